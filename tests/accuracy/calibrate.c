/* calibrate: the figures of many seeds' pictures against the truth, one line of CSV for each seed and
 * number of samples; tests/accuracy/accuracy.py makes tables and plots of it.
 *
 *   calibrate SCENE [--size WxH] [--seeds N] [--levels N] [--reference-seeds N]
 *             [--reference-spp N] [--cache FILE] [--env FILE] [--tonemap OPERATOR]
 *
 * The truth of a seed is the mean of the reference and of all other seeds. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/options/tonemap_options.h"
#include "common/accuracy/curve.h"
#include "common/base/memory.h"
#include "common/cli/options.h"
#include "tests/support/calibration.h"
#include "tests/support/judge.h"

static _Noreturn void die(const char *text)
{
    fprintf(stderr, "calibrate: %s\n", text);
    exit(2);
}

enum { AHEAD = 2 }; /* levels: four times the samples */

/* What a unit of cost is: processor time, which is noisy on a machine with other work, or samples. */
enum unit { CPU_SECONDS, SAMPLES };

static double cost_of(const struct judgement *j, uint32_t level, enum unit unit)
{
    return unit == CPU_SECONDS ? j[level].cpu_s : calibration_spp(level);
}

/* The cost of the error that a later level shows, from the levels up to this one; 0 where there is none. */
static struct accuracy_estimate predict(const struct judgement *j, uint32_t level, uint32_t levels, enum unit unit)
{
    struct accuracy_point points[CALIBRATION_LEVELS_MAX];
    struct accuracy_curve curve;

    if (level + AHEAD >= levels || !(j[level + AHEAD].figures.display_error > 0))
        return (struct accuracy_estimate){0, 0, 0};
    for (uint32_t i = 0; i <= level; i++)
        points[i] = (struct accuracy_point){cost_of(j, i, unit), j[i].figures.display_error,
                                            j[i].figures.display_lo, j[i].figures.display_hi};
    accuracy_curve_fit(&curve, points, level + 1);
    return accuracy_curve_cost(&curve, j[level + AHEAD].figures.display_error);
}

/* The geometric means of all seeds' display errors: figures almost without noise. */
static void mean_of_seeds(const struct judgement *all, uint32_t seeds, uint32_t levels, struct judgement *out)
{
    for (uint32_t level = 0; level < levels; level++) {
        double sum = 0;
        for (uint32_t s = 0; s < seeds; s++)
            sum += log(all[(size_t)s * levels + level].figures.display_error) / seeds;
        out[level] = all[level];
        out[level].figures.display_error = exp(sum);
    }
}

/* One line of one seed's judgements all[levels]. `even`: their mean over the seeds. `reference`: samples
 * of a pixel that the truth was made of. */
static void print_row(const char *scene, uint32_t seed, const struct judgement *all, const struct judgement *even,
                      uint32_t level, uint32_t levels, uint32_t reference, size_t pixels)
{
    const struct judgement *j = &all[level], *later = &all[level + AHEAD < levels ? level + AHEAD : level];
    const struct accuracy_figures *f = &j->figures;
    struct accuracy_estimate cost = predict(all, level, levels, CPU_SECONDS);
    struct accuracy_estimate samples = predict(all, level, levels, SAMPLES);

    printf("%s,%u,%u,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%d,%u,%.9g,%u,%.6g,%.6g,%.6g,%.9g,%d,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%u,%u,%u,%zu,%.6g\n",
           scene, seed, calibration_spp(level), f->display_error, f->display_lo, f->display_hi, j->true_display,
           f->rmse_percent, f->rmse_lo, f->rmse_hi, j->true_rmse, f->psnr_db, j->true_psnr,
           f->lone, f->dark, f->top_share, f->disagreement, f->unseen, f->tail_index, f->reliable, f->reasons,
           j->cpu_s, reference, cost.value, cost.lo, cost.hi, later->cpu_s, later->figures.reliable,
           samples.value, samples.lo, samples.hi, predict(even, level, levels, SAMPLES).value,
           f->display_all, j->true_all, f->worst_part, j->true_part, f->subject, j->fireflies, j->found, j->wrong, pixels, j->exposure);
}

