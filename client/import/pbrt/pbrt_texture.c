/* Texture directives and parameters: each is a small expression. pbrt_texture_slot.c decides how it is used. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/terminal/must.h"
#include "client/import/pbrt/pbrt_texture_parts.h"

static struct pbrt_texture *texture_new(struct pbrt *p, enum pbrt_texture_op op)
{
    struct pbrt_texture *t = must(ARENA_NEW(&p->arena, struct pbrt_texture));

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

/* Constants are folded at once. */
static const struct pbrt_texture *fold(struct pbrt *p, struct pbrt_texture *t)
{
    const struct pbrt_texture *const *c = t->child;
    double v[3];

    if (t->op == TEXTURE_SCALE && pbrt_is_constant(c[0]) && pbrt_is_constant(c[1]))
        for (int i = 0; i < 3; i++)
            v[i] = c[0]->value[i] * c[1]->value[i];
    else if (t->op == TEXTURE_MIX && pbrt_is_constant(c[0]) && pbrt_is_constant(c[1]) && pbrt_is_constant(c[2]))
        for (int i = 0; i < 3; i++)
            v[i] = c[0]->value[i] * (1 - c[2]->value[i]) + c[1]->value[i] * c[2]->value[i];
    else
        return t;
    return pbrt_constant(p, v[0], v[1], v[2]);
}

const struct pbrt_texture *pbrt_product(struct pbrt *p, const struct pbrt_texture *a, const struct pbrt_texture *b)
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

const struct pbrt_texture *pbrt_mask(struct pbrt *p, const struct pbrt_texture *t)
{
    const double value = t->value[0] != 0;
    struct pbrt_texture *mask = pbrt_table_find(&p->masks, &t, sizeof t);

    if (pbrt_is_constant(t))
        return pbrt_constant(p, value, value, value);
    if (!mask) {
        mask = texture_new(p, TEXTURE_MASK);
        mask->is_color = 0;
        mask->child[0] = t;
        texture_weigh(mask);
        pbrt_table_set(&p->masks, &p->arena, &t, sizeof t, mask);
    }
    return mask;
}

static status find_texture(struct pbrt *p, const struct pbrt_param *param, int color, const struct pbrt_texture **out)
{
    const char *name = param->strings[0];
    const struct pbrt_texture *as_color = param->is_bound ? param->bound_color : pbrt_name_find(&p->color_textures, name);
    const struct pbrt_texture *as_float = param->is_bound ? param->bound_float : pbrt_name_find(&p->float_textures, name);

    *out = (color && as_color) || !as_float ? as_color : as_float;
    if (!*out)
        return pbrt_fail(p, STATUS_ERR_INPUT, &param->at, "the texture \"%.80s\" is not known: define it%s", name,
                         p->version3 ? " above" : "");
    return STATUS_OK;
}

void pbrt_textures_bind(const struct pbrt *p, struct pbrt_params *params)
{
    for (size_t i = 0; i < params->count; i++) {
        struct pbrt_param *param = &params->items[i];
        if (param->type != PBRT_TEXTURE)
            continue;
        param->is_bound = 1;
        param->bound_color = pbrt_name_find(&p->color_textures, param->strings[0]);
        param->bound_float = pbrt_name_find(&p->float_textures, param->strings[0]);
    }
}

status pbrt_float_texture(struct pbrt *p, struct pbrt_params *params, const char *name, const struct pbrt_texture **out)
{
    const struct pbrt_param *param = pbrt_param(params, name, PBRT_NUMBERS | PBRT_BIT(PBRT_TEXTURE));
    struct pbrt_texture *t;

    *out = NULL;
    if (!param)
        return STATUS_OK;
    if (param->type == PBRT_TEXTURE)
        return find_texture(p, param, 0, out);
    t = texture_new(p, TEXTURE_CONSTANT);
    t->is_color = 0;
    t->value[0] = t->value[1] = t->value[2] = param->numbers[0];
    *out = t;
    return STATUS_OK;
}

