/* azulejo list: the farm's jobs. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "client/commands/command.h"
#include "client/follow/figures_view.h"
#include "client/terminal/format.h"
#include "client/farm/job_choice.h"
#include "client/follow/job_info.h"
#include "client/terminal/must.h"
#include "client/terminal/table.h"
#include "common/base/memory.h"
#include "common/cli/terminal.h"
#include "protocol/message.h"

/* A terminal with fewer columns than NARROW gets the first table without the last columns of the second. */
enum { NARROW = 120 };
static const char *const titles_narrow[] = {">JOB",    "<NAME", "<OWNER", ">PRIO", "STATE",
                                            ">FRAMES", ">DONE", ">LEFT",  "~NOTE"};
static const char *const titles_wide[] = {">JOB",  "<NAME",  "<OWNER", ">PRIO",    "STATE",     ">FRAMES",
                                          ">DONE", ">ERROR", ">LEFT",  ">WORKERS", "SUBMITTED", "~NOTE"};
enum {
    COLUMNS_NARROW = sizeof titles_narrow / sizeof titles_narrow[0],
    COLUMNS_WIDE = sizeof titles_wide / sizeof titles_wide[0],
};

struct job_rows {
    Azulejo__Wire__Envelope **answers; /* own the data that `jobs` points at */
    size_t answer_count, answer_capacity;
    const Azulejo__Wire__JobInfo **jobs; /* ascending numbers */
    size_t count, capacity;
    uint64_t not_shown;
};

static void rows_release(struct job_rows *r)
{
    for (size_t i = 0; i < r->answer_count; i++)
        message_free(r->answers[i]);
    mem_free(r->answers);
    mem_free(r->jobs);
}

/* Request the jobs that match the filter, page by page from the newest one, until there are `most`. */
static status collect(struct connection *c, Azulejo__Wire__JobFilter filter, size_t most, struct job_rows *r,
                      struct error *err)
{
    Azulejo__Wire__JobQuery query = AZULEJO__WIRE__JOB_QUERY__INIT;
    size_t begin = r->count;

    query.filter = filter;
    do {
        Azulejo__Wire__Envelope envelope = AZULEJO__WIRE__ENVELOPE__INIT;
        Azulejo__Wire__Envelope *answer = NULL;
        const Azulejo__Wire__JobList *list;

        envelope.body_case = AZULEJO__WIRE__ENVELOPE__BODY_JOB_QUERY;
        envelope.job_query = &query;
        TRY(connection_ask(c, &envelope, AZULEJO__WIRE__ENVELOPE__BODY_JOB_LIST, &answer, err));
        list = answer->job_list;
        MUST_GROW(r->answers, r->answer_capacity, r->answer_count + 1);
        MUST_GROW(r->jobs, r->capacity, r->count + list->n_jobs);
        r->answers[r->answer_count++] = answer;
        for (size_t i = 0; i < list->n_jobs; i++)
            r->jobs[r->count++] = list->jobs[i];
        r->not_shown = list->older;
        if (list->n_jobs == 0)
            break;
        if (query.before && list->jobs[0]->job >= query.before)
            return error_set(err, STATUS_ERR_PROTOCOL, "the coordinator sent a page of jobs twice");
        query.before = list->jobs[0]->job;
    } while (r->not_shown > 0 && r->count - begin < most);
    return STATUS_OK;
}

static int by_number(const void *a, const void *b)
{
    const Azulejo__Wire__JobInfo *const *one = a, *const *other = b;

    return ((*one)->job > (*other)->job) - ((*one)->job < (*other)->job);
}

/* All active jobs, and the `newest` of those that have ended. */
static status rows_get(struct connection *c, size_t newest, struct job_rows *r, struct error *err)
{
    size_t kept = 0, first = 0, ended = 0;
    status result = collect(c, AZULEJO__WIRE__JOB_FILTER__JOBS_ACTIVE, SIZE_MAX, r, err);

    THEN(result, collect(c, AZULEJO__WIRE__JOB_FILTER__JOBS_ENDED, newest, r, err));
    if (r->count > 0)
        qsort(r->jobs, r->count, sizeof *r->jobs, by_number);
    /* A job that ended between the two requests is in both answers. */
    for (size_t i = 0; i < r->count; i++)
        if (kept == 0 || r->jobs[i]->job != r->jobs[kept - 1]->job)
            r->jobs[kept++] = r->jobs[i];
    r->count = kept;
    /* Pages are larger than what is wanted of them. */
    for (size_t i = 0; i < r->count; i++)
        ended += (size_t)job_state_ended(r->jobs[i]->state);
    for (size_t i = 0; i < r->count; i++) {
        if (job_state_ended(r->jobs[i]->state) && ended > newest) {
            ended--;
            r->not_shown++;
        } else {
            r->jobs[first++] = r->jobs[i];
        }
    }
    r->count = first;
    return result;
}

/* Only the jobs that the filter lets through, which may be none. */
static status rows_choose(struct connection *c, const struct job_choice *choice, struct chosen_jobs *chosen,
                          struct job_rows *r, struct error *err)
{
    static const struct positionals none;
    status result = job_choice_find(c, choice, &none, chosen, err);

