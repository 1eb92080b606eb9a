#include "coordinator/net/base/unit_audits.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <sys/random.h>

#include "common/system/clock.h"
#include "common/base/digest.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/farm/roster.h"
#include "coordinator/net/server.h"
#include "coordinator/net/base/session_table.h"
#include "coordinator/steering/distrust.h"
#include "protocol/message.h"
#include "protocol/worker_name.h"

struct unit_audit {
    struct unit_audit *next;
    uint64_t job, epoch_floor;
    uint32_t frame;
    struct unit_name unit;
    uint64_t number;  /* of the RenderRequest; 0: it waits */
    uint32_t session; /* that was asked */
    uint64_t asked_ns;
    int builds; /* that worker has to build the scene first */
    uint64_t begun_ns;
    uint32_t stored; /* votes of it that are in the store */
    uint32_t votes;  /* the first is of the worker that delivered it */
    struct audit_vote vote[AUDIT_VOTES_MAX];
};

static unsigned long long id_of(const struct unit_audit *a) { return (unsigned long long)a->job; }

/* ---- which results --------------------------------------------------------------------------- */

static int has_secret(struct unit_audits *audits)
{
    while (audits->secret == 0)
        if (getrandom(&audits->secret, sizeof audits->secret, 0) != sizeof audits->secret)
            return 0;
    return 1;
}

static status vote_of(struct audit_vote *vote, const struct session *session, const struct delivery *r, struct error *err)
{
    snprintf(vote->label, sizeof vote->label, "%s", session->worker->label);
    vote->hash = unit_hash(&r->unit);
    vote->has_digest = 1;
    return wire_unit_digest(&vote->digest, &r->unit, err);
}

/* NULL: too many, no memory, or the job is gone. */
static struct unit_audit *audit_new(struct session *session, const struct delivery *r)
{
    struct unit_audits *audits = &session->server->audits;
    const struct job *job = queue_find(&session->server->farm.queue, r->job);
    struct unit_audit *a = job && audits->count < AUDITS_MAX ? mem_calloc(1, sizeof *a) : NULL;

    if (!a)
        return NULL;
    a->job = r->job;
    a->epoch_floor = job->epoch_floor;
    a->frame = r->frame;
    a->unit = r->unit.name;
    return a;
}

static void audit_add(struct unit_audits *audits, struct unit_audit *a)
{
    a->begun_ns = clock_monotonic_ns();
    if (!audits->first)
        audits->end = &audits->first;
    *audits->end = a;
    audits->end = &a->next;
    audits->count++;
}

void unit_audits_result(struct session *session, const struct delivery *r, uint64_t units_before)
{
    struct unit_audits *audits = &session->server->audits;
    struct unit_audit *a;
    struct error err = {0};

    if (audits->off || !has_secret(audits) ||
        !audit_is_chosen(audits->secret, units_before, session->worker->is_doubted, r->job, r->frame, r->unit.name))
        return;
    a = audit_new(session, r);
    if (!a || vote_of(&a->vote[0], session, r, &err) != STATUS_OK) {
        mem_free(a);
        return;
    }
    a->votes = 1;
    audit_add(audits, a);
}

/* ---- in the store --------------------------------------------------------------------------- */

static struct unit_vote row_of(const struct unit_audit *a, uint32_t place)
{
    struct unit_vote row = {.job = a->job, .epoch_floor = a->epoch_floor, .frame = a->frame, .place = place, .tile = a->unit.tile,
                            .group = a->unit.group, .pass = a->unit.pass, .hash = a->vote[place].hash, .digest = a->vote[place].digest,
                            .has_digest = a->vote[place].has_digest};

    memcpy(row.label, a->vote[place].label, sizeof row.label);
    return row;
}

static void keep(struct server *server, struct unit_audit *a)
{
    struct error err = {0};

    for (; server->store && a->stored < a->votes; a->stored++) {
        const struct unit_vote row = row_of(a, a->stored);
        if (store_vote_add(server->store, &row, &err) != STATUS_OK)
            return; /* the next tick tries it again */
    }
}

struct loading {
    struct unit_audits *audits;
    struct unit_audit *last;
};

