/* azulejo top: the farm at a glance. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

#include "client/commands/command.h"
#include "client/views/workers_view.h"
#include "client/follow/job_info.h"
#include "client/link/reconnect.h"
#include "client/link/signals.h"
#include "client/terminal/format.h"
#include "client/terminal/screen.h"
#include "client/terminal/table.h"
#include "common/base/buffer.h"
#include "common/cli/terminal.h"
#include "common/system/clock.h"
#include "protocol/message.h"

enum {
    NARROW = 100,
    PLAIN_ROWS = 50,   /* of each table, without a terminal */
    FIXED_LINES = 8,   /* of a screen: the head, two titles, what is left out, and space */
    LEAST_ROWS = 3,
    SLICE_MS = 1000,   /* heartbeats are sent in between */
};

/* A terminal with fewer than NARROW columns has no room for owners. */
static const char *const job_titles[] = {">JOB",  "<NAME", ">PRIO",   "STATE",    ">DONE",
                                         ">LEFT", ">RATE/s", ">WORKERS", "<NOTE", "<OWNER"};
static const char *const worker_titles[] = {"<NAME", "<STATE", ">THREADS", ">RATE/s",
                                            ">UNITS", ">JOB", ">SINCE", "<NOTE"};

struct top {
    struct connection_options where;
    struct connection *connection; /* NULL: lost */
    struct screen screen;
    double interval_s;
    int once;
    Azulejo__Wire__Envelope *jobs, *workers;
    struct error lost;
};

static void forget(struct top *t)
{
    message_free(t->jobs);
    message_free(t->workers);
    t->jobs = t->workers = NULL;
}

/* ---- asking --------------------------------------------------------------------------------- */

static status stop_wanted(void *user UNUSED, struct error *err)
{
    return signals_stop() ? error_set(err, STATUS_ERR_TIMEOUT, "interrupted") : STATUS_OK;
}

static status ask(struct top *t, struct error *err)
{
    Azulejo__Wire__Envelope jobs = AZULEJO__WIRE__ENVELOPE__INIT, workers = jobs;
    Azulejo__Wire__JobQuery job_query = AZULEJO__WIRE__JOB_QUERY__INIT;
    Azulejo__Wire__WorkerQuery worker_query = AZULEJO__WIRE__WORKER_QUERY__INIT;
    size_t rows = t->screen.drawn_on ? terminal_rows(STDOUT_FILENO) : PLAIN_ROWS;

    forget(t);
    job_query.first = (uint32_t)rows;
    jobs.body_case = AZULEJO__WIRE__ENVELOPE__BODY_JOB_QUERY;
    jobs.job_query = &job_query;
    workers.body_case = AZULEJO__WIRE__ENVELOPE__BODY_WORKER_QUERY;
    workers.worker_query = &worker_query;
    TRY(connection_ask(t->connection, &jobs, AZULEJO__WIRE__ENVELOPE__BODY_JOB_LIST, &t->jobs, err));
    return connection_ask(t->connection, &workers, AZULEJO__WIRE__ENVELOPE__BODY_WORKER_LIST, &t->workers, err);
}

/* ---- showing -------------------------------------------------------------------------------- */

/* "3 running, 12 queued", of the jobs that have not ended. */
static uint64_t count_jobs(const Azulejo__Wire__JobList *list, struct buffer *words)
{
    uint64_t total = 0;

    for (size_t i = 0; i < list->n_states; i++) {
        if (job_state_ended(i) || list->states[i] == 0)
            continue;
        buffer_printf(words, "%s%u %s", total ? ", " : "", list->states[i], job_state_word(i));
        total += list->states[i];
    }
    return total;
}

static void print_head(const struct top *t, uint64_t *active)
{
    const Azulejo__Wire__WorkerList *workers = t->workers->worker_list;
    struct buffer words = BUFFER_INIT;
    char rate[FORMAT_SIZE], clock[FORMAT_SIZE];
    uint64_t threads = 0, busy = 0;
    double per_second = 0;

    *active = count_jobs(t->jobs->job_list, &words);
    for (size_t i = 0; i < workers->n_workers; i++) {
        threads += workers->workers[i]->threads;
        busy += workers->workers[i]->units_leased > 0;
        per_second += workers->workers[i]->samples_per_second;
    }
    format_time(clock, (int64_t)time(NULL));
    printf("azulejo top: %s, %s\n", connection_address(t->connection), clock);
    printf("%s; %zu worker%s, %" PRIu64 " busy, %" PRIu64 " thread%s; %s samples/s\n",
           *active ? buffer_text(&words) : "no jobs", workers->n_workers, workers->n_workers == 1 ? "" : "s", busy,
           threads, threads == 1 ? "" : "s", format_count(rate, per_second));
    buffer_release(&words);
}

