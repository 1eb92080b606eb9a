/* The graphics state: the current matrices, the attributes, and the stack of both. */
#include <assert.h>
#include <math.h>
#include <string.h>

#include "client/import/pbrt/read/pbrt_directive.h"
#include "client/terminal/must.h"

static void ctm_apply(struct pbrt *p, const struct transform_d *t)
{
    for (unsigned i = 0; i < 2; i++)
        if (p->now.active >> i & 1)
            p->now.ctm.at[i] = transform_d_multiply(&p->now.ctm.at[i], t);
}

static void ctm_replace(struct pbrt *p, const struct transform_d *t)
{
    for (unsigned i = 0; i < 2; i++)
        if (p->now.active >> i & 1)
            p->now.ctm.at[i] = *t;
}

/* ---- the stack ---------------------------------------------------------------------------- */

status pbrt_push(struct pbrt *p, int kind, const struct pbrt_place *at)
{
    if (p->stack_count >= PBRT_STACK_MAX)
        return pbrt_fail(p, STATUS_ERR_LIMIT, at, "attributes are nested more than %d deep", PBRT_STACK_MAX);
    MUST_GROW(p->stack, p->stack_capacity, p->stack_count + 1);
    MUST_GROW(p->stack_kinds, p->kinds_capacity, p->stack_count + 1);
    p->stack[p->stack_count] = p->now;
    p->stack_kinds[p->stack_count++] = kind;
    if (kind != PBRT_STACK_TRANSFORM)
        p->now.renamed = p->renamed_count;
    return STATUS_OK;
}

status pbrt_pop(struct pbrt *p, int kind, const struct pbrt_place *at)
{
    static const char *const begins[] = {"AttributeBegin", "TransformBegin", "ObjectBegin",
                                         "Import"};
    const struct pbrt_state *top = p->stack_count ? &p->stack[p->stack_count - 1] : NULL;

    if (!top)
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "there is nothing to end here");
    if (p->stack_kinds[p->stack_count - 1] != kind)
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "%s must be ended first", begins[p->stack_kinds[p->stack_count - 1]]);
    if (kind == PBRT_STACK_TRANSFORM) {
        p->now.ctm = top->ctm;
        p->now.active = top->active;
    } else {
        if (kind != PBRT_STACK_IMPORT)
            pbrt_names_restore(p, p->now.renamed);
        p->now = *top;
    }
    p->stack_count--;
    return STATUS_OK;
}

/* ---- transforms ----------------------------------------------------------------------------- */

void pbrt_identity(struct pbrt *p)
{
    const struct transform_d identity = transform_d_identity();

    ctm_replace(p, &identity);
}

static status do_identity(struct pbrt *p, const struct pbrt_place *at UNUSED)
{
    pbrt_identity(p);
    return STATUS_OK;
}

static status do_translate(struct pbrt *p, const struct pbrt_place *at UNUSED)
{
    struct transform_d t = transform_d_identity();
    double n[3];

    TRY(pbrt_next_numbers(p, "Translate", n, 3));
    for (int i = 0; i < 3; i++)
        t.m[i][3] = n[i];
    ctm_apply(p, &t);
    return STATUS_OK;
}

static status do_scale(struct pbrt *p, const struct pbrt_place *at UNUSED)
{
    struct transform_d t = transform_d_identity();
    double n[3];

    TRY(pbrt_next_numbers(p, "Scale", n, 3));
    for (int i = 0; i < 3; i++)
        t.m[i][i] = n[i];
    ctm_apply(p, &t);
    return STATUS_OK;
}

static status do_rotate(struct pbrt *p, const struct pbrt_place *at)
{
    struct transform_d t;
    double n[4];

    TRY(pbrt_next_numbers(p, "Rotate", n, 4));
    if (!pbrt_rotation(n[0], n + 1, &t))
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "Rotate's axis has no direction");
    ctm_apply(p, &t);
    return STATUS_OK;
}

static status do_look_at(struct pbrt *p, const struct pbrt_place *at)
{
    struct transform_d t;
    double n[9];

    TRY(pbrt_next_numbers(p, "LookAt", n, 9));
    if (!pbrt_look_at(n, &t))
        return pbrt_fail(p, STATUS_ERR_INPUT, at,
                         "LookAt's direction or up vector has no length, or they are parallel");
    ctm_apply(p, &t);
    return STATUS_OK;
}

