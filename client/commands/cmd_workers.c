/* azulejo workers: the connected workers. */
#include <inttypes.h>

#include "client/commands/command.h"
#include "client/terminal/format.h"
#include "client/farm/job_info.h"
#include "client/terminal/table.h"
#include "common/scene/settings.h"
#include "protocol/message.h"

static const char *const titles[] = {">SESSION", "HOST",     ">PROCESS", "ADDRESS",
                                     ">THREADS", ">LEASED",  ">DONE",    ">RATE/s",
                                     ">SINCE",   "SOFTWARE", ">MEMORY",  "TAGS",
                                     "NOTE"};
enum { COLUMNS = sizeof titles / sizeof titles[0] };

static status print_table(const Azulejo__Wire__WorkerList *list, struct error *err)
{
    struct table table;
    char text[FORMAT_SIZE];
    status result;

    table_init(&table, titles, COLUMNS);
    for (size_t i = 0; i < list->n_workers; i++) {
        const Azulejo__Wire__WorkerInfo *w = list->workers[i];
        table_add(&table, "%u", w->session);
        table_add(&table, "%s", w->host);
        table_add(&table, "%u", w->process);
        table_add(&table, "%s", w->address);
        table_add(&table, "%u", w->threads);
        table_add(&table, "%u", w->units_leased);
        table_add(&table, "%" PRIu64, w->units_done);
        table_add(&table, "%s", format_count(text, w->samples_per_second));
        table_add(&table, "%s", format_duration(text, (double)w->connected_s));
        table_add(&table, "%s", w->software);
        table_add(&table, "%s", w->memory ? format_bytes(text, w->memory) : "-");
        table_add(&table, "%s", w->tags[0] ? w->tags : "-");
        table_add(&table, "%s", w->note);
    }
    result = table_print(&table, err);
    table_release(&table);
    return result;
}

static json_t *worker_json(const Azulejo__Wire__WorkerInfo *w)
{
    json_t *isas = json_array();

    for (int i = 0; i < ISA_COUNT; i++)
        if (w->isa_mask >> i & 1)
            json_array_append_new(isas, json_string(isa_name((enum isa)i)));
    return json_pack("{s:I, s:o, s:I, s:o, s:o, s:o, s:I, s:o, s:I, s:I, s:I, s:o, s:I, s:o, s:o, s:o}",
                     "session", (json_int_t)w->session, "host", json_text(w->host), "process",
                     (json_int_t)w->process, "address", json_text(w->address), "software", json_text(w->software),
                     "kernel", json_text(w->kernel), "threads", (json_int_t)w->threads, "isa", isas,
                     "units_leased", (json_int_t)w->units_leased, "units_done",
                     (json_int_t)w->units_done, "samples_done", (json_int_t)w->samples_done,
                     "samples_per_second", json_number(w->samples_per_second), "connected_s",
                     (json_int_t)w->connected_s, "note", json_text(w->note), "memory",
                     w->memory ? json_integer((json_int_t)w->memory) : json_null(), "tags",
                     json_names(w->tags));
}

static status print_json(const Azulejo__Wire__WorkerList *list, struct error *err)
{
    json_t *workers = json_array();

    for (size_t i = 0; i < list->n_workers; i++)
        json_array_append_new(workers, worker_json(list->workers[i]));
    return json_print(json_pack("{s:o}", "workers", workers), err);
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    Azulejo__Wire__Envelope envelope = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__WorkerQuery query = AZULEJO__WIRE__WORKER_QUERY__INIT;
    int json = 0, done;
    const struct option table[] = {
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct positionals rest;
    struct connection *connection = NULL;
    Azulejo__Wire__Envelope *answer = NULL;
    status result = command_parse(command, table, argc, argv, 0, 0, &rest, &done, err);

    (void)exit_code;
    if (result != STATUS_OK || done)
        return result;
    envelope.body_case = AZULEJO__WIRE__ENVELOPE__BODY_WORKER_QUERY;
    envelope.worker_query = &query;
    result = connection_open(&connection, &where, err);
    if (result == STATUS_OK)
        result = connection_ask(connection, &envelope, AZULEJO__WIRE__ENVELOPE__BODY_WORKER_LIST,
                                &answer, err);
    if (result == STATUS_OK)
        result = json ? print_json(answer->worker_list, err)
                      : print_table(answer->worker_list, err);
    message_free(answer);
    connection_close(connection);
    return result;
}

const struct command command_workers = {
    .name = "workers",
    .group = COMMAND_FARM,
    .usage = "azulejo workers [OPTION]...",
    .summary = "list the workers that are connected",
    .description = "List the workers that are connected to the coordinator and what each has done.",
    .run = run,
};
