#include "web/base/callers.h"

#include <errno.h>
#include <inttypes.h>
#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "protocol/message.h"

static struct caller_row *find_row(const struct callers *callers, uint64_t number)
{
    for (size_t i = 0; i < callers->count; i++)
        if (callers->rows[i].number == number)
            return &callers->rows[i];
    return NULL;
}

static int is_valid(const struct caller_row *row, int64_t now_s)
{
    return row->expires_at == 0 || now_s < row->expires_at;
}

static void take(const struct caller_row *row, int by_cookie, struct web_caller *out)
{
    out->role = row->role;
    out->token = row->number;
    memcpy(out->token_name, row->name, sizeof out->token_name);
    out->by_cookie = by_cookie;
    memcpy(out->who, row->owner, sizeof out->who);
}

/* ---- what the coordinator tells -------------------------------------------------------------- */

static status take_row(struct caller_row *row, const Azulejo__Wire__PageToken *token, struct error *err)
{
    *row = (struct caller_row){.number = token->token, .role = (enum web_role)token->role, .expires_at = token->expires_at};
    if (token->role <= AZULEJO__WIRE__TOKEN_ROLE__TOKEN_ROLE_NONE || (int)token->role >= (int)WEB_ROLES)
        return error_set(err, STATUS_ERR_PROTOCOL, "token %" PRIu64 " has an unknown role", token->token);
    message_text(row->name, sizeof row->name, token->name);
    message_text(row->owner, sizeof row->owner, token->owner);
    return wire_digest_get(&row->hash, &token->hash, "a token's hash", err);
}

/* What was known, compared with what is. */
static void tell_ended(const struct callers *before, const struct callers *now, caller_ended *ended, void *user)
{
    int cookies = before->is_known && !digest_equal(&before->cookie_key, &now->cookie_key);

    for (size_t i = 0; i < before->count; i++) {
        const struct caller_row *old = &before->rows[i], *row = find_row(now, old->number);
        if (!row || !digest_equal(&row->hash, &old->hash))
            ended(user, old->number, cookies);
    }
}

status callers_set(struct callers *callers, const Azulejo__Wire__PageTokens *message, caller_ended *ended, void *user,
                   struct error *err)
{
    struct callers now = {.is_known = 1};
    status s = wire_digest_get(&now.cookie_key, &message->cookie_key, "the cookies' key", err);

    if (s == STATUS_OK && !MEM_GROW(now.rows, now.capacity, message->n_tokens))
        s = error_no_memory(err, "the tokens");
    for (size_t i = 0; s == STATUS_OK && i < message->n_tokens; i++) {
        const struct caller_row *old = find_row(callers, message->tokens[i]->token);
        s = take_row(&now.rows[now.count], message->tokens[i], err);
        if (s == STATUS_OK) {
            struct caller_row *row = &now.rows[now.count++];
            if (old && digest_equal(&old->hash, &row->hash)) {
                row->told_at = old->told_at;
                row->is_over = old->is_over;
            }
        }
    }
    if (s != STATUS_OK) {
        mem_free(now.rows);
        return s;
    }
    tell_ended(callers, &now, ended, user);
    mem_free(callers->rows);
    callers->rows = now.rows;
    callers->count = now.count;
    callers->capacity = now.capacity;
    callers->cookie_key = now.cookie_key;
    callers->is_known = 1;
    return STATUS_OK;
}

void callers_tick(struct callers *callers, int64_t now_s, caller_ended *ended, void *user)
{
    for (size_t i = 0; i < callers->count; i++)
        if (!callers->rows[i].is_over && !is_valid(&callers->rows[i], now_s)) {
            callers->rows[i].is_over = 1;
            ended(user, callers->rows[i].number, 0);
        }
}

void callers_release(struct callers *callers)
{
    mem_free(callers->rows);
    OPENSSL_cleanse(callers, sizeof *callers);
}

/* ---- finding ---------------------------------------------------------------------------------- */

