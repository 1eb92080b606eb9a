#include <string.h>

#include "client/import/builder/mesh.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"

enum {
    /* Larger meshes count as open: the tables below would take gigabytes, only to save the renderer a sign test. */
    CLOSED_TRIANGLES_MAX = 1 << 25,
};

static uint64_t hash_bytes(const uint8_t *bytes, size_t size)
{
    uint64_t h = 0x9e3779b97f4a7c15u;

    for (size_t i = 0; i < size; i += 4) {
        uint32_t word;
        memcpy(&word, bytes + i, 4);
        h = (h ^ word) * 0xff51afd7ed558ccdu;
        h ^= h >> 32;
    }
    return h;
}

/* The least power of two that leaves half of a hash table free. */
static size_t table_size(size_t entries)
{
    size_t size = 16;

    while (size < entries * 2)
        size *= 2;
    return size;
}

void vertices_weld(const void *keys, size_t key_bytes, size_t count, uint32_t *out)
{
    const uint8_t *rows = keys;
    size_t size = table_size(count);
    uint32_t *table = must(mem_calloc(size, sizeof *table)); /* vertex + 1, 0 is free */

    for (size_t v = 0; v < count; v++) {
        const uint8_t *key = rows + v * key_bytes;
        size_t at = (size_t)hash_bytes(key, key_bytes) & (size - 1);
        while (table[at] && memcmp(rows + (size_t)(table[at] - 1) * key_bytes, key, key_bytes) != 0)
            at = (at + 1) & (size - 1);
        if (!table[at])
            table[at] = (uint32_t)v + 1;
        out[v] = table[at] - 1;
    }
    mem_free(table);
}

/* Do the edges of one direction and those of the other cancel? If not, the surface is open; this is
 * known without any table. If so, it is probably closed. */
static int edges_cancel(const struct mesh_source *mesh)
{
    uint64_t *hash = must(mem_alloc_array(mesh->vertex_count, sizeof *hash)), sum = 0;

    for (size_t v = 0; v < mesh->vertex_count; v++)
        hash[v] = hash_bytes((const uint8_t *)(mesh->positions + 3 * v), 3 * sizeof(float));
    for (size_t t = 0; t < mesh->triangle_count; t++)
        for (int i = 0; i < 3; i++) {
            uint64_t from = hash[mesh->indices[3 * t + (size_t)i]];
            uint64_t to = hash[mesh->indices[3 * t + (size_t)((i + 1) % 3)]];
            uint64_t there = (from + 3 * to) * 0xff51afd7ed558ccdu, back = (to + 3 * from) * 0xff51afd7ed558ccdu;
            sum += (there ^ there >> 32) - (back ^ back >> 32);
        }
    mem_free(hash);
    return sum == 0;
}

/* A directed edge is the number of its corner, 3 t + i; the table has it + 1, 0 is free. */
struct edges {
    const struct mesh_source *mesh;
    const uint32_t *weld;
    uint32_t *table;
    size_t size;
};

static uint64_t edge_key(const struct edges *e, size_t edge)
{
    const uint32_t *corner = e->mesh->indices + edge / 3 * 3;

    return (uint64_t)e->weld[corner[edge % 3]] << 32 | e->weld[corner[(edge + 1) % 3]];
}

static uint32_t *edge_find(const struct edges *e, uint64_t key)
{
    size_t at = (size_t)((key ^ key >> 29) * 0xff51afd7ed558ccdu >> 20) & (e->size - 1);

    while (e->table[at] && edge_key(e, e->table[at] - 1) != key)
        at = (at + 1) & (e->size - 1);
    return &e->table[at];
}

static uint32_t part_of(uint32_t *parent, uint32_t triangle)
{
    while (parent[triangle] != triangle) {
        parent[triangle] = parent[parent[triangle]];
        triangle = parent[triangle];
    }
    return triangle;
}

/* Does every directed edge occur once and have its opposite? Joins neighbours in `parent`. */
static int edges_match(const struct edges *e, uint32_t *parent)
{
    const size_t count = 3 * e->mesh->triangle_count;

    for (size_t edge = 0; edge < count; edge++) {
        uint64_t key = edge_key(e, edge);
        uint32_t *slot = edge_find(e, key);
        if (key >> 32 == (uint32_t)key || *slot)
            return 0;
        *slot = (uint32_t)edge + 1;
    }
    for (size_t edge = 0; edge < count; edge++) {
        uint64_t key = edge_key(e, edge);
        uint32_t opposite = *edge_find(e, key << 32 | key >> 32);
        if (!opposite)
            return 0;
        parent[part_of(parent, (uint32_t)(edge / 3))] = part_of(parent, (opposite - 1) / 3);
    }
    return 1;
}

/* The sign that the volumes of all connected parts have, 0: not the same. A part wound inwards shows its back faces to the
 * outside. volume[] becomes six times that of each part. */
static int sign_of_volumes(const struct mesh_source *mesh, uint32_t *parent, double *volume)
{
    const float *origin = mesh->positions; /* a point near the mesh: less cancellation */
    size_t out = 0, in = 0, parts = 0;

    for (size_t t = 0; t < mesh->triangle_count; t++) {
        double p[3][3];
        for (int i = 0; i < 3; i++)
            for (int c = 0; c < 3; c++)
                p[i][c] = (double)mesh->positions[3 * (size_t)mesh->indices[3 * t + (size_t)i] + (size_t)c] -
                          (double)origin[c];
        volume[part_of(parent, (uint32_t)t)] += p[0][0] * (p[1][1] * p[2][2] - p[1][2] * p[2][1]) +
                                                p[0][1] * (p[1][2] * p[2][0] - p[1][0] * p[2][2]) +
                                                p[0][2] * (p[1][0] * p[2][1] - p[1][1] * p[2][0]);
    }
    for (size_t t = 0; t < mesh->triangle_count; t++)
        if (part_of(parent, (uint32_t)t) == t) {
            out += volume[t] > 0;
            in += volume[t] < 0;
            parts++;
        }
    return out == parts ? 1 : in == parts ? -1 : 0;
}

int mesh_is_closed(const struct mesh_source *mesh)
{
    size_t triangles = mesh->triangle_count;
    struct edges edges = {.mesh = mesh, .size = table_size(triangles * 3)};
    uint32_t *weld = NULL, *parent = NULL;
    double *volume = NULL;
    int closed;

    /* A closed surface has 3T/2 edges: T is even, and 4 at least. */
    if (triangles < 4 || triangles % 2 != 0 || triangles > CLOSED_TRIANGLES_MAX)
        return 0;
    if (!edges_cancel(mesh))
        return 0;
    weld = must(mem_alloc_array(mesh->vertex_count, sizeof *weld));
    parent = must(mem_alloc_array(triangles, sizeof *parent));
    edges.table = must(mem_calloc(edges.size, sizeof *edges.table));
    volume = must(mem_calloc(triangles, sizeof *volume));
    vertices_weld(mesh->positions, 3 * sizeof(float), mesh->vertex_count, weld);
    for (size_t t = 0; t < triangles; t++)
        parent[t] = (uint32_t)t;
    edges.weld = weld;
    closed = edges_match(&edges, parent) ? sign_of_volumes(mesh, parent, volume) : 0;
    mem_free(volume);
    mem_free(edges.table);
    mem_free(parent);
    mem_free(weld);
    return closed;
}
