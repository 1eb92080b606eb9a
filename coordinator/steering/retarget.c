#include "coordinator/steering/retarget.h"

#include "common/system/log.h"
#include "common/base/memory.h"

static unsigned long long id_of(const struct job *job) { return (unsigned long long)job->id; }

/* ---- what is refused ------------------------------------------------------------------------- */

static status check_job(const struct job *job, const struct job_extension *extension, struct error *err)
{
    if (job->schedule.size > 0)
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %llu is rendered with another picture's schedule, which fixes all of its samples: submit the scene again without --schedule-from",
                         id_of(job));
    if (job->estimate == ESTIMATE_OPEN)
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %llu is an estimate: let it end, then submit the job or extend the estimate", id_of(job));
    if (extension->frame_count > 0)
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %llu has not ended, and all frames of a job in work have the same rules: extend it without --frames, or let it end first",
                         id_of(job));
    return job->release[0] ? extend_check_release(job, err) : STATUS_OK;
}

/* Does a frame in work have more samples than this cap? Of films that are only on disk it is not known. */
static status check_cap(const struct farm *farm, const struct job *job, uint32_t spp, struct error *err)
{
    uint32_t least = job->frames_done_count > 0 ? extend_least_cap(job) : 0;

    if (spp >= job->settings.spp)
        return STATUS_OK;
    for (const struct job_frame *frame = job->frames; frame; frame = frame->next) {
        uint32_t most = GROUPS * film_coverage(frame->film).group_most;
        if (most > least)
            least = most;
    }
    if (spp < least)
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %llu has up to %u samples a pixel already: give --spp %u or more, or 'finish' it",
                         id_of(job), least, least);
    for (uint64_t frame = job->first_frame; farm->store && frame <= job->last_frame; frame++)
        if (!job_frame_is_done(job, (uint32_t)frame) && !farm_frame_find(job, (uint32_t)frame) &&
            store_film_exists(farm->store, job->id, (uint32_t)frame))
            return error_set(err, STATUS_ERR_REFUSED,
                             "job %llu is %s, and the samples of frame %u are only on disk: fewer than --spp %u can be given once the frame is in work, or 'finish' it",
                             id_of(job), job_state_word(job->state), (uint32_t)frame, job->settings.spp);
    return STATUS_OK;
}

static status check_count(const struct job *job, uint32_t spp, struct error *err)
{
    uint64_t total;

    if (!__builtin_mul_overflow((uint64_t)job->settings.width * job->settings.height * spp,
                                (uint64_t)job_frame_count(job), &total) &&
        total <= INT64_MAX)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_LIMIT,
                     "job %llu would have more samples than can be counted: give a smaller --spp", id_of(job));
}

/* ---- the rules, and what they mean for frames that are done ----------------------------------- */

/* As `azulejo submit` would send them. */
static struct stop_rules rules_of(const struct job *job, const struct stop_rules *wanted, uint32_t spp)
{
    struct stop_rules out = *wanted;

    out.adaptive = stop_ends_a_frame(wanted) && (!stop_has_rounds(&job->stop) || job->stop.adaptive);
    out.spp_min = !out.has_target ? 0 : job->stop.spp_min > 0 ? job->stop.spp_min : SPP_MIN_DEFAULT;
    if (out.spp_min > spp)
        out.spp_min = spp;
    return out;
}

static int rules_are_equal(const struct stop_rules *a, const struct stop_rules *b)
{
    for (int i = 0; i < STOP_COUNT; i++)
        if (!setting_equal(&stop_rules_rows[i], a, b))
            return 0;
    return a->has_target == b->has_target && a->adaptive == b->adaptive &&
           (!a->has_target || (a->target.measure == b->target.measure && a->target.value == b->target.value));
}

/* May the new rules want more of a frame that ended so? */
static int falls_short(const struct job *job, enum frame_end end, const struct stop_rules *rules, uint32_t spp)
{
    if (end == FRAME_END_CAP)
        return spp > job->settings.spp;
    return end != FRAME_END_TARGET || !rules->has_target || rules->target.measure != job->stop.target.measure ||
           stop_target_is_stricter(&rules->target, &job->stop.target);
}

struct frame_set {
    uint8_t *end;      /* [frames] enum frame_end of those that are done; NONE: it is not */
    uint32_t *numbers; /* that go on */
    size_t count;
};

static status ends_of(const struct job *job, struct frame_set *set, struct error *err)
{
    set->end = mem_calloc(job_frame_count(job), 1);
    set->numbers = mem_alloc_array(job_frame_count(job), sizeof *set->numbers);
    NEED(set->end && set->numbers, err, "frames that go on");
    for (uint32_t i = 0; i < job_frame_count(job); i++)
        if (job_frame_is_done(job, job->first_frame + i))
            set->end[i] = FRAME_END_CAP;
    for (size_t i = 0; i < job->cut_count; i++)
        set->end[job->cuts[i].frame - job->first_frame] = (uint8_t)job->cuts[i].end;
    return STATUS_OK;
}

