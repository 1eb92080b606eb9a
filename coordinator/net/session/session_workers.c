/* Workers: what they tell about themselves, what clients ask about them, and do to them. */
#include <stdio.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/farm/roster.h"
#include "coordinator/net/base/held.h"
#include "coordinator/net/server.h"
#include "coordinator/net/base/session_table.h"
#include "coordinator/net/base/workers_list.h"
#include "protocol/message.h"
#include "protocol/worker_name.h"

_Static_assert((int)WORKER_MODE_PAUSED == (int)AZULEJO__WIRE__WORKER_MODE__MODE_PAUSED &&
                   (int)WORKER_MODE_LEAVING == (int)AZULEJO__WIRE__WORKER_MODE__MODE_LEAVING,
               "as on the wire");
_Static_assert((int)WORKER_VERB_UNBLOCK == (int)AZULEJO__WIRE__WORKER_VERB__WORKER_UNBLOCK &&
                   (int)WORKER_VERB_BLOCK == (int)AZULEJO__WIRE__WORKER_VERB__WORKER_BLOCK &&
                   (int)WORKER_VERB_RESUME == (int)AZULEJO__WIRE__WORKER_VERB__WORKER_RESUME,
               "as on the wire");

enum { LONG_UNITS_MAX = 16, GONE_OF_NAME_MAX = 20 };

/* ---- what a worker tells --------------------------------------------------------------------- */

/* Its mode changed: in the log, and in its own lines. */
static void take_mode(struct session *session, const Azulejo__Wire__WorkerStatus *report)
{
    struct farm *farm = &session->server->farm;
    struct farm_worker *worker = session->worker;
    enum worker_mode mode =
        report->mode <= AZULEJO__WIRE__WORKER_MODE__MODE_LEAVING ? (enum worker_mode)report->mode : WORKER_MODE_WORKING;
    int changed = mode != worker->mode;

    message_text(worker->mode_reason, sizeof worker->mode_reason, report->reason);
    worker->mode = mode;
    if (mode != WORKER_MODE_WORKING)
        worker->room = 0; /* it asks again */
    if (!changed)
        return;
    workforce_counts(farm, worker);
    log_info("worker %s %s%s%s", worker->label,
             mode == WORKER_MODE_WORKING ? "takes work"
                                         : mode == WORKER_MODE_PAUSED ? "is paused" : "ends",
             worker->mode_reason[0] ? ": " : "", worker->mode_reason);
    farm_wake(farm);
}

/* An owned copy of the status, by way of the wire's form; NULL: no memory. */
static Azulejo__Wire__Envelope *copy_status(const Azulejo__Wire__WorkerStatus *report)
{
    Azulejo__Wire__Envelope e = MESSAGE(WORKER_STATUS, worker_status, (Azulejo__Wire__WorkerStatus *)report);
    Azulejo__Wire__Envelope *copy = NULL;
    size_t size = azulejo__wire__envelope__get_packed_size(&e);
    uint8_t *bytes = mem_alloc(size);

    if (!bytes)
        return NULL;
    azulejo__wire__envelope__pack(&e, bytes);
    if (message_unpack(&copy, bytes, size, NULL) != STATUS_OK)
        copy = NULL;
    mem_free(bytes);
    return copy;
}

void session_worker_status(struct session *session, const Azulejo__Wire__WorkerStatus *report, uint64_t now_ns)
{
    struct farm *farm = &session->server->farm;
    int hangs = 0;

    take_mode(session, report);
    for (size_t i = 0; i < report->n_long_units && i < LONG_UNITS_MAX; i++) {
        const Azulejo__Wire__LongUnit *unit = report->long_units[i];
        const struct unit_name name = {unit->tile, unit->group, unit->pass};
        uint64_t ms = unit->running_ms < UINT64_MAX / NS_PER_MS ? unit->running_ms : 0;
        hangs |= farm_worker_renders_long(farm, session->worker, unit->job, unit->frame, name, ms * NS_PER_MS, now_ns);
    }
    if (!hangs)
        session->worker->hang_note[0] = 0;
    message_free(session->report);
    session->report = copy_status(report);
    session->told_ns = now_ns;
}