static status take_vote(void *user, const struct unit_vote *row, struct error *err)
{
    struct loading *loading = user;
    struct unit_audit *a = loading->last;
    struct audit_vote *vote;

    if (!a || a->job != row->job || a->frame != row->frame || a->unit.tile != row->tile ||
        a->unit.group != row->group || a->unit.pass != row->pass) {
        a = mem_calloc(1, sizeof *a);
        NEED(a, err, "what is to be rendered again");
        a->job = row->job;
        a->epoch_floor = row->epoch_floor;
        a->frame = row->frame;
        a->unit = (struct unit_name){row->tile, row->group, row->pass};
        audit_add(loading->audits, a);
        loading->last = a;
    }
    if (a->votes == AUDIT_VOTES_MAX)
        return STATUS_OK;
    vote = &a->vote[a->votes++];
    a->stored = a->votes;
    memcpy(vote->label, row->label, sizeof vote->label);
    vote->hash = row->hash;
    vote->digest = row->digest;
    vote->has_digest = row->has_digest;
    return STATUS_OK;
}

status unit_audits_load(struct server *server, struct error *err)
{
    struct loading loading = {&server->audits, NULL};

    return server->audits.off || !server->store ? STATUS_OK : store_votes_load(server->store, take_vote, &loading, err);
}

void unit_audits_keep(struct server *server)
{
    for (struct unit_audit *a = server->audits.first; a; a = a->next)
        keep(server, a);
}

/* ---- asking ---------------------------------------------------------------------------------- */

static void audit_drop(struct server *server, struct unit_audit *a)
{
    struct unit_audits *audits = &server->audits;
    struct unit_audit **at = &audits->first;
    const struct unit_vote row = row_of(a, 0);
    struct error err = {0};

    if (a->stored && store_votes_remove(server->store, &row, &err) != STATUS_OK)
        log_debug("%s", err.text); /* it is decided once more after a restart */
    while (*at != a)
        at = &(*at)->next;
    *at = a->next;
    if (!a->next)
        audits->end = at;
    audits->count--;
    mem_free(a);
}

static int has_voted(const struct unit_audit *a, const char *label)
{
    for (uint32_t i = 0; i < a->votes; i++)
        if (strcmp(a->vote[i].label, label) == 0)
            return 1;
    return 0;
}

static int key_has_voted(const struct unit_audit *a, const char *label)
{
    for (uint32_t i = 0; i < a->votes; i++)
        if (worker_labels_share_key(a->vote[i].label, label))
            return 1;
    return 0;
}

/* It waits, again or for ever more. Who was asked is charged what it says that it took, and no more than passed; all that passed
 * if it built the scene. */
static void end_asking(struct server *server, struct unit_audit *a, uint64_t said_ns, uint64_t now_ns)
{
    struct session *s = session_find(server, a->session);
    uint64_t passed_ns = now_ns - a->asked_ns;

    a->number = 0;
    if (!s || !s->worker)
        return;
    s->worker->is_auditing = 0;
    s->worker->audit_ns += a->builds || said_ns > passed_ns ? passed_ns : said_ns;
}

/* May it be asked, now or later? */
static int may_vote(const struct session *s, const struct job *job, const struct unit_audit *a)
{
    char why[256];

    return s->worker && s->state == SESSION_OPEN && worker_takes_work(s->worker) && !has_voted(a, s->worker->label) &&
           s->id != a->session && farm_can_serve(job, s->worker, why, sizeof why);
}

/* Its own share: what others claim that their results took changes nothing. */
static int has_time(const struct farm_worker *worker)
{
    return (double)worker->audit_ns <= AUDIT_CPU * (double)worker->cpu_ns + AUDIT_FREE_S * 1e9;
}

/* Of those that may render it, were asked nothing and have time for it: by lot, also among those who lack the scene. Two that
 * have a job alone would judge each other. A worker of a key that has answered is asked where no other is free, and not at all
 * where answers of several keys differ: it would add no voice. */
static struct session *choose(struct server *server, const struct job *job, const struct unit_audit *a)
{
    struct unit_audits *audits = &server->audits;
    struct session *chosen[2] = {NULL, NULL}; /* of a key that has answered; of another one */
    uint32_t seen[2] = {0, 0};
    int others = 0, is_doubted = a->votes > 1;

    for (struct session *s = server->sessions; s; s = s->next) {
        int other, is_free;
        if (!may_vote(s, job, a))
            continue;
        other = !key_has_voted(a, s->worker->label);
        is_free = !s->worker->is_auditing && has_time(s->worker);
        others |= other;
        if (is_free && audit_mix(audits->secret ^ ++audits->lots) % ++seen[other] == 0)
            chosen[other] = s;
    }
    if (chosen[1] || (is_doubted && (others || !audit_votes_share_key(a->vote, a->votes))))
        return chosen[1];
    return chosen[0];
}

