#include "coordinator/frame/preview.h"

#include <assert.h>

#include "common/system/clock.h"
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
static int has_rested(const struct preview *p, uint64_t now_ns)
{
    uint64_t rest_ns = PREVIEW_COSTS * p->cost_ns;

    if (rest_ns < PREVIEW_LEAST_MS * NS_PER_MS)
        rest_ns = PREVIEW_LEAST_MS * NS_PER_MS;
    return now_ns - p->made_ns >= rest_ns;
}

static int has_doubled(const struct preview *p, const struct preview_now *now)
{
    return now->samples >= 2 * p->samples;
}

int preview_is_due(const struct preview *p, const struct preview_now *now)
{
    if (now->samples == 0 || p->too_large || !preview_is_watched(p, now->now_ns))
        return 0;
    if (p->file && p->samples == now->samples && p->revision == now->revision)
        return 0;
    return has_rested(p, now->now_ns) || (fits(p, now) && p->covered < 1 && has_doubled(p, now));
}

/* A PNG that is watched is kept up to date, and sent at once. */
int preview_is_good(const struct preview *p, enum preview_kind kind, const struct preview_now *now)
{
    if (!fits(p, now))
        return 0;
    if (p->covered < 1 && has_doubled(p, now))
        return 0;
    return kind == PREVIEW_PNG || !has_rested(p, now->now_ns) || p->samples == now->samples;
}

void preview_age(struct preview *p, uint64_t now_ns)
{
    if (!preview_is_watched(p, now_ns))
        preview_release(p);
}
