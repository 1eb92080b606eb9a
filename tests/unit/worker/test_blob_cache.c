/* The blob cache: what it stores it gives back, what is damaged it never does. */
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "worker/cache/blob_cache.h"
#include "worker/cache/cache_writer.h"
#include "tests/support/scratch.h"

#define NO_LIMIT (1ull << 40)

static int remove_folder(void **state)
{
    char command[192];

    (void)state;
    snprintf(command, sizeof command, "chmod -R u+rwx %s && rm -rf %s", folder, folder);
    return system(command);
}

static struct blob_cache *cache_open(uint64_t limit)
{
    struct blob_cache *cache;

    assert_int_equal(blob_cache_open(&cache, folder, limit, NULL), STATUS_OK);
    return cache;
}

/* Bytes that differ for each seed. */
static void fill(uint8_t *bytes, size_t size, uint32_t seed)
{
    for (size_t i = 0; i < size; i++) {
        seed = seed * 1664525 + 1013904223;
        bytes[i] = (uint8_t)(seed >> 24);
    }
}

static status put(struct blob_cache *cache, const uint8_t *bytes, size_t size, size_t piece, struct digest *digest,
                  struct cached_blob **out, struct error *err)
{
    struct cache_writer *w;
    status s;

    *out = NULL;
    assert_int_equal(digest_of(digest, bytes, size), STATUS_OK);
    s = cache_writer_new(&w, cache, digest, size, err);
    if (s != STATUS_OK)
        return s;
    for (size_t at = 0; at < size && s == STATUS_OK; at += piece)
        s = cache_writer_add(w, bytes + at, size - at < piece ? size - at : piece, err);
    if (s != STATUS_OK) {
        cache_writer_abandon(w);
        return s;
    }
    assert_int_equal(cache_writer_bytes(w), size);
    return cache_writer_finish(w, out, err);
}

static struct digest put_seed(struct blob_cache *cache, size_t size, uint32_t seed)
{
    uint8_t *bytes = malloc(size);
    struct cached_blob *blob;
    struct digest digest;

    assert_non_null(bytes);
    fill(bytes, size, seed);
    assert_int_equal(put(cache, bytes, size, size, &digest, &blob, NULL), STATUS_OK);
    cached_blob_release(blob);
    free(bytes);
    return digest;
}

static int has(struct blob_cache *cache, const struct digest *digest)
{
    struct cached_blob *blob;
    status s = blob_cache_get(cache, digest, &blob, NULL);

    if (s == STATUS_OK)
        cached_blob_release(blob);
    else
        assert_int_equal(s, STATUS_ERR_NOT_FOUND);
    return s == STATUS_OK;
}

static void blob_path(const struct digest *digest, char path[256])
{
    char hex[DIGEST_HEX_SIZE];

    digest_to_hex(digest, hex);
    snprintf(path, 256, "%s/%.2s/%s", folder, hex, hex + 2);
}

static size_t count_temporaries(void)
{
    char command[128];
    FILE *f;
    unsigned count = 99;

    snprintf(command, sizeof command, "ls -A %s/tmp 2>/dev/null | wc -l", folder);
    f = popen(command, "r");
    assert_non_null(f);
    assert_int_equal(fscanf(f, "%u", &count), 1);
    pclose(f);
    return count;
}

