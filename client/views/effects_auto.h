/* effects_auto: leave out the effects that make no visible difference at the accuracy asked for.
 *
 * `--effects auto --target-error N/255` measures the job's first frame (effects_measure) and leaves
 * out the effects chosen by effects_choose; a bias may reach a quarter of the target. They are in
 * settings.without, and so in the manifest and the EXR header.
 */
#pragma once

#include "client/link/connection.h"
#include "client/import/import.h"
#include "client/options/job_options.h"

struct effects_auto {
    const char *effects; /* as given; NULL: not given */
    double target_codes; /* from effects_auto_check; 0: off */
};

#define EFFECTS_AUTO_ROWS(o)                                                                      \
    {"effects", 0, OPTION_CHOICE, &(o).effects, "WHICH",                                          \
     "auto: measure what each effect changes, and leave out what --target-error hides (default all)", \
     0, 0, "all|auto"}

/* `target`: as given to --target-error; NULL: not given. ERR_USAGE. */
status effects_auto_check(struct effects_auto *o, const char *target, struct error *err) MUST_CHECK;
/* If it is on: measure, add to request->settings.without, and report that on standard error. */
status effects_auto_apply(const struct effects_auto *o, struct connection *c, const struct import_result *scene,
                          struct job_request *request, int quiet, struct error *err) MUST_CHECK;

/* "N/255": ERR_USAGE names the option. */
status parse_target_codes(const char *text, double *codes, struct error *err) MUST_CHECK;
