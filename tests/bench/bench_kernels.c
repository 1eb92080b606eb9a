/* bench_kernels: what a kernel that holds only a scene's effects gains on the general one.
 *
 *   bench_kernels SCENE [--env FILE] [--size WxH] [--spp N] [--rounds N] [--frame N]
 *                 [--shutter S] [--max-depth N] [--isa ISA] [--json]
 *
 * Builds the scene twice, once for each kernel, in one thread of one process, and renders every
 * tile with both, one right after the other and each first in turn, so that what else the
 * machine does slows both alike. A round is the whole picture. Prints the medians over the
 * rounds, and fails if a bit differs. Time is the thread's CPU time.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/import/import.h"
#include "common/system/clock.h"
#include "common/cli/options.h"
#include "common/film/tiles.h"
#include "common/scene/effects.h"
#include "tests/support/imported.h"
#include "worker/render/render.h"

enum { KINDS = 2, ROUNDS_MAX = 999 };
enum { SPECIAL, GENERAL };

struct rounds {
    double ns_per_sample[KINDS][ROUNDS_MAX], ratio[ROUNDS_MAX];
    int count;
};

static void die(const struct error *err)
{
    fprintf(stderr, "bench_kernels: %s\n", err->text);
    exit(status_exit_code(err->code));
}

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

static double median(const double *values, int count)
{
    double sorted[ROUNDS_MAX];

    memcpy(sorted, values, (size_t)count * sizeof *sorted);
    qsort(sorted, (size_t)count, sizeof *sorted, by_value);
    return count % 2 ? sorted[count / 2] : (sorted[count / 2 - 1] + sorted[count / 2]) / 2;
}

/* Bounds of the median that hold with 95 % whatever the distribution: order statistics at
 * count/2 -+ 0.98 sqrt(count), by the normal approximation of the binomial. */
static void median_bounds(const double *values, int count, double *low, double *high)
{
    double sorted[ROUNDS_MAX];
    int half = (int)ceil(0.98 * sqrt(count)), first = count / 2 - half;

    memcpy(sorted, values, (size_t)count * sizeof *sorted);
    qsort(sorted, (size_t)count, sizeof *sorted, by_value);
    *low = sorted[first < 0 ? 0 : first];
    *high = sorted[first < 0 ? count - 1 : count - 1 - first];
}

/* One round: CPU nanoseconds of each kernel over the whole picture. */
static void run_round(struct render_scene *const scenes[KINDS], const struct render_settings *settings, uint32_t frame,
                      int round, struct rounds *out)
{
    static float sums[KINDS][TILE_FLOATS_MAX];
    struct render_stats stats[KINDS] = {0};
    uint64_t ns[KINDS] = {0};
    uint32_t tiles = tile_count(settings->width, settings->height);

    for (uint32_t tile = 0; tile < tiles; tile++)
        for (uint32_t unit = 0; unit < GROUPS * pass_count(settings->spp, 0); unit++) {
            uint32_t group = unit % GROUPS, pass = unit / GROUPS;
            size_t floats[KINDS];
            if (pass >= pass_count(settings->spp, group))
                continue;
            for (int i = 0; i < KINDS; i++) {
                int kind = (i + round + 1 + (int)tile) % KINDS;
                uint64_t start = clock_thread_cpu_ns();
                floats[kind] = render_tile(scenes[kind], frame, tile, group, pass, sums[kind], NULL, &stats[kind]);
                ns[kind] += clock_thread_cpu_ns() - start;
            }
            if (floats[SPECIAL] != floats[GENERAL] ||
                memcmp(sums[SPECIAL], sums[GENERAL], floats[GENERAL] * sizeof(float)) != 0) {
                fprintf(stderr, "bench_kernels: the kernels' results differ at tile %u, pass %u\n",
                        tile, pass);
                exit(1);
            }
        }
    if (round < 0)
        return; /* that one was for the caches */
    for (int kind = 0; kind < KINDS; kind++)
        out->ns_per_sample[kind][out->count] = (double)ns[kind] / (double)stats[kind].work.samples;
    out->ratio[out->count++] = (double)ns[SPECIAL] / (double)ns[GENERAL];
}

