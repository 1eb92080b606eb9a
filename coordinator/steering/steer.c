#include "coordinator/steering/steer.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/farm/distrusted.h"
#include "coordinator/farm/closing.h"
#include "coordinator/steering/extend.h"
#include "coordinator/steering/retarget.h"
#include "coordinator/farm/waiting.h"
#include "protocol/fields.h"
#include "protocol/message.h"

/* ---- which verb, and whether -------------------------------------------------------------------- */

enum job_verb_name steer_verb(const Azulejo__Wire__Envelope *message)
{
    const struct job_verb *variant;
    enum job_verb_name verb = VERB_COUNT;

    switch (message->body_case) {
#define VERB(NAME, ...) case AZULEJO__WIRE__ENVELOPE__BODY_JOB_##NAME: verb = VERB_##NAME; break;
#define VARIANT(...)
        JOB_VERBS(VERB, VARIANT)
#undef VERB
#undef VARIANT
    default: return VERB_COUNT;
    }
    variant = job_verb_variant(&job_verbs[verb]);
    return variant && message_is_set(message_body(message), variant->field) ? (enum job_verb_name)(variant - job_verbs)
                                                                            : verb;
}

/* A job whose row is damaged can only go. */
static int is_beyond(const struct job *job, enum job_verb_name verb)
{
    return job->is_damaged && verb != VERB_CANCEL && verb != VERB_REMOVE && verb != VERB_COMMENT;
}

int steer_offers(const struct job *job, enum job_verb_name verb)
{
    if (is_beyond(job, verb) || !(job_verbs[verb].states >> job->state & 1))
        return 0;
    switch (job_verbs[verb].when) {
    case VERB_WHEN_BEGUN: return job->state != JOB_STATE_QUEUED || job->frames || job->samples_done + job->closed_sum.samples > 0;
    case VERB_WHEN_WAITING: return job->needs.after_count > 0 || job->needs.not_before != 0;
    case VERB_WHEN_UNFINISHED: return job->state != JOB_STATE_DONE || job->marks & JOB_MARK_EARLY;
    default: return 1;
    }
}

/* ERR_REFUSED: what cannot be done to a job in its state, and what can. */
static status refuse(const struct job *job, const struct job_verb *verb, struct error *err)
{
    return error_set(err, STATUS_ERR_REFUSED, "job %" PRIu64 " is %s and cannot be %s: %s", job->id,
                     job_state_word(job->state), verb->past, verb->remedy ? verb->remedy : job_state_remedy(job->state));
}

status steer(const struct steering *s, struct error *err)
{
    static steer_deed *const deeds[VERB_COUNT] = {
#define VERB(NAME, name, ...) [VERB_##NAME] = steer_##name,
#define VARIANT(NAME, name, of, ...) [VERB_##NAME] = steer_##of,
        JOB_VERBS(VERB, VARIANT)
#undef VERB
#undef VARIANT
    };
    enum job_verb_name verb = steer_verb(s->message);

    if (is_beyond(s->job, verb))
        return error_set(err, STATUS_ERR_REFUSED, "job %" PRIu64 ": its row in queue.sqlite is damaged: submit it again, then cancel and remove this one",
                         s->job->id);
    if ((job_verbs[verb].states | job_verbs[verb].accepted) >> s->job->state & 1)
        return deeds[verb](s, err);
    return refuse(s->job, job_verb_find(job_verbs[verb].path), err);
}

/* ---- the log ------------------------------------------------------------------------------------- */

struct line {
    char text[2 * JOB_TEXT_MAX];
};

static void write_line(void *user, status result, const struct error *why)
{
    struct line *line = user;

    if (result == STATUS_OK)
        log_info("%s", line->text);
    else
        log_warn("%s, which is not on disk yet: %s", line->text, why->text);
    mem_free(line);
}

/* A line of the coordinator's log, when all that was noted before is on disk: what it says to be done outlives a crash. */
__attribute__((format(printf, 2, 3))) static void say(const struct steering *s, const char *format, ...)
{
    struct line *line = mem_alloc(sizeof *line);
    va_list args;
    int used;

    if (!line)
        return;
    used = snprintf(line->text, sizeof line->text, "job %" PRIu64 " (%s) is ", s->job->id, s->job->name);
    va_start(args, format);
    vsnprintf(line->text + used, sizeof line->text - (size_t)used, format, args);
    va_end(args);
    if (!s->farm->store || store_when_saved(s->farm->store, write_line, line, NULL) != STATUS_OK)
        write_line(line, STATUS_OK, NULL);
}

