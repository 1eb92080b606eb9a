#include <math.h>
#include <string.h>

#include "client/import/builder/builder.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "common/scene/pose.h"

/* The vertical field of view and the position of an added camera: glTF assets face +Z, so it looks
 * from there, turned to the right and raised. */
static const float frame_fov_rad = 40 * PI_F / 180;
static const float frame_azimuth_rad = 30 * PI_F / 180;
static const float frame_elevation_rad = 22 * PI_F / 180;
/* A margin around the scene. */
static const double frame_margin = 1.06;

/* ---- where things are ----------------------------------------------------------------------- */

/* The number of moments of an animation to consider, including its ends. */
enum { MOMENTS = 9 };

struct box {
    struct transform_d to_world;
    float low[3], high[3];
};

struct boxes {
    struct box *list;
    size_t count, capacity;
};

/* Around the vertices that pose_deform makes. */
static status find_deformed(struct builder *b, const struct scene_pose *pose, uint32_t instance, struct box *box)
{
    const struct scene *scene = &b->out->scene;
    const struct scene_mesh *mesh = &scene->meshes[scene->instances[instance].mesh];
    const struct import_blob *blob = builder_blob(b, &mesh->blob);
    float *positions = must(mem_alloc_array(mesh->vertex_count, 3 * sizeof *positions));
    status result;

    if (!blob) {
        mem_free(positions);
        return error_set(b->err, STATUS_ERR_INTERNAL, "a mesh's blob is missing");
    }
    result = pose_deform(pose, scene, instance, blob->data, positions, NULL, NULL, b->err);
    for (int c = 0; c < 3 && result == STATUS_OK; c++) {
        box->low[c] = INFINITY;
        box->high[c] = -INFINITY;
        for (size_t v = 0; v < mesh->vertex_count; v++) {
            box->low[c] = fminf(box->low[c], positions[3 * v + (size_t)c]);
            box->high[c] = fmaxf(box->high[c], positions[3 * v + (size_t)c]);
        }
    }
    mem_free(positions);
    return result;
}

static status add_boxes(struct builder *b, const struct scene_pose *pose, int only_moving, struct boxes *out)
{
    const struct scene *scene = &b->out->scene;

    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct scene_instance *instance = &scene->instances[i];
        const struct scene_mesh *mesh = &scene->meshes[instance->mesh];
        struct box *box;
        if (only_moving && instance->node < 0 && instance->skin < 0)
            continue;
        MUST_GROW(out->list, out->capacity, out->count + 1);
        box = &out->list[out->count++];
        box->to_world = pose_instance(pose, scene, i);
        memcpy(box->low, mesh->bounds_min, sizeof box->low);
        memcpy(box->high, mesh->bounds_max, sizeof box->high);
        if (instance->skin >= 0 || mesh->morph_count) {
            TRY(find_deformed(b, pose, i, box));
        }
    }
    return STATUS_OK;
}

/* Everything that follows a node gets its value at time 0. */
static void place_followers(struct scene *scene, const struct scene_pose *pose)
{
    for (uint32_t i = 0; i < scene->instance_count; i++)
        if (scene->instances[i].node >= 0 && scene->instances[i].skin < 0) {
            scene->instances[i].to_world = pose_instance(pose, scene, i);
        }
    for (uint32_t i = 0; i < scene->light_count; i++) {
        struct scene_light light;
        pose_light(pose, scene, i, &light);
        scene->lights[i] = light;
    }
    for (uint32_t i = 0; i < scene->camera_count; i++) {
        struct scene_camera camera;
        pose_camera(pose, scene, i, &camera);
        scene->cameras[i] = camera;
    }
}

