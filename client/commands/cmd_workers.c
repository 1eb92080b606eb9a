/* azulejo workers: the workers of the farm, and what people do to them. */
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "client/commands/command.h"
#include "client/views/workers_view.h"
#include "client/terminal/json.h"
#include "client/terminal/must.h"
#include "client/terminal/wildcard.h"
#include "common/base/memory.h"
#include "protocol/message.h"

enum { SHOWN_MAX = 20 /* workers that a question lists */ };

struct verb {
    const char *word, *past;
    Azulejo__Wire__WorkerVerb number;
    unsigned states; /* bits: of the workers that a wildcard means */
    int on_marks;    /* a wildcard means blocked names, too, that are not connected */
};

#define STATE(name) (1u << AZULEJO__WIRE__WORKER_STATE__WORKER_STATE_##name)
#define STATES_OPEN (STATE(IDLE) | STATE(WORKING) | STATE(PAUSED))
static const struct verb verbs[] = {
    {"drain", "drained", AZULEJO__WIRE__WORKER_VERB__WORKER_DRAIN, STATES_OPEN, 0},
    {"resume", "resumed", AZULEJO__WIRE__WORKER_VERB__WORKER_RESUME, STATE(DRAINING) | STATE(DRAINED), 0},
    {"block", "blocked", AZULEJO__WIRE__WORKER_VERB__WORKER_BLOCK,
     STATES_OPEN | STATE(DRAINING) | STATE(DRAINED) | STATE(LEAVING), 0},
    {"unblock", "unblocked", AZULEJO__WIRE__WORKER_VERB__WORKER_UNBLOCK, STATE(BLOCKED), 1},
};

/* ---- which workers --------------------------------------------------------------------------- */

struct names {
    char (*items)[256];
    size_t count, capacity;
    int asks; /* more than one was named, or a wildcard was used */
};

static void names_add(struct names *names, const char *name)
{
    for (size_t i = 0; i < names->count; i++)
        if (strcmp(names->items[i], name) == 0)
            return;
    MUST_GROW(names->items, names->capacity, names->count + 1);
    snprintf(names->items[names->count++], sizeof *names->items, "%s", name);
}

static status ask_list(struct connection *c, const char *name, int gone, Azulejo__Wire__Envelope **answer,
                       struct error *err)
{
    Azulejo__Wire__WorkerQuery query = AZULEJO__WIRE__WORKER_QUERY__INIT;
    Azulejo__Wire__Envelope question = MESSAGE(WORKER_QUERY, worker_query, &query);

    query.name = (char *)name;
    query.gone = gone;
    return connection_ask(c, &question, AZULEJO__WIRE__ENVELOPE__BODY_WORKER_LIST, answer, err);
}

/* Add those that the pattern means. */
static status names_match(struct names *names, const char *pattern, const struct verb *verb,
                          const Azulejo__Wire__WorkerList *list, struct error *err)
{
    int seen = 0;
    size_t before = names->count;

    for (size_t i = 0; i < list->n_workers; i++) {
        const Azulejo__Wire__WorkerInfo *w = list->workers[i];
        if (!wildcard_fits(pattern, w->name))
            continue;
        seen = 1;
        if (verb->states >> w->state & 1)
            names_add(names, w->name);
    }
    for (size_t i = 0; verb->on_marks && i < list->n_marks; i++)
        if (list->marks[i]->blocked && wildcard_fits(pattern, list->marks[i]->name))
            names_add(names, list->marks[i]->name);
    if (names->count == before)
        return error_set(err, STATUS_ERR_NOT_FOUND,
                         seen ? "no worker that matches '%s' can be %s (its state: 'azulejo workers')"
                              : "no worker matches '%s' ('azulejo workers' lists them)",
                         pattern, verb->past);
    return STATUS_OK;
}

static status names_find(struct connection *c, const struct verb *verb, const struct positionals *rest,
                         struct names *names, struct error *err)
{
    Azulejo__Wire__Envelope *answer = NULL;
    status result = STATUS_OK;

    names->asks = rest->count > 2;
    for (size_t i = 1; i < rest->count && result == STATUS_OK; i++) {
        const char *text = rest->items[i];
        if (!wildcard_is(text)) {
            names_add(names, text);
            continue;
        }
        names->asks = 1;
        if (!answer)
            result = ask_list(c, "", 0, &answer, err);
        THEN(result, names_match(names, text, verb, answer->worker_list, err));
    }
    message_free(answer);
    return result;
}

