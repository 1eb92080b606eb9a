#include "tests/support/replicates.h"

#include <string.h>

#include "common/film/tiles.h"

/* The sums of one group on a tile: [replicate][pixel][3]. */
static void group_sums(const struct render_scene *scene, const struct render_settings *settings,
                       uint32_t frame, uint32_t tile, uint32_t group, double *sums,
                       struct render_stats *stats)
{
    memset(sums, 0, TILE_FLOATS_MAX * sizeof *sums);
    for (uint32_t p = 0; p < pass_count(settings->spp, group); p++) {
        float part[TILE_FLOATS_MAX];
        size_t n = render_tile(scene, frame, tile, group, p, part, NULL, stats);
        for (size_t i = 0; i < n; i++)
            sums[i] += (double)part[i];
    }
}

void replicates_render(const struct render_scene *scene, const struct render_settings *settings,
                       uint32_t frame, double *mean, double *variance, struct render_stats *stats)
{
    uint32_t tiles = tile_count(settings->width, settings->height);
    size_t values = (size_t)settings->width * settings->height * 3;

    memset(mean, 0, values * sizeof *mean);
    if (variance)
        memset(variance, 0, values * sizeof *variance);
    for (uint32_t t = 0; t < tiles * GROUPS; t++) {
        uint32_t group = t % GROUPS, samples = group_samples(settings->spp, group);
        struct tile_rect rect = tile_rect_of(settings->width, settings->height, t / GROUPS);
        size_t pixels = (size_t)rect.width * rect.height;
        double weight = group_samples(settings->spp, 1) > 0 ? 1.0 / GROUPS : 1;
        static double sums[TILE_FLOATS_MAX];
        if (samples == 0)
            continue;
        group_sums(scene, settings, frame, t / GROUPS, group, sums, stats);
        for (size_t i = 0; i < pixels * 3; i++) {
            size_t x = rect.x + i / 3 % rect.width, y = rect.y + i / 3 / rect.width;
            size_t at = (y * settings->width + x) * 3 + i % 3;
            double a = sums[i], b = sums[pixels * 3 + i];
            mean[at] += weight * (a + b) / samples;
            if (variance && samples > 1) {
                double difference =
                    a / replicate_samples(samples, 0) - b / replicate_samples(samples, 1);
                variance[at] += weight * weight * difference * difference / 4;
            }
        }
    }
}
