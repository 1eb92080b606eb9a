#include "worker/render/scene/render_place.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/base/safeguard.h"

/* A shared mesh is still copied into the top BVH if its copies hold at most this many triangles in
 * all: one BVH is faster than two levels. */
#define BAKE_TRIANGLES_MAX 65536
/* A matrix interpolated half way between two must keep this share of their volume. Otherwise it is
 * no rotation but a collapse, and the vertices are given instead. */
#define VOLUME_SHARE_MIN 0.1
/* A mesh is also baked if its matrix's determinant is beyond this or its inverse. */
#define VOLUME_MIN 1e-30
/* A shared mesh is also baked if rounding its matrix would move it by more than this share of its size. */
#define DIGITS_SHARE_MAX 1e-4
/* Embree wants 16 readable bytes after the last vertex. */
#define PADDING_FLOATS 4

static const struct transform identity = {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
static const struct transform_d identity_d = {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};

struct placer {
    struct render_scene *w;
    const struct render_poses *poses;
    const struct scene *scene;
    uint32_t index; /* the current instance, and what it is made of: */
    const struct scene_instance *description;
    const struct scene_mesh *mesh;
    const struct render_mesh *vertices;
    struct render_instance *instance;
    struct transform_d exact;              /* its transform at the first pose */
    struct transform at[RENDER_STEPS_MAX]; /* [poses->count] rounded */
    struct error *err;
};

int render_scene_own(struct render_scene *w, void *block)
{
    if (block && !MEM_GROW(w->owned, w->owned_capacity, w->owned_count + 1)) {
        mem_free(block);
        return 0;
    }
    if (block)
        w->owned[w->owned_count++] = block;
    return block != NULL;
}

static status no_memory(const struct placer *p) { return error_no_memory(p->err, "the instances"); }

static float32 *new_vertices(const struct placer *p, uint32_t components)
{
    size_t count = p->vertices->vertex_count;
    float32 *out = mem_calloc(components * count + PADDING_FLOATS, sizeof *out);

    return render_scene_own(p->w, out) ? out : NULL;
}

/* The mesh's vertices in world space, each coordinate rounded once. */
static float32 *bake(const struct placer *p, const struct transform_d *to_world)
{
    float32 *out = new_vertices(p, 3);

    if (out)
        transform_points(to_world, p->vertices->positions, p->vertices->vertex_count, out);
    return out;
}

/* Embree inverts matrices in float. */
static int fits_floats(double volume) { return fabs(volume) > VOLUME_MIN && fabs(volume) < 1 / VOLUME_MIN; }

static void set_transform(struct render_instance *instance, const struct transform *to_world, int *flat)
{
    struct transform_d forward = transform_to_d(to_world), inverse;
    double volume = transform_d_determinant(&forward);

    *flat = !transform_d_invert(&forward, &inverse) || !fits_floats(volume);
    instance->to_world = *to_world;
    instance->to_object = transform_from_d(&inverse);
    instance->flipped = volume < 0;
}

/* ---- what stands still -------------------------------------------------------------------- */

/* Does Embree's float matrix blur the mesh? It does if the mesh is far from its own origin and the
 * matrix moves it back. */
static int loses_digits(const struct placer *p)
{
    double size = 0, reach = 0;

    for (int r = 0; r < 3; r++) {
        double extent = 0, sum = fabs(p->exact.m[r][3]);
        for (int c = 0; c < 3; c++) {
            double low = (double)p->mesh->bounds_min[c], high = (double)p->mesh->bounds_max[c];
            extent += fabs(p->exact.m[r][c]) * (high - low);
            sum += fabs(p->exact.m[r][c]) * fmax(fabs(low), fabs(high));
        }
        size = fmax(size, extent);
        reach = fmax(reach, sum);
    }
    return 16 * 0x1p-24 * reach > DIGITS_SHARE_MAX * size;
}

static status place_still(struct placer *p, uint32_t uses)
{
    struct render_instance *instance = p->instance;
    int flat;

    set_transform(instance, &p->at[0], &flat);
    if (memcmp(&p->exact, &identity_d, sizeof identity_d) == 0) {
        instance->instance_positions = p->vertices->positions;
    } else if (flat || uses == 1 || loses_digits(p) ||
               (uint64_t)uses * p->mesh->triangle_count <= BAKE_TRIANGLES_MAX) {
        instance->instance_positions = bake(p, &p->exact);
        if (!instance->instance_positions)
            return no_memory(p);
        p->w->info.mesh_bytes += 3 * sizeof(float32) * (size_t)p->mesh->vertex_count;
    }
    return STATUS_OK;
}

/* ---- what moves --------------------------------------------------------------------------- */

static struct vec3 box_corner(const struct scene_mesh *mesh, unsigned k)
{
    return vec3_make(k & 1 ? mesh->bounds_max[0] : mesh->bounds_min[0],
                     k & 2 ? mesh->bounds_max[1] : mesh->bounds_min[1],
                     k & 4 ? mesh->bounds_max[2] : mesh->bounds_min[2]);
}

static int in_bounds(const float32 *values, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (!(real_abs(values[i]) <= SCENE_COORDINATE_MAX))
            return 0;
    return 1;
}

static status out_of_bounds(const struct placer *p)
{
    return error_set(p->err, STATUS_ERR_INPUT,
                     "instance '%s': in frame %u its animation takes it out of all bounds; mend the "
                     "animation",
                     p->description->name, p->w->frame);
}

static real diagonal(const real low[3], const real high[3])
{
    return vec3_length(vec3_make(high[0] - low[0], high[1] - low[1], high[2] - low[2]));
}

static void grow_box(real low[3], real high[3], const float32 *points, size_t count)
{
    for (size_t i = 0; i < count; i++)
        for (size_t a = 0; a < 3; a++) {
            low[a] = real_min(points[3 * i + a], low[a]);
            high[a] = real_max(points[3 * i + a], high[a]);
        }
}

/* Can the matrix be inverted at the steps and between them? */
static int stays_solid(const struct transform *steps, uint32_t count)
{
    for (uint32_t k = 0; k + 1 < count; k++) {
        struct transform_d a = transform_to_d(&steps[k]), b = transform_to_d(&steps[k + 1]), mid;
        double da = transform_d_determinant(&a), db = transform_d_determinant(&b), dm;
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 4; c++)
                mid.m[r][c] = 0.5 * (a.m[r][c] + b.m[r][c]);
        dm = transform_d_determinant(&mid);
        if (!fits_floats(da) || !fits_floats(db) || !(dm / da > VOLUME_SHARE_MIN) || !(dm / db > VOLUME_SHARE_MIN))
            return 0;
    }
    return 1;
}

