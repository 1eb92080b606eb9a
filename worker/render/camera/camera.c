#include "worker/render/camera/camera.h"

#include "common/math/elementary.h"

static real camera_filter_sample(const struct camera *camera, real u)
{
    real half = real_min(2 * u, 2 * (1 - u)); /* 0..1, exact */
    real scaled = real_sqrt(real_sqrt(half)) * FILTER_TABLE_SIZE;
    int i = scaled < FILTER_TABLE_SIZE ? (int)scaled : FILTER_TABLE_SIZE - 1;
    real offset =
        camera->filter_offset[i] + (camera->filter_offset[i + 1] - camera->filter_offset[i]) * (scaled - (real)i);

    /* -offset from 1/2 on; a branch would be mispredicted every other time. */
    return real_flip(offset, u >= 0.5f);
}

/* Uniform on the aperture. Shirley and Chiu's concentric map (1997) gives a radius and an angle on the disc. Within
 * each blade's sector the fraction of the angle then becomes the position along the blade's edge: (r, s) -> r ((1 - s)
 * corner_k + s corner_k+1). Its Jacobian is r dr ds times a constant, twice the triangle's area, and neighbouring
 * sectors share a radius, so the polygon is covered uniformly and without gaps. */
static void camera_lens_sample(const struct camera *camera, struct sample2 at, real lens[2])
{
    real a = 2 * at.u - 1, b = 2 * at.v - 1, radius, turn, x = 1, y = 0, sine, cosine, angle;

    if (a * a > b * b) {
        radius = real_abs(a);
        turn = 0.125f * (b / a) + (a < 0 ? 0.5f : 0.0f);
    } else {
        radius = real_abs(b);
        turn = b == 0 ? 0.0f : (b < 0 ? 0.75f : 0.25f) - 0.125f * (a / b);
    }
    if (turn < 0)
        turn += 1; /* -1/8..0 */
    angle = turn * (2 * REAL_PI);
    if (camera->blades) {
        real blades = (real)camera->blades, scaled = turn * blades, blade = real_floor(scaled), s;
        if (blade > blades - 1)
            blade = blades - 1;
        s = scaled - blade;
        x = 1 - s + s * camera->blade_cosine;
        y = s * camera->blade_sine;
        angle = blade * (2 * REAL_PI / blades) + camera->blade_rotation_rad;
    }
    real_sincos(angle, &sine, &cosine);
    radius *= camera->lens_radius;
    lens[0] = radius * (x * cosine - y * sine);
    lens[1] = radius * (x * sine + y * cosine);
}

/* Lat-long: -Z in the middle, +X to its right, +Y at the top. The filter may reach past a pole or
 * the seam: sine and cosine continue correctly there. */
static struct vec3 camera_panorama_direction(real film_x, real film_y, real width, real height)
{
    real longitude = (film_x / width - 0.5f) * (2 * REAL_PI);
    real latitude = (0.5f - film_y / height) * REAL_PI;
    real sin_a, cos_a, sin_b, cos_b;

    real_sincos(longitude, &sin_a, &cos_a);
    real_sincos(latitude, &sin_b, &cos_b);
    return vec3_make(sin_a * cos_b, sin_b, -cos_a * cos_b);
}

/* A ray without end from a place in the world, its direction from camera space. */
static inline void camera_place(const struct transform *to_world, struct vec3 origin, struct vec3 direction, real time,
                                struct ray *ray)
{
    ray->origin = origin;
    ray->direction = vec3_normalize(transform_vector(to_world, direction));
    ray->t_max = INFINITY;
    ray->time = time;
    ray->rest[0] = ray->rest[1] = ray->rest[2] = 0;
    ray->left_count = 0;
    ray->reaches = 0;
}

/* Every camera except a pinhole that does not move. (px, py): the point on the image plane. */
static __attribute__((noinline)) void camera_ray_any(const struct camera *camera, real film_x, real film_y, real px,
                                                     real py, const struct sampler *sampler, struct ray *ray)
{
    struct transform to_world = camera->to_world;
    struct vec3 origin = {0, 0, 0}, direction = {px, py, -1};
    real time = 0;

    if (camera->kind == CAMERA_ORTHOGRAPHIC) {
        origin = vec3_make(px, py, 0);
        direction = vec3_make(0, 0, -1);
    } else if (camera->kind == CAMERA_PANORAMA) {
        direction = camera_panorama_direction(film_x, film_y, camera->width, camera->height);
    }
    if (camera->lens_radius > 0) {
        /* All rays of one film position meet in the plane of focus. */
        struct vec3 sharp = vec3_mad(origin, direction, camera->focus_distance);
        real lens[2];
        camera_lens_sample(camera, sampler_get(sampler, DIMENSION_LENS), lens);
        origin.x += lens[0];
        origin.y += lens[1];
        direction = vec3_sub(sharp, origin);
    }
    if (camera->shutter_open) {
        time = sampler_get(sampler, DIMENSION_TIME).u;
        to_world = camera_to_world_at(camera, time);
    }
    camera_place(&to_world, transform_point(&to_world, origin), direction, time, ray);
}

void camera_ray(const struct camera *camera, uint32_t x, uint32_t y, const struct sampler *sampler, struct ray *ray)
{
    struct sample2 pixel = sampler_get(sampler, DIMENSION_PIXEL);
    real film_x = (real)x + 0.5f + camera_filter_sample(camera, pixel.u);
    real film_y = (real)y + 0.5f + camera_filter_sample(camera, pixel.v);
    real px = (2 * film_x / camera->width - 1) * camera->half_width;
    real py = (1 - 2 * film_y / camera->height) * camera->half_height;
    const real(*m)[4] = camera->to_world.m;

    if (camera->pinhole)
        camera_place(&camera->to_world, vec3_make(m[0][3], m[1][3], m[2][3]), vec3_make(px, py, -1), 0, ray);
    else
        camera_ray_any(camera, film_x, film_y, px, py, sampler, ray);
}
