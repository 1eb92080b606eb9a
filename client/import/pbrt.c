#include "client/import/pbrt.h"

#include <assert.h>
#include <math.h>
#include <string.h>
#include <strings.h>

#include "common/base/file.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"

/* What is on the stack of states, and so what may take it off. */
enum { STACK_ATTRIBUTE, STACK_TRANSFORM, STACK_OBJECT, STACK_IMPORT };

/* ---- tables ------------------------------------------------------------------------------- */

static uint64_t hash_bytes(const void *data, size_t size)
{
    const uint8_t *bytes = data;
    uint64_t hash = 0xcbf29ce484222325u; /* FNV-1a */

    for (size_t i = 0; i < size; i++)
        hash = (hash ^ bytes[i]) * 0x100000001b3u;
    return hash ^ hash >> 29;
}

static struct pbrt_entry *table_slot(const struct pbrt_table *t, const void *key, size_t key_bytes)
{
    size_t at = (size_t)hash_bytes(key, key_bytes) & (t->size - 1);

    while (t->entries[at].key && (t->entries[at].key_bytes != key_bytes ||
                                  memcmp(t->entries[at].key, key, key_bytes) != 0))
        at = (at + 1) & (t->size - 1);
    return &t->entries[at];
}

void *pbrt_table_find(const struct pbrt_table *t, const void *key, size_t key_bytes)
{
    return t->size ? table_slot(t, key, key_bytes)->value : NULL;
}

status pbrt_table_set(struct pbrt_table *t, struct arena *arena, const void *key, size_t key_bytes,
                      void *value, struct error *err)
{
    struct pbrt_entry *slot;

    if ((t->count + 1) * 2 > t->size) {
        struct pbrt_table grown = {.size = t->size ? t->size * 2 : 32, .count = t->count};
        grown.entries = mem_calloc(grown.size, sizeof *grown.entries);
        if (!grown.entries)
            return error_no_memory(err, "a table of names");
        for (size_t i = 0; i < t->size; i++)
            if (t->entries[i].key)
                *table_slot(&grown, t->entries[i].key, t->entries[i].key_bytes) = t->entries[i];
        mem_free(t->entries);
        *t = grown;
    }
    slot = table_slot(t, key, key_bytes);
    if (!slot->key) {
        slot->key = arena_alloc(arena, key_bytes + 1, 1);
        if (!slot->key)
            return error_no_memory(err, "a name");
        memcpy(slot->key, key, key_bytes);
        slot->key_bytes = key_bytes;
        t->count++;
    }
    slot->value = value;
    return STATUS_OK;
}

static status table_set_name(struct pbrt *p, struct pbrt_table *t, const char *name, void *value)
{
    return pbrt_table_set(t, &p->arena, name, strlen(name), value, p->err);
}

static void *table_name(const struct pbrt_table *t, const char *name)
{
    return pbrt_table_find(t, name, strlen(name));
}

char *pbrt_keep(struct pbrt *p, const char *text)
{
    return arena_strdup(&p->arena, text);
}

/* ---- matrices ----------------------------------------------------------------------------- */

struct transform_d pbrt_to_world(const struct pbrt *p, const struct transform_d *ctm)
{
    struct transform_d out = *ctm;

    for (int c = 0; c < 4 && p->mirrored; c++)
        out.m[2][c] = -out.m[2][c];
    return out;
}

int pbrt_is_moving(const struct pbrt_matrices *m)
{
    return memcmp(&m->at[0], &m->at[1], sizeof m->at[0]) != 0;
}

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

/* Whole quarter turns come out exact. */
static void sincos_degrees(double angle, double *sine, double *cosine)
{
    static const double quarter[4] = {0, 1, 0, -1};
    double length;
    float s, c;

    angle = fmod(angle, 360);
    if (angle < 0)
        angle += 360;
    if (fmod(angle, 90) == 0) {
        int q = (int)(angle / 90) & 3;
        *sine = quarter[q];
        *cosine = quarter[(q + 1) & 3];
        return;
    }
    det_sincos((float)(angle * PI_D / 180), &s, &c);
    length = sqrt((double)s * (double)s + (double)c * (double)c);
    *sine = (double)s / length; /* exactly a rotation, if not quite the angle */
    *cosine = (double)c / length;
}

