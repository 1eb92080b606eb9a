/* Changes that people make, as statements that wait for the writer thread: it runs them in their order, in the transaction
 * of what else is noted, before the rows of jobs. So only their answers wait for the disk. */
#include <string.h>

#include "common/base/memory.h"
#include "common/system/log.h"
#include "coordinator/store/store_parts.h"

struct noted_change {
    struct noted link;
    const char *what;
    uint64_t clock_job;  /* the clocks of this job begin again; 0: none do */
    int64_t clock_frame; /* -1: of all its frames */
    size_t count;
    struct sql_value values[]; /* then the statement, and the values' texts and bytes */
};

static int has_bytes(const struct sql_value *value)
{
    return (value->kind == SQL_TEXT || value->kind == SQL_BYTES) && value->data;
}

static size_t size_of(const struct sql_value *value)
{
    return !has_bytes(value) ? 0 : value->kind == SQL_TEXT ? strlen(value->data) + 1 : value->size_bytes;
}

static const char *statement_of(const struct noted_change *c) { return (const char *)&c->values[c->count]; }

static struct noted_change *change_new(const char *sql, const struct sql_value *values, size_t count, const char *what)
{
    size_t size = sizeof(struct noted_change) + count * sizeof *values + strlen(sql) + 1;
    struct noted_change *c;
    char *at;

    for (size_t i = 0; i < count; i++)
        size += size_of(&values[i]);
    c = mem_calloc(1, size);
    if (!c)
        return NULL;
    c->what = what;
    c->count = count;
    at = (char *)&c->values[count];
    memcpy(at, sql, strlen(sql) + 1);
    at += strlen(sql) + 1;
    for (size_t i = 0; i < count; i++) {
        c->values[i] = values[i];
        if (!has_bytes(&values[i]))
            continue;
        memcpy(at, values[i].data, size_of(&values[i]));
        c->values[i].data = at;
        at += size_of(&values[i]);
    }
    return c;
}

static status add(struct noted_list *list, const char *sql, const struct sql_value *values, size_t count,
                  const char *what, uint64_t clock_job, int64_t clock_frame, struct error *err)
{
    struct noted_change *c = change_new(sql, values, count, what);

    NEED(c, err, "a change that is to be stored");
    c->clock_job = clock_job;
    c->clock_frame = clock_frame;
    noted_add(list, c, SIZE_MAX);
    return STATUS_OK;
}

status changes_add(struct noted_list *list, const char *sql, const struct sql_value *values, size_t count,
                   const char *what, struct error *err)
{
    return add(list, sql, values, count, what, 0, 0, err);
}

status changes_add_clock(struct noted_list *list, uint64_t job, int64_t frame, struct error *err)
{
    const struct sql_value values[] = {sql_number((int64_t)job), sql_number(frame)};

    return add(list,
               frame < 0 ? "UPDATE clocks SET from_active_ns=active_ns, from_cpu_ns=cpu_ns WHERE job=?1"
                         : "UPDATE clocks SET from_active_ns=active_ns, from_cpu_ns=cpu_ns WHERE job=?1 AND frame=?2",
               values, frame < 0 ? 1 : 2, "the job's frames cannot be stored", job, frame, err);
}

void changes_note(struct store *store, struct noted_list *list)
{
    pthread_mutex_lock(&store->lock);
    for (struct noted *c = list->first, *next; c; c = next) {
        next = c->next;
        noted_add(&store->changes, c, SIZE_MAX);
    }
    *list = (struct noted_list){0};
    pthread_cond_signal(&store->work);
    pthread_mutex_unlock(&store->lock);
}

status sql_note(struct store *store, const char *sql, const struct sql_value *values, size_t count, const char *what,
                struct error *err)
{
    struct noted_list list = {0};

    TRY(changes_add(&list, sql, values, count, what, err));
    changes_note(store, &list);
    return STATUS_OK;
}

status changes_write(struct store *store, struct error *err)
{
    for (const struct noted *n = store->changes.taken; n; n = n->next) {
        const struct noted_change *c = (const struct noted_change *)n;
        status s = sql_change_reserved(store, statement_of(c), c->values, c->count, c->what, err);
        if (s == STATUS_OK)
            continue;
        if ((sqlite3_errcode(store->db) & 0xff) != SQLITE_CONSTRAINT)
            return s;
        log_error("%s: the database does not take it, and it is left out", err->text); /* it would hold up all others */
    }
    return STATUS_OK;
}

status changes_await(struct store *store, struct error *err)
{
    status s = STATUS_OK;

    pthread_mutex_lock(&store->lock);
    while (store->has_writer && !store->failing && (store->changes.first || store->changes.taken))
        pthread_cond_wait(&store->idle, &store->lock);
    if (store->failing && (store->changes.first || store->changes.taken))
        s = error_set(err, store->save_error.code, "%s", store->save_error.text);
    pthread_mutex_unlock(&store->lock);
    return s;
}

static int list_has_clock(const struct noted *n, uint64_t job, uint32_t frame)
{
    for (; n; n = n->next) {
        const struct noted_change *c = (const struct noted_change *)n;
        if (c->clock_job == job && (c->clock_frame < 0 || c->clock_frame == (int64_t)frame))
            return 1;
    }
    return 0;
}

int changes_have_clock(struct store *store, uint64_t job, uint32_t frame)
{
    int there;

    pthread_mutex_lock(&store->lock);
    there = list_has_clock(store->changes.first, job, frame) || list_has_clock(store->changes.taken, job, frame);
    pthread_mutex_unlock(&store->lock);
    return there;
}