/* The keys that could still be asked, AUDIT_VOTES_MAX at most; of a farm whose workers share one, these. */
static uint32_t count_others(struct server *server, const struct job *job, const struct unit_audit *a)
{
    uint32_t keys = 0, same = 0;

    for (struct session *s = server->sessions; s && keys < AUDIT_VOTES_MAX; s = s->next) {
        const struct session *earlier = server->sessions;
        if (!may_vote(s, job, a))
            continue;
        if (key_has_voted(a, s->worker->label)) {
            same++;
            continue;
        }
        while (earlier != s && !(earlier->worker && worker_labels_share_key(earlier->worker->label, s->worker->label) &&
                                 may_vote(earlier, job, a)))
            earlier = earlier->next;
        keys += earlier == s;
    }
    return keys > 0 || !audit_votes_share_key(a->vote, a->votes) ? keys : same;
}

/* 0: not now. */
static int ask(struct server *server, struct unit_audit *a, const struct job *job, uint64_t now_ns)
{
    Azulejo__Wire__RenderRequest request = AZULEJO__WIRE__RENDER_REQUEST__INIT;
    Azulejo__Wire__RenderSettings settings = AZULEJO__WIRE__RENDER_SETTINGS__INIT;
    Azulejo__Wire__WorkUnit unit = AZULEJO__WIRE__WORK_UNIT__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(RENDER_REQUEST, render_request, &request);
    struct session *worker = choose(server, job, a);

    if (!worker)
        return 0;
    unit.tile = a->unit.tile;
    unit.group = a->unit.group;
    unit.pass = a->unit.pass;
    wire_settings_set(&settings, &job->settings);
    wire_digest_set(&request.scene, &job->scene);
    request.job = a->job;
    request.frame = a->frame;
    request.settings = &settings;
    request.unit = &unit;
    e.request = a->number = ++server->requests.last;
    a->session = worker->id;
    worker->worker->is_auditing = 1;
    a->asked_ns = now_ns;
    a->builds = !scenes_were_shown(worker->scenes, &job->scene);
    scenes_show(&worker->scenes, &job->scene);
    if (channel_send(worker->channel, &e) != STATUS_OK)
        log_debug("session %u: an audit was not sent", worker->id);
    return 1;
}

/* ---- the decision ---------------------------------------------------------------------------- */

static struct farm_worker *find_worker(struct server *server, const char *label)
{
    for (struct session *s = server->sessions; s; s = s->next)
        if (s->worker && strcmp(s->worker->label, label) == 0)
            return s->worker;
    return NULL;
}

static void condemn(struct server *server, const struct unit_audit *a, const char *label)
{
    struct farm *farm = &server->farm;
    const struct job *job = queue_find(&farm->queue, a->job);
    struct distrust_report report = {0};
    char name[WORKER_LABEL_MAX + 1];
    struct error err = {0};
    size_t again = 0;
    status s;

    roster_culprit(farm, label, name);
    s = distrust_worker(farm, name, 0, "the coordinator: an audit", &report, &err);

    for (size_t i = 0; i < report.count; i++)
        again += report.frames[i].fate == DISTRUST_AGAIN;
    if (s == STATUS_OK)
        log_error("worker %s is blocked: job %llu, frame %u, tile %u, group %u, pass %u has other bits on two other workers; of the "
                  "%zu frames that it took part in %zu are rendered again ('azulejo distrust %s' lists the others); check its "
                  "machine's memory and processor, then 'azulejo workers unblock %s'", label, id_of(a), a->frame, a->unit.tile,
                  a->unit.group, a->unit.pass, report.count, again, name, name);
    else
        log_error("worker %s gave wrong results, but cannot be distrusted: %s; do it: 'azulejo distrust %s'", label,
                  err.text, name);
    if (job)
        farm_note(farm, job, NULL, "worker %s is blocked: two others give frame %u, tile %u other bits; its frames are "
                  "rendered again", label, a->frame, a->unit.tile);
    distrust_report_release(&report);
}

