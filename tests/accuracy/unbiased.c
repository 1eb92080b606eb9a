/* unbiased: adaptive pictures against uniform ones, over many seeds of hard scenes.
 *
 *   unbiased SCENE [--seeds N] [--samples N] [--last-level N] [--psnr X | --rmse X]
 *            [--size WxH] [--first-seed N]
 *
 * Prints for the right procedure and for each wrong one how much light the adaptive pictures have
 * more than the uniform ones. Ends with status 1 if the right one is off. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "common/cli/options.h"
#include "tests/support/unbiased.h"

int main(int argc, char **argv)
{
    int64_t seeds = 200, samples = 64, level = 3, first = 1;
    double psnr = 0, rmse = 0;
    int help = 0;
    const char *size = "32x32";
    const struct option table[] = {
        {"size", 0, OPTION_STRING, &size, "WxH", "pixels, multiples of 16; default: 32x32", 0, 0, NULL},
        {"seeds", 0, OPTION_INT, &seeds, "N", "how many", 2, 1000000, NULL},
        {"first-seed", 0, OPTION_INT, &first, "N", "the first of them", 0, 1000000, NULL},
        {"samples", 0, OPTION_INT, &samples, "N", "of a group, at most", 2, 8192, NULL},
        {"last-level", 0, OPTION_INT, &level, "N", "the last round", 0, 11, NULL},
        {"psnr", 0, OPTION_REAL, &psnr, "DB", "the target", 0, 200, NULL},
        {"rmse", 0, OPTION_REAL, &rmse, "PERCENT", "the target, instead", 0, 1e6, NULL},
        {0},
    };
    struct positionals rest;
    struct error err = {0};
    struct unbiased_study study = {0};
    struct unbiased_result result;

    if (options_parse(table, argc, argv, &rest, &help, &err) != STATUS_OK || help || rest.count != 1 ||
        sscanf(size, "%ux%u", &study.width, &study.height) != 2) {
        options_print_help("unbiased SCENE [options]", "Tests that adaptive pictures are unbiased.", table);
        return help ? 0 : 2;
    }
    study.path = rest.items[0];
    study.samples = (uint32_t)samples;
    study.last_level = (uint32_t)level;
    study.target = rmse > 0 ? (struct allocation_target){ALLOCATION_RMSE, rmse}
                            : (struct allocation_target){ALLOCATION_PSNR, psnr};
    study.first_seed = (uint32_t)first;
    study.seeds = (uint32_t)seeds;
    unbiased_measure(&study, &result);
    for (int way = 0; way < UNBIASED_WAYS; way++) {
        const struct unbiased_way *w = &result.ways[way];
        printf("%-22s frame %+.2f +- %.2f %%, least p %.2g (at 1 %%, %u tests: %.2g), samples %.1f +- %.1f\n",
               unbiased_names[way], 100 * w->frame.mean / result.uniform.mean,
               100 * running_stats_error(&w->frame) / result.uniform.mean, unbiased_p_value(&result, way), result.tests,
               sidak_alpha(0.01, result.tests), w->samples.mean, sqrt(running_stats_variance(&w->samples)));
    }
    return unbiased_p_value(&result, 0) < sidak_alpha(0.01, result.tests);
}
