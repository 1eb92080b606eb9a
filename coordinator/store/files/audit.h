/* audit: STORE/audit.log, who did what: a line of JSON for each change that a client asked for.
 *
 * Above AUDIT_FILE_BYTES it becomes audit.log.1, that one audit.log.2 and so on; of these AUDIT_OLD_FILES stay.
 * A line is written at once, but not synced: it survives the coordinator's end, not always a power failure.
 * If it cannot be written no request is refused: the log says so once, and the next line that can be
 * written has in "lost" how many could not.
 */
#pragma once

#include <stdint.h>

#include "common/base/buffer.h"
#include "common/base/status.h"

enum {
    AUDIT_FILE_BYTES = 8 << 20,
    AUDIT_OLD_FILES = 4,
    AUDIT_DETAILS_MAX = 4096,    /* bytes of a line's details; longer ones are left out */
};

/* Who asks, as far as it is known. */
struct audit_actor {
    char who[128];    /* user@host, as the client says */
    char address[64]; /* that its connection comes from */
    char key[96];     /* the role that its key proved, and its generation and name: "submit 1 ana"; "": it is the
                       * coordinator itself */
    uint32_t session;
};

struct audit {
    char *path; /* NULL: nothing is written */
    int fd;     /* -1: not open */
    uint64_t lost;
    int failing; /* and this was logged */
};

/* For the store's folder; NULL: nothing is written. ERR_NO_MEMORY. */
status audit_init(struct audit *a, const char *folder, struct error *err) MUST_CHECK;
void audit_release(struct audit *a);

/* Write a line. `job` 0: of none; `details`: a JSON object, or NULL. `why`: why it was refused or failed; NULL:
 * it is done. */
void audit_note(struct audit *a, const struct audit_actor *actor, const char *verb, uint64_t job, const char *details,
                const struct error *why);
