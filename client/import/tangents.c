/* Tangents after MikkTSpace (Mikkelsen 2008, "Simulation of Wrinkled Surfaces Revisited",
 * chapter 2), with one simplification: triangles meet at a vertex when position, normal
 * and texture coordinates agree bit by bit and the texture has the same handedness there;
 * MikkTSpace also asks that they are joined by shared edges. */
#include <math.h>
#include <string.h>

#include "client/import/mesh.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "common/math/vec.h"

enum { HANDS = 2 }; /* 0: w = +1, 1: w = -1 */

struct key {
    float position[3], normal[3], uv[2];
};

struct work {
    const struct mesh_source *mesh;
    struct key *keys;          /* a vertex */
    uint32_t *weld;            /* a vertex: the first vertex like it */
    double (*sum)[HANDS][3];   /* a welded vertex */
    int8_t *hand;              /* a triangle: 0, 1, or -1 without texture area */
    uint8_t *used;             /* a vertex: bit per hand */
    uint32_t (*slot)[HANDS];   /* a vertex: its new number for each hand */
    uint32_t *from;            /* a new vertex: the old one */
};

static struct vec3 at(const float *array, size_t i)
{
    return (struct vec3){array[3 * i], array[3 * i + 1], array[3 * i + 2]};
}

/* Every vertex its own triangle's: flat shading has no normals that triangles could share. */
static status unshare(struct mesh_source *mesh, struct error *err)
{
    size_t corners = mesh->triangle_count * 3;
    status result = mesh_source_gather(mesh, mesh->indices, corners, err);

    if (result == STATUS_OK)
        for (size_t i = 0; i < corners; i++)
            mesh->indices[i] = (uint32_t)i;
    return result;
}

static void fill_keys(struct work *w, const struct mesh_tangents *wanted)
{
    const struct mesh_source *mesh = w->mesh;
    const float *uv = mesh->uv[wanted->uv_set];
    const float(*m)[3] = wanted->uv_transform;

    for (size_t v = 0; v < mesh->vertex_count; v++) {
        float tu = uv[2 * v], tv = uv[2 * v + 1];
        memcpy(w->keys[v].position, mesh->positions + 3 * v, sizeof w->keys[v].position);
        /* + 0.0f: one zero only, so that bits compare as values do */
        w->keys[v].uv[0] = m[0][0] * tu + m[0][1] * tv + m[0][2] + 0.0f;
        w->keys[v].uv[1] = m[1][0] * tu + m[1][1] * tv + m[1][2] + 0.0f;
        if (mesh->normals)
            memcpy(w->keys[v].normal, mesh->normals + 3 * v, sizeof w->keys[v].normal);
    }
    if (mesh->normals)
        return;
    for (size_t t = 0; t < mesh->triangle_count; t++) {
        struct vec3 a = at(mesh->positions, 3 * t), b = at(mesh->positions, 3 * t + 1);
        struct vec3 c = at(mesh->positions, 3 * t + 2);
        struct vec3 n = vec3_normalize(vec3_cross(vec3_sub(b, a), vec3_sub(c, a)));
        for (size_t i = 0; i < 3; i++)
            memcpy(w->keys[3 * t + i].normal, &n, sizeof n);
    }
}

/* The direction in which u grows on triangle t, and its hand. */
static struct vec3 texture_direction(const struct work *w, size_t t, int8_t *hand)
{
    const uint32_t *corner = w->mesh->indices + 3 * t;
    const struct key *k[3] = {&w->keys[corner[0]], &w->keys[corner[1]], &w->keys[corner[2]]};
    double du1 = (double)k[1]->uv[0] - (double)k[0]->uv[0];
    double dv1 = (double)k[1]->uv[1] - (double)k[0]->uv[1];
    double du2 = (double)k[2]->uv[0] - (double)k[0]->uv[0];
    double dv2 = (double)k[2]->uv[1] - (double)k[0]->uv[1];
    double area = du1 * dv2 - du2 * dv1;
    double d[3], largest = 0;
    struct vec3 direction = {0, 0, 0};

    *hand = -1;
    if (area == 0 || !isfinite(area))
        return direction;
    for (int i = 0; i < 3; i++) {
        double e1 = (double)k[1]->position[i] - (double)k[0]->position[i];
        double e2 = (double)k[2]->position[i] - (double)k[0]->position[i];
        d[i] = (e1 * dv2 - e2 * dv1) * (area < 0 ? -1 : 1);
        largest = fmax(largest, fabs(d[i]));
    }
    if (!(largest > 0) || !isfinite(largest))
        return direction;
    for (int i = 0; i < 3; i++)
        d[i] /= largest; /* in a float's range */
    direction = vec3_make((float)d[0], (float)d[1], (float)d[2]);
    /* v runs downwards in glTF, green of a normal map upwards: a texture that is not mirrored
     * has negative area in (u, v) and keeps cross(normal, tangent) as its up (w = +1). */
    *hand = area < 0 ? 0 : 1;
    return vec3_normalize(direction);
}

/* The part of v square to the unit vector n, unit. */
static struct vec3 project(struct vec3 v, struct vec3 n)
{
    return vec3_normalize(vec3_mad(v, n, -vec3_dot(n, v)));
}