/* ---- verbs without arguments --------------------------------------------------------------------- */

status steer_pause(const struct steering *s, struct error *err UNUSED)
{
    char text[JOB_WHO_MAX + 16];

    if (s->job->state == JOB_STATE_PAUSED)
        return STATUS_OK;
    snprintf(text, sizeof text, "paused by %s", s->who);
    farm_job_revoke(s->farm, s->job, "the job is paused");
    farm_note(s->farm, s->job, s->who, "paused");
    farm_job_change(s->farm, s->job, JOB_STATE_PAUSED, text, s->now_ns);
    say(s, "%s", text);
    closing_step(s->farm, s->job, s->now_ns);
    return STATUS_OK;
}

status steer_resume(const struct steering *s, struct error *err UNUSED)
{
    struct job *job = s->job;

    suspicion_clear(&job->suspicion);
    hangs_clear(&job->hangs);
    refusals_clear(&job->refusals);
    farm_note(s->farm, job, s->who, "resumed");
    farm_job_change(s->farm, job, JOB_STATE_QUEUED, NULL, s->now_ns);
    say(s, "resumed by %s", s->who);
    return STATUS_OK;
}

status steer_finish(const struct steering *s, struct error *err)
{
    struct job *job = s->job;

    if (job->state == JOB_STATE_FINISHING)
        return STATUS_OK;
    if (!closing_has_begun(s->farm, job))
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %" PRIu64 " has no frame in work that could be finished: 'cancel' it instead", job->id);
    farm_note(s->farm, job, s->who, "finish: frames in work complete their first pass");
    farm_job_change(s->farm, job, JOB_STATE_FINISHING, NULL, s->now_ns);
    say(s, "finished early by %s", s->who);
    closing_step(s->farm, job, s->now_ns);
    return STATUS_OK;
}

status steer_start(const struct steering *s, struct error *err UNUSED)
{
    struct job *job = s->job;

    if (job->needs.after_count == 0 && job->needs.not_before == 0)
        return STATUS_OK;
    waiting_end(s->farm, job);
    farm_note(s->farm, job, s->who, "started: it waits for no other job and for no time");
    farm_job_save(s->farm, job, s->now_ns);
    say(s, "started by %s, whatever it waited for", s->who);
    s->farm->events.job_changed(s->farm->events.user, job);
    return STATUS_OK;
}

/* ---- verbs with one ------------------------------------------------------------------------------ */

status steer_cancel(const struct steering *s, struct error *err UNUSED)
{
    int discard = s->message->job_cancel->discard, ended = job_state_ended(s->job->state);
    int ends = !ended && (s->job->state != JOB_STATE_CANCELLING || discard);

    if (ends)
        farm_note(s->farm, s->job, s->who, "cancel%s", discard ? ", discarding unfinished frames" : "");
    else if (discard)
        farm_note(s->farm, s->job, s->who, "discard: its films are removed");
    farm_cancel(s->farm, s->job, discard, s->now_ns);
    if (ended && discard)
        say(s, "rid of its films by %s", s->who);
    else if (ends)
        say(s, "cancelled by %s%s", s->who, discard ? ", and its samples are discarded" : "");
    return STATUS_OK;
}

status steer_priority(const struct steering *s, struct error *err UNUSED)
{
    int32_t before = s->job->priority, wanted = s->message->job_priority->priority;

    if (wanted == before)
        return STATUS_OK;
    queue_set_priority(&s->farm->queue, s->job, wanted);
    farm_note(s->farm, s->job, s->who, "priority %d, was %d", wanted, before);
    farm_job_save(s->farm, s->job, s->now_ns);
    farm_wake(s->farm);
    s->farm->events.job_changed(s->farm->events.user, s->job);
    return STATUS_OK;
}

