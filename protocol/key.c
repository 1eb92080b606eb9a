#include "protocol/key.h"

#include <openssl/core_names.h>
#include <openssl/crypto.h>
#include <openssl/kdf.h>
#include <openssl/params.h>
#include <openssl/rand.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "common/base/digest.h"
#include "common/system/file.h"
#include "common/system/log.h"

#define KEY_MAGIC "azulejo-key-1"       /* of what a role shares, and of the farm's own */
#define KEY_MAGIC_NAMED "azulejo-key-2"

static const char *key_words(const struct farm_key *key, char out[KEY_WORDS_SIZE])
{
    return key->is_farm ? "farm key" : key_identity_words(&key->id, out);
}

status farm_key_generate(struct farm_key *key, struct error *err)
{
    memset(key, 0, sizeof *key);
    key->is_farm = 1;
    if (RAND_priv_bytes(key->secret, sizeof key->secret) != 1)
        return error_set(err, STATUS_ERR_INTERNAL, "no random bytes for a key from the system");
    return STATUS_OK;
}

/* HKDF-SHA256 (RFC 5869) of the farm's key: salt "azulejo-key-1" and info "role ROLE"; of a named key salt
 * "azulejo-key-2" and info "role ROLE GENERATION NAME". */
static status derive_secret(const uint8_t farm[FARM_KEY_BYTES], const struct key_identity *id,
                            uint8_t secret[FARM_KEY_BYTES], struct error *err)
{
    EVP_KDF *kdf = EVP_KDF_fetch(NULL, "HKDF", NULL);
    EVP_KDF_CTX *ctx = kdf ? EVP_KDF_CTX_new(kdf) : NULL;
    char info[KEY_IDENTITY_SIZE], hash[] = "SHA256", words[KEY_WORDS_SIZE];
    char shared_salt[] = KEY_MAGIC, named_salt[] = KEY_MAGIC_NAMED, *salt = id->name[0] ? named_salt : shared_salt;
    uint8_t master[FARM_KEY_BYTES];
    int ok = 0;

    if (id->name[0])
        snprintf(info, sizeof info, "role %s %u %s", key_identity_role(id), id->generation, id->name);
    else
        snprintf(info, sizeof info, "role %s", key_identity_role(id));
    memcpy(master, farm, sizeof master);
    if (ctx) {
        OSSL_PARAM params[] = {
            OSSL_PARAM_construct_utf8_string(OSSL_KDF_PARAM_DIGEST, hash, 0),
            OSSL_PARAM_construct_octet_string(OSSL_KDF_PARAM_KEY, master, sizeof master),
            OSSL_PARAM_construct_octet_string(OSSL_KDF_PARAM_SALT, salt, strlen(salt)),
            OSSL_PARAM_construct_octet_string(OSSL_KDF_PARAM_INFO, info, strlen(info)),
            OSSL_PARAM_construct_end(),
        };
        ok = EVP_KDF_derive(ctx, secret, FARM_KEY_BYTES, params) == 1;
    }
    OPENSSL_cleanse(master, sizeof master);
    EVP_KDF_CTX_free(ctx);
    EVP_KDF_free(kdf);
    if (!ok)
        return error_set(err, STATUS_ERR_INTERNAL, "OpenSSL cannot derive the %s (HKDF-SHA256)",
                         key_identity_words(id, words));
    return STATUS_OK;
}

status farm_key_identity(const struct farm_key *key, enum farm_role role, struct key_identity *out, struct error *err)
{
    char words[KEY_WORDS_SIZE];

    memset(out, 0, sizeof *out);
    if (role <= FARM_ROLE_NONE || role >= FARM_ROLE_COUNT)
        return error_set(err, STATUS_ERR_INTERNAL, "no key for role %d", (int)role);
    if (!key->is_farm && key->id.role != role)
        return error_set(err, STATUS_ERR_REFUSED, "the %s cannot act as %s: use a key of that role (azulejo key new)",
                         key_words(key, words), farm_role_name(role));
    *out = key->is_farm ? key_identity_shared(role) : key->id;
    return STATUS_OK;
}

