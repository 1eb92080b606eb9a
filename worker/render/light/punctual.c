#include "worker/render/light/punctual.h"

#include <string.h>

#include "common/math/elementary.h"
#include "worker/render/camera.h"
#include "worker/render/charge.h"

/* An image's mean luminance is taken on a grid of this many points a side. What falls between
 * them is not lost: no image counts as darker than IMAGE_MEAN_MIN. */
enum { IMAGE_GRID = 48 };
#define IMAGE_MEAN_MIN 1e-2

static const struct scene_texture lat_long = {.wrap_u = WRAP_REPEAT, .wrap_v = WRAP_CLAMP};
static const struct scene_texture slide = {.wrap_u = WRAP_CLAMP, .wrap_v = WRAP_CLAMP};

static struct vec3 vec3_of(const float v[3])
{
    return vec3_make(v[0], v[1], v[2]);
}

static struct vec3 column(const struct transform_d *t, int c)
{
    return vec3_normalize(
        vec3_make((float)t->m[0][c], (float)t->m[1][c], (float)t->m[2][c]));
}

void punctual_pose_of(struct punctual_pose *out, const struct scene_light *light)
{
    memset(out, 0, sizeof *out);
    if (light->kind != LIGHT_DIRECTIONAL)
        out->position = vec3_make((float)light->position[0], (float)light->position[1],
                                  (float)light->position[2]);
    if (light->kind == LIGHT_DIRECTIONAL || light->kind == LIGHT_SPOT)
        out->direction = vec3_of(light->direction);
    if (light->kind != LIGHT_GONIOMETRIC && light->kind != LIGHT_PROJECTION)
        return;
    for (int c = 0; c < 3; c++)
        out->axis[c] = column(&light->to_world, c);
    if (light->kind == LIGHT_PROJECTION)
        out->direction = vec3_neg(out->axis[2]);
}

void punctual_init(struct punctual *p, const struct scene_light *light,
                   const struct texture_image *image)
{
    memset(p, 0, sizeof *p);
    p->kind = light->kind;
    p->falloff = light->falloff;
    punctual_pose_of(&p->pose, light);
    p->intensity = vec3_of(light->intensity);
    p->range = light->range;
    if (light->kind == LIGHT_SPOT) {
        p->cos_inner = det_cos(light->inner_cone_rad);
        p->cos_outer = det_cos(light->outer_cone_rad);
    }
    if (light->kind != LIGHT_GONIOMETRIC && light->kind != LIGHT_PROJECTION)
        return;
    p->image = image;
    if (light->kind == LIGHT_PROJECTION) {
        p->slide_y = det_tan(0.5f * light->projection_yfov_rad);
        p->slide_x = p->slide_y * light->projection_aspect;
    }
}

/* ---- where it is -------------------------------------------------------------------------- */

static struct vec3 mixed(struct vec3 a, struct vec3 b, float share)
{
    return vec3_add(vec3_scale(a, 1 - share), vec3_scale(b, share));
}

/* A unit vector between two; between opposite ones, the first. */
static struct vec3 mixed_direction(struct vec3 a, struct vec3 b, float share)
{
    struct vec3 v = vec3_normalize(mixed(a, b, share));

    return vec3_is_black(v) ? a : v;
}

/* The axes, mixed and made orthonormal again; the frame stays as right- or left-handed as it was. */
static void mix_axes(struct vec3 out[3], const struct vec3 a[3], const struct vec3 b[3], float share)
{
    struct vec3 x = mixed(a[0], b[0], share), y;

    out[2] = mixed_direction(a[2], b[2], share);
    x = vec3_normalize(vec3_mad(x, out[2], -vec3_dot(x, out[2])));
    out[0] = vec3_is_black(x) ? a[0] : x;
    y = vec3_cross(out[2], out[0]);
    out[1] = vec3_dot(vec3_cross(a[2], a[0]), a[1]) < 0 ? vec3_neg(y) : y;
}

static struct punctual_pose pose_at(const struct punctual *light, float time)
{
    struct punctual_pose out = {0};
    const struct punctual_pose *a, *b;
    float share;
    uint32_t segment = motion_segment(time, light->motion.steps, &share);

