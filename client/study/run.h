/* run: measures a study with ordinary jobs on the connection's farm.
 *
 * First the main curve: pairs of pictures with 4, 8, 16 ... samples a pixel, of two seeds. Then one
 * choice at a time: pairs of two other seeds at the same few numbers of samples for every choice,
 * the usual way's as well, and a picture of the usual way between every two of another (study_clock.h).
 * pair.h compares the noise of two ways, and separates bias from it.
 *
 * Each step ends with `save`, so that an interruption loses one step at most; a study that was read
 * again continues with the missing steps. Nothing is measured twice, but the usual way's pictures
 * are rendered again, because the study does not keep them.
 */
#pragma once

#include "client/terminal/progress.h"
#include "client/study/pair.h"
#include "client/study/study_clock.h"
#include "client/farm/trial.h"

enum {
    RUN_POINTS_MAX = 20,   /* of the main curve */
    RUN_LEVELS_MAX = 3,    /* points of a choice */
    RUN_SPP_FIRST = 4,     /* two samples of each group */
    RUN_SPP_MAX = 1 << 18,
    RUN_WAYS_SEED = 2,     /* the main curve has two seeds, which stay independent of the ways' */
};

struct study_run {
    struct study *study;
    struct connection *connection;
    const struct import_result *scene;
    const struct job_request *request; /* the user's, except spp */
    uint32_t spp_most;                 /* of a picture */
    const struct image *reference;     /* linear radiance, of the pictures' size; NULL: none */
    const char *name;                  /* of the jobs */
    double budget_s;                   /* on the clock: no step begins that would end later */
    uint32_t levels;                   /* points of a choice, 1..RUN_LEVELS_MAX */
    int local;                         /* the workers are this machine's */
    int quiet;
    status (*save)(void *user, struct error *err);
    /* Replace the connection by one to workers that compute in double, or by the usual one again; NULL:
     * there are no such workers. */
    status (*connect)(void *user, int precise, struct error *err);
    void *user;

    /* ---- private ---- */
    struct progress progress;
    uint64_t started_ns;
    double jobs, jobs_s, jobs_samples;     /* of the usual way so far: how many, and their sums */
    double first_s, first_samples;         /* of the first of them, without the way to the farm and back */
    double job_overhead_s;                 /* on the clock, whatever the samples */
    double wall_per_sample_s;              /* of a sample of all pixels */
    size_t steps, steps_done;              /* of the choices */
    struct image pairs[RUN_POINTS_MAX][2]; /* of the main curve, as far as rendered now */
    struct shown shown;
    struct image usual; /* the best picture of the usual way */
    struct study_clock clock;
    uint32_t usual_spp; /* samples of the probe; 0: there is none here */
    uint32_t probe_spp; /* the same while pairs need one */
};

/* Measure until the study is complete (study->complete) or the budget is spent. ERR_JOB_FAILED
 * after Ctrl-C, and what trial_render returns; the study then has all complete steps. */
status study_run(struct study_run *run, struct error *err) MUST_CHECK;
/* Does the study that was read match this request? ERR_USAGE names the difference. */
status study_run_check(const struct study *s, const struct job_request *request, const char *scene,
                       struct error *err) MUST_CHECK;

/* ---- private to client/study ---- */
/* A pair of pictures with seeds from first_seed on, and its point. The caller releases both trials. */
status run_pair(struct study_run *run, const struct job_request *request, uint32_t spp, uint64_t first_seed,
                const char *what, struct trial pair[2], struct error *err) MUST_CHECK;
/* Core and wall seconds of one picture, samples, rays, and the word on them. A former point must have been released. */
void run_point_set(struct study_point *p, const struct trial pair[2]);
/* Their mean, the least and the most. */
struct study_interval seeds_of(double a, double b);
/* The error that the pair shows. */
void run_point_error(struct study_point *p, const struct pair_error *e);
/* And against the reference, if there is one. */
status run_point_reference(const struct study_run *run, struct study_point *p, const struct image *a,
                           const struct image *b, struct error *err) MUST_CHECK;
double run_left_s(const struct study_run *run);
/* A picture's wall-clock time, as far as is known. */
double run_picture_s(const struct study_run *run, uint32_t spp);
status run_main(struct study_run *run, struct error *err) MUST_CHECK;
status run_choices(struct study_run *run, struct error *err) MUST_CHECK;

/* The law of prices through the points, weighted by their intervals; unknown with fewer than three points. */
void study_fit_points(struct study_fit *fit, const struct study_point *points, size_t count);
