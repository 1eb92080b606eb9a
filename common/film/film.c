#include "common/film/film.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"

/* A pass that arrived before the ones it must follow. */
struct waiting {
    struct waiting *next; /* ascending pass */
    uint32_t pass;
    uint64_t hash;
    float sums[];
};

struct film_tile {
    double *sums;        /* as tile_floats(); NULL until the first pass is folded in */
    uint64_t *hashes;    /* of the passes folded in */
    size_t hash_capacity;
    uint32_t passes;     /* folded in: a prefix of the schedule */
    uint32_t waiting_count;
    struct waiting *waiting;
    double error;        /* sum over pixels and channels of se^2 / (mean^2 + 0.01) */
    int error_known;     /* `error` belongs to the present sums */
};

struct film {
    uint32_t width, height, spp, aovs;
    uint32_t tiles_total, passes_total;
    struct film_tile *tiles;
    uint64_t samples;         /* folded in, over all pixels */
    uint32_t tiles_started;   /* with at least one pass */
    uint32_t tiles_complete;
};

enum {
    STATE_MAGIC = 0x325a5441, /* "ATZ2": 1 knew no AOVs */
    /* magic, passes, frame width, frame height, spp, tile, AOVs, 0 */
    STATE_HEADER_BYTES = 8 * 4,
    STATE_CHECK_BYTES = 8,
};

/* ---- hashing: not cryptographic; tells faults apart, not forgers ---------------------------- */

static uint64_t hash_mix(uint64_t hash, uint64_t word)
{
    hash = (hash ^ word) * 0x9e3779b97f4a7c15ull;
    return hash ^ hash >> 32;
}

static uint64_t hash_floats(const float *values, size_t count)
{
    uint64_t hash = 0x243f6a8885a308d3ull ^ count;

    for (size_t i = 0; i < count; i++) {
        uint32_t bits;
        memcpy(&bits, &values[i], sizeof bits);
        hash = hash_mix(hash, bits);
    }
    return hash_mix(hash, hash >> 29);
}

static uint64_t hash_bytes(const uint8_t *data, size_t size)
{
    uint64_t hash = 0x13198a2e03707344ull ^ size;

    for (; size >= 8; data += 8, size -= 8) {
        uint64_t word = 0;
        for (int i = 7; i >= 0; i--)
            word = word << 8 | data[i];
        hash = hash_mix(hash, word);
    }
    while (size--)
        hash = hash_mix(hash, *data++);
    return hash_mix(hash, hash >> 29);
}

/* ---- life ----------------------------------------------------------------------------------- */

struct film *film_new(uint32_t width, uint32_t height, uint32_t spp)
{
    return film_new_aovs(width, height, spp, 0);
}

struct film *film_new_aovs(uint32_t width, uint32_t height, uint32_t spp, uint32_t aovs)
{
    struct film *film = mem_calloc(1, sizeof *film);

    if (!film)
        return NULL;
    film->width = width;
    film->height = height;
    film->spp = spp;
    film->aovs = aovs;
    film->tiles_total = tile_count(width, height);
    film->passes_total = pass_count(spp);
    film->tiles = mem_calloc(film->tiles_total, sizeof *film->tiles);
    if (!film->tiles) {
        mem_free(film);
        return NULL;
    }
    return film;
}

void film_free(struct film *film)
{
    if (!film)
        return;
    for (uint32_t i = 0; i < film->tiles_total; i++) {
        struct film_tile *tile = &film->tiles[i];
        while (tile->waiting) {
            struct waiting *next = tile->waiting->next;
            mem_free(tile->waiting);
            tile->waiting = next;
        }
        mem_free(tile->hashes);
        mem_free(tile->sums);
    }
    mem_free(film->tiles);
    mem_free(film);
}

static uint32_t tile_pixels(const struct film *film, uint32_t tile)
{
    struct tile_rect rect = tile_rect_of(film->width, film->height, tile);

    return rect.width * rect.height;
}

static size_t tile_numbers(const struct film *film, uint32_t tile)
{
    return tile_floats(film->width, film->height, tile, film->aovs);
}

