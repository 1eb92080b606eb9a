#include "coordinator/web/tokens.h"

#include <errno.h>
#include <inttypes.h>
#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>
#include <openssl/rand.h>
#include <pwd.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/base/clock.h"
#include "common/base/file.h"
#include "common/base/log.h"
#include "common/base/memory.h"
#include "coordinator/store/store.h"
#include "coordinator/web/token_failures.h"

#define TOKEN_PREFIX "azt_" /* so that programs that look for secrets in files know what it is */
_Static_assert((int)WEB_TOKEN_NAME_MAX == (int)TOKEN_NAME_MAX && (int)WEB_WHO_MAX >= (int)JOB_WHO_MAX,
               "a caller has room for its token's texts");
enum { TOKEN_FILE_MAX = 4096, PREFIX_LENGTH = sizeof TOKEN_PREFIX - 1 };

struct web_tokens {
    struct store *store;
    web_token_ended *ended;
    void *user;
    char own[TOKEN_TEXT_SIZE];
    struct token_row *rows;      /* ascending; [0] is the coordinator's own */
    struct token_mark {
        int64_t told;            /* the used_at that the store knows */
        int ended;               /* its end was told */
    } *marks;                    /* of each row */
    size_t count, capacity, mark_capacity;
    struct token_failures failures;
    uint64_t failure_count;
};

static const char *const role_names[WEB_ROLES] = {"none", "view", "submit", "operate", "admin"};

const char *web_role_name(enum web_role role)
{
    return role < WEB_ROLES ? role_names[role] : role_names[WEB_ROLE_NONE];
}

/* ---- texts and hashes ------------------------------------------------------------------------- */

static status hash_of(const char *text, struct digest *out, struct error *err)
{
    status s = digest_of(out, text, strlen(text));

    return s == STATUS_OK ? s : error_set(err, s, "a token's SHA-256 cannot be computed");
}

static status make_text(char out[TOKEN_TEXT_SIZE], struct error *err)
{
    struct digest random;

    if (RAND_bytes(random.bytes, sizeof random.bytes) != 1)
        return error_set(err, STATUS_ERR_INTERNAL, "OpenSSL has no random numbers for a token");
    memcpy(out, TOKEN_PREFIX, PREFIX_LENGTH);
    digest_to_hex(&random, out + PREFIX_LENGTH);
    OPENSSL_cleanse(&random, sizeof random);
    return STATUS_OK;
}

static int is_text(const char *text)
{
    struct digest bytes;

    return strlen(text) == TOKEN_TEXT_SIZE - 1 && strncmp(text, TOKEN_PREFIX, PREFIX_LENGTH) == 0 &&
           digest_from_hex(&bytes, text + PREFIX_LENGTH) == STATUS_OK;
}

/* ---- rows ------------------------------------------------------------------------------------- */

static struct token_row *find_row(const struct web_tokens *tokens, uint64_t number)
{
    for (size_t i = 0; i < tokens->count; i++)
        if (tokens->rows[i].number == number)
            return &tokens->rows[i];
    return NULL;
}

static status add_row(struct web_tokens *tokens, const struct token_row *row, struct error *err)
{
    if (!MEM_GROW(tokens->rows, tokens->capacity, tokens->count + 1) ||
        !MEM_GROW(tokens->marks, tokens->mark_capacity, tokens->count + 1))
        return error_no_memory(err, "the tokens");
    tokens->marks[tokens->count] = (struct token_mark){.told = row->used_at};
    tokens->rows[tokens->count++] = *row;
    return STATUS_OK;
}

static status take_row(void *user, const struct token_row *row, struct error *err)
{
    if (row->role <= WEB_ROLE_NONE || row->role >= WEB_ROLES)
        return error_set(err, STATUS_ERR_CORRUPT, "token %" PRIu64 " has an unknown role", row->number);
    return add_row(user, row, err);
}

const struct token_row *web_tokens_rows(const struct web_tokens *tokens, size_t *count)
{
    *count = tokens->count;
    return tokens->rows;
}

const struct token_row *web_token_row(const struct web_tokens *tokens, uint64_t token)
{
    return find_row(tokens, token);
}

/* ---- the coordinator's own -------------------------------------------------------------------- */

static char *own_path(const struct web_tokens *tokens, struct error *err)
{
    char *path = file_join(store_folder(tokens->store), "web.token");

    if (!path)
        error_no_memory(err, "the page's token");
    return path;
}

