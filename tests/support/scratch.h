/* scratch: one folder for a test program, which goes with all that is in it. */
#pragma once

#include "tests/support/scratch_folder.h"

extern char folder[SCRATCH_PATH]; /* its path */

/* Fixtures of cmocka: the folder is made and removed. */
int folder_set_up(void **state);
int folder_tear_down(void **state);
/* The path of a file in it, overwritten by the next call. */
char *path_of(const char *name);
