#include "client/import/builder/bodies.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/import/builder/mesh.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"

enum {
    /* Volumes with more triangles than this are not analysed: the tables would take gigabytes. */
    BODIES_TRIANGLES_MAX = 1 << 24,
};

/* An edge with its ends in ascending order, and how often it is used in that direction minus the other. */
struct edge {
    uint64_t key; /* lower end << 32 | higher end: never 0 */
    int32_t net;
    uint32_t part; /* one of those that it belongs to */
};

/* An instance that bounds a volume. */
struct part {
    uint32_t instance;
    const float *positions; /* of its mesh */
    const uint32_t *indices;
    size_t first_vertex; /* of its own in the tables below */
    uint32_t parent;     /* union of parts of one material that share edges */
    uint32_t joined;     /* union of parts of several materials that share open edges */
    uint32_t open_edges; /* of a set, at its root in `parent` */
    int open;            /* of a set, at its root in `joined`: open although joined */
    int met;
    uint32_t body; /* likewise: its lowest material, once one was found */
    int moves;     /* of a set, at its root in `joined`: one of its parts does, */
    double volume; /* and six times the volume of the set */
    float gap[3];  /* on one of the open edges */
};

struct bodies {
    struct builder *b;
    const struct scene *scene;
    struct part *parts;
    uint32_t part_count;
    size_t vertex_count, triangle_count;
    float *positions;  /* [vertex_count][3] in the world */
    uint32_t *weld;    /* [vertex_count] the lowest vertex at the same place */
    struct edge *open; /* edges that one material leaves open */
    size_t open_count, open_capacity;
};

/* The material whose volume a surface of this material bounds; for a mix its first part that bounds one; NULL: none. */
static const struct scene_material *filling_of(const struct scene *scene, uint32_t row)
{
    const struct scene_material *m = &scene->materials[row];

    if (m->kind == MATERIAL_MIX) {
        const struct scene_material *first = filling_of(scene, m->mix_material[0]);
        return first ? first : filling_of(scene, m->mix_material[1]);
    }
    return m->kind == MATERIAL_INTERFACE ||
                   (m->kind == MATERIAL_SURFACE && !m->unlit && m->refractive && m->transmission > 0)
               ? m
               : NULL;
}

static uint32_t find_root(struct part *parts, uint32_t part)
{
    while (parts[part].parent != part) {
        parts[part].parent = parts[parts[part].parent].parent;
        part = parts[part].parent;
    }
    return part;
}

static uint32_t find_joined(struct part *parts, uint32_t part)
{
    part = find_root(parts, part);
    while (parts[part].joined != part)
        part = find_root(parts, parts[part].joined);
    return part;
}

static uint32_t material_of(const struct bodies *s, uint32_t part)
{
    return s->scene->instances[s->parts[part].instance].material;
}

static int compare_parts(const void *a, const void *b, void *user)
{
    const struct part *x = a, *y = b;
    const struct scene *scene = user;
    uint32_t mx = scene->instances[x->instance].material;
    uint32_t my = scene->instances[y->instance].material;

    return mx != my ? (mx < my ? -1 : 1) : x->instance < y->instance ? -1 : 1;
}

/* The instances that bound volumes, sorted by material. */
static status find_parts(struct bodies *s)
{
    const struct scene *scene = s->scene;

    s->parts = must(mem_calloc(scene->instance_count, sizeof *s->parts));
    for (uint32_t i = 0; i < scene->instance_count; i++)
        if (filling_of(scene, scene->instances[i].material))
            s->parts[s->part_count++].instance = i;
    qsort_r(s->parts, s->part_count, sizeof *s->parts, compare_parts, (void *)(uintptr_t)scene);
    for (uint32_t i = 0; i < s->part_count; i++) {
        struct part *part = &s->parts[i];
        const struct scene_mesh *mesh = &scene->meshes[scene->instances[part->instance].mesh];
        const struct import_blob *blob = builder_blob(s->b, &mesh->blob);
        struct scene_mesh_layout layout;

        if (!blob)
            return error_set(s->b->err, STATUS_ERR_INTERNAL, "a mesh's blob is missing");
        scene_mesh_layout(mesh, &layout);
        part->positions = (const void *)(blob->data + layout.positions);
        part->indices = (const void *)(blob->data + layout.indices);
        part->first_vertex = s->vertex_count;
        part->parent = part->joined = i;
        s->vertex_count += mesh->vertex_count;
        s->triangle_count += mesh->triangle_count;
    }
    return STATUS_OK;
}

