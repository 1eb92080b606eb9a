#include "coordinator/page/tokens.h"

#include <assert.h>
#include <inttypes.h>
#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>
#include <pwd.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/system/clock.h"
#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/store/store.h"
#include "protocol/message.h"

enum { TOKEN_FILE_MAX = 4096 };

struct web_tokens {
    struct store *store;
    web_token_ended *ended;
    void *user;
    char own[TOKEN_TEXT_SIZE];
    struct token_row *rows; /* ascending; [0] is the coordinator's own */
    struct token_mark {
        int64_t stored_used_at; /* the used_at that the store knows */
        int ended;              /* its end was reported */
    } * marks;                  /* of each row */
    size_t count, capacity, mark_capacity;
};

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
    tokens->marks[tokens->count] = (struct token_mark){.stored_used_at = row->used_at};
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

    TRY(token_text_make(tokens->own, err));
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
        if (token_text_is(word))
            memcpy(tokens->own, word, sizeof tokens->own);
        else
            s = error_set(err, STATUS_ERR_CORRUPT, "%s: does not hold the page's token", path);
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
    struct error why = {0};
    struct stat info;
    status s;

    if (!path)
        return STATUS_ERR_NO_MEMORY;
    s = stat(path, &info) == 0 ? own_read(tokens, path, &info, &why) : STATUS_ERR_NOT_FOUND;
    if (s == STATUS_ERR_CORRUPT)
        log_warn("%s: a new one is made, and page.url beside it has the page's new address", why.text);
    if (s == STATUS_ERR_CORRUPT || s == STATUS_ERR_NOT_FOUND)
        s = own_make(tokens, path, &why);
    if (s != STATUS_OK && err)
        *err = why;
    row.made_at = s == STATUS_OK && stat(path, &info) == 0 ? info.st_mtime : clock_wall_s();
    mem_free(path);
    own_owner(row.owner, sizeof row.owner);
    THEN(s, token_text_hash(tokens->own, &row.hash, err));
    return s == STATUS_OK ? add_row(tokens, &row, err) : s;
}

const char *web_tokens_own(const struct web_tokens *tokens) { return tokens->own; }

status web_tokens_open(struct web_tokens **out, struct store *store, web_token_ended *ended, void *user,
                       struct error *err)
{
    struct web_tokens *tokens = mem_calloc(1, sizeof *tokens);
    status s;

    *out = NULL;
    NEED(tokens, err, "the tokens");
    tokens->store = store;
    tokens->ended = ended;
    tokens->user = user;
    s = own_load(tokens, err);
    THEN(s, store_tokens_load(store, take_row, tokens, err));
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

/* ---- what the page's program gets -------------------------------------------------------------- */

static int is_valid(const struct token_row *row, int64_t now_s)
{
    return row->expires_at == 0 || now_s < row->expires_at;
}

/* Not the coordinator's own token, of which the cookies' key says nothing. 0: OpenSSL failed. */
static int cookie_key(const struct web_tokens *tokens, struct digest *out)
{
    static const char purpose[] = "azulejo page cookies";
    unsigned size = sizeof out->bytes;

    return HMAC(EVP_sha256(), tokens->own, (int)strlen(tokens->own), (const uint8_t *)purpose, sizeof purpose - 1,
                out->bytes, &size) != NULL;
}

status web_tokens_tell(const struct web_tokens *tokens, uint64_t version, web_tokens_use *use, void *user, struct error *err)
{
    Azulejo__Wire__PageToken *list = mem_alloc_array(tokens->count, sizeof *list);
    Azulejo__Wire__PageToken **pointers = mem_alloc_array(tokens->count, sizeof(Azulejo__Wire__PageToken *));
    Azulejo__Wire__PageTokens message = AZULEJO__WIRE__PAGE_TOKENS__INIT;
    struct digest key;
    status s = list && pointers ? STATUS_OK : error_no_memory(err, "a list of tokens");

    if (s == STATUS_OK && !cookie_key(tokens, &key))
        s = error_set(err, STATUS_ERR_INTERNAL, "the key of cookies cannot be computed");
    for (size_t i = 0; s == STATUS_OK && i < tokens->count; i++) {
        struct token_row *row = &tokens->rows[i];
        azulejo__wire__page_token__init(&list[i]);
        list[i].token = row->number;
        list[i].name = row->name;
        list[i].role = (Azulejo__Wire__TokenRole)row->role;
        list[i].owner = row->owner;
        list[i].expires_at = row->expires_at;
        wire_digest_set(&list[i].hash, &row->hash);
        pointers[i] = &list[i];
    }
    if (s == STATUS_OK) {
        message.n_tokens = tokens->count;
        message.tokens = pointers;
        message.version = version;
        wire_digest_set(&message.cookie_key, &key);
        use(user, &message);
        OPENSSL_cleanse(&key, sizeof key);
    }
    mem_free(list);
    mem_free(pointers);
    return s;
}

void web_tokens_used(struct web_tokens *tokens, uint64_t token, int64_t now_s)
{
    struct token_row *row = find_row(tokens, token);

    if (row && (now_s - row->used_at >= TOKEN_USED_S || now_s < row->used_at))
        row->used_at = now_s;
}

int web_token_is_valid(const struct web_tokens *tokens, uint64_t token, int64_t now_s)
{
    const struct token_row *row = find_row(tokens, token);

    return row && is_valid(row, now_s);
}

/* ---- making and ending ------------------------------------------------------------------------ */

/* Printable, and not empty. Names and owners are shown in tables, logs and pages. */
static status check_text(const char *what, const char *text, size_t most, struct error *err)
{
    char clean[MESSAGE_TEXT_MAX];

    if (!text[0] || strlen(text) > most)
        return error_set(err, STATUS_ERR_INPUT, "a token's %s has 1 to %zu bytes", what, most);
    if (strcmp(message_text(clean, sizeof clean, text), text) != 0)
        return error_set(err, STATUS_ERR_INPUT, "a token's %s is UTF-8 text without control characters", what);
    return STATUS_OK;
}

static status check_row(const struct web_tokens *tokens, const struct token_row *row, int64_t now_s, struct error *err)
{
    status s = check_text("name", row->name, TOKEN_NAME_MAX, err);

    THEN(s, check_text("owner", row->owner, JOB_WHO_MAX, err));
    if (s != STATUS_OK)
        return s;
    if (row->role <= WEB_ROLE_NONE || row->role >= WEB_ROLES)
        return error_set(err, STATUS_ERR_INPUT, "a token's role is view, submit, operate or admin");
    if (row->expires_at && row->expires_at <= now_s)
        return error_set(err, STATUS_ERR_INPUT, "a token that has expired already: its end must be in the future");
    if (tokens->count >= TOKENS_MAX)
        return error_set(err, STATUS_ERR_LIMIT,
                         "there are %d tokens already; 'azulejo token revoke' those that are not needed", TOKENS_MAX);
    return STATUS_OK;
}

status web_token_create(struct web_tokens *tokens, struct token_row *row, int64_t now_s, char secret[TOKEN_TEXT_SIZE],
                        struct error *err)
{
    status s = check_row(tokens, row, now_s, err);

