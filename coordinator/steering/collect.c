#include "coordinator/steering/collect.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/bytes_text.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/steering/steer.h"
#include "coordinator/store/store_hold.h"

struct blob_user collect_user(const struct job *job)
{
    return (struct blob_user){.job = job->id,
                              .scene = job->scene,
                              .has_file = job->output.tonemap.has_file,
                              .file = job->output.tonemap.file};
}

status collect_users(const struct farm *farm, struct blob_user **users, size_t *count, struct error *err)
{
    const struct queue *queue = &farm->queue;

    *count = 0;
    *users = mem_calloc(queue->count ? queue->count : 1, sizeof **users);
    NEED(*users, err, "the jobs' blobs");
    for (size_t i = 0; i < queue->count; i++)
        (*users)[(*count)++] = collect_user(queue->all[i]);
    return STATUS_OK;
}

/* A disk with less is full: the store itself says so, and what to do. */
enum { ROOM_NONE_BYTES = 1 << 20 };

/* ---- the plan -------------------------------------------------------------------------------- */

/* Its films and pictures are in use, or its end is not on disk: after a crash now it would go on. */
static int is_busy(const struct farm *farm, const struct job *job, collect_read_fn *is_read, void *user)
{
    return job->to_develop || farm->developing == job || job->closing_frames > 0 || job->unsaved ||
           (job_state_ended(job->state) && store_job_unsaved(farm->store, job->id)) || is_read(user, job->id);
}

static int compare_users(const void *a, const void *b)
{
    uint64_t left = ((const struct blob_user *)a)->job, right = ((const struct blob_user *)b)->job;

    return (left > right) - (left < right);
}

/* Of a job that has not ended, only the films of done frames may be removed: about so many bytes. */
static uint64_t done_share(const struct job *job, uint64_t films)
{
    uint32_t open = 0;

    for (const struct job_frame *f = job->frames; f; f = f->next)
        open++;
    return job->frames_done_count
               ? (uint64_t)((double)films * job->frames_done_count / (job->frames_done_count + 2.0 * open))
               : 0;
}

status collect_plan(struct retention_plan *plan, const struct farm *farm, const struct retention_policy *policy,
                    const struct footprint *footprint, const struct blob_user *users, size_t user_count,
                    collect_read_fn *is_read, void *user, struct error *err)
{
    const struct queue *queue = &farm->queue;
    struct retention_job *jobs = mem_calloc(queue->count ? queue->count : 1, sizeof *jobs);
    struct blob_user *sorted = mem_calloc(user_count ? user_count : 1, sizeof *sorted);
    status s = jobs && sorted ? STATUS_OK : error_no_memory(err, "a plan of what to remove");

    if (s == STATUS_OK && user_count > 0) {
        memcpy(sorted, users, user_count * sizeof *sorted);
        qsort(sorted, user_count, sizeof *sorted, compare_users);
    }
    for (size_t i = 0; i < queue->count && s == STATUS_OK; i++) {
        const struct job *job = queue->all[i];
        const struct job_footprint *room = footprint_find(footprint, job->id);
        const struct blob_user key = {.job = job->id};
        const struct blob_user *blobs =
            user_count ? bsearch(&key, sorted, user_count, sizeof key, compare_users) : NULL;
        int ended = job_state_ended(job->state);

        jobs[i] = (struct retention_job){.job = job->id,
                                         .owner = job->owner,
                                         .ended = ended,
                                         .failed = job->state == JOB_STATE_FAILED ||
                                                   job->state == JOB_STATE_CANCELLED,
                                         .busy = is_busy(farm, job, is_read, user),
                                         .ended_at = job->finished_at,
                                         .films = room ? room->films : 0,
                                         .pictures = room ? room->pictures : 0,
                                         .blobs = blobs ? blobs->bytes : 0};
        if (!ended)
            jobs[i].films = done_share(job, jobs[i].films);
    }
    THEN(s, retention_make(plan, policy, jobs, queue->count, footprint_total(footprint),
                           room_limit_bytes(&policy->store, footprint->disk_bytes), farm->wall_s, err));
    mem_free(sorted);
    mem_free(jobs);
    return s;
}

int64_t collect_newest(const struct farm *farm, const struct retention_policy *policy, size_t *due)
{
    int64_t newest_s = 0;

    *due = 0;
    for (size_t i = 0; i < farm->queue.count; i++) {
        const struct job *job = farm->queue.all[i];
        int64_t keep_s = retention_keep_s(policy, job->state == JOB_STATE_FAILED || job->state == JOB_STATE_CANCELLED);
        int64_t last_s = job->finished_at > job->submitted_at ? job->finished_at : job->submitted_at;
        newest_s = last_s > newest_s ? last_s : newest_s;
        *due += job_state_ended(job->state) && keep_s > 0 && farm->wall_s - job->finished_at >= keep_s;
    }
    return newest_s;
}

/* ---- its steps ------------------------------------------------------------------------------- */

/* The kept films of done frames. */
static int remove_kept(struct farm *farm, const struct job *job)
{
    int removed = 0;

    for (uint64_t frame = job->first_frame; frame <= job->last_frame; frame++)
        if (job_frame_is_done(job, (uint32_t)frame) && !farm_frame_find(job, (uint32_t)frame))
            removed |= store_film_kept_remove(farm->store, job->id, (uint32_t)frame);
    return removed;
}