/* Samples a pixel has after `passes` passes. */
static uint32_t samples_after(const struct film *film, uint32_t passes)
{
    uint32_t begin, end = 0;

    if (passes > 0)
        pass_range(film->spp, passes - 1, &begin, &end);
    return end;
}

/* ---- merging -------------------------------------------------------------------------------- */

/* Room for one more folded pass, so that folding itself cannot fail. */
static int tile_reserve(const struct film *film, uint32_t index, uint32_t passes)
{
    struct film_tile *tile = &film->tiles[index];

    if (!tile->sums) {
        tile->sums = mem_calloc(tile_numbers(film, index), sizeof *tile->sums);
        if (!tile->sums)
            return 0;
    }
    return MEM_GROW(tile->hashes, tile->hash_capacity, passes);
}

static void tile_count_passes(struct film *film, uint32_t index, uint32_t passes)
{
    struct film_tile *tile = &film->tiles[index];
    uint64_t pixels = tile_pixels(film, index);

    film->samples -= pixels * samples_after(film, tile->passes);
    film->samples += pixels * samples_after(film, passes);
    film->tiles_started -= tile->passes > 0;
    film->tiles_started += passes > 0;
    film->tiles_complete -= tile->passes == film->passes_total;
    film->tiles_complete += passes == film->passes_total;
    tile->passes = passes;
    tile->error_known = 0;
}

static void tile_fold(struct film *film, uint32_t index, const float *sums, uint64_t hash)
{
    struct film_tile *tile = &film->tiles[index];
    size_t count = tile_numbers(film, index);

    /* AOVs that are point-sampled are 0 in all passes but the first: they, too, may be added. */
    for (size_t i = 0; i < count; i++)
        tile->sums[i] += sums[i];
    tile->hashes[tile->passes] = hash;
    tile_count_passes(film, index, tile->passes + 1);
}

static status tile_wait(struct film_tile *tile, struct waiting **at, uint32_t pass,
                        const float *sums, size_t count, uint64_t hash, struct error *err)
{
    struct waiting *entry = mem_alloc(sizeof *entry + count * sizeof *sums);

    if (!entry)
        return error_no_memory(err, "an early tile result");
    entry->pass = pass;
    entry->hash = hash;
    memcpy(entry->sums, sums, count * sizeof *sums);
    entry->next = *at;
    *at = entry;
    tile->waiting_count++;
    return STATUS_OK;
}

static status check_result(const struct film *film, uint32_t tile, uint32_t pass, const float *sums,
                           size_t count, struct error *err)
{
    if (tile >= film->tiles_total)
        return error_set(err, STATUS_ERR_INPUT, "tile %u: the frame has %u", tile,
                         film->tiles_total);
    if (pass >= film->passes_total)
        return error_set(err, STATUS_ERR_INPUT, "tile %u, pass %u: the frame has %u passes", tile,
                         pass, film->passes_total);
    if (count != tile_numbers(film, tile))
        return error_set(err, STATUS_ERR_INPUT, "tile %u, pass %u: %zu numbers instead of %zu",
                         tile, pass, count, tile_numbers(film, tile));
    for (size_t i = 0; i < count; i++)
        if (!isfinite(sums[i]))
            return error_set(err, STATUS_ERR_INPUT, "tile %u, pass %u: number %zu is not finite",
                             tile, pass, i);
    return STATUS_OK;
}

status film_merge(struct film *film, uint32_t index, uint32_t pass, const float *sums, size_t count,
                  enum film_merge_result *result, struct error *err)
{
    struct film_tile *tile;
    struct waiting **at;
    uint64_t hash;
    uint32_t ready;
    status s = check_result(film, index, pass, sums, count, err);

    *result = FILM_DUPLICATE;
    if (s != STATUS_OK)
        return s;
    tile = &film->tiles[index];
    hash = hash_floats(sums, count);
    if (pass < tile->passes) {
        *result = tile->hashes[pass] == hash ? FILM_DUPLICATE : FILM_CONFLICT;
        return STATUS_OK;
    }
    for (at = &tile->waiting; *at && (*at)->pass < pass; at = &(*at)->next)
        ;
    if (*at && (*at)->pass == pass) {
        int same = memcmp((*at)->sums, sums, count * sizeof *sums) == 0;
        *result = same ? FILM_DUPLICATE : FILM_CONFLICT;
        return STATUS_OK;
    }
    if (pass > tile->passes) {
        *result = FILM_WAITING;
        return tile_wait(tile, at, pass, sums, count, hash, err);
    }

