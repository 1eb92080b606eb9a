#include "coordinator/frame/frame.h"

#include <assert.h>

#include "common/base/memory.h"
#include "common/tonemap/tonemap.h"
#include "coordinator/frame/spread.h"

enum { BUCKETS_MIN = 64, BUCKETS_MAX = 1 << 16 };

struct job_frame *job_frame_new(struct job *job, uint32_t number, uint32_t width, uint32_t height, uint32_t spp,
                                uint32_t aovs, struct film_file *file)
{
    struct job_frame *frame = mem_calloc(1, sizeof *frame);
    uint32_t tiles = tile_count(width, height);
    uint32_t buckets = BUCKETS_MIN;

    if (!frame)
        return NULL;
    while (buckets < BUCKETS_MAX && buckets < tiles)
        buckets *= 2;
    frame->job = job;
    frame->number = number;
    frame->bucket_mask = buckets - 1;
    frame->film = film_new_aovs(width, height, spp, aovs);
    frame->buckets = mem_calloc(buckets, sizeof(struct unit *));
    frame->spread = mem_alloc_array(tiles, sizeof *frame->spread);
    frame->durable = mem_calloc(tiles, sizeof *frame->durable);
    frame->dirty_mark = mem_calloc(tiles, 1);
    frame->dirty = mem_calloc(tiles, sizeof *frame->dirty);
    frame->shown = mem_calloc(tiles, sizeof *frame->shown);
    if (!frame->film || !frame->buckets || !frame->spread || !frame->durable || !frame->dirty_mark || !frame->dirty ||
        !frame->shown) {
        job_frame_free(frame);
        return NULL;
    }
    film_measure_from(frame->film, rounds_measure_from(&job->stop, &job->schedule, spp));
    spread_order(width, height, frame->spread);
    frame->file = file;
    return frame;
}

status job_frame_begin(struct job_frame *frame, struct error *err)
{
    status s = rounds_init(&frame->rounds, frame->film, &frame->job->stop, &frame->job->schedule, err);

    job_frame_wish(frame);
    for (uint32_t i = 0; i < film_tile_count(frame->film); i++)
        frame->shown[i] = film_tile_samples(frame->film, i);
    return s;
}

void job_frame_free(struct job_frame *frame)
{
    if (!frame)
        return;
    assert(frame->in_flight == 0);
    while (frame->oldest) {
        assert(frame->oldest->holder_count == 0);
        job_frame_unit_settle(frame, frame->oldest);
    }
    film_file_close(frame->file);
    eta_release(&frame->eta);
    for (int kind = 0; kind < PREVIEW_KINDS; kind++)
        preview_release(&frame->previews[kind]);
    for (uint32_t g = 0; g < GROUPS; g++)
        tonemap_pixels_free(frame->display[g]);
    rounds_release(&frame->rounds);
    mem_free(frame->acks);
    mem_free(frame->shown);
    mem_free(frame->dirty);
    mem_free(frame->dirty_mark);
    buffer_release(&frame->journal);
    mem_free(frame->durable);
    mem_free(frame->spread);
    mem_free(frame->buckets);
    mem_free(frame->returned);
    film_free(frame->film);
    mem_free(frame);
}

void job_frame_set_state(struct job_frame *frame, enum frame_state state)
{
    assert((frame->state == FRAME_RENDERING && state == FRAME_COMPLETE) ||
           (frame->state == FRAME_COMPLETE && state == FRAME_DEVELOPING) ||
           (frame->state == FRAME_DEVELOPING && state == FRAME_COMPLETE));
    assert(frame->end != FRAME_END_NONE);
    frame->state = state;
}

uint64_t job_frame_active_ns(const struct job_frame *frame, uint64_t now_ns)
{
    return frame->clock.active_ns + (frame->begun_ns && now_ns > frame->begun_ns ? now_ns - frame->begun_ns : 0);
}

