/* A frame as an EXR file: its header, its layers. */
#include "coordinator/pictures/develop_parts.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/accuracy/schedule.h"
#include "common/accuracy/word.h"
#include "common/system/clock.h"
#include "common/system/log.h"
#include "common/image/image.h"
#include "coordinator/pictures/measured.h"

enum { ATTRIBUTES_MAX = 96 + DEVELOPMENT_MATTE_ATTRIBUTES + 1 + 2 * HEALTH_KINDS };

struct attributes {
    struct exr_attribute items[ATTRIBUTES_MAX];
    size_t count;
};

static void add_text(struct attributes *a, const char *name, const char *text)
{
    a->items[a->count++] = (struct exr_attribute){.name = name, .text = text};
}

static void add_number(struct attributes *a, const char *name, double number)
{
    a->items[a->count++] = (struct exr_attribute){.name = name, .number = number};
}

static void add_point(struct attributes *a, const char *name, const double point[3])
{
    a->items[a->count++] = (struct exr_attribute){.name = name, .point = point};
}

static void add_mattes(struct attributes *a, const struct development *d,
                       char names[DEVELOPMENT_MATTE_ATTRIBUTES][CRYPTOMATTE_NAME_SIZE])
{
    const uint64_t lost = development_mattes_lost(d);

    a->count += development_mattes_attributes(d, a->items + a->count, names);
    if (lost > 0)
        add_number(a, "azulejo:mattesLost", (double)lost);
}

static void add_view(struct attributes *a, const struct development_view *view)
{
    a->items[a->count++] = (struct exr_attribute){.name = "framesPerSecond", .fraction = view->rate};
    if (view->has_camera)
        a->items[a->count++] = (struct exr_attribute){.name = "worldToCamera", .matrix = view->to_camera};
    if (view->has_ndc)
        a->items[a->count++] = (struct exr_attribute){.name = "worldToNDC", .matrix = view->to_ndc};
}

/* The samples it has: a frame of a cancelled job may have fewer than azulejo:spp, and not the same
 * number everywhere. */
static void add_samples(struct attributes *a, const struct development *d)
{
    add_number(a, "azulejo:samples", (double)d->coverage.samples);
    add_number(a, "azulejo:complete", development_is_whole(d));
    add_number(a, "azulejo:samplesMin", d->coverage.least);
    add_number(a, "azulejo:samplesMean", development_mean_samples(d));
    add_number(a, "azulejo:samplesMax", d->coverage.most);
    add_number(a, "azulejo:tilesWithoutSamples", d->coverage.tiles_empty);
    if (d->is_preview)
        add_number(a, "azulejo:covered", development_covered(d));
}

/* What the film contains, and what went wrong in it: the same on every farm. */
static void add_work(struct attributes *a, const struct development *d, char first[HEALTH_KINDS][HEALTH_TEXT_SIZE])
{
#define COUNTER(name, limit, attribute) attribute,
    static const char *const attributes[] = {WORK_COUNTERS(COUNTER)};
    const struct unit_work *w = &d->work;

    for (int i = 0; i < WORK_COUNTER_COUNT; i++)
        if (attributes[i])
            add_number(a, attributes[i], (double)w->count[i]);
    for (int k = 0; k < HEALTH_KINDS; k++) {
        add_number(a, health_rows[k].attribute, (double)w->health.count[k]);
        health_first_text(first[k], w->health.first[k], settings_rect(&d->settings));
        if (first[k][0])
            add_text(a, health_rows[k].attribute_first, first[k]);
    }
    if (depth_light_is_known(&w->depth))
        add_number(a, "azulejo:endedByDepth", depth_light_report(&w->depth, w->samples, d->settings.max_depth).share);
    if (d->settings.clamp > 0) {
        add_number(a, "azulejo:clampedSamples", (double)w->clamped_samples);
        add_number(a, "azulejo:clampedShare", unit_work_clamped_share(w));
    }
}

static void write_measured(const struct development *d, struct buffer *out)
{
    struct measured m = {.job = d->job, .submitted_at = d->submitted_at, .written_at = clock_wall_s(),
                         .workers = d->film ? measured_workers(d->film) : 0,
                         .cpu_ns = d->stats.cpu_ns, .trace_ns = d->stats.trace_ns};

    measured_write(out, &m);
}

/* Those that are the default of most jobs only where they are not. */
static void add_settings(struct attributes *a, const struct render_settings *s,
                         char text[SETTING_COUNT][SETTING_TEXT_SIZE])
{
    for (int i = 0; i < SETTING_COUNT; i++) {
        const struct setting *row = &render_settings_rows[i];
        if (!row->attribute || !setting_is_told(row, s))
            continue;
        if (setting_is_number(row))
            add_number(a, row->attribute, setting_number(row, s));
        else
            add_text(a, row->attribute, setting_text(row, s, text[i]));
    }
}