status pbrt_color_texture(struct pbrt *p, struct pbrt_params *params, const char *name, enum pbrt_use use,
                          const struct pbrt_texture **out)
{
    const struct pbrt_param *param = pbrt_param(params, name, PBRT_COLORS | PBRT_NUMBERS | PBRT_BIT(PBRT_TEXTURE));
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
    return STATUS_OK;
}

/* An optional child. */
static status child_or(struct pbrt *p, const struct pbrt_directive *d, const char *name, int color, double otherwise,
                       const struct pbrt_texture **out)
{
    if (color)
        TRY(pbrt_color_texture(p, d->params, name, USE_UNBOUNDED, out));
    else
        TRY(pbrt_float_texture(p, d->params, name, out));
    if (!*out)
        *out = pbrt_constant(p, otherwise, otherwise, otherwise);
    return STATUS_OK;
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
                  "the texture mapping \"%.40s\" is not supported: the surface's u and v are used", kind);
    }
    for (int i = 0; i < 2; i++)
        if (!(fabs(t->mapping[i][i]) < 1e5) || !(fabs(t->mapping[i][2]) < 1e5))
            return pbrt_fail(p, STATUS_ERR_INPUT, &d->at, "a texture's scale and delta must be below 100000");
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
    pbrt_warn(p, &d->at, "texture wrap", "the wrap mode \"%.40s\" is not supported: repeated", wrap);
    return WRAP_REPEAT;
}

static void read_encoding(struct pbrt *p, const struct pbrt_directive *d, struct pbrt_texture *t)
{
    const char *encoding = pbrt_string(d->params, "encoding", "sRGB");
    double power;

    if (!pbrt_bool(d->params, "gamma", 1)) /* pbrt-v3's: whether to decode 8 bits, numbers as well */
        t->gamma = 1;
    if (strcmp(encoding, "linear") == 0)
        t->gamma = 1;
    else if (strncmp(encoding, "gamma ", 6) == 0 && pbrt_number(encoding + 6, &power) && power > 0.1 && power < 10)
        t->gamma = power;
    else if (strcmp(encoding, "sRGB") != 0 && strcmp(encoding, "srgb") != 0)
        pbrt_warn(p, &d->at, "texture encoding", "the encoding \"%.40s\" is not known: taken as sRGB", encoding);
}

static status read_imagemap(struct pbrt *p, const struct pbrt_directive *d, int color, struct pbrt_texture **out)
{
    static const char *const unneeded[] = {"maxanisotropy", "trilinear", NULL};
    const char *name = pbrt_string(d->params, "filename", NULL);
    struct pbrt_texture *t = texture_new(p, TEXTURE_IMAGE);
    const char *filter;

    *out = t;
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
    t->by_luminance = p->version3;
    pbrt_ignore(d->params, unneeded);
    TRY(pbrt_image(p, name, &d->at, &t->image));
    if (!t->image) { /* warned about: mid grey */
        t->op = TEXTURE_CONSTANT;
        t->value[0] = t->value[1] = t->value[2] = 0.5;
    }
    return STATUS_OK;
}

static status read_checkerboard(struct pbrt *p, const struct pbrt_directive *d, int color, struct pbrt_texture **out)
{
    struct pbrt_texture *t = texture_new(p, TEXTURE_CHECKER);

    *out = t;
    TRY(read_mapping(p, d, t));
    if (pbrt_integer(d->params, "dimension", 2) != 2)
        pbrt_warn(p, &d->at, "checkerboard", "a checkerboard of three dimensions is not supported: one of two is used");
    (void)pbrt_string(d->params, "aamode", NULL);
    TRY(child_or(p, d, "tex1", color, 1, &t->child[0]));
    return child_or(p, d, "tex2", color, 0, &t->child[1]);
}

static status read_uv(struct pbrt *p, const struct pbrt_directive *d, struct pbrt_texture **out)
{
    *out = texture_new(p, TEXTURE_UV);
    return read_mapping(p, d, *out);
}