int main(int argc, char **argv)
{
    const char *env = NULL, *size = "128x128", *isa = "avx2";
    int64_t spp = 16, rounds = 15, depth = 12, frame = 0;
    double shutter = 0, low, high, middle;
    int json = 0, help = 0;
    const struct option table[] = {
        {"env", 0, OPTION_STRING, &env, "FILE", "environment map", 0, 0, NULL},
        {"size", 0, OPTION_STRING, &size, "WxH", "pixels", 0, 0, NULL},
        {"spp", 0, OPTION_INT, &spp, "N", "samples a pixel", 1, 4096, NULL},
        {"rounds", 0, OPTION_INT, &rounds, "N", "pictures by each", 1, ROUNDS_MAX, NULL},
        {"max-depth", 0, OPTION_INT, &depth, "N", "path depth", 0, SETTINGS_DEPTH_MAX, NULL},
        {"isa", 0, OPTION_CHOICE, &isa, "ISA", "Embree's instruction set", 0, 0,
         "sse2|avx2|avx512"},
        {"frame", 0, OPTION_INT, &frame, "N", "of an animation", 0, SETTINGS_FRAMES_MAX, NULL},
        {"shutter", 0, OPTION_REAL, &shutter, "S", "share of the frame's time", 0, 1, NULL},
        {"json", 0, OPTION_FLAG, &json, NULL, "one line of JSON", 0, 0, NULL},
        {0},
    };
    static struct rounds measured;
    struct import_options how = IMPORT_OPTIONS_DEFAULT;
    struct render_scene *scenes[KINDS];
    struct render_settings settings;
    struct import_result import;
    struct positionals rest;
    struct error err = {0};
    unsigned width, height;

    if (options_parse(table, argc, argv, &rest, &help, &err) != STATUS_OK)
        die(&err);
    if (help || rest.count != 1 || sscanf(size, "%ux%u", &width, &height) != 2) {
        options_print_help("bench_kernels SCENE [options]", "Times a scene's kernel against the general one.", table);
        return help ? 0 : 2;
    }
    how.env_path = env;
    if (import_scene(rest.items[0], &how, &import, &err) != STATUS_OK)
        die(&err);
    render_settings_default(&settings);
    settings.width = width;
    settings.height = height;
    settings.spp = (uint32_t)spp;
    settings.max_depth = (uint32_t)depth;
    settings.isa = (enum isa)isa_parse(isa);
    settings.shutter = (float)shutter;
    for (int kind = 0; kind < KINDS; kind++) {
        render_force_general(kind == GENERAL);
        if (render_scene_new(&scenes[kind], &import.scene, &settings, (uint32_t)frame, imported_source(&import),
                             &err) != STATUS_OK)
            die(&err);
    }
    for (int round = -1; round < rounds; round++)
        run_round(scenes, &settings, (uint32_t)frame, round, &measured);
    middle = median(measured.ratio, measured.count);
    median_bounds(measured.ratio, measured.count, &low, &high);
    printf(json ? "{\"kernel\": \"%s\", \"ns\": %.1f, \"general_ns\": %.1f, \"ratio\": %.4f, "
                  "\"low\": %.4f, \"high\": %.4f, \"rounds\": %d}\n"
                : "kernel %s: %.1f ns a sample, general %.1f ns: %.4f of its time (%.4f to %.4f, "
                  "%d rounds)\n",
           render_kernel_variant(scenes[SPECIAL]), median(measured.ns_per_sample[SPECIAL], measured.count),
           median(measured.ns_per_sample[GENERAL], measured.count), middle, low, high, measured.count);
    for (int kind = 0; kind < KINDS; kind++)
        render_scene_free(scenes[kind]);
    import_result_release(&import);
    return 0;
}