/* Who jobs submitted with it belong to: the person that runs the coordinator. */
static void own_owner(char *out, size_t size)
{
    const struct passwd *entry = getpwuid(getuid());
    char host[64] = "";

    (void)gethostname(host, sizeof host - 1);
    snprintf(out, size, "%.62s%s%s", entry ? entry->pw_name : "", entry ? "@" : "", host);
}

/* Without a disk it is good for this run. */
static status own_make(struct web_tokens *tokens, const char *path, struct error *err)
{
    char line[TOKEN_TEXT_SIZE + 1];
    struct error why = {0};
    status s = make_text(tokens->own, err);

    if (s != STATUS_OK)
        return s;
    snprintf(line, sizeof line, "%s\n", tokens->own);
    if (file_write_private(path, line, strlen(line), &why) != STATUS_OK)
        log_warn("the page's token changes with the next start: %s", why.text);
    return STATUS_OK;
}

static status own_read(struct web_tokens *tokens, const char *path, struct stat *info, struct error *err)
{
    struct buffer text = BUFFER_INIT;
    status s = file_read(path, TOKEN_FILE_MAX, &text, err);

    if (s == STATUS_OK) {
        char word[TOKEN_TEXT_SIZE + 1] = "";
        snprintf(word, sizeof word, "%.*s", (int)strcspn(buffer_text(&text), " \r\n"), buffer_text(&text));
        if (is_text(word))
            memcpy(tokens->own, word, sizeof tokens->own);
        else
            s = error_set(err, STATUS_ERR_CORRUPT,
                          "%s: does not hold the page's token; remove it, and the next start makes a new one", path);
        OPENSSL_cleanse(word, sizeof word);
    }
    if (text.data)
        OPENSSL_cleanse(text.data, text.size);
    buffer_release(&text);
    if (s == STATUS_OK && info->st_mode & 077)
        log_warn("%s: other users may read it, and do everything with the page; run chmod 600 on it", path);
    return s;
}

static status own_load(struct web_tokens *tokens, struct error *err)
{
    struct token_row row = {.number = TOKEN_OWN, .name = "this coordinator's", .role = WEB_ROLE_ADMIN,
                            .made_by = "coordinator"};
    char *path = own_path(tokens, err);
    struct stat info;
    status s;

    if (!path)
        return STATUS_ERR_NO_MEMORY;
    s = stat(path, &info) == 0 ? own_read(tokens, path, &info, err) : own_make(tokens, path, err);
    row.made_at = s == STATUS_OK && stat(path, &info) == 0 ? info.st_mtime : clock_wall_s();
    mem_free(path);
    own_owner(row.owner, sizeof row.owner);
    if (s == STATUS_OK)
        s = hash_of(tokens->own, &row.hash, err);
    return s == STATUS_OK ? add_row(tokens, &row, err) : s;
}

const char *web_tokens_own(const struct web_tokens *tokens)
{
    return tokens->own;
}

status web_tokens_open(struct web_tokens **out, struct store *store, web_token_ended *ended, void *user,
                       struct error *err)
{
    struct web_tokens *tokens = mem_calloc(1, sizeof *tokens);
    status s;

    *out = NULL;
    if (!tokens)
        return error_no_memory(err, "the tokens");
    tokens->store = store;
    tokens->ended = ended;
    tokens->user = user;
    s = own_load(tokens, err);
    if (s == STATUS_OK)
        s = store_tokens_load(store, take_row, tokens, err);
    if (s == STATUS_OK)
        *out = tokens;
    else
        web_tokens_close(tokens);
    return s;
}

void web_tokens_close(struct web_tokens *tokens)
{
    if (!tokens)
        return;
    mem_free(tokens->rows);
    mem_free(tokens->marks);
    OPENSSL_cleanse(tokens, sizeof *tokens);
    mem_free(tokens);
}

/* ---- finding ---------------------------------------------------------------------------------- */

static int is_valid(const struct token_row *row, int64_t now_s)
{
    return row->expires_at == 0 || now_s < row->expires_at;
}

static void use(struct token_row *row, int64_t now_s, int by_cookie, struct web_caller *out)
{
    if (now_s - row->used_at >= TOKEN_USED_S || now_s < row->used_at)
        row->used_at = now_s;
    out->role = (enum web_role)row->role;
    out->token = row->number;
    snprintf(out->token_name, sizeof out->token_name, "%s", row->name);
    out->by_cookie = by_cookie;
    snprintf(out->who, sizeof out->who, "%s", row->owner);
}