static void test_store_and_find(void **state)
{
    const size_t sizes[] = {0, 1, 4095, 4096, 4097, 1000000};
    static uint8_t bytes[1000000];

    (void)state;
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        struct blob_cache *cache = cache_open(NO_LIMIT);
        struct cached_blob *blob, *again;
        struct digest digest;
        char path[256];
        struct stat info;
        fill(bytes, sizes[i], (uint32_t)i);
        assert_int_equal(put(cache, bytes, sizes[i], 1000, &digest, &blob, NULL), STATUS_OK);
        assert_true(digest_equal(cached_blob_digest(blob), &digest));
        assert_int_equal(cached_blob_size(blob), sizes[i]);
        assert_non_null(cached_blob_data(blob));
        assert_memory_equal(cached_blob_data(blob), bytes, sizes[i]);
        blob_path(&digest, path);
        assert_int_equal(stat(path, &info), 0);
        assert_int_equal(info.st_size, sizes[i]);
        /* The same bytes, not a second mapping, while it is in use. */
        assert_int_equal(blob_cache_get(cache, &digest, &again, NULL), STATUS_OK);
        assert_ptr_equal(again, blob);
        cached_blob_release(again);
        cached_blob_release(blob);
        blob_cache_close(cache);
        /* And in another process's life. */
        cache = cache_open(NO_LIMIT);
        assert_int_equal(blob_cache_get(cache, &digest, &blob, NULL), STATUS_OK);
        assert_int_equal(cached_blob_size(blob), sizes[i]);
        assert_memory_equal(cached_blob_data(blob), bytes, sizes[i]);
        cached_blob_release(blob);
        blob_cache_close(cache);
        assert_int_equal(count_temporaries(), 0);
    }
}

static void test_absent(void **state)
{
    struct blob_cache *cache = cache_open(NO_LIMIT);
    struct digest digest = {{1, 2, 3}};
    struct cached_blob *blob;
    struct error err = {0};

    (void)state;
    assert_int_equal(blob_cache_get(cache, &digest, &blob, &err), STATUS_ERR_NOT_FOUND);
    assert_null(blob);
    blob_cache_close(cache);
}

enum damage { FLIP_FIRST, FLIP_LAST, CUT, EMPTY, LONGER, SYMLINK, FOLDER, DAMAGES };

static void do_damage(const char *path, enum damage how)
{
    struct stat info;
    int fd = open(path, O_RDWR);
    char byte;
    off_t at;

    assert_true(fd >= 0);
    assert_int_equal(fstat(fd, &info), 0);
    at = how == FLIP_LAST ? info.st_size - 1 : 0;
    switch (how) {
    case FLIP_FIRST:
    case FLIP_LAST:
        assert_int_equal(pread(fd, &byte, 1, at), 1);
        byte ^= 1;
        assert_int_equal(pwrite(fd, &byte, 1, at), 1);
        break;
    case CUT: assert_int_equal(ftruncate(fd, info.st_size - 1), 0); break;
    case EMPTY: assert_int_equal(ftruncate(fd, 0), 0); break;
    case LONGER: assert_int_equal(pwrite(fd, "x", 1, info.st_size), 1); break;
    case SYMLINK:
        assert_int_equal(unlink(path), 0);
        assert_int_equal(symlink("/etc/passwd", path), 0);
        break;
    case FOLDER:
        assert_int_equal(unlink(path), 0);
        assert_int_equal(mkdir(path, 0700), 0);
        break;
    case DAMAGES: break;
    }
    close(fd);
}

/* Damaged while nobody looked: never handed out; gone, or replaced by the next store. */
static void test_damaged_files(void **state)
{
    (void)state;
    log_setup("test", LOG_LEVEL_ERROR);
    for (int how = 0; how < DAMAGES; how++) {
        struct blob_cache *cache = cache_open(NO_LIMIT);
        struct digest digest = put_seed(cache, 5000, 77);
        char path[256];
        blob_cache_close(cache);
        blob_path(&digest, path);
        do_damage(path, how);
        cache = cache_open(NO_LIMIT);
        assert_false(has(cache, &digest));
        if (how < SYMLINK)
            assert_false(file_exists(path));
        if (how == FOLDER)
            assert_int_equal(rmdir(path), 0);
        put_seed(cache, 5000, 77);
        assert_true(has(cache, &digest));
        blob_cache_close(cache);
        unlink(path);
    }
    log_setup("test", LOG_LEVEL_INFO);
}

