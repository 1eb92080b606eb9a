#include "coordinator/job/preview.h"

#include <assert.h>

#include "common/base/clock.h"
#include "common/base/memory.h"

struct preview_file *preview_file_new(struct buffer *bytes)
{
    struct preview_file *file = mem_alloc(sizeof *file);

    if (!file) {
        buffer_release(bytes);
        return NULL;
    }
    *file = (struct preview_file){.bytes = *bytes, .holders = 1};
    buffer_init(bytes);
    return file;
}

struct preview_file *preview_file_hold(struct preview_file *file)
{
    file->holders++;
    return file;
}

void preview_file_drop(struct preview_file *file)
{
    if (!file)
        return;
    assert(file->holders > 0);
    if (--file->holders > 0)
        return;
    buffer_release(&file->bytes);
    mem_free(file);
}

void preview_release(struct preview *p)
{
    preview_file_drop(p->file);
    p->file = NULL;
}

int preview_is_watched(const struct preview *p, uint64_t now_ns)
{
    return p->asked_ns && now_ns - p->asked_ns < PREVIEW_WATCHED_MS * NS_PER_MS;
}

/* It shows this film, developed as the job wants it. */
static int fits(const struct preview *p, const struct preview_now *now)
{
    return p->file && p->revision == now->revision && p->samples <= now->samples;
}

/* Has it been long enough, for what it costs? */
static int has_rested(const struct preview *p, uint32_t costs, uint64_t now_ns)
{
    uint64_t rest_ns = costs * p->cost_ns;

    if (rest_ns < PREVIEW_LEAST_MS * NS_PER_MS)
        rest_ns = PREVIEW_LEAST_MS * NS_PER_MS;
    return now_ns - p->made_ns >= rest_ns;
}

static int has_doubled(const struct preview *p, const struct preview_now *now)
{
    return now->samples >= 2 * p->samples;
}

int preview_is_due(const struct preview *p, enum preview_kind kind, const struct preview_now *now)
{
    int watched = preview_is_watched(p, now->now_ns);

    if (now->samples == 0 || p->too_large || (kind == PREVIEW_EXR && !watched))
        return 0;
    if (p->made_ns == 0)
        return now->covered * PREVIEW_FIRST_SHARE >= 1;
    if (p->file && p->samples == now->samples && p->revision == now->revision)
        return 0;
    if (!fits(p, now))
        return has_rested(p, PREVIEW_COSTS_WATCHED, now->now_ns);
    if (watched && p->covered < 1 && has_doubled(p, now))
        return 1;
    if (watched)
        return has_rested(p, PREVIEW_COSTS_WATCHED, now->now_ns);
    return has_rested(p, PREVIEW_COSTS, now->now_ns) &&
           now->samples - p->samples >= p->samples / 4;
}

/* A PNG is kept up to date. An EXR is only while it is asked for. */
int preview_is_good(const struct preview *p, enum preview_kind kind, const struct preview_now *now)
{
    if (!fits(p, now))
        return 0;
    if (p->covered < 1 && has_doubled(p, now))
        return 0;
    return kind == PREVIEW_PNG || !has_rested(p, PREVIEW_COSTS_WATCHED, now->now_ns) ||
           p->samples == now->samples;
}

void preview_age(struct preview *p, enum preview_kind kind, uint64_t now_ns)
{
    if (kind == PREVIEW_EXR && !preview_is_watched(p, now_ns))
        preview_release(p);
}
