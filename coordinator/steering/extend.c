#include "coordinator/steering/extend.h"

#include <string.h>

#include "common/system/log.h"
#include "coordinator/job/wire.h"

static unsigned long long id_of(const struct job *job) { return (unsigned long long)job->id; }

static status check_work(const struct job *job, struct error *err)
{
    if (job->to_develop)
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %llu: its pictures are being developed again; wait for that, then "
                         "extend it",
                         id_of(job));
    if (job->schedule.size > 0)
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %llu was rendered with another picture's schedule, which fixes all of its samples: submit the scene again without --schedule-from",
                         id_of(job));
    return STATUS_OK;
}

/* Another release renders different samples. */
status extend_check_release(const struct job *job, struct error *err)
{
    if (strcmp(job->release, AZULEJO_VERSION) == 0)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_REFUSED,
                     "job %llu was rendered by %s%s, and this is azulejo %s: their samples do not "
                     "mix; submit the scene again, or extend it with that release",
                     id_of(job), job->release[0] ? "azulejo " : "an older release", job->release, AZULEJO_VERSION);
}

static status check_films(const struct farm *farm, const struct job *job, const struct job_reopening *chosen,
                          struct error *err)
{
    for (uint64_t frame = job->first_frame; farm->store && frame <= job->last_frame; frame++)
        if (job_frame_is_done(job, (uint32_t)frame) && job_reopening_has(chosen, job, (uint32_t)frame) &&
            !store_film_exists(farm->store, job->id, (uint32_t)frame))
            return error_set(err, STATUS_ERR_REFUSED,
                             "job %llu, frame %u: its film was not kept, so nothing can be added to "
                             "it; submit the scene again",
                             id_of(job), (uint32_t)frame);
    return STATUS_OK;
}

uint32_t extend_least_cap(const struct job *job)
{
    uint32_t most = 0;

    if (job->cut_count < job->frames_done_count)
        return job->settings.spp;
    for (size_t i = 0; i < job->cut_count; i++)
        if (job->cuts[i].coverage.group_most > most)
            most = job->cuts[i].coverage.group_most;
    return GROUPS * most;
}

/* Does a chosen frame have fewer samples than the cap allows? */
static int is_room(const struct job *job, const struct job_reopening *chosen)
{
    if (!chosen->chosen)
        return job->cut_count > 0 || job_frames_left(job) > 0;
    for (size_t i = 0; i < job->cut_count; i++)
        if (job_reopening_has(chosen, job, job->cuts[i].frame))
            return 1;
    return 0;
}

/* Single frames may catch up with the others. */
static int is_looser(const struct job *job, const struct job_reopening *chosen, const struct stop_rules *rules)
{
    if (!rules->has_target || !job->stop.has_target)
        return 0;
    return chosen->chosen ? stop_target_is_stricter(&job->stop.target, &rules->target)
                          : !stop_target_is_stricter(&rules->target, &job->stop.target);
}

static status check_rules(const struct job *job, const struct job_reopening *chosen, uint32_t spp,
                          const struct stop_rules *rules, struct error *err)
{
    char text[STOP_TEXT_SIZE];
    uint64_t total;

    if (chosen->chosen && job_frames_left(job) > 0)
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %llu%s, and %u of its frames were never rendered: extend it without "
                         "--frames%s",
                         id_of(job), job->estimate == ESTIMATE_OPEN ? " is an estimate" : " has a part of its frames",
                         job_frames_left(job), job->estimate == ESTIMATE_OPEN ? ", or submit the job" : "");
    if (chosen->chosen && tonemap_takes_frames(&job->output.tonemap))
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %llu's pictures are made of several frames each (--temporal, --denoise-around): extend all of "
                         "them, without --frames",
                         id_of(job));

    if (spp < extend_least_cap(job))
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %llu has up to %u samples a pixel already: give --spp %u or more", id_of(job),
                         extend_least_cap(job), extend_least_cap(job));
    if (is_looser(job, chosen, rules))
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %llu was rendered to %s: give a smaller error in the same unit, or "
                         "--spp",
                         id_of(job), stop_target_text(text, &job->stop.target));
    if (rules->max_rays > 0 && rules->max_rays < job->stop.max_rays + !chosen->chosen)
        return error_set(err, STATUS_ERR_REFUSED, "job %llu was rendered to %llu rays a frame: give a larger --max-rays",
                         id_of(job), (unsigned long long)job->stop.max_rays);
    if (spp == job->settings.spp && !is_room(job, chosen))
        return error_set(err, STATUS_ERR_REFUSED, "job %llu has all of its %u samples a pixel: give a larger --spp",
                         id_of(job), spp);
    if (__builtin_mul_overflow((uint64_t)job->settings.width * job->settings.height * spp,
                               (uint64_t)job_frame_count(job), &total) ||
        total > INT64_MAX)
        return error_set(err, STATUS_ERR_LIMIT,
                         "job %llu would have more samples than can be counted: give a smaller --spp", id_of(job));
    return STATUS_OK;
}