int web_tokens_find(struct web_tokens *tokens, const char *text, int64_t now_s, struct web_caller *out)
{
    struct token_row *found = NULL;
    struct digest hash;

    memset(out, 0, sizeof *out);
    if (!is_text(text) || hash_of(text, &hash, NULL) != STATUS_OK)
        return 0;
    /* All rows, in constant time each: how long it takes says nothing about any of them. */
    for (size_t i = 0; i < tokens->count; i++)
        if (CRYPTO_memcmp(&tokens->rows[i].hash, &hash, sizeof hash) == 0)
            found = &tokens->rows[i];
    if (!found || !is_valid(found, now_s))
        return 0;
    use(found, now_s, 0, out);
    return 1;
}

/* 0: OpenSSL failed. */
static int cookie_mac(const struct web_tokens *tokens, const struct token_row *row, int64_t end_s,
                      struct digest *out)
{
    char hex[DIGEST_HEX_SIZE], text[sizeof "azulejo page  " + 20 + 20 + sizeof hex];
    unsigned size = sizeof out->bytes;

    digest_to_hex(&row->hash, hex);
    snprintf(text, sizeof text, "azulejo page %" PRIu64 " %" PRId64 " %s", row->number, end_s, hex);
    return HMAC(EVP_sha256(), tokens->own, (int)strlen(tokens->own), (const uint8_t *)text, strlen(text),
                out->bytes, &size) != NULL;
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

int web_tokens_find_cookie(struct web_tokens *tokens, const char *cookie, int64_t now_s, struct web_caller *out)
{
    struct token_row *row;
    struct digest mac, right;
    uint64_t number;
    int64_t end_s;

    memset(out, 0, sizeof *out);
    if (!cookie_parse(cookie, &number, &end_s, &mac))
        return 0;
    row = find_row(tokens, number);
    if (!row || !cookie_mac(tokens, row, end_s, &right) || CRYPTO_memcmp(&mac, &right, sizeof mac) != 0 ||
        now_s >= end_s || !is_valid(row, now_s))
        return 0;
    use(row, now_s, 1, out);
    return 1;
}

void web_tokens_cookie(const struct web_tokens *tokens, uint64_t token, int64_t now_s, char out[COOKIE_SIZE],
                       int64_t *life_s)
{
    const struct token_row *row = find_row(tokens, token);
    char hex[DIGEST_HEX_SIZE];
    struct digest mac;

    out[0] = 0;
    *life_s = COOKIE_LIFE_S;
    if (!row)
        return;
    if (row->expires_at && row->expires_at - now_s < *life_s)
        *life_s = row->expires_at - now_s;
    if (!cookie_mac(tokens, row, now_s + *life_s, &mac))
        return;
    digest_to_hex(&mac, hex);
    snprintf(out, COOKIE_SIZE, "%" PRIu64 ".%" PRId64 ".%s", token, now_s + *life_s, hex);
}

int web_tokens_note_failure(struct web_tokens *tokens, const char *peer, uint64_t now_ns)
{
    tokens->failure_count++;
    return token_failures_note(&tokens->failures, peer, now_ns);
}

uint64_t web_tokens_failures(const struct web_tokens *tokens)
{
    return tokens->failure_count;
}

/* ---- making and ending ------------------------------------------------------------------------ */

/* Printable, and not empty. Names and owners are shown in tables, logs and pages. */
static status check_text(const char *what, const char *text, size_t most, struct error *err)
{
    if (!text[0] || strlen(text) > most)
        return error_set(err, STATUS_ERR_INPUT, "a token's %s has 1 to %zu bytes", what, most);
    for (const char *c = text; *c; c++)
        if ((unsigned char)*c < ' ' || *c == 0x7f)
            return error_set(err, STATUS_ERR_INPUT, "a token's %s has no control characters", what);
    return STATUS_OK;
}

static status check_row(const struct web_tokens *tokens, const struct token_row *row, int64_t now_s,
                        struct error *err)
{
    status s = check_text("name", row->name, TOKEN_NAME_MAX, err);

