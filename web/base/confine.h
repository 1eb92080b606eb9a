/* confine: what this program gives up at its start, so that a fault of its own reaches nothing else.
 *
 * - no new privileges (prctl), so that no program that it runs has more than it has;
 * - WEB_MEMORY_BYTES of addresses and WEB_DESCRIPTORS_MIN descriptors or as many as its connections need (setrlimit);
 *   no core files, which would hold its key;
 * - with Landlock (Linux 5.19): no file can be written but below the folder of uploads, and none can be read but these,
 *   libraries and what else every program reads of the system, /proc and the two programs, which alone can be executed.
 *   Of a coordinator that is given by name also /etc, where names are looked up. Without Landlock the log says so.
 *
 * Threads that run already keep what they may: none may.
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"

#define WEB_MEMORY_BYTES ((uint64_t)4 << 30)
enum { WEB_DESCRIPTORS_MIN = 1024 };

struct confinement {
    const char *uploads;  /* the folder that may be written */
    const char *client;   /* a program that is run; NULL: none */
    uint32_t connections; /* at most */
    int resolves;         /* the coordinator or the page is given by name */
};

/* All of them; and when memory runs out, the kernel ends this program and its children first. ERR_IO. */
status confine(const struct confinement *c, struct error *err) MUST_CHECK;
/* End with the process of this number, which must be the parent. ERR_REFUSED: it is not, any more. */
status confine_to_parent(int64_t parent, struct error *err) MUST_CHECK;