/* The rules as if they had been given from the start. */
static struct stop_rules rules_of(const struct job *job, const struct stop_rules *rules)
{
    struct stop_rules out = *rules;

    out.spp_min = job->cut_count == 0 ? job->settings.spp : job->stop.spp_min;
    out.adaptive = stop_ends_a_frame(rules) && (!stop_has_rounds(&job->stop) || job->stop.adaptive);
    if (!stop_has_rounds(&out))
        out.spp_min = 0; /* every pixel gets the cap */
    return out;
}

status farm_go_on(struct farm *farm, struct job *job, const struct job *before, const struct job_reopening *chosen,
                  const struct job *submitted, struct error *err)
{
    struct error why = {0};
    status s = STATUS_OK;

    job_fence(job, farm->leases.epoch);
    if (farm->store)
        s = store_job_extend(farm->store, job, chosen, submitted, err);
    if (s != STATUS_OK) {
        *job = *before;
        return s;
    }
    memset(&job->pictures, 0, sizeof job->pictures);
    job_reopen(&farm->queue, job, chosen);
    farm_job_save(farm, job, 0); /* its row of before may be lost: it is not active, so the time does not matter */
    farm_note_closed(farm, job);
    farm_pictures_wanted(farm, job);
    if (farm->store && chosen->chosen && store_job_sum(farm->store, job, &why) != STATUS_OK)
        log_warn("job %llu: what its other frames took is not counted until the next start: %s", id_of(job), why.text);
    farm_wake(farm);
    farm->events.job_changed(farm->events.user, job);
    return STATUS_OK;
}

status farm_extend(struct farm *farm, struct job *job, const struct job_extension *extension, struct error *err)
{
    struct job_reopening chosen = {0};
    uint32_t spp = extension->spp ? extension->spp : SETTINGS_SPP_MAX;
    status s = check_work(job, err);

    THEN(s, extend_check_release(job, err));
    THEN(s, job_reopening_init(&chosen, job, extension->frames, extension->frame_count, spp, err));
    THEN(s, check_films(farm, job, &chosen, err));
    THEN(s, check_rules(job, &chosen, spp, &extension->rules, err));
    THEN(s, farm_store_usable(farm, err));
    THEN(s, job_reopen_check(&farm->queue, job, err));
    if (s == STATUS_OK) {
        const struct stop_rules rules = rules_of(job, &extension->rules);
        const struct job before = *job;
        job_extend(job, &rules, spp);
        s = farm_go_on(farm, job, &before, &chosen, NULL, err);
    }
    job_reopening_release(&chosen);
    return s;
}

/* ---- estimates ------------------------------------------------------------------------------ */

/* Can the job continue from what the estimate rendered? */
static int is_estimate_of(const struct farm *farm, const struct job *estimate, const struct job *job)
{
    const struct job_reopening all = {0};
    struct error ignored = {0};
    int same = 0;

    return estimate->estimate == ESTIMATE_OPEN && job->estimate == ESTIMATE_NONE &&
           wire_job_estimated(estimate, job, &same, &ignored) == STATUS_OK && same &&
           estimate->state == JOB_STATE_DONE && check_work(estimate, &ignored) == STATUS_OK &&
           extend_check_release(estimate, &ignored) == STATUS_OK &&
           check_films(farm, estimate, &all, &ignored) == STATUS_OK;
}

struct job *farm_find_estimate(const struct farm *farm, const struct job *job)
{
    for (size_t i = farm->queue.count; i-- > 0;)
        if (is_estimate_of(farm, farm->queue.all[i], job))
            return farm->queue.all[i];
    return NULL;
}

status farm_continue_estimate(struct farm *farm, struct job *estimate, const struct job *job, struct error *err)
{
    const struct job_reopening all = {0};
    struct job before;
    status s;

    if (!is_estimate_of(farm, estimate, job))
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %llu was an estimate of this one, but it was continued or removed in the meantime: submit it again",
                         id_of(estimate));
    TRY(job_reopen_check(&farm->queue, estimate, err));
    before = *estimate;
    job_continue(estimate, job);
    s = farm_go_on(farm, estimate, &before, &all, job, err);
    if (s == STATUS_OK)
        log_info("job %llu (%s) was submitted and continues its estimate", id_of(estimate), estimate->name);
    return s;
}