static status read_dots(struct pbrt *p, const struct pbrt_directive *d, int color, struct pbrt_texture **out)
{
    struct pbrt_texture *t = texture_new(p, TEXTURE_DOTS);

    *out = t;
    t->cost = 3 * 8; /* the noise at three places is of eight corners each */
    TRY(read_mapping(p, d, t));
    TRY(child_or(p, d, "inside", color, 1, &t->child[0]));
    return child_or(p, d, "outside", color, 0, &t->child[1]);
}

static status read_bilerp(struct pbrt *p, const struct pbrt_directive *d, int color, struct pbrt_texture **out)
{
    static const char *const names[4] = {"v00", "v01", "v10", "v11"};
    struct pbrt_texture *t = texture_new(p, TEXTURE_BILERP);

    *out = t;
    TRY(read_mapping(p, d, t));
    for (int i = 0; i < 4; i++) {
        const struct pbrt_texture *value;
        TRY(child_or(p, d, names[i], color, i & 1, &value));
        if (!pbrt_is_constant(value))
            return pbrt_fail(p, STATUS_ERR_INPUT, &d->at, "\"%s\" of a bilerp texture must be constant", names[i]);
        memcpy(t->corner[i], value->value, sizeof t->corner[i]);
    }
    return STATUS_OK;
}

static status read_combination(struct pbrt *p, const struct pbrt_directive *d, int color, struct pbrt_texture **out)
{
    struct pbrt_texture *t;

    if (strcmp(d->kind, "constant") == 0) {
        const struct pbrt_texture *value;
        TRY(child_or(p, d, "value", color, 1, &value));
        *out = texture_new(p, TEXTURE_CONSTANT);
        memcpy((*out)->value, value->value, sizeof value->value);
        return STATUS_OK;
    }
    t = texture_new(p, strcmp(d->kind, "scale") == 0          ? TEXTURE_SCALE
                       : strcmp(d->kind, "directionmix") == 0 ? TEXTURE_DIRECTION_MIX
                                                              : TEXTURE_MIX);
    *out = t;
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
        pbrt_warn(p, &d->at, "directionmix", "a texture \"directionmix\" is not supported: its \"tex1\" is used");
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

status pbrt_texture(struct pbrt *p, const char *name, const char *type, const struct pbrt_directive *d)
{
    static const char *const combinations[] = {"constant", "scale", "mix", "directionmix", NULL};
    int color = strcmp(type, "spectrum") == 0 || strcmp(type, "color") == 0;
    const struct pbrt_texture *made;
    struct pbrt_texture *t = NULL;
    char what[128];

    if (!color && strcmp(type, "float") != 0)
        return pbrt_fail(p, STATUS_ERR_INPUT, &d->at, "a texture is of type \"float\" or \"spectrum\", not \"%.40s\"",
                         type);
    if (strcmp(d->kind, "imagemap") == 0)
        TRY(read_imagemap(p, d, color, &t));
    else if (strcmp(d->kind, "checkerboard") == 0)
        TRY(read_checkerboard(p, d, color, &t));
    else if (strcmp(d->kind, "dots") == 0)
        TRY(read_dots(p, d, color, &t));
    else if (strcmp(d->kind, "uv") == 0 && color) /* pbrt-v3's; there is none of numbers */
        TRY(read_uv(p, d, &t));
    else if (strcmp(d->kind, "bilerp") == 0)
        TRY(read_bilerp(p, d, color, &t));
    else if (is_one_of(d->kind, combinations))
        TRY(read_combination(p, d, color, &t));
    else {
        char kind[128];
        snprintf(kind, sizeof kind, "texture %.60s", d->kind);
        pbrt_warn(p, &d->at, kind, "the texture kind \"%.60s\" is not supported: mid grey instead", d->kind);
        t = texture_new(p, TEXTURE_CONSTANT);
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
    snprintf(what, sizeof what, "texture \"%.60s\"", d->kind);
    pbrt_params_report(d->params, p->b, what);
    pbrt_name_set_here(p, color ? &p->color_textures : &p->float_textures, name, made);
    return STATUS_OK;
}
