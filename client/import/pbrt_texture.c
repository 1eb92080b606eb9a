/* Textures: a small expression each, that becomes a factor and a reference to a picture. What
 * is no plain picture is computed here, once, into a new one. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "client/import/pbrt.h"
#include "common/base/memory.h"
#include "common/image/color.h"
#include "common/math/elementary.h"

/* ---- reading ------------------------------------------------------------------------------ */

static struct pbrt_texture *texture_new(struct pbrt *p, enum pbrt_texture_op op)
{
    struct pbrt_texture *t = ARENA_NEW(&p->arena, struct pbrt_texture);

    if (t) {
        t->op = op;
        t->is_color = 1;
        t->scale = 1;
        t->cost = 1;
        t->mapping[0][0] = t->mapping[1][1] = 1;
    }
    return t;
}

const struct pbrt_texture *pbrt_constant(struct pbrt *p, double r, double g, double b)
{
    struct pbrt_texture *t = texture_new(p, TEXTURE_CONSTANT);

    if (t) {
        t->value[0] = r;
        t->value[1] = g;
        t->value[2] = b;
    }
    return t;
}

static void texture_weigh(struct pbrt_texture *t)
{
    for (int i = 0; i < 3; i++)
        if (t->child[i]) {
            t->cost += t->child[i]->cost;
            if (t->depth <= t->child[i]->depth)
                t->depth = t->child[i]->depth + 1;
        }
}

static int is_constant(const struct pbrt_texture *t)
{
    return t->op == TEXTURE_CONSTANT;
}

/* What can be computed at once, is. */
static const struct pbrt_texture *fold(struct pbrt *p, struct pbrt_texture *t)
{
    const struct pbrt_texture *const *c = t->child;
    double v[3];

    if (t->op == TEXTURE_SCALE && is_constant(c[0]) && is_constant(c[1]))
        for (int i = 0; i < 3; i++)
            v[i] = c[0]->value[i] * c[1]->value[i];
    else if (t->op == TEXTURE_MIX && is_constant(c[0]) && is_constant(c[1]) && is_constant(c[2]))
        for (int i = 0; i < 3; i++)
            v[i] = c[0]->value[i] * (1 - c[2]->value[i]) + c[1]->value[i] * c[2]->value[i];
    else
        return t;
    return pbrt_constant(p, v[0], v[1], v[2]);
}

const struct pbrt_texture *pbrt_product(struct pbrt *p, const struct pbrt_texture *a,
                                        const struct pbrt_texture *b)
{
    struct pbrt_texture *t = texture_new(p, TEXTURE_SCALE);

    if (!t)
        return NULL;
    t->child[0] = a;
    t->child[1] = b;
    t->is_color = a->is_color || b->is_color;
    texture_weigh(t);
    return fold(p, t);
}

static status find_texture(struct pbrt *p, const struct pbrt_param *param, int color,
                           const struct pbrt_texture **out)
{
    const char *name = param->strings[0];
    const struct pbrt_table *first = color ? &p->color_textures : &p->float_textures,
                            *second = color ? &p->float_textures : &p->color_textures;

    *out = pbrt_name_find(first, name);
    if (!*out)
        *out = pbrt_name_find(second, name);
    if (!*out)
        return pbrt_fail(p, STATUS_ERR_INPUT, &param->at,
                         "the texture \"%.80s\" is not known: define it above", name);
    return STATUS_OK;
}

status pbrt_float_texture(struct pbrt *p, struct pbrt_params *params, const char *name,
                          const struct pbrt_texture **out)
{
    const struct pbrt_param *param = pbrt_param(params, name, PBRT_NUMBERS |
                                                                  PBRT_BIT(PBRT_TEXTURE));
    struct pbrt_texture *t;

    *out = NULL;
    if (!param)
        return STATUS_OK;
    if (param->type == PBRT_TEXTURE)
        return find_texture(p, param, 0, out);
    t = texture_new(p, TEXTURE_CONSTANT);
    if (!t)
        return error_no_memory(p->err, "a texture");
    t->is_color = 0;
    t->value[0] = t->value[1] = t->value[2] = param->numbers[0];
    *out = t;
    return STATUS_OK;
}

