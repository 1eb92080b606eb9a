#include "coordinator/extend.h"

#include <string.h>

#include "common/base/log.h"

static unsigned long long id_of(const struct job *job)
{
    return (unsigned long long)job->id;
}

static status check_state(const struct job *job, struct error *err)
{
    if (job->state != JOB_STATE_DONE)
        return error_set(err, STATUS_ERR_REFUSED, "job %llu is %s: only a finished job is extended",
                         id_of(job), job_state_word(job->state));
    if (job->to_develop)
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %llu: its pictures are being developed again; wait for that, then "
                         "extend it",
                         id_of(job));
    if (job->schedule.size > 0)
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %llu was rendered by another picture's schedule, which says all of "
                         "its samples: submit the scene again without --schedule-from",
                         id_of(job));
    return STATUS_OK;
}

/* Samples of another release are other samples. */
static status check_release(const struct job *job, struct error *err)
{
    if (strcmp(job->release, AZULEJO_VERSION) == 0)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_REFUSED,
                     "job %llu was rendered by %s%s, and this is azulejo %s: their samples do not "
                     "mix; submit the scene again, or extend it with that release",
                     id_of(job), job->release[0] ? "azulejo " : "an older release", job->release,
                     AZULEJO_VERSION);
}

static status check_films(const struct farm *farm, const struct job *job, struct error *err)
{
    for (uint64_t frame = job->first_frame; farm->store && frame <= job->last_frame; frame++)
        if (!store_film_exists(farm->store, job->id, (uint32_t)frame))
            return error_set(err, STATUS_ERR_REFUSED,
                             "job %llu, frame %u: its film was not kept, so nothing can be added to "
                             "it; submit the scene again",
                             id_of(job), (uint32_t)frame);
    return STATUS_OK;
}

/* The least cap that has room for every sample that there is. */
static uint32_t least_cap(const struct job *job)
{
    uint32_t most = 0;

    if (job->cut_count < job_frame_count(job))
        return job->settings.spp;
    for (size_t i = 0; i < job->cut_count; i++)
        if (job->cuts[i].coverage.group_most > most)
            most = job->cuts[i].coverage.group_most;
    return GROUPS * most;
}

static status check_rules(const struct job *job, uint32_t spp, const struct stop_rules *rules,
                          struct error *err)
{
    char text[STOP_TEXT_SIZE];
    uint64_t total;

    if (spp < least_cap(job))
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %llu has up to %u samples a pixel already: give --spp %u or more",
                         id_of(job), least_cap(job), least_cap(job));
    if (rules->has_target && job->stop.has_target &&
        !stop_target_is_stricter(&rules->target, &job->stop.target))
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %llu was rendered to %s: give a smaller error in the same unit, or "
                         "--spp",
                         id_of(job), stop_target_text(text, &job->stop.target));
    if (spp == job->settings.spp && job->cut_count == 0)
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %llu has all of its %u samples a pixel: give a larger --spp",
                         id_of(job), spp);
    if (__builtin_mul_overflow((uint64_t)job->settings.width * job->settings.height * spp,
                               (uint64_t)job_frame_count(job), &total) ||
        total > INT64_MAX)
        return error_set(err, STATUS_ERR_LIMIT,
                         "job %llu would have more samples than can be counted: give a smaller --spp",
                         id_of(job));
    return STATUS_OK;
}

/* The rules as if they had been given at once. */
static struct stop_rules rules_of(const struct job *job, const struct stop_rules *rules)
{
    struct stop_rules out = *rules;
    int more = rules->has_target || rules->time_limit_ms > 0 || rules->core_limit_ms > 0;

    out.spp_min = job->cut_count == 0 ? job->settings.spp : job->stop.spp_min;
    out.adaptive = more && (!stop_has_rounds(&job->stop) || job->stop.adaptive);
    if (!stop_has_rounds(&out))
        out.spp_min = 0; /* every pixel gets the cap */
    return out;
}

status farm_extend(struct farm *farm, struct job *job, uint32_t spp, const struct stop_rules *rules,
                   struct error *err)
{
    struct stop_rules before = job->stop;
    uint32_t spp_before = job->settings.spp;
    uint64_t floor_before = job->epoch_floor;
    status s = check_state(job, err);

    if (spp == 0)
        spp = SETTINGS_SPP_MAX;
    if (s == STATUS_OK)
        s = check_release(job, err);
    if (s == STATUS_OK)
        s = check_films(farm, job, err);
    if (s == STATUS_OK)
        s = check_rules(job, spp, rules, err);
    if (s == STATUS_OK)
        s = farm_store_usable(farm, err);
    if (s == STATUS_OK)
        s = job_reopen_check(&farm->queue, err);
    if (s != STATUS_OK)
        return s;
    job->stop = rules_of(job, rules);
    job->settings.spp = spp;
    job->epoch_floor = farm->leases.epoch + 1; /* a short pass of the old cap is another unit now */
    if (farm->store)
        s = store_job_extend(farm->store, job, err);
    if (s != STATUS_OK) {
        job->stop = before;
        job->settings.spp = spp_before;
        job->epoch_floor = floor_before;
        return s;
    }
    job_reopen(&farm->queue, job);
    log_info("job %llu (%s) is extended", id_of(job), job->name);
    farm->pump_wanted = 1;
    farm->events.job_changed(farm->events.user, job);
    return STATUS_OK;
}