    THEN(s, token_text_make(secret, err));
    THEN(s, token_text_hash(secret, &row->hash, err));
    row->made_at = now_s;
    row->used_at = 0;
    /* Room first: once stored, it must be in the list. */
    THEN(s, add_row(tokens, row, err));
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

    if (!row)
        return no_such_token(token, err);
    if (token == TOKEN_OWN)
        return error_set(err, STATUS_ERR_REFUSED,
                         "token %d is the coordinator's own: 'azulejo token renew %d' replaces it", TOKEN_OWN,
                         TOKEN_OWN);
    TRY(store_token_remove(tokens->store, token, err));
    at = (size_t)(row - tokens->rows);
    behind = --tokens->count - at;
    memmove(row, row + 1, behind * sizeof *row);
    memmove(&tokens->marks[at], &tokens->marks[at + 1], behind * sizeof tokens->marks[0]);
    tokens->ended(tokens->user, token, 0);
    return STATUS_OK;
}

status web_token_own_write(const struct web_tokens *tokens, const char *secret, struct error *err)
{
    char line[TOKEN_TEXT_SIZE + 1];
    char *path = own_path(tokens, err);
    status s;

    if (!path)
        return STATUS_ERR_NO_MEMORY;
    snprintf(line, sizeof line, "%s\n", secret);
    s = file_write_private(path, line, strlen(line), err);
    OPENSSL_cleanse(line, sizeof line);
    mem_free(path);
    return s;
}

static void renewed(struct web_tokens *tokens, struct token_row *row, const struct digest *hash, int64_t now_s)
{
    row->hash = *hash;
    row->made_at = now_s;
    row->used_at = 0;
    tokens->marks[row - tokens->rows].stored_used_at = 0;
    tokens->ended(tokens->user, row->number, row->number == TOKEN_OWN);
}

status web_token_own_renewed(struct web_tokens *tokens, const char *secret, int64_t now_s, struct error *err)
{
    struct digest hash;

    TRY(token_text_hash(secret, &hash, err));
    memcpy(tokens->own, secret, sizeof tokens->own);
    renewed(tokens, find_row(tokens, TOKEN_OWN), &hash, now_s);
    return STATUS_OK;
}

status web_token_renew(struct web_tokens *tokens, uint64_t token, int64_t now_s, char secret[TOKEN_TEXT_SIZE],
                       struct error *err)
{
    struct token_row *row = find_row(tokens, token);
    struct digest hash;
    status s;

    assert(token != TOKEN_OWN);
    if (!row)
        return no_such_token(token, err);
    if (!is_valid(row, now_s))
        return error_set(err, STATUS_ERR_REFUSED, "token %" PRIu64 " has expired: 'azulejo token create' makes another",
                         token);
    s = token_text_make(secret, err);
    THEN(s, token_text_hash(secret, &hash, err));
    THEN(s, store_token_renew(tokens->store, token, &hash, now_s, err));
    if (s == STATUS_OK)
        renewed(tokens, row, &hash, now_s);
    return s;
}

void web_tokens_tick(struct web_tokens *tokens, int64_t now_s)
{
    for (size_t i = 0; i < tokens->count; i++) {
        int ended = !is_valid(&tokens->rows[i], now_s), before = tokens->marks[i].ended;
        tokens->marks[i].ended = ended; /* a clock that was ahead for a moment ends no token for good */
        if (ended && !before)
            tokens->ended(tokens->user, tokens->rows[i].number, 0);
    }
}

const struct token_row *web_tokens_next_used(struct web_tokens *tokens)
{
    for (size_t i = 0; i < tokens->count; i++) {
        if (tokens->rows[i].number == TOKEN_OWN || tokens->marks[i].stored_used_at == tokens->rows[i].used_at)
            continue;
        tokens->marks[i].stored_used_at = tokens->rows[i].used_at;
        return &tokens->rows[i];
    }
    return NULL;
}
