/* key_identity: whose key a connection was made with, as TLS proves it.
 *
 * Two kinds of keys: those that all of a role share, and those of a name. As text, which is the PSK identity:
 *
 *   azulejo-1 ROLE                   ROLE: worker, client, admin, web
 *   azulejo-2 ROLE GENERATION NAME   ROLE: worker, view, submit, operate, admin
 *
 * GENERATION counts a name's keys from 1: the coordinator says which of them are good (coordinator/net/base/keyring.h).
 * Each identity has one text, and each text at most one identity.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/schema/token_roles.h"

enum {
    KEY_NAME_MAX = 63,            /* bytes */
    KEY_GENERATION_MAX = 1000000,
    KEY_IDENTITY_SIZE = 112,      /* of the longest text, with its end */
    KEY_WORDS_SIZE = 128,
};

/* Who speaks: which side of the protocol it is on. */
enum farm_role {
    FARM_ROLE_NONE,
    FARM_ROLE_WORKER,
    FARM_ROLE_CLIENT,
    FARM_ROLE_ADMIN,
    FARM_ROLE_WEB,
    FARM_ROLE_COUNT
};

struct key_identity {
    enum farm_role role;         /* of a named one: worker or client */
    enum web_role may;           /* what a client may ask for; NONE for others */
    char name[KEY_NAME_MAX + 1]; /* "": the role shares it */
    uint32_t generation;         /* 0: the role shares it */
};

const char *farm_role_name(enum farm_role role); /* "worker", "client", "admin", "web" */

/* The key that all of a role share. All-zero for what is no role. */
struct key_identity key_identity_shared(enum farm_role role);
/* "worker", "view", "submit", "operate" or "admin": put role and may into *out. 0: another word. */
int key_identity_set_role(struct key_identity *out, const char *word);
/* The word of its role, also of a shared key. */
const char *key_identity_role(const struct key_identity *id);

/* 1 to KEY_NAME_MAX letters, digits, '.', '_', '-' and '@', the first no '-'. */
int key_name_is_valid(const char *name);

/* The PSK identity. Returns `out`. */
const char *key_identity_print(const struct key_identity *id, char out[KEY_IDENTITY_SIZE]);
/* Any bytes. 0: they are no identity, and *out is zeroed. */
int key_identity_parse(struct key_identity *out, const void *text, size_t size);
int key_identity_equal(const struct key_identity *a, const struct key_identity *b);

/* For people: "client key", "submit key of anna (generation 2)". Returns `out`. */
const char *key_identity_words(const struct key_identity *id, char out[KEY_WORDS_SIZE]);
