#include "coordinator/farm/distrusted.h"

#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "coordinator/farm/freeze.h"
#include "coordinator/farm/roster.h"
#include "protocol/worker_name.h"

/* ---- who -------------------------------------------------------------------------------------- */

static struct distrusted *find(const struct farm *farm, uint32_t number)
{
    for (size_t i = 0; i < farm->distrusted_count; i++)
        if (farm->distrusted[i].number == number)
            return &farm->distrusted[i];
    return NULL;
}

static status keep(void *user, const struct distrusted *who, struct error *err)
{
    struct farm *farm = user;
    struct distrusted *known = find(farm, who->number);

    if (known) {
        known->since = who->since < known->since ? who->since : known->since;
        return STATUS_OK;
    }
    NEED(MEM_GROW(farm->distrusted, farm->distrusted_capacity, farm->distrusted_count + 1), err, "whose results are not believed");
    farm->distrusted[farm->distrusted_count++] = *who;
    return STATUS_OK;
}

status distrusted_load(struct farm *farm, struct error *err)
{
    return store_distrusted_load(farm->store, keep, farm, err);
}

static status append(void *user, uint32_t number, struct error *err)
{
    struct buffer *numbers = user;

    buffer_append(numbers, &number, sizeof number);
    return buffer_ok(numbers) ? STATUS_OK : error_no_memory(err, "a worker's numbers");
}

status distrusted_numbers(const struct farm *farm, const char *label, struct buffer *numbers, struct error *err)
{
    status s = farm->store ? store_deliverers_of(farm->store, label, append, numbers, err) : STATUS_OK;

    for (uint32_t i = 0; i < farm->worker_count && s == STATUS_OK; i++)
        if (farm->workers[i]->deliverer.number && worker_label_is_of(farm->workers[i]->label, label))
            s = append(numbers, farm->workers[i]->deliverer.number, err);
    return s;
}

status distrusted_add(struct farm *farm, const struct buffer *numbers, int64_t since, struct error *err)
{
    for (size_t at = 0; at + sizeof(uint32_t) <= numbers->size; at += sizeof(uint32_t)) {
        struct distrusted who = {.since = since};
        const struct distrusted *known;
        memcpy(&who.number, numbers->data + at, sizeof who.number);
        for (uint32_t i = 0; i < farm->worker_count; i++)
            if (farm->workers[i]->deliverer.number == who.number)
                farm->workers[i]->deliverer.number = 0; /* what it delivers after an `unblock` counts */
        known = find(farm, who.number);
        if (known && known->since <= since)
            continue;
        TRY(keep(farm, &who, err));
        if (farm->store)
            TRY(store_distrust(farm->store, &who, err));
    }
    return STATUS_OK;
}

status distrusted_add_blocked(struct farm *farm, struct error *err)
{
    struct buffer numbers = BUFFER_INIT;
    status s = STATUS_OK;

    for (size_t i = 0; i < farm->roster.mark_count && s == STATUS_OK; i++)
        if (farm->roster.marks[i].blocked)
            s = distrusted_numbers(farm, farm->roster.marks[i].name, &numbers, err);
    THEN(s, distrusted_add(farm, &numbers, INT64_MAX, err));
    buffer_release(&numbers);
    return s;
}

int distrusted_has(const struct farm *farm, uint32_t deliverer, int64_t done_at)
{
    const struct distrusted *who = find(farm, deliverer);

    return who && done_at >= who->since;
}

void distrusted_label(const struct farm *farm, uint32_t deliverer, char out[WORKER_LABEL_MAX + 1])
{
    struct deliverer gone;

    out[0] = 0;
    for (uint32_t i = 0; i < farm->worker_count; i++)
        if (deliverer && farm->workers[i]->deliverer.number == deliverer)
            snprintf(out, WORKER_LABEL_MAX + 1, "%s", farm->workers[i]->label);
    if (!out[0] && deliverer && farm->store && store_deliverer_find(farm->store, deliverer, &gone, NULL) == STATUS_OK)
        snprintf(out, WORKER_LABEL_MAX + 1, "%s", gone.label);
}

/* ---- in films ----------------------------------------------------------------------------------- */

/* *first: also in pass 0 of a group. */
static int is_in_tile(const struct farm *farm, const struct film *film, uint32_t tile, int *first)
{
    int found = 0;

    for (uint32_t g = 0; g < GROUPS; g++)
        for (uint32_t p = 0; p < film_pass_count(film, g); p++) {
            uint32_t who = film_deliverer(film, tile, g, p);
            if (!who || !find(farm, who))
                continue;
            found = 1;
            *first |= p == 0;
        }
    return found;
}

static status empty_tile(struct job_frame *frame, uint32_t tile, struct error *err)
{
    TRY(film_file_empty_tile(frame->file, frame->film, tile, err));
    memset(frame->durable[tile], 0, sizeof frame->durable[tile]);
    return STATUS_OK;
}

status distrusted_take_out(const struct farm *farm, struct job_frame *frame, struct distrusted_loss *loss,
                           struct error *err)
{
    const uint32_t count = farm->distrusted_count > 0 ? film_tile_count(frame->film) : 0;
    int first = 0, measured;
    status s = STATUS_OK;

    *loss = (struct distrusted_loss){0};
    for (uint32_t t = 0; t < count; t++)
        loss->tiles += (uint32_t)is_in_tile(farm, frame->film, t, &first);
    if (loss->tiles == 0)
        return STATUS_OK;
    TRY(freeze_was_measured(frame, &measured, err));
    loss->part = stop_has_rounds(&frame->job->stop) || (first && measured) ? DISTRUSTED_ALL : DISTRUSTED_TILES;
    for (uint32_t t = 0; loss->part == DISTRUSTED_TILES && t < count && s == STATUS_OK; t++)
        if (is_in_tile(farm, frame->film, t, &first))
            s = empty_tile(frame, t, err);
    return s;
}