/* The steps of the matrix that the frame needs, into the arena of `w`. */
static status choose_matrices(struct placer *p)
{
    float32 corners[RENDER_STEPS_MAX][24];
    real low[3], high[3];
    const float32 *track[RENDER_STEPS_MAX];
    struct transform *steps;
    uint32_t stride, count;

    for (uint32_t k = 0; k < RENDER_STEPS_MAX; k++) {
        for (unsigned c = 0; c < 8; c++) {
            struct vec3 v = transform_point(&p->at[k], box_corner(p->mesh, c));
            corners[k][3 * c] = (float32)v.x;
            corners[k][3 * c + 1] = (float32)v.y;
            corners[k][3 * c + 2] = (float32)v.z;
        }
        if (!in_bounds(corners[k], 24))
            return out_of_bounds(p);
        track[k] = corners[k];
    }
    for (int a = 0; a < 3; a++) {
        low[a] = INFINITY;
        high[a] = -INFINITY;
    }
    grow_box(low, high, corners[0], 8);
    stride = motion_stride(track, 8, diagonal(low, high));
    count = (RENDER_STEPS_MAX - 1) / stride + 1;
    steps = mem_alloc_array(count, sizeof *steps);
    if (!render_scene_own(p->w, steps))
        return no_memory(p);
    for (uint32_t k = 0; k < count; k++)
        steps[k] = p->at[k * stride];
    p->instance->motion_steps = count;
    p->instance->motion_to_world = steps;
    return STATUS_OK;
}

/* Compute the vertices at each of the instance's steps: `positions` has `count` arrays, 1 if nothing moves. */
static status keep_positions(struct placer *p, const float32 *const *positions, uint32_t count)
{
    struct render_instance *instance = p->instance;
    size_t vertices = p->vertices->vertex_count;
    const float32 **kept = mem_alloc_array(count, sizeof *kept);

    if (!render_scene_own(p->w, (void *)kept))
        return no_memory(p);
    instance->bounded = 1;
    for (int a = 0; a < 3; a++) {
        instance->bounds_min[a] = INFINITY;
        instance->bounds_max[a] = -INFINITY;
    }
    for (uint32_t k = 0; k < count; k++) {
        kept[k] = positions[k];
        if (!in_bounds(kept[k], 3 * vertices))
            return out_of_bounds(p);
        grow_box(instance->bounds_min, instance->bounds_max, kept[k], vertices);
        p->w->info.mesh_bytes += 3 * sizeof(float32) * vertices;
    }
    instance->instance_positions = kept[0];
    if (count > 1)
        instance->motion_positions = kept;
    return STATUS_OK;
}

