/* key: the farm's secret, and the keys that each role derives from it.
 *
 * A key file is text: a line "azulejo-key-1 ROLE HEX64" (# comments allowed). The farm
 * key (role "farm") is the master; role keys are HKDF-SHA256 of it, so anyone who holds the
 * farm key can act in every role, and a worker's key file gives no client access. The TLS
 * PSK identity is "azulejo-1 ROLE".
 */
#ifndef AZULEJO_PROTOCOL_KEY_H
#define AZULEJO_PROTOCOL_KEY_H

#include <stdint.h>

#include "common/base/buffer.h"
#include "common/base/status.h"

enum { FARM_KEY_BYTES = 32, FARM_KEY_FILE_MAX = 4096 };

enum farm_role {
    FARM_ROLE_NONE,
    FARM_ROLE_WORKER,
    FARM_ROLE_CLIENT,
    FARM_ROLE_ADMIN,
    FARM_ROLE_COUNT
};

struct farm_key {
    int is_farm;                 /* the master; otherwise only `role`'s secret is known */
    enum farm_role role;
    uint8_t secret[FARM_KEY_BYTES];
};

const char *farm_role_name(enum farm_role role); /* "worker", "client", "admin" */

/* A new random farm key. */
status farm_key_generate(struct farm_key *key, struct error *err) MUST_CHECK;

/* The key of one role, from the farm key or from that role's own key; ERR_REFUSED when
 * `key` belongs to another role. */
status farm_key_for_role(const struct farm_key *key, enum farm_role role,
                         uint8_t secret[FARM_KEY_BYTES], struct error *err) MUST_CHECK;
status farm_key_derive(const struct farm_key *farm, enum farm_role role, struct farm_key *out,
                       struct error *err) MUST_CHECK;

/* Read a key file; log a warning if others than the owner may read it. ERR_INPUT. */
status farm_key_load(struct farm_key *key, const char *path, struct error *err) MUST_CHECK;
/* Append the file's text. */
void farm_key_print(const struct farm_key *key, struct buffer *out);

#endif