static status read_matrix(struct pbrt *p, const struct pbrt_place *at, struct transform_d *out)
{
    double n[16];

    TRY(pbrt_next_numbers(p, "Transform", n, 16));
    if (n[3] != 0 || n[7] != 0 || n[11] != 0 || !(fabs(n[15]) > 0))
        return pbrt_fail(p, STATUS_ERR_UNSUPPORTED, at,
                         "a matrix with a perspective part is not supported: its every fourth "
                         "number must be 0, the last 1");
    for (int i = 0; i < 15; i++)
        n[i] /= n[15];
    *out = transform_d_from_columns(n);
    return STATUS_OK;
}

static status do_transform(struct pbrt *p, const struct pbrt_place *at)
{
    struct transform_d t;

    TRY(read_matrix(p, at, &t));
    ctm_replace(p, &t);
    return STATUS_OK;
}

static status do_concat(struct pbrt *p, const struct pbrt_place *at)
{
    struct transform_d t;

    TRY(read_matrix(p, at, &t));
    ctm_apply(p, &t);
    return STATUS_OK;
}

void pbrt_keep_system(struct pbrt *p, const char *name, const struct pbrt_matrices *m)
{
    struct pbrt_matrices *copy = must(ARENA_NEW(&p->arena, struct pbrt_matrices));

    *copy = *m;
    pbrt_name_set(p, &p->systems, name, copy);
}

static status do_system(struct pbrt *p, const struct pbrt_place *at UNUSED)
{
    const char *name;

    TRY(pbrt_next_string(p, "CoordinateSystem", &name));
    pbrt_keep_system(p, name, &p->now.ctm);
    return STATUS_OK;
}

static status do_system_transform(struct pbrt *p, const struct pbrt_place *at)
{
    const struct pbrt_matrices *m;
    const char *name;

    TRY(pbrt_next_string(p, "CoordSysTransform", &name));
    m = pbrt_name_find(&p->systems, name);
    if (m)
        p->now.ctm = *m;
    else
        pbrt_warn(p, at, "coordinate system", "the coordinate system \"%.80s\" is not known", name);
    return STATUS_OK;
}

static status do_active(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_token t;

    TRY(pbrt_next(&p->reader, &t, p->err));
    if (t.kind == TOKEN_WORD && strcmp(t.text, "All") == 0)
        p->now.active = 3;
    else if (t.kind == TOKEN_WORD && strcmp(t.text, "StartTime") == 0)
        p->now.active = 1;
    else if (t.kind == TOKEN_WORD && strcmp(t.text, "EndTime") == 0)
        p->now.active = 2;
    else
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "ActiveTransform takes StartTime, EndTime or All");
    return STATUS_OK;
}

static status do_times(struct pbrt *p, const struct pbrt_place *at)
{
    double n[2];

    TRY(pbrt_next_numbers(p, "TransformTimes", n, 2));
    if (!(n[0] < n[1]) || fabs(n[0]) > 1e6 || fabs(n[1]) > 1e6)
        return pbrt_fail(p, STATUS_ERR_INPUT, at,
                         "TransformTimes takes a start and a later end, within a million seconds");
    p->time_start = n[0];
    p->time_end = n[1];
    return STATUS_OK;
}

/* ---- attributes ----------------------------------------------------------------------------- */

static status do_reverse(struct pbrt *p, const struct pbrt_place *at UNUSED)
{
    p->now.reversed = !p->now.reversed;
    return STATUS_OK;
}

static status do_attribute_begin(struct pbrt *p, const struct pbrt_place *at)
{
    return pbrt_push(p, PBRT_STACK_ATTRIBUTE, at);
}

static status do_attribute_end(struct pbrt *p, const struct pbrt_place *at)
{
    return pbrt_pop(p, PBRT_STACK_ATTRIBUTE, at);
}

static status do_transform_begin(struct pbrt *p, const struct pbrt_place *at)
{
    return pbrt_push(p, PBRT_STACK_TRANSFORM, at);
}

static status do_transform_end(struct pbrt *p, const struct pbrt_place *at)
{
    return pbrt_pop(p, PBRT_STACK_TRANSFORM, at);
}

