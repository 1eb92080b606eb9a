/* What runs in a child between fork and exec. */
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include "web/base/wall.h"
#include "web/uploads/child.h"
#include "web/uploads/child_parts.h"

enum { PATIENCE = 10 };         /* being polite: the farm's own work goes first */

/* A sanitizer reserves terabytes of addresses. */
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
enum { LIMITS_MEMORY = 0 };
#else
enum { LIMITS_MEMORY = 1 };
#endif

static int limit(int what, unsigned long long most)
{
    const struct rlimit both = {most, most};

    return setrlimit((__rlimit_resource_t)what, &both) == 0;
}

static int prepare(char **words)
{
    unsigned long long memory = strtoull(words[3], NULL, 10), processor = strtoull(words[4], NULL, 10),
                       file = strtoull(words[5], NULL, 10);
    const struct wall wall = {.program = words[CHILD_LAUNCH_WORDS - 1], .port = (uint16_t)strtoul(words[6], NULL, 10),
                              .resolves = words[7][0] == '1'};

    /* The parent may have died before this call; then no one would send the signal. */
    if (prctl(PR_SET_PDEATHSIG, SIGKILL) != 0 || getppid() != (pid_t)strtol(words[2], NULL, 10))
        return 0;
    (void)close_range(CHILD_SECRET_FD + 1, ~0U, 0);
    if (setpriority(PRIO_PROCESS, 0, PATIENCE) != 0) {
        /* Only a courtesy. */
    }
    return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 && limit(RLIMIT_CORE, 0) && limit(RLIMIT_FSIZE, file) &&
           limit(RLIMIT_CPU, processor) && (!LIMITS_MEMORY || memory == 0 || limit(RLIMIT_AS, memory)) &&
           (wall.port == 0 || wall_build(&wall));
}

int web_child_launch(int argc, char **argv, int *exit_status)
{
    if (argc <= CHILD_LAUNCH_WORDS || strcmp(argv[1], CHILD_LAUNCH_COMMAND) != 0)
        return 0;
    *exit_status = 126;
    if (!prepare(argv)) {
        fprintf(stderr, "%s: its limits cannot be set: %s\n", argv[CHILD_LAUNCH_WORDS - 1], strerror(errno));
        return 1;
    }
    execv(argv[CHILD_LAUNCH_WORDS - 1], argv + CHILD_LAUNCH_WORDS);
    fprintf(stderr, "%s: cannot be run: %s\n", argv[CHILD_LAUNCH_WORDS - 1], strerror(errno));
    *exit_status = 127;
    return 1;
}