static void add_known(struct attributes *a, const char *name, double number)
{
    if (isfinite(number))
        add_number(a, name, number);
}

struct error_text {
    char transform[MEASURE_TEXT_MAX], reason[ACCURACY_WORDS_SIZE], rmse_reason[ACCURACY_WORDS_SIZE];
};

/* The picture's estimated errors. A preview has those that were computed last. */
static void add_figures(struct attributes *a, const struct development *d, struct error_text *text)
{
    const struct accuracy_figures *f = &d->point.figures;

    if (!f->known)
        return;
    measure_transform_text(&d->output.tonemap, text->transform);
    add_text(a, "azulejo:errorTransform", text->transform);
    add_number(a, "azulejo:errorSamples", (double)d->point.samples);
    add_known(a, "azulejo:errorDisplay", f->display_error);
    add_known(a, "azulejo:errorDisplayLow", f->display_lo);
    add_known(a, "azulejo:errorDisplayHigh", f->display_hi);
    add_known(a, "azulejo:errorDisplayAll", f->display_all);
    add_known(a, "azulejo:errorWorstPart", f->worst_part);
    add_known(a, "azulejo:errorFireflies", f->fireflies);
    add_known(a, "azulejo:errorSubject", f->subject);
    add_known(a, "azulejo:errorPsnr", f->psnr_db);
    add_known(a, "azulejo:errorPsnrLow", f->psnr_lo);
    add_known(a, "azulejo:errorPsnrHigh", f->psnr_hi);
    add_known(a, "azulejo:errorRmsePercent", f->rmse_percent);
    add_known(a, "azulejo:errorRmsePercentLow", f->rmse_lo);
    add_known(a, "azulejo:errorRmsePercentHigh", f->rmse_hi);
    add_known(a, "azulejo:errorTopShare", f->top_share);
    add_text(a, "azulejo:errorWord", accuracy_word(f));
    if (!f->reliable)
        add_text(a, "azulejo:errorReason", accuracy_reason_text(f, development_effects(d), text->reason));
    add_text(a, "azulejo:errorRmseWord", accuracy_rmse_word(f));
    if (!accuracy_rmse_is_reliable(f))
        add_text(a, "azulejo:errorRmseReason", accuracy_rmse_reason_text(f, development_effects(d), text->rmse_reason));
}

/* How the layer `denoised` was made, and its errors: all of their names begin like this. */
#define DENOISED_PREFIX "azulejo:denoise"
static void add_denoised(struct attributes *a, const struct development *d)
{
    const struct accuracy_figures *f = &d->point.denoised;

    if (!d->denoised_known)
        return;
    add_text(a, "azulejo:denoiseMethod", denoise_method_name(d->denoise_method));
    add_number(a, "azulejo:denoiseVersion", DENOISE_VERSION);
    add_text(a, "azulejo:denoiseGuides", development_guides_text(d));
    add_number(a, "azulejo:denoiseFrames", d->denoised_frames);
    add_number(a, "azulejo:denoiseRawTiles", d->denoise_counts.raw);
    add_number(a, "azulejo:denoiseFireflies", (double)d->denoise_counts.fireflies);
    add_number(a, "azulejo:denoiseRemovedShare", d->denoise_counts.removed);
    if (!f->known)
        return;
    add_known(a, "azulejo:denoisedRmsePercent", f->rmse_percent);
    add_known(a, "azulejo:denoisedRmseLow", f->rmse_lo);
    add_known(a, "azulejo:denoisedRmseHigh", f->rmse_hi);
}

/* ---- AOVs ----------------------------------------------------------------------------------- */

/* The channels of each, as compositors name them (docs/AOV.md), and in Blender's files: its own names where it has the
 * variable, with the same meaning. */