static status confirm(const struct verb *verb, const struct names *names, int yes, int *go_on, struct error *err)
{
    char reply[16] = "";

    *go_on = 1;
    if (!names->asks || yes)
        return STATUS_OK;
    if (!isatty(STDIN_FILENO))
        return error_set(err, STATUS_ERR_USAGE, "would %s %zu worker%s, and there is no terminal to ask: give --yes",
                         verb->word, names->count, names->count == 1 ? "" : "s");
    fprintf(stderr, "%s %zu worker%s:\n", verb->word, names->count, names->count == 1 ? "" : "s");
    for (size_t i = 0; i < names->count && i < SHOWN_MAX; i++)
        fprintf(stderr, "  %s\n", names->items[i]);
    if (names->count > SHOWN_MAX)
        fprintf(stderr, "  and %zu more\n", names->count - SHOWN_MAX);
    fprintf(stderr, "go on? [y/N] ");
    fflush(stderr);
    *go_on = fgets(reply, sizeof reply, stdin) && (reply[0] == 'y' || reply[0] == 'Y');
    return STATUS_OK;
}

/* ---- doing it -------------------------------------------------------------------------------- */

static void print_outcome(const char *name, const struct verb *verb, const Azulejo__Wire__WorkerList *list)
{
    char note[640];

    if (list->n_workers == 0) {
        printf("worker %s: %s, not connected\n", name, list->n_marks ? "blocked" : "free");
        return;
    }
    for (size_t i = 0; i < list->n_workers; i++) {
        const Azulejo__Wire__WorkerInfo *w = list->workers[i];
        printf("worker %s: %s", w->name, worker_state_name(w->state));
        if (verb->number == AZULEJO__WIRE__WORKER_VERB__WORKER_DRAIN && w->units_leased)
            printf(", %u units left", w->units_leased);
        else if (w->note[0])
            printf(": %s", message_text(note, sizeof note, w->note));
        printf("\n");
    }
}

static int is_of_the_worker(status code)
{
    return code == STATUS_ERR_REFUSED || code == STATUS_ERR_NOT_FOUND || code == STATUS_ERR_INPUT;
}

/* Do it to one after another. A failure that is about one worker does not stop the others: the exit
 * code is that of the first. */
static status steer_all(struct connection *c, const struct verb *verb, const struct names *names, int json,
                        int *exit_code, struct error *err)
{
    json_t *done = json_array(), *failed = json_array();
    struct error first = {0};
    status result = STATUS_OK;

    for (size_t i = 0; i < names->count && result == STATUS_OK; i++) {
        Azulejo__Wire__WorkerSteer body = AZULEJO__WIRE__WORKER_STEER__INIT;
        Azulejo__Wire__Envelope question = MESSAGE(WORKER_STEER, worker_steer, &body), *answer = NULL;
        struct error why = {0};
        status s;

        body.name = names->items[i];
        body.verb = verb->number;
        s = connection_ask(c, &question, AZULEJO__WIRE__ENVELOPE__BODY_WORKER_LIST, &answer, &why);
        if (s == STATUS_OK && json)
            json_array_append_new(done, answer->worker_list->n_workers
                                            ? json_message(&answer->worker_list->workers[0]->base)
                                            : json_pack("{s:o}", "name", json_text(body.name)));
        else if (s == STATUS_OK)
            print_outcome(body.name, verb, answer->worker_list);
        message_free(answer);
        if (s == STATUS_OK)
            continue;
        if (names->count == 1 || !is_of_the_worker(s))
            result = error_set(err, s, "%s", why.text);
        if (first.code == STATUS_OK)
            first = why;
        json_array_append_new(failed,
                              json_pack("{s:o, s:o}", "name", json_text(body.name), "error", json_text(why.text)));
        if (result == STATUS_OK)
            fprintf(stderr, "%s\n", why.text);
    }
    if (result == STATUS_OK && first.code != STATUS_OK)
        *exit_code = status_exit_code(first.code);
    if (result == STATUS_OK && json)
        result = json_print(json_pack("{s:O, s:O}", "workers", done, "failed", failed), err);
    json_decref(done);
    json_decref(failed);
    return result;
}

