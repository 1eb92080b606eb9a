#include "worker/render/light/punctual.h"

#include <string.h>

#include "common/math/elementary.h"

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

static struct vec3 column(const struct transform *t, int c)
{
    return vec3_normalize(vec3_make(t->m[0][c], t->m[1][c], t->m[2][c]));
}

void punctual_init(struct punctual *p, const struct scene_light *light,
                   const struct texture_image *image)
{
    memset(p, 0, sizeof *p);
    p->kind = light->kind;
    p->falloff = light->falloff;
    p->position = vec3_of(light->position);
    p->direction = vec3_of(light->direction);
    p->intensity = vec3_of(light->intensity);
    p->range = light->range;
    if (light->kind == LIGHT_SPOT) {
        p->cos_inner = det_cos(light->inner_cone_rad);
        p->cos_outer = det_cos(light->outer_cone_rad);
    }
    if (light->kind != LIGHT_GONIOMETRIC && light->kind != LIGHT_PROJECTION)
        return;
    p->image = image;
    for (int c = 0; c < 3; c++)
        p->axis[c] = column(&light->to_world, c);
    if (light->kind == LIGHT_PROJECTION) {
        p->direction = vec3_neg(p->axis[2]);
        p->slide_y = det_tan(0.5f * light->projection_yfov_rad);
        p->slide_x = p->slide_y * light->projection_aspect;
    }
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

void punctual_bounds(const struct punctual *p, struct light_bounds *out)
{
    memset(out, 0, sizeof *out);
    out->min = out->max = p->position;
    out->axis = vec3_make(0, 0, 1);
    out->spread_rad = PI_F;
    out->emission_rad = PI_F / 2;
    out->reach = p->range > 0 ? p->range : INFINITY;
    out->intensity = (float)((double)vec3_luminance(p->intensity) * image_mean(p));
    if (p->kind == LIGHT_SPOT) {
        out->axis = p->direction;
        out->spread_rad = det_acos(p->cos_inner);
        out->emission_rad = float_max(0, det_acos(p->cos_outer) - out->spread_rad);
    } else if (p->kind == LIGHT_PROJECTION) {
        out->axis = p->direction;
        out->spread_rad =
            det_atan2(sqrtf(p->slide_x * p->slide_x + p->slide_y * p->slide_y), 1);
        out->emission_rad = 0;
    }
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
static struct vec3 image_filter(const struct punctual *light, struct vec3 d)
{
    struct vec3 local = vec3_make(vec3_dot(d, light->axis[0]), vec3_dot(d, light->axis[1]),
                                  vec3_dot(d, light->axis[2]));
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

int punctual_sample(const struct punctual *light, struct vec3 p, struct vec3 *direction,
                    float *distance, struct vec3 *irradiance)
{
    float distance_squared, scale;

    *irradiance = light->intensity;
    if (light->kind == LIGHT_DIRECTIONAL) {
        *direction = vec3_neg(light->direction);
        *distance = INFINITY;
        return 1;
    }
    *direction = vec3_sub(light->position, p);
    distance_squared = vec3_length_squared(*direction);
    if (!(distance_squared > 0) || !isfinite(distance_squared))
        return 0;
    *distance = sqrtf(distance_squared);
    *direction = vec3_scale(*direction, 1 / *distance);
    scale = range_window(*distance, light->range) / distance_squared;
    if (light->kind == LIGHT_SPOT)
        scale *= spot_window(light, -vec3_dot(light->direction, *direction));
    *irradiance = vec3_scale(*irradiance, scale);
    if (light->kind == LIGHT_GONIOMETRIC || light->kind == LIGHT_PROJECTION) {
        *irradiance = vec3_mul(*irradiance, image_filter(light, vec3_neg(*direction)));
        return vec3_max(*irradiance) > 0 && vec3_is_finite(*irradiance);
    }
    return scale > 0 && isfinite(scale);
}
