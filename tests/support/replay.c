#include "tests/support/replay.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/image/color.h"

static void *need(void *memory)
{
    if (!memory) {
        fprintf(stderr, "replay: out of memory\n");
        abort();
    }
    return memory;
}

static _Noreturn void give_up(const char *path, const char *why)
{
    fprintf(stderr, "replay: %s: %s\n", path, why);
    abort();
}

/* ---- a group's sums as they grow ---------------------------------------------------------------- */

struct growing {
    uint32_t width, height;
    size_t floats;           /* of a picture */
    double *sums, *at_level; /* now, and at the last level before this pass */
    float *codes;
    uint64_t *rays; /* [tiles] */
    uint32_t passes, samples, level_samples;
};

static void growing_init(struct growing *g, const struct record_header *h)
{
    memset(g, 0, sizeof *g);
    g->width = h->width;
    g->height = h->height;
    g->floats = (size_t)h->width * h->height * 3;
    g->rays = need(mem_calloc(h->tiles, sizeof *g->rays));
    g->sums = need(mem_calloc(g->floats, sizeof *g->sums));
    g->at_level = need(mem_calloc(g->floats, sizeof *g->at_level));
    g->codes = need(mem_alloc_array(g->floats, sizeof *g->codes));
}

static void growing_release(struct growing *g)
{
    mem_free(g->sums);
    mem_free(g->at_level);
    mem_free(g->codes);
    mem_free(g->rays);
}

static void growing_add(struct growing *g, const struct record_head *head, const float *sums)
{
    struct tile_rect rect = tile_rect_of(g->width, g->height, head->tile);

    for (uint32_t i = 0; i < head->pixels; i++) {
        double *to = &g->sums[((size_t)(rect.y + i / rect.width) * g->width + rect.x + i % rect.width) * 3];
        for (int c = 0; c < 3; c++)
            to[c] += (double)sums[i * 3 + (uint32_t)c];
    }
    g->rays[head->tile] += head->rays;
    g->samples = head->end;
}

/* What makes the logarithmic mean of the group's luminance 0.18; 1 for a black picture. */
static double metered(const struct growing *g)
{
    double sum = 0, count = 0;

    for (size_t i = 0; i < g->floats; i += 3) {
        double y = 0.2126 * g->sums[i] + 0.7152 * g->sums[i + 1] + 0.0722 * g->sums[i + 2];
        if (y > 0) {
            sum += log(y / g->samples);
            count++;
        }
    }
    return count > 0 ? 0.18 / exp(sum / count) : 1;
}

static void encode(struct growing *g, double exposure)
{
    double factor = exposure / g->samples;

    for (size_t i = 0; i < g->floats; i++) {
        double x = g->sums[i] * factor;
        g->codes[i] = (float)(x < 0 ? 0 : x > 1 ? 1 : x);
    }
    srgb_encode_row(g->codes, g->floats);
}

static void exposed_codes(void *user, const float *rgb, uint32_t count, float *codes)
{
    float gain = (float)*(const double *)user;

    for (uint32_t i = 0; i < count * 3; i++)
        codes[i] = rgb[i] * gain;
    film_codes_plain(NULL, codes, count, codes);
}

/* Between two levels, too: there the part since the last one is fewer than half of the samples, and its
 * distance from the mean is scaled to that of a half. */
static void measure_tile(const struct growing *g, uint32_t tile, double exposure, struct film_level *out)
{
    struct tile_rect rect = tile_rect_of(g->width, g->height, tile);
    double sums[TILE_PIXELS_MAX * 3], later = g->samples - g->level_samples;
    double scale = g->level_samples > 0 ? sqrt(later / g->level_samples) : 0;
    float second[TILE_PIXELS_MAX * 3];
    size_t at = 0;

    for (uint32_t y = rect.y; y < rect.y + rect.height; y++)
        for (size_t i = 0, from = ((size_t)y * g->width + rect.x) * 3; i < rect.width * 3; i++, from++, at++) {
            double mean = g->sums[from] / g->samples, b = (g->sums[from] - g->at_level[from]) / later;
            sums[at] = g->sums[from];
            second[at] = (float)((mean + (b - mean) * scale) * g->samples / 2);
        }
    out->rays = g->rays[tile];
    film_level_measure(out, sums, g->passes > 1 ? second : NULL, rect.width, rect.height, g->samples,
                       &(struct film_codes){exposed_codes, &exposure});
}

