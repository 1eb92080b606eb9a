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
#include "common/base/file.h"
#include "common/base/log.h"

#define KEY_MAGIC "azulejo-key-1"

static const char *const role_names[FARM_ROLE_COUNT] = {"none", "worker", "client", "admin"};

const char *farm_role_name(enum farm_role role)
{
    return (unsigned)role < FARM_ROLE_COUNT ? role_names[role] : "unknown";
}

static enum farm_role role_parse(const char *name, size_t length)
{
    for (int r = FARM_ROLE_WORKER; r < FARM_ROLE_COUNT; r++)
        if (strlen(role_names[r]) == length && memcmp(role_names[r], name, length) == 0)
            return (enum farm_role)r;
    return FARM_ROLE_NONE;
}

static const char *key_name(const struct farm_key *key)
{
    return key->is_farm ? "farm" : farm_role_name(key->role);
}

status farm_key_generate(struct farm_key *key, struct error *err)
{
    memset(key, 0, sizeof *key);
    key->is_farm = 1;
    if (RAND_priv_bytes(key->secret, sizeof key->secret) != 1)
        return error_set(err, STATUS_ERR_INTERNAL, "no random bytes for a key from the system");
    return STATUS_OK;
}

/* HKDF-SHA256 (RFC 5869): salt "azulejo-key-1", info "role NAME". */
static status role_secret(const uint8_t farm[FARM_KEY_BYTES], enum farm_role role,
                          uint8_t secret[FARM_KEY_BYTES], struct error *err)
{
    EVP_KDF *kdf = EVP_KDF_fetch(NULL, "HKDF", NULL);
    EVP_KDF_CTX *ctx = kdf ? EVP_KDF_CTX_new(kdf) : NULL;
    char info[32], hash[] = "SHA256", salt[] = KEY_MAGIC;
    uint8_t master[FARM_KEY_BYTES];
    int ok = 0;

    snprintf(info, sizeof info, "role %s", farm_role_name(role));
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
        return error_set(err, STATUS_ERR_INTERNAL, "OpenSSL cannot derive the %s key (HKDF-SHA256)",
                         farm_role_name(role));
    return STATUS_OK;
}

status farm_key_for_role(const struct farm_key *key, enum farm_role role,
                         uint8_t secret[FARM_KEY_BYTES], struct error *err)
{
    memset(secret, 0, FARM_KEY_BYTES);
    if (role <= FARM_ROLE_NONE || role >= FARM_ROLE_COUNT)
        return error_set(err, STATUS_ERR_INTERNAL, "no key for role %d", (int)role);
    if (key->is_farm)
        return role_secret(key->secret, role, secret, err);
    if (key->role != role)
        return error_set(err, STATUS_ERR_REFUSED,
                         "the %s key cannot act as %s: use the farm key or the %s key",
                         key_name(key), farm_role_name(role), farm_role_name(role));
    memcpy(secret, key->secret, FARM_KEY_BYTES);
    return STATUS_OK;
}

status farm_key_derive(const struct farm_key *farm, enum farm_role role, struct farm_key *out,
                       struct error *err)
{
    memset(out, 0, sizeof *out);
    out->role = role;
    return farm_key_for_role(farm, role, out->secret, err);
}

/* One line "azulejo-key-1 ROLE HEX64" of `length` bytes. */
static status key_parse_line(struct farm_key *key, const char *line, size_t length,
                             struct error *err)
{
    char magic[32], role[16], hex[DIGEST_HEX_SIZE + 1], rest[2], copy[160];
    struct digest secret;

    if (length >= sizeof copy)
        return error_set(err, STATUS_ERR_INPUT, "the line is too long");
    memcpy(copy, line, length);
    copy[length] = 0;
    if (strlen(copy) != length || sscanf(copy, "%31s %15s %65s %1s", magic, role, hex, rest) != 3 ||
        strcmp(magic, KEY_MAGIC) != 0)
        return error_set(err, STATUS_ERR_INPUT,
                         "not of the form '" KEY_MAGIC " ROLE 64-hex-digits'");
    if (digest_from_hex(&secret, hex) != STATUS_OK)
        return error_set(err, STATUS_ERR_INPUT, "the key is not 64 hexadecimal digits");
    key->is_farm = strcmp(role, "farm") == 0;
    key->role = role_parse(role, strlen(role));
    if (!key->is_farm && key->role == FARM_ROLE_NONE)
        return error_set(err, STATUS_ERR_INPUT,
                         "unknown role '%s' (farm, worker, client or admin)", role);
    memcpy(key->secret, secret.bytes, FARM_KEY_BYTES);
    OPENSSL_cleanse(&secret, sizeof secret);
    OPENSSL_cleanse(copy, sizeof copy);
    OPENSSL_cleanse(hex, sizeof hex);
    return STATUS_OK;
}

/* Skip blank lines and comments; exactly one key must remain. */
static status key_parse(struct farm_key *key, const char *text, size_t size, const char *path,
                        struct error *err)
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
            return error_set(err, STATUS_ERR_INPUT,
                             "%s, line %u: a second key; keep one key per file", path, line);
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
    if (s == STATUS_OK)
        s = key_parse(key, buffer_text(&text), text.size, path, err);
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
    char hex[DIGEST_HEX_SIZE];

    memcpy(secret.bytes, key->secret, FARM_KEY_BYTES);
    digest_to_hex(&secret, hex);
    buffer_printf(out,
                  "# Azulejo %s key: anyone who holds it can join the farm%s%s. Keep it secret.\n",
                  key_name(key), key->is_farm ? "" : " as ", key->is_farm ? "" : key_name(key));
    buffer_printf(out, KEY_MAGIC " %s %s\n", key_name(key), hex);
    OPENSSL_cleanse(hex, sizeof hex);
    OPENSSL_cleanse(&secret, sizeof secret);
}
