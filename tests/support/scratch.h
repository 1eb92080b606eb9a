/* scratch: a folder of a test's own, which goes with all that is in it. */
#pragma once

extern char folder[32]; /* its path */

/* Fixtures of cmocka: the folder is made and removed. */
int folder_set_up(void **state);
int folder_tear_down(void **state);
/* The path of a file in it, overwritten by the next call. */
char *path_of(const char *name);
