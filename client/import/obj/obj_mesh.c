/* OBJ: parts become meshes. A mesh's vertices are the distinct (position, texture coordinate,
 * normal) of its corners. Without normals, smoothing groups decide what is smooth; a file without
 * either is smoothed where faces meet at less than OBJ_CREASE. */
#include <math.h>
#include <string.h>

#include "client/import/obj/obj.h"
#include "client/import/builder/polygon.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "common/math/vec.h"

/* Cosine of 40 degrees: flatter edges of a file without normals are smoothed. */
#define OBJ_CREASE 0.76604444f

/* ---- what can be drawn ---------------------------------------------------------------------- */

/* Of unit length, from one corner to another. */
static struct vec3 direction(const struct obj *o, size_t from, size_t to)
{
    const double *a = o->v + 3 * (size_t)o->corners[from].v, *b = o->v + 3 * (size_t)o->corners[to].v;

    return vec3_normalize(vec3_make((float)(b[0] - a[0]), (float)(b[1] - a[1]), (float)(b[2] - a[2])));
}

static int face_is_good(struct obj *o, const struct obj_face *face)
{
    for (uint32_t i = 0; i < face->count; i++) {
        struct obj_corner *corner = &o->corners[face->first + i];
        if (corner->v >= o->v_count) {
            builder_warn_at(o->b, o->name, face->line, "face index",
                            "a face names a vertex that does not exist (the file has %zu), or by no whole number: left out", o->v_count);
            return 0;
        }
        if (isnan(o->v[3 * (size_t)corner->v]))
            return 0; /* the vertex was warned of */
        if ((corner->t != OBJ_NONE && corner->t >= o->vt_count) || (corner->n != OBJ_NONE && corner->n >= o->vn_count))
            builder_warn_at(o->b, o->name, face->line, "attribute index",
                            "a face names a vt or vn that does not exist: drawn without it");
        if (corner->t >= o->vt_count)
            corner->t = OBJ_NONE;
        if (corner->n >= o->vn_count)
            corner->n = OBJ_NONE;
    }
    return 1;
}

static void drop_bad_faces(struct obj *o)
{
    size_t kept = 0;

    for (size_t f = 0; f < o->face_count; f++)
        if (face_is_good(o, &o->faces[f]))
            o->faces[kept++] = o->faces[f];
    o->face_count = kept;
}

/* ---- normals -------------------------------------------------------------------------------- */

/* Newell's, relative to the first corner and scaled down, so that nothing overflows. */
static struct vec3 newell(const struct obj *o, const struct obj_face *face)
{
    double normal[3] = {0, 0, 0}, most;

    for (uint32_t i = 1; i + 1 < face->count; i++) {
        const double *a = o->v + 3 * (size_t)o->corners[face->first].v;
        const double *b = o->v + 3 * (size_t)o->corners[face->first + i].v;
        const double *c = o->v + 3 * (size_t)o->corners[face->first + i + 1].v;
        double p[3], q[3];
        for (int k = 0; k < 3; k++) {
            p[k] = b[k] - a[k];
            q[k] = c[k] - a[k];
        }
        for (int k = 0; k < 3; k++)
            normal[k] += p[(k + 1) % 3] * q[(k + 2) % 3] - p[(k + 2) % 3] * q[(k + 1) % 3];
    }
    most = fmax(fabs(normal[0]), fmax(fabs(normal[1]), fabs(normal[2])));
    if (!(most > 0))
        return vec3_splat(0);
    return vec3_normalize(vec3_make((float)(normal[0] / most), (float)(normal[1] / most), (float)(normal[2] / most)));
}

