/* store_hold: a backup copies a store while its coordinator runs; meanwhile nothing that the copy may need is
 * removed from it. STORE/hold is locked (flock): shared by backups, exclusively by what removes. */
#ifndef AZULEJO_COORDINATOR_STORE_HOLD_H
#define AZULEJO_COORDINATOR_STORE_HOLD_H

#include "common/base/status.h"

/* Before a removal: ERR_REFUSED while a backup holds the store. ERR_IO: not known, or the store's disk is not there. *hold is for
 * store_hold_end, also after a failure. [any thread] */
status store_hold_exclude(const char *folder, int *hold, struct error *err) MUST_CHECK;
/* Before a backup: waits until what is being removed is gone. ERR_IO. */
status store_hold_begin(const char *folder, int *hold, struct error *err) MUST_CHECK;
void store_hold_end(int hold);

#endif