static void test_wrong_bytes_are_not_stored(void **state)
{
    struct blob_cache *cache = cache_open(NO_LIMIT);
    struct cache_writer *w;
    struct cached_blob *blob;
    struct digest digest;
    struct error err = {0};
    char path[256];

    (void)state;
    assert_int_equal(digest_of(&digest, "right", 5), STATUS_OK);
    blob_path(&digest, path);
    assert_int_equal(cache_writer_new(&w, cache, &digest, 5, NULL), STATUS_OK);
    assert_int_equal(cache_writer_add(w, "wrong", 5, NULL), STATUS_OK);
    assert_int_equal(cache_writer_finish(w, &blob, &err), STATUS_ERR_CORRUPT);
    assert_null(blob);
    assert_false(file_exists(path));
    /* Too few, too many, given up. */
    assert_int_equal(cache_writer_new(&w, cache, &digest, 6, NULL), STATUS_OK);
    assert_int_equal(cache_writer_add(w, "right", 5, NULL), STATUS_OK);
    assert_int_equal(cache_writer_finish(w, &blob, NULL), STATUS_ERR_CORRUPT);
    assert_int_equal(cache_writer_new(&w, cache, &digest, 4, NULL), STATUS_OK);
    assert_int_equal(cache_writer_add(w, "right", 5, NULL), STATUS_ERR_CORRUPT);
    cache_writer_abandon(w);
    cache_writer_abandon(NULL);
    assert_false(has(cache, &digest));
    assert_int_equal(count_temporaries(), 0);
    blob_cache_close(cache);
}

/* The disk fills up before the first byte, in the middle, and never by the same amount. */
static void test_disk_full(void **state)
{
    static uint8_t bytes[100000];

    (void)state;
    log_setup("test", LOG_LEVEL_ERROR);
    fill(bytes, sizeof bytes, 5);
    for (size_t good = 0; good <= sizeof bytes; good += 20000) {
        struct blob_cache *cache = cache_open(NO_LIMIT);
        struct cache_writer *w;
        struct cached_blob *blob, *again;
        struct digest digest;
        bytes[0] = (uint8_t)(good / 20000); /* a blob of its own */
        assert_int_equal(digest_of(&digest, bytes, sizeof bytes), STATUS_OK);
        assert_int_equal(cache_writer_new(&w, cache, &digest, sizeof bytes, NULL), STATUS_OK);
        assert_int_equal(cache_writer_add(w, bytes, good, NULL), STATUS_OK);
        blob_cache_fault_disk_full(1);
        assert_int_equal(cache_writer_add(w, bytes + good, sizeof bytes - good, NULL), STATUS_OK);
        blob_cache_fault_disk_full(0);
        assert_int_equal(cache_writer_finish(w, &blob, NULL), STATUS_OK);
        assert_memory_equal(cached_blob_data(blob), bytes, sizeof bytes);
        /* Found while it is in use; on disk only if it all fitted. */
        assert_int_equal(blob_cache_get(cache, &digest, &again, NULL), STATUS_OK);
        assert_ptr_equal(again, blob);
        cached_blob_release(again);
        cached_blob_release(blob);
        assert_int_equal(has(cache, &digest), good == sizeof bytes);
        assert_int_equal(count_temporaries(), 0);
        blob_cache_close(cache);
    }
    log_setup("test", LOG_LEVEL_INFO);
}

static void set_age(const struct digest *digest, int seconds)
{
    struct timespec times[2];
    char path[256];

    blob_path(digest, path);
    clock_gettime(CLOCK_REALTIME, &times[0]);
    times[0].tv_sec -= seconds;
    times[1] = times[0];
    assert_int_equal(utimensat(AT_FDCWD, path, times, 0), 0);
}

