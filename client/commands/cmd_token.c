/* azulejo token: who may do what with the farm's page and its API. */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "client/commands/command.h"
#include "client/terminal/format.h"
#include "client/terminal/json.h"
#include "client/terminal/parse.h"
#include "client/terminal/table.h"
#include "common/system/clock.h"
#include "common/base/duration.h"
#include "common/schema/token_roles.h"
#include "protocol/message.h"

struct wishes {
    const char *role, *name, *owner, *expires;
    int json;
};

static const char *role_name(Azulejo__Wire__TokenRole role) { return web_role_name((enum web_role)role); }

/* ---- printing --------------------------------------------------------------------------------- */

static status print_list(const Azulejo__Wire__TokenList *list, int json, struct error *err)
{
    static const char *const titles[] = {">TOKEN", "<NAME", "ROLE", "OWNER", "MADE", "LAST USED", "EXPIRES", "MADE BY"};
    char text[FORMAT_SIZE];
    struct table table;

    if (json)
        return json_print(json_message(&list->base), err);
    table_init(&table, titles, sizeof titles / sizeof *titles);
    for (size_t i = 0; i < list->n_tokens; i++) {
        const Azulejo__Wire__TokenInfo *info = list->tokens[i];
        table_add(&table, "%" PRIu64, info->token);
        table_add(&table, "%s", info->name);
        table_add(&table, "%s", role_name(info->role));
        table_add(&table, "%s", info->owner);
        table_add(&table, "%s", format_time(text, info->made_at));
        table_add(&table, "%s", format_time(text, info->used_at));
        table_add(&table, "%s", info->expires_at ? format_time(text, info->expires_at) : "never");
        table_add(&table, "%s", info->made_by);
    }
    table_print(&table);
    table_release(&table);
    return STATUS_OK;
}

/* The token alone goes to standard output, so that a script can take it. */
static status print_made(const Azulejo__Wire__TokenMade *made, int json, struct error *err)
{
    char name[128];

    if (!made->info)
        return error_set(err, STATUS_ERR_PROTOCOL, "the coordinator's answer describes no token");
    if (json)
        return json_print(json_message(&made->base), err);
    fprintf(stderr, "token %" PRIu64 " (%s), role %s; it is shown only now:\n", made->info->token,
            message_text(name, sizeof name, made->info->name), role_name(made->info->role));
    printf("%s\n", made->secret);
    return STATUS_OK;
}

/* ---- asking ----------------------------------------------------------------------------------- */

static status list(struct connection *c, Azulejo__Wire__Envelope **answer, struct error *err)
{
    Azulejo__Wire__TokenQuery query = AZULEJO__WIRE__TOKEN_QUERY__INIT;
    Azulejo__Wire__Envelope question = MESSAGE(TOKEN_QUERY, token_query, &query);

    return connection_ask(c, &question, AZULEJO__WIRE__ENVELOPE__BODY_TOKEN_LIST, answer, err);
}

static status show(struct connection *c, int json, struct error *err)
{
    Azulejo__Wire__Envelope *answer = NULL;
    status result = list(c, &answer, err);

    THEN(result, print_list(answer->token_list, json, err));
    message_free(answer);
    return result;
}

static status create(struct connection *c, const struct wishes *w, struct error *err)
{
    Azulejo__Wire__TokenCreate body = AZULEJO__WIRE__TOKEN_CREATE__INIT;
    Azulejo__Wire__Envelope question = MESSAGE(TOKEN_CREATE, token_create, &body), *answer = NULL;
    int64_t life_s = 0;
    status result = STATUS_OK;

    body.role = (Azulejo__Wire__TokenRole)web_role_parse(w->role);
    if (w->expires)
        result = duration_parse("--expires", w->expires, &life_s, err);
    if (result == STATUS_OK && w->expires && life_s == 0)
        result = error_set(err, STATUS_ERR_USAGE, "--expires 0: a token must be good for some time");
    if (result != STATUS_OK)
        return result;
    body.name = (char *)(w->name ? w->name : "");
    body.owner = (char *)(w->owner ? w->owner : "");
    body.expires_at = w->expires ? clock_wall_s() + life_s : 0;
    result = connection_ask(c, &question, AZULEJO__WIRE__ENVELOPE__BODY_TOKEN_MADE, &answer, err);
    THEN(result, print_made(answer->token_made, w->json, err));
    message_free(answer);
    return result;
}

/* A number, or a name that only one token has. */
static status find(struct connection *c, const char *text, uint64_t *token, struct error *err)
{
    Azulejo__Wire__Envelope *answer = NULL;
    size_t found = 0;
    status result;
    const char *end = parse_digits(text, UINT64_MAX, token);

    if (end && !*end)
        return STATUS_OK;
    result = list(c, &answer, err);
    for (size_t i = 0; result == STATUS_OK && i < answer->token_list->n_tokens; i++)
        if (strcmp(answer->token_list->tokens[i]->name, text) == 0) {
            *token = answer->token_list->tokens[i]->token;
            found++;
        }
    message_free(answer);
    if (result == STATUS_OK && found != 1)
        return error_set(err, STATUS_ERR_NOT_FOUND,
                         found ? "%zu tokens have the name '%.*s': give its number ('azulejo token list')"
                               : "%zu tokens have the name '%.*s' ('azulejo token list' lists them)",
                         found, (int)sizeof err->text / 4, text);
    return result;
}