status pbrt_color_texture(struct pbrt *p, struct pbrt_params *params, const char *name,
                          enum pbrt_use use, const struct pbrt_texture **out)
{
    const struct pbrt_param *param = pbrt_param(params, name, PBRT_COLORS | PBRT_NUMBERS |
                                                                  PBRT_BIT(PBRT_TEXTURE));
    double rgb[3];

    *out = NULL;
    if (!param)
        return STATUS_OK;
    if (param->type == PBRT_TEXTURE)
        return find_texture(p, param, 1, out);
    if (param->type == PBRT_FLOAT || param->type == PBRT_INTEGER)
        rgb[0] = rgb[1] = rgb[2] = param->numbers[0];
    else
        TRY(pbrt_color_of(p, param, params->color_space, use, rgb));
    *out = pbrt_constant(p, rgb[0], rgb[1], rgb[2]);
    return *out ? STATUS_OK : error_no_memory(p->err, "a texture");
}

/* A child that may be missing. */
static status child_or(struct pbrt *p, const struct pbrt_directive *d, const char *name, int color,
                       double otherwise, const struct pbrt_texture **out)
{
    if (color)
        TRY(pbrt_color_texture(p, d->params, name, USE_UNBOUNDED, out));
    else
        TRY(pbrt_float_texture(p, d->params, name, out));
    if (!*out)
        *out = pbrt_constant(p, otherwise, otherwise, otherwise);
    return *out ? STATUS_OK : error_no_memory(p->err, "a texture");
}

static status read_mapping(struct pbrt *p, const struct pbrt_directive *d, struct pbrt_texture *t)
{
    const char *kind = pbrt_string(d->params, "mapping", "uv");
    static const char *const planar[] = {"v1", "v2", NULL};

    t->mapping[0][0] = pbrt_float(d->params, "uscale", 1);
    t->mapping[1][1] = pbrt_float(d->params, "vscale", 1);
    t->mapping[0][2] = pbrt_float(d->params, "udelta", 0);
    t->mapping[1][2] = pbrt_float(d->params, "vdelta", 0);
    if (strcmp(kind, "uv") != 0) {
        pbrt_ignore(d->params, planar);
        pbrt_warn(p, &d->at, "texture mapping",
                  "the texture mapping \"%.40s\" is not supported: the surface's u and v are used",
                  kind);
    }
    for (int i = 0; i < 2; i++)
        if (!(fabs(t->mapping[i][i]) < 1e5) || !(fabs(t->mapping[i][2]) < 1e5))
            return pbrt_fail(p, STATUS_ERR_INPUT, &d->at,
                             "a texture's scale and delta must be below 100000");
    return STATUS_OK;
}

static enum scene_wrap wrap_of(struct pbrt *p, const struct pbrt_directive *d)
{
    const char *wrap = pbrt_string(d->params, "wrap", "repeat");

    if (strcmp(wrap, "repeat") == 0)
        return WRAP_REPEAT;
    if (strcmp(wrap, "clamp") == 0)
        return WRAP_CLAMP;
    if (strcmp(wrap, "black") == 0)
        return WRAP_BLACK;
    pbrt_warn(p, &d->at, "texture wrap", "the wrap mode \"%.40s\" is not supported: repeated",
              wrap);
    return WRAP_REPEAT;
}

static void read_encoding(struct pbrt *p, const struct pbrt_directive *d, struct pbrt_texture *t)
{
    const char *encoding = pbrt_string(d->params, "encoding", "sRGB");
    double power;

    /* pbrt-v3's: whether to decode; the default for colours. */
    if (!pbrt_bool(d->params, "gamma", t->is_color || !p->version3))
        t->gamma = 1;
    if (strcmp(encoding, "linear") == 0)
        t->gamma = 1;
    else if (strncmp(encoding, "gamma ", 6) == 0 && pbrt_number(encoding + 6, &power) &&
             power > 0.1 && power < 10)
        t->gamma = power;
    else if (strcmp(encoding, "sRGB") != 0 && strcmp(encoding, "srgb") != 0)
        pbrt_warn(p, &d->at, "texture encoding",
                  "the encoding \"%.40s\" is not known: taken as sRGB", encoding);
}