    a = &light->motion.at[segment];
    b = a + 1;
    out.position = mixed(a->position, b->position, share);
    if (light->kind == LIGHT_GONIOMETRIC || light->kind == LIGHT_PROJECTION)
        mix_axes(out.axis, a->axis, b->axis, share);
    else
        out.direction = mixed_direction(a->direction, b->direction, share);
    return out;
}

/* ---- what it can do ---------------------------------------------------------------------- */

/* Mean luminance of the image over the directions (goniometric) or over the slide. */
static double image_mean(const struct punctual *p)
{
    double sum = 0, area = 0;

    if (!p->image)
        return 1;
    for (int i = 0; i < IMAGE_GRID; i++)
        for (int j = 0; j < IMAGE_GRID; j++) {
            float u = ((float)i + 0.5f) / IMAGE_GRID, v = ((float)j + 0.5f) / IMAGE_GRID;
            int round = p->kind == LIGHT_GONIOMETRIC;
            struct texel texel =
                texture_lookup(p->image, round ? &lat_long : &slide, u, v, 0, 1);
            double weight = round ? (double)det_sin(PI_F * v) : 1;

            sum += weight * (double)vec3_luminance(vec3_make(texel.r, texel.g, texel.b));
            area += weight;
        }
    sum /= area;
    return sum > IMAGE_MEAN_MIN ? sum : IMAGE_MEAN_MIN;
}

/* Of all its directions the mean, and the largest angle to it: the directions in between lie
 * within that too while it is less than a right one. */
static void sweep_of(const struct punctual *p, struct vec3 *axis, float *angle_rad)
{
    struct vec3 sum = {0, 0, 0};
    float least = 1;

    *axis = p->pose.direction;
    *angle_rad = 0;
    if (!p->motion.steps)
        return;
    for (uint32_t k = 0; k < p->motion.steps; k++)
        sum = vec3_add(sum, p->motion.at[k].direction);
    sum = vec3_normalize(sum);
    if (!vec3_is_black(sum))
        *axis = sum;
    for (uint32_t k = 0; k < p->motion.steps; k++)
        least = float_min(least, vec3_dot(*axis, p->motion.at[k].direction));
    *angle_rad = det_acos(float_max(least, -1)) + 1e-3f;
    if (*angle_rad >= PI_F / 2)
        *angle_rad = PI_F;
}

void punctual_bounds(const struct punctual *p, struct light_bounds *out)
{
    float sweep_rad;

    memset(out, 0, sizeof *out);
    out->min = out->max = p->pose.position;
    for (uint32_t k = 0; k < p->motion.steps; k++)
        light_bounds_add(out, p->motion.at[k].position);
    out->axis = vec3_make(0, 0, 1);
    out->spread_rad = PI_F;
    out->emission_rad = PI_F / 2;
    out->reach = p->range > 0 ? p->range : INFINITY;
    out->intensity = (float)((double)vec3_luminance(p->intensity) * image_mean(p));
    if (p->kind != LIGHT_SPOT && p->kind != LIGHT_PROJECTION)
        return;
    sweep_of(p, &out->axis, &sweep_rad);
    if (p->kind == LIGHT_SPOT) {
        out->spread_rad = det_acos(p->cos_inner);
        out->emission_rad = float_max(0, det_acos(p->cos_outer) - out->spread_rad);
    } else {
        out->spread_rad =
            det_atan2(sqrtf(p->slide_x * p->slide_x + p->slide_y * p->slide_y), 1);
        out->emission_rad = 0;
    }
    out->spread_rad = float_min(PI_F, out->spread_rad + sweep_rad);
}

double punctual_power(const struct punctual *p, double scene_radius)
{
    double intensity = (double)vec3_luminance(p->intensity) * image_mean(p);
    double x = (double)p->slide_x, y = (double)p->slide_y;

    switch (p->kind) {
    case LIGHT_DIRECTIONAL: return intensity * PI_D * scene_radius * scene_radius;
    case LIGHT_SPOT: return intensity * 2 * PI_D * (1 - (double)p->cos_outer);
    case LIGHT_PROJECTION:
        /* The solid angle of the slide. */
        return intensity * 4 * (double)det_atan2((float)(x * y), (float)sqrt(1 + x * x + y * y));
    default: return intensity * 4 * PI_D;
    }
}

