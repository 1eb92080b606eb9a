#include "tests/support/unbiased.h"

#include <assert.h>
#include <string.h>

#include "tests/support/imported.h"

const char *const unbiased_names[UNBIASED_WAYS] = {
    "right", "own samples", "other's all samples", "ended group grows", "joined by counts",
};

static double joined(const struct replay *r, uint32_t *const passes[RECORD_GROUPS], uint32_t tile, int by_counts)
{
    double sum = 0, weights = 0;

    for (int g = 0; g < RECORD_GROUPS; g++) {
        double weight = by_counts ? pass_samples(passes[g][tile]) : 1;
        sum += weight * r->mean[g][passes[g][tile]][tile];
        weights += weight;
    }
    return sum / weights;
}

static void add_way(struct unbiased_way *way, const struct replay *r, uint32_t *const passes[RECORD_GROUPS],
                    int by_counts)
{
    uint32_t all[RECORD_GROUPS][UNBIASED_TILES_MAX];
    double frame = 0, samples = 0;

    for (uint32_t t = 0; t < r->tiles; t++)
        all[0][t] = all[1][t] = r->passes;
    for (uint32_t t = 0; t < r->tiles; t++) {
        double difference = joined(r, passes, t, by_counts) - joined(r, (uint32_t *[2]){all[0], all[1]}, t, 0);
        running_stats_add(&way->tiles[t], difference);
        frame += difference / r->tiles;
        for (int g = 0; g < RECORD_GROUPS; g++)
            samples += pass_samples(passes[g][t]) / (2.0 * r->tiles);
    }
    running_stats_add(&way->frame, frame);
    running_stats_add(&way->samples, samples);
}

static double uniform_mean(const struct replay *r)
{
    double sum = 0;

    for (uint32_t t = 0; t < r->tiles; t++)
        for (int g = 0; g < RECORD_GROUPS; g++)
            sum += r->mean[g][r->passes][t];
    return sum / (RECORD_GROUPS * r->tiles);
}

void unbiased_measure(const struct unbiased_study *study, struct unbiased_result *out)
{
    struct render_settings settings = imported_settings(study->width, study->height, 2 * study->samples);
    uint32_t first[UNBIASED_TILES_MAX], second[UNBIASED_TILES_MAX];
    uint32_t *const passes[RECORD_GROUPS] = {first, second};
    struct import_result import;
    struct render_scene *scene;

    memset(out, 0, sizeof *out);
    out->tests = tile_count(study->width, study->height);
    out->tests += out->tests > 1; /* one tile is the frame */
    assert(out->tests <= 1 + UNBIASED_TILES_MAX && study->width % TILE_SIZE == 0 && study->height % TILE_SIZE == 0);
    imported_file(study->path, &import);
    render_force_general(1);
    scene = imported_build(&import, &settings, 0);
    for (uint32_t s = 0; s < study->seeds; s++) {
        struct replay replay;
        replay_render(&replay, scene, &settings, study->first_seed + s, study->samples);
        for (int way = 0; way < UNBIASED_WAYS; way++) {
            int by_counts = way == UNBIASED_BY_COUNTS;
            replay_rounds(&replay, NULL, &study->target, study->last_level,
                          by_counts ? REPLAY_RIGHT : (enum replay_fault)way, passes);
            add_way(&out->ways[way], &replay, passes, by_counts);
        }
        running_stats_add(&out->uniform, uniform_mean(&replay));
        replay_release(&replay);
    }
    render_scene_free(scene);
    import_result_release(&import);
    render_force_general(0);
}

double unbiased_p_value(const struct unbiased_result *result, int way)
{
    double least = mean_test_p_value(&result->ways[way].frame, 0);

    for (uint32_t t = 0; t < result->tests - 1; t++) {
        double p = mean_test_p_value(&result->ways[way].tiles[t], 0);
        if (p < least)
            least = p;
    }
    return least;
}
