/* confine: what this program gives up at its start, so that a fault of its own reaches nothing else.
 *
 * - no new privileges (prctl), so that no program that it runs has more than it has;
 * - WEB_MEMORY_BYTES of addresses and WEB_DESCRIPTORS_MIN descriptors or as many as its connections need (setrlimit);
 *   no core files, which would hold its key;
 * - with Landlock (Linux 5.13): no file can be written but below the folder of uploads and in /dev, none can be read
 *   but the system's (/usr, /lib, /etc, /proc, ...) and the two programs. Without it the log says so.
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"

#define WEB_MEMORY_BYTES ((uint64_t)4 << 30)
enum { WEB_DESCRIPTORS_MIN = 1024 };

/* All of them. `uploads`: the folder that may be written; `client`: a program that is run, or NULL: none. ERR_IO. */
status confine(const char *uploads, const char *client, uint32_t connections, struct error *err) MUST_CHECK;
/* End with the process of this number, which must be the parent. ERR_REFUSED: it is not, any more. */
status confine_to_parent(int64_t parent, struct error *err) MUST_CHECK;
