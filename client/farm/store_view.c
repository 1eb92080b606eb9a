#include "client/farm/store_view.h"

#include <inttypes.h>
#include <stdio.h>

#include "client/follow/job_info.h"
#include "client/terminal/field.h"
#include "client/terminal/format.h"
#include "client/terminal/table.h"
#include "common/base/duration.h"
#include "protocol/message.h"

enum { SHOWN_MAX = 20 }; /* jobs and owners in the text */

status store_ask(struct connection *c, int collect, int now, Azulejo__Wire__Envelope **answer, struct error *err)
{
    Azulejo__Wire__StoreQuery body = AZULEJO__WIRE__STORE_QUERY__INIT;
    Azulejo__Wire__Envelope question = MESSAGE(STORE_QUERY, store_query, &body);

    body.collect = collect;
    body.now = now;
    return connection_ask(c, &question, AZULEJO__WIRE__ENVELOPE__BODY_STORE_INFO, answer, err);
}

static uint64_t total(const Azulejo__Wire__StoreInfo *i)
{
    return i->films + i->pictures + i->blobs + i->database + i->reserve + i->other;
}

/* ---- for people ------------------------------------------------------------------------------ */

static void print_kind(const char *label, uint64_t bytes, const char *what)
{
    char text[FORMAT_SIZE];

    field_printf(stdout, label, "%10s%s%s", bytes_text(text, bytes), *what ? "  " : "", what);
}

static void print_limits(const Azulejo__Wire__StoreInfo *i)
{
    char size[FORMAT_SIZE], age[DURATION_TEXT_SIZE];

    if (i->keep_s >= 0)
        field_printf(stdout, "keep", "jobs are removed %s after their end", duration_text(age, i->keep_s));
    if (i->keep_failed_s >= 0)
        field_printf(stdout, "", "failed and cancelled ones after %s", duration_text(age, i->keep_failed_s));
    if (i->store_limit)
        field_printf(stdout, "limit", "%s in the store, then what ended first goes", bytes_text(size, i->store_limit));
    if (i->owner_limit)
        field_printf(stdout, "", "%s of films and pictures for each owner", bytes_text(size, i->owner_limit));
    if (i->keep_s < 0 && i->keep_failed_s < 0 && !i->store_limit && !i->owner_limit)
        field_print(stdout, "keep", "no limit: jobs stay until 'azulejo prune' or 'remove'");
}

static void print_owners(const Azulejo__Wire__StoreInfo *info)
{
    static const char *const titles[] = {"OWNER", ">JOBS", ">FILMS", ">PICTURES"};
    struct table table;
    char text[FORMAT_SIZE];

    table_init(&table, titles, sizeof titles / sizeof *titles);
    for (size_t i = 0; i < info->n_owners && i < SHOWN_MAX; i++) {
        table_add(&table, "%s", info->owners[i]->owner[0] ? info->owners[i]->owner : "-");
        table_add(&table, "%" PRIu64, info->owners[i]->jobs);
        table_add(&table, "%s", bytes_text(text, info->owners[i]->films));
        table_add(&table, "%s", bytes_text(text, info->owners[i]->pictures));
    }
    table_print(&table);
    table_release(&table);
}

static void print_jobs(const Azulejo__Wire__StoreInfo *info)
{
    static const char *const titles[] = {">JOB", "STATE", "<NAME", "OWNER", ">FILMS", ">PICTURES"};
    struct table table;
    char text[FORMAT_SIZE];

    table_init(&table, titles, sizeof titles / sizeof *titles);
    for (size_t i = 0; i < info->n_jobs && i < SHOWN_MAX; i++) {
        const Azulejo__Wire__StoreJob *j = info->jobs[i];
        table_add(&table, "%" PRIu64, j->job);
        table_add(&table, "%s", job_state_word(j->state));
        table_add(&table, "%s", j->name);
        table_add(&table, "%s", j->owner[0] ? j->owner : "-");
        table_add(&table, "%s", bytes_text(text, j->films));
        table_add(&table, "%s", bytes_text(text, j->pictures));
    }
    table_print(&table);
    table_release(&table);
    if (info->n_jobs > SHOWN_MAX || info->more_jobs > 0)
        printf("and %" PRIu64 " more jobs\n",
               info->more_jobs + (info->n_jobs > SHOWN_MAX ? info->n_jobs - SHOWN_MAX : 0));
}

static void print_safety(const Azulejo__Wire__StoreInfo *i)
{
    char when[FORMAT_SIZE] = "";

    if (i->scrub_files > 0 && i->scrubbed_at)
        field_printf(stdout, "scrub", "%" PRIu64 " files were read again since the start, all of them by %s; %" PRIu64 " were damaged",
                     i->scrub_files, format_time(when, i->scrubbed_at), i->scrub_faults);
    else if (i->scrub_files > 0)
        field_printf(stdout, "scrub", "%" PRIu64 " files were read again since the start; %" PRIu64 " were damaged",
                     i->scrub_files, i->scrub_faults);
    else
        field_print(stdout, "scrub", "no file was read again yet: it is done while nothing is rendered");
    if (i->scrub_last[0])
        field_printf(stdout, "", "%s", i->scrub_last);
    if (i->wall[0] || i->wall_lacks[0])
        field_printf(stdout, "wall", "uploaded scenes are read behind a wall: %s", i->wall[0] ? i->wall : "none");
    if (i->wall_lacks[0])
        field_printf(stdout, "", "this kernel cannot keep them from: %s", i->wall_lacks);
}

static void print_events(const Azulejo__Wire__StoreInfo *i)
{
    if (!i->on_event[0])
        return;
    field_printf(stdout, "events", "for %s: %" PRIu64 " taken, %u wait, %" PRIu64 " failed, %" PRIu64 " dropped",
                 i->on_event, i->events_taken, i->events_waiting, i->events_failed, i->events_dropped);
    if (i->events_trouble[0])
        field_printf(stdout, "", "%s", i->events_trouble);
}

static void print_store(const Azulejo__Wire__StoreInfo *i)
{
    char all[FORMAT_SIZE], left[FORMAT_SIZE], disk[FORMAT_SIZE];

    printf("the store takes %s\n", bytes_text(all, total(i)));
    field_printf(stdout, "disk", "%10s of %s are free", bytes_text(left, i->free), bytes_text(disk, i->disk));
    print_kind("films", i->films, "for extend and retry, and of frames in work");
    print_kind("pictures", i->pictures, "");
    print_kind("blobs", i->blobs, "scenes and their files");
    print_kind("database", i->database, "");
    print_kind("reserve", i->reserve, "for the database on a full disk");
    if (i->other > 0)
        print_kind("other", i->other, "");
    if (i->trash > 0)
        print_kind("trash", i->trash, "removed: being freed, and not counted above");
    print_limits(i);
    print_safety(i);
    print_events(i);
    if (i->n_owners > 0) {
        printf("\n");
        print_owners(i);
    }
    if (i->n_jobs > 0) {
        printf("\n");
        print_jobs(i);
    }
}

status store_show(const struct connection_options *where, int json, struct error *err)
{
    struct connection *c = NULL;
    Azulejo__Wire__Envelope *answer = NULL;
    status result = connection_open(&c, where, err);

    THEN(result, store_ask(c, 0, 0, &answer, err));
    if (result == STATUS_OK && json)
        result = json_print(json_message(&answer->store_info->base), err);
    else if (result == STATUS_OK)
        print_store(answer->store_info);
    message_free(answer);
    connection_close(c);
    return result;
}
