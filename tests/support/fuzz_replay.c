/* fuzz_replay: the main() that makes an ordinary test of a fuzz target. It feeds the target
 * every file of the folder argv[1], and each file cut short in many places, from memory of
 * exactly that size, so that a sanitizer sees a read past the end. One TAP line a file: a target
 * that crashes ends the program, which tests/run.sh counts as a failure.
 */
#include <dirent.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/buffer.h"
#include "common/system/file.h"
#include "common/base/memory.h"

enum { FILES_MAX = 4096, CUTS_MAX = 512 };
#define FILE_BYTES_MAX ((size_t)16 << 20)

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
/* Targets may have one, to set up what all runs share. */
int LLVMFuzzerInitialize(int *argc, char ***argv) __attribute__((weak));

static int visible(const struct dirent *entry) { return entry->d_name[0] != '.'; }

static void feed(const uint8_t *data, size_t size)
{
    uint8_t *copy = mem_memdup(data, size);

    if (!copy) {
        fprintf(stderr, "out of memory\n");
        exit(1);
    }
    LLVMFuzzerTestOneInput(copy, size);
    mem_free(copy);
}

/* The whole, then every prefix of a small file, evenly spread ones of a large. */
static int replay(const char *folder, const char *name)
{
    struct buffer file = BUFFER_INIT;
    struct error err = {0};
    char *path = file_join(folder, name);
    const uint8_t *data;
    size_t cuts;

    if (!path || file_read(path, FILE_BYTES_MAX, &file, &err) != STATUS_OK) {
        printf("# %s\n", path ? err.text : "out of memory");
        mem_free(path);
        return 0;
    }
    mem_free(path);
    data = file.data ? file.data : (const uint8_t *)"";
    feed(data, file.size);
    cuts = file.size < CUTS_MAX ? file.size : CUTS_MAX;
    for (size_t i = 0; i < cuts; i++)
        feed(data, file.size * i / cuts);
    buffer_release(&file);
    return 1;
}

int main(int argc, char **argv)
{
    struct dirent **entries = NULL;
    int count, failed = 0, number = 0;

    if (argc != 2) {
        fprintf(stderr, "usage: %s FOLDER\n", argv[0]);
        return 2;
    }
    if (LLVMFuzzerInitialize)
        LLVMFuzzerInitialize(&argc, &argv);
    count = scandir(argv[1], &entries, visible, alphasort);
    if (count <= 0) {
        printf("not ok 1 - no corpus in %s\n", argv[1]);
        free(entries);
        return 1;
    }
    for (int i = 0; i < count; i++) {
        if (i < FILES_MAX) {
            int ok = replay(argv[1], entries[i]->d_name);

            printf("%s %d - %s\n", ok ? "ok" : "not ok", ++number, entries[i]->d_name);
            fflush(stdout);
            failed += !ok;
        }
        free(entries[i]);
    }
    free(entries);
    printf("1..%d\n", number);
    return failed != 0;
}
