/* The store's locks.
 *
 * store_lock: one coordinator, or one restore, has the store. STORE/lock is locked (flock), and STORE/blobs where it is there,
 * so that deleting the file admits no second one. Not the folder itself: a client that fetches into it locks that.
 *
 * store_hold: a backup copies a store while its coordinator runs; meanwhile nothing that the copy may need is
 * removed from it. STORE/hold is locked (flock): shared by backups, exclusively by what removes. */
#pragma once

#include "common/base/status.h"

struct store_lock {
    int file, blobs; /* descriptors; -1: none */
};
#define STORE_UNLOCKED ((struct store_lock){-1, -1})

/* ERR_REFUSED: another process has it; ERR_IO. After a failure *out is STORE_UNLOCKED. */
status store_lock(struct store_lock *out, const char *folder, struct error *err) MUST_CHECK;
void store_unlock(struct store_lock *lock);

/* Before a removal, of which several may be under way in a process: ERR_REFUSED while a backup holds the store. ERR_IO: not known, or the store's disk is not there. *hold is for
 * store_hold_end, also after a failure. [any thread] */
status store_hold_exclude(const char *folder, int *hold, struct error *err) MUST_CHECK;
/* Before a backup: waits until what is being removed is gone. ERR_IO. */
status store_hold_begin(const char *folder, int *hold, struct error *err) MUST_CHECK;
void store_hold_end(int hold);
