/* Textures other than plain pictures, computed once into a new picture. */
#include <math.h>
#include <string.h>

#include "client/import/pbrt/pbrt_texture_parts.h"
#include "common/system/parallel.h"
#include "common/image/color.h"

/* Common properties of the leaves below a texture. */
struct domain {
    const struct pbrt_texture *first; /* the leaf that gives the mapping */
    int same_mapping;
    int images, checkers, bilerps, ramps, dots;
    double fields[2];          /* of the dots along the mesh's u and v */
    int all_wrap, all_nearest; /* of the images; -1: none, -2: different */
    uint32_t width, height;    /* the largest image */
};

static status collect(struct pbrt *p, const struct pbrt_texture *t, struct domain *d)
{
    for (int i = 0; i < 3; i++)
        if (t->child[i])
            TRY(collect(p, t->child[i], d));
    if (t->op != TEXTURE_IMAGE && t->op != TEXTURE_CHECKER && t->op != TEXTURE_BILERP && t->op != TEXTURE_UV &&
        t->op != TEXTURE_DOTS)
        return STATUS_OK;
    if (!d->first)
        d->first = t;
    else if (memcmp(d->first->mapping, t->mapping, sizeof t->mapping) != 0)
        d->same_mapping = 0;
    d->checkers += t->op == TEXTURE_CHECKER;
    d->bilerps += t->op == TEXTURE_BILERP;
    d->ramps += t->op == TEXTURE_UV;
    d->dots += t->op == TEXTURE_DOTS;
    for (int i = 0; i < 2 && t->op == TEXTURE_DOTS; i++)
        d->fields[i] = fmax(d->fields[i], fabs(t->mapping[i][i]));
    if (t->op != TEXTURE_IMAGE)
        return STATUS_OK;
    TRY(pbrt_image_decode(p, t->image));
    d->images++;
    d->all_wrap = d->all_wrap == -1 || d->all_wrap == (int)t->wrap ? (int)t->wrap : -2;
    d->all_nearest = d->all_nearest == -1 || d->all_nearest == t->nearest ? t->nearest : -2;
    if (t->image->width > d->width)
        d->width = t->image->width;
    if (t->image->height > d->height)
        d->height = t->image->height;
    return STATUS_OK;
}

/* The picture's size, how often (s, t) goes through it, and how it is put on the surface. */
struct canvas {
    uint32_t width, height;
    double period;
    double mapping[2][3]; /* mesh uv to (s, t) */
    enum scene_wrap wrap;
    int nearest;
    int is_smooth; /* 8 bits would show */
};

/* Dots are many texels wide, within the limits. */
static uint32_t dots_side(double fields) { return (uint32_t)fmin(fmax(64 * ceil(fields), 256), PBRT_BAKE_SIDE_MAX / 2); }

static void plan_canvas(const struct domain *d, struct canvas *c)
{
    double scale[2] = {1, 1};

    *c = (struct canvas){.period = 1, .wrap = WRAP_REPEAT};
    c->mapping[0][0] = c->mapping[1][1] = 1;
    if (d->same_mapping && d->first && !d->dots) { /* dots do not repeat after a few fields */
        memcpy(c->mapping, d->first->mapping, sizeof c->mapping);
        c->period = d->checkers ? 2 : 1;
    } else if (d->first) { /* the mesh's own 0..1, fine enough for what is repeated within */
        for (int i = 0; i < 2; i++)
            scale[i] = fmax(1, ceil(fabs(d->first->mapping[i][i])));
    }
    if (d->images) {
        double w = d->width * c->period * scale[0], h = d->height * c->period * scale[1];
        c->width = (uint32_t)fmin(w, PBRT_BAKE_SIDE_MAX);
        c->height = (uint32_t)fmin(h, PBRT_BAKE_SIDE_MAX);
        while ((size_t)c->width * c->height > PBRT_BAKE_TEXELS_MAX)
            c->width = (c->width + 1) / 2, c->height = (c->height + 1) / 2;
        c->nearest = d->all_nearest == 1;
    } else if (d->dots) {
        c->width = c->height = d->bilerps || d->ramps || d->checkers ? 1024 : 1;
    } else if (d->ramps) {
        c->width = c->height = d->checkers ? 512 : 256;
        c->is_smooth = 1;
    } else if (d->bilerps) {
        c->width = c->height = d->checkers ? 256 : 64;
    } else if (d->same_mapping) {
        c->width = c->height = 2; /* a checkerboard is two by two fields */
        c->nearest = 1;
    } else {
        c->width = c->height = 1024;
        c->nearest = 1;
    }
    if (d->dots) {
        c->width = (uint32_t)fmax(c->width, dots_side(d->fields[0]));
        c->height = (uint32_t)fmax(c->height, dots_side(d->fields[1]));
    }
    if (d->images && !d->checkers && !d->ramps && !d->dots && d->same_mapping && d->all_wrap >= 0)
        c->wrap = (enum scene_wrap)d->all_wrap;
    if (!d->images && !d->checkers && !d->ramps && !d->dots && d->bilerps)
        c->wrap = WRAP_CLAMP;
}

