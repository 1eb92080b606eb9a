/* trial: one picture rendered for measuring, as an ordinary job on the connection's farm.
 *
 * The connection's watch decides whether a signal ends the wait; a trial that ends this way cancels
 * its job, so that a farm does not continue unneeded work.
 */
#pragma once

#include "client/link/connection.h"
#include "client/import/import.h"
#include "client/options/job_options.h"
#include "common/accuracy/figures.h"
#include "common/image/image.h"

struct trial {
    double core_s;  /* of the workers' threads */
    double wall_s;  /* from the first lease to the end */
    double samples; /* of a pixel */
    double rays;
    double trace_s;                  /* inside Embree; 0: not measured */
    double clamped_share;            /* of the light, removed by settings.clamp */
    struct accuracy_figures figures; /* of the picture, as `azulejo render` prints them; known 0:
                                        too few samples */
    uint64_t effects;                /* that the frame needs, for the figures' text */
    struct image picture;            /* linear radiance */
    struct image sampling;           /* of an adaptive picture: samples of each pixel, in all three channels */
};

/* Called from time to time while a trial waits for a farm without workers. */
struct trial_waiting {
    void (*no_worker)(void *user);
    void *user;
};

/* Render the request's first frame, ended by its cap and its stop rules, and wait for it. A former picture in `out` must have been
 * released; release it after a failure, too. `waiting` may be NULL. */
status trial_render(struct connection *c, const struct import_result *scene, const struct job_request *request,
                    const char *name, const struct trial_waiting *waiting, struct trial *out,
                    struct error *err) MUST_CHECK;
void trial_release(struct trial *t);

/* A connection's watch function (user: NULL) for remote farms: ERR_JOB_FAILED after Ctrl-C. */
status trial_interrupted(void *user, struct error *err) MUST_CHECK;
