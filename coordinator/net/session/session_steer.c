/* What clients do to jobs, and the jobs' logs. */
#include <string.h>

#include "common/base/memory.h"
#include "coordinator/steering/steer.h"
#include "coordinator/net/base/held.h"
#include "coordinator/net/server.h"
#include "coordinator/net/session/session_messages.h"
#include "protocol/fields.h"
#include "protocol/message.h"

/* What the farm cannot check by itself. */
static status check(struct session *session, const Azulejo__Wire__Envelope *message, struct error *err)
{
    struct output_settings output;
    status s;

    if (message->body_case != AZULEJO__WIRE__ENVELOPE__BODY_JOB_DEVELOP)
        return STATUS_OK;
    s = wire_output_get(&output, message->job_develop->output, err);
    return s == STATUS_OK ? session_check_tonemap(session, &output, err) : s;
}

status session_steer(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns,
                     struct error *err)
{
    struct job *job = session_job(session, message_job(message_body(message)), err);
    const struct steering what = {&session->server->farm, job, message, session->who, now_ns};
    status s = job ? check(session, message, err) : STATUS_ERR_NOT_FOUND;

    THEN(s, steer(&what, err));
    return session_answer_change(session, message->request, job, s, err);
}

static status answer_removed(struct session *session, uint64_t request, const struct held_subject *subject,
                             uint64_t now_ns UNUSED, struct error *err UNUSED)
{
    Azulejo__Wire__JobInfo info = AZULEJO__WIRE__JOB_INFO__INIT, *infos[] = {&info};
    Azulejo__Wire__JobList list = AZULEJO__WIRE__JOB_LIST__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(JOB_LIST, job_list, &list);

    info.job = subject->number;
    info.name = (char *)subject->text;
    info.state = (Azulejo__Wire__JobState)subject->state;
    list.n_jobs = 1;
    list.jobs = infos;
    session_reply(session, request, &envelope);
    return STATUS_OK;
}

status session_remove(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns,
                      struct error *err)
{
    struct job *job = session_job(session, message->job_remove->job, err);
    const struct steering what = {&session->server->farm, job, message, session->who, now_ns};
    struct held_subject subject = {.is_plain = 1};

    if (!job)
        return STATUS_ERR_NOT_FOUND;
    memcpy(subject.text, job->name, sizeof subject.text); /* the job may be freed */
    subject.number = job->id;
    subject.state = (int)job->state;
    if (message->job_remove->unless_read && collector_is_read(session->server, job->id))
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %llu stays: somebody fetches its pictures just now ('remove' does not wait for that)",
                         (unsigned long long)job->id);
    TRY(steer(&what, err));
    collector_wake(session->server);
    return session_hold(session, message->request, answer_removed, &subject, err);
}

/* ---- the log --------------------------------------------------------------------------------- */

struct log_answer {
    struct job_event *events;
    size_t count, capacity;
};

static status take_event(void *user, const struct job_event *event, struct error *err)
{
    struct log_answer *a = user;

    NEED(MEM_GROW(a->events, a->capacity, a->count + 1), err, "a job's log");
    a->events[a->count++] = *event;
    return STATUS_OK;
}

/* `job` NULL: of all jobs. */
static status send_log(struct session *session, uint64_t request, const struct job *job, const struct log_answer *a,
                       int more, struct error *err)
{
    Azulejo__Wire__JobEvent *lines = mem_alloc_array(a->count, sizeof *lines);
    Azulejo__Wire__JobEvent **pointers = mem_alloc_array(a->count, sizeof(Azulejo__Wire__JobEvent *));
    Azulejo__Wire__JobLog log = AZULEJO__WIRE__JOB_LOG__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(JOB_LOG, job_log, &log);
    status s = lines && pointers ? STATUS_OK : error_no_memory(err, "a job's log");

    for (size_t i = 0; s == STATUS_OK && i < a->count; i++) {
        azulejo__wire__job_event__init(&lines[i]);
        lines[i].seq = a->events[i].seq;
        lines[i].job = a->events[i].job;
        lines[i].at = a->events[i].at;
        lines[i].from_worker = a->events[i].from_worker;
        lines[i].who = a->events[i].who;
        lines[i].text = a->events[i].text;
        pointers[i] = &lines[i];
    }
    if (s == STATUS_OK) {
        log.job = job ? job->id : 0;
        log.state = job ? (Azulejo__Wire__JobState)job->state : AZULEJO__WIRE__JOB_STATE__JOB_QUEUED;
        log.more = more;
        log.n_events = a->count;
        log.events = pointers;
        session_reply(session, request, &envelope);
    }
    mem_free(pointers);
    mem_free(lines);
    return s;
}

/* The logs of all jobs together. */
static status answer_all(struct session *session, uint64_t request, const Azulejo__Wire__JobLogGet *wanted,
                         struct log_answer *answer, struct error *err)
{
    uint32_t limit = wanted->newest > 0 ? wanted->newest : FARM_EVENTS_MAX;
    status s;

    if (limit > FARM_EVENTS_MAX)
        return error_set(err, STATUS_ERR_INPUT, "the newest %u events: at most %d are sent at a time", limit,
                         FARM_EVENTS_MAX);
    s = store_events_load_all(session->server->store, wanted->after, wanted->newest > 0, limit, take_event, answer,
                              err);
    return s == STATUS_OK ? send_log(session, request, NULL, answer, wanted->newest == 0 && answer->count == limit, err)
                          : s;
}

status session_log(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns UNUSED, struct error *err)
{
    const Azulejo__Wire__JobLogGet *wanted = message->job_log_get;
    const struct job *job = wanted->job ? session_job(session, wanted->job, err) : NULL;
    struct log_answer answer = {0};
    status s;

    if (wanted->job && !job)
        return STATUS_ERR_NOT_FOUND;
    if (wanted->job && wanted->newest)
        return error_set(err, STATUS_ERR_INPUT, "newest: is for the log of all jobs");
    if (!job) {
        s = answer_all(session, message->request, wanted, &answer, err);
    } else {
        s = store_events_load(session->server->store, job->id, wanted->after, take_event, &answer, err);
        THEN(s, send_log(session, message->request, job, &answer, 0, err));
    }
    mem_free(answer.events);
    return s;
}