void session_worker_leaves(const struct session *session, const struct error *why, char *out, size_t size)
{
    const struct farm_worker *worker = session->worker;

    if (worker->is_replaced)
        snprintf(out, size, "it connected again");
    else if (worker->mode == WORKER_MODE_LEAVING && worker->mode_reason[0])
        snprintf(out, size, "it ended: %s", worker->mode_reason);
    else if (session->server->state != SERVER_LISTENING)
        snprintf(out, size, "the coordinator ended");
    else if (why->code != STATUS_OK)
        snprintf(out, size, "%s", why->text);
    else
        snprintf(out, size, "it closed the connection");
}

void session_worker_release(struct session *session)
{
    message_free(session->report);
    session->report = NULL;
}

/* ---- lists ----------------------------------------------------------------------------------- */

/* A list of workers and what it points to. */
struct worker_answer {
    Azulejo__Wire__WorkerList list;
    Azulejo__Wire__WorkerInfo *infos, **info_pointers;
    Azulejo__Wire__WorkerMark *marks, **mark_pointers;
    struct gone {
        struct worker_row row;
        Azulejo__Wire__WorkerGone message;
        Azulejo__Wire__WorkerLine lines[WORKER_LINES_MAX], *line_pointers[WORKER_LINES_MAX];
    } * *gone;
    size_t gone_capacity, gone_count;
    Azulejo__Wire__WorkerGone **gone_pointers;
    struct own_lines {
        Azulejo__Wire__WorkerLine lines[WORKER_LINES_MAX], *pointers[WORKER_LINES_MAX];
    } * own_lines; /* of each worker; NULL: they are not wanted */
    char (*notes)[640];
    const struct farm *farm;
};

static void answer_release(struct worker_answer *a)
{
    for (size_t i = 0; i < a->gone_count; i++)
        mem_free(a->gone[i]);
    mem_free(a->gone);
    mem_free(a->gone_pointers);
    mem_free(a->notes);
    mem_free(a->own_lines);
    mem_free(a->mark_pointers);
    mem_free(a->marks);
    mem_free(a->info_pointers);
    mem_free(a->infos);
}

static void fill_lines(Azulejo__Wire__WorkerLine *lines, Azulejo__Wire__WorkerLine **pointers, struct worker_line *from,
                       uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        azulejo__wire__worker_line__init(&lines[i]);
        lines[i].at = from[i].at;
        lines[i].text = from[i].text;
        pointers[i] = &lines[i];
    }
}

Azulejo__Wire__WorkerState session_worker_state(const struct farm_worker *worker)
{
    int busy = worker->held.units > 0;

    if (worker->hold == WORKER_BLOCKED)
        return AZULEJO__WIRE__WORKER_STATE__WORKER_STATE_BLOCKED;
    if (worker->mode == WORKER_MODE_LEAVING)
        return AZULEJO__WIRE__WORKER_STATE__WORKER_STATE_LEAVING;
    if (worker->hold == WORKER_DRAINED)
        return busy ? AZULEJO__WIRE__WORKER_STATE__WORKER_STATE_DRAINING
                    : AZULEJO__WIRE__WORKER_STATE__WORKER_STATE_DRAINED;
    if (worker->mode == WORKER_MODE_PAUSED)
        return AZULEJO__WIRE__WORKER_STATE__WORKER_STATE_PAUSED;
    return busy ? AZULEJO__WIRE__WORKER_STATE__WORKER_STATE_WORKING : AZULEJO__WIRE__WORKER_STATE__WORKER_STATE_IDLE;
}

/* Why it gets no work, or what is wrong with it. */
static void note_of(const struct farm_worker *worker, char *out, size_t size)
{
    worker_explain(worker, out, size);
    if (!out[0])
        snprintf(out, size, "%s", worker->note);
    if (worker->hang_note[0]) {
        size_t used = strlen(out);
        snprintf(out + used, size - used, "%s%s", used ? "; " : "", worker->hang_note);
    }
}

