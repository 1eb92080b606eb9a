/* glTF: reads the keys of an animation's samplers, checks and mends them. */
#include <math.h>
#include <string.h>

#include "client/import/gltf/gltf.h"
#include "common/base/memory.h"

/* ---- samplers ------------------------------------------------------------------------------- */

static status read_times(struct gltf *g, json_t *sampler, const struct gltf_place *at, struct scene_channel *out)
{
    struct gltf_accessor accessor;
    int64_t index = -1;

    TRY(gltf_index(g, sampler, at, "input", g->accessors, &index));
    if (index < 0)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "has no input");
    TRY(gltf_accessor_open(g, (size_t)index, &accessor));
    if (accessor.components != 1)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "input must be SCALAR");
    if (accessor.count > SCENE_KEYS_MAX)
        return gltf_fail(g, STATUS_ERR_LIMIT, at, "has %zu keys: at most %d are taken", accessor.count, SCENE_KEYS_MAX);
    TRY(gltf_accessor_floats(g, (size_t)index, &accessor, 0, &out->times));
    out->key_count = (uint32_t)accessor.count;
    for (uint32_t i = 0; i < out->key_count; i++)
        if (fabsf(out->times[i]) > (float)GLTF_TIME_MAX_S || (i && out->times[i] < out->times[i - 1]))
            return gltf_fail(g, STATUS_ERR_INPUT, at,
                             "the times of its keys must rise and stay below %d s: key %u is at %g", GLTF_TIME_MAX_S, i,
                             (double)out->times[i]);
    return STATUS_OK;
}

/* An element of the output is a value, or, of weights, one of them. */
static status read_values(struct gltf *g, json_t *sampler, const struct gltf_place *at, const char *what,
                          struct scene_channel *out)
{
    const int one_each = strcmp(what, "weights") == 0, components = one_each ? 1 : (int)out->components;
    size_t wanted = (size_t)out->key_count * (out->interpolation == INTERPOLATE_CUBIC ? 3 : 1);
    struct gltf_accessor accessor;
    int64_t index = -1;

    TRY(gltf_index(g, sampler, at, "output", g->accessors, &index));
    if (index < 0)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "has no output");
    TRY(gltf_accessor_open(g, (size_t)index, &accessor));
    if (one_each)
        wanted *= out->components;
    if (accessor.components != components || accessor.count != wanted)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "output must have %zu elements of %d components for %u keys of a %s",
                         wanted, components, out->key_count, what);
    /* Many channels may name one accessor. */
    g->key_floats += accessor.count * (size_t)accessor.components;
    if (g->key_floats > GLTF_KEY_FLOATS_MAX)
        return gltf_fail(g, STATUS_ERR_LIMIT, at,
                         "the file's animations have more than %d values: choose one with "
                         "--animation",
                         GLTF_KEY_FLOATS_MAX);
    return gltf_accessor_floats(g, (size_t)index, &accessor, 0, &out->values);
}

static status read_interpolation(struct gltf *g, json_t *sampler, const struct gltf_place *at,
                                 enum scene_interpolation *out)
{
    const char *name = "LINEAR";

    TRY(gltf_text(g, sampler, at, "interpolation", &name));
    if (strcmp(name, "LINEAR") == 0)
        *out = INTERPOLATE_LINEAR;
    else if (strcmp(name, "STEP") == 0)
        *out = INTERPOLATE_STEP;
    else if (strcmp(name, "CUBICSPLINE") == 0)
        *out = INTERPOLATE_CUBIC;
    else
        return gltf_fail(g, STATUS_ERR_INPUT, at,
                         "interpolation \"%.32s\" is unknown: LINEAR, STEP and CUBICSPLINE are "
                         "known",
                         name);
    return STATUS_OK;
}

/* ---- mending -------------------------------------------------------------------------------- */

static size_t key_floats(const struct scene_channel *c)
{
    return (size_t)c->components * (c->interpolation == INTERPOLATE_CUBIC ? 3 : 1);
}

/* Of several keys at one time the last one is kept, as if the others came just before it. */
static void drop_equal_times(struct gltf *g, const struct gltf_place *at, struct scene_channel *c)
{
    size_t width = key_floats(c);
    uint32_t kept = 0;

    for (uint32_t i = 0; i < c->key_count; i++) {
        if (kept && c->times[kept - 1] == c->times[i])
            kept--;
        c->times[kept] = c->times[i];
        memmove(c->values + kept * width, c->values + i * width, width * sizeof *c->values);
        kept++;
    }
    if (kept < c->key_count)
        builder_warn(g->b, "keys at one time", "%s[%zu]%s: has several keys at one time: the last of them is taken",
                     at->table, at->row, at->part);
    c->key_count = kept;
}

/* Rotations to unit length (of a spline only the values: it is made unit after). */
static void normalize_rotations(struct gltf *g, const struct gltf_place *at, struct scene_channel *c)
{
    size_t width = key_floats(c), first = c->interpolation == INTERPOLATE_CUBIC ? 4 : 0;

    for (uint32_t i = 0; i < c->key_count; i++) {
        float *q = c->values + i * width + first;
        double length = sqrt((double)q[0] * (double)q[0] + (double)q[1] * (double)q[1] + (double)q[2] * (double)q[2] +
                             (double)q[3] * (double)q[3]);
        if (!(length > 0) || !isfinite(length)) {
            builder_warn(g->b, "rotation", "%s[%zu]%s: key %u is no rotation: none is taken", at->table, at->row,
                         at->part, i);
            q[0] = q[1] = q[2] = 0, q[3] = 1;
            continue;
        }
        for (int k = 0; k < 4; k++)
            q[k] = (float)((double)q[k] / length);
    }
}

int gltf_keys_are_still(const struct scene_channel *c)
{
    size_t width = key_floats(c);
    const float *first = c->values + (c->interpolation == INTERPOLATE_CUBIC ? c->components : 0);

    for (uint32_t i = 0; i < c->key_count; i++)
        for (size_t k = 0; k < width; k++) {
            int tangent = c->interpolation == INTERPOLATE_CUBIC && k / c->components != 1;
            /* The outer tangents of the first and last key do not matter, but exporters write zeros there too. */
            float wanted = tangent ? 0.0f : first[k % c->components];
            if (c->values[i * width + k] != wanted)
                return 0;
        }
    return 1;
}

status gltf_keys(struct gltf *g, json_t *sampler, const struct gltf_place *at, const char *what, struct scene_channel *out)
{
    TRY(read_interpolation(g, sampler, at, &out->interpolation));
    TRY(read_times(g, sampler, at, out));
    TRY(read_values(g, sampler, at, what, out));
    drop_equal_times(g, at, out);
    if (out->path == PATH_ROTATION)
        normalize_rotations(g, at, out);
    return STATUS_OK;
}

void gltf_keys_release(struct scene_channel *keys)
{
    mem_free(keys->times);
    mem_free(keys->values);
}
