#include "common/scene/pose.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/base/safeguard.h"
#include "common/math/elementary.h"
#include "common/scene/effects.h"
#include "common/scene/track.h"

/* ---- channels --------------------------------------------------------------------------- */

/* The keys around a time: the value is that of `key` for u = 0 and of key + 1 for u = 1. Clamped:
 * the last key has u = 0. */
struct moment {
    uint32_t key;
    double u;
    double span_s; /* from key to key + 1 */
};

static struct moment moment_find(const struct scene_channel *c, double time_s)
{
    struct moment m = {0, 0, 0};
    uint32_t low = 0, high = c->key_count - 1;

    /* Keys are floats: what changes at a frame's own time must have changed in that frame. */
    if (c->interpolation == INTERPOLATE_STEP)
        time_s = (double)(float)time_s;
    if (!(time_s > (double)c->times[0]))
        return m;
    if (time_s >= (double)c->times[high]) {
        m.key = high;
        return m;
    }
    while (high - low > 1) { /* times[low] <= time_s < times[high] */
        uint32_t middle = low + (high - low) / 2;
        if ((double)c->times[middle] <= time_s)
            low = middle;
        else
            high = middle;
    }
    m.key = low;
    if (c->interpolation != INTERPOLATE_STEP) {
        m.span_s = (double)c->times[high] - (double)c->times[low];
        m.u = (time_s - (double)c->times[low]) / m.span_s;
    }
    return m;
}

enum part { IN_TANGENT, VALUE, OUT_TANGENT };

static double key_number(const struct scene_channel *c, uint32_t key, enum part part, uint32_t i)
{
    size_t at = key;

    if (c->interpolation == INTERPOLATE_CUBIC)
        at = at * 3 + (size_t)part;
    return (double)c->values[at * c->components + i];
}

/* glTF 2.0, appendix C.4 (linear) and C.5 (cubic Hermite). */
static double channel_number(const struct scene_channel *c, struct moment m, uint32_t i)
{
    double a = key_number(c, m.key, VALUE, i), b;
    double u = m.u, u2 = u * u, u3 = u2 * u;

    if (u == 0)
        return a;
    b = key_number(c, m.key + 1, VALUE, i);
    if (c->interpolation == INTERPOLATE_LINEAR)
        return (1 - u) * a + u * b;
    return (2 * u3 - 3 * u2 + 1) * a + m.span_s * (u3 - 2 * u2 + u) * key_number(c, m.key, OUT_TANGENT, i) +
           (3 * u2 - 2 * u3) * b + m.span_s * (u3 - u2) * key_number(c, m.key + 1, IN_TANGENT, i);
}

double scene_channel_number(const struct scene_channel *channel, double time_s, uint32_t i)
{
    return channel_number(channel, moment_find(channel, time_s), i);
}

static int quaternion_normalize(double q[4])
{
    double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);

    if (!(length > 1e-150) || !isfinite(length))
        return 0;
    for (int i = 0; i < 4; i++)
        q[i] /= length;
    return 1;
}

static void key_rotation(const struct scene_channel *c, uint32_t key, double q[4])
{
    for (uint32_t i = 0; i < 4; i++)
        q[i] = key_number(c, key, VALUE, i);
    quaternion_normalize(q); /* scene_validate has checked that it can be */
}

/* Along the shorter great circle from a to b, both unit (glTF 2.0, C.4). */
static void slerp(const double a[4], const double b[4], double u, double out[4])
{
    double near_b[4], dot = 0, apart = 0, together = 0, angle, sine, wa = 1 - u, wb = u;

    for (int i = 0; i < 4; i++)
        dot += a[i] * b[i];
    for (int i = 0; i < 4; i++) {
        near_b[i] = dot < 0 ? -b[i] : b[i];
        apart += (near_b[i] - a[i]) * (near_b[i] - a[i]);
        together += (near_b[i] + a[i]) * (near_b[i] + a[i]);
    }
    /* Kahan's angle between unit vectors: unlike the arc cosine it is accurate for small ones. */
    angle = 2 * det_atan2_d(sqrt(apart), sqrt(together));
    sine = det_sin_d(angle);
    /* Below, the chord and the arc agree to the last bit; equal keys have no arc. */
    if (sine > 1e-9 || !SAFEGUARD(KEYS_EQUAL)) {
        wa = det_sin_d((1 - u) * angle) / sine;
        wb = det_sin_d(u * angle) / sine;
    }
    for (int i = 0; i < 4; i++)
        out[i] = wa * a[i] + wb * near_b[i];
    quaternion_normalize(out);
}

