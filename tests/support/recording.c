#include "tests/support/recording.h"

#include <string.h>

#include "common/system/clock.h"
#include "worker/render/path/path.h"
#include "worker/render/render_scene.h"

void record_pass_range(uint32_t index, uint32_t *begin, uint32_t *end)
{
    *begin = pass_samples(index);
    *end = pass_samples(index + 1);
}

static void keep_tail(struct record_unit *unit, float luminance, uint32_t pixel)
{
    uint32_t at = unit->head.tail_count;

    if (!(luminance > 0) || (at == RECORD_TAIL_MAX && luminance <= unit->tail[RECORD_TAIL_MAX - 1].luminance))
        return;
    if (at < RECORD_TAIL_MAX)
        unit->head.tail_count++;
    else
        at--;
    for (; at > 0 && unit->tail[at - 1].luminance < luminance; at--)
        unit->tail[at] = unit->tail[at - 1];
    unit->tail[at] = (struct record_tail){luminance, (uint16_t)pixel, 0};
}

/* One pixel's samples by the general kernel, which has the bits of every other. This is the one
 * place that knows how a group's samples are asked of the renderer. */
static void render_pixel(const struct render_scene *scene, uint32_t frame, uint32_t x, uint32_t y, uint32_t index,
                         struct record_unit *unit, struct render_stats *stats)
{
    struct camera_cone cone = camera_cone(&scene->camera);
    double sum[3] = {0};
    uint64_t before = stats->work.subject_samples;

    for (uint32_t j = unit->head.begin; j < unit->head.end; j++) {
        struct sampler sampler;
        struct ray ray;
        struct vec3 radiance;
        sampler_start(&sampler, unit->head.seed, frame, x, y, unit->head.group, j);
        camera_ray(&scene->camera, x, y, &sampler, &ray);
        radiance = path_radiance(scene, &sampler, &ray, cone, NULL, stats);
        if (!vec3_is_finite(radiance)) {
            stats->work.dropped_samples++;
            continue;
        }
        sum[0] += (double)radiance.x;
        sum[1] += (double)radiance.y;
        sum[2] += (double)radiance.z;
        keep_tail(unit, 0.2126f * radiance.x + 0.7152f * radiance.y + 0.0722f * radiance.z, index);
    }
    for (uint32_t c = 0; c < 3; c++)
        unit->sums[index * 3 + c] = (float)sum[c];
    unit->subject[index] = (uint32_t)(stats->work.subject_samples - before);
}

void record_render(const struct render_scene *scene, const struct render_settings *settings, uint32_t seed,
                   uint32_t frame, uint32_t tile, uint32_t group, uint32_t begin, uint32_t end, struct record_unit *out)
{
    struct tile_rect rect = tile_rect_of(settings->width, settings->height, tile);
    uint64_t start = clock_thread_cpu_ns();
    struct render_stats stats = {0};

    memset(&out->head, 0, sizeof out->head);
    out->head.seed = seed;
    out->head.tile = tile;
    out->head.group = group;
    out->head.begin = begin;
    out->head.end = end;
    out->head.pixels = rect.width * rect.height;
    for (uint32_t i = 0; i < out->head.pixels; i++)
        render_pixel(scene, frame, rect.x + i % rect.width, rect.y + i / rect.width, i, out, &stats);
    out->head.rays = stats.work.rays;
    out->head.dropped = stats.work.dropped_samples;
    out->head.cpu_ns = clock_thread_cpu_ns() - start;
}
