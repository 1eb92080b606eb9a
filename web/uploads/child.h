/* child: another program, run under limits for somebody who is not trusted.
 *
 *   web_child_start --runs--> exits, or is killed at a limit or by web_child_kill --> on_end, once --> freed
 *                   \--web_child_abandon: killed, freed, no on_end (a shutdown)
 *
 * It gets a process group of its own, limits of memory, processor time and file sizes, the lowest standing
 * when memory runs out, and no descriptor but its output and `secret`. It is killed when this program
 * ends, however that happens. This program itself sets this up between fork and exec:
 * its main() must call web_child_launch first.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>
#include <uv.h>

#include "common/base/buffer.h"
#include "common/base/status.h"

enum { CHILD_SECRET_FD = 3 };

struct web_child_options {
    const char *program;            /* path */
    const char *const *arguments;   /* with the program's name; NULL ends them */
    const char *const *environment; /* "NAME=VALUE"; NULL ends them */
    const char *folder;             /* where it runs */
    int secret;                     /* a descriptor that it gets as CHILD_SECRET_FD; -1: none */
    uint64_t memory_bytes;          /* of its address space; 0: no limit */
    uint64_t processor_s;           /* of all its threads together */
    uint64_t file_bytes;            /* the largest file that it may write */
    uint16_t wall_port;             /* not 0: it runs behind a wall (web/base/wall.h), and may connect to this port; */
    int resolves;                   /* its address is a name */
    uint64_t limit_ms;              /* then it is killed */
    size_t output_bytes; /* more on its standard output: it is killed; of its standard error the end is kept */
};

enum web_child_end { CHILD_EXITED, CHILD_TOO_LONG, CHILD_TOO_MUCH, CHILD_KILLED };

struct web_child_result {
    enum web_child_end end;
    int64_t exit_status;
    int signal; /* that ended it; 0: none */
    const struct buffer *output, *errors;
};

struct web_child;
typedef void web_child_end_fn(void *user, const struct web_child_result *result);

/* ERR_IO: it cannot be run, and on_end is not called. */
status web_child_start(struct web_child **out, uv_loop_t *loop, const struct web_child_options *options,
                       web_child_end_fn *on_end, void *user, struct error *err) MUST_CHECK;
void web_child_kill(struct web_child *child);
void web_child_abandon(struct web_child *child);

/* If this process was made by web_child_start: become the child's program, and do not return unless that fails;
 * then *exit_status is what main() returns. 0: it was not. */
int web_child_launch(int argc, char **argv, int *exit_status);