int pbrt_unit(double v[3])
{
    double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);

    if (!(length > 1e-150) || !isfinite(length))
        return 0;
    for (int i = 0; i < 3; i++)
        v[i] /= length;
    return 1;
}

/* Rodrigues' formula. */
static int rotation(double angle, const double given[3], struct transform_d *out)
{
    double a[3] = {given[0], given[1], given[2]}, s, c;

    *out = transform_d_identity();
    if (!pbrt_unit(a))
        return 0;
    sincos_degrees(angle, &s, &c);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int k = 3 - i - j;
            out->m[i][j] = a[i] * a[j] * (1 - c) + (i == j ? c : 0);
            if (i != j)
                out->m[i][j] += ((j - i + 3) % 3 == 1 ? -1 : 1) * a[k] * s;
        }
    return 1;
}

static void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* From the world to a camera that stands at n[0..2], looks at n[3..5] with n[6..8] upwards:
 * x to the right of that in a left-handed world. */
static int look_at(const double n[9], struct transform_d *out)
{
    struct transform_d back = transform_d_identity();
    double forward[3], right[3], up[3] = {n[6], n[7], n[8]}, top[3];

    for (int i = 0; i < 3; i++)
        forward[i] = n[3 + i] - n[i];
    if (!pbrt_unit(forward) || !pbrt_unit(up))
        return 0;
    cross(up, forward, right);
    if (!pbrt_unit(right))
        return 0;
    cross(forward, right, top);
    for (int i = 0; i < 3; i++) {
        back.m[i][0] = right[i];
        back.m[i][1] = top[i];
        back.m[i][2] = forward[i];
        back.m[i][3] = n[i];
    }
    return transform_d_invert(&back, out);
}

/* ---- arguments of directives -------------------------------------------------------------- */

static status next_string(struct pbrt *p, const char *directive, const char **out)
{
    struct pbrt_token t;

    TRY(pbrt_next(&p->reader, &t, p->err));
    if (t.kind == TOKEN_OPEN) { /* ["name"] is tolerated, as pbrt does for values */
        TRY(next_string(p, directive, out));
        TRY(pbrt_next(&p->reader, &t, p->err));
        if (t.kind != TOKEN_CLOSE)
            return pbrt_fail(p, STATUS_ERR_INPUT, &t.at, "a closing bracket is missing");
        return STATUS_OK;
    }
    if (t.kind != TOKEN_STRING)
        return pbrt_fail(p, STATUS_ERR_INPUT, &t.at, "%s takes a name in quotes here", directive);
    *out = pbrt_keep(p, t.text);
    return *out ? STATUS_OK : error_no_memory(p->err, "a name");
}

static status next_numbers(struct pbrt *p, const char *directive, double *out, size_t count)
{
    struct pbrt_token t;
    int bracket;

    TRY(pbrt_peek(&p->reader, &t, p->err));
    bracket = t.kind == TOKEN_OPEN;
    if (bracket)
        TRY(pbrt_next(&p->reader, &t, p->err));
    for (size_t i = 0; i < count; i++) {
        TRY(pbrt_next(&p->reader, &t, p->err));
        if (t.kind != TOKEN_WORD || !pbrt_number(t.text, &out[i]))
            return pbrt_fail(p, STATUS_ERR_INPUT, &t.at, "%s takes %zu numbers", directive, count);
    }
    if (bracket) {
        TRY(pbrt_next(&p->reader, &t, p->err));
        if (t.kind != TOKEN_CLOSE)
            return pbrt_fail(p, STATUS_ERR_INPUT, &t.at, "%s takes %zu numbers", directive, count);
    }
    return STATUS_OK;
}

