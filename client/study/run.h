/* run: measures a study with ordinary jobs on the connection's farm.
 *
 * First the main curve: pairs of pictures with 4, 8, 16 ... samples a pixel, of two seeds. Then one
 * choice at a time: pairs of two other seeds at the same few numbers of samples for every choice,
 * the usual way's as well. pair.h compares the noise of two ways, and separates bias from it.
 *
 * Each step ends with `save`, so that an interruption loses one step at most; a study that was read
 * again continues with the missing steps. Nothing is measured twice, but the usual way's pictures
 * are rendered again, because the study does not keep them.
 */
#ifndef AZULEJO_CLIENT_STUDY_RUN_H
#define AZULEJO_CLIENT_STUDY_RUN_H

#include "client/terminal/progress.h"
#include "client/study/pair.h"
#include "client/farm/trial.h"

enum {
    RUN_POINTS_MAX = 20,   /* of the main curve */
    RUN_LEVELS_MAX = 3,    /* points of a choice */
    RUN_SPP_FIRST = 4,     /* the least that all four replicates of a picture share in */
    RUN_SPP_MAX = 1 << 18,
};

struct study_run {
    struct study *study;
    struct connection *connection;
    const struct import_result *scene;
    const struct job_request *request; /* the user's, except spp */
    uint32_t spp_most;                 /* of a picture */
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
    double jobs, jobs_s, jobs_samples; /* of the usual way so far: how many, and their sums */
    double first_s, first_samples;     /* of the first of them, without the way to the farm and back */
    double job_overhead_s;             /* on the clock, whatever the samples */
    double wall_per_sample_s;          /* of a sample of all pixels */
    size_t steps, steps_done;          /* of the choices */
    struct image pairs[RUN_POINTS_MAX][2]; /* of the main curve, as far as rendered now */
    struct shown shown;
    struct image usual;                /* the best picture of the usual way */
    double clock_squares, clock_pairs; /* of ln(time of one seed / time of the other) */
};

/* Measure until the study is complete (study->complete) or the budget is spent. ERR_JOB_FAILED
 * after Ctrl-C, and what trial_render returns; the study then has all complete steps. */
status study_run(struct study_run *run, struct error *err) MUST_CHECK;
/* Does the study that was read match this request? ERR_USAGE names the difference. */
status study_run_check(const struct study *s, const struct job_request *request, const char *scene,
                       struct error *err) MUST_CHECK;

/* ---- private to client/study ---- */
/* A pair of pictures with seeds from first_seed on, and its point. The caller releases both trials. */
status run_pair(struct study_run *run, const struct job_request *request, uint32_t spp,
                uint64_t first_seed, const char *what, struct trial pair[2], struct error *err) MUST_CHECK;
/* Core and wall seconds of one picture, samples, rays, and the word on them. A former point must have been
 * released. */
status run_point_set(struct study_point *p, const struct trial pair[2], struct error *err) MUST_CHECK;
/* The error that the pair shows. */
void run_point_error(struct study_point *p, const struct pair_error *e);
double run_left_s(const struct study_run *run);
/* A picture's wall-clock time, as far as is known. */
double run_picture_s(const struct study_run *run, uint32_t spp);
status run_main(struct study_run *run, struct error *err) MUST_CHECK;
status run_choices(struct study_run *run, struct error *err) MUST_CHECK;

/* The power law through the points, weighted by their intervals; unknown with fewer than three
 * points. */
void study_fit_points(struct study_fit *fit, const struct study_point *points, size_t count);

#endif
