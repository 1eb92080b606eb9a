/* schedule_option: --schedule-from FILE.exr, the samples of a picture that was ended by a time limit or a cancel. */
#pragma once

#include "client/options/job_options.h"

/* Read the schedule of o->schedule_path into the request; nothing happens without one. ERR_USAGE:
 * other options also set samples. ERR_INPUT, ERR_IO name the file. */
status schedule_option_read(struct job_request *request, const struct job_options *o, struct error *err) MUST_CHECK;
/* When the request is complete: use the picture's size if none was given. ERR_USAGE: it does not fit. */
status schedule_option_fit(struct job_request *request, const struct job_options *o, struct error *err) MUST_CHECK;
