/* Keys of names: noted when they are used, listed, revoked and rotated.
 *
 * A change is in effect before it is answered, and on disk when it is: if it cannot be written, the answer says so, and it
 * holds until the coordinator ends. */
#include "coordinator/net/session/session_keys.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/system/clock.h"
#include "common/system/log.h"
#include "coordinator/net/base/session_table.h"
#include "coordinator/net/base/task.h"
#include "coordinator/net/server.h"
#include "protocol/message.h"

/* ---- connections ------------------------------------------------------------------------------- */

/* End those whose key is not good any more, but not the one that asked for it. */
static void end_refused(struct server *server, const struct session *asks)
{
    int64_t now_s = clock_wall_s();

    for (struct session *s = server->sessions, *next; s; s = next) {
        struct error why = {0};
        next = s->next;
        if (s == asks || s->state == SESSION_ENDING ||
            keyring_check(&server->keyring, channel_identity(s->channel), now_s, &why) == STATUS_OK)
            continue;
        log_info("session %u (%s %s) ends: %s", s->id, s->host, s->peer, why.text);
        session_refuse_key(s, &why);
    }
}

void session_keys_tick(struct server *server)
{
    int64_t now_s = clock_wall_s(), from_s = server->keys_checked_s;

    if (now_s == from_s)
        return;
    server->keys_checked_s = now_s;
    if (keyring_ends(&server->keyring, from_s, now_s))
        end_refused(server, NULL);
}

/* ---- what is written ---------------------------------------------------------------------------- */

struct key_task {
    struct task task;
    struct key_row row;
    uint32_t session; /* that asked for the change; 0: none */
    uint64_t request;
};

static status send_keys(struct session *session, uint64_t request, const char *name, struct error *err);

static void key_run(struct task *task)
{
    const struct key_task *k = (struct key_task *)task;

    task->result = store_key_put(task->server->store, &k->row, &task->error);
}

static void key_end(struct task *task)
{
    const struct key_task *k = (struct key_task *)task;
    struct session *session = k->session ? session_find(task->server, k->session) : NULL;
    struct error err = task->error;
    status s = task->result;

    if (s != STATUS_OK)
        error_prefix(&err, "the keys of %s have changed until the coordinator ends, but", k->row.name);
    if (session && s == STATUS_OK)
        s = send_keys(session, k->request, k->row.name, &err);
    if (session && s != STATUS_OK)
        session_fail(session, k->request, &err);
    if (k->session)
        end_refused(task->server, NULL);
    else if (s != STATUS_OK)
        log_debug("%s", err.text); /* the next use is stored */
}

static const struct task_kind key_kind = {"the keys of a name", sizeof(struct key_task), key_run, key_end, NULL, 1};

void session_key_refused(struct session *session, const struct error *why)
{
    const struct key_identity *id = channel_identity(session->channel);
    char subject[LOG_LIMIT_SUBJECT_SIZE];
    uint64_t left_out;

    snprintf(subject, sizeof subject, "%s", id->name[0] ? id->name : key_identity_role(id));
    if (log_limit_pass(&session->server->refused_keys, subject, clock_monotonic_ns(), &left_out))
        log_warn("session %u (%s) was refused: %s%s", session->id, session->peer, why->text,
                 left_out > 0 ? " (it tries again and again)" : "");
    session_refuse_key(session, why);
}

status session_key_greet(struct session *session, struct error *err)
{
    struct server *server = session->server;
    const struct key_identity *id = channel_identity(session->channel);
    const struct key_row *used;
    struct key_task *task;

    TRY(keyring_check(&server->keyring, id, clock_wall_s(), err));
    used = keyring_used(&server->keyring, id, clock_wall_s());
    task = used ? task_new(server, &key_kind, NULL) : NULL;
    if (task) {
        task->row = *used;
        task_start(&task->task);
    }
    return STATUS_OK;
}

/* ---- lists ---------------------------------------------------------------------------------------- */

static uint32_t connections_of(const struct server *server, const char *name)
{
    uint32_t count = 0;

    for (const struct session *s = server->sessions; s; s = s->next)
        count += s->state != SESSION_ENDING && strcmp(channel_identity(s->channel)->name, name) == 0;
    return count;
}

