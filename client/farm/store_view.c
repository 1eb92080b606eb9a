#include "client/farm/store_view.h"

#include <inttypes.h>
#include <stdio.h>

#include "client/farm/job_info.h"
#include "client/terminal/format.h"
#include "client/terminal/table.h"
#include "common/base/duration.h"
#include "protocol/message.h"

enum { SHOWN_MAX = 20 }; /* jobs and owners in the text */

status store_ask(struct connection *c, int collect, Azulejo__Wire__Envelope **answer,
                 struct error *err)
{
    Azulejo__Wire__StoreQuery body = AZULEJO__WIRE__STORE_QUERY__INIT;
    Azulejo__Wire__Envelope question = MESSAGE(STORE_QUERY, store_query, &body);

    body.collect = collect;
    return connection_ask(c, &question, AZULEJO__WIRE__ENVELOPE__BODY_STORE_INFO, answer, err);
}

static uint64_t total(const Azulejo__Wire__StoreInfo *i)
{
    return i->films + i->pictures + i->blobs + i->database + i->reserve + i->other;
}

/* ---- for programs ---------------------------------------------------------------------------- */

static json_t *number(uint64_t value) { return json_integer((json_int_t)value); }

/* null: there is none. */
static json_t *limit_json(uint64_t limit) { return limit ? number(limit) : json_null(); }

static json_t *age_json(int64_t seconds)
{
    return seconds >= 0 ? json_integer(seconds) : json_null();
}

static json_t *jobs_json(const Azulejo__Wire__StoreInfo *info)
{
    json_t *jobs = json_array();

    for (size_t i = 0; i < info->n_jobs; i++) {
        const Azulejo__Wire__StoreJob *j = info->jobs[i];
        json_array_append_new(jobs,
                              json_pack("{s:o, s:o, s:o, s:s, s:o, s:o}", "job", number(j->job),
                                        "name", json_text(j->name), "owner", json_text(j->owner),
                                        "state", job_state_word(j->state), "films",
                                        number(j->films), "pictures", number(j->pictures)));
    }
    return jobs;
}

static json_t *owners_json(const Azulejo__Wire__StoreInfo *info)
{
    json_t *owners = json_array();

    for (size_t i = 0; i < info->n_owners; i++) {
        const Azulejo__Wire__StoreOwner *o = info->owners[i];
        json_array_append_new(owners,
                              json_pack("{s:o, s:o, s:o, s:o}", "owner", json_text(o->owner),
                                        "jobs", number(o->jobs), "films", number(o->films),
                                        "pictures", number(o->pictures)));
    }
    return owners;
}

json_t *store_json(const Azulejo__Wire__StoreInfo *i)
{
    return json_pack(
        "{s:o, s:o, s:o, s:{s:o, s:o, s:o, s:o, s:o, s:o}, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o}",
        "disk", number(i->disk), "free", number(i->free), "total", number(total(i)), "kinds",
        "films", number(i->films), "pictures", number(i->pictures), "blobs", number(i->blobs),
        "database", number(i->database), "reserve", number(i->reserve), "other", number(i->other),
        "trash", number(i->trash),
        "store_limit", limit_json(i->store_limit), "owner_limit", limit_json(i->owner_limit),
        "keep_s", age_json(i->keep_s), "keep_failed_s", age_json(i->keep_failed_s), "jobs",
        jobs_json(i), "more_jobs", number(i->more_jobs), "owners", owners_json(i));
}

/* ---- for people ------------------------------------------------------------------------------ */

static void print_kind(const char *label, uint64_t bytes, const char *what)
{
    char text[FORMAT_SIZE];

    printf("  %-10s  %10s%s%s\n", label, bytes_text(text, bytes), *what ? "  " : "", what);
}

static void print_limits(const Azulejo__Wire__StoreInfo *i)
{
    char size[FORMAT_SIZE], age[DURATION_TEXT_SIZE];

    if (i->keep_s >= 0)
        printf("  %-10s  jobs are removed %s after their end\n", "keep",
               duration_text(age, i->keep_s));
    if (i->keep_failed_s >= 0)
        printf("  %-10s  failed and cancelled ones after %s\n", "",
               duration_text(age, i->keep_failed_s));
    if (i->store_limit)
        printf("  %-10s  %s in the store, then what ended first goes\n", "limit",
               bytes_text(size, i->store_limit));
    if (i->owner_limit)
        printf("  %-10s  %s of films and pictures for each owner\n", "",
               bytes_text(size, i->owner_limit));
    if (i->keep_s < 0 && i->keep_failed_s < 0 && !i->store_limit && !i->owner_limit)
        printf("  %-10s  no limit: jobs stay until 'azulejo prune' or 'remove'\n", "keep");
}

static status print_owners(const Azulejo__Wire__StoreInfo *info, struct error *err)
{
    static const char *const titles[] = {"OWNER", ">JOBS", ">FILMS", ">PICTURES"};
    struct table table;
    char text[FORMAT_SIZE];
    status result;

    table_init(&table, titles, sizeof titles / sizeof *titles);
    for (size_t i = 0; i < info->n_owners && i < SHOWN_MAX; i++) {
        table_add(&table, "%s", info->owners[i]->owner[0] ? info->owners[i]->owner : "-");
        table_add(&table, "%" PRIu64, info->owners[i]->jobs);
        table_add(&table, "%s", bytes_text(text, info->owners[i]->films));
        table_add(&table, "%s", bytes_text(text, info->owners[i]->pictures));
    }
    result = table_print(&table, err);
    table_release(&table);
    return result;
}

static status print_jobs(const Azulejo__Wire__StoreInfo *info, struct error *err)
{
    static const char *const titles[] = {">JOB", "STATE", "<NAME", "OWNER", ">FILMS", ">PICTURES"};
    struct table table;
    char text[FORMAT_SIZE];
    status result;

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
    result = table_print(&table, err);
    table_release(&table);
    if (result == STATUS_OK && (info->n_jobs > SHOWN_MAX || info->more_jobs > 0))
        printf("and %" PRIu64 " more jobs\n",
               info->more_jobs + (info->n_jobs > SHOWN_MAX ? info->n_jobs - SHOWN_MAX : 0));
    return result;
}

static status print_store(const Azulejo__Wire__StoreInfo *i, struct error *err)
{
    char all[FORMAT_SIZE], left[FORMAT_SIZE], disk[FORMAT_SIZE];
    status result = STATUS_OK;

    printf("the store takes %s; %s of the disk's %s are free\n", bytes_text(all, total(i)),
           bytes_text(left, i->free), bytes_text(disk, i->disk));
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
    if (i->n_owners > 0) {
        printf("\n");
        result = print_owners(i, err);
    }
    if (result == STATUS_OK && i->n_jobs > 0) {
        printf("\n");
        result = print_jobs(i, err);
    }
    return result;
}

status store_show(const struct connection_options *where, int json, struct error *err)
{
    struct connection *c = NULL;
    Azulejo__Wire__Envelope *answer = NULL;
    status result = connection_open(&c, where, err);

    if (result == STATUS_OK)
        result = store_ask(c, 0, &answer, err);
    if (result == STATUS_OK)
        result = json ? json_print(store_json(answer->store_info), err)
                      : print_store(answer->store_info, err);
    message_free(answer);
    connection_close(c);
    return result;
}