/* Face normals, and which corners lie around each vertex. */
static void prepare_normals(struct obj *o)
{
    size_t wanted = 0;

    o->face_normals = must(mem_alloc_array(o->face_count, 3 * sizeof *o->face_normals));
    o->corner_face = must(mem_alloc_array(o->corner_count, sizeof *o->corner_face));
    o->around = must(mem_calloc(o->v_count + 2, sizeof *o->around));
    for (size_t f = 0; f < o->face_count; f++) {
        struct vec3 n = newell(o, &o->faces[f]);
        memcpy(o->face_normals + 3 * f, &n, sizeof n);
        for (uint32_t i = 0; i < o->faces[f].count; i++) {
            size_t corner = o->faces[f].first + i;
            o->corner_face[corner] = (uint32_t)f;
            o->around[(size_t)o->corners[corner].v + 2]++;
            wanted++;
        }
    }
    o->around_corners = must(mem_alloc_array(wanted, sizeof *o->around_corners));
    for (size_t v = 2; v < o->v_count + 2; v++)
        o->around[v] += o->around[v - 1];
    /* around[v + 1] starts at the beginning of v and moves to its end, which is the beginning of v
     * + 1. */
    for (size_t f = 0; f < o->face_count; f++)
        for (uint32_t i = 0; i < o->faces[f].count; i++) {
            size_t corner = o->faces[f].first + i;
            o->around_corners[o->around[(size_t)o->corners[corner].v + 1]++] = corner;
        }
}

static struct vec3 face_normal(const struct obj *o, uint32_t face)
{
    const float *n = o->face_normals + 3 * (size_t)face;

    return vec3_make(n[0], n[1], n[2]);
}

/* The angle of a face at one of its corners: the weight of its normal there. */
static float corner_angle(const struct obj *o, size_t corner)
{
    const struct obj_face *face = &o->faces[o->corner_face[corner]];
    size_t i = corner - face->first;
    struct vec3 next = direction(o, corner, face->first + (i + 1) % face->count);
    struct vec3 last = direction(o, corner, face->first + (i + face->count - 1) % face->count);

    return det_acos(vec3_dot(next, last));
}

/* The mean of the faces around the corner's vertex that are smooth with its face. */
static struct vec3 smooth_normal(const struct obj *o, size_t corner)
{
    uint32_t face = o->corner_face[corner];
    size_t v = o->corners[corner].v, begin = o->around[v], end = o->around[v + 1];
    struct vec3 own = face_normal(o, face), sum = vec3_splat(0);

    if (end - begin > OBJ_SMOOTH_VALENCE_MAX)
        return own;
    for (size_t i = begin; i < end; i++) {
        uint32_t other = o->corner_face[o->around_corners[i]];
        struct vec3 n = face_normal(o, other);
        int joined = o->says_smooth ? o->faces[other].smooth == o->faces[face].smooth : vec3_dot(own, n) > OBJ_CREASE;
        if (joined)
            sum = vec3_add(sum, vec3_scale(n, corner_angle(o, o->around_corners[i])));
    }
    sum = vec3_normalize(sum);
    return vec3_is_black(sum) ? own : sum;
}

static int is_smooth(const struct obj *o, const struct obj_face *face) { return !o->says_smooth || face->smooth; }

static struct vec3 corner_normal(const struct obj *o, size_t corner)
{
    uint32_t n = o->corners[corner].n;

    if (n != OBJ_NONE)
        return vec3_make(o->vn[3 * (size_t)n], o->vn[3 * (size_t)n + 1], o->vn[3 * (size_t)n + 2]);
    if (is_smooth(o, &o->faces[o->corner_face[corner]]))
        return smooth_normal(o, corner);
    return face_normal(o, o->corner_face[corner]);
}

/* ---- a mesh --------------------------------------------------------------------------------- */

/* The key of a vertex; compared byte by byte. */
struct vertex_key {
    uint32_t v, t;
    float normal[3];
};

/* The faces of one part: faces[order[first..end)]. */
struct part_faces {
    const uint32_t *order;
    size_t first, end;
    size_t corners, triangles;
    int has_normals, has_uv, has_colors;
};

static void survey(const struct obj *o, struct part_faces *part)
{
    for (size_t k = part->first; k < part->end; k++) {
        const struct obj_face *face = &o->faces[part->order[k]];
        part->corners += face->count;
        part->triangles += face->count - 2;
        part->has_normals |= is_smooth(o, face);
        for (uint32_t i = 0; i < face->count; i++) {
            const struct obj_corner *corner = &o->corners[face->first + i];
            part->has_normals |= corner->n != OBJ_NONE;
            part->has_uv |= corner->t != OBJ_NONE;
            for (size_t c = 0; o->colors && c < 3; c++)
                part->has_colors |= o->colors[4 * (size_t)corner->v + c] != 1;
        }
    }
}