static status next_params(struct pbrt *p, struct pbrt_params *defaults)
{
    TRY(pbrt_params_read(&p->params, &p->reader, p->b));
    p->params.defaults = defaults;
    p->params.color_space = p->now.color_space;
    return STATUS_OK;
}

/* ---- the stack ---------------------------------------------------------------------------- */

static status push(struct pbrt *p, int kind, const struct pbrt_place *at)
{
    if (p->stack_count >= PBRT_STACK_MAX)
        return pbrt_fail(p, STATUS_ERR_LIMIT, at, "attributes are nested more than %d deep",
                         PBRT_STACK_MAX);
    if (!MEM_GROW(p->stack, p->stack_capacity, p->stack_count + 1) ||
        !MEM_GROW(p->stack_kinds, p->kinds_capacity, p->stack_count + 1))
        return error_no_memory(p->err, "the stack of attributes");
    p->stack[p->stack_count] = p->now;
    p->stack_kinds[p->stack_count++] = kind;
    return STATUS_OK;
}

static status pop(struct pbrt *p, int kind, const struct pbrt_place *at)
{
    static const char *const begins[] = {"AttributeBegin", "TransformBegin", "ObjectBegin",
                                         "Import"};
    const struct pbrt_state *top = p->stack_count ? &p->stack[p->stack_count - 1] : NULL;

    if (!top)
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "nothing was begun that could end here");
    if (p->stack_kinds[p->stack_count - 1] != kind)
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "%s must be ended first",
                         begins[p->stack_kinds[p->stack_count - 1]]);
    if (kind == STACK_TRANSFORM) {
        p->now.ctm = top->ctm;
        p->now.active = top->active;
    } else {
        p->now = *top;
    }
    p->stack_count--;
    return STATUS_OK;
}

/* ---- directives --------------------------------------------------------------------------- */

typedef status directive_function(struct pbrt *p, const struct pbrt_place *at);

static status do_identity(struct pbrt *p, const struct pbrt_place *at)
{
    const struct transform_d identity = transform_d_identity();

    (void)at;
    ctm_replace(p, &identity);
    return STATUS_OK;
}

static status do_translate(struct pbrt *p, const struct pbrt_place *at)
{
    struct transform_d t = transform_d_identity();
    double n[3];

    (void)at;
    TRY(next_numbers(p, "Translate", n, 3));
    for (int i = 0; i < 3; i++)
        t.m[i][3] = n[i];
    ctm_apply(p, &t);
    return STATUS_OK;
}

static status do_scale(struct pbrt *p, const struct pbrt_place *at)
{
    struct transform_d t = transform_d_identity();
    double n[3];

    (void)at;
    TRY(next_numbers(p, "Scale", n, 3));
    for (int i = 0; i < 3; i++)
        t.m[i][i] = n[i];
    ctm_apply(p, &t);
    return STATUS_OK;
}

static status do_rotate(struct pbrt *p, const struct pbrt_place *at)
{
    struct transform_d t;
    double n[4];

    TRY(next_numbers(p, "Rotate", n, 4));
    if (!rotation(n[0], n + 1, &t))
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "Rotate's axis has no direction");
    ctm_apply(p, &t);
    return STATUS_OK;
}

static status do_look_at(struct pbrt *p, const struct pbrt_place *at)
{
    struct transform_d t;
    double n[9];

    TRY(next_numbers(p, "LookAt", n, 9));
    if (!look_at(n, &t))
        return pbrt_fail(p, STATUS_ERR_INPUT, at,
                         "LookAt's direction or up vector has no length, or they are parallel");
    ctm_apply(p, &t);
    return STATUS_OK;
}