static status place_moving(struct placer *p)
{
    struct render_instance *instance = p->instance;
    const float32 *positions[RENDER_STEPS_MAX] = {NULL};
    status s = choose_matrices(p);
    uint32_t count = instance->motion_steps;
    int flat;

    if (s != STATUS_OK)
        return s;
    set_transform(instance, &p->at[0], &flat);
    if (stays_solid(instance->motion_to_world, count))
        return STATUS_OK;
    for (uint32_t k = 0; k < count; k++) {
        struct transform_d step = transform_to_d(&instance->motion_to_world[k]);
        positions[k] = bake(p, &step);
        if (!positions[k])
            return no_memory(p);
    }
    return keep_positions(p, positions, count);
}

/* ---- deformed meshes ---------------------------------------------------------------------- */

/* Does what deforms the instance differ between two poses? */
static int deforms_between(const struct placer *p, const struct scene_pose *a, const struct scene_pose *b)
{
    const struct scene *scene = p->scene;
    int32_t node = p->description->node, skin = p->description->skin;

    if (node >= 0) {
        size_t weights = scene->nodes[node].weight_count;
        if (memcmp(&a->to_world[node], &b->to_world[node], sizeof *a->to_world) != 0)
            return 1;
        if (weights && a->weights[node] && memcmp(a->weights[node], b->weights[node], weights * sizeof(double)) != 0)
            return 1;
    }
    if (skin >= 0)
        for (uint32_t j = 0; j < scene->skins[skin].joint_count; j++) {
            uint32_t joint = scene->skins[skin].joints[j];
            if (memcmp(&a->to_world[joint], &b->to_world[joint], sizeof *a->to_world) != 0)
                return 1;
        }
    return 0;
}

/* Do most joints mirror their part of the mesh? */
static int skin_flips(const struct placer *p)
{
    const struct scene_skin *skin = &p->scene->skins[p->description->skin];
    uint32_t mirrored = 0;

    for (uint32_t j = 0; j < skin->joint_count; j++) {
        struct transform_d bind = transform_stored_to_d(&skin->inverse_bind[j]);
        double joint = transform_d_determinant(&p->poses->at[0].to_world[skin->joints[j]]);
        mirrored += joint * transform_d_determinant(&bind) < 0;
    }
    return mirrored > skin->joint_count / 2;
}

/* Allocate a moment's normals and tangents, if the mesh has them. */
static status new_vectors(const struct placer *p, float32 **normals, float32 **tangents)
{
    *normals = *tangents = NULL;
    if (p->vertices->normals && !(*normals = new_vertices(p, 3)))
        return no_memory(p);
    if (p->vertices->tangents && !(*tangents = new_vertices(p, 4)))
        return no_memory(p);
    return STATUS_OK;
}

/* The deformed vertices at moment `k`, in world space; at the first, also normals and tangents. */
static status deform_at(struct placer *p, uint32_t k, float32 **positions)
{
    struct render_instance *instance = p->instance;
    const struct render_mesh *mesh = p->vertices;
    float32 *normals = NULL, *tangents = NULL;
    status s;

    *positions = mem_calloc(3 * (size_t)mesh->vertex_count + PADDING_FLOATS, sizeof **positions);
    if (!*positions)
        return no_memory(p);
    if (k == 0) {
        TRY(new_vectors(p, &normals, &tangents));
        instance->deformed_normals = normals;
        instance->deformed_tangents = tangents;
    }
    s = pose_deform(&p->poses->at[k], p->scene, p->index, mesh->blob, *positions, normals, tangents, p->err);
    if (s == STATUS_OK && !instance->skinned) {
        struct transform_d to_world = transform_to_d(&p->at[k]);
        transform_points(&to_world, *positions, mesh->vertex_count, *positions);
    }
    return s;
}