static status read_imagemap(struct pbrt *p, const struct pbrt_directive *d, int color,
                            struct pbrt_texture **out)
{
    static const char *const unneeded[] = {"maxanisotropy", "trilinear", NULL};
    const char *name = pbrt_string(d->params, "filename", NULL);
    struct pbrt_texture *t = texture_new(p, TEXTURE_IMAGE);
    const char *filter;

    *out = t;
    if (!t)
        return error_no_memory(p->err, "a texture");
    t->is_color = color;
    if (!name)
        return pbrt_fail(p, STATUS_ERR_INPUT, &d->at, "the texture names no \"string filename\"");
    TRY(read_mapping(p, d, t));
    t->wrap = wrap_of(p, d);
    read_encoding(p, d, t);
    filter = pbrt_string(d->params, "filter", "bilinear");
    t->nearest = strcmp(filter, "point") == 0;
    t->scale = pbrt_float(d->params, "scale", 1);
    t->invert = pbrt_bool(d->params, "invert", 0);
    pbrt_ignore(d->params, unneeded);
    TRY(pbrt_image(p, name, &d->at, &t->image));
    if (!t->image) { /* warned about: mid grey */
        t->op = TEXTURE_CONSTANT;
        t->value[0] = t->value[1] = t->value[2] = 0.5;
    }
    return STATUS_OK;
}

static status read_checkerboard(struct pbrt *p, const struct pbrt_directive *d, int color,
                                struct pbrt_texture **out)
{
    struct pbrt_texture *t = texture_new(p, TEXTURE_CHECKER);

    *out = t;
    if (!t)
        return error_no_memory(p->err, "a texture");
    TRY(read_mapping(p, d, t));
    if (pbrt_integer(d->params, "dimension", 2) != 2)
        pbrt_warn(p, &d->at, "checkerboard",
                  "a checkerboard of three dimensions is not supported: one of two is used");
    (void)pbrt_string(d->params, "aamode", NULL);
    TRY(child_or(p, d, "tex1", color, 1, &t->child[0]));
    return child_or(p, d, "tex2", color, 0, &t->child[1]);
}

static status read_bilerp(struct pbrt *p, const struct pbrt_directive *d, int color,
                          struct pbrt_texture **out)
{
    static const char *const names[4] = {"v00", "v01", "v10", "v11"};
    struct pbrt_texture *t = texture_new(p, TEXTURE_BILERP);

    *out = t;
    if (!t)
        return error_no_memory(p->err, "a texture");
    TRY(read_mapping(p, d, t));
    for (int i = 0; i < 4; i++) {
        const struct pbrt_texture *value;
        TRY(child_or(p, d, names[i], color, i & 1, &value));
        if (!is_constant(value))
            return pbrt_fail(p, STATUS_ERR_INPUT, &d->at,
                             "\"%s\" of a bilerp texture must be constant", names[i]);
        memcpy(t->corner[i], value->value, sizeof t->corner[i]);
    }
    return STATUS_OK;
}

static status read_combination(struct pbrt *p, const struct pbrt_directive *d, int color,
                               struct pbrt_texture **out)
{
    struct pbrt_texture *t;

