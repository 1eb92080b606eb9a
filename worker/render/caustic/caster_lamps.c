/* caster_lamps: the small lamps, emissive instances of triangles, for whose light casters are asked.
 *
 * A lamp is small if its radius is less than a tenth of the way to the nearest caster: then few of the rays that a
 * caster scatters meet it. Larger ones are met often enough. Its points are chosen by area and emission.
 */
#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "worker/render/caustic/casters_parts.h"
#include "worker/render/render_scene.h"
#include "worker/render/surface/render_motion.h"

#define SMALL 0.1
/* Of a scene with more, all are left to chance. */
enum { LAMPS_MAX = 256, CORNERS_MAX = 64 };

static int may_be_lamp(const struct render_scene *scene, const struct render_instance *instance)
{
    return !instance->motion_steps && !instance->shape && !(scene->materials[instance->material].m.clearcoat > 0);
}

/* A sphere around the instance's triangles. */
static void enclose(const struct render_scene *scene, uint32_t number, struct small_lamp *lamp)
{
    const struct render_mesh *mesh = &scene->meshes[scene->instances[number].mesh];
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY}, half[3];

    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        double corner[3][3];

        triangle_exact_corners(scene, number, t, 0, corner);
        for (int i = 0; i < 9; i++) {
            low[i % 3] = fmin(low[i % 3], corner[i / 3][i % 3]);
            high[i % 3] = fmax(high[i % 3], corner[i / 3][i % 3]);
        }
    }
    for (int k = 0; k < 3; k++) {
        lamp->middle[k] = (low[k] + high[k]) / 2;
        half[k] = (high[k] - low[k]) / 2;
    }
    lamp->radius = caster_length(half) * (1 + 1e-6);
}

static double to_edge(const double from[3], const double edge[3])
{
    const double along = exact_dot(from, edge) / exact_dot(edge, edge), share = along < 0 ? 0 : along > 1 ? 1 : along;
    double off[3];

    for (int k = 0; k < 3; k++)
        off[k] = from[k] - share * edge[k];
    return caster_length(off);
}

static double distance_of(const struct caster_face *face, const double place[3])
{
    double from[3], from_1[3], edge[3], u, v;

    exact_sub(place, face->corner[0], from);
    u = exact_dot(from, face->along_u);
    v = exact_dot(from, face->along_v);
    if (u >= 0 && v >= 0 && u + v <= 1)
        return fabs(exact_dot(from, face->own));
    exact_sub(place, face->corner[1], from_1);
    exact_sub(face->corner[2], face->corner[1], edge);
    return fmin(fmin(to_edge(from, face->e1), to_edge(from, face->e2)), to_edge(from_1, edge));
}

/* Is a face of the caster nearer than that? */
static int is_nearer(const struct render_scene *scene, const struct caster *caster, const double place[3],
                     double distance)
{
    uint32_t waiting[CASTER_DEPTH_MAX], left = 0, at = 0;

    for (;;) {
        const struct caster_node *node = &caster->nodes[at];
        double way[3];

        exact_sub(node->bounds.centre, place, way);
        if (caster_length(way) - node->bounds.radius < distance) {
            if (node->count == 0) {
                waiting[left++] = node->first;
                at++;
                continue;
            }
            for (uint32_t i = 0; i < node->count; i++) {
                struct caster_face face;

                (void)caster_face_of(scene, &caster->refs[node->first + i], &face);
                if (distance_of(&face, place) < distance)
                    return 1;
            }
        }
        if (left == 0)
            return 0;
        at = waiting[--left];
    }
}

/* Is it small beside the way to the nearest caster? */
static int is_small(const struct casters *casters, const struct small_lamp *lamp)
{
    for (uint32_t i = 0; i < casters->count; i++)
        if (is_nearer(casters->scene, &casters->list[i], lamp->middle, lamp->radius / SMALL))
            return 0;
    return 1;
}

static int is_of_caster(const struct casters *casters, const struct render_instance *instance)
{
    for (uint32_t i = 0; i < casters->count; i++)
        if (casters->list[i].material == instance->material)
            return !instance->motion_steps && !instance->shape;
    return 0;
}

/* A corner of each of the casters' instances, of the first of them if they are many. Returns how many. */
static uint32_t list_corners(const struct casters *casters, double corners[CORNERS_MAX][3])
{
    const struct render_scene *scene = casters->scene;
    uint32_t count = 0;

    for (uint32_t i = 0; i < scene->instance_count && count < CORNERS_MAX; i++) {
        double of_face[3][3];

        if (!is_of_caster(casters, &scene->instances[i]) || scene->meshes[scene->instances[i].mesh].triangle_count == 0)
            continue;
        triangle_exact_corners(scene, i, 0, 0, of_face);
        memcpy(corners[count++], of_face[0], sizeof of_face[0]);
    }
    return count;
}