static void print_jobs(const struct top *t, size_t rows, uint64_t active)
{
    const Azulejo__Wire__JobList *list = t->jobs->job_list;
    struct table table;
    char text[FORMAT_SIZE], note[JOB_NOTE_SIZE];
    int narrow = t->screen.drawn_on && terminal_columns(STDOUT_FILENO) < NARROW;

    rows = rows < list->n_jobs ? rows : list->n_jobs;
    table_init(&table, job_titles, sizeof job_titles / sizeof *job_titles - (size_t)narrow);
    for (size_t i = 0; i < rows; i++) {
        const Azulejo__Wire__JobInfo *job = list->jobs[i];
        int running = job->state == AZULEJO__WIRE__JOB_STATE__JOB_RUNNING;
        table_add(&table, "%" PRIu64, job->job);
        table_add(&table, "%s", job->name);
        table_add(&table, "%d", job->priority);
        table_add(&table, "%s", job_state_word(job->state));
        table_add(&table, "%.0f %%",
                  job->samples_total ? 100.0 * (double)job->samples_done / (double)job->samples_total : 0.0);
        table_add(&table, "%s", running ? format_duration(text, job->seconds_left) : "-");
        table_add(&table, "%s", running ? format_count(text, job->samples_per_second) : "-");
        table_add(&table, "%u", job->workers);
        table_add(&table, "%s", job_info_note(note, job));
        if (!narrow)
            table_add(&table, "%s", job->owner[0] ? job->owner : "-");
    }
    table_print(&table);
    table_release(&table);
    if (active > rows)
        printf("... and %" PRIu64 " more\n", active - rows);
}

static int by_rate(const void *a, const void *b)
{
    const Azulejo__Wire__WorkerInfo *one = *(Azulejo__Wire__WorkerInfo *const *)a;
    const Azulejo__Wire__WorkerInfo *other = *(Azulejo__Wire__WorkerInfo *const *)b;

    if (one->samples_per_second != other->samples_per_second)
        return one->samples_per_second < other->samples_per_second ? 1 : -1;
    return one->session < other->session ? -1 : one->session > other->session;
}

static void print_workers(const Azulejo__Wire__WorkerList *list, size_t rows)
{
    struct table table;
    char text[FORMAT_SIZE];

    if (list->n_workers > 0)
        qsort(list->workers, list->n_workers, sizeof *list->workers, by_rate);
    rows = rows < list->n_workers ? rows : list->n_workers;
    table_init(&table, worker_titles, sizeof worker_titles / sizeof *worker_titles);
    for (size_t i = 0; i < rows; i++) {
        const Azulejo__Wire__WorkerInfo *w = list->workers[i];
        table_add(&table, "%s", w->name);
        table_add(&table, "%s", worker_state_name(w->state));
        table_add(&table, "%u", w->threads);
        table_add(&table, "%s", format_count(text, w->samples_per_second));
        table_add(&table, "%u", w->units_leased);
        if (w->job)
            table_add(&table, "%" PRIu64, w->job);
        else
            table_add(&table, "-");
        table_add(&table, "%s", format_duration(text, (double)w->connected_s));
        table_add(&table, "%s", w->note);
    }
    table_print(&table);
    table_release(&table);
    if (list->n_workers > rows)
        printf("... and %zu more\n", list->n_workers - rows);
}

