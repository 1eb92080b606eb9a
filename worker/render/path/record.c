/* record: what is written down of a path, and its words. */
#include "worker/render/record.h"

#include <string.h>

#include "worker/render/path/kernel.h"
#include "worker/render/path/record_path.h"
#include "worker/render/render_scene.h"

/* Where the thread writes; NULL: no record is wanted. */
static _Thread_local struct sample_record *record_now;

_Static_assert((int)RECORD_BODIES_MAX >= (int)INTERIOR_MAX, "a record holds all bodies that a path is in");

#define RECORD_TEXT(NAME, text) text,

const char *path_end_text(enum path_end end)
{
    static const char *const texts[] = {PATH_END_MAP(RECORD_TEXT)};

    return texts[end];
}

const char *path_met_text(enum path_met met)
{
    static const char *const texts[] = {PATH_MET_MAP(RECORD_TEXT)};

    return texts[met];
}

/* The vertex being written, NULL: none. */
static struct record_vertex *record_vertex(void)
{
    return record_now && record_now->count > 0 && !record_now->truncated ? &record_now->vertices[record_now->count - 1]
                                                                         : NULL;
}

/* The next vertex, with everything absent. */
static struct record_vertex *record_vertex_next(void)
{
    struct record_vertex *r;

    if (!record_now || record_now->truncated)
        return NULL;
    if (record_now->count == RECORD_VERTICES_MAX) {
        record_now->truncated = 1;
        return NULL;
    }
    r = &record_now->vertices[record_now->count++];
    memset(r, 0, sizeof *r);
    r->instance = r->mesh = r->material = r->medium = -1;
    r->light.number = r->light.instance = -1;
    r->light.kind = r->lobe = "";
    r->survival = r->met_weight = r->light.weight = 1;
    return r;
}

void record_vertex_begins(const struct path *path, struct path_vertex *v, struct path_notes *notes)
{
    struct record_vertex *r = record_vertex_next();

    memset(v, 0, sizeof *v);
    memset(notes, 0, sizeof *notes);
    notes->met_weight = notes->weight = notes->survival = 1;
    v->sample.lobe = BSDF_LOBES;
    if (!r)
        return;
    r->depth = path->depth;
    for (uint32_t i = 0; i < path->interior.count; i++) {
        r->bodies[i].material = path->interior.entry[i] & ~INTERIOR_OWED;
        r->bodies[i].owed = (path->interior.entry[i] & INTERIOR_OWED) != 0;
    }
    r->body_count = path->interior.count;
}

static void record_surface(struct record_vertex *r, const struct render_scene *scene, const struct surface *s)
{
    r->p = beyond_boundaries(scene, s->p, s->rest);
    r->ng = s->ng;
    r->t = s->t;
    r->front = s->front;
    r->instance = (int32_t)(s->instance - scene->instances);
    r->mesh = (int32_t)s->instance->mesh;
    r->material = (int32_t)(s->material - scene->materials);
    r->triangle = s->triangle;
}

/* The path is there already, unless the medium absorbed it. */
static void record_in_medium(struct record_vertex *r, const struct path *path, const struct path_vertex *v,
                             enum path_end end)
{
    const int there = end == PATH_GOES_ON || end == PATH_ROULETTE || !(v->medium_t < INFINITY);

    r->t = v->medium_t;
    r->p = there ? path->ray.origin : vec3_mad(path->ray.origin, path->ray.direction, v->medium_t);
    r->p = beyond_boundaries(path->scene, r->p, there ? path->ray.rest : NULL);
}