static const struct {
    const char *names[EXR_NAMES_COUNT][3];
    int precise; /* float even in a file of halves */
} aov_layers[AOV_COUNT] = {
#define ONE(plain, blender) {{plain}, {"ViewLayer." blender}}
#define THREE(plain, blender, a, b, c)                                                                                 \
    {{plain "." a, plain "." b, plain "." c},                                                                          \
     {"ViewLayer." blender "." a, "ViewLayer." blender "." b, "ViewLayer." blender "." c}}
#define TWO(plain, a, b) {{plain "." a, plain "." b}, {"ViewLayer." plain "." a, "ViewLayer." plain "." b}}
    [AOV_DEPTH] = {ONE("Z", "Depth.Z"), 1},
    [AOV_NORMAL] = {THREE("N", "Normal", "X", "Y", "Z"), 0},
    [AOV_ALBEDO] = {THREE("albedo", "albedo", "R", "G", "B"), 0},
    [AOV_POSITION] = {THREE("P", "Position", "X", "Y", "Z"), 1},
    [AOV_UV] = {TWO("uv", "U", "V"), 1},
    [AOV_OBJECT_ID] = {ONE("objectId.X", "IndexOB.X"), 1},
    [AOV_MATERIAL_ID] = {ONE("materialId.X", "IndexMA.X"), 1},
    [AOV_MOTION] = {TWO("motion", "X", "Y"), 1},
    [AOV_SAMPLES] = {ONE("samples.Y", "samples.Y"), 1},
    [AOV_ERROR] = {THREE("error", "error", "R", "G", "B"), 0},
    [AOV_DENOISING] = {ONE("Denoising Depth.Z", "Denoising Depth.Z"), 1},
    [AOV_DENOISING_ALBEDO] = {THREE("Denoising Albedo", "Denoising Albedo", "R", "G", "B"), 0},
    [AOV_DENOISING_NORMAL] = {THREE("Denoising Normal", "Denoising Normal", "X", "Y", "Z"), 0},
    [AOV_EMISSION] = {THREE("emission", "emission", "R", "G", "B"), 0},
    [AOV_VARIANCE] = {THREE("variance", "variance", "R", "G", "B"), 1},
};

/* In addition to AOV_ERROR's own: each tile's error in display codes, in all its pixels. */
static const char *const tile_error_names[EXR_NAMES_COUNT] = {"tileError.Y", "ViewLayer.tileError.Y"};
/* Of the picture without its noise, one plane a channel. */
static const char *const denoised_names[EXR_NAMES_COUNT][3] = THREE("denoised", "denoised", "R", "G", "B");
static const char *const blender_picture[4] = {"ViewLayer.Combined.R", "ViewLayer.Combined.G", "ViewLayer.Combined.B",
                                               "ViewLayer.Combined.A"};

static size_t list_channels(uint32_t aovs, enum exr_names as, struct exr_channel *out)
{
    size_t count = 0;

    for (int aov = 0; aov < AOV_COUNT; aov++)
        for (uint32_t c = 0; aovs >> aov & 1 && c < film_aov_channels((enum aov)aov); c++)
            out[count++] = (struct exr_channel){aov_layers[aov].names[as][c], aov_layers[aov].precise};
    if (aovs >> AOV_ERROR & 1)
        out[count++] = (struct exr_channel){tile_error_names[as], 0};
    return count;
}

static void develop_tile_errors(const struct development *d, uint32_t y, uint32_t height, float *plane)
{
    uint32_t width = film_width(d->film), columns = (width + TILE_SIZE - 1) / TILE_SIZE;

    for (uint32_t row = y; row < y + height; row++)
        for (uint32_t x = 0; x < width; x++)
            *plane++ = d->tile_errors ? d->tile_errors[row / TILE_SIZE * columns + x / TILE_SIZE] : 0;
}

static void develop_denoised(const struct development *d, uint32_t y, uint32_t height, float *planes)
{
    const size_t pixels = (size_t)d->denoised.width * height;
    const float *from = d->denoised.pixels + (size_t)y * d->denoised.width * 3;

    for (size_t i = 0; i < pixels; i++)
        for (size_t c = 0; c < 3; c++)
            planes[c * pixels + i] = from[3 * i + c];
}

static void develop_lines(void *user, uint32_t y, uint32_t height, float *planes)
{
    const struct development *d = user;

    if (d->denoised.pixels) {
        develop_denoised(d, y, height, planes);
        planes += (size_t)d->denoised.width * height * 3;
    }
    for (int aov = 0; d->film && aov < AOV_COUNT; aov++)
        if (d->settings.aovs >> aov & 1 && aov != AOV_ALPHA) { /* that is the picture's fourth channel */
            film_develop_aov(d->film, (enum aov)aov, y, height, planes);
            planes += (size_t)film_aov_channels((enum aov)aov) * film_width(d->film) * height;
        }
    if (d->film && d->settings.aovs >> AOV_ERROR & 1) {
        develop_tile_errors(d, y, height, planes);
        planes += (size_t)film_width(d->film) * height;
    }
    development_mattes_lines(d, y, height, planes);
}