/* Where the vertices are in the world. A skin moves all its meshes from one space. */
static void place_vertices(struct bodies *s)
{
    const struct transform_d identity = transform_d_identity();

    s->positions = must(mem_alloc_array(s->vertex_count, 3 * sizeof *s->positions));
    s->weld = must(mem_alloc_array(s->vertex_count, sizeof *s->weld));
    for (uint32_t i = 0; i < s->part_count; i++) {
        const struct part *part = &s->parts[i];
        const struct scene_instance *instance = &s->scene->instances[part->instance];
        float *out = s->positions + 3 * part->first_vertex;
        size_t floats = 3 * (size_t)s->scene->meshes[instance->mesh].vertex_count;

        transform_points(instance->skin >= 0 ? &identity : &instance->to_world, part->positions, floats / 3, out);
        for (size_t k = 0; k < floats; k++)
            out[k] += 0.0f; /* -0 is 0 */
    }
    vertices_weld(s->positions, 3 * sizeof(float), s->vertex_count, s->weld);
}

static struct edge *edge_find(struct edge *table, size_t size, uint64_t key)
{
    size_t at = (size_t)((key ^ key >> 29) * 0xff51afd7ed558ccdu >> 20) & (size - 1);

    while (table[at].key && table[at].key != key)
        at = (at + 1) & (size - 1);
    return &table[at];
}

/* Is the mesh's winding reversed in the world? */
static int is_mirrored(const struct scene_instance *instance)
{
    return instance->skin < 0 && transform_d_determinant(&instance->to_world) < 0;
}

static void count_edges(struct bodies *s, uint32_t index, struct edge *table, size_t size)
{
    const struct part *part = &s->parts[index];
    const struct scene_instance *instance = &s->scene->instances[part->instance];
    const uint32_t *weld = s->weld + part->first_vertex;
    size_t corners = 3 * (size_t)s->scene->meshes[instance->mesh].triangle_count;
    int way = is_mirrored(instance) ? -1 : 1;

    for (size_t k = 0; k < corners; k++) {
        uint32_t from = weld[part->indices[k]];
        uint32_t to = weld[part->indices[k % 3 == 2 ? k - 2 : k + 1]];
        uint64_t key = from < to ? (uint64_t)from << 32 | to : (uint64_t)to << 32 | from;
        struct edge *edge;

        if (from == to)
            continue;
        edge = edge_find(table, size, key);
        if (edge->key)
            s->parts[find_root(s->parts, index)].parent = find_root(s->parts, edge->part);
        edge->key = key;
        edge->net += from < to ? way : -way;
        edge->part = index;
    }
}

/* Find the open edges of the parts from `first` to `end`, all of one material. */
static void find_open_edges(struct bodies *s, uint32_t first, uint32_t end)
{
    size_t triangles = 0, size = 16;
    struct edge *table;

    for (uint32_t i = first; i < end; i++)
        triangles += s->scene->meshes[s->scene->instances[s->parts[i].instance].mesh].triangle_count;
    while (size < 6 * triangles) /* 3 edges a triangle at most, half of the table free */
        size *= 2;
    table = must(mem_calloc(size, sizeof *table));
    for (uint32_t i = first; i < end; i++)
        count_edges(s, i, table, size);
    for (size_t i = 0; i < size; i++) {
        if (!table[i].net)
            continue;
        MUST_GROW(s->open, s->open_capacity, s->open_count + 1);
        s->open[s->open_count++] = table[i];
    }
    mem_free(table);
}

static int compare_edges(const void *a, const void *b)
{
    const struct edge *x = a, *y = b;

    if (x->key != y->key)
        return x->key < y->key ? -1 : 1;
    return x->part < y->part ? -1 : 1;
}

static int fills_alike(const struct scene_material *a, const struct scene_material *b)
{
    return a->ior == b->ior && a->priority == b->priority && a->medium == b->medium && a->dispersion == b->dispersion &&
           a->attenuation_distance == b->attenuation_distance &&
           memcmp(a->attenuation_color, b->attenuation_color, sizeof a->attenuation_color) == 0;
}