status farm_key_secret(const struct farm_key *key, const struct key_identity *id, uint8_t secret[FARM_KEY_BYTES],
                       struct error *err)
{
    char words[KEY_WORDS_SIZE], wanted[KEY_WORDS_SIZE];

    memset(secret, 0, FARM_KEY_BYTES);
    if (id->role <= FARM_ROLE_NONE || id->role >= FARM_ROLE_COUNT)
        return error_set(err, STATUS_ERR_INTERNAL, "no key for role %d", (int)id->role);
    if (key->is_farm)
        return derive_secret(key->secret, id, secret, err);
    if (!key_identity_equal(&key->id, id))
        return error_set(err, STATUS_ERR_REFUSED, "the %s is not the %s", key_words(key, words),
                         key_identity_words(id, wanted));
    memcpy(secret, key->secret, FARM_KEY_BYTES);
    return STATUS_OK;
}

status farm_key_for_role(const struct farm_key *key, enum farm_role role, uint8_t secret[FARM_KEY_BYTES],
                         struct error *err)
{
    struct key_identity id;
    status s = farm_key_identity(key, role, &id, err);

    memset(secret, 0, FARM_KEY_BYTES);
    return s == STATUS_OK ? farm_key_secret(key, &id, secret, err) : s;
}

status farm_key_derive(const struct farm_key *farm, enum farm_role role, struct farm_key *out, struct error *err)
{
    memset(out, 0, sizeof *out);
    out->id = key_identity_shared(role);
    return farm_key_for_role(farm, role, out->secret, err);
}

status farm_key_derive_named(const struct farm_key *farm, const struct key_identity *id, struct farm_key *out,
                             struct error *err)
{
    memset(out, 0, sizeof *out);
    out->id = *id;
    return farm_key_secret(farm, id, out->secret, err);
}

/* The words of a line; 0: of neither form. A named key's identity is checked as the wire's is. */
static int key_parse_words(struct farm_key *key, const char *line, char hex[DIGEST_HEX_SIZE + 1], struct error *err)
{
    char role[16], generation[8], name[KEY_NAME_MAX + 2], rest[2], text[KEY_IDENTITY_SIZE];

    if (sscanf(line, KEY_MAGIC_NAMED " %15s %7s %64s %65s %1s", role, generation, name, hex, rest) == 4) {
        snprintf(text, sizeof text, "azulejo-2 %s %s %s", role, generation, name);
        if (!key_identity_parse(&key->id, text, strlen(text)))
            (void)error_set(err, STATUS_ERR_INPUT, "not the key of a role, a generation and a name");
        return key->id.role != FARM_ROLE_NONE;
    }
    if (sscanf(line, KEY_MAGIC " %15s %65s %1s", role, hex, rest) != 2) {
        (void)error_set(err, STATUS_ERR_INPUT, "not of the form '" KEY_MAGIC " ROLE 64-hex-digits' nor '" KEY_MAGIC_NAMED
                        " ROLE GENERATION NAME 64-hex-digits'");
        return 0;
    }
    key->is_farm = strcmp(role, "farm") == 0;
    snprintf(text, sizeof text, "azulejo-1 %s", role);
    if (!key->is_farm && !key_identity_parse(&key->id, text, strlen(text)))
        (void)error_set(err, STATUS_ERR_INPUT, "unknown role '%s' (farm, worker, client, admin or web)", role);
    return key->is_farm || key->id.role != FARM_ROLE_NONE;
}