/* The done frames that go on. Pictures that are made of several frames are all made again, or none. */
static status choose(const struct farm *farm, const struct job *job, const struct stop_rules *rules, uint32_t spp,
                     struct frame_set *set, struct retarget_result *result, struct error *err)
{
    int together = 0;
    status s = ends_of(job, set, err);

    for (uint32_t i = 0; s == STATUS_OK && i < job_frame_count(job) && tonemap_takes_frames(&job->output.tonemap); i++)
        together |= set->end[i] != FRAME_END_NONE && falls_short(job, (enum frame_end)set->end[i], rules, spp);
    for (uint32_t i = 0; s == STATUS_OK && i < job_frame_count(job); i++) {
        uint32_t frame = job->first_frame + i;
        if (set->end[i] == FRAME_END_NONE || (!together && !falls_short(job, (enum frame_end)set->end[i], rules, spp)))
            continue;
        if (!farm->store || store_film_exists(farm->store, job->id, frame))
            set->numbers[set->count++] = frame;
        else
            result->without_film++;
    }
    result->reopened = (uint32_t)set->count;
    if (s == STATUS_OK && together && result->without_film > 0)
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %llu's pictures are made of several frames each (--temporal, --denoise-around), and %u of those that "
                         "are done have no film any more: submit the scene again",
                         id_of(job), result->without_film);
    if (s == STATUS_OK && set->count > 0 && farm->developing == job)
        return error_set(err, STATUS_ERR_REFUSED, "job %llu: a picture of it is being made again; try that in a moment",
                         id_of(job));
    return s;
}

/* ---- the change ------------------------------------------------------------------------------ */

/* What the store must forget: a frame whose pictures are being made may be noted as done at any moment. */
static void add_developing(const struct job *job, struct frame_set *set)
{
    for (const struct job_frame *frame = job->frames; frame; frame = frame->next)
        if (frame->state == FRAME_DEVELOPING)
            set->numbers[set->count++] = frame->number;
}

static status store_change(struct farm *farm, struct job *job, const struct job_extension *wanted, uint32_t spp,
                           const struct job_reopening *chosen, struct error *err)
{
    const struct job before = *job;
    status s = STATUS_OK;

    job_set_rules(job, &wanted->rules, spp);
    job_fence(job, farm->leases.epoch);
    if (farm->store)
        s = store_job_extend(farm->store, job, chosen, NULL, err);
    if (s != STATUS_OK)
        *job = before;
    return s;
}

static void take_effect(struct farm *farm, struct job *job, const struct job_reopening *chosen, uint64_t now_ns)
{
    struct error why = {0};

    job_reopen_frames(&farm->queue, job, chosen);
    farm_note_closed(farm, job);
    if (job->frames_developed_count == job->frames_done_count)
        farm_pictures_unwanted(farm, job);
    farm_pictures_wanted(farm, job);
    if (farm->store && store_job_sum(farm->store, job, &why) != STATUS_OK)
        log_warn("job %llu: what its done frames took is not counted until the next start: %s", id_of(job), why.text);
    for (struct job_frame *frame = job->frames, *next; frame; frame = next) {
        next = frame->next;
        farm_frame_renew(farm, frame, now_ns);
    }
    farm_wake(farm);
    farm->events.job_changed(farm->events.user, job);
}

status farm_retarget(struct farm *farm, struct job *job, const struct job_extension *extension,
                     struct retarget_result *result, uint64_t now_ns, struct error *err)
{
    uint32_t spp = extension->spp ? extension->spp : SETTINGS_SPP_MAX;
    const struct job_extension wanted = {.spp = spp, .rules = rules_of(job, &extension->rules, spp)};
    struct job_reopening chosen = {0};
    struct frame_set set = {0};
    status s = check_job(job, extension, err);

    *result = (struct retarget_result){0};
    if (s == STATUS_OK && spp == job->settings.spp && rules_are_equal(&wanted.rules, &job->stop)) {
        result->same = 1;
        return STATUS_OK;
    }
    THEN(s, check_cap(farm, job, spp, err));
    THEN(s, check_count(job, spp, err));
    THEN(s, farm_store_usable(farm, err));
    THEN(s, choose(farm, job, &wanted.rules, spp, &set, result, err));
    if (s == STATUS_OK && !MEM_GROW(job->cuts, job->cut_capacity, job_frame_count(job)))
        s = error_no_memory(err, "frames that go on");
    if (s == STATUS_OK)
        add_developing(job, &set);
    THEN(s, job_reopening_of(&chosen, job, set.numbers, set.count, spp, err));
    THEN(s, store_change(farm, job, &wanted, spp, &chosen, err));
    if (s == STATUS_OK)
        take_effect(farm, job, &chosen, now_ns);
    job_reopening_release(&chosen);
    mem_free(set.numbers);
    mem_free(set.end);
    return s;
}
