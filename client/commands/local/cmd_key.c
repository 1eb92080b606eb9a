/* azulejo key: keys of names. They are made here, of the farm's key; who revokes one tells the coordinator. */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "client/commands/command.h"
#include "client/terminal/format.h"
#include "client/terminal/json.h"
#include "client/terminal/must.h"
#include "client/terminal/table.h"
#include "common/base/buffer.h"
#include "common/base/duration.h"
#include "protocol/message.h"
#include "protocol/worker_name.h"

enum { KEEP_DEFAULT_S = 7 * 86400 };

struct wishes {
    const char *role, *output, *keep;
    int64_t generation;
    int json;
};

/* ---- making one ------------------------------------------------------------------------------- */

static status make(const struct connection_options *where, const char *name, const struct wishes *w, struct error *err)
{
    char host[CONNECTION_HOST_MAX];
    struct farm_key farm = {0}, derived = {0};
    struct key_identity id = {.generation = (uint32_t)(w->generation ? w->generation : 1)};
    uint16_t port;
    status s = STATUS_OK;

    if (!key_name_is_valid(name))
        return error_set(err, STATUS_ERR_USAGE,
                         "'%s' cannot be a key's name: 1 to %d letters, digits, '.', '_', '-' and '@', the first no '-'", name,
                         KEY_NAME_MAX);
    snprintf(id.name, sizeof id.name, "%s", name);
    (void)key_identity_set_role(&id, w->role);
    if (id.role == FARM_ROLE_WORKER && !worker_name_is_valid(name))
        return error_set(err, STATUS_ERR_USAGE, "'%s' cannot be the name of a worker's key: there is no '@' in it", name);
    s = connection_options_resolve(where, host, &port, &farm, err);
    if (s == STATUS_OK && !farm.is_farm)
        s = error_set(err, STATUS_ERR_INPUT, "--key: not the farm's key, which alone makes others; it is on the coordinator");
    THEN(s, farm_key_derive_named(&farm, &id, &derived, err));
    THEN(s, command_write_key(&derived, w->output, err));
    explicit_bzero(&farm, sizeof farm);
    explicit_bzero(&derived, sizeof derived);
    return s;
}

/* ---- printing --------------------------------------------------------------------------------- */

static void print_names(const Azulejo__Wire__KeyList *list)
{
    static const char *const titles[] = {"<NAME", "ROLES", ">GENERATION", ">CONNECTIONS", "LAST USED", "CHANGED", "BY", "NOTE"};
    char text[FORMAT_SIZE];
    struct table table;

    table_init(&table, titles, sizeof titles / sizeof *titles);
    for (size_t i = 0; i < list->n_keys; i++) {
        const Azulejo__Wire__KeyInfo *info = list->keys[i];
        table_add(&table, "%s", info->name);
        table_add(&table, "%s", info->roles);
        table_add(&table, "%" PRIu32, info->generation);
        table_add(&table, "%" PRIu32, info->connections);
        table_add(&table, "%s", format_time(text, info->used_at));
        table_add(&table, "%s", format_time(text, info->changed_at));
        table_add(&table, "%s", info->changed_by);
        if (info->revoked)
            table_add(&table, "revoked; the next is generation %" PRIu32, info->generation);
        else if (info->oldest < info->generation)
            table_add(&table, "generation %" PRIu32 " until %s", info->oldest, format_time(text, info->oldest_until));
        else
            table_add(&table, "%s", "");
    }
    table_print(&table);
    table_release(&table);
    if (list->damaged)
        printf("what was revoked is not known for certain: other names are refused ('azulejo-coordinator --check' says why)\n");
    if (list->shared)
        printf("keys that all of a role share are taken as well (--no-shared-keys of the coordinator turns them off)\n");
}

static void print_change(const Azulejo__Wire__KeyInfo *info, int rotated)
{
    char text[FORMAT_SIZE];
    int several = strchr(info->roles, ' ') != NULL;
    const char *role = info->roles[0] && !several ? info->roles : "ROLE";

    if (rotated && info->oldest < info->generation)
        printf("%s: generation %" PRIu32 " begins; generation %" PRIu32 " is good until %s\n", info->name,
               info->generation, info->oldest, format_time(text, info->oldest_until));
    else
        printf("%s: the keys that there were are %s\n", info->name, rotated ? "replaced" : "revoked");
    printf("'azulejo key new %s --role %s --generation %" PRIu32 "' makes %s\n", info->name, role, info->generation,
           rotated ? "its next key" : "it another key, should it have one");
}

/* ---- asking ------------------------------------------------------------------------------------- */

static status list(struct connection *c, int json, struct error *err)
{
    Azulejo__Wire__KeyQuery query = AZULEJO__WIRE__KEY_QUERY__INIT;
    Azulejo__Wire__Envelope question = MESSAGE(KEY_QUERY, key_query, &query), *answer = NULL;
    status s = connection_ask(c, &question, AZULEJO__WIRE__ENVELOPE__BODY_KEY_LIST, &answer, err);

    if (s == STATUS_OK && json)
        s = json_print(json_message(&answer->key_list->base), err);
    else if (s == STATUS_OK)
        print_names(answer->key_list);
    message_free(answer);
    return s;
}

