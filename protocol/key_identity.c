#include "protocol/key_identity.h"

#include <stdio.h>
#include <string.h>

static const char *const role_names[FARM_ROLE_COUNT] = {"none", "worker", "client", "admin", "web"};

const char *farm_role_name(enum farm_role role)
{
    return (unsigned)role < FARM_ROLE_COUNT ? role_names[role] : "unknown";
}

struct key_identity key_identity_shared(enum farm_role role)
{
    struct key_identity id = {0};

    if (role <= FARM_ROLE_NONE || role >= FARM_ROLE_COUNT)
        return id;
    id.role = role;
    id.may = role == FARM_ROLE_CLIENT || role == FARM_ROLE_ADMIN ? WEB_ROLE_ADMIN : WEB_ROLE_NONE;
    return id;
}

int key_identity_set_role(struct key_identity *out, const char *word)
{
    out->may = web_role_parse(word);
    out->role = strcmp(word, "worker") == 0 ? FARM_ROLE_WORKER : out->may ? FARM_ROLE_CLIENT : FARM_ROLE_NONE;
    return out->role != FARM_ROLE_NONE;
}

const char *key_identity_role(const struct key_identity *id)
{
    return id->name[0] && id->role == FARM_ROLE_CLIENT ? web_role_name(id->may) : farm_role_name(id->role);
}

int key_name_is_valid(const char *name)
{
    static const char allowed[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-@";
    size_t length = strlen(name);

    /* Not an option, for who types it. */
    return length > 0 && length <= KEY_NAME_MAX && name[0] != '-' && strspn(name, allowed) == length;
}

const char *key_identity_print(const struct key_identity *id, char out[KEY_IDENTITY_SIZE])
{
    if (id->name[0])
        snprintf(out, KEY_IDENTITY_SIZE, "azulejo-2 %s %u %s", key_identity_role(id), id->generation, id->name);
    else
        snprintf(out, KEY_IDENTITY_SIZE, "azulejo-1 %s", farm_role_name(id->role));
    return out;
}

/* The words of a text; a text that is not what they print is no identity, so zeros before a number and a second blank
 * are refused without a rule of their own. */
static int parse_words(struct key_identity *out, const char *text)
{
    char role[16], name[KEY_NAME_MAX + 2];

    if (sscanf(text, "azulejo-1 %15s", role) == 1) {
        for (int r = FARM_ROLE_WORKER; r < FARM_ROLE_COUNT; r++)
            if (strcmp(role, role_names[r]) == 0)
                *out = key_identity_shared((enum farm_role)r);
        return out->role != FARM_ROLE_NONE;
    }
    if (sscanf(text, "azulejo-2 %15s %7u %64s", role, &out->generation, name) != 3 || !key_name_is_valid(name) ||
        out->generation < 1 || out->generation > KEY_GENERATION_MAX)
        return 0;
    memcpy(out->name, name, strlen(name) + 1);
    return key_identity_set_role(out, role);
}

int key_identity_parse(struct key_identity *out, const void *text, size_t size)
{
    char copy[KEY_IDENTITY_SIZE], printed[KEY_IDENTITY_SIZE];

    memset(out, 0, sizeof *out);
    if (size < sizeof copy) {
        memcpy(copy, text, size);
        copy[size] = 0;
        if (parse_words(out, copy) && strlen(key_identity_print(out, printed)) == size &&
            memcmp(printed, copy, size) == 0)
            return 1;
    }
    memset(out, 0, sizeof *out);
    return 0;
}

int key_identity_equal(const struct key_identity *a, const struct key_identity *b)
{
    return a->role == b->role && a->may == b->may && a->generation == b->generation && strcmp(a->name, b->name) == 0;
}

const char *key_identity_words(const struct key_identity *id, char out[KEY_WORDS_SIZE])
{
    if (id->name[0])
        snprintf(out, KEY_WORDS_SIZE, "%s key of %s (generation %u)", key_identity_role(id), id->name, id->generation);
    else
        snprintf(out, KEY_WORDS_SIZE, "%s key", farm_role_name(id->role));
    return out;
}
