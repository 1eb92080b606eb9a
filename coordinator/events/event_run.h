/* event_run: one run of the program of --on-event.
 *
 *   spawn --> it runs --it ends--> its exit status says what becomes of the event
 *               |--EVENT_RUN_S, or *ending--> SIGTERM --EVENT_END_MS--> SIGKILL, both to its process group
 *
 * It gets a JSON object as its standard input, a file in memory. Its standard output is dropped, the last line of its
 * standard error is kept. It has no other descriptor, no argument, and of the environment PATH, HOME, LANG and TZ.
 */
#pragma once

#include <stdatomic.h>

#include "common/base/status.h"

enum {
    EVENT_RUN_S = 30,            /* a run's time */
    EVENT_END_MS = 1000,         /* from SIGTERM to SIGKILL */
    EVENT_LATER = 75,            /* the exit status that asks for another run: EX_TEMPFAIL of sysexits.h */
    EVENT_HOW_SIZE = 400,
};

enum event_fate {
    EVENT_FATE_TAKEN,            /* it ended with status 0 */
    EVENT_FATE_REFUSED,          /* with another one but EVENT_LATER */
    EVENT_FATE_AGAIN,            /* with EVENT_LATER, or by a signal, or it could not be run */
};

/* Is it a file that this process may execute? ERR_INPUT. */
status event_program_check(const char *path, struct error *err) MUST_CHECK;
/* Run it, and wait for its end. `how`: its exit status, and the last line that it wrote. [any thread] */
enum event_fate event_run(const char *program, const char *json, const atomic_int *ending, char how[EVENT_HOW_SIZE]);