static status read_matrix(struct pbrt *p, const struct pbrt_place *at, struct transform_d *out)
{
    double n[16];

    TRY(next_numbers(p, "Transform", n, 16));
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

static status keep_system(struct pbrt *p, const char *name, const struct pbrt_matrices *m)
{
    struct pbrt_matrices *copy = ARENA_NEW(&p->arena, struct pbrt_matrices);

    if (!copy)
        return error_no_memory(p->err, "a coordinate system");
    *copy = *m;
    return table_set_name(p, &p->systems, name, copy);
}

static status do_system(struct pbrt *p, const struct pbrt_place *at)
{
    const char *name;

    (void)at;
    TRY(next_string(p, "CoordinateSystem", &name));
    return keep_system(p, name, &p->now.ctm);
}

static status do_system_transform(struct pbrt *p, const struct pbrt_place *at)
{
    const struct pbrt_matrices *m;
    const char *name;

    TRY(next_string(p, "CoordSysTransform", &name));
    m = table_name(&p->systems, name);
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
        return pbrt_fail(p, STATUS_ERR_INPUT, at,
                         "ActiveTransform takes StartTime, EndTime or All");
    return STATUS_OK;
}

static status do_times(struct pbrt *p, const struct pbrt_place *at)
{
    double n[2];

    TRY(next_numbers(p, "TransformTimes", n, 2));
    if (!(n[0] < n[1]) || fabs(n[0]) > 1e6 || fabs(n[1]) > 1e6)
        return pbrt_fail(p, STATUS_ERR_INPUT, at,
                         "TransformTimes takes a start and a later end, within a million seconds");
    p->time_start = n[0];
    p->time_end = n[1];
    return STATUS_OK;
}

static status do_reverse(struct pbrt *p, const struct pbrt_place *at)
{
    (void)at;
    p->now.reversed = !p->now.reversed;
    return STATUS_OK;
}

static status do_attribute_begin(struct pbrt *p, const struct pbrt_place *at)
{
    return push(p, STACK_ATTRIBUTE, at);
}

static status do_attribute_end(struct pbrt *p, const struct pbrt_place *at)
{
    return pop(p, STACK_ATTRIBUTE, at);
}

static status do_transform_begin(struct pbrt *p, const struct pbrt_place *at)
{
    return push(p, STACK_TRANSFORM, at);
}

static status do_transform_end(struct pbrt *p, const struct pbrt_place *at)
{
    return pop(p, STACK_TRANSFORM, at);
}

/* Attribute "shape" "float radius" 2: what later shapes have where they say nothing. */
static status do_attribute(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_params **slot;
    const char *target;

    assert(p);
    TRY(next_string(p, "Attribute", &target));
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
    TRY(next_params(p, *slot));
    *slot = pbrt_params_copy(&p->params, &p->arena);
    return *slot ? STATUS_OK : error_no_memory(p->err, "attributes");
}

static status do_include(struct pbrt *p, const struct pbrt_place *at)
{
    const char *name;

    TRY(next_string(p, "Include", &name));
    return pbrt_include(&p->reader, name, at, p->err);
}

/* What an imported file does to the state stays in it. */
static status do_import(struct pbrt *p, const struct pbrt_place *at)
{
    TRY(push(p, STACK_IMPORT, at));
    TRY(do_include(p, at));
    p->import_depth[p->import_count++] = p->reader.depth;
    return STATUS_OK;
}

/* Imports whose file has come to its end. */
static status end_imports(struct pbrt *p, const struct pbrt_place *at, int all)
{
    while (p->import_count &&
           (all || p->reader.depth < p->import_depth[p->import_count - 1])) {
        p->import_count--;
        TRY(pop(p, STACK_IMPORT, at));
    }
    return STATUS_OK;
}

/* ---- directives with a kind and parameters ------------------------------------------------ */

static status read_directive(struct pbrt *p, const char *word, struct pbrt_params *defaults,
                             const struct pbrt_place *at, struct pbrt_directive *out)
{
    *out = (struct pbrt_directive){.at = *at, .ctm = p->now.ctm, .params = &p->params};
    TRY(next_string(p, word, &out->kind));
    return next_params(p, defaults);
}

/* Camera and film wait for one another until the world begins. */
static status keep_directive(struct pbrt *p, const char *word, const struct pbrt_place *at,
                             struct pbrt_directive *out)
{
    if (p->in_world)
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "%s must stand before WorldBegin", word);
    TRY(read_directive(p, word, NULL, at, out));
    out->params = pbrt_params_copy(&p->params, &p->arena);
    return out->params ? STATUS_OK : error_no_memory(p->err, "parameters");
}

