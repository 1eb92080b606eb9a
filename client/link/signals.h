/* signals: Ctrl-C and ends of child processes, as events for the code that waits.
 *
 * The handlers only set a flag and write a byte into a pipe. Code that waits adds signals_fd() to
 * what it polls, drains it with signals_drain() and then checks what happened. SIGINT, SIGTERM and
 * SIGHUP all request the same: an orderly stop.
 */
#pragma once

#include "common/base/status.h"

/* From now on signals are caught. Idempotent. */
status signals_catch(struct error *err) MUST_CHECK;

/* Back to the default actions, for a child process between fork and exec. Async-signal-safe. */
void signals_restore_in_child(void);

/* A descriptor that becomes readable when a caught signal arrives; -1 before signals_catch. */
int signals_fd(void);
void signals_drain(void);

/* The signal that asked us to stop, or 0. */
int signals_stop(void);
/* The number of such signals. */
int signals_stop_count(void);