static void channel_rotation(const struct scene_channel *c, struct moment m, double q[4])
{
    double from[4], to[4];

    key_rotation(c, m.key, from);
    memcpy(q, from, sizeof from);
    if (m.u == 0)
        return;
    if (c->interpolation == INTERPOLATE_LINEAR) {
        key_rotation(c, m.key + 1, to);
        slerp(from, to, m.u, q);
        return;
    }
    for (uint32_t i = 0; i < 4; i++)
        to[i] = channel_number(c, m, i);
    if (quaternion_normalize(to)) /* else the spline goes through 0: keep the key before */
        memcpy(q, to, sizeof to);
}

/* ---- nodes ------------------------------------------------------------------------------ */

struct local {
    double translation[3], rotation[4], scale[3];
};

static struct local node_rest(const struct scene_node *node)
{
    struct local l;

    for (int i = 0; i < 3; i++) {
        l.translation[i] = node->translation[i];
        l.scale[i] = node->scale[i];
    }
    for (int i = 0; i < 4; i++)
        l.rotation[i] = node->rotation[i];
    return l;
}

static void channel_apply(const struct scene_channel *c, double time_s, struct local *l, double *weights)
{
    struct moment m = moment_find(c, time_s);
    double *to = c->path == PATH_TRANSLATION ? l->translation
                 : c->path == PATH_SCALE     ? l->scale
                                             : weights;

    if (c->path == PATH_ROTATION) {
        channel_rotation(c, m, l->rotation);
        return;
    }
    assert(to); /* scene_validate: it has as many components as the node has weights */
    for (uint32_t i = 0; i < c->components; i++)
        to[i] = channel_number(c, m, i);
}

static int transform_d_is_in_range(const struct transform_d *t)
{
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            if (!(fabs(t->m[r][c]) <= (double)SCENE_COORDINATE_MAX))
                return 0;
    return 1;
}

/* One block: transforms, pointers to weights, weights. */
static status pose_allocate(struct scene_pose *pose, const struct scene *scene, struct error *err)
{
    size_t nodes = scene->node_count, weights = 0;
    double *numbers;

    /* Validated counts: 2^22 nodes of 2^10 weights do not overflow. */
    for (uint32_t i = 0; i < scene->node_count; i++)
        weights += scene->nodes[i].weight_count;
    pose->storage = mem_alloc(nodes * (sizeof *pose->to_world + sizeof *pose->weights) + weights * sizeof *numbers);
    NEED(pose->storage, err, "the pose of the scene's nodes");
    pose->to_world = pose->storage;
    pose->weights = (double **)(void *)(pose->to_world + nodes);
    numbers = (double *)(void *)(pose->weights + nodes);
    for (uint32_t i = 0; i < scene->node_count; i++) {
        const struct scene_node *node = &scene->nodes[i];
        pose->weights[i] = node->weight_count ? numbers : NULL;
        for (uint32_t w = 0; w < node->weight_count; w++)
            *numbers++ = (double)node->weights[w];
    }
    return STATUS_OK;
}