/* Ten blobs of 1,000 bytes under a limit of 10,000; the next one sweeps to 9,000. */
static void test_least_recently_used_go_first(void **state)
{
    struct blob_cache *cache = cache_open(10000);
    struct digest digests[11];
    struct cached_blob *held;

    (void)state;
    for (int i = 0; i < 10; i++) {
        digests[i] = put_seed(cache, 1000, 100 + (uint32_t)i);
        set_age(&digests[i], 1000 - i);
    }
    assert_true(has(cache, &digests[0])); /* used now: the youngest */
    assert_int_equal(blob_cache_get(cache, &digests[2], &held, NULL), STATUS_OK);
    set_age(&digests[2], 5000); /* the oldest, and in use */
    digests[10] = put_seed(cache, 1000, 110);
    for (int i = 0; i < 11; i++) {
        char path[256];
        blob_path(&digests[i], path);
        assert_int_equal(file_exists(path), i != 1 && i != 2);
    }
    /* What is in use stays usable although its file is gone. */
    assert_int_equal(cached_blob_size(held), 1000);
    assert_true(has(cache, &digests[2]));
    cached_blob_release(held);
    assert_false(has(cache, &digests[2]));
    blob_cache_close(cache);
    /* A lower limit holds from the opening on. */
    cache = cache_open(3000);
    for (int i = 0; i < 11; i++)
        assert_int_equal(has(cache, &digests[i]), i == 0 || i == 10);
    blob_cache_close(cache);
}

static void test_blob_larger_than_the_limit(void **state)
{
    struct blob_cache *cache = cache_open(100);
    static uint8_t bytes[5000];
    struct cached_blob *blob;
    struct digest digest;

    (void)state;
    fill(bytes, sizeof bytes, 9);
    assert_int_equal(put(cache, bytes, sizeof bytes, 500, &digest, &blob, NULL), STATUS_OK);
    assert_memory_equal(cached_blob_data(blob), bytes, sizeof bytes);
    assert_true(has(cache, &digest));
    cached_blob_release(blob);
    assert_false(has(cache, &digest));
    blob_cache_close(cache);
}

static void test_folder_that_cannot_be_used(void **state)
{
    struct blob_cache *cache;
    struct error err = {0};
    char path[128];

    (void)state;
    snprintf(path, sizeof path, "%s/file", folder);
    assert_int_equal(file_write_atomic(path, "x", 1, NULL), STATUS_OK);
    assert_int_equal(blob_cache_open(&cache, path, NO_LIMIT, &err), STATUS_ERR_IO);
    assert_null(cache);
    assert_non_null(strstr(err.text, path));
    assert_non_null(strstr(err.text, "--cache"));
    assert_int_equal(blob_cache_open(&cache, "/proc/azulejo", NO_LIMIT, &err), STATUS_ERR_IO);
    assert_non_null(strstr(err.text, "--cache"));
    if (geteuid() != 0) { /* root may do anything */
        snprintf(path, sizeof path, "%s/closed", folder);
        assert_int_equal(mkdir(path, 0500), 0);
        assert_int_equal(blob_cache_open(&cache, path, NO_LIMIT, &err), STATUS_ERR_IO);
        assert_non_null(strstr(err.text, "--cache"));
    }
}

static void test_left_over_temporaries(void **state)
{
    struct blob_cache *cache = cache_open(NO_LIMIT);
    char old[128], young[128];
    struct timespec times[2] = {{.tv_sec = 1000000000}, {.tv_sec = 1000000000}};

    (void)state;
    blob_cache_close(cache);
    snprintf(old, sizeof old, "%s/tmp/host-1-0", folder);
    snprintf(young, sizeof young, "%s/tmp/host-2-0", folder);
    assert_int_equal(file_write_atomic(old, "x", 1, NULL), STATUS_OK);
    assert_int_equal(file_write_atomic(young, "x", 1, NULL), STATUS_OK);
    assert_int_equal(utimensat(AT_FDCWD, old, times, 0), 0);
    cache = cache_open(NO_LIMIT);
    assert_false(file_exists(old));
    assert_true(file_exists(young)); /* another process may be at it */
    blob_cache_close(cache);
}