    if (strcmp(d->kind, "constant") == 0) {
        const struct pbrt_texture *value;
        TRY(child_or(p, d, "value", color, 1, &value));
        *out = texture_new(p, TEXTURE_CONSTANT);
        if (!*out)
            return error_no_memory(p->err, "a texture");
        memcpy((*out)->value, value->value, sizeof value->value);
        return STATUS_OK;
    }
    t = texture_new(p, strcmp(d->kind, "scale") == 0          ? TEXTURE_SCALE
                       : strcmp(d->kind, "directionmix") == 0 ? TEXTURE_DIRECTION_MIX
                                                              : TEXTURE_MIX);
    *out = t;
    if (!t)
        return error_no_memory(p->err, "a texture");
    if (t->op == TEXTURE_SCALE && (pbrt_has(d->params, "tex1") || pbrt_has(d->params, "tex2"))) {
        TRY(child_or(p, d, "tex1", color, 1, &t->child[0])); /* pbrt-v3 */
        return child_or(p, d, "tex2", color, 1, &t->child[1]);
    }
    if (t->op == TEXTURE_SCALE) {
        TRY(child_or(p, d, "tex", color, 1, &t->child[0]));
        return child_or(p, d, "scale", 0, 1, &t->child[1]);
    }
    TRY(child_or(p, d, "tex1", color, t->op == TEXTURE_MIX ? 0 : 1, &t->child[0]));
    TRY(child_or(p, d, "tex2", color, t->op == TEXTURE_MIX ? 1 : 0, &t->child[1]));
    if (t->op == TEXTURE_DIRECTION_MIX) {
        pbrt_warn(p, &d->at, "directionmix",
                  "a texture \"directionmix\" is not supported: its \"tex1\" is used");
        (void)pbrt_param(d->params, "dir", ~0u);
        t->child[1] = NULL;
        return STATUS_OK;
    }
    return child_or(p, d, "amount", 0, 0.5, &t->child[2]);
}

static int is_one_of(const char *word, const char *const *list)
{
    for (; *list; list++)
        if (strcmp(word, *list) == 0)
            return 1;
    return 0;
}

status pbrt_texture(struct pbrt *p, const char *name, const char *type,
                    const struct pbrt_directive *d)
{
    static const char *const combinations[] = {"constant", "scale", "mix", "directionmix", NULL};
    int color = strcmp(type, "spectrum") == 0 || strcmp(type, "color") == 0;
    const struct pbrt_texture *made;
    struct pbrt_texture *t = NULL;
    char what[128];

    if (!color && strcmp(type, "float") != 0)
        return pbrt_fail(p, STATUS_ERR_INPUT, &d->at,
                         "a texture is of type \"float\" or \"spectrum\", not \"%.40s\"", type);
    if (strcmp(d->kind, "imagemap") == 0)
        TRY(read_imagemap(p, d, color, &t));
    else if (strcmp(d->kind, "checkerboard") == 0)
        TRY(read_checkerboard(p, d, color, &t));
    else if (strcmp(d->kind, "bilerp") == 0)
        TRY(read_bilerp(p, d, color, &t));
    else if (is_one_of(d->kind, combinations))
        TRY(read_combination(p, d, color, &t));
    else {
        char kind[128];
        snprintf(kind, sizeof kind, "texture %.60s", d->kind);
        pbrt_warn(p, &d->at, kind,
                  "the texture kind \"%.60s\" is not supported: mid grey instead", d->kind);
        t = texture_new(p, TEXTURE_CONSTANT);
        if (!t)
            return error_no_memory(p->err, "a texture");
        t->value[0] = t->value[1] = t->value[2] = 0.5;
        for (size_t i = 0; i < d->params->count; i++)
            d->params->items[i].used = 1;
    }
    t->is_color = color;
    texture_weigh(t);
    if (t->depth > PBRT_TEXTURE_DEPTH_MAX || t->cost > PBRT_TEXTURE_COST_MAX)
        return pbrt_fail(p, STATUS_ERR_LIMIT, &d->at,
                         "textures are built of one another more than %d deep or of more than %d",
                         PBRT_TEXTURE_DEPTH_MAX, PBRT_TEXTURE_COST_MAX);
    made = fold(p, t);
    if (!made)
        return error_no_memory(p->err, "a texture");
    snprintf(what, sizeof what, "texture \"%.60s\"", d->kind);
    pbrt_params_report(d->params, p->b, what);
    return pbrt_name_set(p, color ? &p->color_textures : &p->float_textures, name, made);
}

