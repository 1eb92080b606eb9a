/* The names of pbrt-v4: each has one meaning in the whole file, and may be used before its definition.
 *
 * What uses an unknown name waits until the file ends. All else is done at once: a later definition cannot change it, because
 * a second one is an error. In pbrt-v3 a name means what it meant where it was used, and nothing waits. */
#include <string.h>

#include "client/import/pbrt/read/pbrt_directive.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"

enum { PBRT_LATE_MAX = 1 << 24 /* directives that wait */ };

/* A directive that waits, and the state it stands in. */
struct pbrt_late {
    enum pbrt_late_kind kind;
    const char *name, *type; /* of a texture; an instance's object */
    struct pbrt_directive d;
    struct pbrt_state state;
    struct pbrt_object *object; /* that it is a part of */
    int is_done;
};

status pbrt_define(struct pbrt *p, const char *kind, const char *name, const struct pbrt_place *at)
{
    struct pbrt_place *first;
    size_t size = strlen(kind) + strlen(name) + 2;
    char *key;

    if (p->version3)
        return STATUS_OK;
    key = must(arena_alloc(&p->arena, size, 1));
    memcpy(key, kind, strlen(kind) + 1);
    memcpy(key + strlen(kind) + 1, name, strlen(name) + 1);
    first = pbrt_table_find(&p->defined, key, size);
    if (first)
        return pbrt_fail(p, STATUS_ERR_INPUT, at,
                         "the %s \"%.80s\" is defined twice, first in %.200s:%u: in pbrt-v4 a name has one meaning in the "
                         "whole file; rename one of them",
                         kind, name, first->file, first->line);
    first = must(ARENA_NEW(&p->arena, struct pbrt_place));
    *first = *at;
    pbrt_table_set(&p->defined, &p->arena, key, size, first);
    return STATUS_OK;
}

/* ---- what waits --------------------------------------------------------------------------- */

/* Is it a parameter that takes textures of numbers, whatever it belongs to? */
static int takes_numbers(const char *name)
{
    static const char *const names[] = {"alpha", "shadowalpha", "amount", "scale", "sigma", "metallic", "displacement",
                                        "bumpmap"};
    static const char ending[] = "roughness";
    size_t length = strlen(name);

    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (strcmp(name, names[i]) == 0)
            return 1;
    return length >= sizeof ending - 1 && strcmp(name + length - (sizeof ending - 1), ending) == 0;
}

/* Does one of them name a texture that is still unknown? `color`: their kind unless the parameter's name decides. */
static int params_wait(const struct pbrt *p, const struct pbrt_params *params, int color)
{
    for (; params; params = params->defaults)
        for (size_t i = 0; i < params->count; i++) {
            const struct pbrt_param *param = &params->items[i];
            const int numbers = !color || takes_numbers(param->name);
            if (param->type == PBRT_TEXTURE &&
                !pbrt_name_find(numbers ? &p->float_textures : &p->color_textures, param->strings[0]))
                return 1;
        }
    return 0;
}

static int material_waits(const struct pbrt *p, struct pbrt_material *m, unsigned depth)
{
    const char *part[2];

    if (m->known || depth > PBRT_MATERIAL_DEPTH_MAX)
        return 0;
    if (!m->kind || params_wait(p, m->params, 1))
        return 1;
    if (strcmp(m->kind, "mix") == 0 && pbrt_mix_parts(m, part))
        for (int i = 0; i < 2; i++) {
            struct pbrt_material *found = pbrt_name_find(&p->materials, part[i]);
            if (!found || material_waits(p, found, depth + 1))
                return 1;
        }
    m->known = 1;
    return 0;
}

static int media_wait(const struct pbrt *p)
{
    const char *const names[] = {p->now.inside, p->now.outside};

    for (int i = 0; i < 2 && strcmp(names[0], names[1]) != 0; i++)
        if (*names[i] && !pbrt_name_find(&p->media, names[i]))
            return 1;
    return 0;
}

static int shape_waits(const struct pbrt *p, const struct pbrt_directive *d)
{
    return params_wait(p, d->params, 1) || material_waits(p, p->now.material, 0) || media_wait(p);
}

static int waits(const struct pbrt *p, enum pbrt_late_kind kind, const char *name, const char *type,
                 const struct pbrt_directive *d)
{
    const struct pbrt_object *object;

    if (kind == LATE_SHAPE)
        return shape_waits(p, d);
    if (kind == LATE_TEXTURE)
        return params_wait(p, d->params, strcmp(type, "float") != 0);
    object = pbrt_name_find(&p->objects, name);
    return !object || object->waits;
}

static status run_now(struct pbrt *p, enum pbrt_late_kind kind, const char *name, const char *type,
                      const struct pbrt_directive *d)
{
    return kind == LATE_SHAPE     ? pbrt_shape(p, d)
           : kind == LATE_TEXTURE ? pbrt_texture(p, name, type, d)
                                  : pbrt_object_place(p, name, &d->at);
}

status pbrt_now_or_late(struct pbrt *p, enum pbrt_late_kind kind, const char *name, const char *type,
                        const struct pbrt_directive *d)
{
    struct pbrt_late *late;

    if (p->version3 || !waits(p, kind, name, type, d))
        return run_now(p, kind, name, type, d);
    if (p->late_count >= PBRT_LATE_MAX)
        return pbrt_fail(p, STATUS_ERR_LIMIT, &d->at, "more than %d directives use names that are defined later",
                         PBRT_LATE_MAX);
    MUST_GROW(p->late, p->late_capacity, p->late_count + 1);
    late = &p->late[p->late_count++];
    *late = (struct pbrt_late){
        .kind = kind, .name = name, .type = type, .d = *d, .state = p->now, .object = p->object};
    if (d->params)
        late->d.params = pbrt_params_copy(d->params, &p->arena);
    if (p->object && kind == LATE_SHAPE)
        p->object->waits = 1;
    return STATUS_OK;
}

/* ---- the file's end ----------------------------------------------------------------------- */

static status run_late(struct pbrt *p, struct pbrt_late *late, struct pbrt_place *at)
{
    *at = late->d.at;
    p->now = late->state;
    p->object = late->object;
    late->is_done = 1;
    return run_now(p, late->kind, late->name, late->type, &late->d);
}

/* Those that wait for one another take a round for each step between them. */
static status run_textures(struct pbrt *p, struct pbrt_place *at)
{
    int progress = 1;

    for (int round = 0; progress && round <= PBRT_TEXTURE_DEPTH_MAX; round++) {
        progress = 0;
        for (size_t i = 0; i < p->late_count; i++) {
            struct pbrt_late *late = &p->late[i];
            if (late->kind != LATE_TEXTURE || late->is_done || waits(p, late->kind, late->name, late->type, &late->d))
                continue;
            TRY(run_late(p, late, at));
            progress = 1;
        }
    }
    return progress ? pbrt_fail(p, STATUS_ERR_LIMIT, at, "textures use later ones more than %d deep", PBRT_TEXTURE_DEPTH_MAX)
                    : STATUS_OK;
}

status pbrt_late_finish(struct pbrt *p, struct pbrt_place *at)
{
    TRY(run_textures(p, at));
    for (int instances = 0; instances < 2; instances++) /* the objects are complete then */
        for (size_t i = 0; i < p->late_count; i++)
            if (!p->late[i].is_done && instances == (p->late[i].kind == LATE_INSTANCE))
                TRY(run_late(p, &p->late[i], at));
    return STATUS_OK;
}