static void keep_errors(struct replay *replay, struct growing *g, uint32_t group, uint32_t passes)
{
    float *error = need(mem_alloc_array(g->floats, sizeof *error));

    float *mean = need(mem_alloc_array(g->floats, sizeof *mean));

    encode(g, replay->shown);
    for (size_t i = 0; i < g->floats; i++) {
        error[i] = g->codes[i] * 255; /* subtract_other() makes it an error */
        mean[i] = (float)(g->sums[i] / g->samples);
    }
    replay->error[group][passes] = error;
    replay->picture[group][passes] = mean;
}

/* The group's passes are in up to `passes`. */
static void pass_done(struct replay *replay, struct growing *g, uint32_t group, uint32_t passes, unsigned keep)
{
    struct film_level *tiles = need(mem_alloc_array(replay->tiles, sizeof *tiles));

    g->passes = passes;
    if (passes == 1)
        replay->exposure[group] = replay->shown > 0 ? replay->shown : metered(g);
    for (uint32_t t = 0; t < replay->tiles; t++)
        measure_tile(g, t, replay->exposure[group], &tiles[t]);
    replay->statistics[group][passes] = tiles;
    if (keep & REPLAY_MEANS) {
        double *mean = need(mem_alloc_array(replay->tiles, sizeof *mean));
        for (uint32_t t = 0; t < replay->tiles; t++) {
            struct tile_rect r = tile_rect_of(replay->width, replay->height, t);
            mean[t] = tiles[t].radiance / (3.0 * r.width * r.height);
        }
        replay->mean[group][passes] = mean;
    }
    if (keep & REPLAY_ERRORS)
        keep_errors(replay, g, group, passes);
    if (level_at(passes) >= 0) {
        memcpy(g->at_level, g->sums, g->floats * sizeof *g->sums);
        g->level_samples = g->samples;
    }
}

/* ---- rendering --------------------------------------------------------------------------------- */

void replay_render(struct replay *out, const struct render_scene *scene, const struct render_settings *settings,
                   uint32_t seed, uint32_t samples)
{
    struct record_header h = {.width = settings->width, .height = settings->height};
    struct record_unit *unit = need(mem_calloc(1, sizeof *unit));

    h.tiles = tile_count(h.width, h.height);
    memset(out, 0, sizeof *out);
    out->width = h.width;
    out->height = h.height;
    out->tiles = h.tiles;
    out->cpu_ns = need(mem_calloc(out->tiles, sizeof *out->cpu_ns));
    for (uint32_t group = 0; group < RECORD_GROUPS; group++) {
        struct growing g;
        growing_init(&g, &h);
        for (uint32_t pass = 0;; pass++) {
            uint32_t begin, end;
            record_pass_range(pass, &begin, &end);
            if (end > samples)
                break;
            for (uint32_t t = 0; t < h.tiles; t++) {
                record_render(scene, settings, seed, 0, t, group, begin, end, unit);
                growing_add(&g, &unit->head, unit->sums);
            }
            pass_done(out, &g, group, pass + 1, REPLAY_MEANS);
            out->passes = pass + 1;
        }
        growing_release(&g);
    }
    mem_free(unit);
}

/* ---- reading -------------------------------------------------------------------------------------- */

struct reader {
    FILE *file;
    const char *path;
    struct record_header header;
    struct record_unit unit;
};