uint64_t job_frame_cpu_ns(const struct job_frame *frame) { return frame->clock.cpu_ns + frame->stats.cpu_ns; }

/* ---- the pool of units that no lease holds --------------------------------------------------- */

/* Are the tiles of this pass lent in the order of spread.h? Of the others neighbours are lent together. */
static int is_spread(struct unit_name name) { return name.pass == 0 && name.group == 0; }

static struct unit_name unit_at(const struct job_frame *frame, struct unit_name cursor)
{
    if (is_spread(cursor))
        cursor.tile = frame->spread[cursor.tile];
    return cursor;
}

static uint32_t rank_in_pass(const struct job_frame *frame, struct unit_name name)
{
    return is_spread(name) ? spread_rank(film_width(frame->film), film_height(frame->film), name.tile) : name.tile;
}

static int name_before(const struct job_frame *frame, struct unit_name a, struct unit_name b)
{
    if (a.pass != b.pass)
        return a.pass < b.pass;
    return a.group != b.group ? a.group < b.group : rank_in_pass(frame, a) < rank_in_pass(frame, b);
}

void job_frame_wish(struct job_frame *frame)
{
    frame->returned_count = 0; /* the cursor will reach them again */
    frame->cursor = frame->early = (struct unit_name){0, 0, 0};
    frame->cursor_left = film_wanted(frame->film);
}

void job_frame_return(struct job_frame *frame, struct unit_name name)
{
    size_t i = frame->returned_count;

    if (!MEM_GROW(frame->returned, frame->returned_capacity, i + 1)) {
        job_frame_wish(frame);
        return;
    }
    frame->returned_count++;
    while (i > 0 && name_before(frame, name, frame->returned[(i - 1) / 2])) {
        frame->returned[i] = frame->returned[(i - 1) / 2];
        i = (i - 1) / 2;
    }
    frame->returned[i] = name;
}

static struct unit_name returned_pop(struct job_frame *frame)
{
    struct unit_name *heap = frame->returned;
    struct unit_name top = heap[0], last = heap[--frame->returned_count];
    size_t i = 0, count = frame->returned_count;

    for (;;) {
        size_t child = 2 * i + 1;
        if (child >= count)
            break;
        if (child + 1 < count && name_before(frame, heap[child + 1], heap[child]))
            child++;
        if (!name_before(frame, heap[child], last))
            break;
        heap[i] = heap[child];
        i = child;
    }
    heap[i] = last;
    return top;
}

/* Is the unit neither lent nor merged? */
static int unit_is_free(const struct job_frame *frame, struct unit_name name)
{
    return !film_has(frame->film, name.tile, name.group, name.pass) && !job_frame_unit_find(frame, name);
}

static void cursor_advance(const struct job_frame *frame, struct unit_name *c)
{
    if (++c->tile < film_tile_count(frame->film))
        return;
    c->tile = 0;
    if (++c->group < GROUPS)
        return;
    c->group = 0;
    c->pass++;
}

static int is_wanted(const struct job_frame *frame, struct unit_name name)
{
    return name.pass < film_tile_wanted(frame->film, name.tile, name.group);
}

int job_frame_take(struct job_frame *frame, struct unit_name *out)
{
    const struct film *film = frame->film;

    while (frame->returned_count > 0) {
        *out = returned_pop(frame);
        if (is_wanted(frame, *out) && unit_is_free(frame, *out))
            return 1;
    }
    while (frame->cursor_left > 0) {
        *out = unit_at(frame, frame->cursor);
        if (!is_wanted(frame, *out)) {
            cursor_advance(frame, &frame->cursor);
            continue;
        }
        if (out->pass >= film_tile_seen(film, out->tile, out->group) +
                             (uint32_t)(film_is_frozen(film, out->group) ? FRAME_PASSES_AHEAD : FRAME_PASSES_UNFROZEN))
            return 0;
        cursor_advance(frame, &frame->cursor);
        frame->cursor_left--;
        if (unit_is_free(frame, *out))
            return 1;
    }
    return 0;
}

