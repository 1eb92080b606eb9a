/* Tangents after MikkTSpace: Mikkelsen 2008, "Simulation of Wrinkled Surfaces Revisited", chapter
 * 2, and the documented rules of its published implementation, on which normal map bakers agree:
 *
 *  1. Corners are one vertex where position, normal and texture coordinates are equal.
 *  2. Two triangles are neighbours across an edge that they run through in opposite directions;
 *     of more than two the first that fit are paired.
 *  3. Around a vertex the corners of triangles that are joined by such edges, and show the
 *     texture with the same hand, form a group. A triangle without area in the texture joins
 *     the first group that reaches it and takes its hand.
 *  4. A group's tangent is the mean of its triangles' texture directions, each projected to
 *     the plane of the normal and made unit, weighted with the angle at the vertex there.
 *
 * Two things differ: groups are not split at exactly opposite directions (its default threshold of
 * 180 degrees splits nothing else), and a corner without a group gets the tangent of another group
 * of the same vertex, or any direction in the plane, not a fixed (1, 0, 0).
 */
#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "client/import/builder/mesh.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "common/math/vec.h"

enum { NO_TRIANGLE = -1, NO_GROUP = -1 };

struct key {
    float position[3], normal[3], uv[2];
};

struct group {
    double sum[3];
    int hand;            /* 0: w = +1, 1: w = -1 */
    struct vec3 tangent; /* of the sum */
};

/* One side of a triangle, for finding neighbours. */
struct side {
    uint32_t low, high; /* its welded vertices */
    uint32_t corner;    /* 3 * triangle + the corner that it starts from */
    int forward;        /* from low to high */
};

struct work {
    struct mesh_source *mesh;
    struct key *keys;       /* a vertex */
    uint32_t *weld;         /* a vertex: the first vertex like it */
    struct vec3 *direction; /* a triangle: where u grows, unit */
    uint8_t *hand;          /* a triangle */
    uint8_t *any;           /* a triangle: no area in the texture, or none at all */
    int32_t *neighbor;      /* a corner: the triangle across the side that starts there */
    int32_t *group_of;      /* a corner */
    struct group *groups;
    size_t group_count, group_capacity;
    int32_t *group_at; /* a welded vertex: its first group, for corners without */
};

static struct vec3 at(const float *array, size_t i)
{
    return (struct vec3){array[3 * i], array[3 * i + 1], array[3 * i + 2]};
}

/* Give each triangle its own vertices: flat shading has no normals to share. */
static void unshare(struct mesh_source *mesh)
{
    size_t corners = mesh->triangle_count * 3;

    mesh_source_gather(mesh, mesh->indices, corners);
    for (size_t i = 0; i < corners; i++)
        mesh->indices[i] = (uint32_t)i;
}