/* Is it small beside the way to each of these corners? No tree is needed, and it keeps most large lamps out. */
static int may_be_small(const struct small_lamp *lamp, double (*corners)[3], uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        double way[3];

        exact_sub(corners[i], lamp->middle, way);
        if (caster_length(way) < lamp->radius / SMALL)
            return 0;
    }
    return lamp->radius > 0;
}

/* An instance's faces are together among the emitters'. */
status caster_lamps_begin(struct casters *casters, struct error *err)
{
    const struct render_scene *scene = casters->scene;
    const struct emitters *e = &scene->emitters;
    struct caster_lamps *lamps = &casters->lamps;
    double corners[CORNERS_MAX][3];
    uint32_t tried = 0, corner_count;

    if (e->face_count == 0)
        return STATUS_OK;
    corner_count = list_corners(casters, corners);
    lamps->list = mem_alloc_array(LAMPS_MAX, sizeof *lamps->list);
    NEED(lamps->list, err, "what casts caustics");
    for (uint32_t i = 0; i < e->face_count; i++) {
        const uint32_t number = e->faces[i].instance;
        struct small_lamp lamp = {.instance = number};

        if ((i > 0 && e->faces[i - 1].instance == number) || !may_be_lamp(scene, &scene->instances[number]))
            continue;
        if (tried++ == LAMPS_MAX) {
            lamps->count = 0;
            return STATUS_OK;
        }
        enclose(scene, number, &lamp);
        if (may_be_small(&lamp, corners, corner_count))
            lamps->list[lamps->count++] = lamp;
    }
    return STATUS_OK;
}

static double weight_of(const struct render_scene *scene, const struct hit *face)
{
    const float32 *emission = scene->materials[scene->instances[face->instance].material].m.emission;
    double corner[3][3], e1[3], e2[3], across[3];

    triangle_exact_corners(scene, face->instance, face->triangle, 0, corner);
    exact_sub(corner[1], corner[0], e1);
    exact_sub(corner[2], corner[0], e2);
    exact_cross(e1, e2, across);
    return caster_length(across) * ((double)emission[0] + (double)emission[1] + (double)emission[2]);
}

/* Keep the small ones. */
static status sort_out(struct casters *casters, struct error *err)
{
    struct caster_lamps *lamps = &casters->lamps;
    uint32_t kept = 0;

    lamps->of_instance = mem_calloc(casters->scene->instance_count, sizeof *lamps->of_instance);
    NEED(lamps->of_instance, err, "what casts caustics");
    for (uint32_t i = 0; i < lamps->count; i++) {
        if (!is_small(casters, &lamps->list[i]))
            continue;
        lamps->list[kept++] = lamps->list[i];
        lamps->of_instance[lamps->list[i].instance] = kept;
    }
    lamps->count = kept;
    return STATUS_OK;
}

status caster_lamps_finish(struct casters *casters, struct error *err)
{
    const struct emitters *e = &casters->scene->emitters;
    struct caster_lamps *lamps = &casters->lamps;
    uint32_t count = 0;
    double *weights;
    status s;

    if (lamps->count == 0)
        return STATUS_OK;
    TRY(sort_out(casters, err));
    lamps->faces = mem_alloc_array(e->face_count, sizeof *lamps->faces);
    weights = mem_alloc_array(e->face_count, sizeof *weights);
    if (!lamps->faces || !weights) {
        mem_free(weights);
        return error_no_memory(err, "what casts caustics");
    }
    for (uint32_t i = 0; i < e->face_count; i++)
        if (lamps->of_instance[e->faces[i].instance] > 0 && !emitters_is_dark(e, i)) {
            weights[count] = weight_of(casters->scene, &e->faces[i]);
            lamps->faces[count++] = e->faces[i];
        }
    s = light_table_init(&lamps->table, weights, count, err);
    mem_free(weights);
    if (lamps->table.count == 0)
        lamps->count = 0;
    return s;
}

void caster_lamps_release(struct caster_lamps *lamps)
{
    mem_free(lamps->of_instance);
    mem_free(lamps->list);
    mem_free(lamps->faces);
    light_table_release(&lamps->table);
}

uint32_t casters_lamp_count(const struct casters *casters) { return casters->lamps.count; }

int casters_know_lamp(const struct casters *casters, uint32_t instance)
{
    return casters->lamps.count > 0 && casters->lamps.of_instance[instance] > 0;
}

const struct hit *casters_choose_face(const struct casters *casters, real *u, real *v, real *odds,
                                      struct caster_lamp *lamp)
{
    const struct caster_lamps *lamps = &casters->lamps;
    const struct small_lamp *chosen;
    uint32_t face = 0;

    (void)light_table_choose(&lamps->table, u, v, &face, odds);
    chosen = &lamps->list[lamps->of_instance[lamps->faces[face].instance] - 1];
    memcpy(lamp->middle, chosen->middle, sizeof lamp->middle);
    lamp->radius = chosen->radius;
    lamp->kind = CASTER_LAMP_NEAR;
    lamp->moves = 0;
    return &lamps->faces[face];
}
