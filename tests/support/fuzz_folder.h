/* fuzz_folder: the files that a fuzz target's input may name. One folder for the process, in memory
 * where there is /dev/shm; it is taken away when the process ends in good order. */
#pragma once

#include <stddef.h>

#include "client/import/builder/input_files.h"

/* Its path. The folder is made when it is first asked for; these abort when they fail. */
const char *fuzz_folder(void);
/* Write a file in it, again if need be. */
void fuzz_folder_put(const char *name, const void *data, size_t size_bytes);
/* Abort unless every file that a scene read lies in the folder, but for the one called `given`,
 * which is the input itself. */
void fuzz_folder_check(const struct input_files *files, const char *given);