/* ---- looking up --------------------------------------------------------------------------- */

static double decode(const struct pbrt_texture *t, float encoded)
{
    if (t->image->is_float || t->gamma == 1)
        return (double)encoded;
    if (t->gamma == 0)
        return (double)srgb_decode(encoded);
    return (double)det_pow(encoded, (float)t->gamma);
}

/* Texel (x, y), row 0 at the top, as colour and as the number that pbrt takes from it. */
static void texel(const struct pbrt_texture *t, long x, long y, double out[4])
{
    const struct image *im = &t->image->pixels;
    long w = (long)im->width, h = (long)im->height;
    const float *from;

    memset(out, 0, 4 * sizeof *out);
    if (t->wrap == WRAP_BLACK && (x < 0 || y < 0 || x >= w || y >= h))
        return;
    if (t->wrap == WRAP_CLAMP) {
        x = x < 0 ? 0 : x >= w ? w - 1 : x;
        y = y < 0 ? 0 : y >= h ? h - 1 : y;
    } else {
        x = (x % w + w) % w;
        y = (y % h + h) % h;
    }
    from = im->pixels + ((size_t)y * im->width + (size_t)x) * im->channels;
    for (unsigned c = 0; c < 3; c++)
        out[c] = decode(t, from[im->channels >= 3 ? c : 0]);
    out[3] = im->channels < 3    ? out[0]
             : im->channels == 3 ? (out[0] + out[1] + out[2]) / 3
                                 : (double)from[3];
}

static void look_up_image(const struct pbrt_texture *t, double s, double up, double out[4])
{
    const struct image *im = &t->image->pixels;
    double x = s * im->width, y = (1 - up) * im->height;

    if (!(fabs(x) < 1e15) || !(fabs(y) < 1e15))
        x = y = 0;
    if (t->nearest) {
        texel(t, (long)floor(x), (long)floor(y), out);
    } else {
        double fx = floor(x - 0.5), fy = floor(y - 0.5), wx = x - 0.5 - fx, wy = y - 0.5 - fy;
        double corner[4];
        memset(out, 0, 4 * sizeof *out);
        for (int i = 0; i < 4; i++) {
            double weight = (i & 1 ? wx : 1 - wx) * (i & 2 ? wy : 1 - wy);
            if (weight == 0)
                continue;
            texel(t, (long)fx + (i & 1), (long)fy + (i >> 1), corner);
            for (int c = 0; c < 4; c++)
                out[c] += weight * corner[c];
        }
    }
    for (int c = 0; c < 4; c++) {
        out[c] *= t->scale;
        if (t->invert)
            out[c] = out[c] < 1 ? 1 - out[c] : 0;
    }
}

/* rgb, and the number as out[3]. `uv` are the mesh's. Depth and cost are limited. */
static void evaluate(const struct pbrt_texture *t, const double uv[2], double out[4])
{
    double a[4], b[4], m[4], st[2];

    for (int i = 0; i < 2; i++)
        st[i] = t->mapping[i][0] * uv[0] + t->mapping[i][1] * uv[1] + t->mapping[i][2];
    switch (t->op) {
    case TEXTURE_CONSTANT:
        memcpy(out, t->value, sizeof t->value);
        out[3] = (out[0] + out[1] + out[2]) / 3;
        break;
    case TEXTURE_IMAGE:
        look_up_image(t, st[0], st[1], out);
        break;
    case TEXTURE_SCALE:
        evaluate(t->child[0], uv, a);
        evaluate(t->child[1], uv, b);
        for (int i = 0; i < 4; i++)
            out[i] = a[i] * b[i];
        break;
    case TEXTURE_MIX:
        evaluate(t->child[0], uv, a);
        evaluate(t->child[1], uv, b);
        evaluate(t->child[2], uv, m);
        for (int i = 0; i < 4; i++)
            out[i] = a[i] * (1 - m[3]) + b[i] * m[3];
        break;
    case TEXTURE_CHECKER:
        evaluate(t->child[fmod(floor(st[0]) + floor(st[1]), 2) != 0], uv, out);
        break;
    case TEXTURE_BILERP:
        for (int i = 0; i < 3; i++)
            out[i] = (1 - st[0]) * ((1 - st[1]) * t->corner[0][i] + st[1] * t->corner[1][i]) +
                     st[0] * ((1 - st[1]) * t->corner[2][i] + st[1] * t->corner[3][i]);
        out[3] = (out[0] + out[1] + out[2]) / 3;
        break;
    case TEXTURE_DIRECTION_MIX:
        evaluate(t->child[0], uv, out);
        break;
    }
    if (!t->is_color)
        out[0] = out[1] = out[2] = out[3];
}