    /* This pass, and the waiting ones that follow it without a gap. */
    ready = pass + 1;
    for (struct waiting *w = tile->waiting; w && w->pass == ready; w = w->next)
        ready++;
    if (!tile_reserve(film, index, ready))
        return error_no_memory(err, "the film");
    tile_fold(film, index, sums, hash);
    while (tile->waiting && tile->waiting->pass == tile->passes) {
        struct waiting *next = tile->waiting->next;
        tile_fold(film, index, tile->waiting->sums, tile->waiting->hash);
        mem_free(tile->waiting);
        tile->waiting = next;
        tile->waiting_count--;
    }
    *result = FILM_MERGED;
    return STATUS_OK;
}

/* ---- questions ------------------------------------------------------------------------------ */

uint32_t film_width(const struct film *film)
{
    return film->width;
}

uint32_t film_height(const struct film *film)
{
    return film->height;
}

uint32_t film_spp(const struct film *film)
{
    return film->spp;
}

uint32_t film_aovs(const struct film *film)
{
    return film->aovs;
}

uint32_t film_tile_count(const struct film *film)
{
    return film->tiles_total;
}

uint32_t film_pass_count(const struct film *film)
{
    return film->passes_total;
}

uint32_t film_tile_passes(const struct film *film, uint32_t tile)
{
    return film->tiles[tile].passes;
}

uint32_t film_tile_waiting(const struct film *film, uint32_t tile)
{
    return film->tiles[tile].waiting_count;
}

int film_has(const struct film *film, uint32_t tile, uint32_t pass)
{
    const struct film_tile *t = &film->tiles[tile];

    if (pass < t->passes)
        return 1;
    for (const struct waiting *w = t->waiting; w && w->pass <= pass; w = w->next)
        if (w->pass == pass)
            return 1;
    return 0;
}

uint32_t film_tile_samples(const struct film *film, uint32_t tile)
{
    return samples_after(film, film->tiles[tile].passes);
}

uint64_t film_samples(const struct film *film)
{
    return film->samples;
}

uint64_t film_samples_total(const struct film *film)
{
    return (uint64_t)film->width * film->height * film->spp;
}

int film_complete(const struct film *film)
{
    return film->tiles_complete == film->tiles_total;
}

int film_covered(const struct film *film)
{
    return film->tiles_started == film->tiles_total;
}

struct film_coverage film_coverage(const struct film *film)
{
    struct film_coverage c = {.samples = film->samples, .least = UINT32_MAX,
                              .tiles = film->tiles_total,
                              .tiles_empty = film->tiles_total - film->tiles_started};

    for (uint32_t i = 0; i < film->tiles_total; i++) {
        uint32_t samples = film_tile_samples(film, i);
        c.least = samples < c.least ? samples : c.least;
        c.most = samples > c.most ? samples : c.most;
    }
    return c;
}

/* ---- developing ----------------------------------------------------------------------------- */

static void develop_tile(const struct film *film, uint32_t index, float *rgb)
{
    struct tile_rect rect = tile_rect_of(film->width, film->height, index);
    const double *first = film->tiles[index].sums;
    const double *second = first + (size_t)rect.width * rect.height * 3;
    double samples = samples_after(film, film->tiles[index].passes);

    for (uint32_t y = 0; y < rect.height; y++) {
        float *row = rgb + ((size_t)(rect.y + y) * film->width + rect.x) * 3;
        for (uint32_t i = 0; i < rect.width * 3; i++)
            row[i] = (float)((*first++ + *second++) / samples);
    }
}

void film_develop(const struct film *film, float *rgb)
{
    memset(rgb, 0, (size_t)film->width * film->height * 3 * sizeof *rgb);
    for (uint32_t i = 0; i < film->tiles_total; i++)
        if (film->tiles[i].passes > 0)
            develop_tile(film, i, rgb);
}