static int edges_alike(const struct bodies *s, const struct edge *a, const struct edge *b)
{
    return fills_alike(filling_of(s->scene, material_of(s, a->part)), filling_of(s->scene, material_of(s, b->part)));
}

static int may_join(const struct bodies *s, const struct edge *a, const struct edge *b)
{
    return (a->net < 0) != (b->net < 0) &&
           s->scene->materials[material_of(s, a->part)].kind == s->scene->materials[material_of(s, b->part)].kind;
}

/* Join the parts that leave one edge open: those that are filled alike, and only what these leave
 * open (`rest`) with others. Where water touches its glass along an edge, and both are of several
 * materials, the water's parts belong to one another. */
static void join_at_edge(struct bodies *s, const struct edge *edges, size_t count, int32_t *rest)
{
    for (size_t i = 0; i < count; i++) {
        rest[i] = 0;
        for (size_t k = 0; k < count; k++)
            rest[i] += edges_alike(s, &edges[i], &edges[k]) ? edges[k].net : 0;
    }
    for (size_t i = 0; i < count; i++)
        for (size_t k = 0; k < i; k++)
            if (may_join(s, &edges[i], &edges[k]) && (edges_alike(s, &edges[i], &edges[k]) || (rest[i] && rest[k])))
                s->parts[find_joined(s->parts, edges[k].part)].joined = find_joined(s->parts, edges[i].part);
}

/* Join what shares open edges, and see what stays open all the same. */
static void join_parts(struct bodies *s)
{
    size_t end;
    int32_t *rest;

    if (s->open_count == 0)
        return;
    rest = must(mem_alloc_array(s->open_count, sizeof *rest));
    qsort(s->open, s->open_count, sizeof *s->open, compare_edges);
    for (size_t i = 0; i < s->open_count; i = end) {
        for (end = i + 1; end < s->open_count && s->open[end].key == s->open[i].key;)
            end++;
        join_at_edge(s, s->open + i, end - i, rest);
    }
    mem_free(rest);
    for (size_t i = 0; i < s->open_count; i = end) {
        int32_t net = 0;

        for (end = i; end < s->open_count && s->open[end].key == s->open[i].key; end++)
            net += s->open[end].net;
        for (size_t k = i; k < end; k++) {
            struct part *set = &s->parts[find_root(s->parts, s->open[k].part)];
            if (net)
                s->parts[find_joined(s->parts, s->open[k].part)].open = 1;
            if (!set->open_edges++)
                memcpy(set->gap, s->positions + 3 * (s->open[k].key >> 32), sizeof set->gap);
        }
    }
}

/* The lowest material fills a volume that several close together. */
static void give_bodies(struct bodies *s)
{
    struct scene *scene = &s->b->out->scene;

    for (uint32_t i = 0; i < s->part_count; i++) {
        struct part *set = &s->parts[find_joined(s->parts, i)];
        uint32_t own = material_of(s, i), body;

        if (!set->met) { /* parts are in the order of their materials */
            set->met = 1;
            set->body = own;
        }
        body = set->body;
        if (set->open || body == own)
            continue;
        scene->instances[s->parts[i].instance].body = (int32_t)body;
        if (!fills_alike(filling_of(scene, body), filling_of(scene, own)))
            builder_warn(s->b, "volume of two materials",
                         "meshes of the materials '%.80s' and '%.80s' close one volume together, "
                         "but fill it differently: the first one fills all of it",
                         scene->materials[body].name, scene->materials[own].name);
    }
}

/* Six times the volume that the part's triangles cut out, seen from `origin`. */
static double volume_of(const struct bodies *s, const struct part *part, const float *origin)
{
    const struct scene_instance *instance = &s->scene->instances[part->instance];
    const float *positions = s->positions + 3 * part->first_vertex;
    size_t corners = 3 * (size_t)s->scene->meshes[instance->mesh].triangle_count;
    double sum = 0;

    for (size_t t = 0; t < corners; t += 3) {
        double p[3][3];
        for (size_t k = 0; k < 3; k++)
            for (size_t a = 0; a < 3; a++)
                p[k][a] = (double)positions[3 * (size_t)part->indices[t + k] + a] - (double)origin[a];
        sum += p[0][0] * (p[1][1] * p[2][2] - p[1][2] * p[2][1]) + p[0][1] * (p[1][2] * p[2][0] - p[1][0] * p[2][2]) +
               p[0][2] * (p[1][0] * p[2][1] - p[1][1] * p[2][0]);
    }
    return is_mirrored(instance) ? -sum : sum;
}

