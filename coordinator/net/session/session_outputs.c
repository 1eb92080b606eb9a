/* What a client can fetch of a frame: files, previews, and the history of its errors. */
#include <inttypes.h>
#include <stdio.h>

#include "common/system/file.h"
#include "common/math/elementary.h"
#include "common/scene/manifest.h"
#include "coordinator/farm/forecast.h"
#include "coordinator/job/wire.h"
#include "coordinator/net/base/looks.h"
#include "coordinator/net/base/previews.h"
#include "coordinator/net/server.h"
#include "coordinator/net/session/session_messages.h"
#include "coordinator/net/session/session_tasks.h"
#include "protocol/message.h"

/* `shows`: it is sent as a preview; NULL: it is not. */
static status send_file(struct session *session, const struct job *job, const Azulejo__Wire__OutputGet *message,
                        const char *extension, uint64_t request, const struct transfer_preview *shows,
                        struct error *err)
{
    uint32_t frame = message->frame;
    struct output_asked asked = {.job = job->id, .frame = frame, .has = message->have.len > 0, .is_preview = shows != NULL};
    struct buffer path = BUFFER_INIT;
    status s = asked.has ? wire_digest_get(&asked.have, &message->have, "the client's file", err) : STATUS_OK;

    if (s != STATUS_OK)
        return s;
    if (shows)
        asked.shows = *shows;
    snprintf(asked.extension, sizeof asked.extension, "%s", extension);
    store_output_path(session->server->store, job->id, frame, extension, &path);
    if (!buffer_ok(&path))
        s = error_no_memory(err, "a path");
    else if (!file_exists(buffer_text(&path)))
        s = error_set(err, STATUS_ERR_NOT_FOUND,
                      "job %" PRIu64 ", frame %u: its %s file is no longer on the coordinator", job->id, frame,
                      extension);
    else
        session_task_output(session, request, buffer_text(&path), &asked);
    buffer_release(&path);
    return s;
}

static status check_frame(const struct job *job, uint32_t number, struct error *err)
{
    if (number >= job->first_frame && number <= job->last_frame)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 " has frames %u to %u", job->id, job->first_frame,
                     job->last_frame);
}

static status check_done(const struct job *job, uint32_t number, struct error *err)
{
    if (job_frame_is_done(job, number))
        return STATUS_OK;
    return error_set(err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 ", frame %u is not finished", job->id, number);
}

/* One of a finished frame's files. */
static status send_picture(struct session *session, const struct job *job, const Azulejo__Wire__OutputGet *message,
                           uint64_t request, struct error *err)
{
    int exr = message->kind == AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EXR;
    int png = message->kind == AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PNG;
    const char *extension = exr ? "exr" : png ? "png" : "jpg";

    TRY(check_done(job, message->frame, err));
    if (!(exr ? job->output.exr : png ? job->output.png : job->output.jpg))
        return error_set(err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 " has no %s output", job->id, extension);
    if (!exr && !job_frame_is_developed(job, message->frame))
        return error_set(err, STATUS_ERR_NOT_FOUND,
                         "job %" PRIu64 ", frame %u is not tone mapped yet%s%s; try again in a "
                         "moment",
                         job->id, message->frame, trouble_is(&job->pictures) ? ": " : "", job->pictures.text);
    return send_file(session, job, message, extension, request, NULL, err);
}

/* What the picture of a finished frame shows. */
static struct transfer_preview finished_shows(const struct job *job, uint32_t number)
{
    struct transfer_preview shows = {.covered = 1, .samples = job->settings.spp};

    for (size_t i = 0; i < job->cut_count; i++) {
        const struct film_coverage *c = &job->cuts[i].coverage;
        if (job->cuts[i].frame != number || c->tiles == 0)
            continue;
        shows.covered = 1 - (double)c->tiles_empty / c->tiles;
        shows.samples = (double)c->samples / ((double)job->settings.width * job->settings.height);
    }
    return shows;
}