/* ---- computing a picture ------------------------------------------------------------------ */

/* What the leaves below a texture have in common. */
struct domain {
    const struct pbrt_texture *first;   /* the leaf that gives the mapping */
    int same_mapping;
    int images, checkers, bilerps;
    int all_wrap, all_nearest;          /* of the images; -1: none, -2: different */
    uint32_t width, height;             /* the largest image */
};

static status collect(struct pbrt *p, const struct pbrt_texture *t, struct domain *d)
{
    for (int i = 0; i < 3; i++)
        if (t->child[i])
            TRY(collect(p, t->child[i], d));
    if (t->op != TEXTURE_IMAGE && t->op != TEXTURE_CHECKER && t->op != TEXTURE_BILERP)
        return STATUS_OK;
    if (!d->first)
        d->first = t;
    else if (memcmp(d->first->mapping, t->mapping, sizeof t->mapping) != 0)
        d->same_mapping = 0;
    d->checkers += t->op == TEXTURE_CHECKER;
    d->bilerps += t->op == TEXTURE_BILERP;
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
    double mapping[2][3];   /* mesh uv to (s, t) */
    enum scene_wrap wrap;
    int nearest;
};

static void plan_canvas(const struct domain *d, struct canvas *c)
{
    double scale[2] = {1, 1};

    *c = (struct canvas){.period = 1, .wrap = WRAP_REPEAT};
    c->mapping[0][0] = c->mapping[1][1] = 1;
    if (d->same_mapping && d->first) {
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
    } else if (d->bilerps) {
        c->width = c->height = d->checkers ? 256 : 64;
    } else if (d->same_mapping) {
        c->width = c->height = 2; /* a checkerboard is two by two fields */
        c->nearest = 1;
    } else {
        c->width = c->height = 1024;
        c->nearest = 1;
    }
    if (d->images && !d->checkers && d->same_mapping && d->all_wrap >= 0)
        c->wrap = (enum scene_wrap)d->all_wrap;
    if (!d->images && !d->checkers && d->bilerps)
        c->wrap = WRAP_CLAMP;
}

/* Where texel (x, y) lies in mesh uv: the inverse of what the slot does. 0: nowhere. */
static int canvas_uv(const struct canvas *c, uint32_t x, uint32_t y, double uv[2])
{
    double s = (x + 0.5) / c->width * c->period, t = (1 - (y + 0.5) / c->height) * c->period;

    if (c->mapping[0][0] == 0 || c->mapping[1][1] == 0)
        return 0;
    uv[0] = (s - c->mapping[0][2]) / c->mapping[0][0];
    uv[1] = (t - c->mapping[1][2]) / c->mapping[1][1];
    return 1;
}

static void slot_mapping(const double mapping[2][3], double period, int flip,
                         struct scene_texture_slot *slot)
{
    for (int i = 0; i < 3; i++) {
        slot->uv_transform[0][i] = (float)(mapping[0][i] / period);
        slot->uv_transform[1][i] = (float)((flip ? -1 : 1) * mapping[1][i] / period);
    }
    if (flip)
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
    known = ARENA_NEW(&p->arena, uint32_t);
    if (!known)
        return error_no_memory(p->err, "a texture");
    *known = *row;
    return pbrt_table_set(&p->texture_rows, &p->arena, key, sizeof key, known, p->err);
}

