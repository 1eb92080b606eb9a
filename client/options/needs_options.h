/* needs_options: the options that say what a job waits for and which workers it needs. */
#pragma once

#include "client/options/setting_option.h"
#include "common/schema/job_needs.h"

struct needs_options {
    union setting_said said[NEED_COUNT];
};

#define NEED_SETTING_OPTION(o, KIND, type, name, ...) setting_option(&job_needs_rows[NEED_##name], &(o).said[NEED_##name]),
#define NEED_OWN_OPTION(o, name, ...) setting_option(&job_needs_rows[NEED_##name], &(o).said[NEED_##name]),
/* Ends with a comma. */
#define NEEDS_OPTION_ROWS(o) JOB_NEEDS(NEED_OWN_OPTION, NEED_SETTING_OPTION, o)

/* Call before the scene is read. The jobs of `after` are job_needs_find's. ERR_USAGE. */
status needs_options_check(const struct needs_options *o, struct job_needs *out, struct error *err) MUST_CHECK;
