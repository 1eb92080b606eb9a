#include "client/farm/owners.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "client/terminal/must.h"
#include "client/terminal/table.h"
#include "common/base/memory.h"
#include "common/film/tiles.h"
#include "protocol/message.h"

/* ---- colours --------------------------------------------------------------------------------- */

/* Red, green and blue, then colours of Okabe and Ito's set for all eyes that differ from these. */
static const struct {
    const char *word;
    uint8_t rgb[3];
} palette[] = {
    {"red", {214, 45, 45}},        {"green", {46, 160, 67}},   {"blue", {44, 92, 214}},
    {"orange", {230, 159, 0}},     {"sky blue", {86, 180, 233}}, {"yellow", {240, 228, 66}},
    {"pink", {204, 121, 167}},     {"white", {235, 235, 235}}, {"brown", {133, 88, 48}},
};
enum { PALETTE = sizeof palette / sizeof *palette };
static const uint8_t unknown_color[3] = {128, 128, 128};

/* Towards white (1) or black (-1). */
static void shade(uint8_t color[3], double by)
{
    for (int i = 0; i < 3; i++)
        color[i] = (uint8_t)(by >= 0 ? color[i] + (255 - color[i]) * by + 0.5 : color[i] * (1 + by) + 0.5);
}

/* The n-th worker: the palette's colours, then dark ones, then pale ones, then these again. */
static void choose_color(struct owners_worker *worker, uint32_t n)
{
    static const struct {
        const char *word;
        double by;
    } rounds[] = {{"", 0}, {"dark ", -0.45}, {"pale ", 0.5}};
    uint32_t round = n / PALETTE % 3;

    memcpy(worker->color, palette[n % PALETTE].rgb, 3);
    shade(worker->color, rounds[round].by);
    snprintf(worker->color_words, sizeof worker->color_words, "%s%s", rounds[round].word, palette[n % PALETTE].word);
}

void owners_thread_color(const struct owners_worker *worker, uint32_t thread, uint8_t out[3])
{
    static const double shades[] = {0, 0.25, -0.2, 0.4, -0.32, 0.12, -0.1, 0.33};

    memcpy(out, worker->color, 3);
    if (thread > 0)
        shade(out, shades[(thread - 1) % (sizeof shades / sizeof *shades)]);
}

/* ---- the answer ------------------------------------------------------------------------------ */

static void name_worker(struct owners_worker *worker)
{
    char text[OWNERS_NAME_MAX - 32];

    if (worker->wire && worker->wire->name[0])
        snprintf(worker->name, sizeof worker->name, "%s", message_text(text, sizeof text, worker->wire->name));
    else if (worker->wire && worker->wire->host[0])
        snprintf(worker->name, sizeof worker->name, "%s, process %" PRIu32,
                 message_text(text, sizeof text, worker->wire->host), worker->wire->process);
    else
        snprintf(worker->name, sizeof worker->name, "not known");
}

static int by_name(const void *one, const void *other)
{
    const struct owners_worker *a = one, *b = other;
    int names = strverscmp(a->name, b->name);

    if (!a->wire != !b->wire)
        return a->wire ? -1 : 1; /* what is not known comes last */
    return names ? names : (a->place > b->place) - (a->place < b->place);
}

static struct owners_worker *worker_at(const struct owners *o, uint32_t place)
{
    for (uint32_t i = 0; i < o->worker_count; i++)
        if (o->workers[i].place == place)
            return &o->workers[i];
    return NULL;
}

static void count_share(struct owners_worker *worker, const Azulejo__Wire__FrameShare *share, uint32_t pixels)
{
    uint32_t thread = share->thread < OWNERS_THREADS_MAX ? share->thread : 0;
    uint8_t *bits = &worker->threads[thread / 8], bit = (uint8_t)(1 << thread % 8);

    worker->units += share->units;
    worker->samples += (uint64_t)share->samples * pixels;
    worker->thread_count += !(*bits & bit);
    *bits |= bit;
}

static void count_tile(struct owners *o, uint32_t i)
{
    const Azulejo__Wire__FrameTile *tile = o->map->tiles[i];
    struct tile_rect rect = tile_rect_of(o->map->width, o->map->height, i);
    uint64_t units = 0;

    if (tile->n_shares == 0) {
        o->tiles_empty++;
        return;
    }
    worker_at(o, tile->shares[0]->worker)->tiles++;
    for (size_t k = 0; k < tile->n_shares; k++) {
        units += tile->shares[k]->units;
        count_share(worker_at(o, tile->shares[k]->worker), tile->shares[k], rect.width * rect.height);
        if (k > 0 && tile->shares[k]->worker != tile->shares[0]->worker &&
            tile->shares[k - 1]->worker == tile->shares[0]->worker)
            o->tiles_shared++;
    }
    o->tiles_cut += units < tile->units;
}

