#include "worker/path_message.h"

#include <ctype.h>

#include "common/base/memory.h"

enum { WORD_SIZE = 32, VECTORS = 15 };

/* A vertex's parts, beside each other so that one block holds the message. */
struct vertex_parts {
    Azulejo__Wire__PathVertex vertex;
    Azulejo__Wire__LightSampled light;
    Azulejo__Wire__Vec3 vectors[VECTORS];
    uint32_t vector_count;
    char lobe[WORD_SIZE], kind[WORD_SIZE];
    char *bodies[RECORD_BODIES_MAX];
};

struct path_message {
    Azulejo__Wire__SamplePath path;
    Azulejo__Wire__Vec3 radiance;
    Azulejo__Wire__PathVertex *pointers[RECORD_VERTICES_MAX];
    struct vertex_parts parts[];
};

static Azulejo__Wire__Vec3 vector_of(struct vec3 v)
{
    Azulejo__Wire__Vec3 out = AZULEJO__WIRE__VEC3__INIT;

    out.x = v.x;
    out.y = v.y;
    out.z = v.z;
    return out;
}

static Azulejo__Wire__Vec3 *add_vector(struct vertex_parts *p, struct vec3 v)
{
    p->vectors[p->vector_count] = vector_of(v);
    return &p->vectors[p->vector_count++];
}

/* "DIFFUSE_TRANSMISSION" -> "diffuse transmission" */
static char *word_of(char out[WORD_SIZE], const char *name)
{
    size_t i = 0;

    for (; name[i] && i + 1 < WORD_SIZE; i++)
        out[i] = name[i] == '_' ? ' ' : (char)tolower((unsigned char)name[i]);
    out[i] = 0;
    return out;
}

/* The name of row `index` of one of the scene's tables; "" where there is none. */
#define NAME_OF(scene, table, count, index) \
    ((scene) && (index) >= 0 && (uint32_t)(index) < (scene)->count ? (scene)->table[index].name : "")

static Azulejo__Wire__LightSampled *light_of(struct vertex_parts *p, const struct record_light *light,
                                             const struct scene *scene)
{
    Azulejo__Wire__LightSampled *out = &p->light;

    azulejo__wire__light_sampled__init(out);
    out->kind = word_of(p->kind, light->kind);
    out->number =
        scene && light->number >= 0 ? (int32_t)record_scene_light(scene, (uint32_t)light->number) : light->number;
    out->instance = light->instance;
    out->triangle = light->triangle;
    out->name = (char *)(light->instance >= 0 ? NAME_OF(scene, instances, instance_count, light->instance)
                                              : NAME_OF(scene, lights, light_count, out->number));
    out->direction = add_vector(p, light->direction);
    out->distance = light->distance;
    out->radiance = add_vector(p, light->radiance);
    out->pdf = light->pdf;
    out->delta = light->delta != 0;
    out->scatter_pdf = light->scatter_pdf;
    out->scatter = add_vector(p, light->scatter);
    out->weight = light->weight;
    out->traced = light->traced != 0;
    out->visible = add_vector(p, light->visible);
    return out;
}

static void name_vertex(Azulejo__Wire__PathVertex *out, const struct record_vertex *v, const struct scene *scene)
{
    out->instance = v->instance;
    out->instance_name = (char *)NAME_OF(scene, instances, instance_count, v->instance);
    out->mesh = v->mesh;
    out->mesh_name = (char *)NAME_OF(scene, meshes, mesh_count, v->mesh);
    out->material = v->material;
    out->material_name = (char *)NAME_OF(scene, materials, material_count, v->material);
    out->triangle = v->triangle;
    out->medium = v->medium;
    out->medium_name = (char *)NAME_OF(scene, media, medium_count, v->medium);
}

static void fill_vertex(struct vertex_parts *p, const struct record_vertex *v, const struct scene *scene)
{
    Azulejo__Wire__PathVertex *out = &p->vertex;

    azulejo__wire__path_vertex__init(out);
    out->kind = (char *)path_met_text(v->met);
    out->depth = v->depth;
    out->position = add_vector(p, v->p);
    out->geometric_normal = add_vector(p, v->ng);
    out->shading_normal = add_vector(p, v->ns);
    out->distance = v->t;
    out->front = v->front != 0;
    name_vertex(out, v, scene);
    for (uint32_t i = 0; i < v->body_count; i++)
        p->bodies[i] = (char *)NAME_OF(scene, materials, material_count, (int32_t)v->bodies[i].material);
    out->bodies = p->bodies;
    out->n_bodies = v->body_count;
    out->throughput = add_vector(p, v->throughput);
    out->added_medium = add_vector(p, v->added[FROM_MEDIUM]);
    out->added_path = add_vector(p, v->added[FROM_PATH]);
    out->added_light = add_vector(p, v->added[FROM_LIGHT]);
    out->added_caster = add_vector(p, v->added[FROM_CASTER]);
    out->met_pdf = v->met_pdf;
    out->met_weight = v->met_weight;
    if (v->light.asked)
        out->light = light_of(p, &v->light, scene);
    out->lobe = word_of(p->lobe, v->scattered ? v->lobe : "");
    out->direction = add_vector(p, v->direction);
    out->weight = add_vector(p, v->weight);
    out->pdf = v->pdf;
    out->delta = v->delta != 0;
    out->survival = v->survival;
}

struct path_message *path_message_new(const struct sample_record *record, const struct scene *scene)
{
    struct path_message *m = mem_calloc(1, sizeof *m + record->count * sizeof *m->parts);

    if (!m)
        return NULL;
    azulejo__wire__sample_path__init(&m->path);
    m->radiance = vector_of(record->radiance);
    m->path.radiance = &m->radiance;
    m->path.end = (char *)path_end_text(record->end);
    m->path.truncated = record->truncated != 0;
    for (uint32_t i = 0; i < record->count; i++) {
        fill_vertex(&m->parts[i], &record->vertices[i], scene);
        m->pointers[i] = &m->parts[i].vertex;
    }
    m->path.vertices = m->pointers;
    m->path.n_vertices = record->count;
    return m;
}

Azulejo__Wire__SamplePath *path_message_body(struct path_message *m) { return &m->path; }
