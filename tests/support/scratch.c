#include "tests/support/scratch.h"

#include <stdio.h>

#include "common/system/file.h"

char folder[SCRATCH_PATH];

int folder_set_up(void **state)
{
    (void)state;
    scratch_folder(folder);
    return 0;
}

int folder_tear_down(void **state)
{
    (void)state;
    file_remove_tree(folder);
    return 0;
}

char *path_of(const char *name)
{
    static char path[256];

    snprintf(path, sizeof path, "%s/%s", folder, name);
    return path;
}