status scene_pose_init(struct scene_pose *pose, const struct scene *scene, double time_s, struct error *err)
{
    uint32_t channel = 0;
    status result;

    memset(pose, 0, sizeof *pose);
    result = pose_allocate(pose, scene, err);
    for (uint32_t i = 0; i < scene->node_count && result == STATUS_OK; i++) {
        const struct scene_node *node = &scene->nodes[i];
        struct local local = node_rest(node);
        struct transform_d *to_world = &pose->to_world[i];

        for (; channel < scene->channel_count && scene->channels[channel].node == i; channel++)
            channel_apply(&scene->channels[channel], time_s, &local, pose->weights[i]);
        *to_world =
            node->has_matrix ? node->matrix : transform_d_from_trs(local.translation, local.rotation, local.scale);
        if (node->parent >= 0)
            *to_world = transform_d_multiply(&pose->to_world[node->parent], to_world);
        if (!transform_d_is_in_range(to_world))
            result = error_set(err, STATUS_ERR_INPUT,
                               "the scene's nodes[%u] is moved beyond 1e15 metres at %g s: the file's "
                               "animation is damaged or its parents' scales add up to that",
                               i, time_s);
    }
    if (result != STATUS_OK) {
        scene_pose_release(pose);
        return result;
    }
    for (uint32_t i = 0; i < scene->node_count; i++)
        for (int r = 0; r < 3; r++)
            pose->to_world[i].m[r][3] -= scene->origin[r];
    return STATUS_OK;
}

void scene_pose_release(struct scene_pose *pose)
{
    mem_free(pose->storage);
    memset(pose, 0, sizeof *pose);
}

/* ---- what follows nodes ----------------------------------------------------------------- */

struct transform_d pose_instance(const struct scene_pose *pose, const struct scene *scene, uint32_t instance)
{
    const struct scene_instance *it = &scene->instances[instance];

    if (it->skin >= 0)
        return transform_d_identity();
    return it->node >= 0 ? pose->to_world[it->node] : it->to_world;
}

/* The rigid part of a node's transform; only its position if its axes vanish. */
static void follow_rigidly(const struct transform_d *node, struct transform_d *to_world)
{
    struct transform_d rigid;

    if (transform_d_rigid(node, &rigid))
        *to_world = rigid;
    else
        for (int r = 0; r < 3; r++)
            to_world->m[r][3] = node->m[r][3];
}

void pose_camera(const struct scene_pose *pose, const struct scene *scene, uint32_t camera, struct scene_camera *out)
{
    *out = scene->cameras[camera];
    if (out->node >= 0)
        follow_rigidly(&pose->to_world[out->node], &out->to_world);
}

void pose_light(const struct scene_pose *pose, const struct scene *scene, uint32_t light, struct scene_light *out)
{
    const struct transform_d *node;
    double back[3], largest = 0, length;

    *out = scene->lights[light];
    if (out->node < 0)
        return;
    node = &pose->to_world[out->node];
    follow_rigidly(node, &out->to_world);
    for (int r = 0; r < 3; r++) {
        out->position[r] = node->m[r][3];
        back[r] = node->m[r][2];
        if (fabs(back[r]) > largest)
            largest = fabs(back[r]);
    }
    if (largest == 0)
        return;
    for (int r = 0; r < 3; r++)
        back[r] /= largest;
    length = sqrt(back[0] * back[0] + back[1] * back[1] + back[2] * back[2]);
    for (int r = 0; r < 3; r++)
        out->direction[r] = (float)(-back[r] / length);
}

/* ---- deformed meshes -------------------------------------------------------------------- */

/* A mesh's arrays, and what moves its vertices. */
struct deformation {
    const uint8_t *blob;
    struct scene_mesh_layout layout;
    uint32_t vertex_count;
    uint32_t morph_count;       /* 0 also if no weight is given */
    const double *weights;      /* [morph_count] */
    uint32_t joint_count;       /* 0: no skin */
    struct transform_d *joints; /* [joint_count] mesh to world */
};

struct vertex {
    double position[3], normal[3], tangent[3], handedness;
};

static void read_floats(const uint8_t *from, size_t count, double *to)
{
    float values[4];

    memcpy(values, from, count * sizeof *values);
    for (size_t i = 0; i < count; i++)
        to[i] = (double)values[i];
}

static void add_floats(const uint8_t *from, double weight, double to[3])
{
    double delta[3];

    read_floats(from, 3, delta);
    for (int i = 0; i < 3; i++)
        to[i] += weight * delta[i];
}

static void vertex_morph(const struct deformation *d, uint32_t v, struct vertex *out)
{
    const int has_normals = d->layout.normals != SIZE_MAX;
    const size_t stride = 3 * sizeof(float);

    for (uint32_t i = 0; i < d->morph_count; i++) {
        const uint8_t *target = d->blob + d->layout.morphs + i * d->layout.morph_stride;
        if (d->weights[i] == 0)
            continue;
        add_floats(target + v * stride, d->weights[i], out->position);
        if (has_normals)
            add_floats(target + ((size_t)d->vertex_count + v) * stride, d->weights[i], out->normal);
    }
}