static status do_camera(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_matrices world_from_camera;

    TRY(keep_directive(p, "Camera", at, &p->camera));
    for (int i = 0; i < 2; i++)
        if (!transform_d_invert(&p->camera.ctm.at[i], &world_from_camera.at[i]))
            return pbrt_fail(p, STATUS_ERR_INPUT, at, "the camera's matrix cannot be inverted");
    p->camera_medium = p->now.outside;
    return keep_system(p, "camera", &world_from_camera);
}

static status do_film(struct pbrt *p, const struct pbrt_place *at)
{
    TRY(keep_directive(p, "Film", at, &p->film));
    if (strcmp(p->film.kind, "image") == 0)
        p->version3 = 1; /* pbrt-v4 has no such film */
    return STATUS_OK;
}

static status do_sampler(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_directive d;

    TRY(read_directive(p, "Sampler", NULL, at, &d));
    return pbrt_sampler(p, &d);
}

static status do_integrator(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_directive d;

    TRY(read_directive(p, "Integrator", NULL, at, &d));
    return pbrt_integrator(p, &d);
}

static status do_filter(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_directive d;

    TRY(read_directive(p, "PixelFilter", NULL, at, &d));
    pbrt_warn(p, at, "PixelFilter", "the pixel filter \"%.40s\" is not taken over: pictures are "
              "made with one filter here", d.kind);
    return STATUS_OK;
}

/* How rays are found does not change the picture. */
static status do_accelerator(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_directive d;

    return read_directive(p, "Accelerator", NULL, at, &d);
}

static status do_option(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_directive d = {.kind = "", .at = *at, .params = &p->params};

    TRY(next_params(p, NULL));
    return pbrt_option(p, &d);
}

static status do_color_space(struct pbrt *p, const struct pbrt_place *at)
{
    const char *name;
    int space;

    TRY(next_string(p, "ColorSpace", &name));
    space = pbrt_space_of(name);
    if (space < 0)
        return pbrt_fail(p, STATUS_ERR_INPUT, at,
                         "the colour space \"%.40s\" is not known: there are srgb, dci-p3, "
                         "rec2020 and aces2065-1",
                         name);
    p->now.color_space = space;
    return STATUS_OK;
}

static status do_world(struct pbrt *p, const struct pbrt_place *at)
{
    if (p->in_world)
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "WorldBegin stands twice");
    TRY(pbrt_camera(p));
    p->in_world = 1;
    p->now.active = 3;
    TRY(do_identity(p, at));
    return keep_system(p, "world", &p->now.ctm);
}

static status do_world_end(struct pbrt *p, const struct pbrt_place *at)
{
    (void)p;
    (void)at;
    return STATUS_OK;
}

static status need_world(struct pbrt *p, const char *word, const struct pbrt_place *at)
{
    if (p->in_world)
        return STATUS_OK;
    return pbrt_fail(p, STATUS_ERR_INPUT, at, "%s must stand after WorldBegin", word);
}

static status do_texture(struct pbrt *p, const struct pbrt_place *at)
{
    const char *name, *type;
    struct pbrt_directive d;

    TRY(need_world(p, "Texture", at));
    TRY(next_string(p, "Texture", &name));
    TRY(next_string(p, "Texture", &type));
    TRY(read_directive(p, "Texture", p->now.texture_defaults, at, &d));
    return pbrt_texture(p, name, type, &d);
}

static status add_material(struct pbrt *p, const char *kind, const char *name,
                           const struct pbrt_place *at, struct pbrt_material **out)
{
    struct pbrt_material *m = ARENA_NEW(&p->arena, struct pbrt_material);

    *out = m;
    if (!m)
        return error_no_memory(p->err, "a material");
    m->kind = kind;
    m->name = name;
    m->at = *at;
    m->params = pbrt_params_copy(&p->params, &p->arena);
    return m->params ? STATUS_OK : error_no_memory(p->err, "a material");
}