static int next_unit(struct reader *r)
{
    size_t floats;

    if (fread(&r->unit.head, sizeof r->unit.head, 1, r->file) != 1)
        return 0;
    floats = (size_t)r->unit.head.pixels * 3;
    if (r->unit.head.pixels > TILE_PIXELS_MAX || r->unit.head.tail_count > RECORD_TAIL_MAX ||
        r->unit.head.tile >= r->header.tiles || r->unit.head.group >= RECORD_GROUPS ||
        fread(r->unit.sums, sizeof *r->unit.sums, floats, r->file) != floats ||
        fread(r->unit.tail, sizeof *r->unit.tail, r->unit.head.tail_count, r->file) != r->unit.head.tail_count)
        give_up(r->path, "the recording is damaged");
    return 1;
}

static void open_recording(struct reader *r, const char *path)
{
    r->path = path;
    r->file = fopen(path, "rb");
    if (!r->file)
        give_up(path, "cannot be opened");
    if (fread(&r->header, sizeof r->header, 1, r->file) != 1 || r->header.magic != RECORD_MAGIC ||
        r->header.passes > RECORD_PASSES_MAX)
        give_up(path, "is no recording");
}

/* Exposure of the seed's whole picture, and the tiles' costs. */
static double survey(struct replay *replay, struct reader *r, uint32_t seed)
{
    struct growing all;
    double exposure;

    growing_init(&all, &r->header);
    while (next_unit(r)) {
        const struct record_head *head = &r->unit.head;
        uint32_t most = r->header.spp / RECORD_GROUPS;
        if (head->seed != seed)
            continue;
        growing_add(&all, head, r->unit.sums);
        replay->cpu_ns[head->tile] += (double)head->cpu_ns / (2.0 * most);
    }
    all.samples = r->header.spp;
    exposure = metered(&all);
    growing_release(&all);
    return exposure;
}

/* shown: 0: find it. */
static void read_seed(struct replay *out, const char *path, uint32_t seed, unsigned keep, double shown)
{
    struct reader *r = need(mem_calloc(1, sizeof *r));
    struct growing groups[RECORD_GROUPS];
    uint32_t units[RECORD_GROUPS] = {0};

    memset(out, 0, sizeof *out);
    open_recording(r, path);
    out->width = r->header.width;
    out->height = r->header.height;
    out->tiles = r->header.tiles;
    out->passes = r->header.passes;
    out->cpu_ns = need(mem_calloc(out->tiles, sizeof *out->cpu_ns));
    out->shown = survey(out, r, seed);
    if (shown > 0)
        out->shown = shown;
    rewind(r->file);
    if (fread(&r->header, sizeof r->header, 1, r->file) != 1)
        give_up(path, "cannot be read again");
    for (int g = 0; g < RECORD_GROUPS; g++)
        growing_init(&groups[g], &r->header);
    while (next_unit(r)) {
        uint32_t g = r->unit.head.group;
        if (r->unit.head.seed != seed)
            continue;
        growing_add(&groups[g], &r->unit.head, r->unit.sums);
        if (++units[g] % out->tiles == 0)
            pass_done(out, &groups[g], g, units[g] / out->tiles, keep);
    }
    for (int g = 0; g < RECORD_GROUPS; g++) {
        if (units[g] != out->passes * out->tiles)
            give_up(path, "the seed is not in the recording");
        growing_release(&groups[g]);
    }
    fclose(r->file);
    mem_free(r);
}

/* Codes of one seed less those of another: sqrt(2) times the error of either, in distribution. */
static void subtract_other(struct replay *replay, const struct replay *other)
{
    size_t floats = (size_t)replay->width * replay->height * 3;

    for (int g = 0; g < RECORD_GROUPS; g++)
        for (uint32_t pass = 1; pass <= replay->passes; pass++)
            for (size_t i = 0; i < floats; i++)
                replay->error[g][pass][i] = (replay->error[g][pass][i] - other->error[g][pass][i]) * 0.70710678f;
}

void replay_read(struct replay *out, const char *path, uint32_t seed, unsigned keep)
{
    read_seed(out, path, seed, keep, 0);
    if (keep & REPLAY_ERRORS) {
        struct replay *other = need(mem_alloc(sizeof *other));
        read_seed(other, path, seed + REPLAY_OTHER, REPLAY_ERRORS, out->shown);
        subtract_other(out, other);
        replay_release(other);
        mem_free(other);
    }
}