status steer_comment(const struct steering *s, struct error *err)
{
    const char *text = s->message->job_comment->comment;

    if (strlen(text) > JOB_COMMENT_MAX)
        return error_set(err, STATUS_ERR_INPUT, "a comment has at most %d bytes", JOB_COMMENT_MAX);
    message_text(s->job->comment, sizeof s->job->comment, text);
    farm_note(s->farm, s->job, s->who, s->job->comment[0] ? "comment: %s" : "the comment is removed", s->job->comment);
    farm_job_save(s->farm, s->job, s->now_ns);
    s->farm->events.job_changed(s->farm->events.user, s->job);
    return STATUS_OK;
}

/* ---- develop ------------------------------------------------------------------------------------- */

status steer_develop(const struct steering *s, struct error *err)
{
    struct output_settings output;
    status result = wire_output_get(&output, s->message->job_develop->output, err);

    THEN(result, farm_develop(s->farm, s->job, &output, err));
    if (result == STATUS_OK)
        farm_note(s->farm, s->job, s->who, "developed again, with %s", output.tonemap.op->name);
    return result;
}

/* ---- extend ---------------------------------------------------------------------------------- */

static void note_rules(const struct steering *s, const struct stop_rules *before, uint32_t spp_before,
                       const struct retarget_result *result)
{
    const struct job *job = s->job;
    char now[STOP_RULES_TEXT_SIZE], was[STOP_RULES_TEXT_SIZE], frames[128] = "";

    if (result->reopened > 0)
        snprintf(frames, sizeof frames, "; %" PRIu32 " done frame%s go%s on", result->reopened,
                 result->reopened == 1 ? "" : "s", result->reopened == 1 ? "es" : "");
    else if (result->without_film > 0)
        snprintf(frames, sizeof frames, "; done frames whose films were not kept stay as they are");
    stop_rules_text(now, &job->stop, job->settings.spp);
    stop_rules_text(was, before, spp_before);
    farm_note(s->farm, job, s->who, "extended to %s, was %s%s", now, was, frames);
    say(s, "extended by %s to %s, was %s%s", s->who, now, was, frames);
}

static status check_extension(struct job_extension *out, const Azulejo__Wire__JobExtend *wanted, struct error *err)
{
    *out = (struct job_extension){.spp = wanted->spp, .frames = wanted->frames, .frame_count = wanted->n_frames};
    if (wire_stop_get(&out->rules, wanted->stop, err) != STATUS_OK)
        return STATUS_ERR_INPUT;
    if (wanted->spp > SETTINGS_SPP_MAX)
        return error_set(err, STATUS_ERR_INPUT, "%u samples a pixel: must be 1..%d", wanted->spp, SETTINGS_SPP_MAX);
    if (wanted->spp == 0 && !stop_ends_a_frame(&out->rules))
        return error_set(err, STATUS_ERR_INPUT,
                         "no rule says when the pictures are good enough: give samples a pixel (spp), a target error, a "
                         "time limit or a limit of core time");
    return STATUS_OK;
}

status steer_extend(const struct steering *s, struct error *err)
{
    struct job *job = s->job;
    const struct stop_rules before = job->stop;
    uint32_t spp_before = job->settings.spp;
    struct retarget_result result = {0};
    struct job_extension extension;
    status done = check_extension(&extension, s->message->job_extend, err);

    THEN(done, job->state != JOB_STATE_DONE ? farm_retarget(s->farm, job, &extension, &result, s->now_ns, err)
                                            : farm_extend(s->farm, job, &extension, err));
    if (done != STATUS_OK || result.same)
        return done;
    farm_job_save(s->farm, job, s->now_ns);
    note_rules(s, &before, spp_before, &result);
    return STATUS_OK;
}

/* ---- retry ----------------------------------------------------------------------------------- */

static int is_cut_by_a_person(const struct job *job, uint32_t frame)
{
    for (size_t i = 0; i < job->cut_count; i++)
        if (job->cuts[i].frame == frame)
            return job->cuts[i].end == FRAME_END_CANCEL || job->cuts[i].end == FRAME_END_FINISH;
    return 0;
}

