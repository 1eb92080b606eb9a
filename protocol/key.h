/* key: the farm's secret, and the keys that are derived from it: one for each role, and one for each name.
 *
 * A key file is text: a line "azulejo-key-1 ROLE HEX64", or "azulejo-key-2 ROLE GENERATION NAME HEX64" (# comments
 * allowed). The farm key (role "farm") is the master; the others are HKDF-SHA256 of it and their identity, so anyone who
 * holds the farm key can act as anyone, and the coordinator, which does, knows every key from its name. Any
 * other key opens its own identity alone: its holder can neither act as somebody else nor as a coordinator to them.
 */
#pragma once

#include <stdint.h>

#include "common/base/buffer.h"
#include "common/base/status.h"
#include "protocol/key_identity.h"

enum { FARM_KEY_BYTES = 32, FARM_KEY_FILE_MAX = 4096 };

struct farm_key {
    int is_farm;            /* the master; otherwise only the secret of `id` is known */
    struct key_identity id; /* zero for the master */
    uint8_t secret[FARM_KEY_BYTES];
};

/* A new random farm key. */
status farm_key_generate(struct farm_key *key, struct error *err) MUST_CHECK;

/* What `key` proves when it is used in a role: the shared identity of the farm key, else its own. ERR_REFUSED when it
 * belongs to another role. */
status farm_key_identity(const struct farm_key *key, enum farm_role role, struct key_identity *out,
                         struct error *err) MUST_CHECK;
/* The secret of an identity, from the farm key or from that identity's own key; ERR_REFUSED when `key` is another's. */
status farm_key_secret(const struct farm_key *key, const struct key_identity *id, uint8_t secret[FARM_KEY_BYTES],
                       struct error *err) MUST_CHECK;
/* That of what it proves in a role. */
status farm_key_for_role(const struct farm_key *key, enum farm_role role, uint8_t secret[FARM_KEY_BYTES],
                         struct error *err) MUST_CHECK;
/* The key that all of a role share, and that of an identity. */
status farm_key_derive(const struct farm_key *farm, enum farm_role role, struct farm_key *out,
                       struct error *err) MUST_CHECK;
status farm_key_derive_named(const struct farm_key *farm, const struct key_identity *id, struct farm_key *out,
                             struct error *err) MUST_CHECK;

/* The text of a key file; `path` is for messages. ERR_INPUT. */
status farm_key_parse(struct farm_key *key, const char *text, size_t size, const char *path,
                      struct error *err) MUST_CHECK;
/* Read a key file; log a warning if others than the owner may read it. ERR_INPUT. */
status farm_key_load(struct farm_key *key, const char *path, struct error *err) MUST_CHECK;
/* Append the file's text. */
void farm_key_print(const struct farm_key *key, struct buffer *out);
