/* Loop subdivision over half-edges. Half-edge 3 t + i runs from corner i of triangle t to corner
 * i + 1; opposite[] names the one that runs back in the neighbour, LOOP_NONE at a boundary. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "client/import/builder/shapes.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"

#define LOOP_NONE UINT32_MAX

/* One level. `start` is a half-edge that leaves the vertex: at a boundary the one on it, so that
 * turning counter-clockwise from there meets all others. */
struct loop {
    size_t vertex_count, triangle_count;
    double *positions;  /* [3] */
    double *uv;         /* [2] or NULL */
    uint32_t *corners;  /* [3] a triangle: the vertex where each half-edge starts */
    uint32_t *opposite; /* [3] */
    uint32_t *start;    /* [vertex_count] */
};

static void loop_release(struct loop *loop)
{
    mem_free(loop->positions);
    mem_free(loop->uv);
    mem_free(loop->corners);
    mem_free(loop->opposite);
    mem_free(loop->start);
    memset(loop, 0, sizeof *loop);
}

static void loop_reserve(struct loop *loop, size_t vertices, size_t triangles, int uv)
{
    loop->positions = must(mem_alloc_array(vertices, 3 * sizeof *loop->positions));
    loop->uv = uv ? must(mem_alloc_array(vertices, 2 * sizeof *loop->uv)) : NULL;
    loop->corners = must(mem_alloc_array(triangles, 3 * sizeof *loop->corners));
    loop->opposite = must(mem_alloc_array(triangles, 3 * sizeof *loop->opposite));
    loop->start = must(mem_alloc_array(vertices, sizeof *loop->start));
    loop->vertex_count = vertices;
    loop->triangle_count = triangles;
}

static uint32_t next_half(uint32_t h) { return h % 3 == 2 ? h - 2 : h + 1; }

static uint32_t previous_half(uint32_t h) { return h % 3 == 0 ? h + 2 : h - 1; }

/* The next half-edge that leaves the same vertex, counter-clockwise; LOOP_NONE: the boundary. */
static uint32_t turn(const struct loop *loop, uint32_t h) { return loop->opposite[previous_half(h)]; }

/* ---- the control mesh ----------------------------------------------------------------------- */

struct half_key {
    uint64_t edge; /* lower corner << 32 | higher corner */
    uint32_t half;
    uint32_t forward; /* it runs from the lower corner to the higher */
};

static int compare_half_keys(const void *a, const void *b)
{
    const struct half_key *x = a, *y = b;

    if (x->edge != y->edge)
        return x->edge < y->edge ? -1 : 1;
    return x->half < y->half ? -1 : x->half > y->half;
}

/* Join the half-edges of every edge that has exactly two, running against each other. */
static void find_opposites(struct loop *loop)
{
    size_t count = 3 * loop->triangle_count;
    struct half_key *keys = must(mem_alloc_array(count, sizeof *keys));

    for (uint32_t h = 0; h < count; h++) {
        uint64_t from = loop->corners[h], to = loop->corners[next_half(h)];
        keys[h] = (struct half_key){
            .edge = from < to ? from << 32 | to : to << 32 | from, .half = h, .forward = from < to};
        loop->opposite[h] = LOOP_NONE;
    }
    qsort(keys, count, sizeof *keys, compare_half_keys);
    for (size_t i = 0, j; i < count; i = j) {
        for (j = i + 1; j < count && keys[j].edge == keys[i].edge;)
            j++;
        if (j - i == 2 && keys[i].forward != keys[i + 1].forward) {
            loop->opposite[keys[i].half] = keys[i + 1].half;
            loop->opposite[keys[i + 1].half] = keys[i].half;
        }
    }
    mem_free(keys);
}

/* Give every fan of triangles its own vertex: `from[new]` is the control vertex. Afterwards the
 * triangles around a vertex are one fan, or one ring. */
static size_t part_vertices(struct loop *loop, uint32_t *from)
{
    size_t halves = 3 * loop->triangle_count, vertices = 0;
    uint32_t *fan = must(mem_alloc_array(halves, sizeof *fan)); /* the new vertex of a half-edge */

    memset(fan, 0xff, halves * sizeof *fan);
    for (uint32_t h = 0; h < halves; h++) {
        uint32_t first = h, at;
        if (fan[h] != LOOP_NONE)
            continue;
        /* Clockwise to the boundary, if there is one. */
        while (loop->opposite[first] != LOOP_NONE && next_half(loop->opposite[first]) != h)
            first = next_half(loop->opposite[first]);
        if (loop->opposite[first] != LOOP_NONE)
            first = h;
        at = first;
        do {
            fan[at] = (uint32_t)vertices;
            at = turn(loop, at);
        } while (at != LOOP_NONE && at != first);
        from[vertices] = loop->corners[h];
        loop->start[vertices++] = first;
    }
    memcpy(loop->corners, fan, halves * sizeof *fan);
    mem_free(fan);
    return vertices;
}