static status renew(struct connection *c, const char *text, int json, struct error *err)
{
    Azulejo__Wire__TokenRenew body = AZULEJO__WIRE__TOKEN_RENEW__INIT;
    Azulejo__Wire__Envelope question = MESSAGE(TOKEN_RENEW, token_renew, &body), *answer = NULL;
    status result = STATUS_OK;

    body.token = 1; /* the coordinator's own */
    if (text)
        result = find(c, text, &body.token, err);
    THEN(result, connection_ask(c, &question, AZULEJO__WIRE__ENVELOPE__BODY_TOKEN_MADE, &answer, err));
    THEN(result, print_made(answer->token_made, json, err));
    message_free(answer);
    return result;
}

static status end_token(struct connection *c, const char *text, int json, struct error *err)
{
    Azulejo__Wire__TokenRevoke body = AZULEJO__WIRE__TOKEN_REVOKE__INIT;
    Azulejo__Wire__Envelope question = MESSAGE(TOKEN_REVOKE, token_revoke, &body), *answer = NULL;
    status result = find(c, text, &body.token, err);

    THEN(result, connection_ask(c, &question, AZULEJO__WIRE__ENVELOPE__BODY_TOKEN_LIST, &answer, err));
    if (result == STATUS_OK && json)
        result = print_list(answer->token_list, 1, err);
    else if (result == STATUS_OK)
        printf("token %" PRIu64 " was revoked\n", (uint64_t)body.token);
    message_free(answer);
    return result;
}

/* ---- the command ------------------------------------------------------------------------------ */

static status check_words(const struct positionals *rest, const struct wishes *w, struct error *err)
{
    const char *verb = rest->count ? rest->items[0] : "list";
    size_t least = strcmp(verb, "revoke") == 0, most = least || strcmp(verb, "renew") == 0;
    int creates = strcmp(verb, "create") == 0;

    if (!creates && !most && strcmp(verb, "list") != 0)
        return command_word_unknown(verb, "list, create, renew or revoke", err);
    if (rest->count > 0 && rest->count - 1 < least)
        return error_set(err, STATUS_ERR_USAGE, "revoke which token? 'azulejo token list' lists them");
    if (rest->count > 0 && rest->count - 1 > most)
        return error_set(err, STATUS_ERR_USAGE, "unexpected argument '%s'", rest->items[1 + most]);
    if (creates && !w->role)
        return error_set(err, STATUS_ERR_USAGE, "which --role: view, submit, operate or admin?");
    if (!creates && (w->role || w->name || w->owner || w->expires))
        return error_set(err, STATUS_ERR_USAGE, "--role, --name, --owner and --expires are for 'token create'");
    return STATUS_OK;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct wishes w = {0};
    int done;
    const struct option table[] = {
        {"role", 0, OPTION_CHOICE, &w.role, "ROLE",
         "what the token may do; each role may do what those before it may", 0, 0, TOKEN_ROLE_WORDS},
        {"name", 0, OPTION_STRING, &w.name, "TEXT", "what lists and the audit log call it (its role)", 0, 0, NULL},
        {"owner", 0, OPTION_STRING, &w.owner, "USER@HOST", "the owner of the jobs submitted with it (who asks)", 0, 0,
         NULL},
        {"expires", 0, OPTION_STRING, &w.expires, "TIME", "it ends after this time, as in 30d (default: never)", 0, 0,
         NULL},
        {"json", 0, OPTION_FLAG, &w.json, NULL, "print JSON", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct positionals rest;
    struct connection *c = NULL;
    const char *verb;
    status result = command_parse(command, table, argc, argv, 0, 2, &rest, &done, err);

    if (result != STATUS_OK || done)
        return result;
    verb = rest.count ? rest.items[0] : "list";
    result = check_words(&rest, &w, err);
    THEN(result, connection_open(&c, &where, err));
    THEN(result, strcmp(verb, "create") == 0   ? create(c, &w, err)
                 : strcmp(verb, "renew") == 0  ? renew(c, rest.count > 1 ? rest.items[1] : NULL, w.json, err)
                 : strcmp(verb, "revoke") == 0 ? end_token(c, rest.items[1], w.json, err)
                                               : show(c, w.json, err));
    connection_close(c);
    return result;
}

const struct command command_token = {
    .name = "token",
    .group = COMMAND_FARM,
    .usage = "azulejo token [list | create --role ROLE | renew [TOKEN] | revoke TOKEN] [OPTION]...",
    .summary = "make, list and revoke tokens for the page and the API",
    .description =
        "A token opens the farm's page and its API: 'view' looks at everything, 'submit' also submits jobs and steers its\n"
        "own, 'operate' steers all jobs and workers, 'admin' does everything. It is shown once, when it is made.\n"
        "'revoke' ends it and all that is open with it at once. 'renew' gives a token another secret; without TOKEN, the\n"
        "coordinator's own, which the page's address has, and signs all browsers out.\n"
        "TOKEN is a number or a name. Keys of the role admin may do all this, and those that all clients share.",
    .run = run,
};
