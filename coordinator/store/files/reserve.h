/* reserve: disk space and descriptors kept back for the store, so that it can still record how jobs end when the disk
 * is full or the descriptors are used up.
 *
 * Disk: STORE/reserve holds RESERVE_BYTES. It is removed when the database runs out of space, and created again as soon
 * as there is space. Descriptors: the last RESERVE_DESCRIPTORS below the process's limit are the store's, and as many
 * before them serve files that are opened for peers (a blob to send, an upload). Connections have the rest. The kernel
 * assigns the lowest free number, so the number of a new descriptor shows how many are left: code that opens one for a
 * peer asks reserve_allows or reserve_is_short, and closes it if it may not keep it. With a limit below 256 each part
 * is an eighth.
 */
#pragma once

#include "common/base/status.h"

enum {
    RESERVE_BYTES = 4 << 20,
    RESERVE_DESCRIPTORS = 64,
};

/* Create the reserve in the store's folder unless it exists. ERR_IO, ERR_NO_MEMORY: nothing is left behind. */
status reserve_hold(const char *folder, struct error *err) MUST_CHECK;
/* Free its space. 0: there was no reserve. [any thread] */
int reserve_release(const char *folder);

/* May a file for a peer keep this new descriptor? 0: it is one of the store's. */
int reserve_allows(int fd);
/* Are so few descriptors left that no more connections should be accepted? */
int reserve_is_short(void);