static void fill_worker(struct worker_answer *a, size_t at, struct session *s, uint64_t now_ns)
{
    Azulejo__Wire__WorkerInfo *info = &a->infos[at];
    struct farm_worker *worker = s->worker;
    char *note = a->notes[at];

    azulejo__wire__worker_info__init(info);
    note_of(worker, note, 640);
    info->session = s->id;
    info->host = s->host;
    info->process = s->process;
    info->address = s->peer;
    info->software = s->software;
    info->kernel = worker->ray_tracer;
    info->threads = worker->threads;
    info->isa_mask = worker->isa_mask;
    info->units_leased = worker->held.units;
    info->units_done = worker->units_done;
    info->samples_done = worker->samples_done;
    info->samples_per_second = rate_per_second(&worker->rate, now_ns);
    info->connected_s = (now_ns - s->begun_ns) / NS_PER_SECOND;
    info->note = note;
    info->name = worker->label;
    info->tags = worker->tags;
    info->memory = worker->memory;
    info->state = session_worker_state(worker);
    info->job = worker->held.units > 0 ? worker->held.job : 0;
    info->core_seconds = (double)worker->cpu_ns / 1e9;
    if (s->report) {
        info->status = s->report->worker_status;
        info->status_age_s = (double)(now_ns - s->told_ns) / 1e9;
    }
    if (!a->own_lines)
        return;
    fill_lines(a->own_lines[at].lines, a->own_lines[at].pointers, worker->lines, worker->line_count);
    info->lines = a->own_lines[at].pointers;
    info->n_lines = worker->line_count;
}

/* Is it one that was asked for? `job` 0 and `name` "" mean any, and a key's name, which no worker has, all of the key. */
static int is_wanted(const struct farm *farm, const struct farm_worker *worker, const char *name, uint64_t job)
{
    return worker && !worker->is_replaced &&
           (!name[0] || strcmp(name, worker->label) == 0 ||
            (worker_label_is_of(worker->label, name) && !roster_find(farm, name))) &&
           (job == 0 || (worker->held.units > 0 && worker->held.job == job));
}

static status take_workers(struct worker_answer *a, struct server *server, const char *name, uint64_t job,
                           uint64_t now_ns, struct error *err)
{
    size_t room = server->farm.worker_count;

    a->infos = mem_alloc_array(room, sizeof *a->infos);
    a->info_pointers = mem_alloc_array(room, sizeof(Azulejo__Wire__WorkerInfo *));
    a->notes = mem_alloc_array(room, sizeof *a->notes);
    a->own_lines = name[0] ? mem_alloc_array(room, sizeof *a->own_lines) : NULL;
    NEED(a->infos && a->info_pointers && a->notes && (!name[0] || a->own_lines), err, "a list of workers");
    for (struct session *s = server->sessions; s && a->list.n_workers < room; s = s->next) {
        size_t at = a->list.n_workers;
        if (!is_wanted(&server->farm, s->worker, name, job))
            continue;
        fill_worker(a, at, s, now_ns);
        a->info_pointers[at] = &a->infos[at];
        a->list.n_workers++;
    }
    a->list.workers = a->info_pointers;
    return STATUS_OK;
}

static status take_marks(struct worker_answer *a, struct farm *farm, const char *name, struct error *err)
{
    struct roster *roster = &farm->roster;

    a->marks = mem_alloc_array(roster->mark_count, sizeof *a->marks);
    a->mark_pointers = mem_alloc_array(roster->mark_count, sizeof(Azulejo__Wire__WorkerMark *));
    NEED(a->marks && a->mark_pointers, err, "a list of workers");
    for (size_t i = 0; i < roster->mark_count; i++) {
        struct worker_mark *mark = &roster->marks[i];
        Azulejo__Wire__WorkerMark *out = &a->marks[a->list.n_marks];
        if (name[0] && strcmp(name, mark->name) != 0 && !(mark->blocked && worker_label_is_of(name, mark->name)))
            continue;
        azulejo__wire__worker_mark__init(out);
        out->name = mark->name;
        out->blocked = mark->blocked;
        out->who = mark->who;
        out->at = mark->at;
        a->mark_pointers[a->list.n_marks++] = out;
    }
    a->list.marks = a->mark_pointers;
    return STATUS_OK;
}

static status take_gone(void *user, const struct worker_row *row, struct error *err)
{
    struct worker_answer *a = user;
    const struct farm_worker *connected = roster_find(a->farm, row->name);
    struct gone *gone;
    Azulejo__Wire__WorkerGone *m;

    if (connected && connected->instance == row->instance)
        return STATUS_OK; /* it has connected again, and its row will say so soon */
    if (a->own_lines && a->gone_count == GONE_OF_NAME_MAX)
        return STATUS_OK;
    if (!MEM_GROW(a->gone, a->gone_capacity, a->gone_count + 1) || !(gone = mem_calloc(1, sizeof *gone)))
        return error_no_memory(err, "a list of workers");
    a->gone[a->gone_count++] = gone;
    gone->row = *row;
    m = &gone->message;
    azulejo__wire__worker_gone__init(m);
    m->name = gone->row.name;
    m->host = gone->row.host;
    m->process = row->process;
    m->address = gone->row.address;
    m->software = gone->row.software;
    m->threads = row->threads;
    m->joined_at = row->joined_at;
    m->left_at = row->left_at;
    m->connections = row->connections;
    m->units_done = row->units;
    m->samples_done = row->samples;
    m->core_seconds = (double)row->cpu_ns / 1e9;
    m->why = gone->row.why;
    if (a->own_lines) {
        fill_lines(gone->lines, gone->line_pointers, gone->row.lines, row->line_count);
        m->lines = gone->line_pointers;
        m->n_lines = row->line_count;
    }
    return STATUS_OK;
}