static status change(struct connection *c, const char *name, int rotate, const struct wishes *w, struct error *err)
{
    Azulejo__Wire__KeyChange wanted = AZULEJO__WIRE__KEY_CHANGE__INIT;
    Azulejo__Wire__Envelope question = MESSAGE(KEY_CHANGE, key_change, &wanted), *answer = NULL;
    int64_t keep_s = KEEP_DEFAULT_S;
    status s = w->keep ? duration_parse("--keep", w->keep, &keep_s, err) : STATUS_OK;

    wanted.name = (char *)name;
    wanted.rotate = rotate;
    wanted.keep_s = keep_s < UINT32_MAX ? (uint32_t)keep_s : UINT32_MAX;
    THEN(s, connection_ask(c, &question, AZULEJO__WIRE__ENVELOPE__BODY_KEY_LIST, &answer, err));
    if (s == STATUS_OK && answer->key_list->n_keys != 1)
        s = error_set(err, STATUS_ERR_PROTOCOL, "the coordinator's answer describes no key");
    if (s == STATUS_OK && w->json)
        s = json_print(json_message(&answer->key_list->base), err);
    else if (s == STATUS_OK)
        print_change(answer->key_list->keys[0], rotate);
    message_free(answer);
    return s;
}

/* ---- the command ---------------------------------------------------------------------------------- */

static status check_words(const struct positionals *rest, const struct wishes *w, struct error *err)
{
    const char *verb = rest->count ? rest->items[0] : "list";
    int makes = strcmp(verb, "new") == 0, rotates = strcmp(verb, "rotate") == 0;
    size_t names = makes || rotates || strcmp(verb, "revoke") == 0;

    if (!names && strcmp(verb, "list") != 0)
        return command_word_unknown(verb, "list, new, revoke or rotate", err);
    if (names && rest->count < 2)
        return error_set(err, STATUS_ERR_USAGE, "%s whose key? Give its NAME", verb);
    if (rest->count > 1 + names)
        return error_set(err, STATUS_ERR_USAGE, "unexpected argument '%s'", rest->items[1 + names]);
    if (makes && !w->role)
        return error_set(err, STATUS_ERR_USAGE, "which --role: worker, view, submit, operate or admin?");
    if (!makes && (w->role || w->output || w->generation))
        return error_set(err, STATUS_ERR_USAGE, "--role, --generation and --output are for 'key new'");
    if (!rotates && w->keep)
        return error_set(err, STATUS_ERR_USAGE, "--keep is for 'key rotate'");
    return STATUS_OK;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct wishes w = {0};
    int done;
    const struct option table[] = {
        {"role", 'r', OPTION_CHOICE, &w.role, "ROLE",
         "new: what the key is for; of people's, each role may do what those before it may", 0, 0,
         "worker|view|submit|operate|admin"},
        {"generation", 0, OPTION_INT, &w.generation, "N", "new: which of the name's keys, after a revoke or rotate (1)", 1,
         KEY_GENERATION_MAX, NULL},
        {"output", 'o', OPTION_STRING, &w.output, "FILE",
         "new: write a new file that only its owner can read, instead of standard output", 0, 0, NULL},
        {"keep", 0, OPTION_STRING, &w.keep, "TIME", "rotate: the present key stays good so long (7d)", 0, 0, NULL},
        {"json", 0, OPTION_FLAG, &w.json, NULL, "print JSON", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct positionals rest;
    struct connection *c = NULL;
    const char *verb;
    status s = command_parse(command, table, argc, argv, 0, 3, &rest, &done, err);

    if (s != STATUS_OK || done)
        return s;
    verb = rest.count ? rest.items[0] : "list";
    TRY(check_words(&rest, &w, err));
    if (strcmp(verb, "new") == 0)
        return make(&where, rest.items[1], &w, err);
    s = connection_open(&c, &where, err);
    THEN(s, strcmp(verb, "list") == 0 ? list(c, w.json, err)
                                      : change(c, rest.items[1], strcmp(verb, "rotate") == 0, &w, err));
    connection_close(c);
    return s;
}

const struct command command_key = {
    .name = "key",
    .group = COMMAND_FARM,
    .usage = "azulejo key [list | new NAME --role ROLE | revoke NAME | rotate NAME] [OPTION]...",
    .summary = "make, list, revoke and rotate keys of people and machines",
    .description =
        "A key of a NAME lets one person or machine in: 'worker' renders, 'view' looks at everything, 'submit' also submits\n"
        "jobs and steers its own, 'operate' steers all jobs and workers, 'admin' does everything. Its jobs belong to NAME.\n"
        "'new' makes it of the farm's key (--key), without asking the coordinator, which knows every key that follows from\n"
        "that. 'revoke' ends all keys of a name and their connections at once. 'rotate' begins its next generation; the\n"
        "present key stays good for a while. 'list' shows the names whose keys were used or changed.",
    .run = run,
};