/* The joints' transforms, weighted. 0: a joint does not exist. */
static int joints_blend(const struct deformation *d, const struct mesh_influence *influence, struct transform_d *out)
{
    memset(out, 0, sizeof *out);
    for (int i = 0; i < 4; i++) {
        const double weight = (double)influence->weight[i];
        if (influence->weight[i] == 0)
            continue;
        if (influence->joint[i] >= d->joint_count)
            return 0;
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 4; c++)
                out->m[r][c] += weight * d->joints[influence->joint[i]].m[r][c];
    }
    return 1;
}

static void map_vector(const struct transform_d *t, double v[3])
{
    const double x = v[0], y = v[1], z = v[2];

    for (int r = 0; r < 3; r++)
        v[r] = t->m[r][0] * x + t->m[r][1] * y + t->m[r][2] * z;
}

/* By the inverse transpose up to a positive factor: the cofactors times the determinant's sign,
 * which exist for a singular matrix too. */
static void map_normal(const struct transform_d *t, double sign, double n[3])
{
    const double(*m)[4] = t->m;
    const double x = n[0], y = n[1], z = n[2];

    for (int r = 0; r < 3; r++) {
        const int a = (r + 1) % 3, b = (r + 2) % 3;
        n[r] = sign * ((m[a][1] * m[b][2] - m[a][2] * m[b][1]) * x + (m[a][2] * m[b][0] - m[a][0] * m[b][2]) * y +
                       (m[a][0] * m[b][1] - m[a][1] * m[b][0]) * z);
        if (!SAFEGUARD(NORMAL_COFACTORS))
            n[r] *= sign / transform_d_determinant(t);
    }
}

static int vertex_skin(const struct deformation *d, uint32_t v, struct vertex *out)
{
    struct mesh_influence influence;
    struct transform_d t;
    double sign;

    assert(d->blob);
    memcpy(&influence, d->blob + d->layout.skin + (size_t)v * sizeof influence, sizeof influence);
    if (!joints_blend(d, &influence, &t))
        return 0;
    sign = transform_d_determinant(&t) < 0 ? -1 : 1;
    map_vector(&t, out->position);
    for (int r = 0; r < 3; r++)
        out->position[r] += t.m[r][3];
    map_normal(&t, sign, out->normal);
    map_vector(&t, out->tangent);
    out->handedness *= sign;
    return 1;
}

/* Store v normalised; if that is impossible, store `otherwise` as it is in the blob. */
static void store_unit(const double v[3], const uint8_t *otherwise, float *out)
{
    double largest = 0, length;
    double u[3];

    memcpy(out, otherwise, 3 * sizeof *out);
    for (int i = 0; i < 3; i++)
        if (!(fabs(v[i]) <= largest))
            largest = fabs(v[i]);
    if (!(largest > 0) || !isfinite(largest))
        return;
    for (int i = 0; i < 3; i++)
        u[i] = v[i] / largest;
    length = sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
    for (int i = 0; i < 3; i++)
        out[i] = (float)(u[i] / length);
}

/* The row of a vertex; NULL if the mesh has no such array. */
static const uint8_t *array_at(const struct deformation *d, size_t array, size_t v, size_t floats)
{
    return array == SIZE_MAX ? NULL : d->blob + array + v * floats * sizeof(float);
}

static status vertex_deform(const struct deformation *d, uint32_t v, float *positions, float *normals, float *tangents,
                            struct error *err)
{
    const uint8_t *normal = array_at(d, d->layout.normals, v, 3);
    const uint8_t *tangent = array_at(d, d->layout.tangents, v, 4);
    struct vertex at = {{0}, {0}, {0}, 0};
    double numbers[4];