static void record_light(struct record_light *r, const struct render_scene *scene, const struct light_sample *s,
                         const struct path_notes *notes)
{
#define RECORD_LIGHT_KIND(KIND, ...) [LIGHT_##KIND] = #KIND,
    static const char *const kinds[] = {LIGHT_KINDS(RECORD_LIGHT_KIND)};
    const struct emitters *e = &scene->emitters;

    r->asked = notes->asked;
    r->found = notes->found;
    r->weight = notes->weight;
    r->scatter = notes->scatter;
    r->scatter_pdf = notes->scatter_pdf;
    r->traced = notes->traced;
    r->visible = notes->visible;
    if (!s->light)
        return;
    r->kind = kinds[s->kind];
    if (s->kind < LIGHT_KIND_COUNT) {
        for (uint32_t i = 0; i < e->punctual_count; i++)
            if (e->punctual[i] == s->light)
                r->number = (int32_t)i;
    } else if (s->kind != LIGHT_ENVIRONMENT) {
        r->instance = (int32_t)((const struct hit *)s->light)->instance;
        r->triangle = ((const struct hit *)s->light)->triangle;
    }
    if (!r->found)
        return;
    r->direction = s->direction;
    r->distance = s->distance;
    r->radiance = light_radiance(s);
    r->pdf = s->pdf;
    r->delta = s->delta;
}

/* The direction in which the path went on, if it did. */
static void record_direction(struct record_vertex *r, const struct path *path, const struct path_vertex *v,
                             enum path_end end)
{
#define RECORD_LOBE(NAME, ...) #NAME,
    static const char *const lobes[] = {BSDF_LOBE_MAP(RECORD_LOBE) ""};
    const int surface = v->met == PATH_MET_SURFACE;

    r->lobe = lobes[v->sample.lobe];
    r->scattered = (v->met == PATH_MET_MEDIUM && (end == PATH_GOES_ON || end == PATH_ROULETTE)) ||
                   (surface && (end == PATH_GOES_ON || end == PATH_SIDE || end == PATH_ROULETTE || end == PATH_BLACK));
    if (!r->scattered)
        return;
    if (!surface)
        r->lobe = "PHASE";
    r->direction = path->ray.direction;
    r->weight = surface ? v->sample.weight : vec3_splat(1);
    r->pdf = surface ? v->sample.pdf : path->pdf;
    r->delta = surface && v->sample.flags & BSDF_DELTA;
}

void record_vertex_ends(const struct path *path, const struct path_vertex *v, const struct path_notes *notes,
                        enum path_end end)
{
    struct record_vertex *r = record_vertex();

    if (record_now)
        record_now->end = end;
    if (!r)
        return;
    r->met = v->met;
    r->throughput = notes->throughput;
    r->survival = notes->survival;
    r->t = INFINITY;
    memcpy(r->added, notes->added, sizeof r->added);
    r->met_pdf = notes->met_pdf;
    r->met_weight = notes->met_weight;
    for (uint32_t i = 0; v->medium && i < path->scene->medium_count; i++)
        if (path->scene->media[i] == v->medium)
            r->medium = (int32_t)i;
    if (v->met == PATH_MET_SURFACE || v->met == PATH_MET_BOUNDARY)
        record_surface(r, path->scene, &v->s);
    else if (v->met == PATH_MET_MEDIUM)
        record_in_medium(r, path, v, end);
    if (v->met == PATH_MET_SURFACE && end != PATH_UNLIT && end != PATH_DEPTH)
        r->ns = v->s.basis.n;
    record_light(&r->light, path->scene, &v->light, notes);
    record_direction(r, path, v, end);
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

void render_sample(const struct render_scene *scene, uint32_t frame, uint32_t x, uint32_t y, uint32_t number,
                   float32 added[3], struct sample_record *record, struct render_stats *stats)
{
    struct vec3 sum;

    if (record) {
        record->count = 0;
        record->truncated = 0;
        record->end = PATH_GOES_ON;
    }
    record_now = record;
    sum = kernel_recording.sample_render(scene, frame, x, y, number, record ? &record->radiance : NULL, stats);
    record_now = NULL;
    added[0] = (float32)sum.x;
    added[1] = (float32)sum.y;
    added[2] = (float32)sum.z;
}
