/* job_lines: the worker's last log lines, on their way to the coordinator, which keeps the last of
 * them with the worker, and those about the job that it renders in the job's log. A bounded ring: with too many lines the oldest are
 * lost. There is one for the process, as there is one log.
 *
 * Lines may come from any thread; the other functions belong to the loop's thread.
 */
#pragma once

#include <stdint.h>

#include "protocol/channel.h"

enum {
    JOB_LINES_MAX = 32,
    JOB_LINES_AT_ONCE = 8,     /* sent by one call */
};

/* From now on, lines that are logged belong to this job; 0: to none. The first call begins
 * it: no line before it is kept. */
void job_lines_of(uint64_t job);
/* Send some of the waiting lines. */
void job_lines_send(struct channel *channel);