static void accumulate(struct work *w)
{
    const struct mesh_source *mesh = w->mesh;

    for (size_t t = 0; t < mesh->triangle_count; t++) {
        const uint32_t *corner = mesh->indices + 3 * t;
        struct vec3 direction = texture_direction(w, t, &w->hand[t]);
        if (w->hand[t] < 0)
            continue;
        for (int i = 0; i < 3; i++) {
            uint32_t v = corner[i];
            struct vec3 n = at(w->keys[v].normal, 0);
            struct vec3 p = at(mesh->positions, v);
            struct vec3 e1 = project(vec3_sub(at(mesh->positions, corner[(i + 1) % 3]), p), n);
            struct vec3 e2 = project(vec3_sub(at(mesh->positions, corner[(i + 2) % 3]), p), n);
            struct vec3 tangent = project(direction, n);
            double angle = (double)det_acos(vec3_dot(e1, e2));
            double *sum = w->sum[w->weld[v]][w->hand[t]];
            sum[0] += (double)tangent.x * angle;
            sum[1] += (double)tangent.y * angle;
            sum[2] += (double)tangent.z * angle;
        }
    }
}

static int sum_is_zero(const double sum[3])
{
    return sum[0] == 0 && sum[1] == 0 && sum[2] == 0;
}

/* Which hand a corner takes: its triangle's, or for a triangle without texture area that of
 * a neighbour that has one. */
static int corner_hand(const struct work *w, size_t t, uint32_t v)
{
    if (w->hand[t] >= 0)
        return w->hand[t];
    return sum_is_zero(w->sum[w->weld[v]][0]) && !sum_is_zero(w->sum[w->weld[v]][1]);
}

/* Number the new vertices (old order, right hand first) and point the indices at them. */
static size_t split(struct work *w, uint32_t *indices)
{
    const struct mesh_source *mesh = w->mesh;
    size_t count = 0;

    for (size_t t = 0; t < mesh->triangle_count; t++)
        for (size_t i = 0; i < 3; i++) {
            uint32_t v = indices[3 * t + i];
            w->used[v] |= (uint8_t)(1 << corner_hand(w, t, v));
        }
    for (size_t v = 0; v < mesh->vertex_count; v++)
        for (int hand = 0; hand < HANDS; hand++)
            if (w->used[v] >> hand & 1) {
                w->slot[v][hand] = (uint32_t)count;
                w->from[count++] = (uint32_t)v;
            }
    for (size_t t = 0; t < mesh->triangle_count; t++)
        for (size_t i = 0; i < 3; i++) {
            uint32_t v = indices[3 * t + i];
            indices[3 * t + i] = w->slot[v][corner_hand(w, t, v)];
        }
    return count;
}

static void write_tangents(const struct work *w, size_t count, float *tangents)
{
    for (size_t i = 0; i < count; i++) {
        uint32_t v = w->from[i];
        int hand = w->slot[v][0] == i && (w->used[v] & 1) ? 0 : 1;
        const double *sum = w->sum[w->weld[v]][hand];
        struct vec3 n = at(w->keys[v].normal, 0);
        struct vec3 t = vec3_make((float)sum[0], (float)sum[1], (float)sum[2]);
        t = vec3_normalize(t);
        if (vec3_is_black(t)) /* no direction is better than another */
            t = frame_from_normal(n).s;
        tangents[4 * i] = t.x;
        tangents[4 * i + 1] = t.y;
        tangents[4 * i + 2] = t.z;
        tangents[4 * i + 3] = hand ? -1.0f : 1.0f;
    }
}

status tangents_generate(struct mesh_source *mesh, const struct mesh_tangents *wanted,
                         struct error *err)
{
    struct work w = {.mesh = mesh};
    float *tangents = NULL;
    status result = STATUS_OK;
    size_t vertices, count;

    mem_free(mesh->tangents);
    mesh->tangents = NULL;
    if (!mesh->normals) {
        result = unshare(mesh, err);
        if (result != STATUS_OK)
            return result;
    }
    vertices = mesh->vertex_count;
    w.keys = mem_calloc(vertices, sizeof *w.keys);
    w.weld = mem_alloc_array(vertices, sizeof *w.weld);
    w.sum = mem_calloc(vertices, sizeof *w.sum);
    w.hand = mem_alloc_array(mesh->triangle_count, sizeof *w.hand);
    w.used = mem_calloc(vertices, sizeof *w.used);
    w.slot = mem_calloc(vertices, sizeof *w.slot);
    w.from = mem_alloc_array(vertices, HANDS * sizeof *w.from);
    if (!w.keys || !w.weld || !w.sum || !w.hand || !w.used || !w.slot || !w.from) {
        result = error_no_memory(err, "tangents");
        goto done;
    }
    fill_keys(&w, wanted);
    result = vertices_weld(w.keys, sizeof *w.keys, vertices, w.weld, err);
    if (result != STATUS_OK)
        goto done;
    accumulate(&w);
    count = split(&w, mesh->indices);
    if (count > UINT32_MAX / 2) {
        result = error_set(err, STATUS_ERR_LIMIT, "the mesh has too many vertices");
        goto done;
    }
    tangents = mem_alloc_array(count, 4 * sizeof *tangents);
    if (!tangents) {
        result = error_no_memory(err, "tangents");
        goto done;
    }
    write_tangents(&w, count, tangents);
    result = mesh_source_gather(mesh, w.from, count, err);
    if (result == STATUS_OK) {
        mesh->tangents = tangents;
        tangents = NULL;
    }
done:
    mem_free(tangents);
    mem_free(w.from);
    mem_free(w.slot);
    mem_free(w.used);
    mem_free(w.hand);
    mem_free(w.sum);
    mem_free(w.weld);
    mem_free(w.keys);
    return result;
}