static void remove_films(struct farm *farm, const struct job *job, const char *why)
{
    if (job_state_ended(job->state))
        store_films_remove(farm->store, job->id);
    else if (!remove_kept(farm, job))
        return;
    log_info("job %" PRIu64 " (%s): its kept films are removed: %s", job->id, job->name, why);
    farm_note(farm, job, NULL, "its kept films are removed: %s", why);
}

static status take_step(struct farm *farm, struct job *job, int whole, const char *why, uint64_t now_ns,
                        struct error *err)
{
    uint64_t id = job->id;
    status s;

    if (!whole) {
        remove_films(farm, job, why);
        return STATUS_OK;
    }
    s = steer_remove(&(struct steering){.farm = farm, .job = job, .who = "the coordinator", .now_ns = now_ns}, err);
    if (s == STATUS_OK)
        log_info("job %" PRIu64 " was removed because %s", id, why);
    return s;
}

status collect_step(struct farm *farm, const struct retention_plan *plan, const struct retention_step *step,
                    const struct retention_policy *policy, collect_read_fn *is_read, void *user, uint64_t now_ns,
                    enum collect_result *result, struct error *err)
{
    struct job *job = queue_find(&farm->queue, step->job);
    char why[RETENTION_TEXT_MAX + 1];
    int hold = -1;
    status s;

    *result = COLLECT_NOTHING;
    if (!job || is_busy(farm, job, is_read, user) || (step->whole && !job_state_ended(job->state)))
        return STATUS_OK;
    retention_text(why, plan, step, policy);
    /* Only asked: store_job_clear takes it itself, and films alone are needed by no job. */
    s = store_hold_exclude(store_folder(farm->store), &hold, err);
    store_hold_end(hold);
    THEN(s, take_step(farm, job, step->whole, why, now_ns, err));
    if (s == STATUS_OK)
        *result = step->whole ? COLLECT_JOB : COLLECT_FILMS;
    return s;
}

/* ---- before a job is taken -------------------------------------------------------------------- */

static status check_owner(const struct farm *farm, const struct retention_policy *policy, const struct job *job,
                          uint64_t needed, struct error *err)
{
    char need[BYTES_TEXT_SIZE], limit[BYTES_TEXT_SIZE], others[BYTES_TEXT_SIZE];
    uint64_t promised = 0;

    for (size_t i = 0; i < farm->queue.active_count; i++)
        if (strcmp(farm->queue.active[i]->owner, job->owner) == 0)
            promised += retention_job_bytes(farm->queue.active[i], 0);
    if (policy->owner_limit == 0 || needed + promised <= policy->owner_limit)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_LIMIT,
                     "the job needs about %s, %s has jobs that have not ended for %s, and %s are allowed "
                     "(--owner-limit): submit fewer or smaller frames, or wait until a job has ended",
                     bytes_text(need, needed), job->owner[0] ? job->owner : "this owner", bytes_text(others, promised),
                     bytes_text(limit, policy->owner_limit));
}

/* What may be removed to make room. */
static uint64_t evictable(const struct farm *farm, const struct retention_policy *policy,
                          const struct footprint *footprint)
{
    uint64_t sum = 0;

    for (size_t i = 0; i < footprint->count && retention_makes_room(policy); i++) {
        const struct job *job = queue_find(&farm->queue, footprint->jobs[i].job);
        if (job && job_state_ended(job->state))
            sum += footprint->jobs[i].films + footprint->jobs[i].pictures;
    }
    return sum;
}

/* What a job may take when so many bytes of the disk are free. */
static uint64_t room_within(const struct farm *farm, const struct retention_policy *policy,
                            const struct footprint *footprint, uint64_t disk, uint64_t free_bytes)
{
    uint64_t limit = room_limit_bytes(&policy->store, disk), used = footprint_total(footprint);
    uint64_t allowed = limit == 0 ? UINT64_MAX : limit < used ? 0 : limit - used;

    return (allowed < free_bytes ? allowed : free_bytes) + evictable(farm, policy, footprint);
}

status collect_check_room(const struct farm *farm, const struct retention_policy *policy,
                          const struct footprint *footprint, const struct job *job, int force, struct error *err)
{
    char need[BYTES_TEXT_SIZE], there[BYTES_TEXT_SIZE];
    int films_stay = !retention_makes_room(policy) && !farm->discards_films;
    uint64_t needed = retention_job_bytes(job, films_stay), disk, left, room;
    struct error why = {0};
    status s = check_owner(farm, policy, job, retention_job_bytes(job, 0), err);

    if (s != STATUS_OK || force || footprint_disk(store_folder(farm->store), &disk, &left, &why) != STATUS_OK)
        return s;
    if (left < ROOM_NONE_BYTES)
        return s;
    room = room_within(farm, policy, footprint, disk, left);
    if (needed > room) /* what was removed last may be on its way; asked only now, since that walks a folder */
        room = room_within(farm, policy, footprint, disk, left + footprint_trash(store_folder(farm->store)));
    if (needed <= room)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_LIMIT,
                     "the job needs about %s on the coordinator's disk (%u frames of %u x %u "
                     "pixels%s), and %s are "
                     "there: submit fewer or smaller frames, remove jobs ('azulejo show --farm' "
                     "says what takes the "
                     "room), or give --force: it then waits whenever the disk is full",
                     bytes_text(need, needed), job_frames_wanted(job), job->settings.width, job->settings.height,
                     films_stay ? ", with their films" : "", bytes_text(there, room));
}