void replay_release(struct replay *replay)
{
    for (int g = 0; g < RECORD_GROUPS; g++) {
        for (int pass = 0; pass <= RECORD_PASSES_MAX; pass++) {
            mem_free(replay->statistics[g][pass]);
            mem_free(replay->error[g][pass]);
            mem_free(replay->picture[g][pass]);
            mem_free(replay->mean[g][pass]);
        }
    }
    mem_free(replay->cpu_ns);
    memset(replay, 0, sizeof *replay);
}

/* ---- rounds ------------------------------------------------------------------------------------------ */

/* What all samples of a group say of a tile, as if they had been those of `level`. */
static struct film_level as_level(const struct film_level *all, uint32_t samples, uint32_t level)
{
    struct film_level out = *all;
    double ratio = (double)samples / (2u << level);
    int shift = (int)lround(log2(ratio)); /* a half octave of error for each octave of samples */

    out.linear *= ratio;
    out.display *= (float)ratio;
    out.channels *= (float)ratio;
    out.rays = (uint64_t)((double)all->rays / ratio);
    memset(out.bins, 0, sizeof out.bins);
    memset(out.spreads, 0, sizeof out.spreads);
    for (int b = 0; b + 2 * shift < LEVEL_SPREADS; b++)
        out.spreads[b + 2 * shift] = all->spreads[b];
    for (int b = 0; b < LEVEL_BINS; b++)
        out.bins[b + shift < LEVEL_BINS ? b + shift : LEVEL_BINS - 1] =
            (uint16_t)(out.bins[b + shift < LEVEL_BINS ? b + shift : LEVEL_BINS - 1] + all->bins[b]);
    return out;
}

static void what_decides(const struct replay *r, int group, uint32_t level, enum replay_fault fault,
                         uint32_t *const passes[RECORD_GROUPS], struct film_level *out)
{
    int by = fault == REPLAY_OWN_SAMPLES ? group : 1 - group;

    for (uint32_t t = 0; t < r->tiles; t++) {
        uint32_t n = level_passes(level);
        if (fault == REPLAY_OTHERS_ALL_SAMPLES && passes[by][t] > n)
            n = passes[by][t];
        if (n > r->passes)
            n = r->passes;
        out[t] = as_level(&r->statistics[by][n][t], pass_samples(n), level);
    }
}

int replay_rounds(const struct replay *decides, const struct allocation_rules *rules,
                  const struct allocation_target *target, uint32_t last_level, enum replay_fault fault,
                  uint32_t *const passes[RECORD_GROUPS])
{
    struct film_level *tiles[RECORD_GROUPS], *before[RECORD_GROUPS] = {NULL, NULL};
    int ended[RECORD_GROUPS] = {0}, cut = 0;

    for (int g = 0; g < RECORD_GROUPS; g++) {
        tiles[g] = need(mem_alloc_array(decides->tiles, sizeof *tiles[g]));
        for (uint32_t t = 0; t < decides->tiles; t++)
            passes[g][t] = 0;
    }
    for (uint32_t k = 0; k <= last_level; k++) {
        for (int g = 0; g < RECORD_GROUPS; g++)
            for (uint32_t t = 0; t < decides->tiles; t++)
                if (passes[g][t] < level_passes(k) && (!ended[g] || (!ended[1 - g] && fault == REPLAY_ENDED_GROWS)))
                    passes[g][t] = level_passes(k);
        for (int g = 0; g < RECORD_GROUPS; g++)
            what_decides(decides, g, k, fault, passes, tiles[g]);
        for (int g = 0; g < RECORD_GROUPS; g++) {
            struct allocation_input in = {decides->width, decides->height, k, tiles[g], k > 1 ? before[g] : NULL, passes[g], rules};
            struct allocation_round round;
            struct error err;
            uint32_t lambda;
            if (ended[g])
                continue;
            if (allocation_round(&round, &in, &err) != STATUS_OK)
                need(NULL);
            lambda = round.full;
            if (target)
                ended[g] = allocation_target(&round, target, &lambda);
            allocation_wanted(&round, lambda, passes[g]);
            for (uint32_t t = 0; t < decides->tiles; t++)
                if (passes[g][t] > decides->passes) {
                    passes[g][t] = decides->passes;
                    cut = 1;
                }
            allocation_round_release(&round);
        }
        for (int g = 0; g < RECORD_GROUPS; g++) {
            struct film_level *free_now = before[g] ? before[g] : need(mem_alloc_array(decides->tiles, sizeof *tiles[g]));
            before[g] = tiles[g];
            tiles[g] = free_now;
        }
    }
    for (int g = 0; g < RECORD_GROUPS; g++) {
        mem_free(tiles[g]);
        mem_free(before[g]);
    }
    return ended[0] && ended[1] && !cut;
}