    read_floats(array_at(d, d->layout.positions, v, 3), 3, at.position);
    if (normal)
        read_floats(normal, 3, at.normal);
    if (tangent) {
        read_floats(tangent, 4, numbers);
        memcpy(at.tangent, numbers, sizeof at.tangent);
        at.handedness = numbers[3];
    }
    vertex_morph(d, v, &at);
    if (d->joint_count && !vertex_skin(d, v, &at))
        return error_set(err, STATUS_ERR_INPUT, "vertex %u follows a joint that its skin of %u joints has not", v,
                         d->joint_count);
    for (int i = 0; i < 3; i++)
        if (!(fabs(at.position[i]) <= (double)SCENE_COORDINATE_MAX))
            return error_set(err, STATUS_ERR_INPUT, "vertex %u is moved beyond 1e15 metres", v);
    for (int i = 0; i < 3 && positions; i++)
        positions[(size_t)v * 3 + (size_t)i] = (float)at.position[i];
    if (normal && normals)
        store_unit(at.normal, normal, normals + (size_t)v * 3);
    if (tangent && tangents) {
        store_unit(at.tangent, tangent, tangents + (size_t)v * 4);
        tangents[(size_t)v * 4 + 3] = (float)at.handedness;
    }
    return STATUS_OK;
}

/* Does the instance's node have as many weights as the mesh has morph targets? */
static int is_morphed(const struct scene *scene, const struct scene_instance *it)
{
    const struct scene_mesh *mesh = &scene->meshes[it->mesh];

    return it->node >= 0 && mesh->morph_count && scene->nodes[it->node].weight_count == mesh->morph_count;
}

static status joints_make(struct deformation *d, const struct scene_pose *pose, const struct scene_skin *skin,
                          struct error *err)
{
    d->joints = mem_alloc_array(skin->joint_count, sizeof *d->joints);
    NEED(d->joints, err, "a skin's joints");
    d->joint_count = skin->joint_count;
    for (uint32_t i = 0; i < skin->joint_count; i++) {
        const struct transform_d bind = transform_stored_to_d(&skin->inverse_bind[i]);
        d->joints[i] = transform_d_multiply(&pose->to_world[skin->joints[i]], &bind);
    }
    return STATUS_OK;
}

status pose_deform(const struct scene_pose *pose, const struct scene *scene, uint32_t instance, const uint8_t *blob,
                   float *positions, float *normals, float *tangents, struct error *err)
{
    const struct scene_instance *it = &scene->instances[instance];
    const struct scene_mesh *mesh = &scene->meshes[it->mesh];
    struct deformation d = {.blob = blob, .vertex_count = mesh->vertex_count};
    struct error why = {0};
    status result = STATUS_OK;

    scene_mesh_layout(mesh, &d.layout);
    if (is_morphed(scene, it)) {
        d.morph_count = mesh->morph_count;
        d.weights = pose->weights[it->node];
    }
    if (it->skin >= 0)
        result = joints_make(&d, pose, &scene->skins[it->skin], &why);
    for (uint32_t v = 0; v < mesh->vertex_count && result == STATUS_OK; v++)
        result = vertex_deform(&d, v, positions, normals, tangents, &why);
    mem_free(d.joints);
    if (result != STATUS_OK)
        return error_set(err, result, "instance %u \"%.80s\": %s", instance, it->name, why.text);
    return STATUS_OK;
}

/* ---- what moves at all ------------------------------------------------------------------ */

int scene_channel_is_still(const struct scene_channel *c)
{
    for (uint32_t key = 0; key < c->key_count; key++)
        for (uint32_t i = 0; i < c->components; i++) {
            if (key_number(c, key, VALUE, i) != key_number(c, 0, VALUE, i))
                return 0;
            if (c->interpolation == INTERPOLATE_CUBIC &&
                (key_number(c, key, IN_TANGENT, i) != 0 || key_number(c, key, OUT_TANGENT, i) != 0))
                return 0;
        }
    return 1;
}

static int weights_move(const struct scene *scene, int32_t node)
{
    uint32_t low = 0, high = scene->channel_count;

    while (low < high) { /* the first channel that is not before (node, PATH_WEIGHTS) */
        uint32_t middle = low + (high - low) / 2;
        const struct scene_channel *c = &scene->channels[middle];
        if (c->node < (uint32_t)node || (c->node == (uint32_t)node && c->path < PATH_WEIGHTS))
            low = middle + 1;
        else
            high = middle;
    }
    return low < scene->channel_count && scene->channels[low].node == (uint32_t)node &&
           scene->channels[low].path == PATH_WEIGHTS;
}

