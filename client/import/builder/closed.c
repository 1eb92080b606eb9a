#include <string.h>

#include "client/import/builder/mesh.h"
#include "common/base/memory.h"

enum {
    /* Larger meshes count as open: the tables below would take gigabytes, only to save the renderer
     * a sign test. */
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

status vertices_weld(const void *keys, size_t key_bytes, size_t count, uint32_t *out,
                     struct error *err)
{
    const uint8_t *rows = keys;
    size_t size = table_size(count);
    uint32_t *table = mem_calloc(size, sizeof *table); /* vertex + 1, 0 is free */

    if (!table)
        return error_no_memory(err, "welding vertices");
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
    return STATUS_OK;
}

/* A directed edge and the triangle on its left. */
struct edge {
    uint64_t key; /* from << 32 | to; from != to, so 0 is free */
    uint32_t triangle;
};

static struct edge *edge_find(struct edge *table, size_t size, uint64_t key)
{
    size_t at = (size_t)((key ^ key >> 29) * 0xff51afd7ed558ccdu >> 20) & (size - 1);

    while (table[at].key && table[at].key != key)
        at = (at + 1) & (size - 1);
    return &table[at];
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
static int edges_match(const struct mesh_source *mesh, const uint32_t *weld, struct edge *table,
                       size_t size, uint32_t *parent)
{
    for (size_t t = 0; t < mesh->triangle_count; t++)
        for (int i = 0; i < 3; i++) {
            uint64_t from = weld[mesh->indices[3 * t + (size_t)i]];
            uint64_t to = weld[mesh->indices[3 * t + (size_t)((i + 1) % 3)]];
            struct edge *edge = edge_find(table, size, from << 32 | to);
            if (from == to || edge->key)
                return 0;
            edge->key = from << 32 | to;
            edge->triangle = (uint32_t)t;
        }
    for (size_t t = 0; t < mesh->triangle_count; t++)
        for (int i = 0; i < 3; i++) {
            uint64_t from = weld[mesh->indices[3 * t + (size_t)i]];
            uint64_t to = weld[mesh->indices[3 * t + (size_t)((i + 1) % 3)]];
            const struct edge *opposite = edge_find(table, size, to << 32 | from);
            if (!opposite->key)
                return 0;
            parent[part_of(parent, (uint32_t)t)] = part_of(parent, opposite->triangle);
        }
    return 1;
}

/* Six times the signed volume of each connected part; all must be positive: a part wound
 * inwards shows its back faces to the outside. */
static int volumes_positive(const struct mesh_source *mesh, uint32_t *parent, double *volume)
{
    const float *origin = mesh->positions; /* a point near the mesh: less cancellation */

    for (size_t t = 0; t < mesh->triangle_count; t++) {
        double p[3][3];
        for (int i = 0; i < 3; i++)
            for (int c = 0; c < 3; c++)
                p[i][c] = (double)mesh->positions[3 * (size_t)mesh->indices[3 * t + (size_t)i] +
                                                  (size_t)c] -
                          (double)origin[c];
        volume[part_of(parent, (uint32_t)t)] += p[0][0] * (p[1][1] * p[2][2] - p[1][2] * p[2][1]) +
                                                p[0][1] * (p[1][2] * p[2][0] - p[1][0] * p[2][2]) +
                                                p[0][2] * (p[1][0] * p[2][1] - p[1][1] * p[2][0]);
    }
    for (size_t t = 0; t < mesh->triangle_count; t++)
        if (part_of(parent, (uint32_t)t) == t && !(volume[t] > 0))
            return 0;
    return 1;
}

status mesh_is_closed(const struct mesh_source *mesh, int *closed, struct error *err)
{
    size_t triangles = mesh->triangle_count;
    size_t size = table_size(triangles * 3);
    uint32_t *weld = NULL, *parent = NULL;
    struct edge *table = NULL;
    double *volume = NULL;
    status result = STATUS_OK;

    *closed = 0;
    /* A closed surface has 3T/2 edges: T is even, and 4 at least. */
    if (triangles < 4 || triangles % 2 != 0 || triangles > CLOSED_TRIANGLES_MAX)
        return STATUS_OK;
    weld = mem_alloc_array(mesh->vertex_count, sizeof *weld);
    parent = mem_alloc_array(triangles, sizeof *parent);
    table = mem_calloc(size, sizeof *table);
    volume = mem_calloc(triangles, sizeof *volume);
    if (!weld || !parent || !table || !volume) {
        result = error_no_memory(err, "looking for open edges");
        goto done;
    }
    result = vertices_weld(mesh->positions, 3 * sizeof(float), mesh->vertex_count, weld, err);
    if (result != STATUS_OK)
        goto done;
    for (size_t t = 0; t < triangles; t++)
        parent[t] = (uint32_t)t;
    *closed = edges_match(mesh, weld, table, size, parent) &&
              volumes_positive(mesh, parent, volume);
done:
    mem_free(volume);
    mem_free(table);
    mem_free(parent);
    mem_free(weld);
    return result;
}