/* ---- judging ----------------------------------------------------------------------------------------- */

static int ascending(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;

    return (x > y) - (x < y);
}

/* The two groups' errors are independent: their product has mean 0, so leaving it out changes only
 * the noise of the judgement. */
struct replay_errors replay_errors(const struct replay *replay, uint32_t *const passes[RECORD_GROUPS])
{
    size_t pixels = (size_t)replay->width * replay->height;
    float *largest = need(mem_alloc_array(pixels, sizeof *largest));
    struct replay_errors out = {0};
    uint32_t across = tiles_across(replay->width);

    for (size_t p = 0; p < pixels; p++) {
        uint32_t tile = (uint32_t)(p / replay->width / TILE_SIZE * across + p % replay->width / TILE_SIZE);
        const float *e0 = &replay->error[0][passes[0][tile]][3 * p], *e1 = &replay->error[1][passes[1][tile]][3 * p];
        largest[p] = 0;
        for (int c = 0; c < 3; c++) {
            float e = 0.5f * (e0[c] + e1[c]), against = 0.5f * (e0[c] - e1[c]);
            out.square += 0.5 * ((double)e * (double)e + (double)against * (double)against);
            if (fabsf(e) > largest[p])
                largest[p] = fabsf(e);
        }
    }
    out.square /= 3 * (double)pixels;
    qsort(largest, pixels, sizeof *largest, ascending);
    out.display = (double)largest[(size_t)(0.95 * (double)(pixels - 1))];
    mem_free(largest);
    return out;
}

static status codes_of_picture(void *user, const float *rgb, uint32_t width, uint32_t height, float *codes,
                               struct error *err)
{
    (void)err;
    exposed_codes(user, rgb, width * height, codes);
    return STATUS_OK;
}

void replay_reported(const struct replay *replay, uint32_t *const passes[RECORD_GROUPS], struct accuracy_figures *out)
{
    size_t floats = (size_t)replay->width * replay->height * 3;
    float *parts[RECORD_GROUPS];
    struct accuracy_picture picture = {.width = replay->width, .height = replay->height};
    double exposure = replay->shown;
    struct accuracy_transform transform = {.apply = codes_of_picture, .user = &exposure};
    uint32_t across = tiles_across(replay->width);
    struct error err = {0};

    for (int g = 0; g < RECORD_GROUPS; g++) {
        picture.groups[g] = parts[g] = need(mem_alloc_array(floats, sizeof *parts[g]));
        for (size_t i = 0; i < floats; i++) {
            size_t p = i / 3, tile = p / replay->width / TILE_SIZE * across + p % replay->width / TILE_SIZE;
            parts[g][i] = replay->picture[g][passes[g][tile]][i];
        }
    }
    if (accuracy_figures_of(out, &picture, &transform, NULL, NULL, &err) != STATUS_OK)
        need(NULL);
    for (int g = 0; g < RECORD_GROUPS; g++)
        mem_free(parts[g]);
}

double replay_cost(const struct replay *replay, uint32_t *const passes[RECORD_GROUPS])
{
    double ns = 0;

    for (uint32_t t = 0; t < replay->tiles; t++)
        for (int g = 0; g < RECORD_GROUPS; g++)
            ns += replay->cpu_ns[t] * pass_samples(passes[g][t]);
    return ns * 1e-9;
}
