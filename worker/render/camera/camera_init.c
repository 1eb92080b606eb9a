/* camera_init: what a camera does once or rarely. */
#include <string.h>

#include "common/math/elementary.h"
#include "common/scene/effects.h"
#include "worker/render/camera/camera.h"

/* Half the width of each filter's support, pixels. */
static const double filter_radii[PIXEL_FILTER_COUNT] = {
    [PIXEL_FILTER_BLACKMAN_HARRIS] = 1.5,
    [PIXEL_FILTER_BOX] = 0.5,
    [PIXEL_FILTER_TRIANGLE] = 1,
    [PIXEL_FILTER_GAUSSIAN] = 1.5,
};

/* The weight at x of -1..0, the left half of the support: up to a factor. The window of Blackman and Harris has 4 terms
 * (Harris 1978, -92 dB). The Gaussian's standard deviation is a third of the radius, where it is cut and 0. */
static double filter_weight(enum pixel_filter filter, double x)
{
    double turn = (x + 1) * PI_D;

    switch (filter) {
    case PIXEL_FILTER_BOX: return 1;
    case PIXEL_FILTER_TRIANGLE: return 1 + x;
    case PIXEL_FILTER_GAUSSIAN: return (double)(real_exp((real)(-4.5 * x * x)) - real_exp(-4.5f));
    default:
        return 0.35875 - 0.48829 * (double)real_cos((real)turn) + 0.14128 * (double)real_cos((real)(2 * turn)) -
               0.01168 * (double)real_cos((real)(3 * turn));
    }
}

/* The table's entry i is where the left half's accumulated weight, of 1, reaches (i / FILTER_TABLE_SIZE)^4: the fourth
 * power gives the faint tail as many entries as the bright middle. */
static void filter_table_fill(real table[FILTER_TABLE_SIZE + 1], enum pixel_filter filter, double radius)
{
    enum { STEPS = 1 << 14 };
    const double step = radius / STEPS;
    double total = 0, sum = 0;
    int next = 1;

    for (int i = 0; i < STEPS; i++)
        total += filter_weight(filter, (-radius + (i + 0.5) * step) / radius);
    table[0] = (real)-radius;
    for (int i = 0; i < STEPS; i++) {
        double weight = filter_weight(filter, (-radius + (i + 0.5) * step) / radius) / total;
        for (; next < FILTER_TABLE_SIZE; next++) {
            double w = (double)next / FILTER_TABLE_SIZE, target = w * w * w * w;
            if (sum + weight < target)
                break;
            table[next] = (real)(-radius + (i + (target - sum) / weight) * step);
        }
        sum += weight;
    }
    while (next <= FILTER_TABLE_SIZE)
        table[next++] = 0;
}

static void lens_init(struct camera *camera, const struct scene_camera *description,
                      const struct render_settings *settings)
{
    if (camera->kind == CAMERA_PANORAMA || (settings->without & EFFECT_DEPTH_OF_FIELD))
        return;
    camera->lens_radius = settings->lens_radius >= 0 ? settings->lens_radius : description->lens_radius;
    camera->focus_distance = settings->focus_distance > 0 ? settings->focus_distance : description->focus_distance;
    if (!(camera->lens_radius > 0) || !(camera->focus_distance > 0)) {
        camera->lens_radius = 0; /* a lens without a focus distance has no effect */
        return;
    }
    if (description->blades >= 3) {
        camera->blades = description->blades;
        camera->blade_rotation_rad = description->blade_rotation_rad;
        real_sincos(2 * REAL_PI / (real)camera->blades, &camera->blade_sine, &camera->blade_cosine);
    }
}

void camera_init(struct camera *camera, const struct scene_camera *description, const struct render_settings *settings,
                 const struct camera_motion *motion)
{
    uint32_t width = settings_whole_width(settings), height = settings_whole_height(settings);
    real aspect = (real)width / (real)height;

    memset(camera, 0, sizeof *camera);
    camera->kind = description->kind;
    camera->to_world = transform_from_d(&description->to_world);
    camera->width = (real)width;
    camera->height = (real)height;
    camera->half_height =
        description->kind == CAMERA_PERSPECTIVE ? real_tan(description->yfov_rad * 0.5f) : description->ymag;
    camera->half_width = camera->half_height * aspect;
    lens_init(camera, description, settings);
    if (motion && motion->shutter_open) {
        camera->shutter_open = 1;
        if (motion->steps >= 2) {
            camera->motion_steps = motion->steps < CAMERA_STEPS_MAX ? motion->steps : CAMERA_STEPS_MAX;
            memcpy(camera->motion, motion->to_world, camera->motion_steps * sizeof *camera->motion);
            camera->to_world = camera->motion[0];
        }
    }
    camera->pinhole = camera->kind == CAMERA_PERSPECTIVE && !(camera->lens_radius > 0) && !camera->shutter_open;
    filter_table_fill(camera->filter_offset, settings->pixel_filter,
                      settings->filter_width > 0 ? (double)settings->filter_width / 2
                                                 : filter_radii[settings->pixel_filter]);
}

