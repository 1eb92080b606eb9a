/* Textures in the slots of materials: a factor and a reference to a picture, which is the file's
 * own if it can be used as stored. */
#include <math.h>

#include "client/terminal/must.h"
#include "client/import/pbrt/pbrt_texture_parts.h"

/* Rows of a picture run downwards, pbrt's t upwards. */
static void put_mapping(const double mapping[2][3], double period, struct scene_texture_slot *slot)
{
    for (int i = 0; i < 3; i++) {
        slot->uv_transform[0][i] = (float)(mapping[0][i] / period);
        slot->uv_transform[1][i] = (float)(-mapping[1][i] / period);
    }
    slot->uv_transform[1][2] = (float)(1 - mapping[1][2] / period);
    slot->uv_set = 0;
}

static status texture_row(struct pbrt *p, const struct scene_texture *texture, uint32_t *row)
{
    const uint32_t key[5] = {texture->image, (uint32_t)texture->wrap_u, (uint32_t)texture->wrap_v,
                             (uint32_t)texture->nearest, (uint32_t)texture->encoding};
    uint32_t *known = pbrt_table_find(&p->texture_rows, key, sizeof key);

    if (known) {
        *row = *known;
        return STATUS_OK;
    }
    TRY(builder_add_texture(p->b, texture, row));
    known = must(ARENA_NEW(&p->arena, uint32_t));
    *known = *row;
    pbrt_table_set(&p->texture_rows, &p->arena, key, sizeof key, known);
    return STATUS_OK;
}

status pbrt_slot_put(struct pbrt *p, const struct scene_texture *texture, const double mapping[2][3], double period,
                     struct scene_texture_slot *slot)
{
    uint32_t row;

    TRY(texture_row(p, texture, &row));
    slot->texture = (int32_t)row;
    put_mapping(mapping, period, slot);
    return STATUS_OK;
}

static void no_slot(struct scene_texture_slot *slot)
{
    *slot = (struct scene_texture_slot){.texture = -1};
    slot->uv_transform[0][0] = slot->uv_transform[1][1] = 1;
}

/* A picture that can be used as stored. */
static int is_plain(const struct pbrt_texture *t)
{
    return t->op == TEXTURE_IMAGE && !t->invert && t->is_color &&
           (t->image->is_float || t->gamma == 0 || t->gamma == 1);
}

static status plain_slot(struct pbrt *p, const struct pbrt_texture *t, struct scene_texture_slot *slot)
{
    struct scene_texture texture = {.wrap_u = t->wrap, .wrap_v = t->wrap, .nearest = t->nearest};

    texture.encoding = t->image->is_float ? ENCODING_BY_SLOT
                       : t->gamma == 1    ? ENCODING_LINEAR
                                          : ENCODING_SRGB;
    TRY(pbrt_image_row(p, t->image, &texture.image));
    return pbrt_slot_put(p, &texture, t->mapping, 1, slot);
}

status pbrt_color_slot(struct pbrt *p, const struct pbrt_texture *color, const struct pbrt_texture *alpha, float limit,
                       float factor[3], struct scene_texture_slot *slot)
{
    const struct pbrt_texture *t = color;
    double f[3] = {1, 1, 1};
    int fits = 1;

    no_slot(slot);
    while (t->op == TEXTURE_SCALE && (pbrt_is_constant(t->child[0]) || pbrt_is_constant(t->child[1]))) {
        const int which = pbrt_is_constant(t->child[0]) ? 0 : 1;
        for (int i = 0; i < 3; i++)
            f[i] *= t->child[which]->value[i];
        t = t->child[1 - which];
    }
    if (t->op == TEXTURE_IMAGE && !t->invert)
        for (int i = 0; i < 3; i++)
            f[i] *= t->scale;
    else if (pbrt_is_constant(t))
        for (int i = 0; i < 3; i++)
            f[i] *= t->value[i];
    for (int i = 0; i < 3; i++) {
        fits = fits && f[i] >= 0 && f[i] <= (double)limit;
        factor[i] = (float)fmin(fmax(f[i], 0), (double)limit);
    }
    if (pbrt_is_constant(t) && !alpha)
        return STATUS_OK;
    if (pbrt_is_constant(t)) { /* the factor has the colour, the picture only alpha */
        float ignored[3];
        const struct pbrt_texture *white = pbrt_constant(p, 1, 1, 1);
        return pbrt_bake_color(p, white, alpha, 1, ignored, slot);
    }
    if (is_plain(t) && fits && !alpha)
        return plain_slot(p, t, slot);
    return pbrt_bake_color(p, color, alpha, limit, factor, slot);
}

status pbrt_scalar_slot(struct pbrt *p, const struct pbrt_texture *value, pbrt_change *change, double parameter,
                        float *factor, struct scene_texture_slot *slot)
{
    no_slot(slot);
    if (pbrt_is_constant(value)) {
        const double mean = (value->value[0] + value->value[1] + value->value[2]) / 3;
        *factor = (float)fmin(fmax(change(mean, parameter), 0), 1);
        return STATUS_OK;
    }
    return pbrt_bake_scalar(p, value, change, parameter, factor, slot);
}

status pbrt_image_slot(struct pbrt *p, struct pbrt_image *image, enum scene_encoding encoding, enum scene_wrap wrap,
                       int nearest, struct scene_texture_slot *slot)
{
    static const double identity[2][3] = {{1, 0, 0}, {0, 1, 0}};
    struct scene_texture texture = {
        .wrap_u = wrap, .wrap_v = wrap, .nearest = nearest, .encoding = encoding};

    no_slot(slot);
    TRY(pbrt_image_row(p, image, &texture.image));
    return pbrt_slot_put(p, &texture, identity, 1, slot);
}