int job_frame_take_early(struct job_frame *frame, struct unit_name *out)
{
    uint32_t ahead[GROUPS], most = 0;

    for (uint32_t g = 0; g < GROUPS; g++) {
        ahead[g] = rounds_ahead(&frame->rounds, frame->film, g);
        most = ahead[g] > most ? ahead[g] : most;
    }
    while (frame->early.pass < most) {
        *out = unit_at(frame, frame->early);
        cursor_advance(frame, &frame->early);
        if (out->pass < ahead[out->group] && !is_wanted(frame, *out) && unit_is_free(frame, *out))
            return 1;
    }
    return 0;
}

uint64_t job_frame_unleased(const struct job_frame *frame) { return frame->returned_count + frame->cursor_left; }

int job_frame_has_unit(const struct job_frame *frame, struct unit_name name)
{
    return name.tile < film_tile_count(frame->film) && name.group < GROUPS &&
           name.pass < film_pass_count(frame->film, name.group);
}

int job_frame_is_watched(const struct job_frame *frame, struct unit_name name)
{
    return name.pass >= film_tile_passes(frame->film, name.tile, name.group) &&
           name.pass < film_tile_seen(frame->film, name.tile, name.group);
}

int job_frame_is_settled(const struct job_frame *frame, struct unit_name name)
{
    return name.pass < frame->durable[name.tile][name.group] || job_frame_is_watched(frame, name);
}

uint64_t job_frame_unit_samples(const struct job_frame *frame, struct unit_name name)
{
    struct tile_rect rect = tile_rect_of(film_width(frame->film), film_height(frame->film), name.tile);
    uint32_t begin, end;

    pass_range(film_spp(frame->film), name.group, name.pass, &begin, &end);
    return (uint64_t)rect.width * rect.height * (end - begin);
}

/* ---- outstanding units ----------------------------------------------------------------------- */

static struct unit **bucket_of(const struct job_frame *frame, struct unit_name name)
{
    uint32_t hash = name.tile * 0x9e3779b1u ^ (name.pass * GROUPS + name.group) * 0x85ebca77u;

    return &frame->buckets[(hash ^ hash >> 16) & frame->bucket_mask];
}

static int names_equal(struct unit_name a, struct unit_name b)
{
    return a.tile == b.tile && a.group == b.group && a.pass == b.pass;
}

struct unit *job_frame_unit_find(const struct job_frame *frame, struct unit_name name)
{
    struct unit *unit = *bucket_of(frame, name);

    while (unit && !names_equal(unit->name, name))
        unit = unit->chain;
    return unit;
}

static void age_remove(struct job_frame *frame, struct unit *unit)
{
    *(unit->older ? &unit->older->newer : &frame->oldest) = unit->newer;
    *(unit->newer ? &unit->newer->older : &frame->newest) = unit->older;
}

static void age_append(struct job_frame *frame, struct unit *unit)
{
    unit->older = frame->newest;
    unit->newer = NULL;
    *(frame->newest ? &frame->newest->newer : &frame->oldest) = unit;
    frame->newest = unit;
}

/* Many workers hold many units: longer chains would cost more with each. Without memory they do. */
static void buckets_grow(struct job_frame *frame)
{
    struct unit **old = frame->buckets;
    uint32_t count = frame->bucket_mask + 1;
    struct unit **more = count < UNIT_BUCKETS_MAX ? mem_calloc(2 * (size_t)count, sizeof(struct unit *)) : NULL;

    if (!more)
        return;
    frame->buckets = more;
    frame->bucket_mask = 2 * count - 1;
    mem_free(old);
    for (struct unit *unit = frame->oldest; unit; unit = unit->newer) {
        struct unit **bucket = bucket_of(frame, unit->name);
        unit->chain = *bucket;
        *bucket = unit;
    }
}

