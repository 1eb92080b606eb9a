/* What prints ends the program when memory is exhausted, at whichever allocation: one line, and the exit status. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "client/terminal/json.h"
#include "client/terminal/must.h"
#include "client/terminal/table.h"
#include "protocol/azulejo.pb-c.h"

enum { EACH_MAX = 2000 };

static void tell_table(void)
{
    static const char *const titles[] = {"NAME", ">COUNT"};
    struct table table;

    table_init(&table, titles, 2);
    for (int i = 0; i < 40; i++)
        table_add(&table, "cell %d", i);
    table_print(&table);
    table_release(&table);
}

static void tell_message(void)
{
    Azulejo__Wire__JobInfo info = AZULEJO__WIRE__JOB_INFO__INIT, *jobs[] = {&info, &info};
    Azulejo__Wire__RenderSettings settings = AZULEJO__WIRE__RENDER_SETTINGS__INIT;
    Azulejo__Wire__JobList list = AZULEJO__WIRE__JOB_LIST__INIT;
    struct error err = {0};

    settings.without = 5;
    info.settings = &settings;
    info.name = (char *)"a name";
    list.jobs = jobs;
    list.n_jobs = 2;
    if (json_print(json_message(&list.base), &err) != STATUS_OK)
        _exit(99);
}

/* Run it in a process of its own whose allocation number n fails; the exit status. What it printed is in `out`, what
 * it complained of in `err`. `failed`: the allocation was reached. */
static int ended(void (*tell)(void), long n, char out[1 << 16], char err[256], int *failed)
{
    FILE *printed = tmpfile(), *complained = tmpfile();
    pid_t child = fork();
    int how;

    if (child == 0) {
        dup2(fileno(printed), STDOUT_FILENO);
        dup2(fileno(complained), STDERR_FILENO);
        setvbuf(stdout, NULL, _IONBF, 0);
        must_begin();
        mem_fault_arm(n, 1);
        tell();
        fflush(stdout);
        _exit(mem_fault_count() ? 98 : 0);
    }
    assert_int_equal(waitpid(child, &how, 0), child);
    assert_true(WIFEXITED(how));
    rewind(printed);
    rewind(complained);
    out[fread(out, 1, (1 << 16) - 1, printed)] = 0;
    err[fread(err, 1, 255, complained)] = 0;
    fclose(printed);
    fclose(complained);
    *failed = err[0] != 0;
    return WEXITSTATUS(how);
}

static void check_every_allocation(void (*tell)(void))
{
    static char out[1 << 16], whole[1 << 16];
    char err[256];
    int failed = 1;
    long n;

    assert_int_equal(ended(tell, EACH_MAX, whole, err, &failed), 0);
    for (n = 0, failed = 1; failed; n++) {
        int status_code = ended(tell, n, out, err, &failed);
        assert_int_equal(status_code, failed ? status_exit_code(STATUS_ERR_NO_MEMORY) : 0);
        assert_string_equal(err, failed ? "azulejo: out of memory\n" : "");
        assert_string_equal(out, failed ? "" : whole); /* nothing is printed in part */
    }
    assert_true(n > 20 && n < EACH_MAX);
}

static void test_tables(void **state)
{
    (void)state;
    check_every_allocation(tell_table);
}

static void test_messages(void **state)
{
    (void)state;
    check_every_allocation(tell_message);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_tables),
        cmocka_unit_test(test_messages),
    };

    return cmocka_run_group_tests_name("client/must", tests, NULL, NULL);
}
