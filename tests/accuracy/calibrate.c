/* calibrate: the figures of many seeds' pictures against the truth, one line of CSV for each seed and
 * number of samples; tests/accuracy/accuracy.py makes tables and plots of it.
 *
 *   calibrate SCENE [--size WxH] [--seeds N] [--levels N] [--reference-seeds N]
 *             [--reference-spp N] [--cache FILE]
 *
 * The truth of a seed is the mean of the reference and of all other seeds. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/options.h"
#include "tests/support/calibration.h"
#include "tests/support/judge.h"

static _Noreturn void die(const char *text)
{
    fprintf(stderr, "calibrate: %s\n", text);
    exit(2);
}

static void print_row(const char *scene, uint32_t seed, uint32_t spp, const struct judgement *j)
{
    const struct accuracy_figures *f = &j->figures;

    printf("%s,%u,%u,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.6g,%.6g,%.6g,%.6g,%d,%u,%.9g\n",
           scene, seed, spp, f->display_error, f->display_lo, f->display_hi, j->true_display,
           f->rmse_percent, f->rmse_lo, f->rmse_hi, j->true_rmse, f->psnr_db, j->true_psnr,
           f->top_share, f->disagreement, f->unseen, f->tail_index, f->reliable, f->reasons,
           j->cpu_s);
}

int main(int argc, char **argv)
{
    const char *size_text = "64x64", *cache = NULL, *name = "", *slash;
    int64_t seeds = 20, levels = 7, reference_seeds = 2, reference_spp = 2048;
    int help = 0, header = 0;
    const struct option table[] = {
        {"size", 0, OPTION_STRING, &size_text, "WxH", "pixels; default: 64x64", 0, 0, NULL},
        {"seeds", 0, OPTION_INT, &seeds, "N", "pictures; default: 20", 2, 1000, NULL},
        {"levels", 0, OPTION_INT, &levels, "N", "4, 8, ... samples of a pixel; default: 7, to 256", 1,
         CALIBRATION_LEVELS_MAX, NULL},
        {"reference-seeds", 0, OPTION_INT, &reference_seeds, "N", "of the reference; default: 2", 1, 64, NULL},
        {"reference-spp", 0, OPTION_INT, &reference_spp, "N", "samples of each; default: 2048", 4, 65536, NULL},
        {"cache", 0, OPTION_STRING, &cache, "FILE", "keep the pictures here", 0, 0, NULL},
        {"header", 0, OPTION_FLAG, &header, NULL, "print the columns' names and end", 0, 0, NULL},
        {0},
    };
    struct calibration c;
    struct calibration_size size = {.first_seed = 1};
    struct positionals rest;
    struct error err = {0};

    if (options_parse(table, argc, argv, &rest, &help, &err) != STATUS_OK)
        die(err.text);
    if (header) {
        puts("scene,seed,spp,display,display_lo,display_hi,display_true,rmse,rmse_lo,rmse_hi,rmse_true,"
             "psnr,psnr_true,top_share,disagreement,unseen,tail_index,reliable,reasons,cpu_s");
        return 0;
    }
    if (help || rest.count != 1 || sscanf(size_text, "%ux%u", &size.width, &size.height) != 2) {
        options_print_help("calibrate SCENE [options]", "Figures against truth.", table);
        return help ? 0 : 2;
    }
    size.seeds = (uint32_t)seeds;
    size.levels = (uint32_t)levels;
    size.reference_seeds = (uint32_t)reference_seeds;
    size.reference_spp = (uint32_t)reference_spp;
    if (!cache || !calibration_load(&c, cache, &size)) {
        calibration_render(&c, rest.items[0], &size);
        if (cache)
            calibration_save(&c, cache, &size);
    }
    calibration_describe(&c, rest.items[0]);
    slash = strrchr(rest.items[0], '/');
    name = slash ? slash + 1 : rest.items[0];
    for (uint32_t s = 0; s < c.seeds; s++)
        for (uint32_t level = 0; level < c.levels; level++) {
            struct judgement j;
            judge(&j, &c, s, level);
            print_row(name, s, calibration_spp(level), &j);
        }
    calibration_release(&c);
    return 0;
}