/* The frames that go on if none are named; the caller frees them. */
static status unfinished_frames(const struct job *job, uint32_t **out, size_t *count, struct error *err)
{
    *count = 0;
    *out = mem_alloc_array(job_frame_count(job), sizeof **out);
    NEED(*out, err, "frames to try again");
    for (uint64_t at = job->first_frame; at <= job->last_frame; at++) {
        uint32_t frame = (uint32_t)at;
        if (job_frame_is_done(job, frame) ? is_cut_by_a_person(job, frame) : !job_frame_is_resting(job, frame))
            (*out)[(*count)++] = frame;
    }
    if (*count == 0 && job->state == JOB_STATE_DONE)
        return refuse(job, &job_verbs[VERB_RETRY], err);
    if (*count == 0)
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %" PRIu64 " has all of its frames: name those to try again (--frames)", job->id);
    return STATUS_OK;
}

/* Of those that are not done, only the chosen ones are rendered. */
static void rest_others(struct job *job, const struct job_reopening *chosen)
{
    for (uint64_t at = job->first_frame; at <= job->last_frame; at++) {
        uint32_t frame = (uint32_t)at;
        if (job_reopening_has(chosen, job, frame))
            job_frame_wake(job, frame);
        else if (!job_frame_is_done(job, frame))
            job_frame_rest(job, frame);
    }
}

status steer_reopen(struct farm *farm, struct job *job, const struct job_reopening *chosen, struct error *err)
{
    uint8_t *resting = job_resting_copy(job);
    struct job before;
    status s;

    NEED(resting, err, "frames to try again");
    rest_others(job, chosen);
    before = *job;
    s = farm_go_on(farm, job, &before, chosen, NULL, err);
    if (s != STATUS_OK)
        job_resting_restore(job, resting);
    mem_free(resting);
    return s;
}

static int ascends(const uint32_t *numbers, size_t count)
{
    for (size_t i = 1; i < count; i++)
        if (numbers[i] <= numbers[i - 1])
            return 0;
    return 1;
}

static status check_retry(const struct job *job, const Azulejo__Wire__JobRetry *wanted, struct error *err)
{
    if (!ascends(wanted->frames, wanted->n_frames))
        return error_set(err, STATUS_ERR_INPUT, "the frames to try again must ascend");
    return job->release[0] ? extend_check_release(job, err) : STATUS_OK;
}

status steer_retry(const struct steering *s, struct error *err)
{
    const Azulejo__Wire__JobRetry *wanted = s->message->job_retry;
    struct job *job = s->job;
    struct job_reopening chosen = {0};
    uint32_t *unfinished = NULL;
    size_t count = wanted->n_frames;
    status result = check_retry(job, wanted, err);

    if (result == STATUS_OK && count == 0)
        result = unfinished_frames(job, &unfinished, &count, err);
    if (result == STATUS_OK)
        result = job_reopening_init(&chosen, job, unfinished ? unfinished : wanted->frames, count, job->settings.spp, err);
    THEN(result, farm_store_usable(s->farm, err));
    THEN(result, job_reopen_check(&s->farm->queue, job, err));
    if (result == STATUS_OK && !unfinished)
        result = distrusted_add_blocked(s->farm, err);
    THEN(result, steer_reopen(s->farm, job, &chosen, err));
    if (result == STATUS_OK) {
        suspicion_clear(&job->suspicion);
        refusals_clear(&job->refusals);
        farm_note(s->farm, job, s->who, "retry: %zu frame%s%s", count, count == 1 ? "" : "s",
                  unfinished ? "" : ", chosen");
        say(s, "tried again by %s", s->who);
    }
    job_reopening_release(&chosen);
    mem_free(unfinished);
    return result;
}

/* ---- remove ---------------------------------------------------------------------------------- */

status steer_remove(const struct steering *s, struct error *err)
{
    struct farm *farm = s->farm;
    struct job *job = s->job;
    status result = STATUS_OK;

    waiting_settle(farm, s->now_ns); /* while it is there */
    if (farm->store)
        result = store_job_remove(farm->store, job->id, err);
    if (result != STATUS_OK)
        return result;
    say(s, "removed by %s; it was of %s", s->who, job->owner[0] ? job->owner : "an unknown owner");
    farm_pictures_unwanted(farm, job);
    queue_remove(&farm->queue, job);
    if (farm->events.job_removed)
        farm->events.job_removed(farm->events.user, job->id);
    farm_job_dispose(farm, job);
    return STATUS_OK;
}