static void test_every_allocation_fails_once(void **state)
{
    static uint8_t bytes[3000];
    long n;

    (void)state;
    log_setup("test", LOG_LEVEL_ERROR);
    for (n = 0; n < 100; n++) {
        struct blob_cache *cache = NULL;
        struct cached_blob *blob = NULL;
        struct digest digest;
        long failed;
        status s;
        fill(bytes, sizeof bytes, 1000 + (uint32_t)n);
        mem_fault_arm(n, 1);
        s = blob_cache_open(&cache, folder, NO_LIMIT, NULL);
        if (s == STATUS_OK)
            s = put(cache, bytes, sizeof bytes, 1000, &digest, &blob, NULL);
        cached_blob_release(blob);
        if (s == STATUS_OK) {
            s = blob_cache_get(cache, &digest, &blob, NULL);
            cached_blob_release(blob);
        }
        failed = mem_fault_count();
        mem_fault_arm(-1, 0);
        blob_cache_close(cache);
        assert_int_equal(count_temporaries(), 0);
        if (!failed) {
            assert_int_equal(s, STATUS_OK);
            break;
        }
        /* Some failures only cost a file in the cache. */
        assert_true(s == STATUS_ERR_NO_MEMORY || s == STATUS_OK || s == STATUS_ERR_NOT_FOUND);
    }
    assert_true(n > 8 && n < 100);
    log_setup("test", LOG_LEVEL_INFO);
}

/* Four threads put and get the same blobs, evicting one another's all the time. */
enum { SHARED_BLOBS = 20, SHARED_ROUNDS = 400, SHARED_SIZE = 2000 };

static void *share(void *argument)
{
    struct blob_cache *cache = argument;
    uint8_t bytes[SHARED_SIZE];
    uintptr_t wrong = 0;
    uint32_t random = (uint32_t)(uintptr_t)&bytes;

    for (int i = 0; i < SHARED_ROUNDS; i++) {
        struct cached_blob *blob = NULL;
        struct digest digest;
        random = random * 1664525 + 1013904223;
        fill(bytes, sizeof bytes, random >> 16 & (SHARED_BLOBS - 1));
        if (digest_of(&digest, bytes, sizeof bytes) != STATUS_OK)
            return (void *)1;
        if (blob_cache_get(cache, &digest, &blob, NULL) != STATUS_OK) {
            struct cache_writer *w = NULL;
            if (cache_writer_new(&w, cache, &digest, sizeof bytes, NULL) != STATUS_OK ||
                cache_writer_add(w, bytes, sizeof bytes, NULL) != STATUS_OK ||
                cache_writer_finish(w, &blob, NULL) != STATUS_OK)
                return (void *)2;
        }
        wrong |= cached_blob_size(blob) != sizeof bytes || memcmp(cached_blob_data(blob), bytes, sizeof bytes) != 0;
        cached_blob_release(blob);
    }
    return (void *)wrong;
}

static void share_by_threads(struct blob_cache *cache)
{
    pthread_t threads[4];

    for (int i = 0; i < 4; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, share, cache), 0);
    for (int i = 0; i < 4; i++) {
        void *result;
        assert_int_equal(pthread_join(threads[i], &result), 0);
        assert_null(result);
    }
}

static void test_threads_and_processes(void **state)
{
    pid_t child;
    int how;
    struct blob_cache *cache;

    (void)state;
    log_setup("test", LOG_LEVEL_ERROR);
    child = fork();
    assert_true(child >= 0);
    cache = cache_open(SHARED_SIZE * SHARED_BLOBS / 4);
    if (child == 0) {
        uintptr_t wrong = (uintptr_t)share(cache);
        blob_cache_close(cache);
        _exit((int)wrong);
    }
    share_by_threads(cache);
    blob_cache_close(cache);
    assert_int_equal(waitpid(child, &how, 0), child);
    assert_true(WIFEXITED(how));
    assert_int_equal(WEXITSTATUS(how), 0);
    log_setup("test", LOG_LEVEL_INFO);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, folder_set_up, remove_folder)
    const struct CMUnitTest tests[] = {
        TEST(test_store_and_find),
        TEST(test_absent),
        TEST(test_damaged_files),
        TEST(test_wrong_bytes_are_not_stored),
        TEST(test_disk_full),
        TEST(test_least_recently_used_go_first),
        TEST(test_blob_larger_than_the_limit),
        TEST(test_folder_that_cannot_be_used),
        TEST(test_left_over_temporaries),
        TEST(test_every_allocation_fails_once),
        TEST(test_threads_and_processes),
    };
#undef TEST
    return cmocka_run_group_tests_name("blob_cache", tests, NULL, NULL);
}
