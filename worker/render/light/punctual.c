#include "worker/render/light/punctual.h"

#include "common/base/memory.h"
#include "common/base/safeguard.h"
#include "common/math/elementary.h"
#include "worker/render/base/health_scope.h"
#include "worker/render/camera/camera.h"

/* An image's mean luminance is computed on a grid of this many points a side. Bright spots between
 * the points are not lost: no image counts as darker than IMAGE_MEAN_MIN. */
enum { IMAGE_GRID = 48 };
#define IMAGE_MEAN_MIN 1e-2

static struct vec3 vec3_of(const float32 v[3]) { return vec3_make(v[0], v[1], v[2]); }

static struct vec3 column(const struct transform_d *t, int c)
{
    return vec3_normalize(vec3_make((real)t->m[0][c], (real)t->m[1][c], (real)t->m[2][c]));
}

void punctual_pose_of(struct punctual_pose *out, const struct scene_light *light)
{
    unsigned parts = scene_light_parts(light->kind);

    *out = (struct punctual_pose){0};
    if (parts & LIGHT_HAS_PLACE)
        out->position = vec3_make((real)light->position[0], (real)light->position[1], (real)light->position[2]);
    if (parts & LIGHT_HAS_DIRECTION)
        out->direction = vec3_of(light->direction);
    if (!(parts & LIGHT_HAS_FRAME))
        return;
    for (int c = 0; c < 3; c++)
        out->axis[c] = column(&light->to_world, c);
    out->direction = vec3_neg(out->axis[2]);
}

void *punctual_alloc(size_t size, enum scene_light_kind kind, const struct scene_light *light)
{
    struct punctual *p = mem_calloc(1, size);

    if (!p)
        return NULL;
    p->kind = kind;
    punctual_pose_of(&p->pose, light);
    p->intensity = vec3_of(light->intensity);
    p->range = light->range;
    return p;
}

/* ---- position ----------------------------------------------------------------------------- */

static struct vec3 mixed(struct vec3 a, struct vec3 b, real share)
{
    return vec3_add(vec3_scale(a, 1 - share), vec3_scale(b, share));
}

/* A unit vector interpolated between two; between opposite ones, the first. */
static struct vec3 mixed_direction(struct vec3 a, struct vec3 b, real share)
{
    struct vec3 v = vec3_normalize(mixed(a, b, share));

    return vec3_is_black(v) ? a : v;
}

/* The axes, interpolated and made orthonormal again. What follows a node is never mirrored (pose_light). */
static void mix_axes(struct vec3 out[3], const struct vec3 a[3], const struct vec3 b[3], real share)
{
    struct vec3 x = mixed(a[0], b[0], share);

    out[2] = mixed_direction(a[2], b[2], share);
    x = vec3_normalize(vec3_mad(x, out[2], -vec3_dot(x, out[2])));
    out[0] = vec3_is_black(x) ? a[0] : x;
    out[1] = vec3_cross(out[2], out[0]);
}

const struct punctual_pose *punctual_pose_at(const struct punctual *p, real time, struct punctual_pose *moved)
{
    const struct punctual_pose *a, *b;
    uint32_t segment;
    real share;

    if (!p->motion.steps)
        return &p->pose;
    segment = motion_segment(time, p->motion.steps, &share);
    a = &p->motion.at[segment];
    b = a + 1;
    moved->position = mixed(a->position, b->position, share);
    moved->direction = mixed_direction(a->direction, b->direction, share);
    if (scene_light_parts(p->kind) & LIGHT_HAS_FRAME)
        mix_axes(moved->axis, a->axis, b->axis, share);
    return moved;
}

/* ---- bounds ----------------------------------------------------------------------------- */

void punctual_weigh(const struct punctual *p, double mean, struct light_weight *out)
{
    double intensity = (double)vec3_luminance(p->intensity) * mean;
    struct light_bounds *b = &out->bounds;

    b->min = b->max = p->pose.position;
    for (uint32_t k = 0; k < p->motion.steps; k++)
        light_bounds_add(b, p->motion.at[k].position);
    b->axis = vec3_make(0, 0, 1);
    b->spread_rad = REAL_PI;
    b->emission_rad = REAL_PI / 2;
    b->reach = p->range > 0 ? p->range : INFINITY;
    out->intensity = (double)(real)intensity;
    out->power = intensity * 4 * PI_D;
}