static status point_at_gone(struct worker_answer *a, struct error *err)
{
    a->gone_pointers = mem_alloc_array(a->gone_count, sizeof(Azulejo__Wire__WorkerGone *));
    NEED(a->gone_pointers, err, "a list of workers");
    for (size_t i = 0; i < a->gone_count; i++)
        a->gone_pointers[i] = &a->gone[i]->message;
    a->list.gone = a->gone_pointers;
    a->list.n_gone = a->gone_count;
    return STATUS_OK;
}

status workers_list(struct server *server, const char *name, uint64_t job, int with_gone, workers_use *use, void *user,
                    uint64_t now_ns, struct error *err)
{
    struct worker_answer *a = mem_calloc(1, sizeof *a);
    status s;

    NEED(a, err, "a list of workers");
    azulejo__wire__worker_list__init(&a->list);
    a->farm = &server->farm;
    s = take_workers(a, server, name, job, now_ns, err);
    THEN(s, take_marks(a, &server->farm, name, err));
    if (s == STATUS_OK && with_gone)
        s = store_workers_gone(server->store, name, take_gone, a, err);
    THEN(s, point_at_gone(a, err));
    if (s == STATUS_OK)
        use(user, &a->list);
    answer_release(a);
    mem_free(a);
    return s;
}

/* A request of a session. */
struct asked {
    struct session *session;
    uint64_t request;
};

static void send_workers(void *user, Azulejo__Wire__WorkerList *list)
{
    const struct asked *asked = user;
    Azulejo__Wire__Envelope envelope = MESSAGE(WORKER_LIST, worker_list, list);

    session_reply(asked->session, asked->request, &envelope);
}

static status answer(struct session *session, uint64_t request, const char *name, uint64_t job, int with_gone,
                     uint64_t now_ns, struct error *err)
{
    struct asked asked = {session, request};

    return workers_list(session->server, name, job, with_gone, send_workers, &asked, now_ns, err);
}

/* Those that have just left are in the store by then. */
static status answer_gone(struct session *session, uint64_t request, const struct held_subject *subject,
                          uint64_t now_ns, struct error *err)
{
    return answer(session, request, subject->text, subject->number, 1, now_ns, err);
}

status session_workers(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns,
                       struct error *err)
{
    const Azulejo__Wire__WorkerQuery *query = message->worker_query;
    struct held_subject subject = {.number = query->job};

    /* No worker has such a name, or the one that has it is here. */
    if (!query->gone || strlen(query->name) > WORKER_LABEL_MAX || roster_find(&session->server->farm, query->name))
        return answer(session, message->request, query->name, query->job, query->gone, now_ns, err);
    if (held_has_room(session->server, err) != STATUS_OK)
        return STATUS_ERR_LIMIT;
    snprintf(subject.text, sizeof subject.text, "%s", query->name);
    return session_hold(session, message->request, answer_gone, &subject, err);
}

static status answer_steered(struct session *session, uint64_t request, const struct held_subject *subject,
                             uint64_t now_ns, struct error *err)
{
    return answer(session, request, subject->text, 0, 0, now_ns, err);
}

status session_worker_steer(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns UNUSED,
                            struct error *err)
{
    const Azulejo__Wire__WorkerSteer *wanted = message->worker_steer;
    struct held_subject subject = {.is_plain = 1};
    status s;

    if (wanted->verb > AZULEJO__WIRE__WORKER_VERB__WORKER_UNBLOCK)
        return error_set(err, STATUS_ERR_PROTOCOL, "a verb for a worker that there is not");
    s = roster_steer(&session->server->farm, wanted->name, (enum worker_verb)wanted->verb, session->who, err);
    snprintf(subject.text, sizeof subject.text, "%s", wanted->name);
    return s == STATUS_OK ? session_hold(session, message->request, answer_steered, &subject, err) : s;
}