    if (result == STATUS_ERR_NOT_FOUND)
        return STATUS_OK;
    if (result != STATUS_OK)
        return result;
    MUST_GROW(r->jobs, r->capacity, chosen->count);
    for (size_t i = 0; i < chosen->count; i++)
        r->jobs[r->count++] = chosen->items[i].info;
    return STATUS_OK;
}

static void add_error(struct table *table, const Azulejo__Wire__JobInfo *job)
{
    char text[FORMAT_SIZE];
    const Azulejo__Wire__Figures *figures = job->now ? job->now->figures : NULL;

    table_add(table, "%s%s", figures ? figures_display_text(text, figures->display) : "-",
              figures && !figures->reliable ? "?" : "");
}

static void add_job(struct table *table, const Azulejo__Wire__JobInfo *job, int wide)
{
    char text[FORMAT_SIZE], note[JOB_NOTE_SIZE];
    const char *when;

    table_add(table, "%" PRIu64, job->job);
    table_add(table, "%s", job->name);
    table_add(table, "%s", job->owner[0] ? job->owner : "-");
    table_add(table, "%d", job->priority);
    table_add(table, "%s", job_state_word(job->state));
    table_add(table, "%u/%u", job->frames_done, job->last_frame - job->first_frame + 1);
    table_add(table, "%d %%", (int)(100 * job->done_share));
    if (wide)
        add_error(table, job);
    table_add(table, "%s",
              job->state == AZULEJO__WIRE__JOB_STATE__JOB_RUNNING ? format_duration(text, job->seconds_left) : "-");
    if (wide) {
        table_add(table, "%u", job->workers);
        /* Month to minute; 'azulejo show' has the full time. */
        when = format_time(text, job->submitted_at);
        table_add(table, "%.11s", strlen(when) > 5 ? when + 5 : when);
    }
    table_add(table, "%s", job_info_note(note, job));
}

static void print_table(const struct job_rows *list)
{
    int wide = !isatty(STDOUT_FILENO) || terminal_columns(STDOUT_FILENO) >= NARROW;
    struct table table;

    table_init(&table, wide ? titles_wide : titles_narrow, wide ? COLUMNS_WIDE : COLUMNS_NARROW);
    for (size_t i = 0; i < list->count; i++)
        add_job(&table, list->jobs[i], wide);
    table_print(&table);
    table_release(&table);
}

static status print_json(const struct job_rows *rows, struct error *err)
{
    Azulejo__Wire__JobList list = AZULEJO__WIRE__JOB_LIST__INIT;

    list.jobs = (Azulejo__Wire__JobInfo **)(uintptr_t)rows->jobs; /* only read */
    list.n_jobs = rows->count;
    list.older = rows->not_shown;
    return json_print(json_message(&list.base), err);
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct job_choice choice = {0};
    struct chosen_jobs chosen = {0};
    struct job_rows rows = {0};
    int64_t newest = -1; /* all */
    int json = 0, done, filtered;
    const struct option table[] = {
        {"state", 0, OPTION_STRING, &choice.states, "STATE,...",
         "only jobs in these states, as in queued,failed", 0, 0, NULL},
        {"mine", 0, OPTION_FLAG, &choice.mine, NULL,
         "only jobs that you submitted from this machine", 0, 0, NULL},
        {"newest", 'n', OPTION_INT, &newest, "N",
         "of the jobs that have ended, only the newest N (default: all)", 0, 1e9, NULL},
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct positionals rest;
    struct connection *connection = NULL;
    status result = command_parse(command, table, argc, argv, 0, 0, &rest, &done, err);

    if (result != STATUS_OK || done)
        return result;
    filtered = choice.states || choice.mine;
    if (filtered && newest >= 0)
        return error_set(err, STATUS_ERR_USAGE, "--newest cannot be combined with --state and --mine");
    if (filtered)
        result = job_choice_check(&choice, &rest, err);
    THEN(result, connection_open(&connection, &where, err));
    THEN(result, filtered ? rows_choose(connection, &choice, &chosen, &rows, err)
                          : rows_get(connection, newest < 0 ? SIZE_MAX : (size_t)newest, &rows, err));
    if (result == STATUS_OK && json)
        result = print_json(&rows, err);
    else if (result == STATUS_OK)
        print_table(&rows);
    if (result == STATUS_OK && rows.not_shown > 0 && !json)
        fprintf(stderr, "%" PRIu64 " older jobs that have ended are not shown\n", rows.not_shown);
    rows_release(&rows);
    chosen_jobs_release(&chosen);
    connection_close(connection);
    return result;
}

const struct command command_list = {
    .name = "list",
    .group = COMMAND_JOBS,
    .usage = "azulejo list [OPTION]...",
    .summary = "list the jobs",
    .description = "List the farm's jobs: the running and queued ones, and those that have ended. The notes say why a job\n"
                   "waits or failed.",
    .run = run,
};