static status add_canvas(struct pbrt *p, const struct canvas *c, const struct image *pixels,
                         int as_exr, enum scene_encoding encoding, struct scene_texture_slot *slot)
{
    const int small = (size_t)c->width * c->height <= 4096;
    const struct exr_options options = {0};
    struct scene_texture texture = {.wrap_u = c->wrap,
                                    .wrap_v = c->wrap,
                                    .nearest = c->nearest,
                                    .encoding = encoding};
    struct buffer out = BUFFER_INIT;
    uint32_t row;
    status result = as_exr ? exr_encode(&out, pixels, &options, p->err)
                           : pbrt_png(pixels, small ? 16 : 8, &out, p->err);

    if (result != STATUS_OK) {
        buffer_release(&out);
        return result;
    }
    TRY(builder_add_image(p->b, "computed", out.data, out.size, &texture.image));
    TRY(texture_row(p, &texture, &row));
    slot->texture = (int32_t)row;
    slot_mapping(c->mapping, c->period, 1, slot);
    return STATUS_OK;
}

static status plan(struct pbrt *p, const struct pbrt_texture *a, const struct pbrt_texture *b,
                   struct canvas *c)
{
    struct domain d = {.same_mapping = 1, .all_wrap = -1, .all_nearest = -1};

    TRY(collect(p, a, &d));
    if (b)
        TRY(collect(p, b, &d));
    plan_canvas(&d, c);
    return STATUS_OK;
}

static status bake_color(struct pbrt *p, const struct pbrt_texture *color,
                         const struct pbrt_texture *alpha, float limit,
                         float factor[3], struct scene_texture_slot *slot)
{
    struct image pixels = {0};
    struct canvas c;
    double brightest = 0;
    int as_exr;
    status result;

    TRY(plan(p, color, alpha, &c));
    TRY(image_init(&pixels, c.width, c.height, alpha ? 4 : 3, p->err));
    for (size_t i = 0; i < (size_t)c.width * c.height; i++) {
        double uv[2], v[4] = {0}, a[4];
        float *to = pixels.pixels + i * pixels.channels;
        if (canvas_uv(&c, (uint32_t)(i % c.width), (uint32_t)(i / c.width), uv)) {
            evaluate(color, uv, v);
            if (alpha) {
                evaluate(alpha, uv, a);
                to[3] = (float)fmin(fmax(a[3], 0), 1);
            }
        }
        for (int k = 0; k < 3; k++) {
            to[k] = (float)fmin(fmax(v[k], 0), (double)limit);
            brightest = fmax(brightest, (double)to[k]);
        }
    }
    /* Light above 1 does not fit into a PNG, nor does it need alpha. */
    as_exr = brightest > 1;
    for (size_t i = 0; !as_exr && i < (size_t)c.width * c.height; i++)
        for (int k = 0; k < 3; k++) {
            float *to = pixels.pixels + i * pixels.channels + k;
            *to = srgb_encode(*to);
        }
    result = add_canvas(p, &c, &pixels, as_exr, as_exr ? ENCODING_BY_SLOT : ENCODING_SRGB, slot);
    image_release(&pixels);
    pbrt_images_trim(p);
    factor[0] = factor[1] = factor[2] = 1;
    return result;
}

/* ---- slots -------------------------------------------------------------------------------- */

static void no_slot(struct scene_texture_slot *slot)
{
    *slot = (struct scene_texture_slot){.texture = -1};
    slot->uv_transform[0][0] = slot->uv_transform[1][1] = 1;
}

/* A picture that can be shown as it is stored. */
static int is_plain(const struct pbrt_texture *t)
{
    return t->op == TEXTURE_IMAGE && !t->invert && t->is_color &&
           (t->image->is_float || t->gamma == 0 || t->gamma == 1);
}

static status plain_slot(struct pbrt *p, const struct pbrt_texture *t,
                         struct scene_texture_slot *slot)
{
    struct scene_texture texture = {.wrap_u = t->wrap, .wrap_v = t->wrap, .nearest = t->nearest};
    uint32_t row;