/* The control mesh as a loop, without triangles that repeat a corner. */
static void loop_init(struct loop *loop, const struct shape_control *control)
{
    size_t kept = 0;
    uint32_t *from;

    /* At most one vertex for each corner, once the fans are split. */
    loop_reserve(loop, 3 * control->triangle_count, control->triangle_count, control->uv != NULL);
    for (size_t t = 0; t < control->triangle_count; t++) {
        const uint32_t *c = control->indices + 3 * t;
        if (c[0] != c[1] && c[1] != c[2] && c[2] != c[0])
            memcpy(loop->corners + 3 * kept++, c, 3 * sizeof *c);
    }
    loop->triangle_count = kept;
    find_opposites(loop);
    from = must(mem_alloc_array(3 * kept, sizeof *from));
    loop->vertex_count = part_vertices(loop, from);
    for (size_t v = 0; v < loop->vertex_count; v++) {
        for (size_t c = 0; c < 3; c++)
            loop->positions[3 * v + c] = (double)control->positions[3 * (size_t)from[v] + c];
        for (size_t c = 0; loop->uv && c < 2; c++)
            loop->uv[2 * v + c] = (double)control->uv[2 * (size_t)from[v] + c];
    }
    mem_free(from);
}

/* ---- masks ---------------------------------------------------------------------------------- */

static int is_boundary(const struct loop *loop, size_t vertex)
{
    return loop->opposite[loop->start[vertex]] == LOOP_NONE;
}

/* The neighbours of a vertex, counter-clockwise, at a boundary from end to end. */
struct ring {
    uint32_t *vertices;
    size_t count, capacity;
    int boundary;
};

static void ring_fill(struct ring *ring, const struct loop *loop, size_t vertex)
{
    uint32_t first = loop->start[vertex], h = first;

    ring->count = 0;
    ring->boundary = is_boundary(loop, vertex);
    for (;;) {
        uint32_t turned = turn(loop, h);
        MUST_GROW(ring->vertices, ring->capacity, ring->count + 2);
        ring->vertices[ring->count++] = loop->corners[next_half(h)];
        if (turned == LOOP_NONE)
            ring->vertices[ring->count++] = loop->corners[previous_half(h)];
        if (turned == LOOP_NONE || turned == first)
            return;
        h = turned;
    }
}

/* (1 - n w) p + w (sum of the neighbours); at a boundary of the two on it. */
static void ring_mean(const struct ring *ring, const struct loop *loop, size_t vertex, double inner_weight,
                      double boundary_weight, double out[3])
{
    for (size_t c = 0; c < 3; c++) {
        double p = loop->positions[3 * vertex + c], sum = 0;
        if (ring->boundary) {
            sum = loop->positions[3 * (size_t)ring->vertices[0] + c] +
                  loop->positions[3 * (size_t)ring->vertices[ring->count - 1] + c];
            out[c] = (1 - 2 * boundary_weight) * p + boundary_weight * sum;
            continue;
        }
        for (size_t i = 0; i < ring->count; i++)
            sum += loop->positions[3 * (size_t)ring->vertices[i] + c];
        out[c] = (1 - (double)ring->count * inner_weight) * p + inner_weight * sum;
    }
}

/* Warren's weight of a neighbour of a vertex with n. */
static double loop_beta(size_t n) { return n == 3 ? 3.0 / 16 : 3.0 / (8 * (double)n); }

/* Weights of neighbour i of n in the two limit tangents: the normal is along x cross y. At a boundary x leads to its
 * first neighbour and y inwards (Hoppe et al. 1994). With the weight of the vertex itself each adds up to 0. */
static void tangent_weights(size_t i, size_t n, int boundary, double *x, double *y)
{
    float sine, cosine;
    double theta;

    if (!boundary) {
        det_sincos((float)(2 * PI_D * (double)i / (double)n), &sine, &cosine);
        *x = (double)cosine;
        *y = (double)sine;
        return;
    }
    *x = i == 0 ? 1 : i == n - 1 ? -1 : 0;
    theta = PI_D / (double)(n - 1);
    det_sincos((float)theta, &sine, &cosine);
    if (n == 2)
        *y = 1;
    else if (n == 3)
        *y = i == 1;
    else if (n == 4)
        *y = i == 0 || i == 3 ? -1 : 2;
    else if (i == 0 || i == n - 1)
        *y = -(double)sine;
    else
        *y = (2 - 2 * (double)cosine) * (double)det_sin((float)((double)i * theta));
}