enum { ROLES_SIZE = 64 };

/* "worker submit" */
static void put_roles(const struct key_row *row, char out[ROLES_SIZE])
{
    out[0] = 0;
    for (unsigned bit = 0; bit < WEB_ROLES; bit++)
        if (row->roles & 1u << bit)
            snprintf(out + strlen(out), ROLES_SIZE - strlen(out), "%s%s", out[0] ? " " : "",
                     bit ? web_role_name((enum web_role)bit) : farm_role_name(FARM_ROLE_WORKER));
}

static int by_name(const void *a, const void *b)
{
    const Azulejo__Wire__KeyInfo *const *x = a, *const *y = b;

    return strcmp((*x)->name, (*y)->name);
}

struct listed_key {
    Azulejo__Wire__KeyInfo info;
    char roles[ROLES_SIZE];
};

/* Points at the row. */
static void fill_info(const struct server *server, struct listed_key *k, const struct key_row *row)
{
    Azulejo__Wire__KeyInfo *info = &k->info;

    azulejo__wire__key_info__init(info);
    put_roles(row, k->roles);
    info->name = (char *)row->name;
    info->generation = row->generation;
    info->oldest = row->oldest_until > clock_wall_s() ? row->oldest : row->generation;
    info->oldest_until = info->oldest < row->generation ? row->oldest_until : 0;
    info->roles = k->roles;
    info->used_at = row->used_at;
    info->changed_at = row->changed_at;
    info->changed_by = (char *)row->changed_by;
    info->revoked = row->revoked;
    info->connections = connections_of(server, row->name);
}

/* Those of a name, or all: NULL. */
static status send_keys(struct session *session, uint64_t request, const char *name, struct error *err)
{
    const struct keyring *ring = &session->server->keyring;
    struct listed_key *keys = mem_alloc_array(ring->count, sizeof *keys);
    Azulejo__Wire__KeyInfo **pointers = mem_alloc_array(ring->count, sizeof(Azulejo__Wire__KeyInfo *));
    Azulejo__Wire__KeyList list = AZULEJO__WIRE__KEY_LIST__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(KEY_LIST, key_list, &list);
    status s = ring->count == 0 || (keys && pointers) ? STATUS_OK : error_no_memory(err, "a list of keys");

    for (size_t i = 0; s == STATUS_OK && i < ring->count; i++) {
        if (name && strcmp(ring->rows[i].name, name) != 0)
            continue;
        fill_info(session->server, &keys[list.n_keys], &ring->rows[i]);
        pointers[list.n_keys] = &keys[list.n_keys].info;
        list.n_keys++;
    }
    if (s == STATUS_OK) {
        if (list.n_keys > 1)
            qsort(pointers, list.n_keys, sizeof(Azulejo__Wire__KeyInfo *), by_name);
        list.keys = pointers;
        list.shared = !ring->no_shared;
        list.damaged = ring->damaged > 0;
        session_reply(session, request, &envelope);
    }
    mem_free(pointers);
    mem_free(keys);
    return s;
}

status session_key_query(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns UNUSED,
                         struct error *err)
{
    return send_keys(session, message->request, NULL, err);
}

status session_key_change(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns UNUSED,
                          struct error *err)
{
    const Azulejo__Wire__KeyChange *wanted = message->key_change;
    struct server *server = session->server;
    struct key_task *task = task_new(server, &key_kind, err);
    status s;

    if (!task)
        return STATUS_ERR_NO_MEMORY;
    s = wanted->rotate ? keyring_rotate(&server->keyring, wanted->name, wanted->keep_s, session->who, clock_wall_s(),
                                        &task->row, err)
                       : keyring_revoke(&server->keyring, wanted->name, session->who, clock_wall_s(), &task->row, err);
    if (s != STATUS_OK) {
        task_drop(&task->task);
        return s;
    }
    task->session = session->id;
    task->request = message->request;
    task_start(&task->task);
    end_refused(server, session);
    return STATUS_OK;
}
