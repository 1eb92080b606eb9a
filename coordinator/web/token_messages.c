#include "coordinator/web/token_messages.h"

#include <inttypes.h>
#include <openssl/crypto.h>
#include <stdio.h>
#include <string.h>

#include "common/base/clock.h"
#include "common/base/memory.h"
#include "protocol/message.h"

_Static_assert((int)AZULEJO__WIRE__TOKEN_ROLE__TOKEN_ROLE_VIEW == (int)WEB_ROLE_VIEW &&
                   (int)AZULEJO__WIRE__TOKEN_ROLE__TOKEN_ROLE_SUBMIT == (int)WEB_ROLE_SUBMIT &&
                   (int)AZULEJO__WIRE__TOKEN_ROLE__TOKEN_ROLE_OPERATE == (int)WEB_ROLE_OPERATE &&
                   (int)AZULEJO__WIRE__TOKEN_ROLE__TOKEN_ROLE_ADMIN == (int)WEB_ROLE_ADMIN,
               "roles have the same numbers on the wire");

/* Points at the row. */
static void fill_info(Azulejo__Wire__TokenInfo *info, const struct token_row *row)
{
    azulejo__wire__token_info__init(info);
    info->token = row->number;
    info->name = (char *)row->name;
    info->role = (Azulejo__Wire__TokenRole)row->role;
    info->owner = (char *)row->owner;
    info->made_by = (char *)row->made_by;
    info->made_at = row->made_at;
    info->used_at = row->used_at;
    info->expires_at = row->expires_at;
}

static status send_list(struct web_tokens *tokens, struct session *session, uint64_t request, struct error *err)
{
    size_t count;
    const struct token_row *rows = web_tokens_rows(tokens, &count);
    Azulejo__Wire__TokenInfo *infos = mem_alloc_array(count, sizeof *infos);
    Azulejo__Wire__TokenInfo **pointers = mem_alloc_array(count, sizeof(Azulejo__Wire__TokenInfo *));
    Azulejo__Wire__TokenList list = AZULEJO__WIRE__TOKEN_LIST__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(TOKEN_LIST, token_list, &list);
    status s = infos && pointers ? STATUS_OK : error_no_memory(err, "a list of tokens");

    for (size_t i = 0; s == STATUS_OK && i < count; i++) {
        fill_info(&infos[i], &rows[i]);
        pointers[i] = &infos[i];
    }
    if (s == STATUS_OK) {
        list.n_tokens = count;
        list.tokens = pointers;
        session_reply(session, request, &envelope);
    }
    mem_free(pointers);
    mem_free(infos);
    return s;
}

static void send_made(struct session *session, uint64_t request, const struct token_row *row, char *secret)
{
    Azulejo__Wire__TokenInfo info;
    Azulejo__Wire__TokenMade made = AZULEJO__WIRE__TOKEN_MADE__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(TOKEN_MADE, token_made, &made);

    fill_info(&info, row);
    made.info = &info;
    made.secret = secret;
    session_reply(session, request, &envelope);
}

/* A text as it is, or an error: nothing of it is left out silently. */
static status take_text(char *out, size_t size, const char *text, const char *what, struct error *err)
{
    if (strlen(text) >= size)
        return error_set(err, STATUS_ERR_INPUT, "a token's %s has at most %zu bytes", what, size - 1);
    memcpy(out, text, strlen(text) + 1);
    return STATUS_OK;
}

static status create(struct web_tokens *tokens, struct session *session, const Azulejo__Wire__Envelope *message,
                     struct error *err)
{
    const Azulejo__Wire__TokenCreate *wanted = message->token_create;
    struct token_row row = {.role = wanted->role, .expires_at = wanted->expires_at};
    const char *name = wanted->name[0] ? wanted->name : web_role_name((enum web_role)wanted->role);
    char secret[TOKEN_TEXT_SIZE] = "";
    status s = take_text(row.name, sizeof row.name, name, "name", err);

    if (s == STATUS_OK)
        s = take_text(row.owner, sizeof row.owner, wanted->owner[0] ? wanted->owner : session->who, "owner", err);
    snprintf(row.made_by, sizeof row.made_by, "%s", session->who);
    if (s == STATUS_OK)
        s = web_token_create(tokens, &row, clock_wall_s(), secret, err);
    if (s == STATUS_OK)
        send_made(session, message->request, &row, secret);
    OPENSSL_cleanse(secret, sizeof secret);
    return s;
}

static status renew(struct web_tokens *tokens, struct session *session, const Azulejo__Wire__Envelope *message,
                    struct error *err)
{
    uint64_t token = message->token_renew->token;
    char secret[TOKEN_TEXT_SIZE] = "";
    status s = web_token_renew(tokens, token, clock_wall_s(), secret, err);

    if (s == STATUS_OK)
        send_made(session, message->request, web_token_row(tokens, token), secret);
    OPENSSL_cleanse(secret, sizeof secret);
    return s;
}

status token_message(struct web_tokens *tokens, struct session *session, const Azulejo__Wire__Envelope *message,
                     struct error *err)
{
    status s = STATUS_OK;

    switch (message->body_case) {
    case AZULEJO__WIRE__ENVELOPE__BODY_TOKEN_CREATE: return create(tokens, session, message, err);
    case AZULEJO__WIRE__ENVELOPE__BODY_TOKEN_RENEW: return renew(tokens, session, message, err);
    case AZULEJO__WIRE__ENVELOPE__BODY_TOKEN_REVOKE:
        s = web_token_revoke(tokens, message->token_revoke->token, err);
        break;
    default: break;
    }
    return s == STATUS_OK ? send_list(tokens, session, message->request, err) : s;
}