static status do_material(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_directive d;

    TRY(need_world(p, "Material", at));
    TRY(read_directive(p, "Material", p->now.material_defaults, at, &d));
    return add_material(p, d.kind, d.kind, at, &p->now.material);
}

static status do_make_material(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_material *m;
    const char *name, *kind;

    TRY(need_world(p, "MakeNamedMaterial", at));
    TRY(next_string(p, "MakeNamedMaterial", &name));
    TRY(next_params(p, p->now.material_defaults));
    kind = pbrt_string(&p->params, "type", NULL);
    if (!kind)
        return pbrt_fail(p, STATUS_ERR_INPUT, at,
                         "the material \"%.80s\" has no \"string type\"", name);
    kind = pbrt_keep(p, kind);
    if (!kind)
        return error_no_memory(p->err, "a material");
    TRY(add_material(p, kind, name, at, &m));
    return table_set_name(p, &p->materials, name, m);
}

static status do_named_material(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_material *m;
    const char *name;

    TRY(need_world(p, "NamedMaterial", at));
    TRY(next_string(p, "NamedMaterial", &name));
    m = table_name(&p->materials, name);
    if (!m)
        return pbrt_fail(p, STATUS_ERR_INPUT, at,
                         "the material \"%.80s\" is not known: define it above with "
                         "MakeNamedMaterial",
                         name);
    p->now.material = m;
    return STATUS_OK;
}

static status do_make_medium(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_directive d = {.at = *at, .ctm = p->now.ctm, .params = &p->params};
    const char *name;

    TRY(next_string(p, "MakeNamedMedium", &name));
    TRY(next_params(p, p->now.medium_defaults));
    d.kind = pbrt_string(&p->params, "type", "");
    return pbrt_medium(p, name, &d);
}

static status do_medium_interface(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_token t;

    (void)at;
    TRY(next_string(p, "MediumInterface", &p->now.inside));
    p->now.outside = p->now.inside;
    TRY(pbrt_peek(&p->reader, &t, p->err));
    if (t.kind == TOKEN_STRING)
        TRY(next_string(p, "MediumInterface", &p->now.outside));
    return STATUS_OK;
}

static status do_light(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_directive d;

    TRY(need_world(p, "LightSource", at));
    TRY(read_directive(p, "LightSource", p->now.light_defaults, at, &d));
    if (p->object)
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "a light cannot stand in an object definition");
    return pbrt_light(p, &d);
}

static status do_area_light(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_area_light *light;
    struct pbrt_directive d;

    TRY(need_world(p, "AreaLightSource", at));
    TRY(read_directive(p, "AreaLightSource", p->now.light_defaults, at, &d));
    if (strcmp(d.kind, "diffuse") != 0 && strcmp(d.kind, "area") != 0) {
        pbrt_warn(p, at, "area light kind", "the area light \"%.60s\" is not known: left out",
                  d.kind);
        p->now.area_light = NULL;
        return STATUS_OK;
    }
    light = ARENA_NEW(&p->arena, struct pbrt_area_light);
    if (!light)
        return error_no_memory(p->err, "a light");
    light->at = *at;
    light->params = pbrt_params_copy(&p->params, &p->arena);
    p->now.area_light = light;
    return light->params ? STATUS_OK : error_no_memory(p->err, "a light");
}

static status do_shape(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_directive d;

    TRY(need_world(p, "Shape", at));
    TRY(read_directive(p, "Shape", p->now.shape_defaults, at, &d));
    return pbrt_shape(p, &d);
}

