#include "worker/render/camera.h"

#include "common/math/elementary.h"

/* Half the width of the filter's support, pixels. */
#define FILTER_RADIUS 1.5

/* Blackman-Harris window over -FILTER_RADIUS..FILTER_RADIUS (Harris 1978, 4 terms, -92 dB). */
static double blackman_harris(double x)
{
    double turn = (x / FILTER_RADIUS + 1) * PI_D;

    return 0.35875 - 0.48829 * (double)det_cos((float)turn) +
           0.14128 * (double)det_cos((float)(2 * turn)) -
           0.01168 * (double)det_cos((float)(3 * turn));
}

/* The table's entry i is where the left half's accumulated weight, of 1, reaches
 * (i / FILTER_TABLE_SIZE)^4: the fourth power gives the faint tail as many entries as the
 * bright middle. */
static void filter_table_fill(float table[FILTER_TABLE_SIZE + 1])
{
    enum { STEPS = 1 << 14 };
    const double step = FILTER_RADIUS / STEPS;
    double total = 0, sum = 0;
    int next = 1;

    for (int i = 0; i < STEPS; i++)
        total += blackman_harris(-FILTER_RADIUS + (i + 0.5) * step);
    table[0] = -FILTER_RADIUS;
    for (int i = 0; i < STEPS; i++) {
        double weight = blackman_harris(-FILTER_RADIUS + (i + 0.5) * step) / total;
        for (; next < FILTER_TABLE_SIZE; next++) {
            double w = (double)next / FILTER_TABLE_SIZE, target = w * w * w * w;
            if (sum + weight < target)
                break;
            table[next] = (float)(-FILTER_RADIUS + (i + (target - sum) / weight) * step);
        }
        sum += weight;
    }
    while (next <= FILTER_TABLE_SIZE)
        table[next++] = 0;
}

void camera_init(struct camera *camera, const struct scene_camera *description, uint32_t width,
                 uint32_t height)
{
    float aspect = (float)width / (float)height;

    camera->kind = description->kind;
    camera->to_world = description->to_world;
    camera->width = (float)width;
    camera->height = (float)height;
    camera->half_height = description->kind == CAMERA_PERSPECTIVE
                              ? det_tan(description->yfov_rad * 0.5f)
                              : description->ymag;
    camera->half_width = camera->half_height * aspect;
    filter_table_fill(camera->filter_offset);
}

static float filter_sample(const struct camera *camera, float u)
{
    float half = u < 0.5f ? 2 * u : 2 * (1 - u); /* 0..1, exact */
    float scaled = sqrtf(sqrtf(half)) * FILTER_TABLE_SIZE;
    int i = scaled < FILTER_TABLE_SIZE ? (int)scaled : FILTER_TABLE_SIZE - 1;
    float offset = camera->filter_offset[i] +
                   (camera->filter_offset[i + 1] - camera->filter_offset[i]) * (scaled - (float)i);

    return u < 0.5f ? offset : -offset;
}

void camera_ray(const struct camera *camera, uint32_t x, uint32_t y, const struct sampler *sampler,
                struct ray *ray)
{
    struct sample2 pixel = sampler_get(sampler, DIMENSION_PIXEL);
    float film_x = (float)x + 0.5f + filter_sample(camera, pixel.u);
    float film_y = (float)y + 0.5f + filter_sample(camera, pixel.v);
    float px = (2 * film_x / camera->width - 1) * camera->half_width;
    float py = (1 - 2 * film_y / camera->height) * camera->half_height;
    struct vec3 origin = {0, 0, 0}, direction = {px, py, -1};

    if (camera->kind == CAMERA_ORTHOGRAPHIC) {
        origin = vec3_make(px, py, 0);
        direction = vec3_make(0, 0, -1);
    }
    ray->origin = transform_point(&camera->to_world, origin);
    ray->direction = vec3_normalize(transform_vector(&camera->to_world, direction));
    ray->t_max = INFINITY;
    ray->time = 0;
}
