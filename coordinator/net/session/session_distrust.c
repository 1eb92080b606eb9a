/* WorkerDistrust: what a worker rendered is rendered again (coordinator/steering/distrust.h). */
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "coordinator/net/base/held.h"
#include "coordinator/net/server.h"
#include "coordinator/net/base/session_table.h"
#include "coordinator/net/session/session_messages.h"
#include "protocol/message.h"

_Static_assert((int)DISTRUST_RELEASE == (int)AZULEJO__WIRE__DISTRUST_FATE__DISTRUST_RELEASE &&
                   (int)DISTRUST_NO_FILM == (int)AZULEJO__WIRE__DISTRUST_FATE__DISTRUST_NO_FILM,
               "as on the wire");

/* A list of frames as a message. */
struct answer {
    Azulejo__Wire__DistrustReport message;
    Azulejo__Wire__DistrustFrames *jobs, **job_pointers;
    uint32_t *frames;
};

static void answer_release(struct answer *a)
{
    mem_free(a->jobs);
    mem_free(a->job_pointers);
    mem_free(a->frames);
}

static Azulejo__Wire__DistrustFrames *group_of(struct answer *a, const struct distrust_frame *f, const struct job *job)
{
    Azulejo__Wire__DistrustFrames *group = a->message.n_jobs ? &a->jobs[a->message.n_jobs - 1] : NULL;

    if (group && group->job == f->job && (int)group->fate == (int)f->fate)
        return group;
    group = &a->jobs[a->message.n_jobs];
    azulejo__wire__distrust_frames__init(group);
    group->job = f->job;
    group->name = job ? (char *)(uintptr_t)job->name : (char *)(uintptr_t) "";
    group->fate = (Azulejo__Wire__DistrustFate)f->fate;
    a->job_pointers[a->message.n_jobs++] = group;
    return group;
}

/* By job and fate, each with ascending frames. */
static status fill(struct answer *a, const struct farm *farm, const struct distrust_report *report, struct error *err)
{
    size_t sent = 0;

    azulejo__wire__distrust_report__init(&a->message);
    a->jobs = mem_alloc_array(report->count, sizeof *a->jobs);
    a->job_pointers = mem_alloc_array(report->count, sizeof(Azulejo__Wire__DistrustFrames *));
    a->frames = mem_alloc_array(report->count, sizeof *a->frames);
    NEED(a->jobs && a->job_pointers && a->frames, err, "a worker's frames");
    for (size_t i = 0, end; i < report->count; i = end) {
        for (end = i; end < report->count && report->frames[end].job == report->frames[i].job; end++)
            *(report->frames[end].fate == DISTRUST_AGAIN ? &a->message.again : &a->message.left) += 1;
        for (int fate = DISTRUST_AGAIN; fate <= DISTRUST_RELEASE; fate++)
            for (size_t k = i; k < end && sent < DISTRUST_FRAMES_MAX; k++) {
                Azulejo__Wire__DistrustFrames *group;
                if ((int)report->frames[k].fate != fate)
                    continue;
                group = group_of(a, &report->frames[k], queue_find(&farm->queue, report->frames[k].job));
                if (!group->frames)
                    group->frames = a->frames + sent;
                group->frames[group->n_frames++] = report->frames[k].frame;
                sent++;
            }
    }
    a->message.jobs = a->job_pointers;
    return STATUS_OK;
}

/* On disk by now. */
static status answer_distrust(struct session *session, uint64_t request, const struct held_subject *subject,
                              uint64_t now_ns UNUSED, struct error *err)
{
    struct server *server = session->server;
    struct distrust_report *report = &server->reports[subject->number % DISTRUST_REPORTS_MAX];
    struct answer a = {0};
    Azulejo__Wire__Envelope envelope = MESSAGE(DISTRUST_REPORT, distrust_report, &a.message);
    status s;

    if (server->reports_made - subject->number >= DISTRUST_REPORTS_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "worker %s is blocked and not believed any more; its frames are listed when you "
                         "ask again: too many asked at once", subject->text);
    s = fill(&a, &server->farm, report, err);
    a.message.worker = (char *)(uintptr_t)subject->text;
    if (s == STATUS_OK)
        session_reply(session, request, &envelope);
    answer_release(&a);
    distrust_report_release(report);
    return s;
}

status session_worker_distrust(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns UNUSED,
                               struct error *err)
{
    const Azulejo__Wire__WorkerDistrust *wanted = message->worker_distrust;
    struct server *server = session->server;
    struct held_subject subject = {.is_plain = 1};
    struct distrust_report *report;
    status s;

    if (held_has_room(server, err) != STATUS_OK)
        return STATUS_ERR_LIMIT;
    if (wanted->since < 0)
        return error_set(err, STATUS_ERR_INPUT, "`since` is seconds since 1970 (UTC), not %lld", (long long)wanted->since);
    subject.number = ++server->reports_made;
    report = &server->reports[subject.number % DISTRUST_REPORTS_MAX];
    distrust_report_release(report);
    s = distrust_worker(&server->farm, wanted->name, wanted->since, session->who, report, err);
    snprintf(subject.text, sizeof subject.text, "%s", wanted->name);
    return s == STATUS_OK ? session_hold(session, message->request, answer_distrust, &subject, err) : s;
}
