#include "coordinator/pictures/measure.h"

#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "coordinator/film/store_film.h"

/* The film's tile, as the measurement's tile `t`. */
static void take_tails(struct measurement *m, const struct film *film, uint32_t tile, uint32_t t)
{
    m->subject[t] = (float)film_tile_subject(film, tile);
    for (uint32_t g = 0; g < GROUPS; g++) {
        float *list = m->tails + ((size_t)t * GROUPS + g) * TAIL_MAX;
        struct tail tail;
        film_tail(film, tile, g, &tail);
        for (uint32_t i = 0; i < TAIL_MAX; i++)
            list[i] = i < tail.count ? tail.entries[i].value : 0;
        m->samples[t * GROUPS + g] = film_group_samples(film, tile, g);
    }
}

void measurement_take_tile(struct measurement *m, const struct film *film, uint32_t tile)
{
    const struct tile_rect rect = tile_rect_of(m->width, m->height, tile);

    for (uint32_t g = 0; g < GROUPS && !m->film; g++) {
        film_group_tile(film, tile, g, FILM_PICTURE, m->groups[g]);
        if (m->guides.albedo[g])
            film_group_tile(film, tile, g, AOV_DENOISING_ALBEDO, m->guides.albedo[g]);
        if (m->guides.normal[g])
            film_group_tile(film, tile, g, AOV_DENOISING_NORMAL, m->guides.normal[g]);
        if (m->guides.emission[g])
            film_group_tile(film, tile, g, AOV_EMISSION, m->guides.emission[g]);
    }
    if (m->guides.position)
        film_develop_tile_aov(film, tile, AOV_POSITION, m->guides.position);
    if (m->guides.object)
        film_develop_tile_aov(film, tile, AOV_OBJECT_ID, m->guides.object);
    take_tails(m, film, tile, tile);
    for (uint32_t g = 0; g < GROUPS; g++)
        m->pixel_samples += (uint64_t)m->samples[tile * GROUPS + g] * rect.width * rect.height;
}

/* Empty, for a film of this size; with guides if `aovs` has all of them, without groups if these are to be read from `film`. */
static status begin(struct measurement *out, uint32_t width, uint32_t height, uint32_t aovs, const struct film *film,
                    struct error *err)
{
    const size_t values = (size_t)width * height * 3;
    const int guided = (aovs & AOV_FOR_DENOISING) == AOV_FOR_DENOISING;
    int whole = 1;

    *out = (struct measurement){.width = width, .height = height, .tiles = tile_count(width, height), .film = film};
    out->samples = mem_calloc((size_t)out->tiles * GROUPS, sizeof *out->samples);
    out->subject = mem_calloc(out->tiles, sizeof *out->subject);
    out->tails = mem_alloc_array((size_t)out->tiles * GROUPS * TAIL_MAX, sizeof *out->tails);
    for (uint32_t g = 0; g < GROUPS && !film; g++) {
        float **const pictures[] = {&out->groups[g], &out->guides.albedo[g], &out->guides.normal[g],
                                    &out->guides.emission[g]};
        for (size_t i = 0; i < (guided ? sizeof pictures / sizeof *pictures : 1); i++) {
            *pictures[i] = mem_calloc(values, sizeof **pictures[i]);
            whole &= *pictures[i] != NULL;
        }
    }
    if (whole && out->samples && out->subject && out->tails)
        return STATUS_OK;
    measurement_release(out);
    return error_no_memory(err, "a frame's groups of samples");
}

static status take(struct measurement *out, const struct film *film, uint32_t aovs, int copies, struct error *err)
{
    TRY(begin(out, film_width(film), film_height(film), aovs, copies ? NULL : film, err));
    for (uint32_t i = 0; i < out->tiles; i++)
        measurement_take_tile(out, film, i);
    return STATUS_OK;
}

status measurement_begin(struct measurement *out, const struct film *film, int guided, struct error *err)
{
    return begin(out, film_width(film), film_height(film), guided ? film_aovs(film) : 0, NULL, err);
}

