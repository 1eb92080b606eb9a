#include "client/views/workers_view.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "client/terminal/format.h"
#include "client/terminal/table.h"
#include "common/scene/settings.h"
#include "protocol/message.h"

const char *worker_state_name(Azulejo__Wire__WorkerState state)
{
    static const char *const names[] = {"idle",    "working", "paused", "draining",
                                        "drained", "blocked", "leaving"};

    return (unsigned)state < sizeof names / sizeof *names ? names[state] : "unknown";
}

static int is_connected(const Azulejo__Wire__WorkerList *list, const char *name)
{
    for (size_t i = 0; i < list->n_workers; i++)
        if (strcmp(list->workers[i]->name, name) == 0)
            return 1;
    return 0;
}

/* ---- tables ---------------------------------------------------------------------------------- */

static void add_cpus(struct table *table, const Azulejo__Wire__WorkerStatus *s)
{
    if (s)
        table_add(table, "%.1f", s->cpus);
    else
        table_add(table, "-");
}

static void add_bytes(struct table *table, uint64_t bytes)
{
    char text[FORMAT_SIZE];

    table_add(table, "%s", bytes ? bytes_text(text, bytes) : "-");
}

static void add_worker(struct table *table, const Azulejo__Wire__WorkerInfo *w)
{
    const Azulejo__Wire__WorkerStatus *s = w->status;
    char text[FORMAT_SIZE];

    table_add(table, "%s", w->name);
    table_add(table, "%s", worker_state_name(w->state));
    if (w->job)
        table_add(table, "%" PRIu64, w->job);
    else
        table_add(table, "-");
    if (s)
        table_add(table, "%u/%u", s->threads_busy, w->threads);
    else
        table_add(table, "%u", w->threads);
    table_add(table, "%s", format_count(text, w->samples_per_second));
    add_cpus(table, s);
    add_bytes(table, s ? s->memory_bytes : 0);
    add_bytes(table, s ? s->cache_bytes : 0);
    table_add(table, "%" PRIu64, w->units_done);
    table_add(table, "%s", format_duration(text, (double)w->connected_s));
    table_add(table, "%s", w->host);
    table_add(table, "%s", w->tags[0] ? w->tags : "-");
    table_add(table, "%s", w->note);
}

static void add_blocked(struct table *table, const Azulejo__Wire__WorkerMark *mark)
{
    table_add(table, "%s", mark->name);
    table_add(table, "blocked");
    for (int column = 2; column < 12; column++)
        table_add(table, "-");
    table_add(table, "blocked by %s; not connected", mark->who);
}

void workers_print(const Azulejo__Wire__WorkerList *list)
{
    static const char *const titles[] = {"NAME",    "STATE",  ">JOB",  ">THREADS", ">RATE/s", ">CPU",
                                         ">MEMORY", ">CACHE", ">DONE", ">SINCE",   "HOST",    "TAGS", "~NOTE"};
    struct table table;

    table_init(&table, titles, sizeof titles / sizeof *titles);
    for (size_t i = 0; i < list->n_workers; i++)
        add_worker(&table, list->workers[i]);
    for (size_t i = 0; i < list->n_marks; i++)
        if (list->marks[i]->blocked && !is_connected(list, list->marks[i]->name))
            add_blocked(&table, list->marks[i]);
    table_print(&table);
    table_release(&table);
}

void workers_print_gone(const Azulejo__Wire__WorkerList *list)
{
    static const char *const titles[] = {"NAME",   "LEFT",      ">STAYED", ">UNITS",
                                         ">SAMPLES", ">CORE TIME", "HOST",    "~WHY"};
    struct table table;

    table_init(&table, titles, sizeof titles / sizeof *titles);
    for (size_t i = 0; i < list->n_gone; i++) {
        const Azulejo__Wire__WorkerGone *w = list->gone[i];
        char text[FORMAT_SIZE];
        table_add(&table, "%s", w->name);
        table_add(&table, "%s", format_time(text, w->left_at));
        table_add(&table, "%s", format_duration(text, (double)(w->left_at - w->joined_at)));
        table_add(&table, "%" PRIu64, w->units_done);
        table_add(&table, "%s", format_count(text, (double)w->samples_done));
        table_add(&table, "%s", format_duration(text, w->core_seconds));
        table_add(&table, "%s", w->host);
        table_add(&table, "%s", w->why);
    }
    table_print(&table);
    table_release(&table);
}

/* ---- one worker ------------------------------------------------------------------------------ */

