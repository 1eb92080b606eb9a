/* What is removed is gone from its place at once, and from the disk by and by; closing waits for one file only. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include "common/system/file.h"
#include "common/system/trash.h"
#include "tests/support/scratch.h"

/* ---- a disk whose removals wait at a gate ----------------------------------------------------- */

static pthread_mutex_t gate_lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t gate_changed = PTHREAD_COND_INITIALIZER;
static int gate_closed, at_gate;

static void gate_set(int closed)
{
    pthread_mutex_lock(&gate_lock);
    gate_closed = closed;
    pthread_cond_broadcast(&gate_changed);
    pthread_mutex_unlock(&gate_lock);
}

static void gate_await(void)
{
    pthread_mutex_lock(&gate_lock);
    while (!at_gate)
        pthread_cond_wait(&gate_changed, &gate_lock);
    pthread_mutex_unlock(&gate_lock);
}

/* Instead of the C library's. */
int unlinkat(int at, const char *path, int flags)
{
    pthread_mutex_lock(&gate_lock);
    at_gate++;
    pthread_cond_broadcast(&gate_changed);
    while (gate_closed)
        pthread_cond_wait(&gate_changed, &gate_lock);
    at_gate--;
    pthread_mutex_unlock(&gate_lock);
    return (int)syscall(SYS_unlinkat, at, path, flags);
}

/* ---- files ------------------------------------------------------------------------------------ */

static int tear_down(void **state)
{
    gate_set(0);
    return folder_tear_down(state);
}

static void make_folder(const char *name) { assert_int_equal(mkdir(path_of(name), 0700), 0); }

static int make_file(const char *name, off_t size)
{
    int fd = open(path_of(name), O_RDWR | O_CREAT | O_EXCL, 0600);

    assert_true(fd >= 0);
    assert_int_equal(ftruncate(fd, size), 0);
    return fd;
}

static void make_closed(const char *name) { assert_int_equal(close(make_file(name, 100)), 0); }

static int entries_of(const char *name)
{
    DIR *stream = opendir(path_of(name));
    const struct dirent *entry;
    int count = 0;

    assert_non_null(stream);
    while ((entry = readdir(stream)))
        count += entry->d_name[0] != '.';
    closedir(stream);
    return count;
}

static void pause_a_little(void) { nanosleep(&(struct timespec){.tv_nsec = 1000000}, NULL); }

static void await_empty(void)
{
    while (entries_of("trash") > 0)
        pause_a_little();
}

static struct trash *open_trash(void)
{
    struct trash *trash;
    struct error err = {0};

    assert_int_equal(trash_open(&trash, folder, &err), STATUS_OK);
    return trash;
}

/* ---- tests ------------------------------------------------------------------------------------ */

static void files_and_folders_go_at_once(void **state)
{
    struct trash *trash;

    (void)state;
    make_folder("trash");
    make_closed("file");
    make_folder("films");
    make_closed("films/1");
    make_folder("films/deep");
    make_closed("films/deep/2");
    trash = open_trash();
    gate_set(1);
    assert_int_equal(trash_unlink(folder, path_of("file")), 0);
    assert_true(trash_take(folder, path_of("films")));
    assert_false(file_exists(path_of("file")) || file_exists(path_of("films")));
    assert_int_equal(entries_of("trash"), 2);
    make_closed("file"); /* the name is free */
    gate_set(0);
    await_empty();
    assert_true(file_exists(path_of("file")));
    assert_int_equal(trash_unlink(folder, path_of("none")), -1);
    assert_int_equal(errno, ENOENT);
    trash_close(trash);
}

static void what_a_kill_left_goes(void **state)
{
    struct trash *trash;

    (void)state;
    make_folder("trash");
    make_closed("trash/1");
    make_folder("trash/2");
    make_closed("trash/2/3");
    trash = open_trash();
    await_empty();
    trash_close(trash);
}

/* The folder is made later: its disk was away. */
static void without_a_folder_files_are_unlinked(void **state)
{
    struct trash *trash = open_trash();

    (void)state;
    make_closed("file");
    assert_int_equal(trash_unlink(folder, path_of("file")), 0);
    assert_false(file_exists(path_of("file")));
    make_folder("films");
    assert_false(trash_take(folder, path_of("films")));
    assert_true(file_exists(path_of("films")));
    make_folder("trash");
    make_closed("trash/left");
    trash_wake();
    await_empty();
    trash_close(trash);
}

static void without_a_thread_nothing_is_left_lying(void **state)
{
    (void)state;
    make_folder("trash");
    make_closed("file");
    assert_false(trash_take(folder, path_of("file")));
    assert_int_equal(errno, ENOTSUP);
    assert_int_equal(trash_unlink(folder, path_of("file")), 0);
    assert_false(file_exists(path_of("file")));
    assert_int_equal(entries_of("trash"), 0);
}

/* A writer that has the file open writes on, and does not wait for its room when it closes. */
static void open_files_are_closed_by_the_thread(void **state)
{
    struct trash *trash;
    int large, small;

    (void)state;
    make_folder("trash");
    large = make_file("large", 3 << 20);
    small = make_file("small", 100);
    trash = open_trash();
    gate_set(1);
    make_closed("first");
    assert_int_equal(trash_unlink(folder, path_of("first")), 0);
    gate_await(); /* from here on the thread is busy */
    assert_int_equal(trash_unlink(folder, path_of("large")), 0);
    assert_int_equal(write(large, "more", 4), 4);
    trash_close_file(large);
    trash_close_file(small);
    assert_int_equal(fcntl(small, F_GETFD), -1);
    assert_true(fcntl(large, F_GETFD) >= 0);
    gate_set(0);
    while (fcntl(large, F_GETFD) >= 0)
        pause_a_little();
    await_empty();
    trash_close(trash);
}

static void *close_trash(void *trash)
{
    trash_close(trash);
    return NULL;
}

static void closing_waits_for_one_file(void **state)
{
    struct trash *trash;
    pthread_t closer;

    (void)state;
    make_folder("trash");
    trash = open_trash();
    gate_set(1);
    for (int i = 0; i < 3; i++) {
        make_closed("file");
        assert_int_equal(trash_unlink(folder, path_of("file")), 0);
    }
    gate_await();
    assert_int_equal(pthread_create(&closer, NULL, close_trash, trash), 0);
    while (trash_take(folder, path_of("none")) || errno != ENOTSUP) /* until it is closing */
        pause_a_little();
    gate_set(0);
    assert_int_equal(pthread_join(closer, NULL), 0);
    assert_int_equal(entries_of("trash"), 2);
    trash = open_trash();
    await_empty();
    trash_close(trash);
}

#define TRASH_TEST(name) cmocka_unit_test_setup_teardown(name, folder_set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TRASH_TEST(files_and_folders_go_at_once),
        TRASH_TEST(what_a_kill_left_goes),
        TRASH_TEST(without_a_folder_files_are_unlinked),
        TRASH_TEST(without_a_thread_nothing_is_left_lying),
        TRASH_TEST(open_files_are_closed_by_the_thread),
        TRASH_TEST(closing_waits_for_one_file),
    };
    return cmocka_run_group_tests_name("trash", tests, NULL, NULL);
}