static void limit_normal(const struct ring *ring, const struct loop *loop, size_t vertex, double out[3])
{
    const double *p = loop->positions + 3 * vertex;
    double tangent[2][3] = {{0}}, length;

    for (size_t i = 0; i < ring->count; i++) {
        double w[2];
        tangent_weights(i, ring->count, ring->boundary, &w[0], &w[1]);
        for (size_t c = 0; c < 3; c++) {
            /* Relative to p, which accounts for the weight of the vertex itself. */
            double q = loop->positions[3 * (size_t)ring->vertices[i] + c] - p[c];
            tangent[0][c] += w[0] * q;
            tangent[1][c] += w[1] * q;
        }
    }
    for (size_t c = 0; c < 3; c++)
        out[c] = tangent[0][(c + 1) % 3] * tangent[1][(c + 2) % 3] - tangent[0][(c + 2) % 3] * tangent[1][(c + 1) % 3];
    length = sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2]);
    for (size_t c = 0; c < 3; c++)
        out[c] = length > 0 && length < INFINITY ? out[c] / length : 0;
}

/* ---- one level ------------------------------------------------------------------------------ */

/* Number the edges: `edge_of` each half-edge. */
static size_t number_edges(const struct loop *loop, uint32_t *edge_of)
{
    size_t edges = 0;

    for (uint32_t h = 0; h < 3 * loop->triangle_count; h++)
        edge_of[h] = loop->opposite[h] < h ? edge_of[loop->opposite[h]] : (uint32_t)edges++;
    return edges;
}

/* The new vertex in the middle of half-edge h. */
static void add_middle(const struct loop *loop, uint32_t h, struct loop *out, size_t vertex)
{
    size_t a = loop->corners[h], b = loop->corners[next_half(h)];
    uint32_t back = loop->opposite[h];

    for (size_t c = 0; c < 3; c++) {
        double ends = loop->positions[3 * a + c] + loop->positions[3 * b + c], sides;
        if (back == LOOP_NONE) {
            out->positions[3 * vertex + c] = 0.5 * ends;
            continue;
        }
        sides = loop->positions[3 * (size_t)loop->corners[previous_half(h)] + c] +
                loop->positions[3 * (size_t)loop->corners[previous_half(back)] + c];
        out->positions[3 * vertex + c] = 0.375 * ends + 0.125 * sides;
    }
    for (size_t c = 0; loop->uv && c < 2; c++)
        out->uv[2 * vertex + c] = 0.5 * (loop->uv[2 * a + c] + loop->uv[2 * b + c]);
}

/* Triangle t becomes 4 t + i at each corner i, (corner, middle of i, middle of i - 1), and
 * 4 t + 3 in between, (middles of 0, 1, 2). */
static void split_triangles(const struct loop *loop, const uint32_t *edge_of, struct loop *out)
{
    for (uint32_t t = 0; t < loop->triangle_count; t++)
        for (uint32_t i = 0; i < 3; i++) {
            uint32_t h = 3 * t + i, child = 3 * (4 * t + i), centre = 3 * (4 * t + 3);
            uint32_t before = (i + 2) % 3;
            uint32_t ahead = loop->opposite[h], behind = loop->opposite[3 * t + before];
            uint32_t middle = (uint32_t)loop->vertex_count + edge_of[h];
            out->corners[child] = loop->corners[h];
            out->corners[child + 1] = middle;
            out->corners[child + 2] = (uint32_t)loop->vertex_count + edge_of[3 * t + before];
            out->corners[centre + i] = middle;
            /* The first half of h lies against the second half of its opposite, and so on. */
            out->opposite[child] = ahead == LOOP_NONE ? LOOP_NONE : 3 * (4 * (ahead / 3) + next_half(ahead) % 3) + 2;
            out->opposite[child + 2] = behind == LOOP_NONE ? LOOP_NONE : 3 * (4 * (behind / 3) + behind % 3);
            out->opposite[child + 1] = centre + before;
            out->opposite[centre + before] = child + 1;
        }
}

/* The start half-edge of each vertex: for old ones the child of their old start, for new boundary
 * ones the one on the boundary. */
static void find_starts(const struct loop *loop, const uint32_t *edge_of, struct loop *out)
{
    for (size_t v = 0; v < loop->vertex_count; v++)
        out->start[v] = 3 * (4 * (loop->start[v] / 3) + loop->start[v] % 3);
    for (uint32_t h = 0; h < 3 * loop->triangle_count; h++)
        if (loop->opposite[h] == LOOP_NONE || loop->opposite[h] > h)
            /* The second half of h, which is the third edge of the child at its end. */
            out->start[loop->vertex_count + edge_of[h]] = 3 * (4 * (h / 3) + next_half(h) % 3) + 2;
}