uint32_t film_aov_channels(enum aov aov)
{
    return aov == AOV_SAMPLES ? 1 : aov == AOV_ERROR ? 3 : aov_channels(aov);
}

/* Value `c` of pixel `pixel` of a tile that has passes. */
static double aov_value(const struct film_tile *tile, const double *values, enum aov aov,
                        size_t pixels, size_t pixel, uint32_t c, uint32_t samples)
{
    double difference;

    if (aov == AOV_SAMPLES)
        return samples;
    if (aov != AOV_ERROR)
        return values[pixel * aov_channels(aov) + c] / (aov_is_point(aov) ? 1 : samples);
    if (samples < REPLICATES)
        return 0;
    difference = tile->sums[pixel * 3 + c] / replicate_samples(samples, 0) -
                 tile->sums[(pixels + pixel) * 3 + c] / replicate_samples(samples, 1);
    return fabs(difference) / 2;
}

void film_develop_aov(const struct film *film, enum aov aov, uint32_t y, uint32_t height,
                      float *out)
{
    uint32_t across = tiles_across(film->width), channels = film_aov_channels(aov);
    size_t plane = (size_t)height * film->width;

    memset(out, 0, channels * plane * sizeof *out);
    for (uint32_t i = y / TILE_SIZE * across; i < film->tiles_total; i++) {
        struct tile_rect rect = tile_rect_of(film->width, film->height, i);
        const struct film_tile *tile = &film->tiles[i];
        size_t pixels = (size_t)rect.width * rect.height;
        uint32_t samples = samples_after(film, tile->passes);
        const double *values;
        if (rect.y >= y + height)
            break;
        if (tile->passes == 0)
            continue;
        values = tile->sums + tile_aov_offset((uint32_t)pixels, film->aovs, aov);
        for (uint32_t row = 0; row < rect.height && rect.y + row < y + height; row++)
            for (uint32_t x = 0; x < rect.width; x++)
                for (uint32_t c = 0; c < channels; c++)
                    out[c * plane + (size_t)(rect.y + row - y) * film->width + rect.x + x] =
                        (float)aov_value(tile, values, aov, pixels, (size_t)row * rect.width + x,
                                         c, samples);
    }
}

static double tile_error(const struct film *film, uint32_t index)
{
    struct film_tile *tile = &film->tiles[index];
    size_t values = (size_t)tile_pixels(film, index) * 3;
    uint32_t samples = samples_after(film, tile->passes);
    double first_count = replicate_samples(samples, 0),
           second_count = replicate_samples(samples, 1);

    if (tile->error_known)
        return tile->error;
    tile->error = 0;
    for (size_t i = 0; i < values; i++) {
        double first = tile->sums[i], second = tile->sums[values + i];
        double difference = first / first_count - second / second_count;
        double mean = (first + second) / samples;
        tile->error += difference * difference / 4 / (mean * mean + 0.01);
    }
    tile->error_known = 1;
    return tile->error;
}

double film_relative_mse(const struct film *film)
{
    double sum = 0;

    for (uint32_t i = 0; i < film->tiles_total; i++) {
        if (samples_after(film, film->tiles[i].passes) < REPLICATES)
            return NAN;
        sum += tile_error(film, i);
    }
    return sum / ((double)film->width * film->height * 3);
}

/* ---- a tile's state on disk -------------------------------------------------------------------
 * header | doubles as tile_floats() | hash of every pass of the schedule (0: not in) |
 * 64-bit check of all before. The header repeats the frame's geometry and the tile's number so
 * that a state that was written to the wrong place is refused. */

static uint8_t *put32(uint8_t *out, uint32_t value)
{
    for (int i = 0; i < 4; i++)
        *out++ = (uint8_t)(value >> 8 * i);
    return out;
}

static uint8_t *put64(uint8_t *out, uint64_t value)
{
    return put32(put32(out, (uint32_t)value), (uint32_t)(value >> 32));
}

static uint32_t get32(const uint8_t *in)
{
    return (uint32_t)in[0] | (uint32_t)in[1] << 8 | (uint32_t)in[2] << 16 | (uint32_t)in[3] << 24;
}

