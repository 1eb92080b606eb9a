#include "tests/support/starve.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "common/base/memory.h"

enum { EACH_MAX = 20000 };
enum { WHOLE = 90, SURVIVED, REFUSED, OTHER }; /* exit statuses of a process that did not end itself */

/* How the process ended whose allocation number n failed; what it printed is in `line`. */
static int ended(status (*run)(void *user), void *user, long n, char line[256])
{
    FILE *complained = tmpfile();
    pid_t child = fork();
    int how;

    if (child == 0) {
        status result;

        dup2(fileno(complained), STDERR_FILENO);
        mem_fault_arm(n, 1);
        result = run(user);
        _exit(result == STATUS_OK ? mem_fault_count() ? SURVIVED : WHOLE
                                  : result == STATUS_ERR_NO_MEMORY ? REFUSED : OTHER);
    }
    assert_int_equal(waitpid(child, &how, 0), child);
    rewind(complained);
    line[fread(line, 1, 255, complained)] = 0;
    fclose(complained);
    return WIFEXITED(how) ? WEXITSTATUS(how) : OTHER;
}

long starve_each(status (*run)(void *user), void *user, long survivors)
{
    char line[256];
    int how = SURVIVED;
    long n = 0;

    for (; how != WHOLE; n++) {
        assert_true(n < EACH_MAX);
        how = ended(run, user, n, line);
        survivors -= how == SURVIVED;
        if (how == status_exit_code(STATUS_ERR_NO_MEMORY))
            assert_string_equal(line, "azulejo: out of memory\n");
        else if (how == OTHER)
            fail_msg("allocation %ld: \"%s\"", n, line);
    }
    assert_true(survivors >= 0);
    return n - 1;
}
