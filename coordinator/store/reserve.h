/* reserve: what is kept back for the store, so that it can still note how jobs end when the disk is
 * full or the descriptors are used up.
 *
 * Disk: STORE/reserve holds RESERVE_BYTES. It is removed when the database finds no room, and made
 * again as soon as there is room for it.
 * Descriptors: the last RESERVE_DESCRIPTORS below the process's limit are the store's, and as many
 * before them serve files that are opened for peers (a blob to send, an upload). Connections have the
 * rest. The kernel gives the lowest number that is free, so the number of a new descriptor tells how
 * many are left: who opens one for a peer asks reserve_allows or reserve_is_short, and gives it back
 * when it may not keep it. Of a limit below 256 each part is an eighth.
 */
#ifndef AZULEJO_COORDINATOR_RESERVE_H
#define AZULEJO_COORDINATOR_RESERVE_H

#include "common/base/status.h"

enum {
    RESERVE_BYTES = 4 << 20,
    RESERVE_DESCRIPTORS = 64,
};

/* Make the reserve in the store's folder unless it is there. ERR_IO, ERR_NO_MEMORY: nothing is left
 * behind. */
status reserve_hold(const char *folder, struct error *err) MUST_CHECK;
/* Give its room back. 0: there was none. [any thread] */
int reserve_release(const char *folder);

/* May a file that serves a peer have this descriptor, which was opened just now? 0: it is one of the
 * store's. */
int reserve_allows(int fd);
/* Are so few descriptors left that no more connection should be taken? */
int reserve_is_short(void);

#endif