/* Cut the faces; the indices are those of the part's corners, one after the other. */
static void cut_faces(struct obj *o, const struct part_faces *part, struct mesh_source *mesh, struct vertex_key *keys)
{
    struct polygon_scratch scratch = {0};
    uint32_t *polygon = NULL;
    float *outline = NULL;
    size_t polygon_capacity = 0, outline_capacity = 0, base = 0;

    for (size_t k = part->first; k < part->end; k++) {
        const struct obj_face *face = &o->faces[part->order[k]];
        uint32_t *indices = mesh->indices + 3 * mesh->triangle_count;
        MUST_GROW(polygon, polygon_capacity, face->count);
        MUST_GROW(outline, outline_capacity, 3 * (size_t)face->count);
        for (uint32_t i = 0; i < face->count; i++) {
            const struct obj_corner *corner = &o->corners[face->first + i];
            struct vec3 n = part->has_normals ? vec3_normalize(corner_normal(o, face->first + i)) : vec3_splat(0);
            polygon[i] = i;
            for (size_t c = 0; c < 3; c++) /* relative to the first corner: differences are what counts */
                outline[3 * i + c] =
                    (float)(o->v[3 * (size_t)corner->v + c] - o->v[3 * (size_t)o->corners[face->first].v + c]);
            keys[base + i] = (struct vertex_key){corner->v, corner->t, {n.x + 0.0f, n.y + 0.0f, n.z + 0.0f}};
        }
        polygon_triangulate(&scratch, outline, polygon, face->count, indices);
        for (size_t i = 0; i < 3 * (size_t)(face->count - 2); i++)
            indices[i] += (uint32_t)base;
        mesh->triangle_count += face->count - 2;
        base += face->count;
        if (scratch.fans) {
            scratch.fans = 0;
            builder_warn_at(o->b, o->name, face->line, "fan",
                            "a face crosses itself or is too large to be cut cleanly");
        }
    }
    mem_free(polygon);
    mem_free(outline);
    polygon_scratch_release(&scratch);
}

static void fill_vertex(const struct obj *o, const struct vertex_key *key, const struct mesh_origin *origin,
                        struct mesh_source *mesh)
{
    size_t at = mesh->vertex_count++;

    for (int c = 0; c < 3; c++)
        mesh->positions[3 * at + (size_t)c] = mesh_place(origin, o->v[3 * (size_t)key->v + (size_t)c], c);
    if (mesh->normals)
        memcpy(mesh->normals + 3 * at, key->normal, 3 * sizeof(float));
    if (mesh->colors)
        memcpy(mesh->colors + 4 * at, o->colors + 4 * (size_t)key->v, 4 * sizeof(float));
    if (mesh->uv[0]) {
        const float none[2] = {0, 0};
        const float *uv = key->t == OBJ_NONE ? none : o->vt + 2 * (size_t)key->t;
        mesh->uv[0][2 * at] = uv[0];
        mesh->uv[0][2 * at + 1] = 1 - uv[1]; /* OBJ counts v from the image's bottom */
    }
}

static void choose_origin(const struct obj *o, const struct part_faces *part, const struct vertex_key *keys,
                          struct mesh_origin *out)
{
    double *points = must(mem_alloc_array(part->corners, 3 * sizeof *points));

    for (size_t i = 0; i < part->corners; i++)
        memcpy(points + 3 * i, o->v + 3 * (size_t)keys[i].v, 3 * sizeof *points);
    mesh_origin_near(points, part->corners, o->origin, 1, out);
    mem_free(points);
}

static void weld_corners(struct obj *o, const struct part_faces *part, const struct vertex_key *keys,
                         struct mesh_source *mesh)
{
    uint32_t *weld = must(mem_alloc_array(part->corners, sizeof *weld));
    struct mesh_origin origin;
    size_t distinct = 0;