static status steer(struct connection *c, const struct verb *verb, const struct positionals *rest, int yes, int json,
                    int *exit_code, struct error *err)
{
    struct names names = {0};
    int go_on = 0;
    status result = names_find(c, verb, rest, &names, err);

    THEN(result, confirm(verb, &names, yes, &go_on, err));
    if (result == STATUS_OK && !go_on)
        fprintf(stderr, "nothing was changed\n");
    if (result == STATUS_OK && go_on)
        result = steer_all(c, verb, &names, json, exit_code, err);
    mem_free(names.items);
    return result;
}

/* ---- looking --------------------------------------------------------------------------------- */

static status show(struct connection *c, const char *name, int json, struct error *err)
{
    Azulejo__Wire__Envelope *answer = NULL;
    status result = ask_list(c, name, 1, &answer, err);
    const Azulejo__Wire__WorkerList *list = result == STATUS_OK ? answer->worker_list : NULL;

    if (list && list->n_workers + list->n_gone + list->n_marks == 0)
        result = error_set(err, STATUS_ERR_NOT_FOUND,
                           "no worker '%.64s' is connected, and none of that name left "
                           "('azulejo workers --gone' lists those that left)",
                           name);
    else if (list && json)
        result = json_print(json_message(&list->base), err);
    else if (list)
        workers_print_one(list);
    message_free(answer);
    return result;
}

static status list_all(struct connection *c, int gone, int json, struct error *err)
{
    Azulejo__Wire__Envelope *answer = NULL;
    status result = ask_list(c, "", gone, &answer, err);

    if (result == STATUS_OK && json)
        result = json_print(json_message(&answer->worker_list->base), err);
    else if (result == STATUS_OK && gone)
        workers_print_gone(answer->worker_list);
    else if (result == STATUS_OK)
        workers_print(answer->worker_list);
    message_free(answer);
    return result;
}

/* NULL with an error: not a verb, or the wrong number of names. *verb is NULL for "show". */
static status parse_words(const struct positionals *rest, const struct verb **verb, struct error *err)
{
    const char *word = rest->items[0];

    *verb = NULL;
    for (size_t i = 0; i < sizeof verbs / sizeof *verbs; i++)
        if (strcmp(word, verbs[i].word) == 0)
            *verb = &verbs[i];
    if (!*verb && strcmp(word, "show") != 0)
        return command_word_unknown(word, "show, drain, resume, block or unblock", err);
    if (rest->count < 2)
        return error_set(err, STATUS_ERR_USAGE, "which worker? 'azulejo workers' lists their names");
    if (!*verb && rest->count > 2)
        return error_set(err, STATUS_ERR_USAGE, "show takes one worker");
    return STATUS_OK;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code, struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    int json = 0, gone = 0, yes = 0, done;
    const struct option table[] = {
        {"gone", 0, OPTION_FLAG, &gone, NULL, "list those that left instead: what they did, and why they left", 0, 0,
         NULL},
        {"yes", 'y', OPTION_FLAG, &yes, NULL, "do not ask before several workers are changed", 0, 0, NULL},
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    const struct verb *verb = NULL;
    struct positionals rest;
    struct connection *c = NULL;
    status result = command_parse(command, table, argc, argv, 0, OPTIONS_POSITIONAL_MAX, &rest, &done, err);

    if (result != STATUS_OK || done)
        return result;
    if (rest.count > 0)
        result = parse_words(&rest, &verb, err);
    if (result == STATUS_OK && rest.count > 0 && gone)
        result = error_set(err, STATUS_ERR_USAGE, "--gone is for the list of workers");
    THEN(result, connection_open(&c, &where, err));
    THEN(result, verb             ? steer(c, verb, &rest, yes, json, exit_code, err)
                 : rest.count > 0 ? show(c, rest.items[1], json, err)
                                  : list_all(c, gone, json, err));
    connection_close(c);
    return result;
}

const struct command command_workers = {
    .name = "workers",
    .group = COMMAND_FARM,
    .usage = "azulejo workers [show NAME | drain|resume|block|unblock NAME...] [OPTION]...",
    .summary = "list the workers, or drain, resume, block and unblock them",
    .description =
        "List the workers that are connected and what each has done, or show all about one.\n"
        "'drain' lets workers finish what they have and gives them no more, until 'resume' or their process ends.\n"
        "'block' gives their work to others at once and none to their names, across restarts, until 'unblock'.\n"
        "In NAME, * and ? may stand for anything.",
    .run = run,
};
