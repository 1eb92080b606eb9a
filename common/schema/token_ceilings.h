/* token_ceilings: what one token, or key of a name, may take of the farm at once, by its role, each once. docs/OPERATIONS.md has the same table.
 *
 * CEILING(NAME, blob_gib, jobs_percent, previews, connections)
 *   blob_gib     GiB of blobs that it sent and no job needs (coordinator/net/base/holders.h); 0: none may be sent
 *   jobs_percent  of the disk, what its owner's jobs have with their scenes (coordinator/steering/owner_room.h); 100: all
 *   previews     pictures that are made for it at the same time
 *   connections  to the page, of all addresses together; of a key to the coordinator, where a worker's key
 *                has a ceiling of its own (coordinator/net/door.h) */
#pragma once

#include <stdint.h>

#include "common/schema/token_roles.h"

#define TOKEN_CEILINGS(CEILING)    \
    CEILING(NONE, 0, 0, 1, 64)          \
    CEILING(VIEW, 0, 0, 1, 64)          \
    CEILING(SUBMIT, 16, 50, 2, 64)      \
    CEILING(OPERATE, 64, 100, 2, 96)    \
    CEILING(ADMIN, 256, 100, 4, 128)

struct token_ceiling {
    uint64_t blob_bytes;
    uint32_t jobs_percent, previews, connections;
};

static inline struct token_ceiling token_ceiling_of(enum web_role role)
{
    static const struct token_ceiling all[WEB_ROLES] = {
#define CEILING(NAME, gib, jobs, previews, connections) [WEB_ROLE_##NAME] = {(uint64_t)(gib) << 30, jobs, previews, connections},
        TOKEN_CEILINGS(CEILING)
#undef CEILING
    };

    return all[role < WEB_ROLES ? role : WEB_ROLE_NONE];
}