    choose_origin(o, part, keys, &origin);
    memcpy(mesh->origin, origin.at, sizeof mesh->origin);
    vertices_weld(keys, sizeof *keys, part->corners, weld);
    for (size_t i = 0; i < part->corners; i++)
        distinct += weld[i] == i;
    mesh->positions = must(mem_alloc_array(distinct, 3 * sizeof(float)));
    mesh->normals = part->has_normals ? must(mem_alloc_array(distinct, 3 * sizeof(float))) : NULL;
    mesh->uv[0] = part->has_uv ? must(mem_alloc_array(distinct, 2 * sizeof(float))) : NULL;
    mesh->colors = part->has_colors ? must(mem_alloc_array(distinct, 4 * sizeof(float))) : NULL;
    for (size_t i = 0; i < part->corners; i++)
        if (weld[i] == i) {
            weld[i] = (uint32_t)mesh->vertex_count;
            fill_vertex(o, &keys[i], &origin, mesh);
        } else {
            weld[i] = weld[weld[i]]; /* the first of them already has its number */
        }
    for (size_t i = 0; i < 3 * mesh->triangle_count; i++)
        mesh->indices[i] = weld[mesh->indices[i]];
    mem_free(weld);
}

static status make_source(struct obj *o, const struct part_faces *part, struct mesh_source *mesh)
{
    struct vertex_key *keys;

    if (part->triangles > SCENE_TRIANGLES_MAX || part->corners >= OBJ_BAD)
        return error_set(o->err, STATUS_ERR_LIMIT, "has %zu triangles in one group: at most %d", part->triangles,
                         SCENE_TRIANGLES_MAX);
    keys = must(mem_alloc_array(part->corners, sizeof *keys));
    mesh->indices = must(mem_alloc_array(part->triangles, 3 * sizeof *mesh->indices));
    cut_faces(o, part, mesh, keys);
    weld_corners(o, part, keys, mesh);
    mem_free(keys);
    return STATUS_OK;
}

static struct mesh_tangents tangents_of(const struct scene_material *m)
{
    struct mesh_tangents wanted = {.uv_transform = {{1, 0, 0}, {0, 1, 0}}};

    wanted.wanted = m->normal_texture.texture >= 0 || m->anisotropy > 0;
    if (m->normal_texture.texture >= 0)
        memcpy(wanted.uv_transform, m->normal_texture.uv_transform, sizeof wanted.uv_transform);
    return wanted;
}

static status make_part(struct obj *o, const struct obj_part *part, struct part_faces *faces)
{
    struct mesh_source mesh = {0};
    struct scene_instance instance;
    struct mesh_tangents tangents;
    double origin[3];
    const char *name = builder_name(o->b, o->words.texts[part->name]);
    uint32_t material;
    int64_t row = BUILDER_NO_ROW;
    status result;

    survey(o, faces);
    TRY(obj_material_row(o, part->material, part->line, faces->has_colors, &material));
    tangents = tangents_of(&o->b->materials[material]);
    result = make_source(o, faces, &mesh);
    memcpy(origin, mesh.origin, sizeof origin);
    THEN(result, mesh_finish(o->b, &mesh, name, &tangents, &row));
    mesh_source_release(&mesh);
    if (result != STATUS_OK || row == BUILDER_NO_ROW)
        return result;
    scene_instance_default(&instance);
    instance.name = name;
    instance.mesh = (uint32_t)row;
    instance.material = material;
    for (int c = 0; c < 3; c++)
        instance.to_world.m[c][3] = origin[c];
    return builder_add_instance(o->b, &instance);
}

status obj_make_meshes(struct obj *o)
{
    size_t *starts = must(mem_calloc(o->part_count + 2, sizeof *starts));
    uint32_t *order = NULL;
    status result = STATUS_OK;

    drop_bad_faces(o);
    order = must(mem_alloc_array(o->face_count, sizeof *order));
    if (result == STATUS_OK)
        prepare_normals(o);
    if (result == STATUS_OK) {
        for (size_t f = 0; f < o->face_count; f++)
            starts[o->faces[f].part + 2]++;
        for (size_t p = 2; p < o->part_count + 2; p++)
            starts[p] += starts[p - 1];
        for (size_t f = 0; f < o->face_count; f++)
            order[starts[o->faces[f].part + 1]++] = (uint32_t)f;
    }
    for (size_t p = 0; p < o->part_count && result == STATUS_OK; p++) {
        struct part_faces faces = {.order = order, .first = starts[p], .end = starts[p + 1]};
        if (faces.first < faces.end)
            result = make_part(o, &o->parts[p], &faces);
    }
    mem_free(order);
    mem_free(starts);
    return result;
}