/* Report volumes that several meshes close together: none of the meshes is closed by itself. */
static void seal(struct bodies *s)
{
    struct scene *scene = &s->b->out->scene;

    for (uint32_t i = 0; i < s->part_count; i++) {
        struct part *set = &s->parts[find_joined(s->parts, i)];
        const struct scene_instance *instance = &scene->instances[s->parts[i].instance];
        set->moves |= instance->node >= 0 || instance->skin >= 0;
        set->volume += volume_of(s, &s->parts[i], s->positions + 3 * set->first_vertex);
    }
    for (uint32_t i = 0; i < s->part_count; i++) {
        const struct part *set = &s->parts[find_joined(s->parts, i)];
        scene->instances[s->parts[i].instance].sealed = !set->open && !set->moves && set->volume > 0;
    }
}

/* Report the faults of the parts from `first` to `end`, all of one material. */
static void report(struct bodies *s, uint32_t first, uint32_t end)
{
    const struct scene *scene = s->scene;
    const char *material = scene->materials[material_of(s, first)].name;
    uint32_t open = 0, example = 0;
    char place[320], kind[340];
    double volume = 0;

    snprintf(place, sizeof place, "material '%s'", material);
    for (uint32_t i = first; i < end; i++) {
        uint32_t root = find_root(s->parts, i);
        if (s->parts[find_joined(s->parts, i)].open && s->parts[root].open_edges) {
            example = open++ ? example : i;
            continue;
        }
        volume += volume_of(s, &s->parts[i], s->positions + 3 * s->parts[first].first_vertex);
    }
    if (open) {
        const struct part *part = &s->parts[example];
        const struct part *set = &s->parts[find_root(s->parts, example)];
        snprintf(kind, sizeof kind, "open %s", place);
        builder_warn_at(s->b, place, 0, kind,
                        "its volume is not closed: '%.80s' has %u open edges, one at %g %g %g%s. "
                        "A ray through the gap continues as if it had not left or entered the volume: it gets "
                        "the wrong colour and refraction. Close the mesh, or make the material a thin wall",
                        scene->instances[part->instance].name, set->open_edges, (double)set->gap[0],
                        (double)set->gap[1], (double)set->gap[2], open > 1 ? ", and other meshes have some too" : "");
    }
    if (volume < 0) {
        snprintf(kind, sizeof kind, "inverted %s", place);
        builder_warn_at(s->b, place, 0, kind,
                        "'%.80s' is wound inwards: its volume shows as a bubble of air in the "
                        "material. Reverse its triangles",
                        scene->instances[s->parts[first].instance].name);
    }
}

static uint32_t group_end(const struct bodies *s, uint32_t first)
{
    uint32_t end = first;

    while (end < s->part_count && material_of(s, end) == material_of(s, first))
        end++;
    return end;
}

static status find_bodies(struct bodies *s)
{
    uint32_t end;

    TRY(find_parts(s));
    if (s->part_count == 0)
        return STATUS_OK;
    if (s->triangle_count > BODIES_TRIANGLES_MAX || s->vertex_count > UINT32_MAX) {
        builder_warn(s->b, "volumes not checked",
                     "refractive volumes and media have %zu triangles: above %d, gaps are not "
                     "searched for, and each material's surfaces count as closed",
                     s->triangle_count, BODIES_TRIANGLES_MAX);
        return STATUS_OK;
    }
    place_vertices(s);
    for (uint32_t i = 0; i < s->part_count; i = end) {
        end = group_end(s, i);
        find_open_edges(s, i, end);
    }
    join_parts(s);
    give_bodies(s);
    seal(s);
    for (uint32_t i = 0; i < s->part_count; i = end) {
        end = group_end(s, i);
        report(s, i, end);
    }
    return STATUS_OK;
}

status bodies_find(struct builder *b)
{
    struct bodies s = {.b = b, .scene = &b->out->scene};
    status result = STATUS_OK;

    if (b->out->scene.volume_rule == VOLUMES_NESTED)
        result = find_bodies(&s);
    mem_free(s.open);
    mem_free(s.weld);
    mem_free(s.positions);
    mem_free(s.parts);
    return result;
}
