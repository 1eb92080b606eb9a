/* child: a program that runs for us and dies with us.
 *
 * A child has its own process group, so that a Ctrl-C at the terminal reaches only us and we can shut it down cleanly;
 * the kernel sends it a signal if we die. Its output goes to a log file, whose tail explains an unexpected end.
 */
#pragma once

#include <sys/types.h>

#include "common/base/buffer.h"
#include "common/base/status.h"

struct child {
    const char *label; /* "worker 1", for messages; not owned */
    pid_t pid;         /* 0: not started */
    int ended;         /* reaped */
    int wait_status;   /* as from waitpid, once ended */
};

/* Find a program beside our own executable, else in PATH: append its path. ERR_INPUT. */
status child_find_program(const char *name, struct buffer *path, struct error *err) MUST_CHECK;

/* Start argv[0] with its output going to `log_path` (appended), or to our standard error when that is NULL. stdout_fd
 * >= 0: its standard output goes there instead. When we die it gets death_signal. ERR_IO. */
status child_start(struct child *child, const char *label, char *const argv[], const char *log_path, int stdout_fd,
                   int death_signal, struct error *err) MUST_CHECK;

/* The same with a standard input; -1: none. */
status child_start_fed(struct child *child, const char *label, char *const argv[], const char *log_path, int stdin_fd,
                       int stdout_fd, int death_signal, struct error *err) MUST_CHECK;

/* Has it ended? Never blocks. */
int child_has_ended(struct child *child);

/* "ended with exit status 3", "was killed by signal 9 (Killed)". */
void child_describe_end(const struct child *child, char *out, size_t size);

/* Send SIGTERM to all, wait up to limit_ms for them to end, then send SIGKILL; all are reaped. */
void children_stop(struct child *children, size_t count, unsigned limit_ms);

/* Print the last lines of a log file to standard error, indented. */
void child_print_log_tail(const char *log_path, const char *label);
