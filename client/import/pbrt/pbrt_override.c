/* pbrt-v3: a shape may give values of its own for parameters of its material, which count before the material's. */
#include <string.h>

#include "client/import/pbrt/read/pbrt_context.h"
#include "client/terminal/must.h"

/* What the shape itself does not read, and a material may: textures, strings and single values. */
static int may_override(const struct pbrt_param *param)
{
    return !param->used && ((PBRT_BIT(param->type) & (PBRT_COLORS | PBRT_BIT(PBRT_TEXTURE))) != 0 ||
                            param->number_count + param->string_count == 1);
}

/* Those parameters of the shape, with names that mean what they mean now. NULL: there are none. */
static struct pbrt_params *overrides_of(struct pbrt *p, const struct pbrt_params *shape)
{
    struct pbrt_params some = *shape, *copy;
    struct pbrt_param items[PBRT_PARAMS_MAX];

    some.items = items;
    some.count = 0;
    for (size_t i = 0; i < shape->count; i++)
        if (may_override(&shape->items[i]))
            items[some.count++] = shape->items[i];
    if (some.count == 0)
        return NULL;
    copy = pbrt_params_copy(&some, &p->arena);
    pbrt_textures_bind(p, copy);
    return copy;
}

/* Equal for equal overrides of one material. */
static void key_of(const struct pbrt_material *m, const struct pbrt_params *params, struct buffer *key)
{
    buffer_append(key, &m, sizeof m);
    for (size_t i = 0; i < params->count; i++) {
        const struct pbrt_param *param = &params->items[i];
        const void *const bound[2] = {param->bound_color, param->bound_float};
        buffer_append(key, param->name, strlen(param->name) + 1);
        buffer_append(key, &param->type, sizeof param->type);
        buffer_append(key, &param->number_count, sizeof param->number_count);
        buffer_append(key, param->numbers, param->number_count * sizeof *param->numbers);
        for (size_t s = 0; s < param->string_count; s++)
            buffer_append(key, param->strings[s], strlen(param->strings[s]) + 1);
        buffer_append(key, bound, sizeof bound);
    }
    must_hold(key);
}

static struct pbrt_material *derive(struct pbrt *p, struct pbrt_material *from, struct pbrt_params *overrides)
{
    struct pbrt_material *m = must(ARENA_NEW(&p->arena, struct pbrt_material));

    m->kind = from->kind;
    m->name = from->name;
    m->at = from->at;
    m->mix[0] = from->mix[0];
    m->mix[1] = from->mix[1];
    m->is_derived = 1;
    m->params = overrides;
    overrides->defaults = from->params;
    for (size_t i = 0; i < from->params->count; i++) /* what is overridden is not unknown */
        if (pbrt_has(&(struct pbrt_params){.items = overrides->items, .count = overrides->count}, from->params->items[i].name))
            from->params->items[i].used = 1;
    return m;
}

/* The shape's parameters that the material has used. */
static size_t mark_used(struct pbrt_params *shape, const struct pbrt_params *overrides)
{
    size_t next = 0, used = 0;

    for (size_t i = 0; i < shape->count; i++)
        if (may_override(&shape->items[i])) {
            shape->items[i].used = overrides->items[next].used;
            used += (size_t)overrides->items[next++].used;
        }
    return used;
}

status pbrt_override(struct pbrt *p, struct pbrt_params *shape, struct pbrt_material **m)
{
    struct pbrt_params *overrides = p->version3 ? overrides_of(p, shape) : NULL;
    struct buffer key = BUFFER_INIT;
    struct pbrt_material *derived;
    status result;

    if (!overrides)
        return STATUS_OK;
    key_of(*m, overrides, &key);
    derived = pbrt_table_find(&p->derived, key.data, key.size);
    if (!derived) {
        derived = derive(p, *m, overrides);
        pbrt_table_set(&p->derived, &p->arena, key.data, key.size, derived);
    }
    buffer_release(&key);
    result = pbrt_material_resolve(p, derived, 0);
    if (result == STATUS_OK && mark_used(shape, derived->params) > 0)
        *m = derived;
    return result;
}