static void fill_keys(struct work *w, const struct mesh_tangents *wanted)
{
    const struct mesh_source *mesh = w->mesh;
    const float *uv = mesh->uv[wanted->uv_set];
    const float(*m)[3] = wanted->uv_transform;

    for (size_t v = 0; v < mesh->vertex_count; v++) {
        float tu = uv[2 * v], tv = uv[2 * v + 1];
        memcpy(w->keys[v].position, mesh->positions + 3 * v, sizeof w->keys[v].position);
        /* + 0.0f: no negative zero, so that bits compare like values */
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

static uint32_t vertex_of(const struct work *w, size_t corner) { return w->weld[w->mesh->indices[corner]]; }

/* ---- triangles ------------------------------------------------------------------------------ */

/* The direction in which u grows on triangle t, and its hand. */
static void read_triangle(struct work *w, size_t t)
{
    const uint32_t *corner = w->mesh->indices + 3 * t;
    const struct key *k[3] = {&w->keys[corner[0]], &w->keys[corner[1]], &w->keys[corner[2]]};
    double du1 = (double)k[1]->uv[0] - (double)k[0]->uv[0];
    double dv1 = (double)k[1]->uv[1] - (double)k[0]->uv[1];
    double du2 = (double)k[2]->uv[0] - (double)k[0]->uv[0];
    double dv2 = (double)k[2]->uv[1] - (double)k[0]->uv[1];
    double area = du1 * dv2 - du2 * dv1;
    double d[3], largest = 0;

    w->any[t] = 1;
    /* v runs downwards in glTF, green of a normal map upwards: a texture that is not mirrored
     * has negative area in (u, v) and keeps cross(normal, tangent) as its up (w = +1). */
    w->hand[t] = area < 0 ? 0 : 1;
    if (area == 0 || !isfinite(area))
        return;
    for (int i = 0; i < 3; i++) {
        double e1 = (double)k[1]->position[i] - (double)k[0]->position[i];
        double e2 = (double)k[2]->position[i] - (double)k[0]->position[i];
        d[i] = (e1 * dv2 - e2 * dv1) * (area < 0 ? -1 : 1);
        largest = fmax(largest, fabs(d[i]));
    }
    if (!(largest > 0) || !isfinite(largest))
        return;
    for (int i = 0; i < 3; i++)
        d[i] /= largest; /* scaled into a float's range */
    w->direction[t] = vec3_normalize(vec3_make((float)d[0], (float)d[1], (float)d[2]));
    w->any[t] = vec3_is_black(w->direction[t]);
}

/* Does it use one vertex twice? Then it joins nothing. */
static int is_collapsed(const struct work *w, size_t t)
{
    uint32_t a = vertex_of(w, 3 * t), b = vertex_of(w, 3 * t + 1), c = vertex_of(w, 3 * t + 2);

    return a == b || b == c || c == a;
}

/* ---- neighbours ----------------------------------------------------------------------------- */

static int side_compare(const void *a, const void *b)
{
    const struct side *x = a, *y = b;

    if (x->low != y->low)
        return x->low < y->low ? -1 : 1;
    if (x->high != y->high)
        return x->high < y->high ? -1 : 1;
    return (x->corner > y->corner) - (x->corner < y->corner);
}

/* Pair the sides of one edge: each with the first later one that runs against it. */
static void pair_sides(struct work *w, const struct side *sides, size_t count)
{
    size_t open[2] = {0, 0}; /* the first unpaired side of each direction, or later */

    for (size_t i = 0; i < count; i++) {
        int against = !sides[i].forward;
        size_t *first = &open[against];
        while (*first < i && (sides[*first].forward != against || w->neighbor[sides[*first].corner] != NO_TRIANGLE))
            ++*first;
        if (*first >= i)
            continue;
        w->neighbor[sides[i].corner] = (int32_t)(sides[*first].corner / 3);
        w->neighbor[sides[*first].corner] = (int32_t)(sides[i].corner / 3);
    }
}

static void find_neighbors(struct work *w)
{
    size_t corners = w->mesh->triangle_count * 3, count = 0;
    struct side *sides = must(mem_alloc_array(corners, sizeof *sides));

    for (size_t c = 0; c < corners; c++) {
        uint32_t from = vertex_of(w, c), to = vertex_of(w, c % 3 == 2 ? c - 2 : c + 1);
        w->neighbor[c] = NO_TRIANGLE;
        if (is_collapsed(w, c / 3))
            continue;
        sides[count++] = (struct side){from < to ? from : to, from < to ? to : from, (uint32_t)c,
                                       from < to};
    }
    qsort(sides, count, sizeof *sides, side_compare);
    for (size_t i = 0, end; i < count; i = end) {
        for (end = i + 1; end < count && sides[end].low == sides[i].low && sides[end].high == sides[i].high; end++)
            ;
        pair_sides(w, sides + i, end - i);
    }
    mem_free(sides);
}

/* ---- groups --------------------------------------------------------------------------------- */

/* Let triangle t join the group at its corner of `vertex`; the corner, or -1 when it does not. */
static int join_group(struct work *w, int32_t group, uint32_t vertex, size_t t)
{
    int32_t *of = w->group_of + 3 * t;
    int corner = 0;

    while (vertex_of(w, 3 * t + (size_t)corner) != vertex)
        corner++;
    if (of[corner] != NO_GROUP)
        return -1;
    if (w->any[t] && of[0] == NO_GROUP && of[1] == NO_GROUP && of[2] == NO_GROUP)
        w->hand[t] = (uint8_t)w->groups[group].hand;
    if (w->hand[t] != w->groups[group].hand)
        return -1;
    of[corner] = group;
    return corner;
}

/* From a corner to one side (0: across the side that starts there) as far as the group goes. */
static void walk(struct work *w, int32_t group, uint32_t vertex, size_t start, int back)
{
    size_t corner = start;

    for (;;) {
        size_t t = corner / 3;
        int32_t next = w->neighbor[back ? 3 * t + (corner % 3 + 2) % 3 : corner];
        int joined;
        if (next == NO_TRIANGLE)
            return;
        joined = join_group(w, group, vertex, (size_t)next);
        if (joined < 0)
            return;
        corner = 3 * (size_t)next + (size_t)joined;
    }
}

static void make_groups(struct work *w)
{
    size_t corners = w->mesh->triangle_count * 3;

    for (size_t c = 0; c < corners; c++)
        w->group_of[c] = NO_GROUP;
    for (size_t c = 0; c < corners; c++) {
        uint32_t vertex = vertex_of(w, c);
        int32_t group = (int32_t)w->group_count;
        if (w->group_of[c] != NO_GROUP || w->any[c / 3])
            continue;
        MUST_GROW(w->groups, w->group_capacity, w->group_count + 1);
        w->groups[w->group_count++] = (struct group){.hand = w->hand[c / 3]};
        w->group_of[c] = group;
        if (w->group_at[vertex] == NO_GROUP)
            w->group_at[vertex] = group;
        walk(w, group, vertex, c, 0);
        walk(w, group, vertex, c, 1);
    }
}

/* The part of v square to the unit vector n, unit. */
static struct vec3 project(struct vec3 v, struct vec3 n) { return vec3_normalize(vec3_mad(v, n, -vec3_dot(n, v))); }

/* The contribution of a corner to its group. */
static void accumulate(struct work *w, size_t corner)
{
    const struct mesh_source *mesh = w->mesh;
    size_t t = corner / 3, i = corner % 3;
    uint32_t v = mesh->indices[corner];
    struct vec3 n = at(w->keys[v].normal, 0), p = at(mesh->positions, v);
    struct vec3 next = at(mesh->positions, mesh->indices[3 * t + (i + 1) % 3]);
    struct vec3 previous = at(mesh->positions, mesh->indices[3 * t + (i + 2) % 3]);
    struct vec3 tangent = project(w->direction[t], n);
    double angle = (double)det_acos(vec3_dot(project(vec3_sub(next, p), n), project(vec3_sub(previous, p), n)));
    double *sum = w->groups[w->group_of[corner]].sum;

    sum[0] += (double)tangent.x * angle;
    sum[1] += (double)tangent.y * angle;
    sum[2] += (double)tangent.z * angle;
}

static void finish_groups(struct work *w)
{
    for (size_t c = 0; c < w->mesh->triangle_count * 3; c++)
        if (!w->any[c / 3])
            accumulate(w, c);
    for (size_t g = 0; g < w->group_count; g++) {
        const double *sum = w->groups[g].sum;
        w->groups[g].tangent = vec3_normalize(vec3_make((float)sum[0], (float)sum[1], (float)sum[2]));
    }
}

/* ---- vertices ------------------------------------------------------------------------------- */

/* A vertex of the result: an old one with a tangent. */
struct corner_key {
    uint32_t vertex;
    float tangent[4];
};

static struct corner_key corner_key(const struct work *w, size_t corner)
{
    uint32_t v = w->mesh->indices[corner];
    int32_t group = w->group_of[corner];
    struct corner_key key = {.vertex = v};
    struct vec3 t = {0, 0, 0};
    int hand = w->hand[corner / 3];

    if (group == NO_GROUP)
        group = w->group_at[w->weld[v]];
    if (group != NO_GROUP) {
        assert(w->groups);
        t = w->groups[group].tangent;
        hand = w->groups[group].hand;
    }
    if (vec3_is_black(t)) /* no direction is better than another */
        t = basis_from_normal(at(w->keys[v].normal, 0)).s;
    key.tangent[0] = t.x + 0.0f;
    key.tangent[1] = t.y + 0.0f;
    key.tangent[2] = t.z + 0.0f;
    key.tangent[3] = hand ? -1.0f : 1.0f;
    return key;
}

/* Split the vertices whose corners differ in their tangents. The new vertices keep the order of the
 * old ones, and within one old vertex the order of its corners. */
static void split_vertices(struct work *w)
{
    struct mesh_source *mesh = w->mesh;
    size_t corners = mesh->triangle_count * 3, count = 0;
    struct corner_key *keys = must(mem_alloc_array(corners, sizeof *keys));
    uint32_t *same = must(mem_alloc_array(corners, sizeof *same));
    uint32_t *start = must(mem_calloc(mesh->vertex_count + 1, sizeof *start));
    uint32_t *number = must(mem_alloc_array(corners, sizeof *number));
    uint32_t *from;
    float *tangents;

    for (size_t c = 0; c < corners; c++)
        keys[c] = corner_key(w, c);
    vertices_weld(keys, sizeof *keys, corners, same);
    for (size_t c = 0; c < corners; c++)
        if (same[c] == c) {
            start[keys[c].vertex + 1]++;
            count++;
        }
    for (size_t v = 0; v < mesh->vertex_count; v++)
        start[v + 1] += start[v];
    from = must(mem_alloc_array(count, sizeof *from));
    tangents = must(mem_alloc_array(count, 4 * sizeof *tangents));
    for (size_t c = 0; c < corners; c++) {
        if (same[c] == c) {
            number[c] = start[keys[c].vertex]++;
            from[number[c]] = keys[c].vertex;
            memcpy(tangents + 4 * (size_t)number[c], keys[c].tangent, sizeof keys[c].tangent);
        }
        mesh->indices[c] = number[same[c]];
    }
    mesh_source_gather(mesh, from, count);
    mesh->tangents = tangents;
    mem_free(from);
    mem_free(number);
    mem_free(start);
    mem_free(same);
    mem_free(keys);
}

static void work_release(struct work *w)
{
    mem_free(w->keys);
    mem_free(w->weld);
    mem_free(w->direction);
    mem_free(w->hand);
    mem_free(w->any);
    mem_free(w->neighbor);
    mem_free(w->group_of);
    mem_free(w->groups);
    mem_free(w->group_at);
}

static void work_init(struct work *w)
{
    size_t vertices = w->mesh->vertex_count, triangles = w->mesh->triangle_count;

    w->keys = must(mem_calloc(vertices, sizeof *w->keys));
    w->weld = must(mem_alloc_array(vertices, sizeof *w->weld));
    w->group_at = must(mem_alloc_array(vertices, sizeof *w->group_at));
    w->direction = must(mem_calloc(triangles, sizeof *w->direction));
    w->hand = must(mem_calloc(triangles, sizeof *w->hand));
    w->any = must(mem_calloc(triangles, sizeof *w->any));
    w->neighbor = must(mem_alloc_array(triangles, 3 * sizeof *w->neighbor));
    w->group_of = must(mem_alloc_array(triangles, 3 * sizeof *w->group_of));
    for (size_t v = 0; v < vertices; v++)
        w->group_at[v] = NO_GROUP;
}

void tangents_generate(struct mesh_source *mesh, const struct mesh_tangents *wanted)
{
    struct work w = {.mesh = mesh};

    mem_free(mesh->tangents);
    mesh->tangents = NULL;
    if (!mesh->normals)
        unshare(mesh);
    work_init(&w);
    fill_keys(&w, wanted);
    vertices_weld(w.keys, sizeof *w.keys, mesh->vertex_count, w.weld);
    for (size_t t = 0; t < mesh->triangle_count; t++)
        read_triangle(&w, t);
    find_neighbors(&w);
    make_groups(&w);
    finish_groups(&w);
    split_vertices(&w);
    work_release(&w);
}