    if (s == STATUS_OK)
        s = check_text("owner", row->owner, JOB_WHO_MAX, err);
    if (s != STATUS_OK)
        return s;
    if (row->role <= WEB_ROLE_NONE || row->role >= WEB_ROLES)
        return error_set(err, STATUS_ERR_INPUT, "a token's role is view, submit, operate or admin");
    if (row->expires_at && row->expires_at <= now_s)
        return error_set(err, STATUS_ERR_INPUT, "a token that has expired already: its end must be in the future");
    if (tokens->count >= TOKENS_MAX)
        return error_set(err, STATUS_ERR_LIMIT,
                         "there are %d tokens already; 'azulejo token revoke' those that nobody needs", TOKENS_MAX);
    return STATUS_OK;
}

status web_token_create(struct web_tokens *tokens, struct token_row *row, int64_t now_s,
                        char secret[TOKEN_TEXT_SIZE], struct error *err)
{
    status s = check_row(tokens, row, now_s, err);

    if (s == STATUS_OK)
        s = make_text(secret, err);
    if (s == STATUS_OK)
        s = hash_of(secret, &row->hash, err);
    row->made_at = now_s;
    row->used_at = 0;
    /* Room first: once stored, it must be in the list. */
    if (s == STATUS_OK)
        s = add_row(tokens, row, err);
    if (s != STATUS_OK)
        return s;
    s = store_token_add(tokens->store, row, err);
    tokens->rows[tokens->count - 1] = *row;
    if (s != STATUS_OK)
        tokens->count--;
    return s;
}

static status no_such_token(uint64_t token, struct error *err)
{
    return error_set(err, STATUS_ERR_NOT_FOUND, "there is no token %" PRIu64 " ('azulejo token list' lists them)",
                     token);
}

status web_token_revoke(struct web_tokens *tokens, uint64_t token, struct error *err)
{
    struct token_row *row = find_row(tokens, token);
    size_t at, behind;
    status s;

    if (!row)
        return no_such_token(token, err);
    if (token == TOKEN_OWN)
        return error_set(err, STATUS_ERR_REFUSED,
                         "token %d is the coordinator's own: 'azulejo token renew %d' replaces it", TOKEN_OWN,
                         TOKEN_OWN);
    s = store_token_remove(tokens->store, token, err);
    if (s != STATUS_OK)
        return s;
    at = (size_t)(row - tokens->rows);
    behind = --tokens->count - at;
    memmove(row, row + 1, behind * sizeof *row);
    memmove(&tokens->marks[at], &tokens->marks[at + 1], behind * sizeof tokens->marks[0]);
    tokens->ended(tokens->user, token, 0);
    return STATUS_OK;
}

static status own_store(struct web_tokens *tokens, const char *secret, struct error *err)
{
    char line[TOKEN_TEXT_SIZE + 1];
    char *path = own_path(tokens, err);
    status s;

    if (!path)
        return STATUS_ERR_NO_MEMORY;
    snprintf(line, sizeof line, "%s\n", secret);
    s = file_write_private(path, line, strlen(line), err);
    if (s == STATUS_OK)
        memcpy(tokens->own, secret, sizeof tokens->own);
    OPENSSL_cleanse(line, sizeof line);
    mem_free(path);
    return s;
}

status web_token_renew(struct web_tokens *tokens, uint64_t token, int64_t now_s, char secret[TOKEN_TEXT_SIZE],
                       struct error *err)
{
    struct token_row *row = find_row(tokens, token);
    struct digest hash;
    status s;

    if (!row)
        return no_such_token(token, err);
    if (!is_valid(row, now_s))
        return error_set(err, STATUS_ERR_REFUSED,
                         "token %" PRIu64 " has expired: 'azulejo token create' makes another", token);
    s = make_text(secret, err);
    if (s == STATUS_OK)
        s = hash_of(secret, &hash, err);
    if (s == STATUS_OK)
        s = token == TOKEN_OWN ? own_store(tokens, secret, err)
                               : store_token_renew(tokens->store, token, &hash, now_s, err);
    if (s != STATUS_OK)
        return s;
    row->hash = hash;
    row->made_at = now_s;
    row->used_at = 0;
    tokens->marks[row - tokens->rows].told = 0;
    tokens->ended(tokens->user, token, token == TOKEN_OWN);
    return STATUS_OK;
}

void web_tokens_tick(struct web_tokens *tokens, int64_t now_s)
{
    for (size_t i = 0; i < tokens->count; i++)
        if (!tokens->marks[i].ended && !is_valid(&tokens->rows[i], now_s)) {
            tokens->marks[i].ended = 1;
            tokens->ended(tokens->user, tokens->rows[i].number, 0);
        }
}

const struct token_row *web_tokens_next_used(struct web_tokens *tokens)
{
    for (size_t i = 0; i < tokens->count; i++) {
        if (tokens->rows[i].number == TOKEN_OWN || tokens->marks[i].told == tokens->rows[i].used_at)
            continue;
        tokens->marks[i].told = tokens->rows[i].used_at;
        return &tokens->rows[i];
    }
    return NULL;
}
