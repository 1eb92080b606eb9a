/* glTF: EXT_lights_ies, luminaires with a measured distribution (client/import/ies). */
#include <math.h>
#include <string.h>

#include "client/import/gltf/gltf.h"
#include "client/import/builder/uri.h"
#include "client/import/ies/ies.h"
#include "common/system/file.h"

/* The picture's row; a profile that cannot be used, or that does not shine, has none. */
static status read_profile(struct gltf *g, size_t index, struct gltf_profile *out)
{
    const struct gltf_place at = gltf_at("EXT_lights_ies.lights", index, "");
    struct buffer bytes = BUFFER_INIT, picture = BUFFER_INIT;
    const char *uri = NULL, *name = "";
    struct image image = {0};
    uint32_t row;
    json_t *profile;
    status result;

    out->image = BUILDER_NO_ROW;
    TRY(gltf_row(g, g->profile_table, &at, &profile));
    TRY(gltf_text(g, profile, &at, "uri", &uri));
    TRY(gltf_text(g, profile, &at, "name", &name));
    if (!*name)
        name = uri && !uri_is_data(uri) ? file_basename(uri) : "IES profile";
    result = gltf_read_bytes(g, profile, &at, uri, &bytes);
    if (result == STATUS_OK) {
        struct error inner = {0};

        result = ies_read(&image, &out->candela, bytes.data, bytes.size, &inner);
        if (result != STATUS_OK)
            result = gltf_fail(g, result, &at, "\"%.80s\": %.200s", name, inner.text);
    }
    THEN(result, out->candela > 0 ? pfm_encode(&picture, &image, g->err) : STATUS_OK);
    if (result == STATUS_OK && out->candela > 0) {
        result = builder_add_image(g->b, name, picture.data, picture.size, &row);
        picture = (struct buffer)BUFFER_INIT; /* taken over */
        out->image = row;
    } else if (result == STATUS_OK) {
        builder_warn(g->b, "dark profile", "%s[%zu] \"%.80s\" has no light in any direction", at.table, index, name);
    } else {
        result = builder_leave_out(g->b, g->name, 0, "light", name, result);
    }
    buffer_release(&picture);
    buffer_release(&bytes);
    image_release(&image);
    return result;
}

/* The picture's axes beside the node's: where the node moves, in a node of their own. */
static status place(struct gltf *g, const struct transform_d *to_world, struct scene_light *out)
{
    static const double nowhere[3] = {0, 0, 0}, unscaled[3] = {1, 1, 1};
    const struct transform_d frame = transform_d_from_trs(nowhere, ies_frame, unscaled);
    struct scene_node turned = {.parent = out->node, .scale = {1, 1, 1}};
    struct transform_d rigid;
    uint32_t row;

    for (int c = 0; c < 3; c++)
        out->position[c] = to_world->m[c][3];
    if (!transform_d_rigid(to_world, &rigid))
        rigid = transform_d_identity();
    for (int c = 0; c < 3; c++)
        rigid.m[c][3] = out->position[c];
    out->to_world = transform_d_multiply(&rigid, &frame);
    if (out->node < 0)
        return STATUS_OK;
    memcpy(turned.rotation, ies_frame, sizeof turned.rotation);
    TRY(builder_add_node(g->b, &turned, &row));
    out->node = (int32_t)row;
    return STATUS_OK;
}

status gltf_ies_light(struct gltf *g, json_t *extension, const struct gltf_place *at_node, const char *node_name,
                      const struct transform_d *to_world, int32_t node, int *added)
{
    const struct gltf_place at = gltf_within(at_node, ".EXT_lights_ies");
    double multiplier = 1, color[3] = {1, 1, 1};
    struct gltf_profile *profile;
    struct scene_light out;
    int64_t index = -1;

    *added = 0;
    TRY(gltf_index(g, extension, &at, "light", g->profile_table, &index));
    TRY(gltf_number(g, extension, &at, "multiplier", &multiplier));
    TRY(gltf_numbers(g, extension, &at, "color", 3, color));
    if (index < 0)
        return gltf_fail(g, STATUS_ERR_INPUT, &at, "names no light");
    profile = &g->profiles[index];
    if (profile->image == GLTF_ROW_UNREAD)
        TRY(read_profile(g, (size_t)index, profile));
    if (profile->image == BUILDER_NO_ROW)
        return STATUS_OK;
    scene_light_default(&out);
    out.kind = LIGHT_GONIOMETRIC;
    out.image = (int32_t)profile->image;
    out.node = node;
    for (int c = 0; c < 3; c++) {
        const double value = fmin(fmax(color[c], 0), 1) * multiplier * profile->candela * g->light_scale[LIGHT_POINT];

        if (!(value >= 0 && value <= (double)SCENE_RADIANCE_MAX))
            return gltf_fail(g, STATUS_ERR_INPUT, &at, "the multiplier is %g: its light must be 0 to %g", multiplier,
                             (double)SCENE_RADIANCE_MAX);
        out.intensity[c] = (float)value;
    }
    TRY(place(g, to_world, &out));
    out.name = builder_name(g->b, node_name);
    *added = 1;
    return builder_add_light(g->b, &out);
}
