/* bench_denoise: processor time of denoising a picture whose noise is made up, in core-seconds, and the memory beyond
 * input and output. See docs/DENOISING.md.
 *
 *   bench_denoise [--threads N] */
#include <stdio.h>
#include <stdlib.h>
#include <sys/resource.h>

#include "common/base/memory.h"
#include "common/cli/options.h"
#include "common/denoise/denoise.h"
#include "common/image/color.h"
#include "common/system/clock.h"
#include "common/system/parallel.h"
#include "tests/support/denoise_toys.h"

static status srgb_codes(void *user, const float *rgb, uint32_t width, uint32_t height, float *codes, struct error *err)
{
    (void)user;
    (void)err;
    for (size_t i = 0; i < (size_t)width * height * 3; i++)
        codes[i] = 255 * srgb_encode(rgb[i]);
    return STATUS_OK;
}

static double peak_mib(void)
{
    struct rusage usage;

    return getrusage(RUSAGE_SELF, &usage) == 0 ? (double)usage.ru_maxrss / 1024 : 0;
}

/* With the display's figures, as final pictures have them, or without, as previews. */
static void bench(uint32_t width, uint32_t height, enum denoise_method method, int figures, unsigned threads)
{
    const struct accuracy_transform srgb = {.apply = srgb_codes, .user = NULL};
    const struct denoise_options options = {.method = method, .threads = threads, .transform = figures ? &srgb : NULL};
    const double output = (double)width * height * 3 * sizeof(float) / (1024 * 1024);
    struct toy toy;
    struct toy_groups groups;
    struct denoise_result result;
    struct error err = {0};
    double before, cpu_s, wall_s;
    uint64_t cpu, wall;

    toy_make(&toy, width, height, 1);
    toy_sample(&groups, &toy, TOY_EXPONENTIAL, 8, 1);
    before = peak_mib();
    cpu = parallel_cpu_ns();
    wall = clock_monotonic_ns();
    if (denoise(&groups.input, &options, &result, &err) != STATUS_OK) {
        fprintf(stderr, "bench_denoise: %s\n", err.text);
        exit(1);
    }
    cpu_s = (double)(parallel_cpu_ns() - cpu) * 1e-9;
    wall_s = (double)(clock_monotonic_ns() - wall) * 1e-9;
    printf("%ux%u %s%s: %.2f core-seconds, %.2f s, %.0f MiB beyond input and output\n", width, height,
           method == DENOISE_FAST ? "fast" : "full", figures ? " with figures" : "", cpu_s, wall_s,
           peak_mib() - before - output);
    denoise_result_release(&result);
    toy_groups_release(&groups);
    toy_release(&toy);
}

int main(int argc, char **argv)
{
    int64_t threads = 0;
    int help = 0;
    const struct option table[] = {
        {"threads", 0, OPTION_INT, &threads, "N", "default: one for each processor", 0, PARALLEL_THREADS_MAX, NULL},
        {0},
    };
    struct positionals rest;
    struct error err = {0};

    if (options_parse(table, argc, argv, &rest, &help, &err) != STATUS_OK) {
        fprintf(stderr, "bench_denoise: %s\n", err.text);
        return 2;
    }
    if (help || rest.count) {
        options_print_help("bench_denoise [options]", "Times the denoiser.", table);
        return help ? 0 : 2;
    }
    bench(960, 540, DENOISE_FAST, 0, (unsigned)threads);
    bench(1920, 1080, DENOISE_FULL, 1, (unsigned)threads);
    return 0;
}