/* Is there anything to see of a frame that is not finished? */
static status check_begun(const struct job *job, const struct job_frame *frame, uint32_t number, struct error *err)
{
    if (!frame && !job_state_is_open(job->state))
        return error_set(err, STATUS_ERR_NOT_FOUND,
                         "job %" PRIu64 " is %s: frames in work have previews only while it runs%s", job->id,
                         job_state_word(job->state),
                         job_state_ended(job->state) ? "" : " ('azulejo resume' continues it)");
    if (!frame || film_samples(frame->film) == 0)
        return error_set(err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 ", frame %u has no samples yet", job->id, number);
    return STATUS_OK;
}

/* The frame, in work or finished, tone mapped otherwise. */
static status send_look(struct session *session, const struct job *job, const Azulejo__Wire__OutputGet *message,
                        uint64_t request, struct error *err)
{
    uint32_t number = message->frame;
    int done = job_frame_is_done(job, number);
    struct transfer_preview shows = {0};
    struct job_frame *frame = done ? NULL : farm_frame_find(job, number);
    struct output_settings output;
    status s;

    if (message->kind != AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_PNG)
        return error_set(err, STATUS_ERR_INPUT, "only a preview as PNG can have settings of its own");
    output = job->output;
    s = message->output ? wire_output_get(&output, message->output, err) : STATUS_OK;
    THEN(s, session_look(&output, message, err));
    THEN(s, session_check_tonemap(session, &output, err));
    if (s == STATUS_OK && !done)
        s = check_begun(job, frame, number, err);
    if (s != STATUS_OK)
        return s;
    if (done)
        shows = finished_shows(job, number);
    return looks_ask(session, request, job, number, frame, &output, &shows, err);
}

/* The frame so far; its file if the frame is finished. */
static status send_preview(struct session *session, const struct job *job, const Azulejo__Wire__OutputGet *message,
                           uint64_t request, struct error *err)
{
    int linear = message->kind == AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_EXR;
    uint32_t number = message->frame;
    struct job_frame *frame = farm_frame_find(job, number);
    status s;

    if (job_frame_is_done(job, number)) {
        struct transfer_preview shows = finished_shows(job, number);
        if (linear ? job->output.exr : job->output.png && job_frame_is_developed(job, number))
            return send_file(session, job, message, linear ? "exr" : "png", request, &shows, err);
        return error_set(err, STATUS_ERR_NOT_FOUND,
                         "job %" PRIu64 ", frame %u is finished: fetch its files without --preview", job->id, number);
    }
    s = check_begun(job, frame, number, err);
    if (s == STATUS_OK)
        previews_ask(session, request, frame, linear ? PREVIEW_EXR : PREVIEW_PNG);
    return s;
}

/* Is there no file of the picture, although the frame is done? */
static int must_develop(const struct job *job, uint32_t frame)
{
    return job_frame_is_done(job, frame) && !(job->output.png && job_frame_is_developed(job, frame));
}

static status send_output(struct session *session, const struct job *job, const Azulejo__Wire__OutputGet *message,
                          uint64_t request, struct error *err)
{
    uint32_t number = message->frame;
    status s = check_frame(job, number, err);

    if (s != STATUS_OK)
        return s;
    session->reads_job = job->id;
    if (message->output || message->n_look || (message->develop && must_develop(job, number)))
        return send_look(session, job, message, request, err);
    switch (message->kind) {
    case AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EXR:
    case AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PNG:
    case AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_JPEG: return send_picture(session, job, message, request, err);
    case AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EFFECTS_JSON:
        s = check_done(job, number, err);
        return s == STATUS_OK ? send_file(session, job, message, MANIFEST_EXTENSION, request, NULL, err) : s;
    case AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_PNG:
    case AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_EXR: return send_preview(session, job, message, request, err);
    default: return error_set(err, STATUS_ERR_UNSUPPORTED, "unknown kind of output %d", (int)message->kind);
    }
}

