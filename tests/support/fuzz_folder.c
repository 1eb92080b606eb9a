#include "tests/support/fuzz_folder.h"

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "tests/support/scratch_folder.h"

enum { PATH_SIZE = 128 };

static char folder[SCRATCH_PATH];

static void clean_up(void)
{
    DIR *dir = opendir(folder);
    const struct dirent *entry;

    if (!dir)
        return;
    while ((entry = readdir(dir)))
        if (entry->d_name[0] != '.')
            unlinkat(dirfd(dir), entry->d_name, 0);
    closedir(dir);
    rmdir(folder);
}

const char *fuzz_folder(void)
{
    if (folder[0])
        return folder;
    scratch_folder(folder);
    atexit(clean_up);
    return folder;
}

void fuzz_folder_put(const char *name, const void *data, size_t size_bytes)
{
    char path[PATH_SIZE];
    FILE *file;

    snprintf(path, sizeof path, "%s/%s", fuzz_folder(), name);
    file = fopen(path, "wb");
    if (!file || (size_bytes && fwrite(data, 1, size_bytes, file) != size_bytes) || fclose(file) != 0)
        abort();
}

void fuzz_folder_check(const struct input_files *files, const char *given)
{
    size_t length = strlen(fuzz_folder());

    for (size_t i = 0; i < files->count; i++) {
        char *whole;
        if (strcmp(files->files[i].name, given) == 0)
            continue;
        whole = realpath(files->files[i].name, NULL);
        if (!whole || strncmp(whole, fuzz_folder(), length) != 0 || whole[length] != '/')
            abort();
        free(whole);
    }
}