    texture.encoding = t->image->is_float ? ENCODING_BY_SLOT
                       : t->gamma == 1    ? ENCODING_LINEAR
                                          : ENCODING_SRGB;
    TRY(pbrt_image_row(p, t->image, &texture.image));
    TRY(texture_row(p, &texture, &row));
    slot->texture = (int32_t)row;
    slot_mapping(t->mapping, 1, 1, slot);
    return STATUS_OK;
}

status pbrt_color_slot(struct pbrt *p, const struct pbrt_texture *color,
                       const struct pbrt_texture *alpha, float limit, float factor[3],
                       struct scene_texture_slot *slot)
{
    const struct pbrt_texture *t = color;
    double f[3] = {1, 1, 1};
    int fits = 1;

    no_slot(slot);
    while (t->op == TEXTURE_SCALE && (is_constant(t->child[0]) || is_constant(t->child[1]))) {
        const int which = is_constant(t->child[0]) ? 0 : 1;
        for (int i = 0; i < 3; i++)
            f[i] *= t->child[which]->value[i];
        t = t->child[1 - which];
    }
    if (t->op == TEXTURE_IMAGE && !t->invert)
        for (int i = 0; i < 3; i++)
            f[i] *= t->scale;
    else if (is_constant(t))
        for (int i = 0; i < 3; i++)
            f[i] *= t->value[i];
    for (int i = 0; i < 3; i++) {
        fits = fits && f[i] >= 0 && f[i] <= (double)limit;
        factor[i] = (float)fmin(fmax(f[i], 0), (double)limit);
    }
    if (is_constant(t) && !alpha)
        return STATUS_OK;
    if (is_constant(t)) { /* the factor has the colour, the picture only alpha */
        float ignored[3];
        const struct pbrt_texture *white = pbrt_constant(p, 1, 1, 1);
        if (!white)
            return error_no_memory(p->err, "a texture");
        return bake_color(p, white, alpha, 1, ignored, slot);
    }
    if (is_plain(t) && fits && !alpha)
        return plain_slot(p, t, slot);
    return bake_color(p, color, alpha, limit, factor, slot);
}

status pbrt_scalar_slot(struct pbrt *p, const struct pbrt_texture *value, pbrt_change *change,
                        double parameter, float *factor, struct scene_texture_slot *slot)
{
    struct image pixels = {0};
    struct canvas c;
    status result;

    no_slot(slot);
    if (is_constant(value)) {
        *factor = (float)fmin(fmax(change(value->value[0], parameter), 0), 1);
        return STATUS_OK;
    }
    TRY(plan(p, value, NULL, &c));
    TRY(image_init(&pixels, c.width, c.height, 4, p->err));
    for (size_t i = 0; i < (size_t)c.width * c.height; i++) {
        double uv[2], v[4] = {0};
        if (canvas_uv(&c, (uint32_t)(i % c.width), (uint32_t)(i / c.width), uv))
            evaluate(value, uv, v);
        for (int k = 0; k < 4; k++)
            pixels.pixels[4 * i + (size_t)k] =
                (float)fmin(fmax(change(v[3], parameter), 0), 1);
    }
    result = add_canvas(p, &c, &pixels, 0, ENCODING_LINEAR, slot);
    image_release(&pixels);
    pbrt_images_trim(p);
    *factor = 1;
    return result;
}

status pbrt_image_slot(struct pbrt *p, struct pbrt_image *image, enum scene_encoding encoding,
                       enum scene_wrap wrap, int nearest, struct scene_texture_slot *slot)
{
    static const double identity[2][3] = {{1, 0, 0}, {0, 1, 0}};
    struct scene_texture texture = {
        .wrap_u = wrap, .wrap_v = wrap, .nearest = nearest, .encoding = encoding};
    uint32_t row;

    no_slot(slot);
    TRY(pbrt_image_row(p, image, &texture.image));
    TRY(texture_row(p, &texture, &row));
    slot->texture = (int32_t)row;
    slot_mapping(identity, 1, 1, slot);
    return STATUS_OK;
}