/* The mean of all its directions, and the largest angle to it: the directions in between are within
 * that angle, too, as long as it is less than a right angle. */
static real sweep_of(const struct punctual *p, struct vec3 *axis)
{
    struct vec3 sum = {0, 0, 0};
    real least = 1, angle_rad;

    *axis = p->pose.direction;
    if (!p->motion.steps)
        return 0;
    for (uint32_t k = 0; k < p->motion.steps; k++)
        sum = vec3_add(sum, p->motion.at[k].direction);
    sum = vec3_normalize(sum);
    if (!vec3_is_black(sum))
        *axis = sum;
    for (uint32_t k = 0; k < p->motion.steps; k++)
        least = real_min(least, vec3_dot(*axis, p->motion.at[k].direction));
    angle_rad = real_acos(real_max(least, -1)) + REAL(1e-3);
    return angle_rad < REAL_PI / 2 ? angle_rad : REAL_PI;
}

void punctual_narrow(const struct punctual *p, real spread_rad, struct light_bounds *bounds)
{
    real sweep_rad = sweep_of(p, &bounds->axis);

    bounds->spread_rad = real_min(REAL_PI, spread_rad + sweep_rad);
}

/* ---- what arrives ------------------------------------------------------------------------ */

/* Windowed inverse-square falloff (KHR_lights_punctual). */
static real range_window(real distance, real range)
{
    real q;

    if (range <= 0)
        return 1;
    q = distance / range;
    q = 1 - q * q * q * q;
    return q < 0 ? 0 : q > 1 ? 1 : q;
}

int punctual_arrive(const struct punctual *p, struct vec3 position, struct vec3 at, struct light_sample *out,
                    real *share)
{
    struct vec3 way = vec3_sub(position, at);
    real distance_squared = vec3_length_squared(way);

    if (!light_is_apart(distance_squared))
        return health_distance(distance_squared);
    out->distance = real_sqrt(distance_squared);
    out->direction = vec3_scale(way, 1 / out->distance);
    *share = range_window(out->distance, p->range) / distance_squared;
    return 1;
}

int punctual_shine(const struct punctual *p, real share, struct light_sample *out)
{
    out->delta = 1;
    out->radiance = vec3_scale(p->intensity, share);
    return (share > 0 && isfinite(share)) || health_density(share);
}

/* ---- images ------------------------------------------------------------------------------ */

struct vec3 punctual_image(const struct texture_image *image, const struct scene_texture *wrap, real u, real v)
{
    struct texel texel = texture_lookup(image, wrap, u, v, 0, 1);

    return vec3_make(texel.r, texel.g, texel.b);
}

static double mean_bounded(double mean)
{
    return mean > IMAGE_MEAN_MIN || !SAFEGUARD(LIGHT_IMAGE_SPOT) ? mean : IMAGE_MEAN_MIN;
}

double punctual_image_mean(const struct texture_image *image, const struct scene_texture *wrap, int latitudes)
{
    double sum = 0, area = 0;

    for (int i = 0; i < IMAGE_GRID; i++)
        for (int j = 0; j < IMAGE_GRID; j++) {
            real u = ((real)i + 0.5f) / IMAGE_GRID, v = ((real)j + 0.5f) / IMAGE_GRID;
            double weight = latitudes ? (double)real_sin(REAL_PI * v) : 1;

            sum += weight * (double)vec3_luminance(punctual_image(image, wrap, u, v));
            area += weight;
        }
    return mean_bounded(sum / area);
}

struct vec3 punctual_to_local(const struct punctual_pose *pose, struct vec3 direction)
{
    return vec3_make(vec3_dot(direction, pose->axis[0]), vec3_dot(direction, pose->axis[1]),
                     vec3_dot(direction, pose->axis[2]));
}
