#include "coordinator/steering/owner_room.h"

#include <string.h>

#include "common/base/bytes_text.h"
#include "common/base/memory.h"
#include "coordinator/steering/collect.h"

void owner_room_release(struct owner_room *room)
{
    mem_free(room->ended);
    mem_free(room->users);
    *room = (struct owner_room){0};
}

/* Note one of the owner's jobs. Returns the most that its films and pictures take, where they stay. */
static uint64_t add_job(struct owner_room *room, const struct job *job, int evicts, int films_stay,
                        const struct footprint *footprint)
{
    const struct job_footprint *row = footprint_find(footprint, job->id);
    uint64_t estimated = retention_job_bytes(job, films_stay), measured = row ? row->films + row->pictures : 0;

    room->users[room->user_count++] = collect_user(job);
    if (!job_state_ended(job->state)) {
        room->promised += estimated;
        return 0;
    }
    if (evicts)
        return 0;
    room->ended[room->ended_count++] = job->id;
    return measured > estimated ? measured : estimated; /* it may have ended after the footprint was measured */
}

status owner_room_init(struct owner_room *room, const struct farm *farm, const struct retention_policy *policy,
                       const struct footprint *footprint, uint64_t blobs_most, const struct job *job, uint64_t estimate,
                       uint64_t limit, struct error *err)
{
    const struct queue *queue = &farm->queue;
    const int evicts = retention_makes_room(policy) || policy->owner_limit > 0;
    const int films_stay = !evicts && !farm->discards_films;
    uint64_t most = 0;

    *room = (struct owner_room){0};
    if (limit == 0)
        return STATUS_OK;
    room->ended = mem_calloc(queue->count + 1, sizeof *room->ended);
    room->users = mem_calloc(queue->count + 1, sizeof *room->users);
    if (!room->ended || !room->users) {
        owner_room_release(room);
        return error_no_memory(err, "the jobs of an owner");
    }
    room->limit = limit;
    room->needed = retention_job_bytes(job, films_stay);
    memcpy(room->owner, job->owner, sizeof room->owner);
    room->users[room->user_count++] = collect_user(job);
    for (size_t i = 0; i < queue->count; i++)
        if (strcmp(queue->all[i]->owner, job->owner) == 0 && queue->all[i]->id != estimate)
            most += add_job(room, queue->all[i], evicts, films_stay, footprint);
    most += room->needed + room->promised;
    if (most <= limit && blobs_most <= limit - most)
        owner_room_release(room);
    return STATUS_OK;
}

/* What the films and pictures of the jobs that have ended take. */
static status measure_ended(const struct owner_room *room, const char *folder, uint64_t *bytes, struct error *err)
{
    struct footprint now = {0};
    status s = room->ended_count > 0 ? footprint_measure(&now, folder, err) : STATUS_OK;

    *bytes = 0;
    for (size_t i = 0; i < room->ended_count && s == STATUS_OK; i++) {
        const struct job_footprint *row = footprint_find(&now, room->ended[i]);
        *bytes += row ? row->films + row->pictures : 0;
    }
    footprint_release(&now);
    return s;
}

status owner_room_check(const struct owner_room *room, const char *folder, struct error *err)
{
    char need[BYTES_TEXT_SIZE], has[BYTES_TEXT_SIZE], scenes[BYTES_TEXT_SIZE], limit[BYTES_TEXT_SIZE];
    uint64_t kept = 0, blobs = 0;

    if (room->limit == 0)
        return STATUS_OK;
    TRY(measure_ended(room, folder, &kept, err));
    TRY(sweep_bytes(room->users, room->user_count, folder, &blobs, err));
    kept += room->promised;
    if (kept + room->needed + blobs <= room->limit)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_LIMIT,
                     "the job needs about %s, %s has jobs for %s, their scenes and its own take %s, and %s are allowed to an "
                     "owner with the role submit (--submit-jobs): remove jobs ('azulejo prune --mine'), or submit fewer or "
                     "smaller frames",
                     bytes_text(need, room->needed), room->owner[0] ? room->owner : "this owner", bytes_text(has, kept),
                     bytes_text(scenes, blobs), bytes_text(limit, room->limit));
}