static status find_boxes(struct builder *b, struct boxes *out)
{
    struct scene *scene = &b->out->scene;
    double duration = scene_duration_s(scene);
    int moments = scene->node_count ? MOMENTS : 1;
    status result = STATUS_OK;

    for (int m = 0; m < moments && result == STATUS_OK; m++) {
        struct scene_pose pose;
        result = scene_pose_init(&pose, scene, duration * m / (MOMENTS - 1), b->err);
        if (result == STATUS_OK && m == 0)
            place_followers(scene, &pose);
        THEN(result, add_boxes(b, &pose, m > 0, out));
        scene_pose_release(&pose);
    }
    return result;
}

/* ---- a camera ------------------------------------------------------------------------------- */

static void box_corner(const struct box *box, int corner, double out[3])
{
    for (int r = 0; r < 3; r++) {
        out[r] = box->to_world.m[r][3];
        for (int c = 0; c < 3; c++)
            out[r] += box->to_world.m[r][c] * (double)(corner >> c & 1 ? box->high[c] : box->low[c]);
    }
}

/* *low_y: the lowest height. */
static void find_center(const struct boxes *boxes, double center[3], double *low_y)
{
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};

    for (size_t i = 0; i < 8 * boxes->count; i++) {
        double at[3];
        box_corner(&boxes->list[i / 8], i % 8, at);
        for (int c = 0; c < 3; c++) {
            low[c] = fmin(low[c], at[c]);
            high[c] = fmax(high[c], at[c]);
        }
    }
    for (int c = 0; c < 3; c++) {
        center[c] = (low[c] + high[c]) / 2;
        if (!isfinite(center[c]))
            center[c] = 0;
    }
    *low_y = isfinite(low[1]) ? low[1] : 0;
}

/* The distance from the centre at which the corners of every box are in the picture. `axes` are the camera's. */
static double distance_needed(const struct boxes *boxes, const double center[3], const struct transform_d *axes,
                              double tangent)
{
    double needed = 0;

    for (size_t i = 0; i < 8 * boxes->count; i++) {
        double at[3], seen[3];
        box_corner(&boxes->list[i / 8], i % 8, at);
        for (int c = 0; c < 3; c++)
            at[c] -= center[c];
        for (int c = 0; c < 3; c++)
            seen[c] = at[0] * axes->m[0][c] + at[1] * axes->m[1][c] + at[2] * axes->m[2][c];
        /* In the frame when max(|x|, |y|) <= (distance - z) * tangent: a square frame, which every
         * landscape picture contains. */
        needed = fmax(needed, seen[2] + fmax(fabs(seen[0]), fabs(seen[1])) * frame_margin / tangent);
    }
    return needed > 0 && isfinite(needed) ? needed : 1;
}

static void frame_boxes(struct builder *b, const struct boxes *boxes, struct scene_camera *out)
{
    double *center = b->framed_center, distance;
    struct transform_d view = transform_d_identity();
    float sin_a, cos_a, sin_e, cos_e;

    det_sincos(frame_azimuth_rad, &sin_a, &cos_a);
    det_sincos(frame_elevation_rad, &sin_e, &cos_e);
    view.m[0][2] = (double)(sin_a * cos_e);
    view.m[1][2] = (double)sin_e;
    view.m[2][2] = (double)(cos_a * cos_e);
    for (int i = 0; i < 3; i++)
        view.m[i][1] = i == 1;
    out->yfov_rad = frame_fov_rad;
    if (!transform_d_rigid(&view, &out->to_world)) /* constants: cannot happen */
        return;
    find_center(boxes, center, &b->framed_low_y);
    b->framed_distance = distance = distance_needed(boxes, center, &out->to_world, (double)det_tan(frame_fov_rad / 2));
    for (int i = 0; i < 3; i++)
        out->to_world.m[i][3] = center[i] + view.m[i][2] * distance;
}

status scene_place(struct builder *b, struct scene_camera *framed)
{
    struct boxes boxes = {0};
    status result;

    if (!framed && b->out->scene.node_count == 0)
        return STATUS_OK;
    result = find_boxes(b, &boxes);
    if (result == STATUS_OK && framed)
        frame_boxes(b, &boxes, framed);
    mem_free(boxes.list);
    return result;
}