/* One line of `length` bytes. */
static status key_parse_line(struct farm_key *key, const char *line, size_t length, struct error *err)
{
    char hex[DIGEST_HEX_SIZE + 1] = "", copy[256];
    struct digest secret = {0};
    status s = STATUS_OK;

    memset(key, 0, sizeof *key);
    if (length >= sizeof copy)
        return error_set(err, STATUS_ERR_INPUT, "the line is too long");
    memcpy(copy, line, length);
    copy[length] = 0;
    if (strlen(copy) != length)
        s = error_set(err, STATUS_ERR_INPUT, "has a byte that is no text");
    else if (!key_parse_words(key, copy, hex, err))
        s = STATUS_ERR_INPUT;
    else if (digest_from_hex(&secret, hex) != STATUS_OK)
        s = error_set(err, STATUS_ERR_INPUT, "the key is not 64 hexadecimal digits");
    memcpy(key->secret, secret.bytes, FARM_KEY_BYTES);
    OPENSSL_cleanse(&secret, sizeof secret);
    OPENSSL_cleanse(copy, sizeof copy);
    OPENSSL_cleanse(hex, sizeof hex);
    return s;
}

/* Skip blank lines and comments; exactly one key must remain. */
status farm_key_parse(struct farm_key *key, const char *text, size_t size, const char *path, struct error *err)
{
    size_t at = 0;
    unsigned line = 0, found = 0;

    while (at < size) {
        const char *end = memchr(text + at, '\n', size - at);
        size_t next = end ? (size_t)(end - text) + 1 : size;
        size_t first = at, last = end ? next - 1 : size;
        line++;
        at = next;
        while (first < last && strchr(" \t\r", text[first]) && text[first])
            first++;
        if (first == last || text[first] == '#')
            continue;
        if (found++)
            return error_set(err, STATUS_ERR_INPUT, "%s, line %u: a second key; keep one key per file", path, line);
        if (key_parse_line(key, text + first, last - first, err) != STATUS_OK) {
            error_prefix(err, "%s, line %u", path, line);
            return STATUS_ERR_INPUT;
        }
    }
    if (!found)
        return error_set(err, STATUS_ERR_INPUT, "%s: has no '" KEY_MAGIC " ...' line", path);
    return STATUS_OK;
}

status farm_key_load(struct farm_key *key, const char *path, struct error *err)
{
    struct buffer text = BUFFER_INIT;
    struct stat info;
    status s;

    memset(key, 0, sizeof *key);
    s = file_read(path, FARM_KEY_FILE_MAX, &text, err);
    THEN(s, farm_key_parse(key, buffer_text(&text), text.size, path, err));
    if (text.data)
        OPENSSL_cleanse(text.data, text.capacity);
    buffer_release(&text);
    if (s != STATUS_OK) {
        OPENSSL_cleanse(key, sizeof *key);
        if (s == STATUS_ERR_LIMIT && err)
            err->code = STATUS_ERR_INPUT;
        return s == STATUS_ERR_LIMIT ? STATUS_ERR_INPUT : s;
    }
    if (stat(path, &info) == 0 && S_ISREG(info.st_mode) && (info.st_mode & 077))
        log_warn("%s: others may read this key; chmod 600 it", path);
    return STATUS_OK;
}

void farm_key_print(const struct farm_key *key, struct buffer *out)
{
    struct digest secret;
    char hex[DIGEST_HEX_SIZE], words[KEY_WORDS_SIZE];
    const char *role = key->is_farm ? "farm" : key_identity_role(&key->id);

    memcpy(secret.bytes, key->secret, FARM_KEY_BYTES);
    digest_to_hex(&secret, hex);
    buffer_printf(out, "# Azulejo %s: anyone who holds it can join the farm", key_words(key, words));
    if (key->id.name[0]) {
        buffer_printf(out, " as %s. Keep it secret.\n", key->id.name);
        buffer_printf(out, KEY_MAGIC_NAMED " %s %u %s %s\n", role, key->id.generation, key->id.name, hex);
    } else {
        buffer_printf(out, "%s%s. Keep it secret.\n", key->is_farm ? "" : " as ", key->is_farm ? "" : role);
        buffer_printf(out, KEY_MAGIC " %s %s\n", role, hex);
    }
    OPENSSL_cleanse(hex, sizeof hex);
    OPENSSL_cleanse(&secret, sizeof secret);
}