/* ---- what arrives ------------------------------------------------------------------------ */

/* Windowed inverse-square falloff (KHR_lights_punctual). */
static float range_window(float distance, float range)
{
    float q;

    if (range <= 0)
        return 1;
    q = distance / range;
    q = 1 - q * q * q * q;
    return q < 0 ? 0 : q > 1 ? 1 : q;
}

static float spot_window(const struct punctual *light, float cos_angle)
{
    float span = light->cos_inner - light->cos_outer, fade;

    if (light->falloff == FALLOFF_GLTF)
        span = float_max(0.001f, span);
    else if (!(span > 0))
        return cos_angle >= light->cos_outer ? 1 : 0;
    fade = float_min(1, float_max(0, (cos_angle - light->cos_outer) / span));
    return light->falloff == FALLOFF_GLTF ? fade * fade : fade * fade * (3 - 2 * fade);
}

/* What the image lets through towards `d` (unit, away from the light). */
static struct vec3 image_filter(const struct punctual *light, const struct vec3 axis[3],
                                struct vec3 d)
{
    struct vec3 local =
        vec3_make(vec3_dot(d, axis[0]), vec3_dot(d, axis[1]), vec3_dot(d, axis[2]));
    struct texel texel;
    float u, v;

    if (light->kind == LIGHT_GONIOMETRIC) {
        if (!light->image)
            return vec3_splat(1);
        u = 0.5f + det_atan2(local.z, local.x) * INV_2PI_F;
        v = det_atan2(sqrtf(local.x * local.x + local.z * local.z), local.y) * INV_PI_F;
        texel = texture_lookup(light->image, &lat_long, u, v, 0, 1);
        return vec3_make(texel.r, texel.g, texel.b);
    }
    if (!(local.z < 0))
        return vec3_splat(0);
    u = local.x / (-local.z * light->slide_x);
    v = local.y / (-local.z * light->slide_y);
    if (!(fabsf(u) <= 1 && fabsf(v) <= 1))
        return vec3_splat(0);
    if (!light->image)
        return vec3_splat(1);
    texel = texture_lookup(light->image, &slide, 0.5f + 0.5f * u, 0.5f - 0.5f * v, 0, 1);
    return vec3_make(texel.r, texel.g, texel.b);
}

int punctual_sample(const struct punctual *light, struct vec3 p, float time,
                    struct vec3 *direction, float *distance, struct vec3 *irradiance)
{
    const struct punctual_pose *pose = &light->pose;
    struct punctual_pose moved;
    float distance_squared, scale;

    if (light->motion.steps) {
        CHARGE_SCOPE(MOTION_BLUR);
        moved = pose_at(light, time);
        pose = &moved;
    }
    *irradiance = light->intensity;
    if (light->kind == LIGHT_DIRECTIONAL) {
        *direction = vec3_neg(pose->direction);
        *distance = INFINITY;
        return 1;
    }
    *direction = vec3_sub(pose->position, p);
    distance_squared = vec3_length_squared(*direction);
    if (!(distance_squared > 0) || !isfinite(distance_squared))
        return 0;
    *distance = sqrtf(distance_squared);
    *direction = vec3_scale(*direction, 1 / *distance);
    scale = range_window(*distance, light->range) / distance_squared;
    if (light->kind == LIGHT_SPOT)
        scale *= spot_window(light, -vec3_dot(pose->direction, *direction));
    *irradiance = vec3_scale(*irradiance, scale);
    if (light->kind == LIGHT_GONIOMETRIC || light->kind == LIGHT_PROJECTION) {
        *irradiance = vec3_mul(*irradiance, image_filter(light, pose->axis, vec3_neg(*direction)));
        return vec3_max(*irradiance) > 0 && vec3_is_finite(*irradiance);
    }
    return scale > 0 && isfinite(scale);
}
