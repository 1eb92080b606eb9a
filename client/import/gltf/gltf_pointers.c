/* glTF: KHR_animation_pointer, what animations change besides nodes' transforms and weights.
 *
 * A value that is animated is written into the file's own object, as the largest of its keys, before materials, lights
 * and cameras are read: so a factor that is 0 at first does not switch off its textures. Afterwards its keys become
 * tracks of the scene (common/scene/track.h).
 */
#include <math.h>
#include <string.h>

#include "client/import/gltf/gltf.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "common/scene/track.h"

/* ---- what can be animated ---------------------------------------------------------------------- */

enum { FACTORS_MAX = 3, TRACKS_MAX = 1 << 15 };

/* A value of the file. `number`: the field of its target, by its own enum. */
struct gltf_value {
    const char *pointer;            /* #: the row */
    enum scene_track_target target; /* TRACK_TARGETS: no picture shows it */
    int number;
    int components;
    const char *other; /* the value that it is multiplied by; NULL: none */
    float other_default[FACTORS_MAX];
};

#define EXT(name) "/materials/#/extensions/KHR_materials_" name
#define PBR "/materials/#/pbrMetallicRoughness"
#define LIGHT "/extensions/KHR_lights_punctual/lights/#"
#define TRANSFORM "/extensions/KHR_texture_transform"
#define OF_MATERIAL(pointer, value, components) {pointer, TRACK_MATERIAL, MATERIAL_VALUE_##value, components, NULL, {0}}
#define OF_LIGHT(key, field) {LIGHT key, TRACK_LIGHT, TRACK_LIGHT_##field, 1, NULL, {0}}
#define OF_CAMERA(key, field) {"/cameras/#/" key, TRACK_CAMERA, TRACK_CAMERA_##field, 1, NULL, {0}}
#define UNSEEN(pointer) {pointer, TRACK_TARGETS, 0, 1, NULL, {0}}
/* Of textures of directions the offset alone: the mesh's tangents follow from scale and rotation. */
#define OF_DIRECTIONS(pointer, slot) {pointer TRANSFORM "/offset", TRACK_UV_OFFSET, MATERIAL_TEXTURE_##slot, 2, NULL, {0}}
#define OF_TEXTURE(pointer, slot)                                                                           \
    {pointer TRANSFORM "/scale", TRACK_UV_SCALE, MATERIAL_TEXTURE_##slot, 2, NULL, {0}},                    \
    {pointer TRANSFORM "/rotation", TRACK_UV_ROTATION, MATERIAL_TEXTURE_##slot, 1, NULL, {0}},              \
    OF_DIRECTIONS(pointer, slot)

static const struct gltf_value values[] = {
    OF_MATERIAL(PBR "/baseColorFactor", base_color, 4),
    OF_MATERIAL(PBR "/metallicFactor", metallic, 1),
    OF_MATERIAL(PBR "/roughnessFactor", roughness, 1),
    OF_MATERIAL("/materials/#/alphaCutoff", alpha_cutoff, 1),
    OF_MATERIAL("/materials/#/normalTexture/scale", normal_scale, 1),
    {"/materials/#/emissiveFactor", TRACK_MATERIAL, MATERIAL_VALUE_emission, 3, EXT("emissive_strength/emissiveStrength"), {1}},
    {EXT("emissive_strength/emissiveStrength"), TRACK_MATERIAL, MATERIAL_VALUE_emission, 1, "/materials/#/emissiveFactor", {0}},
    OF_MATERIAL(EXT("ior/ior"), ior, 1),
    OF_MATERIAL(EXT("specular/specularFactor"), specular, 1),
    OF_MATERIAL(EXT("specular/specularColorFactor"), specular_color, 3),
    OF_MATERIAL(EXT("transmission/transmissionFactor"), transmission, 1),
    OF_MATERIAL(EXT("volume/attenuationColor"), attenuation_color, 3),
    OF_MATERIAL(EXT("volume/attenuationDistance"), attenuation_distance, 1),
    OF_MATERIAL(EXT("clearcoat/clearcoatFactor"), clearcoat, 1),
    OF_MATERIAL(EXT("clearcoat/clearcoatRoughnessFactor"), clearcoat_roughness, 1),
    OF_MATERIAL(EXT("clearcoat/clearcoatNormalTexture/scale"), clearcoat_normal_scale, 1),
    OF_MATERIAL(EXT("sheen/sheenColorFactor"), sheen_color, 3),
    OF_MATERIAL(EXT("sheen/sheenRoughnessFactor"), sheen_roughness, 1),
    OF_MATERIAL(EXT("iridescence/iridescenceFactor"), iridescence, 1),
    OF_MATERIAL(EXT("iridescence/iridescenceIor"), iridescence_ior, 1),
    OF_MATERIAL(EXT("iridescence/iridescenceThicknessMinimum"), iridescence_thickness_min_nm, 1),
    OF_MATERIAL(EXT("iridescence/iridescenceThicknessMaximum"), iridescence_thickness_max_nm, 1),
    OF_MATERIAL(EXT("anisotropy/anisotropyStrength"), anisotropy, 1),
    OF_MATERIAL(EXT("anisotropy/anisotropyRotation"), anisotropy_rotation_rad, 1),
    OF_MATERIAL(EXT("dispersion/dispersion"), dispersion, 1),
    OF_MATERIAL(EXT("diffuse_transmission/diffuseTransmissionFactor"), diffuse_transmission, 1),
    OF_MATERIAL(EXT("diffuse_transmission/diffuseTransmissionColorFactor"), diffuse_transmission_color, 3),
    OF_MATERIAL(EXT("diffuse_roughness/diffuseRoughnessFactor"), diffuse_roughness, 1),
    OF_TEXTURE(PBR "/baseColorTexture", base_color),
    OF_TEXTURE(PBR "/metallicRoughnessTexture", metallic_roughness),
    OF_DIRECTIONS("/materials/#/normalTexture", normal),
    OF_TEXTURE("/materials/#/emissiveTexture", emission),
    OF_TEXTURE(EXT("specular/specularTexture"), specular),
    OF_TEXTURE(EXT("specular/specularColorTexture"), specular_color),
    OF_TEXTURE(EXT("transmission/transmissionTexture"), transmission),
    OF_TEXTURE(EXT("clearcoat/clearcoatTexture"), clearcoat),
    OF_TEXTURE(EXT("clearcoat/clearcoatRoughnessTexture"), clearcoat_roughness),
    OF_DIRECTIONS(EXT("clearcoat/clearcoatNormalTexture"), clearcoat_normal),
    OF_TEXTURE(EXT("sheen/sheenColorTexture"), sheen_color),
    OF_TEXTURE(EXT("sheen/sheenRoughnessTexture"), sheen_roughness),
    OF_TEXTURE(EXT("iridescence/iridescenceTexture"), iridescence),
    OF_TEXTURE(EXT("iridescence/iridescenceThicknessTexture"), iridescence_thickness),
    OF_DIRECTIONS(EXT("anisotropy/anisotropyTexture"), anisotropy),
    OF_TEXTURE(EXT("diffuse_transmission/diffuseTransmissionTexture"), diffuse_transmission),
    OF_TEXTURE(EXT("diffuse_transmission/diffuseTransmissionColorTexture"), diffuse_transmission_color),
    OF_TEXTURE(EXT("diffuse_roughness/diffuseRoughnessTexture"), diffuse_roughness),
    {LIGHT "/color", TRACK_LIGHT, TRACK_LIGHT_INTENSITY, 3, LIGHT "/intensity", {1}},
    {LIGHT "/intensity", TRACK_LIGHT, TRACK_LIGHT_INTENSITY, 1, LIGHT "/color", {1, 1, 1}},
    OF_LIGHT("/range", RANGE),
    OF_LIGHT("/spot/innerConeAngle", INNER_CONE),
    OF_LIGHT("/spot/outerConeAngle", OUTER_CONE),
    OF_CAMERA("perspective/yfov", YFOV),
    OF_CAMERA("orthographic/ymag", YMAG),
    {"/nodes/#/extensions/KHR_node_visibility/visible", TRACK_INSTANCE, 0, 1, NULL, {0}},
    UNSEEN("/materials/#/occlusionTexture/strength"),
    UNSEEN("/materials/#/occlusionTexture" TRANSFORM "/scale"),
    UNSEEN("/materials/#/occlusionTexture" TRANSFORM "/rotation"),
    UNSEEN("/materials/#/occlusionTexture" TRANSFORM "/offset"),
    UNSEEN("/cameras/#/perspective/znear"),
    UNSEEN("/cameras/#/perspective/zfar"),
    UNSEEN("/cameras/#/orthographic/znear"),
    UNSEEN("/cameras/#/orthographic/zfar"),
};

/* The pointer's row, if it is of this form; -1: it is not. */
static int64_t match(const char *form, const char *pointer)
{
    int64_t row = 0;

    for (; *form && *pointer; form++) {
        if (*form != '#') {
            if (*form != *pointer++)
                return -1;
            continue;
        }
        if (*pointer < '0' || *pointer > '9')
            return -1;
        for (; *pointer >= '0' && *pointer <= '9'; pointer++)
            if ((row = row * 10 + (*pointer - '0')) > UINT32_MAX)
                return -1;
    }
    return *form || *pointer ? -1 : row;
}

const struct gltf_value *gltf_value_find(const char *pointer, uint32_t *row)
{
    for (size_t i = 0; i < sizeof values / sizeof *values; i++) {
        const int64_t found = match(values[i].pointer, pointer);

        if (found >= 0) {
            *row = (uint32_t)found;
            return &values[i];
        }
    }
    return NULL;
}

int gltf_value_is_seen(const struct gltf_value *value) { return value->target != TRACK_TARGETS; }

/* ---- in the file ----------------------------------------------------------------------------- */

/* May the object be added? Its values have defaults without it. */
static int may_be_added(const char *key)
{
    return strcmp(key, "extensions") == 0 || strcmp(key, "pbrMetallicRoughness") == 0 || strcmp(key, "spot") == 0 ||
           strncmp(key, "KHR_", 4) == 0;
}

/* The object with the value, and the value's key; NULL: the file does not have it. `add`: what may be missing is added. */
static json_t *object_of(struct gltf *g, const char *form, uint32_t row, int add, char key[GLTF_KEY_MAX])
{
    json_t *at = g->root;

    for (const char *step = form + 1;; step += strcspn(step, "/") + 1) {
        const size_t length = strcspn(step, "/");
        json_t *next;

        memcpy(key, step, length);
        key[length] = '\0';
        if (!step[length])
            return json_is_object(at) ? at : NULL;
        next = *key == '#' ? json_array_get(at, row) : json_object_get(at, key);
        if (!next && add && json_is_object(at) && may_be_added(key)) {
            next = must(json_object());
            if (json_object_set_new(at, key, next) != 0)
                must(NULL);
        }
        at = next;
    }
}

/* Its numbers; where there are none, `initial`'s. Returns how many. */
static int numbers_of(struct gltf *g, const char *form, uint32_t row, const float *initial, int count, float *out)
{
    char key[GLTF_KEY_MAX];
    json_t *in = json_object_get(object_of(g, form, row, 0, key), key);

    for (int i = 0; i < count; i++) {
        json_t *number = json_is_array(in) ? json_array_get(in, (size_t)i) : in;

        out[i] = json_is_number(number) ? (float)json_number_value(number) : initial[i];
    }
    return count;
}

static const float *key_value(const struct scene_channel *keys, uint32_t key)
{
    return keys->values +
           (size_t)keys->components * (keys->interpolation == INTERPOLATE_CUBIC ? 3 * (size_t)key + 1 : (size_t)key);
}

static const float *largest_of(const struct scene_channel *keys)
{
    const float *largest = key_value(keys, 0);
    double most = -1;

    for (uint32_t k = 0; k < keys->key_count; k++) {
        const float *value = key_value(keys, k);
        double sum = 0;

        for (uint32_t i = 0; i < keys->components; i++)
            sum += fabs((double)value[i]);
        if (sum > most) {
            most = sum;
            largest = value;
        }
    }
    return largest;
}

static json_t *to_json(const struct gltf_value *value, const float *numbers)
{
    json_t *list;

    if (value->target == TRACK_INSTANCE)
        return json_boolean(numbers[0] >= 0.5f);
    if (value->components == 1)
        return must(json_real((double)numbers[0]));
    list = must(json_array());
    for (int i = 0; i < value->components; i++)
        if (json_array_append_new(list, must(json_real((double)numbers[i]))) != 0)
            must(NULL);
    return list;
}

/* ---- reading --------------------------------------------------------------------------------- */

static struct gltf_track *track_of(const struct gltf *g, const struct gltf_value *value, uint32_t row)
{
    for (size_t i = 0; i < g->track_count; i++)
        if (g->tracks[i].value == value && g->tracks[i].row == row)
            return &g->tracks[i];
    return NULL;
}

static int is_there(struct gltf *g, const struct gltf_value *value, uint32_t row, const struct gltf_place *at)
{
    char key[GLTF_KEY_MAX];
    json_t *in = object_of(g, value->pointer, row, 1, key);

    if (!in)
        builder_warn(g->b, "nothing to animate", "%s[%zu]%s: animates \"%s\" of row %u, which the file does not have: left out",
                     at->table, at->row, at->part, value->pointer, row);
    else if (track_of(g, value, row))
        builder_warn(g->b, "animated twice",
                     "%s[%zu]%s: animates \"%s\" of row %u, which an earlier channel does already: the first is taken "
                     "(--animation \"%.80s\" takes this animation alone)",
                     at->table, at->row, at->part, value->pointer, row, g->b->out->animations[at->row].name);
    return in && !track_of(g, value, row);
}

status gltf_track(struct gltf *g, const struct gltf_value *value, uint32_t row, json_t *sampler,
                  const struct gltf_place *at_sampler, const struct gltf_place *at, double *duration_s)
{
    struct gltf_track out = {.value = value, .row = row, .at = *at, .keys.components = (uint32_t)value->components};
    char key[GLTF_KEY_MAX];
    status result;

    if (g->track_count >= TRACKS_MAX)
        return gltf_fail(g, STATUS_ERR_LIMIT, at,
                         "is more than %d animated values: choose an animation with --animation", TRACKS_MAX);
    if (!is_there(g, value, row, at))
        return STATUS_OK;
    out.keys.path = PATH_WEIGHTS;
    result = gltf_keys(g, sampler, at_sampler, value->pointer, &out.keys);
    if (result != STATUS_OK) {
        gltf_keys_release(&out.keys);
        return result;
    }
    if (value->target == TRACK_INSTANCE)
        out.keys.interpolation = INTERPOLATE_STEP;
    *duration_s = fmax(*duration_s, (double)out.keys.times[out.keys.key_count - 1]);
    if (json_object_set_new(object_of(g, value->pointer, row, 1, key), key, to_json(value, largest_of(&out.keys))) != 0)
        must(NULL);
    if (gltf_keys_are_still(&out.keys)) { /* the value, not a motion: it is in the file now */
        gltf_keys_release(&out.keys);
        return STATUS_OK;
    }
    if (value->target == TRACK_INSTANCE)
        g->node_data[row].visible = (int32_t)g->track_count;
    MUST_GROW(g->tracks, g->track_capacity, g->track_count + 1);
    g->tracks[g->track_count++] = out;
    return STATUS_OK;
}

void gltf_tracks_free(struct gltf *g)
{
    for (size_t i = 0; i < g->track_count; i++)
        gltf_keys_release(&g->tracks[i].keys);
    mem_free(g->tracks);
    mem_free(g->placed);
}

/* ---- into the scene -------------------------------------------------------------------------- */

void gltf_note_placed(struct gltf *g, enum scene_track_target target, size_t file_row, size_t node, size_t row)
{
    if (g->track_count == 0)
        return;
    MUST_GROW(g->placed, g->placed_capacity, g->placed_count + 1);
    g->placed[g->placed_count++] = (struct gltf_placed){target, (uint32_t)file_row, (uint32_t)node, (uint32_t)row};
}

/* The keys of `track` times `by`, for as many numbers as that has. Values outside of the field's range are brought into it. */
static status add_keys(struct gltf *g, const struct gltf_track *from, struct scene_track *track, const double *by, int count)
{
    const struct scene_channel *keys = &from->keys;
    const uint32_t parts = keys->interpolation == INTERPOLATE_CUBIC ? 3 : 1, rows = keys->key_count * parts;
    float *numbers = must(mem_alloc_array((size_t)rows * (size_t)count, sizeof *numbers));
    float least, most;
    double outside = 0;
    int clamped = 0;
    status result;

    g->key_floats += (size_t)rows * (size_t)count;
    if (g->key_floats > GLTF_KEY_FLOATS_MAX) {
        mem_free(numbers);
        return gltf_fail(g, STATUS_ERR_LIMIT, &from->at, "animates more than %d values in all that it hides or changes",
                         GLTF_KEY_FLOATS_MAX);
    }
    (void)scene_track_count(track, &least, &most);
    for (uint32_t r = 0; r < rows; r++)
        for (int i = 0; i < count; i++) {
            const double number = (double)keys->values[(size_t)r * keys->components + (keys->components > 1 ? (size_t)i : 0)] * by[i];
            const double kept = fmin(fmax(number, (double)least), track->factor ? (double)SCENE_RADIANCE_MAX : (double)most);
            const int is_value = parts == 1 || r % 3 == 1;

            if (is_value && kept != number) {
                outside = number;
                clamped = 1;
            }
            numbers[(size_t)r * (size_t)count + (size_t)i] =
                (float)(is_value ? kept : fmin(fmax(number, -(double)SCENE_RADIANCE_MAX), (double)SCENE_RADIANCE_MAX));
        }
    if (clamped)
        builder_warn(g->b, "animated out of range", "%s[%zu]%s: animates \"%s\" to %g: brought into its range",
                     from->at.table, from->at.row, from->at.part, from->value->pointer, outside);
    track->keys = *keys;
    track->keys.values = numbers;
    track->keys.components = (uint32_t)count;
    result = builder_add_track(g->b, track);
    mem_free(numbers);
    return result;
}

static const struct gltf_value *value_at(const char *form)
{
    for (size_t i = 0; i < sizeof values / sizeof *values; i++)
        if (strcmp(values[i].pointer, form) == 0)
            return &values[i];
    return NULL;
}

/* A product, of a colour and a number: where both are animated, the colour is the value and the number its factor. */
static status add_product(struct gltf *g, const struct gltf_track *from, struct scene_track *track, double unit)
{
    const struct gltf_value *value = from->value;
    const int is_number = value->components == 1;
    double by[FACTORS_MAX];
    float other[FACTORS_MAX] = {1, 1, 1};

    if (track_of(g, value_at(value->other), from->row)) {
        track->factor = is_number;
        return add_keys(g, from, track, is_number ? (const double[]){1} : (const double[]){unit, unit, unit}, value->components);
    }
    (void)numbers_of(g, value->other, from->row, value->other_default, is_number ? FACTORS_MAX : 1, other);
    for (int i = 0; i < FACTORS_MAX; i++)
        by[i] = unit * (double)other[is_number ? i : 0];
    return add_keys(g, from, track, by, FACTORS_MAX);
}

static status add_track(struct gltf *g, const struct gltf_track *from, uint32_t row)
{
    static const double ones[] = {1, 1, 1, 1};
    const struct gltf_value *value = from->value;
    struct scene_track track = {.target = value->target, .row = row, .field = (uint32_t)value->number};
    double unit = 1;

    if (value->target == TRACK_MATERIAL)
        track.field = scene_track_value((enum material_value_number)value->number);
    else if (value->target <= TRACK_UV_OFFSET)
        track.field = scene_track_texture((enum material_texture)value->number);
    else if (value->target == TRACK_LIGHT)
        unit = g->light_scale[g->b->lights[row].kind];
    if (value->other)
        return add_product(g, from, &track, unit);
    return add_keys(g, from, &track, ones, value->components);
}

/* Of T R S a rotation needs its scale beside it, and a scale its rotation: one that is not animated has one key. */
static status add_partner(struct gltf *g, const struct gltf_track *from, uint32_t row)
{
    static const float initial[] = {1, 1};
    const struct gltf_value *partner = from->value + (from->value->target == TRACK_UV_SCALE ? 1 : -1);
    float time = 0, number[2] = {0, 0};
    struct gltf_track still = {.value = partner, .row = from->row, .at = from->at};

    if (from->value->target == TRACK_UV_OFFSET || track_of(g, partner, from->row))
        return STATUS_OK;
    (void)numbers_of(g, partner->pointer, from->row, partner->components > 1 ? initial : number, partner->components, number);
    still.keys = (struct scene_channel){.path = PATH_WEIGHTS, .interpolation = INTERPOLATE_STEP, .key_count = 1,
                                        .components = (uint32_t)partner->components, .times = &time, .values = number};
    return add_track(g, &still, row);
}

/* Does the material read the value? Not what stands beside the archived model, and no emission of which the texture, which
 * may say that a small part glows, cannot be read (gltf_materials.c). */
static int reads(struct gltf *g, const struct gltf_track *from, uint32_t row)
{
    const float *emission = g->b->materials[row].emission;

    if (strncmp(from->value->pointer, PBR, strlen(PBR)) == 0 &&
        gltf_extension(json_array_get(g->materials, from->row), "KHR_materials_pbrSpecularGlossiness"))
        return 0;
    return from->value->target != TRACK_MATERIAL || from->value->number != MATERIAL_VALUE_emission || emission[0] > 0 ||
           emission[1] > 0 || emission[2] > 0;
}

static status add_to_material(struct gltf *g, const struct gltf_track *from)
{
    const int64_t row = g->material_rows[from->row];

    if (row < 0 || !reads(g, from, (uint32_t)row)) /* or nothing has the material */
        return STATUS_OK;
    TRY(add_track(g, from, (uint32_t)row));
    return from->value->target == TRACK_MATERIAL ? STATUS_OK : add_partner(g, from, (uint32_t)row);
}

/* What the nodes above hide at times: of lights the intensity is 0 then. */
static status add_visibility(struct gltf *g, const struct gltf_placed *placed)
{
    static const double one[] = {1};
    struct scene_track track = {.target = placed->target, .row = placed->row, .factor = placed->target == TRACK_LIGHT ? 2 : 0};

    if (placed->target == TRACK_CAMERA)
        return STATUS_OK;
    for (int64_t node = placed->node; node >= 0; node = g->node_data[node].parent)
        if (g->node_data[node].visible >= 0) {
            TRY(add_keys(g, &g->tracks[g->node_data[node].visible], &track, one, 1));
            track.factor++;
        }
    return STATUS_OK;
}

status gltf_add_tracks(struct gltf *g)
{
    for (size_t i = 0; i < g->track_count; i++)
        if (g->tracks[i].value->target <= TRACK_UV_OFFSET)
            TRY(add_to_material(g, &g->tracks[i]));
    for (size_t i = 0; i < g->placed_count; i++) {
        const struct gltf_placed *placed = &g->placed[i];

        for (size_t k = 0; k < g->track_count && placed->target != TRACK_INSTANCE; k++)
            if (g->tracks[k].value->target == placed->target && g->tracks[k].row == placed->file_row)
                TRY(add_track(g, &g->tracks[k], placed->row));
        TRY(add_visibility(g, placed));
    }
    return STATUS_OK;
}
