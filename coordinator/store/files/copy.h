/* copy: files of a store to and from its backup. */
#pragma once

#include <stdint.h>

#include "common/base/status.h"

struct copied {
    uint64_t files, bytes; /* that were copied; bytes without holes */
};

/* Copy the folder's files, and those of its folders, that are not in `to` with the same size and time; `to` is made. Files that
 * vanish meanwhile are left out; a missing `from` is empty. Modes are 700 and 600, and times are
 * kept. Not synced. ERR_IO, ERR_NO_MEMORY. */
status copy_tree(const char *from, const char *to, struct copied *sum, struct error *err) MUST_CHECK;
/* One file; ERR_IO also if it is not there. */
status copy_file(const char *from, const char *to, struct copied *sum, struct error *err) MUST_CHECK;
