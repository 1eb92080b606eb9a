#include "tests/support/groups.h"

#include <string.h>

#include "common/film/tiles.h"

/* The sums of one group on a tile: [pixel][3]. */
static void group_sums(const struct render_scene *scene, const struct render_settings *settings, uint32_t frame,
                       uint32_t tile, uint32_t group, double *sums, struct render_stats *stats)
{
    memset(sums, 0, TILE_FLOATS_MAX * sizeof *sums);
    for (uint32_t p = 0; p < pass_count(settings->spp, group); p++) {
        float part[TILE_FLOATS_MAX];
        size_t n = render_tile(scene, frame, tile, group, p, part, NULL, stats);
        for (size_t i = 0; i < n; i++)
            sums[i] += (double)part[i];
    }
}

void groups_render_apart(const struct render_scene *scene, const struct render_settings *settings, uint32_t frame,
                         double *mean, double *apart, struct render_stats *stats)
{
    static double sums[GROUPS][TILE_FLOATS_MAX];
    const int both = group_samples(settings->spp, 1) > 0;

    for (uint32_t t = 0; t < tile_count(settings->width, settings->height); t++) {
        struct tile_rect rect = tile_rect_of(settings->width, settings->height, t);
        for (uint32_t g = 0; g < GROUPS; g++)
            group_sums(scene, settings, frame, t, g, sums[g], stats);
        for (size_t i = 0; i < (size_t)rect.width * rect.height * 3; i++) {
            size_t x = rect.x + i / 3 % rect.width, y = rect.y + i / 3 / rect.width;
            size_t at = (y * settings->width + x) * 3 + i % 3;
            double a = sums[0][i] / group_samples(settings->spp, 0);
            double b = both ? sums[1][i] / group_samples(settings->spp, 1) : a;
            mean[at] = (a + b) / 2;
            if (apart)
                apart[at] = (a - b) / 2;
        }
    }
}

void groups_render(const struct render_scene *scene, const struct render_settings *settings, uint32_t frame,
                   double *mean, double *variance, struct render_stats *stats)
{
    groups_render_apart(scene, settings, frame, mean, variance, stats);
    for (size_t i = 0; variance && i < (size_t)settings->width * settings->height * 3; i++)
        variance[i] *= variance[i];
}