/* Attribute "shape" "float radius" 2: defaults for later shapes. */
static status do_attribute(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_params **slot;
    const char *target;

    assert(p);
    TRY(pbrt_next_string(p, "Attribute", &target));
    slot = strcmp(target, "shape") == 0      ? &p->now.shape_defaults
           : strcmp(target, "light") == 0    ? &p->now.light_defaults
           : strcmp(target, "material") == 0 ? &p->now.material_defaults
           : strcmp(target, "medium") == 0   ? &p->now.medium_defaults
           : strcmp(target, "texture") == 0  ? &p->now.texture_defaults
                                             : NULL;
    if (!slot)
        return pbrt_fail(p, STATUS_ERR_INPUT, at,
                         "Attribute takes \"shape\", \"light\", \"material\", \"medium\" or "
                         "\"texture\"");
    TRY(pbrt_next_params(p, *slot));
    *slot = pbrt_params_copy(&p->params, &p->arena);
    MUST_GROW(p->attributes, p->attribute_capacity, p->attribute_count + 1);
    p->attributes[p->attribute_count++] = *slot;
    return STATUS_OK;
}

static status do_color_space(struct pbrt *p, const struct pbrt_place *at)
{
    const char *name;
    int space;

    TRY(pbrt_next_string(p, "ColorSpace", &name));
    space = pbrt_space_of(name);
    if (space < 0)
        return pbrt_fail(p, STATUS_ERR_INPUT, at,
                         "the colour space \"%.40s\" is unknown: known are srgb, dci-p3, "
                         "rec2020 and aces2065-1",
                         name);
    p->now.color_space = space;
    return STATUS_OK;
}

static status do_medium_interface(struct pbrt *p, const struct pbrt_place *at UNUSED)
{
    struct pbrt_token t;

    TRY(pbrt_next_string(p, "MediumInterface", &p->now.inside));
    p->now.outside = p->now.inside;
    TRY(pbrt_peek(&p->reader, &t, p->err));
    if (t.kind == TOKEN_STRING)
        TRY(pbrt_next_string(p, "MediumInterface", &p->now.outside));
    return STATUS_OK;
}

/* A directive may be the last word of an imported file and find its name in the file around it:
 * the import has ended then, so that each one that is under way lies deeper than those before. */
static status next_file_name(struct pbrt *p, const struct pbrt_place *at, const char **name)
{
    TRY(pbrt_next_string(p, "Include", name));
    return pbrt_end_imports(p, at, 0);
}

static status do_include(struct pbrt *p, const struct pbrt_place *at)
{
    const char *name;

    TRY(next_file_name(p, at, &name));
    return pbrt_include(&p->reader, name, at, p->err);
}

/* An imported file does not change the state of the importing one. */
static status do_import(struct pbrt *p, const struct pbrt_place *at)
{
    const char *name;

    TRY(next_file_name(p, at, &name));
    TRY(pbrt_push(p, PBRT_STACK_IMPORT, at));
    TRY(pbrt_include(&p->reader, name, at, p->err));
    assert(p->import_count < PBRT_INCLUDE_DEPTH_MAX);
    p->import_depth[p->import_count++] = p->reader.depth;
    return STATUS_OK;
}

status pbrt_end_imports(struct pbrt *p, const struct pbrt_place *at, int all)
{
    while (p->import_count && (all || p->reader.depth < p->import_depth[p->import_count - 1])) {
        p->import_count--;
        TRY(pbrt_pop(p, PBRT_STACK_IMPORT, at));
    }
    return STATUS_OK;
}

const struct pbrt_word pbrt_state_words[] = {
    {"Identity", do_identity},
    {"Translate", do_translate},
    {"Scale", do_scale},
    {"Rotate", do_rotate},
    {"LookAt", do_look_at},
    {"Transform", do_transform},
    {"ConcatTransform", do_concat},
    {"CoordinateSystem", do_system},
    {"CoordSysTransform", do_system_transform},
    {"ActiveTransform", do_active},
    {"TransformTimes", do_times},
    {"ReverseOrientation", do_reverse},
    {"AttributeBegin", do_attribute_begin},
    {"AttributeEnd", do_attribute_end},
    {"TransformBegin", do_transform_begin},
    {"TransformEnd", do_transform_end},
    {"Attribute", do_attribute},
    {"Include", do_include},
    {"Import", do_import},
    {"ColorSpace", do_color_space},
    {"MediumInterface", do_medium_interface},
    {NULL, NULL},
};