int scene_instance_deforms(const struct scene *scene, uint32_t instance)
{
    const struct scene_instance *it = &scene->instances[instance];
    const struct scene_node *node;

    if (it->skin >= 0)
        return 1;
    if (!is_morphed(scene, it))
        return 0;
    node = &scene->nodes[it->node];
    for (uint32_t i = 0; i < node->weight_count; i++)
        if (node->weights[i] != 0)
            return 1;
    return weights_move(scene, it->node);
}

enum { MOVES = 1, MORPHS = 2 }; /* what a node does at some time */

/* What each node does; it inherits its parents' moves. */
static void nodes_mark(const struct scene *scene, uint8_t *marks)
{
    for (uint32_t i = 0; i < scene->channel_count; i++) {
        const struct scene_channel *c = &scene->channels[i];
        if (!scene_channel_is_still(c))
            marks[c->node] |= c->path == PATH_WEIGHTS ? MORPHS : MOVES;
    }
    for (uint32_t i = 0; i < scene->node_count; i++)
        if (scene->nodes[i].parent >= 0)
            marks[i] |= marks[scene->nodes[i].parent] & MOVES;
}

static int instance_moves(const struct scene *scene, const uint8_t *marks, const struct scene_instance *it)
{
    if (is_morphed(scene, it) && (marks[it->node] & MORPHS))
        return 1;
    if (it->skin < 0)
        return it->node >= 0 && (marks[it->node] & MOVES);
    for (uint32_t i = 0; i < scene->skins[it->skin].joint_count; i++)
        if (marks[scene->skins[it->skin].joints[i]] & MOVES)
            return 1;
    return 0;
}

/* Does anything that this camera sees move? */
static int scene_moves(const struct scene *scene, const struct render_settings *settings)
{
    const struct scene_camera *camera = &scene->cameras[settings->camera];
    uint8_t *marks;
    int moves;

    if (scene->channel_count == 0)
        return 0;
    marks = mem_calloc(scene->node_count, 1);
    if (!marks)
        return 1;
    nodes_mark(scene, marks);
    moves = camera->node >= 0 && (marks[camera->node] & MOVES);
    for (uint32_t i = 0; i < scene->instance_count && !moves; i++)
        moves = instance_moves(scene, marks, &scene->instances[i]);
    for (uint32_t i = 0; i < scene->light_count && !moves; i++)
        moves = scene->lights[i].node >= 0 && (marks[scene->lights[i].node] & MOVES);
    mem_free(marks);
    return moves;
}

int scene_is_animated(const struct scene *scene, const struct render_settings *settings)
{
    return scene_moves(scene, settings) || scene_tracks_change(scene, settings->camera);
}

void scene_shutter(const struct scene *scene, const struct render_settings *settings, uint32_t frame, double *open_s,
                   double *close_s)
{
    const struct scene_camera *camera = &scene->cameras[settings->camera];
    const double fps = (double)settings->fps;
    const double time_s = scene_frame_s(settings, frame);

    *open_s = *close_s = time_s;
    if (settings->without & EFFECT_MOTION_BLUR || !scene_moves(scene, settings))
        return;
    if (settings->shutter > 0) {
        *close_s = time_s + (double)settings->shutter / fps;
    } else if (camera->shutter_close_s > camera->shutter_open_s) {
        *open_s = time_s + (double)camera->shutter_open_s;
        *close_s = time_s + (double)camera->shutter_close_s;
    }
}

static double later(double last, const struct scene_channel *c)
{
    return fmax(last, (double)c->times[c->key_count - 1]);
}

double scene_duration_s(const struct scene *scene)
{
    double last = 0;

    for (uint32_t i = 0; i < scene->channel_count; i++)
        last = later(last, &scene->channels[i]);
    for (uint32_t i = 0; i < scene->track_count; i++)
        last = later(last, &scene->tracks[i].keys);
    return last;
}