static uint64_t get64(const uint8_t *in)
{
    return get32(in) | (uint64_t)get32(in + 4) << 32;
}

size_t film_tile_state_size(const struct film *film, uint32_t tile)
{
    return STATE_HEADER_BYTES + tile_numbers(film, tile) * 8 + (size_t)film->passes_total * 8 +
           STATE_CHECK_BYTES;
}

void film_tile_save(const struct film *film, uint32_t index, uint8_t *out)
{
    const struct film_tile *tile = &film->tiles[index];
    size_t count = tile_numbers(film, index);
    uint8_t *at = out;

    at = put32(at, STATE_MAGIC);
    at = put32(at, tile->passes);
    at = put32(at, film->width);
    at = put32(at, film->height);
    at = put32(at, film->spp);
    at = put32(at, index);
    at = put32(at, film->aovs);
    at = put32(at, 0);
    for (size_t i = 0; i < count; i++) {
        uint64_t bits = 0;
        if (tile->sums)
            memcpy(&bits, &tile->sums[i], sizeof bits);
        at = put64(at, bits);
    }
    for (uint32_t i = 0; i < film->passes_total; i++)
        at = put64(at, i < tile->passes ? tile->hashes[i] : 0);
    put64(at, hash_bytes(out, (size_t)(at - out)));
}

status film_tile_peek(const struct film *film, uint32_t tile, const uint8_t *data,
                      size_t size_bytes, uint32_t *passes, struct error *err)
{
    *passes = 0;
    if (tile >= film->tiles_total || size_bytes != film_tile_state_size(film, tile))
        return error_set(err, STATUS_ERR_CORRUPT, "tile %u: its state has %zu bytes", tile,
                         size_bytes);
    if (get32(data) != STATE_MAGIC ||
        get64(data + size_bytes - STATE_CHECK_BYTES) !=
            hash_bytes(data, size_bytes - STATE_CHECK_BYTES))
        return error_set(err, STATUS_ERR_CORRUPT, "tile %u: its stored state is damaged", tile);
    if (get32(data + 4) > film->passes_total || get32(data + 8) != film->width ||
        get32(data + 12) != film->height || get32(data + 16) != film->spp ||
        get32(data + 20) != tile || get32(data + 24) != film->aovs)
        return error_set(err, STATUS_ERR_CORRUPT,
                         "tile %u: the stored state belongs to another tile or frame", tile);
    *passes = get32(data + 4);
    return STATUS_OK;
}

status film_tile_load(struct film *film, uint32_t index, const uint8_t *data, size_t size_bytes,
                      struct error *err)
{
    uint32_t passes;
    struct film_tile *tile;
    const uint8_t *at = data + STATE_HEADER_BYTES;
    size_t count;
    status s = film_tile_peek(film, index, data, size_bytes, &passes, err);

    if (s != STATUS_OK)
        return s;
    tile = &film->tiles[index];
    count = tile_numbers(film, index);
    for (size_t i = 0; i < count; i++) {
        uint64_t bits = get64(at + 8 * i);
        double value;
        memcpy(&value, &bits, sizeof value);
        if (!isfinite(value))
            return error_set(err, STATUS_ERR_CORRUPT, "tile %u: a stored sum is not finite", index);
    }
    if (passes > 0 && !tile_reserve(film, index, passes))
        return error_no_memory(err, "the film");
    for (size_t i = 0; passes > 0 && i < count; i++) {
        uint64_t bits = get64(at + 8 * i);
        memcpy(&tile->sums[i], &bits, sizeof bits);
    }
    at += 8 * count;
    for (uint32_t i = 0; i < passes; i++)
        tile->hashes[i] = get64(at + 8 * (size_t)i);
    if (passes == 0 && tile->sums)
        memset(tile->sums, 0, count * sizeof *tile->sums);
    while (tile->waiting) {
        struct waiting *next = tile->waiting->next;
        mem_free(tile->waiting);
        tile->waiting = next;
    }
    tile->waiting_count = 0;
    tile_count_passes(film, index, passes);
    return STATUS_OK;
}