/* A screen's rows are shared: each table may take what the other does not need. */
static void share_rows(const struct top *t, size_t *jobs, size_t *workers)
{
    size_t lines = terminal_rows(STDOUT_FILENO);
    size_t rows = lines > FIXED_LINES + 2 * LEAST_ROWS ? lines - FIXED_LINES : 2 * LEAST_ROWS;
    size_t n_workers = t->workers->worker_list->n_workers;

    *jobs = *workers = PLAIN_ROWS;
    if (!t->screen.drawn_on)
        return;
    *workers = n_workers < rows / 2 ? n_workers : rows / 2;
    *jobs = rows - *workers;
    if (t->jobs->job_list->n_jobs < *jobs) {
        *jobs = t->jobs->job_list->n_jobs;
        *workers = rows - *jobs;
    }
}

static void show(struct top *t)
{
    size_t jobs, workers;
    uint64_t active;

    share_rows(t, &jobs, &workers);
    screen_clear(&t->screen);
    print_head(t, &active);
    putchar('\n');
    print_jobs(t, jobs, active);
    putchar('\n');
    print_workers(t->workers->worker_list, workers);
    if (!t->screen.drawn_on && !t->once)
        putchar('\n');
}

static void show_loss(const struct top *t)
{
    screen_clear(&t->screen);
    if (t->screen.drawn_on)
        printf("azulejo top: %s; trying again\n", t->lost.text);
    else
        fprintf(stderr, "azulejo top: %s; trying again\n", t->lost.text);
}

/* Ask and show once. A lost connection is shown, and made again the next time. */
static status turn(struct top *t, struct error *err)
{
    status s = t->connection ? STATUS_OK : connection_open(&t->connection, &t->where, err);

    THEN(s, ask(t, err));
    if (s == STATUS_OK)
        show(t);
    if (s == STATUS_OK || t->once || !reconnect_is_loss(s) || signals_stop())
        return s;
    if (err)
        t->lost = *err;
    connection_close(t->connection);
    t->connection = NULL;
    show_loss(t);
    return STATUS_OK;
}

/* Until the next picture, while the connection is kept alive. 0: it is to end. */
static int wait_a_while(const struct top *t)
{
    uint64_t end_ns = clock_monotonic_ns() + (uint64_t)(t->interval_s * 1e9), now_ns;

    while ((now_ns = clock_monotonic_ns()) < end_ns) {
        uint64_t left_ms = (end_ns - now_ns) / NS_PER_MS + 1;
        int key = screen_wait(&t->screen, signals_fd(), (int)(left_ms < SLICE_MS ? left_ms : SLICE_MS));
        signals_drain();
        if (key == 'q' || key == 'Q' || signals_stop())
            return 0;
        if (t->connection)
            (void)connection_pump(t->connection, 0);
    }
    return 1;
}

static status repeat(struct top *t, struct error *err)
{
    status s;

    do
        s = turn(t, err);
    while (s == STATUS_OK && !t->once && !ferror(stdout) && wait_a_while(t));
    return signals_stop() ? STATUS_OK : s;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct top t = {.where = CONNECTION_OPTIONS_INIT, .interval_s = 2};
    int done;
    const struct option table[] = {
        {"once", '1', OPTION_FLAG, &t.once, NULL, "print it once and exit", 0, 0, NULL},
        {"interval", 0, OPTION_REAL, &t.interval_s, "SECONDS", "time between two pictures (default 2)",
         0.1, 86400, NULL},
        CONNECTION_OPTION_ROWS(t.where),
        {0},
    };
    struct positionals rest;
    status result = command_parse(command, table, argc, argv, 0, 0, &rest, &done, err);

    if (result != STATUS_OK || done)
        return result;
    result = signals_catch(err);
    t.where.watch = stop_wanted;
    THEN(result, connection_open(&t.connection, &t.where, err));
    if (result == STATUS_ERR_TIMEOUT && !t.once)
        result = STATUS_OK; /* it listens, and may answer later: repeat() goes on trying */
    if (result != STATUS_OK)
        return result;
    if (!t.once)
        screen_begin(&t.screen);
    result = repeat(&t, err);
    screen_end(&t.screen);
    forget(&t);
    connection_close(t.connection);
    return result;
}

const struct command command_top = {
    .name = "top",
    .group = COMMAND_FARM,
    .usage = "azulejo top [OPTION]...",
    .summary = "show the farm at a glance: jobs, workers, rates",
    .description = "Show the jobs that have not ended, in the order of service, and the workers, fastest first; again\n"
                   "every two seconds until q or Ctrl-C. Without a terminal it is printed each time.",
    .run = run,
};
