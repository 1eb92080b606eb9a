/* record: what the hooks write down, and its words. */
#include "worker/render/record.h"

#include <string.h>

#include "worker/render/path/kernel.h"
#include "worker/render/path/record_hooks.h"
#include "worker/render/world.h"

_Thread_local struct sample_record *record_now;

#define RECORD_TEXT(NAME, text) text,

const char *record_end_text(enum record_end end)
{
    static const char *const texts[] = {RECORD_END_MAP(RECORD_TEXT)};

    return texts[end];
}

const char *record_kind_text(enum record_kind kind)
{
    static const char *const texts[] = {RECORD_KIND_MAP(RECORD_TEXT)};

    return texts[kind];
}

struct record_vertex *record_vertex(void)
{
    return record_now && record_now->count > 0 && !record_now->truncated
               ? &record_now->vertices[record_now->count - 1] : NULL;
}

struct record_vertex *record_vertex_next(void)
{
    struct record_vertex *v;

    if (!record_now || record_now->truncated)
        return NULL;
    if (record_now->count == RECORD_VERTICES_MAX) {
        record_now->truncated = 1;
        return NULL;
    }
    v = &record_now->vertices[record_now->count++];
    memset(v, 0, sizeof *v);
    v->instance = v->mesh = v->material = v->medium = -1;
    v->light.number = v->light.instance = -1;
    v->light.kind = v->lobe = "";
    v->survival = v->met_weight = v->light.weight = 1;
    return v;
}

void record_light_kind(const struct render_scene *scene, int kind, const char *text,
                       const void *light)
{
    const struct emitters *e = &scene->emitters;
    struct record_vertex *v = record_vertex();

    if (!v)
        return;
    v->light.kind = text;
    if (kind < LIGHT_KIND_COUNT) {
        for (uint32_t i = 0; i < e->punctual_count; i++)
            if (e->punctual[i] == light)
                v->light.number = (int32_t)i;
    } else if (kind != LIGHT_ENVIRONMENT) {
        v->light.instance = (int32_t)((const struct hit *)light)->instance;
        v->light.triangle = ((const struct hit *)light)->triangle;
    }
}

/* The emitters have the directional lights first, each kind in the list's order (emitters.c). */
uint32_t record_scene_light(const struct scene *scene, uint32_t number)
{
    for (int directional = 1; directional >= 0; directional--)
        for (uint32_t i = 0; i < scene->light_count; i++)
            if ((scene->lights[i].kind == LIGHT_DIRECTIONAL) == directional && number-- == 0)
                return i;
    return scene->light_count;
}

void render_sample(const struct render_scene *scene, uint32_t frame, uint32_t x, uint32_t y,
                   uint32_t number, float32 added[3], struct sample_record *record,
                   struct render_stats *stats)
{
    struct vec3 sum;

    if (record) {
        record->count = 0;
        record->truncated = 0;
        record->end = RECORD_END_NONE;
    }
    record_now = record;
    sum = sample_render_recording(scene, frame, x, y, number, record ? &record->radiance : NULL,
                                  stats);
    record_now = NULL;
    added[0] = (float32)sum.x;
    added[1] = (float32)sum.y;
    added[2] = (float32)sum.z;
}