static status do_object_begin(struct pbrt *p, const struct pbrt_place *at)
{
    const char *name;

    TRY(need_world(p, "ObjectBegin", at));
    TRY(next_string(p, "ObjectBegin", &name));
    if (p->object)
        return pbrt_fail(p, STATUS_ERR_INPUT, at,
                         "an object cannot be defined inside of another one");
    TRY(push(p, STACK_OBJECT, at));
    p->object = ARENA_NEW(&p->arena, struct pbrt_object);
    if (!p->object)
        return error_no_memory(p->err, "an object");
    if (table_name(&p->objects, name)) /* its parts stay with the arena's owner until the end */
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "the object \"%.80s\" is defined twice", name);
    return table_set_name(p, &p->objects, name, p->object);
}

static status do_object_end(struct pbrt *p, const struct pbrt_place *at)
{
    TRY(pop(p, STACK_OBJECT, at));
    p->object = NULL;
    return STATUS_OK;
}

static status do_object_instance(struct pbrt *p, const struct pbrt_place *at)
{
    const struct pbrt_object *object;
    const char *name;

    TRY(need_world(p, "ObjectInstance", at));
    TRY(next_string(p, "ObjectInstance", &name));
    object = table_name(&p->objects, name);
    if (!object)
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "the object \"%.80s\" is not known", name);
    if (p->object)
        return pbrt_fail(p, STATUS_ERR_INPUT, at,
                         "an object cannot be placed in an object definition");
    return pbrt_object_place(p, object, at);
}

static const struct {
    const char *word;
    directive_function *run;
} directives[] = {
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
    {"Camera", do_camera},
    {"Film", do_film},
    {"Sampler", do_sampler},
    {"Integrator", do_integrator},
    {"SurfaceIntegrator", do_integrator},
    {"PixelFilter", do_filter},
    {"Accelerator", do_accelerator},
    {"Option", do_option},
    {"ColorSpace", do_color_space},
    {"WorldBegin", do_world},
    {"WorldEnd", do_world_end},
    {"Texture", do_texture},
    {"Material", do_material},
    {"MakeNamedMaterial", do_make_material},
    {"NamedMaterial", do_named_material},
    {"MakeNamedMedium", do_make_medium},
    {"MediumInterface", do_medium_interface},
    {"LightSource", do_light},
    {"AreaLightSource", do_area_light},
    {"Shape", do_shape},
    {"ObjectBegin", do_object_begin},
    {"ObjectEnd", do_object_end},
    {"ObjectInstance", do_object_instance},
};
enum { DIRECTIVE_COUNT = sizeof directives / sizeof *directives };

static int directive_find(const char *word)
{
    for (int i = 0; i < DIRECTIVE_COUNT; i++)
        if (strcmp(directives[i].word, word) == 0)
            return i;
    return -1;
}

/* ---- the frame ---------------------------------------------------------------------------- */

static status begin(struct pbrt *p, const void *data, size_t size_bytes, const char *name,
                    const char *folder)
{
    static const struct pbrt_place nowhere = {"", 0};

    arena_init(&p->arena);
    p->time_end = 1;
    p->max_depth = p->samples = -1;
    p->last_node = BUILDER_NO_ROW;
    p->now.active = 3;
    p->now.ctm.at[0] = p->now.ctm.at[1] = transform_d_identity();
    p->now.inside = p->now.outside = p->camera_medium = "";
    TRY(pbrt_reader_init(&p->reader, &p->arena, data, size_bytes, name, folder, p->err));
    TRY(add_material(p, "diffuse", "default", &nowhere, &p->default_material));
    p->now.material = p->default_material;
    return STATUS_OK;
}

static void finish(struct pbrt *p)
{
    struct pbrt_table *const tables[] = {&p->float_textures, &p->color_textures, &p->materials,
                                         &p->media,          &p->objects,        &p->systems,
                                         &p->images,         &p->texture_rows,   &p->spectra};

    for (size_t i = 0; i < p->images.size; i++)
        if (p->images.entries[i].value)
            pbrt_image_forget(p->images.entries[i].value);
    for (size_t i = 0; i < p->objects.size; i++)
        if (p->objects.entries[i].value)
            mem_free(((struct pbrt_object *)p->objects.entries[i].value)->parts);
    for (size_t i = 0; i < sizeof tables / sizeof *tables; i++)
        mem_free(tables[i]->entries);
    pbrt_params_release(&p->params);
    pbrt_reader_release(&p->reader);
    mem_free(p->stack);
    mem_free(p->stack_kinds);
    arena_release(&p->arena);
}