status session_output_get(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns UNUSED,
                          struct error *err)
{
    const struct job *job = session_job(session, message->output_get->job, err);
    status s;

    if (!job)
        return STATUS_ERR_NOT_FOUND;
    s = send_output(session, job, message->output_get, message->request, err);
    transfers_pump(&session->transfers, session->channel);
    return s;
}

/* ---- history --------------------------------------------------------------------------------- */

/* The points of a curve are dense near the present error, where its interval bends, and reach this much further. */
enum { COST_POINTS = 48, MEASURES = ALLOCATION_RMSE + 1 };
#define COST_REACH_LN 13.8 /* a million times the cost */

struct cost_curve {
    Azulejo__Wire__CostCurve curve;
    Azulejo__Wire__CostPoint points[COST_POINTS], *pointers[COST_POINTS];
};

/* 0: nothing is known. */
static int cost_curve_set(struct cost_curve *out, const struct history *history, enum allocation_measure measure)
{
    struct prices prices;

    forecast_prices(history, measure, &prices);
    azulejo__wire__cost_curve__init(&out->curve);
    out->curve.measure = (uint32_t)measure + 1;
    out->curve.points = out->pointers;
    out->curve.stop = PRICE_STOP;
    out->curve.width = PRICE_WIDTH;
    for (int i = 0; i < COST_POINTS && prices.curve.points > 0; i++) {
        double further = (double)i / (COST_POINTS - 1), reach = COST_REACH_LN * further * further;
        double error = accuracy_curve_error(&prices.curve, det_exp_d(prices.curve.pivot + reach)).value;
        struct accuracy_estimate cost = prices_cost(&prices, error);

        out->points[i] = (Azulejo__Wire__CostPoint)AZULEJO__WIRE__COST_POINT__INIT;
        out->points[i].error = error;
        out->points[i].core_seconds = cost.value;
        out->points[i].core_seconds_low = cost.lo;
        out->points[i].core_seconds_high = cost.hi;
        out->pointers[out->curve.n_points++] = &out->points[i];
    }
    return prices.curve.points > 0;
}

static void send_history(struct session *session, uint64_t request, uint64_t job, uint32_t frame,
                         const struct history *history)
{
    struct wire_point points[HISTORY_MAX];
    Azulejo__Wire__HistoryPoint *pointers[HISTORY_MAX];
    struct cost_curve costs[MEASURES];
    Azulejo__Wire__CostCurve *curves[MEASURES];
    Azulejo__Wire__History message = AZULEJO__WIRE__HISTORY__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(HISTORY, history, &message);

    for (uint32_t i = 0; i < history->count; i++) {
        wire_point_set(&points[i], &history->points[i]);
        pointers[i] = &points[i].message;
    }
    message.job = job;
    message.frame = frame;
    message.n_points = history->count;
    message.points = pointers;
    message.curves = curves;
    for (int m = 0; m < MEASURES; m++)
        if (cost_curve_set(&costs[m], history, (enum allocation_measure)m))
            curves[message.n_curves++] = &costs[m].curve;
    session_reply(session, request, &envelope);
}
/* The store has the history of a finished frame; that of a frame not yet begun is empty. */
status session_history_get(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns UNUSED,
                           struct error *err)
{
    const struct job *job = session_job(session, message->history_get->job, err);
    uint32_t number = message->history_get->frame;
    struct history history = {.count = 0};
    const struct job_frame *frame;
    status s = STATUS_OK;

    if (!job)
        return STATUS_ERR_NOT_FOUND;
    frame = farm_frame_find(job, number);
    if (frame)
        history = frame->history;
    else if ((s = check_frame(job, number, err)) == STATUS_OK)
        s = store_history_load(session->server->store, job->id, number, &history, err);
    if (s == STATUS_OK)
        send_history(session, message->request, job->id, number, &history);
    return s;
}