struct camera_cone camera_cone(const struct camera *camera)
{
    struct camera_cone cone = {0, 0};

    if (camera->kind == CAMERA_ORTHOGRAPHIC)
        cone.width = camera->half_height / camera->height;
    else if (camera->kind == CAMERA_PANORAMA) /* the shorter side of a pixel on the equator */
        cone.spread = 0.5f * real_min(REAL_PI / camera->height, 2 * REAL_PI / camera->width);
    else
        cone.spread = camera->half_height / camera->height;
    return cone;
}

/* Column `c` of the rotation. */
static struct vec3 column(const struct transform *t, int c) { return vec3_make(t->m[0][c], t->m[1][c], t->m[2][c]); }

static void set_column(struct transform *t, int c, struct vec3 v)
{
    t->m[0][c] = v.x;
    t->m[1][c] = v.y;
    t->m[2][c] = v.z;
}

/* Gram-Schmidt orthonormalisation, starting from the view axis; 0 if an axis vanishes. */
static int orthonormalize(struct transform *t)
{
    struct vec3 z = vec3_normalize(column(t, 2)), x = column(t, 0), y = column(t, 1);

    x = vec3_normalize(vec3_mad(x, z, -vec3_dot(x, z)));
    y = vec3_mad(y, z, -vec3_dot(y, z));
    y = vec3_normalize(vec3_mad(y, x, -vec3_dot(y, x)));
    if (vec3_is_black(x) || vec3_is_black(y) || vec3_is_black(z))
        return 0;
    set_column(t, 0, x);
    set_column(t, 1, y);
    set_column(t, 2, z);
    return 1;
}

struct transform camera_to_world_at(const struct camera *camera, real time)
{
    struct transform mixed;
    uint32_t segment;
    real f;

    if (!camera->motion_steps)
        return camera->to_world;
    segment = motion_segment(time, camera->motion_steps, &f);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++) {
            real a = camera->motion[segment].m[r][c], b = camera->motion[segment + 1].m[r][c];
            mixed.m[r][c] = (1 - f) * a + f * b;
        }
    /* Half a turn within one step: the direction of rotation is ambiguous. */
    return orthonormalize(&mixed) ? mixed : camera->motion[segment];
}

int camera_project(const struct camera *camera, struct vec3 p, real time, real pixel[2])
{
    struct transform to_world = camera_to_world_at(camera, time);
    struct vec3 d = vec3_sub(p, column(&to_world, 3));
    real x = vec3_dot(column(&to_world, 0), d), y = vec3_dot(column(&to_world, 1), d);
    real z = vec3_dot(column(&to_world, 2), d);

    pixel[0] = pixel[1] = 0;
    if (camera->kind == CAMERA_PANORAMA) {
        real length = real_sqrt(x * x + y * y + z * z);
        if (!(length > 0) || !isfinite(length))
            return 0;
        pixel[0] = (real_atan2(x, -z) / (2 * REAL_PI) + 0.5f) * camera->width;
        pixel[1] = (0.5f - real_asin(y / length) / REAL_PI) * camera->height;
        return 1;
    }
    if (camera->kind == CAMERA_PERSPECTIVE) {
        x = x / -z;
        y = y / -z;
    }
    if (!(z < 0) || !isfinite(x) || !isfinite(y))
        return 0;
    pixel[0] = (x / camera->half_width + 1) * 0.5f * camera->width;
    pixel[1] = (1 - y / camera->half_height) * 0.5f * camera->height;
    return isfinite(pixel[0]) && isfinite(pixel[1]);
}

int camera_motion_vector(const struct camera *camera, struct vec3 opening, struct vec3 closing, real motion[2])
{
    real a[2], b[2];

    motion[0] = motion[1] = 0;
    if (!camera_project(camera, opening, 0, a) || !camera_project(camera, closing, 1, b))
        return 0;
    motion[0] = b[0] - a[0];
    motion[1] = b[1] - a[1];
    if (camera->kind == CAMERA_PANORAMA && real_abs(motion[0]) > 0.5f * camera->width)
        motion[0] += motion[0] > 0 ? -camera->width : camera->width;
    return 1;
}