static int is_valid(const Azulejo__Wire__FrameTiles *map)
{
    if (map->width == 0 || map->width > SETTINGS_SIZE_MAX || map->height == 0 || map->height > SETTINGS_SIZE_MAX ||
        map->n_tiles != tile_count(map->width, map->height) || map->n_workers > map->n_tiles * GROUPS * PASSES_MAX)
        return 0;
    for (size_t i = 0; i < map->n_tiles; i++)
        for (size_t k = 0; k < map->tiles[i]->n_shares; k++)
            if (map->tiles[i]->shares[k]->worker > map->n_workers)
                return 0;
    return 1;
}

/* Workers without a tile or a unit are left out: they rendered what others sent first. */
static void drop_idle_workers(struct owners *o)
{
    uint32_t kept = 0;

    for (uint32_t i = 0; i < o->worker_count; i++)
        if (o->workers[i].units > 0)
            o->workers[kept++] = o->workers[i];
    o->worker_count = kept;
}

status owners_take(struct owners *o, Azulejo__Wire__Envelope *answer, struct error *err)
{
    *o = (struct owners){.answer = answer, .map = answer->frame_tiles};
    if (!is_valid(o->map))
        return error_set(err, STATUS_ERR_PROTOCOL, "the coordinator sent tiles of no possible frame");
    o->workers = must(mem_calloc(o->map->n_workers + 1, sizeof *o->workers));
    o->worker_count = (uint32_t)o->map->n_workers + 1; /* the first one: not known */
    for (uint32_t i = 0; i < o->worker_count; i++) {
        o->workers[i].place = i;
        o->workers[i].wire = i > 0 ? o->map->workers[i - 1] : NULL;
        name_worker(&o->workers[i]);
    }
    for (uint32_t i = 0; i < o->map->n_tiles; i++)
        count_tile(o, i);
    drop_idle_workers(o);
    if (o->worker_count > 1)
        qsort(o->workers, o->worker_count, sizeof *o->workers, by_name);
    for (uint32_t i = 0; i < o->worker_count; i++) {
        o->samples += o->workers[i].samples;
        choose_color(&o->workers[i], i);
        if (!o->workers[i].wire) {
            memcpy(o->workers[i].color, unknown_color, sizeof unknown_color);
            snprintf(o->workers[i].color_words, sizeof o->workers[i].color_words, "grey");
        }
    }
    return STATUS_OK;
}

status owners_get(struct connection *c, uint64_t job, uint32_t frame, struct owners *out, struct error *err)
{
    Azulejo__Wire__FrameTilesGet get = AZULEJO__WIRE__FRAME_TILES_GET__INIT;
    Azulejo__Wire__Envelope question = MESSAGE(FRAME_TILES_GET, frame_tiles_get, &get), *answer = NULL;
    status result;

    *out = (struct owners){0};
    get.job = job;
    get.frame = frame;
    get.shares = 1;
    result = connection_ask(c, &question, AZULEJO__WIRE__ENVELOPE__BODY_FRAME_TILES, &answer, err);
    return result == STATUS_OK ? owners_take(out, answer, err) : result;
}

void owners_release(struct owners *o)
{
    message_free(o->answer);
    mem_free(o->workers);
    *o = (struct owners){0};
}

const struct owners_worker *owners_of_tile(const struct owners *o, uint32_t tile, uint32_t *thread)
{
    const Azulejo__Wire__FrameTile *t = o->map->tiles[tile];

    *thread = t->n_shares > 0 ? t->shares[0]->thread : 0;
    return t->n_shares > 0 ? worker_at(o, t->shares[0]->worker) : NULL;
}

/* ---- for people ------------------------------------------------------------------------------ */

void owners_print(const struct owners *o)
{
    static const char *const titles[] = {"COLOUR", "<WORKER", ">THREADS", ">TILES", ">UNITS", ">SAMPLES"};
    struct table table;

    table_init(&table, titles, sizeof titles / sizeof *titles);
    for (uint32_t i = 0; i < o->worker_count; i++) {
        const struct owners_worker *w = &o->workers[i];
        table_add(&table, "%s", w->color_words);
        table_add(&table, "%s", w->name);
        table_add(&table, "%" PRIu32, w->thread_count);
        table_add(&table, "%" PRIu32, w->tiles);
        table_add(&table, "%" PRIu64, w->units);
        table_add(&table, "%.1f %%", o->samples ? 100.0 * (double)w->samples / (double)o->samples : 0.0);
    }
    printf("job %" PRIu64 ", frame %u: %u x %u tiles, %u worker%s\n", o->map->job, o->map->frame,
           tiles_across(o->map->width), tiles_across(o->map->height), o->worker_count, o->worker_count == 1 ? "" : "s");
    table_print(&table);
    table_release(&table);
    if (o->tiles_shared > 0)
        printf("%u tile%s shared: a tile is counted for the worker with the most samples of it\n", o->tiles_shared,
               o->tiles_shared == 1 ? " is" : "s are");
    if (o->tiles_cut > 0)
        printf("of %u tile%s only the largest shares were sent: units and samples are too few\n", o->tiles_cut,
               o->tiles_cut == 1 ? "" : "s");
    if (o->tiles_empty > 0)
        printf("%u tile%s no samples yet\n", o->tiles_empty, o->tiles_empty == 1 ? " has" : "s have");
}

