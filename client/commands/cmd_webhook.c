/* azulejo webhook: addresses that the coordinator sends what happens to jobs. */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "client/commands/command.h"
#include "client/terminal/json.h"
#include "client/terminal/parse.h"
#include "client/terminal/table.h"
#include "protocol/message.h"

/* ---- printing --------------------------------------------------------------------------------- */

static status print_list(const Azulejo__Wire__WebhookList *list, int json, struct error *err)
{
    static const char *const titles[] = {">WEBHOOK", "<URL", ">SENT", ">WAITING", ">FAILED", ">GIVEN UP", "MADE BY",
                                         "~LAST ERROR"};
    struct table table;

    if (json)
        return json_print(json_message(&list->base), err);
    table_init(&table, titles, sizeof titles / sizeof *titles);
    for (size_t i = 0; i < list->n_webhooks; i++) {
        const Azulejo__Wire__WebhookInfo *info = list->webhooks[i];
        table_add(&table, "%" PRIu64, info->webhook);
        table_add(&table, "%s", info->url);
        table_add(&table, "%" PRIu64, info->sent);
        table_add(&table, "%u", info->waiting);
        table_add(&table, "%" PRIu64, info->failed);
        table_add(&table, "%" PRIu64, info->given_up);
        table_add(&table, "%s", info->made_by);
        table_add(&table, "%s", info->last_error);
    }
    table_print(&table);
    table_release(&table);
    return STATUS_OK;
}

/* The secret alone goes to standard output, so that a script can take it. */
static status print_made(const Azulejo__Wire__WebhookList *list, int json, struct error *err)
{
    char url[MESSAGE_TEXT_MAX];

    if (list->n_webhooks != 1 || !list->secret[0])
        return error_set(err, STATUS_ERR_PROTOCOL, "the coordinator's answer describes no webhook");
    if (json)
        return print_list(list, 1, err);
    fprintf(stderr, "webhook %" PRIu64 " to %s; the secret that signs what is sent is shown only now:\n",
            list->webhooks[0]->webhook, message_text(url, sizeof url, list->webhooks[0]->url));
    printf("%s\n", list->secret);
    return STATUS_OK;
}

/* ---- the verbs -------------------------------------------------------------------------------- */

enum verb { LIST, ADD, REMOVE, TEST, VERBS };
static const struct {
    const char *word, *argument; /* what it needs; NULL: nothing */
} verbs[VERBS] = {{"list", NULL}, {"add", "URL"}, {"remove", "WEBHOOK"}, {"test", "WEBHOOK"}};

static status number_of(const char *text, uint64_t *out, struct error *err)
{
    const char *end = parse_digits(text, UINT64_MAX, out);

    if (end && !*end)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_USAGE, "'%.64s' is not a webhook's number ('azulejo webhook list' lists them)",
                     text);
}

/* Ask, and print the answer. */
static status ask(struct connection *c, enum verb verb, const char *argument, int json, struct error *err)
{
    Azulejo__Wire__WebhookQuery query = AZULEJO__WIRE__WEBHOOK_QUERY__INIT;
    Azulejo__Wire__WebhookAdd add = AZULEJO__WIRE__WEBHOOK_ADD__INIT;
    Azulejo__Wire__WebhookRemove leave = AZULEJO__WIRE__WEBHOOK_REMOVE__INIT;
    Azulejo__Wire__WebhookTest try = AZULEJO__WIRE__WEBHOOK_TEST__INIT;
    Azulejo__Wire__Envelope questions[VERBS] = {[LIST] = MESSAGE(WEBHOOK_QUERY, webhook_query, &query),
                                                [ADD] = MESSAGE(WEBHOOK_ADD, webhook_add, &add),
                                                [REMOVE] = MESSAGE(WEBHOOK_REMOVE, webhook_remove, &leave),
                                                [TEST] = MESSAGE(WEBHOOK_TEST, webhook_test, &try)};
    Azulejo__Wire__Envelope *answer = NULL;
    uint64_t number = 0;
    status result = STATUS_OK;

    if (verb == REMOVE || verb == TEST)
        result = number_of(argument, &number, err);
    add.url = (char *)argument;
    leave.webhook = try.webhook = number;
    THEN(result, connection_ask(c, &questions[verb], AZULEJO__WIRE__ENVELOPE__BODY_WEBHOOK_LIST, &answer, err));
    if (result == STATUS_OK && verb == ADD)
        result = print_made(answer->webhook_list, json, err);
    else if (result == STATUS_OK && (verb == LIST || json))
        result = print_list(answer->webhook_list, json, err);
    else if (result == STATUS_OK)
        printf(verb == TEST ? "webhook %" PRIu64 " took the test event\n" : "webhook %" PRIu64 " was removed\n",
               number);
    message_free(answer);
    return result;
}

static status parse_words(const struct positionals *rest, enum verb *verb, struct error *err)
{
    *verb = LIST;
    if (rest->count == 0)
        return STATUS_OK;
    while (*verb < VERBS && strcmp(verbs[*verb].word, rest->items[0]) != 0)
        ++*verb;
    if (*verb == VERBS)
        return command_word_unknown(rest->items[0], "list, add, remove or test", err);
    if (verbs[*verb].argument && rest->count < 2)
        return error_set(err, STATUS_ERR_USAGE, "%s needs a %s", verbs[*verb].word, verbs[*verb].argument);
    if (!verbs[*verb].argument && rest->count > 1)
        return error_set(err, STATUS_ERR_USAGE, "unexpected argument '%s'", rest->items[1]);
    return STATUS_OK;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    int json = 0, done;
    const struct option table[] = {
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct positionals rest;
    struct connection *c = NULL;
    enum verb verb = LIST;
    status result = command_parse(command, table, argc, argv, 0, 2, &rest, &done, err);

    if (result != STATUS_OK || done)
        return result;
    result = parse_words(&rest, &verb, err);
    THEN(result, connection_open(&c, &where, err));
    THEN(result, ask(c, verb, rest.count > 1 ? rest.items[1] : "", json, err));
    connection_close(c);
    return result;
}

const struct command command_webhook = {
    .name = "webhook",
    .group = COMMAND_FARM,
    .usage = "azulejo webhook [list | add URL | remove WEBHOOK | test WEBHOOK] [OPTION]...",
    .summary = "send what happens to jobs to other programs",
    .description =
        "The coordinator posts JSON to URL when a job is done or failed, and when something needs a person: a job is\n"
        "parked, or the store cannot be used. It signs what it sends with the webhook's secret, which is shown once, and\n"
        "tries again for a day. A person who may add webhooks can make the coordinator send requests to any address\n"
        "that it reaches.",
    .run = run,
};