static void print_lines(Azulejo__Wire__WorkerLine *const *lines, size_t count)
{
    char when[FORMAT_SIZE], text[MESSAGE_TEXT_MAX];

    for (size_t i = 0; i < count; i++)
        printf("    %s  %s\n", format_time(when, lines[i]->at),
               message_text(text, sizeof text, lines[i]->text));
}

static void print_status(const Azulejo__Wire__WorkerStatus *s)
{
    char text[FORMAT_SIZE], other[FORMAT_SIZE];

    printf("  cpu:      %.1f processors", s->cpus);
    if (s->other_cpus >= 0)
        printf(", other processes of its machine %.1f", s->other_cpus);
    printf("\n  memory:   %s of its machine's %s\n", bytes_text(text, s->memory_bytes),
           bytes_text(other, s->machine_memory_bytes));
    printf("  cache:    %s of at most %s\n", bytes_text(text, s->cache_bytes),
           bytes_text(other, s->cache_limit_bytes));
    for (size_t i = 0; i < s->n_long_units; i++) {
        const Azulejo__Wire__LongUnit *u = s->long_units[i];
        printf("  renders:  job %" PRIu64 ", frame %u, tile %u, group %u, pass %u for %s\n", u->job, u->frame,
               u->tile, u->group, u->pass, format_duration(text, (double)u->running_ms / 1000));
    }
}

static void print_connected(const Azulejo__Wire__WorkerInfo *w)
{
    char text[MESSAGE_TEXT_MAX], when[FORMAT_SIZE];

    printf("%s: %s", message_text(text, sizeof text, w->name), worker_state_name(w->state));
    if (w->note[0])
        printf(" (%s)", message_text(text, sizeof text, w->note));
    printf("\n  host:     %s", message_text(text, sizeof text, w->host));
    printf(", process %u, %s, session %u\n", w->process, message_text(text, sizeof text, w->address), w->session);
    printf("  software: %s\n", message_text(text, sizeof text, w->kernel));
    if (w->job)
        printf("  job:      %" PRIu64 ", %u units\n", w->job, w->units_leased);
    if (w->status)
        printf("  threads:  %u of %u render\n", w->status->threads_busy, w->threads);
    else
        printf("  threads:  %u\n", w->threads);
    if (w->memory)
        printf("  offers:   %s of memory\n", bytes_text(when, w->memory));
    if (w->tags[0])
        printf("  tags:     %s\n", message_text(text, sizeof text, w->tags));
    printf("  rate:     %s samples/s\n", format_count(when, w->samples_per_second));
    if (w->status)
        print_status(w->status);
    printf("  done:     %" PRIu64 " units, ", w->units_done);
    printf("%s samples, ", format_count(when, (double)w->samples_done));
    printf("%s of core time, ", format_duration(when, w->core_seconds));
    printf("in %s\n", format_duration(when, (double)w->connected_s));
    if (w->n_lines)
        printf("  last lines:\n");
    print_lines(w->lines, w->n_lines);
}

static void print_gone(const Azulejo__Wire__WorkerGone *w)
{
    char text[MESSAGE_TEXT_MAX], when[FORMAT_SIZE];

    printf("%s left %s: ", message_text(text, sizeof text, w->name), format_time(when, w->left_at));
    printf("%s\n  host:     ", message_text(text, sizeof text, w->why));
    printf("%s, process %u, ", message_text(text, sizeof text, w->host), w->process);
    printf("%s\n", message_text(text, sizeof text, w->address));
    printf("  joined:   %s, %u connection%s\n", format_time(when, w->joined_at), w->connections,
           w->connections == 1 ? "" : "s");
    printf("  done:     %" PRIu64 " units, ", w->units_done);
    printf("%s samples, ", format_count(when, (double)w->samples_done));
    printf("%s of core time\n", format_duration(when, w->core_seconds));
    if (w->n_lines)
        printf("  last lines:\n");
    print_lines(w->lines, w->n_lines);
}

void workers_print_one(const Azulejo__Wire__WorkerList *list)
{
    char who[256], when[FORMAT_SIZE];

    for (size_t i = 0; i < list->n_workers; i++)
        print_connected(list->workers[i]);
    for (size_t i = 0; i < list->n_marks; i++)
        if (list->marks[i]->blocked)
            printf("%s is blocked since %s by %s\n", list->marks[i]->name, format_time(when, list->marks[i]->at),
                   message_text(who, sizeof who, list->marks[i]->who));
    for (size_t i = 0; i < list->n_gone; i++) {
        if (i > 0 || list->n_workers > 0)
            printf("\n");
        print_gone(list->gone[i]);
    }
}