/* ---- for programs ---------------------------------------------------------------------------- */

static json_t *color_json(const uint8_t color[3])
{
    return json_sprintf("#%02x%02x%02x", color[0], color[1], color[2]);
}

static json_t *thread_json(uint32_t thread) { return thread > 0 ? json_integer((json_int_t)thread) : json_null(); }

static json_t *worker_name_json(const struct owners_worker *worker)
{
    return worker && worker->wire ? json_text(worker->name) : json_null();
}

static json_t *worker_json(const struct owners *o, const struct owners_worker *w)
{
    json_t *threads = json_array();

    for (uint32_t t = 1; t < OWNERS_THREADS_MAX; t++)
        if (w->threads[t / 8] >> t % 8 & 1)
            json_array_append_new(threads, json_integer((json_int_t)t));
    return json_pack("{s:o, s:o, s:o, s:o, s:s, s:o, s:I, s:I, s:I, s:f}", "name", worker_name_json(w), "host",
                     w->wire ? json_text(w->wire->host) : json_null(), "process",
                     w->wire ? json_integer((json_int_t)w->wire->process) : json_null(), "color", color_json(w->color),
                     "color_name", w->color_words, "threads", threads, "tiles", (json_int_t)w->tiles, "units",
                     (json_int_t)w->units, "samples", (json_int_t)w->samples, "samples_share",
                     o->samples ? (double)w->samples / (double)o->samples : 0.0);
}

static json_t *shares_json(const struct owners *o, const Azulejo__Wire__FrameTile *tile)
{
    json_t *shares = json_array();

    for (size_t i = 0; i < tile->n_shares; i++) {
        const Azulejo__Wire__FrameShare *s = tile->shares[i];
        json_array_append_new(shares,
                              json_pack("{s:o, s:o, s:I, s:I}", "worker", worker_name_json(worker_at(o, s->worker)),
                                        "thread", thread_json(s->thread), "units", (json_int_t)s->units, "samples",
                                        (json_int_t)s->samples));
    }
    return shares;
}

static json_t *tile_json(const struct owners *o, uint32_t i)
{
    const Azulejo__Wire__FrameTile *tile = o->map->tiles[i];
    struct tile_rect rect = tile_rect_of(o->map->width, o->map->height, i);
    uint32_t thread;
    const struct owners_worker *owner = owners_of_tile(o, i, &thread);
    uint8_t color[3];

    if (owner)
        owners_thread_color(owner, thread, color);
    return json_pack("{s:I, s:I, s:I, s:I, s:o, s:o, s:o, s:o, s:I, s:o, s:f, s:o}", "x", (json_int_t)rect.x, "y",
                     (json_int_t)rect.y, "width", (json_int_t)rect.width, "height", (json_int_t)rect.height, "worker",
                     worker_name_json(owner), "thread", thread_json(thread), "color",
                     owner ? color_json(color) : json_null(), "samples", json_number(tile->samples), "units",
                     (json_int_t)tile->units, "error", json_number(tile->error), "cpu_seconds",
                     (double)tile->cpu_ns / 1e9, "shares", shares_json(o, tile));
}

json_t *owners_json(const struct owners *o)
{
    json_t *workers = json_array(), *tiles = json_array();

    for (uint32_t i = 0; i < o->worker_count; i++)
        json_array_append_new(workers, worker_json(o, &o->workers[i]));
    for (uint32_t i = 0; i < o->map->n_tiles; i++)
        json_array_append_new(tiles, tile_json(o, i));
    return json_pack("{s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:o, s:o}", "job", (json_int_t)o->map->job, "frame",
                     (json_int_t)o->map->frame, "width", (json_int_t)o->map->width, "height",
                     (json_int_t)o->map->height, "tile_size", (json_int_t)TILE_SIZE, "tiles_x",
                     (json_int_t)tiles_across(o->map->width), "tiles_y", (json_int_t)tiles_across(o->map->height),
                     "workers", workers, "tiles", tiles);
}