static void doubt(struct server *server, const struct unit_audit *a)
{
    char names[AUDIT_VOTES_MAX * (WORKER_LABEL_MAX + 2)] = "";

    for (uint32_t i = 0; i < a->votes; i++) {
        struct farm_worker *worker = find_worker(server, a->vote[i].label);
        size_t used = strlen(names);
        if (worker)
            worker->is_doubted = 1;
        snprintf(names + used, sizeof names - used, "%s%s", i ? ", " : "", a->vote[i].label);
    }
    log_error("job %llu, frame %u, tile %u, group %u, pass %u: workers %s give other bits; %s", id_of(a), a->frame,
              a->unit.tile, a->unit.group, a->unit.pass, names,
              a->votes < AUDIT_VOTES_MAX ? "another worker decides" : "no answer has a majority");
}

/* 1: it is over. */
static int decide(struct server *server, const struct unit_audit *a)
{
    const struct job *job = queue_find(&server->farm.queue, a->job);
    struct job_frame *frame = job ? farm_frame_find(job, a->frame) : NULL;
    uint32_t right = 0;
    enum audit_verdict verdict = audit_judge(a->vote, a->votes, job ? count_others(server, job, a) : 0, &right);

    if (verdict == AUDIT_MORE || verdict == AUDIT_OPEN)
        doubt(server, a);
    if (verdict == AUDIT_AGREES && frame)
        frame->audited++;
    for (uint32_t i = 0; i < a->votes && verdict == AUDIT_DECIDED; i++) {
        struct farm_worker *worker = find_worker(server, a->vote[i].label);
        if (!audit_votes_agree(&a->vote[i], &a->vote[right]))
            condemn(server, a, a->vote[i].label);
        else if (worker)
            worker->is_doubted = 0;
    }
    return verdict != AUDIT_MORE;
}

void unit_audits_conflict(struct session *session, const struct delivery *r, const struct audit_vote *first)
{
    struct server *server = session->server;
    struct unit_audit *a = server->audits.off || !has_secret(&server->audits) ? NULL : audit_new(session, r);
    struct error err = {0};

    if (!a || strcmp(first->label, session->worker->label) == 0 || vote_of(&a->vote[1], session, r, &err) != STATUS_OK) {
        mem_free(a);
        return;
    }
    a->vote[0] = *first;
    a->votes = 2;
    audit_add(&server->audits, a);
    doubt(server, a);
}

int unit_audits_answer(struct session *worker, const Azulejo__Wire__Envelope *message)
{
    struct server *server = worker->server;
    struct unit_audits *audits = &server->audits;
    struct unit_audit *a = audits->first;
    const Azulejo__Wire__RenderResult *result;
    struct audit_vote *vote;
    struct error err = {0};

    while (a && (a->number != message->request || a->session != worker->id))
        a = a->next;
    if (!a || a->number == 0)
        return 0;
    result = message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_RENDER_RESULT ? message->render_result : NULL;
    end_asking(server, a, result ? result->cpu_ns : 0, clock_monotonic_ns()); /* it waits for another worker, unless it is decided */
    vote = &a->vote[a->votes];
    if (!result || wire_digest_get(&vote->digest, &result->digest, "a unit", &err) != STATUS_OK)
        return 1;
    vote->hash = result->hash;
    vote->has_digest = 1;
    snprintf(vote->label, sizeof vote->label, "%s", worker->worker->label);
    a->votes++;
    audits->done++;
    if (decide(server, a))
        audit_drop(server, a);
    return 1;
}

/* ---- from time to time ---------------------------------------------------------------------- */

void unit_audits_tick(struct server *server, uint64_t now_ns)
{
    struct unit_audits *audits = &server->audits;
    struct unit_audit *next;
    uint32_t tries = 0; /* for which no worker was free */

    for (struct unit_audit *a = audits->first; a; a = next) {
        const struct job *job = queue_find(&server->farm.queue, a->job);
        next = a->next;
        if (now_ns - a->begun_ns > (uint64_t)AUDIT_STORE_S * NS_PER_SECOND)
            keep(server, a);
        if (a->number &&
            (!session_find(server, a->session) || now_ns - a->asked_ns > (uint64_t)AUDIT_WAIT_S * NS_PER_SECOND))
            end_asking(server, a, UINT64_MAX, now_ns); /* choose() passes over that session */
        if (a->number)
            continue;
        if (!job || job->epoch_floor != a->epoch_floor || job->removed)
            audit_drop(server, a);
        else if (tries < AUDIT_TRIES)
            tries += !ask(server, a, job, now_ns);
    }
}

void unit_audits_release(struct server *server)
{
    struct unit_audits *audits = &server->audits;

    for (struct unit_audit *a = audits->first, *next; a; a = next) {
        next = a->next;
        mem_free(a);
    }
    *audits = (struct unit_audits){0};
}