int main(int argc, char **argv)
{
    const char *size_text = "64x64", *cache = NULL, *env = NULL, *tonemap = TONEMAP_DEFAULT, *name = "", *slash;
    int64_t seeds = 20, levels = 7, reference_seeds = 3, reference_spp = 4096;
    int help = 0, header = 0;
    const struct option table[] = {
        {"size", 0, OPTION_STRING, &size_text, "WxH", "pixels; default: 64x64", 0, 0, NULL},
        {"seeds", 0, OPTION_INT, &seeds, "N", "pictures; default: 20", 2, 1000, NULL},
        {"levels", 0, OPTION_INT, &levels, "N", "4, 8, ... samples of a pixel; default: 7, to 256", 1,
         CALIBRATION_LEVELS_MAX, NULL},
        {"reference-seeds", 0, OPTION_INT, &reference_seeds, "N", "of the reference; 0: as in the cache; default: 3", 0, 64, NULL},
        {"reference-spp", 0, OPTION_INT, &reference_spp, "N", "samples of each; default: 4096", 4, 65536, NULL},
        {"cache", 0, OPTION_STRING, &cache, "FILE", "keep the pictures here", 0, 0, NULL},
        {"env", 0, OPTION_STRING, &env, "FILE", "light the scene with this environment map", 0, 0, NULL},
        {"tonemap", 0, OPTION_STRING, &tonemap, "NAME", "operator by which errors are seen, with its presets; default: " TONEMAP_DEFAULT, 0, 0, NULL},
        {"header", 0, OPTION_FLAG, &header, NULL, "print the columns' names and end", 0, 0, NULL},
        {0},
    };
    struct judgement *judgements, even[CALIBRATION_LEVELS_MAX];
    struct calibration c;
    struct calibration_size size = {.first_seed = 1};
    struct tonemap_settings look;
    struct positionals rest;
    struct error err = {0};

    if (options_parse(table, argc, argv, &rest, &help, &err) != STATUS_OK)
        die(err.text);
    if (header) {
        puts("scene,seed,spp,display,display_lo,display_hi,display_true,rmse,rmse_lo,rmse_hi,rmse_true,"
             "psnr,psnr_true,lone,dark,top_share,disagreement,unseen,tail_index,reliable,reasons,cpu_s,reference,"
             "cost,cost_lo,cost_hi,later_cpu_s,later_reliable,samples,samples_lo,samples_hi,samples_even,"
             "all,all_true,part,part_true,subject,fireflies,found,wrong,pixels,exposure");
        return 0;
    }
    if (help || rest.count != 1 || sscanf(size_text, "%ux%u", &size.width, &size.height) != 2) {
        options_print_help("calibrate SCENE [options]", "Figures against truth.", table);
        return help ? 0 : 2;
    }
    if (tonemap_settings_init(&look, tonemap, &err) != STATUS_OK)
        die(err.text);
    size.seeds = (uint32_t)seeds;
    size.levels = (uint32_t)levels;
    size.reference_seeds = (uint32_t)reference_seeds;
    size.reference_spp = (uint32_t)reference_spp;
    if (size.reference_seeds == 0 && !cache)
        die("--reference-seeds 0 takes the reference of --cache FILE; name one");
    if (!cache || !calibration_load(&c, cache, &size)) {
        if (size.reference_seeds == 0)
            die("the cache has no such pictures; give --reference-seeds N to render them");
        calibration_render(&c, rest.items[0], env, &size);
        if (cache)
            calibration_save(&c, cache, &size);
    }
    calibration_describe(&c, rest.items[0], env);
    slash = strrchr(rest.items[0], '/');
    name = slash ? slash + 1 : rest.items[0];
    judgements = mem_alloc_array((size_t)c.seeds * c.levels, sizeof *judgements);
    if (!judgements)
        die("out of memory");
    for (uint32_t s = 0; s < c.seeds; s++)
        for (uint32_t level = 0; level < c.levels; level++)
            judge(&judgements[(size_t)s * c.levels + level], &c, s, level, &look);
    mean_of_seeds(judgements, c.seeds, c.levels, even);
    for (uint32_t s = 0; s < c.seeds; s++)
        for (uint32_t level = 0; level < c.levels; level++)
            print_row(name, s, judgements + (size_t)s * c.levels, even, level, c.levels,
                      c.reference_seeds * c.reference_spp + (c.seeds - 1) * calibration_spp(c.levels - 1), (size_t)c.width * c.height);
    mem_free(judgements);
    calibration_release(&c);
    return 0;
}