status measurement_of(struct measurement *out, const struct film *film, struct error *err)
{
    return take(out, film, 0, 0, err);
}

/* ---- a sample of the tiles ------------------------------------------------------------------- */

enum { SAMPLE_ACROSS = 8 }; /* tiles beside each other */

static uint32_t whole_tiles(const struct film *film)
{
    return film_width(film) / TILE_SIZE * (film_height(film) / TILE_SIZE);
}

uint32_t measurement_sample(const struct film *film, uint32_t count)
{
    uint32_t rows = (count < whole_tiles(film) ? count : whole_tiles(film)) / SAMPLE_ACROSS;

    return count >= film_tile_count(film) ? 0 : rows * SAMPLE_ACROSS;
}

/* The i-th tile of the sequence R2 (Roberts 2018): evenly spread, and not on a lattice, whose border would count twice. It
 * comes back to tiles: `seen` has those that were given. */
static uint32_t next_tile(const struct film *film, uint32_t *i, uint8_t *seen)
{
    const uint32_t across = film_width(film) / TILE_SIZE, down = film_height(film) / TILE_SIZE;
    uint32_t tile;

    do {
        const uint64_t at = ++*i;
        const uint32_t u = (uint32_t)(0x80000000u + at * 3242174889u), v = (uint32_t)(0x80000000u + at * 2447445414u);
        uint32_t x = (uint32_t)((uint64_t)u * across >> 32), y = (uint32_t)((uint64_t)v * down >> 32);
        if (at > 8 * (uint64_t)across * down) { /* nearly all were given: the rest in order */
            x = (uint32_t)(at % across);
            y = (uint32_t)(at / across % down);
        }
        tile = y * tiles_across(film_width(film)) + x;
    } while (seen[tile]);
    seen[tile] = 1;
    return tile;
}

/* The film's tile, whole, as the measurement's tile `t`, SAMPLE_ACROSS beside each other. */
static void take_sampled(struct measurement *m, const struct film *film, uint32_t tile, uint32_t t)
{
    const size_t line = (size_t)SAMPLE_ACROSS * TILE_SIZE * 3;
    const size_t at = t / SAMPLE_ACROSS * TILE_SIZE * line + (size_t)(t % SAMPLE_ACROSS) * TILE_SIZE * 3;

    for (uint32_t g = 0; g < GROUPS; g++)
        film_group_tile_at(film, tile, g, FILM_PICTURE, m->groups[g] + at, line);
    take_tails(m, film, tile, t);
    for (uint32_t g = 0; g < GROUPS; g++)
        m->pixel_samples += (uint64_t)m->samples[t * GROUPS + g] * TILE_SIZE * TILE_SIZE;
}

status measurement_take_sample(struct measurement *out, const struct film *film, uint32_t count, struct error *err)
{
    const uint32_t tiles = measurement_sample(film, count);
    uint32_t i = 0;
    uint8_t *seen;
    status s;

    seen = mem_calloc(film_tile_count(film), 1);
    NEED(seen, err, "a sample of a frame's tiles");
    s = begin(out, SAMPLE_ACROSS * TILE_SIZE, tiles / SAMPLE_ACROSS * TILE_SIZE, 0, NULL, err);
    if (s == STATUS_OK)
        out->of_tiles = film_tile_count(film);
    for (uint32_t t = 0; s == STATUS_OK && t < tiles; t++)
        take_sampled(out, film, next_tile(film, &i, seen), t);
    mem_free(seen);
    return s;
}

status measurement_take_guided(struct measurement *out, const struct film *film, struct error *err)
{
    return take(out, film, film_aovs(film), 1, err);
}

