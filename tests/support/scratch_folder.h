/* scratch_folder: a folder of a test's own. */
#pragma once

enum { SCRATCH_PATH = 32 };

/* Make a folder and put its path into `path` (SCRATCH_PATH bytes): in memory where there is room, so that no test waits
 * for a disk, else in /tmp. Stops the program if it cannot be made. */
void scratch_folder(char *path);