status job_frame_unit_lend(struct job_frame *frame, struct unit_name name, struct lease *lease, uint64_t now_ns)
{
    struct unit *unit = job_frame_unit_find(frame, name);
    int added = 0;

    if (unit) {
        if (unit->holder_count == UNIT_HOLDERS_MAX)
            return STATUS_ERR_LIMIT;
        age_remove(frame, unit);
    } else {
        struct unit **bucket = bucket_of(frame, name);
        unit = mem_calloc(1, sizeof *unit);
        if (!unit)
            return STATUS_ERR_NO_MEMORY;
        unit->name = name;
        unit->chain = *bucket;
        *bucket = unit;
        added = 1;
        frame->outstanding_count++;
    }
    unit->holders[unit->holder_count++] = lease;
    unit->granted_ns = now_ns;
    age_append(frame, unit);
    if (added && frame->outstanding_count > 2 * frame->bucket_mask)
        buckets_grow(frame);
    return STATUS_OK;
}

void job_frame_unit_settle(struct job_frame *frame, struct unit *unit)
{
    struct unit **at = bucket_of(frame, unit->name);

    while (*at != unit)
        at = &(*at)->chain;
    *at = unit->chain;
    age_remove(frame, unit);
    frame->outstanding_count--;
    mem_free(unit);
}

void job_frame_unit_drop(struct job_frame *frame, struct unit *unit, struct lease *lease)
{
    struct unit_name name = unit->name;

    for (uint32_t i = 0; i < unit->holder_count; i++) {
        if (unit->holders[i] == lease) {
            unit->holders[i] = unit->holders[--unit->holder_count];
            break;
        }
    }
    if (unit->holder_count > 0)
        return;
    job_frame_unit_settle(frame, unit);
    job_frame_return(frame, name);
}

/* ---- what waits for the disk ----------------------------------------------------------------- */

static int tile_is_durable(const struct job_frame *frame, uint32_t tile)
{
    for (uint32_t g = 0; g < GROUPS; g++)
        if (frame->durable[tile][g] != film_tile_passes(frame->film, tile, g))
            return 0;
    return 1;
}

int job_frame_is_durable(const struct job_frame *frame)
{
    for (uint32_t i = 0; i < film_tile_count(frame->film); i++)
        if (!tile_is_durable(frame, i))
            return 0;
    return 1;
}

void job_frame_mark_folded(struct job_frame *frame, uint64_t now_ns)
{
    for (uint32_t i = 0; i < film_tile_count(frame->film); i++)
        if (!tile_is_durable(frame, i))
            job_frame_mark_dirty(frame, i, now_ns);
}

void job_frame_mark_dirty(struct job_frame *frame, uint32_t tile, uint64_t now_ns)
{
    frame->shown[tile] = film_tile_samples(frame->film, tile);
    if (frame->dirty_mark[tile] & FRAME_TILE_DIRTY)
        return;
    if (frame->dirty_count == 0)
        frame->dirty_since_ns = now_ns;
    frame->dirty_mark[tile] |= FRAME_TILE_DIRTY;
    frame->dirty[frame->dirty_count++] = tile;
}

/* Without memory for it, the tile goes to the disk as a whole. */
static void journal_fold(void *user, const struct film_fold *fold)
{
    struct job_frame *frame = user;

    if (!film_record_unit(&frame->journal, fold))
        frame->dirty_mark[fold->unit->tile] |= FRAME_TILE_WHOLE;
}

void job_frame_keep_journal(struct job_frame *frame) { film_on_fold(frame->film, journal_fold, frame); }

status job_frame_await_ack(struct job_frame *frame, struct pending_ack ack, struct error *err)
{
    if (frame->ack_count >= FRAME_ACKS_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "frame %u: %d results wait for the disk", frame->number,
                         FRAME_ACKS_MAX);
    NEED(MEM_GROW(frame->acks, frame->ack_capacity, frame->ack_count + 1), err, "acknowledgements");
    frame->acks[frame->ack_count++] = ack;
    return STATUS_OK;
}
