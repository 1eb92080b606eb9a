/* schedule_option: --schedule-from FILE.exr, the samples of a picture that a clock or a cancel ended. */
#ifndef AZULEJO_CLIENT_SCHEDULE_OPTION_H
#define AZULEJO_CLIENT_SCHEDULE_OPTION_H

#include "client/farm/job_options.h"

/* Read the schedule of o->schedule_path into the request; nothing without one. ERR_USAGE: other options speak
 * of samples, too. ERR_INPUT, ERR_IO name the file. */
status schedule_option_read(struct job_request *request, const struct job_options *o,
                            struct error *err) MUST_CHECK;
/* When the request is complete: take the picture's size if none was asked for. ERR_USAGE: it does not
 * fit. */
status schedule_option_fit(struct job_request *request, const struct job_options *o,
                           struct error *err) MUST_CHECK;

#endif