/* Texel (x, y) in mesh uv: the inverse of the slot's transform. 0: there is none. */
static int canvas_uv(const struct canvas *c, uint32_t x, uint32_t y, double uv[2])
{
    double s = (x + 0.5) / c->width * c->period, t = (1 - (y + 0.5) / c->height) * c->period;

    if (c->mapping[0][0] == 0 || c->mapping[1][1] == 0)
        return 0;
    uv[0] = (s - c->mapping[0][2]) / c->mapping[0][0];
    uv[1] = (t - c->mapping[1][2]) / c->mapping[1][1];
    return 1;
}

static status add_canvas(struct pbrt *p, const struct canvas *c, const struct image *pixels, int as_pfm,
                         enum scene_encoding encoding, struct scene_texture_slot *slot)
{
    const int fine = c->is_smooth || (size_t)c->width * c->height <= 4096;
    struct scene_texture texture = {.wrap_u = c->wrap,
                                    .wrap_v = c->wrap,
                                    .nearest = c->nearest,
                                    .encoding = encoding};
    struct buffer out = BUFFER_INIT;
    status result = as_pfm ? pfm_encode(&out, pixels, p->err) : png_encode_texture(&out, pixels, fine ? 16 : 8, p->err);

    if (result != STATUS_OK) {
        buffer_release(&out);
        return result;
    }
    TRY(builder_add_image(p->b, "computed", out.data, out.size, &texture.image));
    return pbrt_slot_put(p, &texture, c->mapping, c->period, slot);
}

static status plan(struct pbrt *p, const struct pbrt_texture *a, const struct pbrt_texture *b, struct canvas *c)
{
    struct domain d = {.same_mapping = 1, .all_wrap = -1, .all_nearest = -1};

    TRY(collect(p, a, &d));
    if (b)
        TRY(collect(p, b, &d));
    plan_canvas(&d, c);
    return STATUS_OK;
}

/* The texels of a canvas, row by row: each depends on its place alone. */
struct baker {
    const struct canvas *canvas;
    const struct pbrt_texture *texture, *alpha; /* alpha, change: may be NULL */
    float limit;
    pbrt_change *change;
    double parameter;
    struct image *out;
};

static float within(double v, double most) { return (float)fmin(fmax(v, 0), most); }

static void bake_rows(void *user, size_t begin, size_t end)
{
    const struct baker *b = user;
    const struct canvas *c = b->canvas;

    for (size_t i = begin * c->width; i < end * c->width; i++) {
        float *to = b->out->pixels + i * b->out->channels;
        double uv[2], v[4] = {0}, a[4] = {0};
        int known = canvas_uv(c, (uint32_t)(i % c->width), (uint32_t)(i / c->width), uv);

        if (known)
            pbrt_evaluate(b->texture, uv, v);
        if (known && b->alpha)
            pbrt_evaluate(b->alpha, uv, a);
        if (b->change)
            v[0] = v[1] = v[2] = a[3] = b->change(v[3], b->parameter);
        for (uint32_t k = 0; k < b->out->channels; k++)
            to[k] = within(k < 3 ? v[k] : a[3], k < 3 ? (double)b->limit : 1);
    }
}

status pbrt_bake_color(struct pbrt *p, const struct pbrt_texture *color, const struct pbrt_texture *alpha, float limit,
                       float factor[3], struct scene_texture_slot *slot)
{
    struct image pixels = {0};
    struct canvas c;
    struct baker baker = {
        .canvas = &c, .texture = color, .alpha = alpha, .limit = limit, .out = &pixels};
    size_t values;
    int as_pfm = 0;
    status result;

    TRY(plan(p, color, alpha, &c));
    TRY(image_init(&pixels, c.width, c.height, alpha ? 4 : 3, p->err));
    parallel_for(0, c.height, 1, bake_rows, &baker);
    /* Light above 1 does not fit into a PNG, nor does it need alpha. */
    values = (size_t)c.width * c.height * pixels.channels;
    for (size_t i = 0; i < values; i++)
        as_pfm |= pixels.pixels[i] > 1;
    for (size_t i = 0; !as_pfm && i < values; i++)
        if (i % pixels.channels < 3)
            pixels.pixels[i] = srgb_encode(pixels.pixels[i]);
    result = add_canvas(p, &c, &pixels, as_pfm, as_pfm ? ENCODING_BY_SLOT : ENCODING_SRGB, slot);
    image_release(&pixels);
    pbrt_images_trim(p);
    factor[0] = factor[1] = factor[2] = 1;
    return result;
}

status pbrt_bake_scalar(struct pbrt *p, const struct pbrt_texture *value, pbrt_change *change, double parameter,
                        float *factor, struct scene_texture_slot *slot)
{
    struct image pixels = {0};
    struct canvas c;
    struct baker baker = {.canvas = &c, .texture = value, .limit = 1, .change = change,
                          .parameter = parameter, .out = &pixels};
    status result;

    TRY(plan(p, value, NULL, &c));
    TRY(image_init(&pixels, c.width, c.height, 4, p->err));
    parallel_for(0, c.height, 1, bake_rows, &baker);
    result = add_canvas(p, &c, &pixels, 0, ENCODING_LINEAR, slot);
    image_release(&pixels);
    pbrt_images_trim(p);
    *factor = 1;
    return result;
}
