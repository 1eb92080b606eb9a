/* pilot: small trial renders that tell what an effect costs and what it does.
 *
 * Every trial is an ordinary job of the same scene with the same seed, once as it is and once
 * without the effect, so that both share their random numbers and most of their noise.
 */
#ifndef AZULEJO_CLIENT_PILOT_H
#define AZULEJO_CLIENT_PILOT_H

#include "client/connection.h"
#include "client/import/import.h"
#include "client/job_options.h"
#include "common/image/image.h"

struct pilot_trial {
    uint64_t without;      /* effects left out */
    double cpu_s;          /* of the workers' threads: the least of all runs */
    struct image picture;  /* linear radiance */
};

/* Run the trials one after another, `runs` times through, so that a machine that is busy for a
 * while slows all of them. trials[i].without is given, the rest is filled in; the caller
 * releases the pictures (also after a failure). */
status pilot_run(struct connection *c, const struct import_result *scene,
                 const struct job_request *request, struct pilot_trial *trials, size_t count,
                 unsigned runs, struct error *err) MUST_CHECK;

#endif