int callers_find(struct callers *callers, const char *text, int64_t now_s, struct web_caller *out)
{
    const struct caller_row *found = NULL;
    struct digest hash;

    memset(out, 0, sizeof *out);
    if (!token_text_is(text) || token_text_hash(text, &hash, NULL) != STATUS_OK)
        return 0;
    /* All rows, in constant time each: how long it takes says nothing about any of them. */
    for (size_t i = 0; i < callers->count; i++)
        if (CRYPTO_memcmp(&callers->rows[i].hash, &hash, sizeof hash) == 0)
            found = &callers->rows[i];
    if (!found || !is_valid(found, now_s))
        return 0;
    take(found, 0, out);
    return 1;
}

/* 0: OpenSSL failed. */
static int cookie_mac(const struct callers *callers, const struct caller_row *row, int64_t end_s, struct digest *out)
{
    char hex[DIGEST_HEX_SIZE], text[sizeof "azulejo page  " + 20 + 20 + sizeof hex];
    unsigned size = sizeof out->bytes;

    digest_to_hex(&row->hash, hex);
    snprintf(text, sizeof text, "azulejo page %" PRIu64 " %" PRId64 " %s", row->number, end_s, hex);
    return HMAC(EVP_sha256(), callers->cookie_key.bytes, sizeof callers->cookie_key.bytes, (const uint8_t *)text,
                strlen(text), out->bytes, &size) != NULL;
}

/* NUMBER.END.MAC of exactly that form. */
static int cookie_parse(const char *cookie, uint64_t *number, int64_t *end_s, struct digest *mac)
{
    char *end;

    if (strlen(cookie) >= COOKIE_SIZE || cookie[0] < '1' || cookie[0] > '9')
        return 0;
    errno = 0;
    *number = strtoull(cookie, &end, 10);
    if (*end != '.' || end[1] < '1' || end[1] > '9')
        return 0;
    *end_s = strtoll(end + 1, &end, 10);
    return errno == 0 && *end == '.' && digest_from_hex(mac, end + 1) == STATUS_OK;
}

int callers_find_cookie(struct callers *callers, const char *cookie, int64_t now_s, struct web_caller *out)
{
    const struct caller_row *row;
    struct digest mac, right;
    uint64_t number;
    int64_t end_s;

    memset(out, 0, sizeof *out);
    if (!cookie_parse(cookie, &number, &end_s, &mac))
        return 0;
    row = find_row(callers, number);
    if (!row || !cookie_mac(callers, row, end_s, &right) || CRYPTO_memcmp(&mac, &right, sizeof mac) != 0 ||
        now_s >= end_s || !is_valid(row, now_s))
        return 0;
    take(row, 1, out);
    return 1;
}

void callers_cookie(const struct callers *callers, uint64_t token, int64_t now_s, char out[COOKIE_SIZE],
                    int64_t *life_s)
{
    const struct caller_row *row = find_row(callers, token);
    char hex[DIGEST_HEX_SIZE];
    struct digest mac;

    out[0] = 0;
    *life_s = COOKIE_LIFE_S;
    if (!row)
        return;
    if (row->expires_at && row->expires_at - now_s < *life_s)
        *life_s = row->expires_at - now_s;
    if (!cookie_mac(callers, row, now_s + *life_s, &mac))
        return;
    digest_to_hex(&mac, hex);
    snprintf(out, COOKIE_SIZE, "%" PRIu64 ".%" PRId64 ".%s", token, now_s + *life_s, hex);
}

int callers_must_tell(struct callers *callers, uint64_t token, int64_t now_s)
{
    struct caller_row *row = find_row(callers, token);

    if (!row || (now_s - row->told_at < CALLER_TOLD_S && now_s >= row->told_at))
        return 0;
    row->told_at = now_s;
    return 1;
}

const char *callers_name(const struct callers *callers, uint64_t token)
{
    const struct caller_row *row = find_row(callers, token);

    return row ? row->name : "";
}

int callers_note_failure(struct callers *callers, const char *peer, uint64_t now_ns)
{
    callers->failure_count++;
    return token_failures_note(&callers->failures, peer, now_ns);
}