/* For where its pixels' points are, and of what. */
static status begin_points(struct measurement *m, uint32_t aovs, struct error *err)
{
    const size_t pixels = (size_t)m->width * m->height;

    if (!(aovs >> AOV_POSITION & 1))
        return STATUS_OK;
    m->guides.position = mem_calloc(pixels * 3, sizeof(float));
    NEED(m->guides.position, err, "a frame's positions");
    if (!(aovs >> AOV_OBJECT_ID & 1))
        return STATUS_OK;
    m->guides.object = mem_calloc(pixels, sizeof(float));
    NEED(m->guides.object, err, "a frame's objects");
    return STATUS_OK;
}

status measurement_read_guided(struct measurement *out, struct film_reader *reader, int positions, struct error *err)
{
    const struct film *film = film_reader_film(reader);
    uint32_t tile;
    status s = begin(out, film_width(film), film_height(film), film_aovs(film), NULL, err);

    if (s == STATUS_OK && positions)
        s = begin_points(out, film_aovs(film), err);
    while (s == STATUS_OK && (s = film_reader_next(reader, &tile, err)) == STATUS_OK)
        measurement_take_tile(out, film, tile);
    if (s == STATUS_ERR_NOT_FOUND) /* that was the last */
        return STATUS_OK;
    measurement_release(out);
    return s;
}

int measurement_is_guided(const struct measurement *m) { return m->guides.albedo[0] != NULL; }

void measurement_release(struct measurement *m)
{
    for (uint32_t g = 0; g < GROUPS; g++) {
        mem_free(m->groups[g]);
        mem_free(m->guides.albedo[g]);
        mem_free(m->guides.normal[g]);
        mem_free(m->guides.emission[g]);
    }
    mem_free(m->guides.position);
    mem_free(m->guides.object);
    mem_free(m->samples);
    mem_free(m->subject);
    mem_free(m->tails);
    memset(m, 0, sizeof *m);
}

/* ---- how it is shown ------------------------------------------------------------------------- */

struct shown {
    const struct tonemap_settings *tone;
    struct tonemap_context context; /* without a state: every picture is metered by itself */
    struct tonemap_pixels *pictures[3];
};

static status show_codes(void *user, const float *rgb, uint32_t width, uint32_t height, float *codes, struct error *err)
{
    const struct shown *shown = user;
    size_t values = (size_t)width * height * 3;
    /* Only read. */
    const struct image in = {.width = width, .height = height, .channels = 3, .pixels = (float *)rgb};
    struct image out = {0};
    status s = tonemap_apply(&out, &in, shown->tone, &shown->context, err);

    for (size_t i = 0; s == STATUS_OK && i < values; i++)
        codes[i] = out.pixels[i] * 255;
    image_release(&out);
    return s;
}

static status measure_picture(void *user, int picture, const float *rgb, uint32_t width, uint32_t height,
                              struct error *err)
{
    struct shown *shown = user;
    const struct image in = {.width = width, .height = height, .channels = 3, .pixels = (float *)rgb};
    struct tonemap_state state = {0};

    if (tonemap_reach(shown->tone) == TONEMAP_REACH_STATE)
        TRY(tonemap_measure(&state, &in, shown->tone, &shown->context, err));
    return tonemap_pixels_new(&shown->pictures[picture], shown->tone, &state, &shown->context, err);
}

static void code_pixels(void *user, int picture, const float *rgb, uint32_t count, float *codes)
{
    const struct shown *shown = user;

    tonemap_pixels_codes(shown->pictures[picture], rgb, count, codes);
}

static void film_lines(void *user, int group, uint32_t y, uint32_t height, float *out)
{
    const struct measurement *m = user;

    film_group_rows(m->film, (uint32_t)group, y, height, out);
}

