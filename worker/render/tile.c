/* tile: the one pixel loop. */
#include <float.h>

#include "worker/render/path.h"
#include "worker/render/render.h"
#include "worker/render/world.h"

size_t render_tile(const struct render_scene *scene, uint32_t frame, uint32_t tile, uint32_t pass,
                   float *sums, struct render_stats *stats)
{
    const struct render_settings *settings = &scene->settings;
    struct tile_rect rect = tile_rect_of(settings->width, settings->height, tile);
    size_t pixels = (size_t)rect.width * rect.height, index = 0;
    uint32_t begin, end;

    pass_range(settings->spp, pass, &begin, &end);
    for (uint32_t y = rect.y; y < rect.y + rect.height; y++)
        for (uint32_t x = rect.x; x < rect.x + rect.width; x++, index++) {
            double sum[REPLICATES][3] = {{0}};
            for (uint32_t i = begin; i < end; i++) {
                struct sampler sampler;
                struct vec3 radiance;
                struct ray ray;
                sampler_start(&sampler, settings->seed, frame, x, y, i);
                camera_ray(&scene->camera, x, y, &sampler, &ray);
                radiance = path_radiance(scene, &sampler, ray, stats);
                stats->samples++;
                if (!vec3_is_finite(radiance)) {
                    stats->dropped_samples++;
                    continue;
                }
                sum[i % REPLICATES][0] += (double)radiance.x;
                sum[i % REPLICATES][1] += (double)radiance.y;
                sum[i % REPLICATES][2] += (double)radiance.z;
            }
            for (int r = 0; r < REPLICATES; r++)
                for (int c = 0; c < 3; c++)
                    sums[((size_t)r * pixels + index) * 3 + (size_t)c] = (float)(sum[r][c] < FLT_MAX ? sum[r][c] : FLT_MAX);
        }
    return REPLICATES * pixels * 3;
}