status develop_exr(struct development *d, struct buffer *exr, struct error *err)
{
    struct attributes a = {.count = 0};
    char scene[DIGEST_HEX_SIZE];
    struct error_text text;
    char texts[SETTING_COUNT][SETTING_TEXT_SIZE];
    struct exr_channel channels[EXR_CHANNELS_MAX];
    struct exr_channels more = {.channels = channels, .lines = develop_lines, .user = d};
    char first[HEALTH_KINDS][HEALTH_TEXT_SIZE];
    char mattes[DEVELOPMENT_MATTE_ATTRIBUTES][CRYPTOMATTE_NAME_SIZE];
    struct buffer measured = BUFFER_INIT, command = BUFFER_INIT;
    struct image with_alpha = {0};
    struct development_view view;
    const enum exr_names as = d->settings.exr_names;
    char region[SETTINGS_REGION_TEXT_SIZE];
    uint64_t clamped = 0;
    const struct exr_window window = {d->settings.whole_width, d->settings.whole_height,
                                      d->settings.region_x, d->settings.region_y};
    struct exr_options options = {.half = d->output.exr_half, .clamped = &clamped};
    status s;

    TRY(development_find_view(d, &view, err));
    TRY(development_mattes_begin(d, err));
    digest_to_hex(&d->scene, scene);
    add_text(&a, "azulejo:software", "azulejo " AZULEJO_VERSION);
    add_text(&a, "azulejo:scene", scene);
    add_text(&a, "azulejo:sceneName", d->scene_name);
    add_text(&a, "azulejo:jobName", d->name);
    add_number(&a, "azulejo:frame", d->frame);
    add_samples(&a, d);
    add_settings(&a, &d->settings, texts);
    add_text(&a, "azulejo:kernel", d->ray_tracer);
    develop_command(d, &command);
    add_text(&a, "azulejo:command", buffer_text(&command));
    if (d->described)
        add_point(&a, "azulejo:origin", d->description.origin);
    add_view(&a, &view);
    if (d->schedule.size > 0)
        add_text(&a, SCHEDULE_ATTRIBUTE, buffer_text(&d->schedule));
    add_figures(&a, d, &text);
    add_denoised(&a, d);
    add_work(&a, d, first);
    add_mattes(&a, d, mattes);
    write_measured(d, &measured);
    if (!buffer_ok(&measured) || !buffer_ok(&command)) {
        buffer_release(&measured);
        buffer_release(&command);
        return error_no_memory(err, "the picture's header");
    }
    add_text(&a, MEASURED_ATTRIBUTE, buffer_text(&measured));
    if (d->settings.whole_width) {
        options.window = &window;
        add_text(&a, SETTINGS_REGION_ATTRIBUTE, settings_region_text(&d->settings, region));
    }
    options.attributes = a.items;
    options.attribute_count = a.count;
    if (d->denoised.pixels) {
        for (; more.count < 3; more.count++)
            channels[more.count] = (struct exr_channel){denoised_names[as][more.count], 0};
    }
    if (d->film)
        more.count += list_channels(d->settings.aovs & ~(1u << AOV_ALPHA), as, channels + more.count);
    more.count += development_mattes_channels(d, channels + more.count);
    options.more = &more;
    options.names = as == EXR_NAMES_BLENDER ? blender_picture : NULL;
    s = d->alpha ? develop_with_alpha(&with_alpha, &d->image, d->alpha, err) : STATUS_OK;
    THEN(s, exr_encode(exr, d->alpha ? &with_alpha : &d->image, &options, err));
    image_release(&with_alpha);
    buffer_release(&measured);
    buffer_release(&command);
    if (s == STATUS_OK && clamped > 0)
        log_warn("job %" PRIu64 ", frame %u: %" PRIu64 " values were too large for half floats and "
                 "are 65504 in the EXR file",
                 d->job, d->frame, clamped);
    return s;
}

status development_renew_layer(const struct development *d, struct store *store, struct error *err)
{
    struct buffer before = BUFFER_INIT, after = BUFFER_INIT;
    struct attributes a = {.count = 0};
    char name[64];
    status s = store_output_read(store, d->job, d->frame, "exr", IMAGE_BYTES_MAX, &before, err);

    add_denoised(&a, d);
    snprintf(name, sizeof name, "job %" PRIu64 ", frame %u", d->job, d->frame);
    THEN(s, exr_replace(&after, before.data, before.size, name, denoised_names[d->settings.exr_names], &d->denoised,
                        DENOISED_PREFIX, a.items, a.count, err));
    THEN(s, store_output_write(store, d->job, d->frame, "exr", &after, err));
    buffer_release(&after);
    buffer_release(&before);
    return s == STATUS_ERR_NOT_FOUND ? STATUS_OK : s; /* there is no such file, or no layer in it */
}
