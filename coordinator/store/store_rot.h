/* store_rot: look through a store that no coordinator uses for what flipped or was cut at rest (--check), and mend it
 * (--repair).
 *
 *   queue.sqlite   its structure, each row's digest, jobs whose rows are lost. --repair: what can be read goes into a new
 *                  file, the old one stays as queue.sqlite.damaged; a job whose row is lost is parked under its number
 *   blobs          each has its digest as its name. --repair: removed; its scene's next submission sends it again
 *   outputs        their digests stand beside them. Fetching makes them again (coordinator/steering/remake.h)
 *   films          their records have digests. Tiles that are damaged are rendered again
 *
 * Not looked at: audit.log, the page's certificate and address, uploads. */
#pragma once

#include <stdint.h>

#include "common/base/status.h"

struct rot {
    uint64_t files, faults;
};
/* `say` gets a line for each fault, with its remedy. ERR_REFUSED: the store is used. ERR_CORRUPT: of a newer version.
 * ERR_IO, ERR_NO_MEMORY. */
status store_rot_check(const char *folder, int repair, void (*say)(const char *line), struct rot *out,
                       struct error *err) MUST_CHECK;