/* The normals and tangents at each step; those of the first are known. */
static status deform_vectors(struct placer *p, uint32_t stride)
{
    struct render_instance *instance = p->instance;
    uint32_t count = instance->motion_steps;
    const float32 **normals, **tangents;
    status s = STATUS_OK;

    if (!instance->deformed_normals && !instance->deformed_tangents)
        return STATUS_OK;
    normals = mem_calloc(count, sizeof *normals);
    if (!render_scene_own(p->w, (void *)normals))
        return no_memory(p);
    tangents = mem_calloc(count, sizeof *tangents);
    if (!render_scene_own(p->w, (void *)tangents))
        return no_memory(p);
    normals[0] = instance->deformed_normals;
    tangents[0] = instance->deformed_tangents;
    for (uint32_t k = 1; k < count && s == STATUS_OK; k++) {
        float32 *n, *t;
        s = new_vectors(p, &n, &t);
        if (s == STATUS_OK)
            s = pose_deform(&p->poses->at[k * stride], p->scene, p->index, p->vertices->blob, NULL, n, t, p->err);
        normals[k] = n;
        tangents[k] = t;
    }
    instance->motion_normals = instance->deformed_normals ? normals : NULL;
    instance->motion_tangents = instance->deformed_tangents ? tangents : NULL;
    return s;
}

/* Choose which moments to keep. */
static uint32_t choose_moments(struct placer *p, float32 *const positions[RENDER_STEPS_MAX])
{
    const float32 *track[RENDER_STEPS_MAX];
    real low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    struct render_instance *instance = p->instance;
    uint32_t stride;

    for (int k = 0; k < RENDER_STEPS_MAX; k++)
        track[k] = positions[k];
    grow_box(low, high, track[0], p->vertices->vertex_count);
    stride = motion_stride(track, p->vertices->vertex_count, diagonal(low, high));
    instance->motion_steps = (RENDER_STEPS_MAX - 1) / stride + 1;
    return stride;
}

static status keep_matrices(struct placer *p, uint32_t stride)
{
    struct transform *steps = mem_alloc_array(p->instance->motion_steps, sizeof *steps);

    if (!render_scene_own(p->w, steps))
        return no_memory(p);
    for (uint32_t k = 0; k < p->instance->motion_steps; k++)
        steps[k] = p->at[k * stride];
    p->instance->motion_to_world = steps;
    return STATUS_OK;
}

static status place_deformed(struct placer *p)
{
    struct render_instance *instance = p->instance;
    float32 *positions[RENDER_STEPS_MAX] = {NULL};
    const float32 *kept[RENDER_STEPS_MAX] = {NULL};
    uint32_t moments = 1, stride = 1, used = 1;
    status s = STATUS_OK;
    int flat;

    instance->skinned = p->description->skin >= 0 && (p->mesh->arrays & MESH_SKIN);
    if (instance->skinned) {
        set_transform(instance, &identity, &flat);
        instance->flipped = skin_flips(p);
    } else {
        set_transform(instance, &p->at[0], &flat);
    }
    for (uint32_t k = 1; k < p->poses->count && moments == 1; k++)
        if (deforms_between(p, &p->poses->at[0], &p->poses->at[k]))
            moments = RENDER_STEPS_MAX;
    for (uint32_t k = 0; k < moments && s == STATUS_OK; k++) {
        s = deform_at(p, k, &positions[k]);
        if (s == STATUS_OK && !in_bounds(positions[k], 3 * (size_t)p->vertices->vertex_count))
            s = out_of_bounds(p);
    }
    if (s == STATUS_OK && moments > 1) {
        stride = choose_moments(p, positions);
        used = instance->motion_steps;
        s = deform_vectors(p, stride);
        if (s == STATUS_OK && !instance->skinned)
            s = keep_matrices(p, stride);
    }
    for (uint32_t k = 0; k < used && s == STATUS_OK; k++) {
        kept[k] = positions[k * stride];
        positions[k * stride] = NULL;
        if (!render_scene_own(p->w, (void *)kept[k]))
            s = no_memory(p);
    }
    if (s == STATUS_OK)
        s = keep_positions(p, kept, used);
    for (uint32_t k = 0; k < RENDER_STEPS_MAX; k++)
        mem_free(positions[k]);
    return s;
}

/* ---- all ---------------------------------------------------------------------------------- */

enum placement { PLACE_STILL, PLACE_MOVING, PLACE_DEFORMED };

/* Make instance `index` the current one. */
static enum placement look_at(struct placer *p, uint32_t index)
{
    int moves = 0;