/* An error names its place: the directive at `at` where nothing better is known. */
static status placed(struct pbrt *p, status result, const struct pbrt_place *at)
{
    size_t length = strlen(at->file);

    if (result == STATUS_OK || result == STATUS_ERR_NO_MEMORY || p->b->error_is_placed)
        return result;
    p->b->error_is_placed = 1;
    if (strncmp(p->err->text, at->file, length) != 0 || p->err->text[length] != ':')
        error_prefix(p->err, "%s:%u", at->file, at->line);
    return result;
}

static status run(struct pbrt *p)
{
    struct pbrt_token t;

    for (;;) {
        int found;
        status result = pbrt_next(&p->reader, &t, p->err);
        if (result != STATUS_OK)
            return placed(p, result, &t.at);
        TRY(end_imports(p, &t.at, t.kind == TOKEN_END));
        if (t.kind == TOKEN_END)
            break;
        found = t.kind == TOKEN_WORD ? directive_find(t.text) : -1;
        if (found < 0)
            return pbrt_fail(p, STATUS_ERR_INPUT, &t.at,
                             "\"%.60s\" is no directive of a pbrt scene", 
                             t.kind == TOKEN_OPEN    ? "["
                             : t.kind == TOKEN_CLOSE ? "]"
                                                     : t.text);
        result = directives[found].run(p, &t.at);
        if (result != STATUS_OK)
            return placed(p, result, &t.at);
    }
    if (p->object || p->stack_count)
        pbrt_warn(p, &t.at, "unended", "the file ends before its last %s does",
                  p->object ? "ObjectBegin" : "AttributeBegin");
    if (!p->in_world)
        return placed(p, pbrt_camera(p), &t.at);
    for (size_t i = 0; i < p->b->camera_count && !p->is_animated; i++)
        p->b->cameras[i].shutter_open_s = p->b->cameras[i].shutter_close_s = 0;
    return STATUS_OK;
}

static status import(const void *data, size_t size_bytes, const char *name, const char *folder,
                     const struct import_options *options, struct builder *b)
{
    struct pbrt *p = mem_calloc(1, sizeof *p);
    status result;

    if (!p)
        return error_no_memory(b->err, "a scene");
    p->b = b;
    p->err = b->err;
    p->reader.arena = &p->arena;
    result = begin(p, data, size_bytes, name, folder);
    if (result == STATUS_OK)
        result = run(p);
    if (result == STATUS_OK)
        result = builder_finish(b, file_basename(name), options);
    finish(p);
    mem_free(p);
    return result;
}

static int recognise(const void *data, size_t size_bytes, const char *name)
{
    const char *text = data, *base = file_basename(name);
    size_t length = strlen(base), at = 0, start;
    char word[32];

    if ((length > 5 && strcasecmp(base + length - 5, ".pbrt") == 0) ||
        (length > 8 && strcasecmp(base + length - 8, ".pbrt.gz") == 0))
        return 1;
    while (at < size_bytes) {
        if (text[at] == '#')
            while (at < size_bytes && text[at] != '\n')
                at++;
        else if (text[at] && strchr(" \t\r\n", text[at]))
            at++;
        else
            break;
    }
    for (start = at; at < size_bytes && at - start < sizeof word - 1 &&
                     ((text[at] >= 'a' && text[at] <= 'z') || (text[at] >= 'A' && text[at] <= 'Z'));
         at++)
        word[at - start] = text[at];
    word[at - start] = 0;
    return directive_find(word) >= 0;
}

const struct import_format format_pbrt = {
    .name = "pbrt-v4 (.pbrt)",
    .recognise = recognise,
    .import = import,
};
