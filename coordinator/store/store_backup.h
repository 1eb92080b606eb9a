/* store_backup: a store is copied while its coordinator runs, and put back.
 *
 * A backup holds the store (store_hold.h): nothing that a job needs is removed meanwhile. It copies the files, then the database
 * with SQLite's backup API, then the files that have changed since; again if meanwhile pictures
 * were developed or frames of ended jobs went on, so that pictures and rows belong together. Films
 * may be newer than the rows: a frame then goes on from them. A film that is written meanwhile is
 * as after a crash: what is torn at its end is cut off. DIR/backup is written last.
 *
 * A restored store goes on like one that was copied while its coordinator was down, and renders the same bits.
 * Its lease epochs are beyond all that the store has granted since the backup.
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"
#include "coordinator/store/files/copy.h"

/* Into a folder that is empty or not there. ERR_REFUSED: it is neither, or lies in the store; ERR_IO; ERR_NO_MEMORY;
 * ERR_CORRUPT: the folder is no store. */
status store_backup(const char *store, const char *dir, struct copied *sum, struct error *err) MUST_CHECK;
/* Into a store that is empty or not there. ERR_REFUSED: it is neither, or a coordinator uses it; ERR_CORRUPT: `dir` is
 * no complete backup, or its database is damaged; ERR_IO; ERR_NO_MEMORY. Damaged blobs are left out and logged. A
 * restore that was killed is repeated; until then no coordinator starts on the store (store_restoring). */
status store_restore(const char *dir, const char *store, struct copied *sum, struct error *err) MUST_CHECK;
/* Was a restore begun and not ended? */
int store_restoring(const char *store);