static void subdivide(const struct loop *loop, struct loop *out, struct ring *ring)
{
    size_t halves = 3 * loop->triangle_count, edges;
    uint32_t *edge_of = must(mem_alloc_array(halves, sizeof *edge_of));

    edges = number_edges(loop, edge_of);
    loop_reserve(out, loop->vertex_count + edges, 4 * loop->triangle_count, loop->uv != NULL);
    for (size_t v = 0; v < loop->vertex_count; v++) {
        ring_fill(ring, loop, v);
        ring_mean(ring, loop, v, loop_beta(ring->count), 1.0 / 8, out->positions + 3 * v);
    }
    if (loop->uv)
        memcpy(out->uv, loop->uv, loop->vertex_count * 2 * sizeof *loop->uv);
    for (uint32_t h = 0; h < halves; h++)
        if (loop->opposite[h] == LOOP_NONE || loop->opposite[h] > h)
            add_middle(loop, h, out, loop->vertex_count + edge_of[h]);
    split_triangles(loop, edge_of, out);
    find_starts(loop, edge_of, out);
    mem_free(edge_of);
}

/* Every vertex at its limit, with its limit normal. */
static void write_limit(const struct loop *loop, struct ring *ring, struct mesh_source *out)
{
    out->positions = must(mem_alloc_array(loop->vertex_count, 3 * sizeof *out->positions));
    out->normals = must(mem_alloc_array(loop->vertex_count, 3 * sizeof *out->normals));
    out->uv[0] = loop->uv ? must(mem_alloc_array(loop->vertex_count, 2 * sizeof *out->uv[0])) : NULL;
    out->indices = must(mem_memdup(loop->corners, loop->triangle_count * 3 * sizeof *loop->corners));
    out->vertex_count = loop->vertex_count;
    out->triangle_count = loop->triangle_count;
    for (size_t v = 0; v < loop->vertex_count; v++) {
        double limit[3], normal[3], n;
        ring_fill(ring, loop, v);
        n = (double)ring->count;
        ring_mean(ring, loop, v, 1 / (n + 3 / (8 * loop_beta(ring->count))), 1.0 / 6, limit);
        limit_normal(ring, loop, v, normal);
        for (size_t c = 0; c < 3; c++) {
            out->positions[3 * v + c] = (float)limit[c] + 0.0f;
            out->normals[3 * v + c] = (float)normal[c] + 0.0f;
        }
        for (size_t c = 0; out->uv[0] && c < 2; c++)
            out->uv[0][2 * v + c] = (float)loop->uv[2 * v + c];
    }
}

/* ---- the whole ------------------------------------------------------------------------------ */

static status check_control(const struct shape_control *control, uint32_t levels, struct error *err)
{
    if (levels > SHAPE_LOOP_LEVELS_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%u levels of subdivision: at most %d are made", levels,
                         SHAPE_LOOP_LEVELS_MAX);
    if (control->triangle_count > ((size_t)SHAPE_TRIANGLES_MAX >> (2 * levels)))
        return error_set(err, STATUS_ERR_LIMIT, "%zu triangles subdivided %u times: more than %d triangles",
                         control->triangle_count, levels, SHAPE_TRIANGLES_MAX);
    for (size_t i = 0; i < 3 * control->triangle_count; i++)
        if (control->indices[i] >= control->vertex_count)
            return error_set(err, STATUS_ERR_INPUT, "index %zu is %u, but there are %zu vertices", i,
                             control->indices[i], control->vertex_count);
    for (size_t i = 0; i < 3 * control->vertex_count; i++)
        if (!(fabsf(control->positions[i]) <= SCENE_COORDINATE_MAX))
            return error_set(err, STATUS_ERR_INPUT, "coordinate %zu is %g: only finite numbers up to 1e15 are taken", i,
                             (double)control->positions[i]);
    for (size_t i = 0; control->uv && i < 2 * control->vertex_count; i++)
        if (!isfinite(control->uv[i]))
            return error_set(err, STATUS_ERR_INPUT, "texture coordinate %zu is not finite", i);
    return STATUS_OK;
}

status shape_loop(const struct shape_control *control, uint32_t levels, struct mesh_source *out, struct error *err)
{
    struct loop loop = {0}, finer = {0};
    struct ring ring = {0};

    memset(out, 0, sizeof *out);
    TRY(check_control(control, levels, err));
    loop_init(&loop, control);
    for (uint32_t level = 0; level < levels; level++) {
        subdivide(&loop, &finer, &ring);
        loop_release(&loop);
        loop = finer;
        memset(&finer, 0, sizeof finer);
    }
    write_limit(&loop, &ring, out);
    mem_free(ring.vertices);
    loop_release(&loop);
    return STATUS_OK;
}
