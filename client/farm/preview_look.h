/* preview_look: a preview that is tone mapped with other settings than its job's. What no option names is the job's own. */
#pragma once

#include "client/link/connection.h"
#include "client/options/output.h"
#include "client/options/tonemap_options.h"

struct preview_look {
    struct tonemap_options tone;
    int no_dither;
    int given;                     /* some option was; the rest is filled by preview_look_check */
    struct output_request request; /* released by preview_look_release */
    struct wire_output output;
};

/* Evaluate the options; `has_preview`: they have something to change. ERR_USAGE, and those of tonemap_options_check. */
status preview_look_check(struct preview_look *look, int has_preview, struct error *err) MUST_CHECK;
/* Complete them by the job's settings, and send the operator's file. The result is for OutputGet, and valid as long as
 * `look` and `job` are; NULL without options. */
status preview_look_output(struct preview_look *look, struct connection *c, const Azulejo__Wire__JobInfo *job,
                           Azulejo__Wire__OutputSettings **out, struct error *err) MUST_CHECK;
void preview_look_release(struct preview_look *look);