status measurement_figures(const struct measurement *m, const struct tonemap_settings *tone,
                           const struct tonemap_context *context, uint64_t effects, double brightest,
                           struct accuracy_figures *out, struct accuracy_map *map, struct error *err)
{
    struct shown shown = {.tone = tone, .context = *context};
    struct accuracy_transform transform = {.apply = show_codes, .user = &shown, .threads = context->threads};
    struct accuracy_picture picture = {.width = m->width, .height = m->height,
                                       .samples = m->samples, .subject = m->subject,
                                       .of_tiles = m->of_tiles, .lines = film_lines, .user = (void *)m};
    struct accuracy_tails tails = {.values = m->tails, .lists = (size_t)m->tiles * GROUPS,
                                   .length = TAIL_MAX, .samples = m->pixel_samples};
    struct accuracy_evidence evidence = {
        .samples = (double)m->pixel_samples / ((double)m->width * m->height),
        .effects = effects, .brightest = brightest, .tails = &tails};

    status s;

    for (uint32_t g = 0; g < GROUPS; g++)
        picture.groups[g] = m->groups[g];
    shown.context.state = NULL;
    shown.context.apart = m->of_tiles ? TILE_SIZE : 0;
    if (tonemap_reach(tone) != TONEMAP_REACH_PICTURE) {
        transform.measure = measure_picture;
        transform.codes = code_pixels;
    }
    s = accuracy_figures_of(out, &picture, &transform, &evidence, map, err);
    for (int i = 0; i < 3; i++)
        if (shown.pictures[i])
            tonemap_pixels_free(shown.pictures[i]);
    return s;
}

/* A tile that lacks a group is shown as it is. */
static void restore_tiles(const struct measurement *m, const struct image *raw, float *out)
{
    for (uint32_t t = 0; t < m->tiles; t++) {
        const struct tile_rect rect = tile_rect_of(m->width, m->height, t);
        if (m->samples[t * GROUPS] > 0 && m->samples[t * GROUPS + 1] > 0)
            continue;
        for (uint32_t y = rect.y; y < rect.y + rect.height; y++) {
            const size_t at = ((size_t)y * m->width + rect.x) * 3;
            memcpy(out + at, raw->pixels + at, (size_t)rect.width * 3 * sizeof *out);
        }
    }
}

struct denoise_input measurement_input(const struct measurement *m)
{
    struct denoise_input input = {.width = m->width, .height = m->height, .samples = m->samples};

    for (uint32_t g = 0; g < GROUPS; g++) {
        input.groups[g] = m->groups[g];
        input.albedo[g] = m->guides.albedo[g];
        input.normal[g] = m->guides.normal[g];
        input.direct[g] = m->guides.emission[g];
    }
    return input;
}

status measurement_denoise(const struct measurement *m, const struct measurement_others *others,
                           const struct image *raw, enum denoise_method method, unsigned threads,
                           const struct measurement_evidence *known, struct denoise_result *out, struct error *err)
{
    const struct accuracy_tails tails = {.values = m->tails, .lists = (size_t)m->tiles * GROUPS,
                                         .length = TAIL_MAX, .samples = m->pixel_samples};
    const struct accuracy_evidence evidence = {
        .samples = (double)m->pixel_samples / ((double)m->width * m->height), .effects = known ? known->effects : 0,
        .brightest = known ? known->brightest : 0, .tails = &tails};
    const struct denoise_options options = {.method = method, .threads = threads, .evidence = known ? &evidence : NULL};
    struct denoise_input input = measurement_input(m);

    if (others) {
        input.other_count = others->count;
        input.other = others->find;
        input.other_user = others->user;
    }
    TRY(denoise(&input, &options, out, err));
    restore_tiles(m, raw, out->image);
    return STATUS_OK;
}

void measure_transform_text(const struct tonemap_settings *tone, char out[MEASURE_TEXT_MAX])
{
    snprintf(out, MEASURE_TEXT_MAX, "%s, exposure %+g EV%s%s%s", tone->op->name, tone->exposure_ev,
             tone->metering != TONEMAP_METERING_OFF ? " after metering by " : "",
             tone->metering != TONEMAP_METERING_OFF ? tonemap_metering_name(tone->metering) : "",
             tone->op->display_encoded ? "" : ", sRGB");
}
