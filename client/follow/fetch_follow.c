/* Fetching a job's files as they are finished. */
#include <inttypes.h>
#include <poll.h>
#include <stdio.h>

#include "client/follow/cut_frame.h"
#include "client/follow/fetch.h"
#include "client/link/signals.h"
#include "client/terminal/json.h"
#include "client/terminal/must.h"
#include "common/system/clock.h"
#include "common/base/memory.h"
#include "protocol/message.h"

enum { POLL_MS = 250 }; /* for pictures that an ended job still gets */

struct following {
    struct job_fetch *fetch;
    const struct frame_choice *choice;
    struct frame_list frames; /* count 0: all */
    uint32_t revision;        /* of the pictures that are here */
    uint64_t deadline_ns;     /* monotonic; 0: none */
    status verdict;           /* of the job's files, once it has ended; its error is `why` */
    struct error why;
};

static status begin(struct following *w, const Azulejo__Wire__JobInfo *job, struct error *err)
{
    size_t count = (size_t)(job->last_frame - job->first_frame) + 1;
    status result;

    if (w->fetch->followed)
        return STATUS_OK;
    result = frame_choice_of(w->choice, job->first_frame, job->last_frame, &w->frames, err);
    THEN(result, job_fetch_begin(w->fetch, w->frames.count ? w->frames.count : count, err));
    if (result != STATUS_OK)
        return result;
    w->fetch->followed = must(mem_calloc(count, 1));
    w->revision = job->revision;
    return STATUS_OK;
}

/* The job's pictures are being made again: those that are here are old. */
static void forget_pictures(struct following *w, const Azulejo__Wire__JobInfo *job)
{
    unsigned old = 0;

    for (unsigned i = 0; i < FETCH_KINDS; i++)
        if ((OUTPUT_FORMAT_PNG | OUTPUT_FORMAT_JPEG) >> i & 1)
            old |= FETCH_GOT(i) | FETCH_TRIED(i);
    w->fetch->again |= w->revision != job->revision;
    for (uint32_t i = 0; i <= job->last_frame - job->first_frame && w->revision != job->revision; i++)
        w->fetch->followed[i] &= (uint8_t)~old;
    w->revision = job->revision;
}

static status fetch_finished(struct following *w, const Azulejo__Wire__JobInfo *job, struct error *err)
{
    const unsigned display = OUTPUT_FORMAT_PNG | OUTPUT_FORMAT_JPEG;
    unsigned wanted = job_fetch_kinds(w->fetch);
    uint64_t count = w->frames.count ? w->frames.count : (uint64_t)(job->last_frame - job->first_frame) + 1;
    status result = STATUS_OK;

    for (uint64_t i = 0; i < count && result == STATUS_OK; i++) {
        uint32_t frame = w->frames.count ? w->frames.items[i] : job->first_frame + (uint32_t)i;
        unsigned now = 0;
        if (job_frame_listed(job, &job->done, frame))
            now |= wanted & ~display;
        if (job_frame_listed(job, &job->developed, frame))
            now |= wanted & display;
        result = job_fetch_some(w->fetch, frame, now, err);
    }
    return result;
}

/* A job may end before the last of its frames are tone mapped. */
static status await_pictures(struct following *w, Azulejo__Wire__Envelope **list, struct error *err)
{
    uint64_t number = w->fetch->job->job;
    status result = STATUS_OK;

    while (result == STATUS_OK && !w->fetch->job->develop_error[0] &&
           job_fetch_kinds(w->fetch) & (OUTPUT_FORMAT_PNG | OUTPUT_FORMAT_JPEG) &&
           w->fetch->job->frames_developed < w->fetch->job->frames_done) {
        struct pollfd wake = {.fd = signals_fd(), .events = POLLIN};
        (void)poll(&wake, 1, POLL_MS); /* a signal or a timeout: ask again either way */
        if (w->deadline_ns && clock_monotonic_ns() >= w->deadline_ns)
            return error_set(err, STATUS_ERR_TIMEOUT, "the pictures of job %" PRIu64 " are not made in time", number);
        message_free(*list);
        w->fetch->job = NULL;
        result = job_query(w->fetch->connection, number, list, err);
        if (result == STATUS_OK)
            w->fetch->job = job_list_find((*list)->job_list, number);
    }
    return result;
}

static int is_loss_or_stop(status code) { return code != STATUS_OK && (reconnect_is_loss(code) || signals_stop()); }

/* What is missing after the job's end is so for good. */
static status fetch_rest(struct following *w, struct error *err)
{
    Azulejo__Wire__Envelope *list = NULL;
    status result = await_pictures(w, &list, err);

    if (result == STATUS_OK) {
        forget_pictures(w, w->fetch->job);
        w->why = (struct error){0};
        w->fetch->failed = w->fetch->not_rendered = 0; /* of an attempt that lost its connection */
        json_decref(w->fetch->missing);
        w->fetch->missing = NULL;
        w->verdict = job_fetch_pictures(w->fetch, &w->frames, &w->why);
        if (is_loss_or_stop(w->verdict)) {
            result = w->verdict;
            if (err)
                *err = w->why;
        }
    }
    message_free(list);
    return result;
}

static status update(void *user, struct connection *c, const Azulejo__Wire__JobInfo *job, struct error *err)
{
    struct following *w = user;
    status result;

    w->fetch->connection = c;
    w->fetch->job = job;
    TRY(begin(w, job, err));
    forget_pictures(w, job);
    result = job_state_ended(job->state) ? fetch_rest(w, err) : fetch_finished(w, job, err);
    w->fetch->job = NULL;
    return result;
}

static status report(const struct following *w, const Azulejo__Wire__JobInfo *job, const struct follow *how,
                     struct error *err)
{
    char cut[CUT_FRAME_TEXT_SIZE];
    json_t *out;

    for (size_t i = 0; i < job->n_cut_frames && !how->quiet; i++)
        fprintf(stderr, "%s\n", cut_frame_text(cut, job, job->cut_frames[i]));
    if (!how->json)
        return STATUS_OK;
    out = json_pack("{s:o}", "job", json_message(&job->base));
    json_object_update_new(out, job_fetch_json(w->fetch));
    return json_print(out, err);
}

status job_fetch_follow(struct connection **c, uint64_t job, struct job_fetch *f, const struct frame_choice *choice,
                        const struct follow *how, struct error *err)
{
    struct following w = {.fetch = f, .choice = choice};
    struct follow mine = *how;
    Azulejo__Wire__Envelope *last = NULL;
    const Azulejo__Wire__JobInfo *info;
    status result;

    f->json = how->json || how->quiet;
    if (how->limit_s > 0)
        w.deadline_ns = clock_monotonic_ns() + (uint64_t)(how->limit_s * 1e9);
    mine.update = update;
    mine.update_user = &w;
    result = follow_wait(c, job, &mine, &last, err);
    if (result == STATUS_OK) {
        info = job_list_find(last->job_list, job);
        result = report(&w, info, how, err);
        THEN(result, job_info_verdict(info, err));
        THEN(result, job_info_missed(info, err));
        if (result == STATUS_OK && w.verdict != STATUS_OK) {
            result = w.verdict;
            if (err)
                *err = w.why;
        }
    }
    message_free(last);
    frame_list_free(&w.frames);
    return result;
}
