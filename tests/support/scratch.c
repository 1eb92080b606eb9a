#include "tests/support/scratch.h"

#include <stdio.h>
#include <stdlib.h>

#include "common/system/file.h"

char folder[32];

int folder_set_up(void **state)
{
    (void)state;
    snprintf(folder, sizeof folder, "/tmp/azulejo-test-XXXXXX");
    return mkdtemp(folder) ? 0 : -1;
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