    p->index = index;
    p->description = &p->scene->instances[index];
    p->mesh = &p->scene->meshes[p->description->mesh];
    p->vertices = &p->w->meshes[p->description->mesh];
    p->instance = &p->w->instances[index];
    for (uint32_t k = 0; k < p->poses->count; k++) {
        struct transform_d exact = pose_instance(&p->poses->at[k], p->scene, index);
        if (k == 0)
            p->exact = exact;
        p->at[k] = transform_from_d(&exact);
        moves |= memcmp(&p->at[k], &p->at[0], sizeof *p->at) != 0;
    }
    if (scene_instance_deforms(p->scene, index))
        return PLACE_DEFORMED;
    return moves ? PLACE_MOVING : PLACE_STILL;
}

/* The material whose body the instance bounds; its own if the settings leave that one out. */
static uint32_t body_of(const struct render_scene *w, const struct scene_instance *description)
{
    uint32_t body = description->body < 0 ? description->material : (uint32_t)description->body;
    const struct render_material *filling = &w->materials[w->materials[body].filling];

    return filling->flags & MATERIAL_BOUNDS && SAFEGUARD(BODY_OF_MESHES) ? body : description->material;
}

static uint32_t alpha_key(const struct scene_instance *description)
{
    uint32_t bits[12], key = description->material;

    memcpy(bits, description->to_world.m, sizeof bits);
    for (int i = 0; i < 12; i++) {
        key = (key ^ bits[i]) * 0x9e3779b1u;
        key ^= key >> 15;
    }
    return key;
}

static status place_one(struct placer *p, uint32_t index, const uint32_t *uses)
{
    enum placement placement = look_at(p, index);

    p->instance->mesh = p->description->mesh;
    p->instance->material = p->description->material;
    p->instance->body = body_of(p->w, p->description);
    p->w->info.triangles += p->mesh->triangle_count;
    if (placement == PLACE_DEFORMED)
        return place_deformed(p);
    return placement == PLACE_MOVING ? place_moving(p) : place_still(p, uses[p->instance->mesh]);
}

status render_scene_place(struct render_scene *w, const struct render_poses *poses, struct error *err)
{
    struct placer p = {.w = w, .poses = poses, .scene = poses->scene, .err = err};
    uint32_t *uses = mem_calloc(p.scene->mesh_count, sizeof *uses);
    status s = STATUS_OK;

    w->instances = mem_calloc(p.scene->instance_count, sizeof *w->instances);
    if (!uses || !w->instances) {
        s = no_memory(&p);
        goto done;
    }
    w->instance_count = p.scene->instance_count;
    for (uint32_t i = 0; i < w->instance_count; i++)
        if (look_at(&p, i) == PLACE_STILL)
            uses[p.scene->instances[i].mesh]++;
    for (uint32_t i = 0; i < w->instance_count && s == STATUS_OK; i++)
        s = place_one(&p, i, uses);
    w->info.instances = w->instance_count;
done:
    mem_free(uses);
    return s;
}

void place_keys(struct render_scene *w, const struct scene *scene)
{
    for (uint32_t i = 0; i < w->instance_count; i++)
        w->instances[i].alpha_key = alpha_key(&scene->instances[i]);
}

int place_moves(const struct render_scene *w)
{
    for (uint32_t i = 0; i < w->instance_count; i++)
        if (w->instances[i].motion_steps)
            return 1;
    return 0;
}

size_t place_hull(const struct render_scene *w, const struct scene *scene, uint32_t index, struct vec3 *out)
{
    const struct render_instance *instance = &w->instances[index];
    const struct scene_mesh *mesh = &scene->meshes[instance->mesh];
    uint32_t steps = instance->motion_steps ? instance->motion_steps : 1;
    size_t count = 0;

    if (instance->bounded) {
        for (unsigned k = 0; k < 8; k++)
            out[count++] = vec3_make((k & 1 ? instance->bounds_max : instance->bounds_min)[0],
                                     (k & 2 ? instance->bounds_max : instance->bounds_min)[1],
                                     (k & 4 ? instance->bounds_max : instance->bounds_min)[2]);
        return count;
    }
    for (uint32_t s = 0; s < steps; s++)
        for (unsigned k = 0; k < 8; k++)
            out[count++] = transform_point(instance->motion_steps ? &instance->motion_to_world[s] : &instance->to_world,
                                           box_corner(mesh, k));
    return count;
}
