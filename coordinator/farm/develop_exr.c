/* A frame as an EXR file: its header, its layers. */
#include "coordinator/farm/develop_parts.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/accuracy/schedule.h"
#include "common/accuracy/word.h"
#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/base/memory.h"
#include "common/image/image.h"
#include "coordinator/farm/measured.h"

enum { ATTRIBUTES_MAX = 64 + 2 * HEALTH_KINDS };

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
static void add_work(struct attributes *a, const struct development *d,
                     char first[HEALTH_KINDS][HEALTH_TEXT_SIZE])
{
    const struct unit_work *w = &d->work;

    add_number(a, "azulejo:rays", (double)w->rays);
    add_number(a, "azulejo:vertices", (double)w->vertices);
    add_number(a, "azulejo:leakedRays", (double)w->leaked_rays);
    for (int k = 0; k < HEALTH_KINDS; k++) {
        add_number(a, health_rows[k].attribute, (double)w->health.count[k]);
        health_first_text(first[k], w->health.first[k], settings_rect(&d->settings));
        if (first[k][0])
            add_text(a, health_rows[k].attribute_first, first[k]);
    }
    if (depth_light_is_known(&w->depth))
        add_number(a, "azulejo:endedByDepth",
                   depth_light_report(&w->depth, w->samples, d->settings.max_depth).share);
}

static void write_measured(const struct development *d, struct buffer *out)
{
    struct measured m = {.job = d->job, .submitted_at = d->submitted_at, .written_at = clock_wall_s(),
                         .workers = d->film ? measured_workers(d->film) : 0,
                         .cpu_ns = d->stats.cpu_ns, .trace_ns = d->stats.trace_ns};

    measured_write(out, &m);
}

/* Settings that only some jobs have. */
static void add_extras(struct attributes *a, const struct render_settings *s,
                       char without[SETTINGS_TEXT_SIZE])
{
    add_number(a, "azulejo:fps", s->fps);
    if (s->shutter > 0)
        add_number(a, "azulejo:shutter", s->shutter);
    if (s->lens_radius >= 0)
        add_number(a, "azulejo:lensRadius", s->lens_radius);
    if (s->focus_distance > 0)
        add_number(a, "azulejo:focusDistance", s->focus_distance);
    if (s->without)
        add_text(a, "azulejo:without", settings_effects_text(s->without, without));
}

/* Algorithms other than the defaults, and the effect of clamping on the frame. */
static void add_choices(struct attributes *a, const struct development *d)
{
    const struct render_settings *s = &d->settings;

    if (s->sampler != SAMPLER_SOBOL)
        add_text(a, "azulejo:sampler", sampler_name(s->sampler));
    if (s->light_choice != LIGHT_CHOICE_TREE)
        add_text(a, "azulejo:lightChoice", light_choice_name(s->light_choice));
    if (s->no_roulette)
        add_text(a, "azulejo:roulette", "off");
    if (s->texture_filter != TEXTURE_FILTER_CONE)
        add_text(a, "azulejo:textureFilter", texture_filter_name(s->texture_filter));
    if (s->bvh_quality != BVH_QUALITY_MEDIUM)
        add_text(a, "azulejo:bvhQuality", bvh_quality_name(s->bvh_quality));
    if (s->not_robust)
        add_text(a, "azulejo:robust", "off");
    if (s->clamp > 0) {
        add_number(a, "azulejo:clamp", (double)s->clamp);
        add_number(a, "azulejo:clampedSamples", (double)d->work.clamped_samples);
        add_number(a, "azulejo:clampedShare", unit_work_clamped_share(&d->work));
    }
}

static void add_known(struct attributes *a, const char *name, double number)
{
    if (isfinite(number))
        add_number(a, name, number);
}

struct error_text {
    char transform[MEASURE_TEXT_MAX], reason[ACCURACY_WORDS_SIZE];
};

/* The picture's estimated errors. A preview has those that were computed last. */
static void add_figures(struct attributes *a, const struct development *d,
                        struct error_text *text)
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
}

/* ---- AOVs ----------------------------------------------------------------------------------- */

/* The channels of each, as compositors name them (docs/AOV.md). */
static const struct {
    const char *names[3];
    int precise; /* float even in a file of halves */
} aov_layers[AOV_COUNT] = {
    [AOV_DEPTH] = {{"Z"}, 1},
    [AOV_NORMAL] = {{"N.X", "N.Y", "N.Z"}, 0},
    [AOV_ALBEDO] = {{"albedo.R", "albedo.G", "albedo.B"}, 0},
    [AOV_POSITION] = {{"P.X", "P.Y", "P.Z"}, 1},
    [AOV_UV] = {{"uv.U", "uv.V"}, 1},
    [AOV_OBJECT_ID] = {{"objectId.X"}, 1},
    [AOV_MATERIAL_ID] = {{"materialId.X"}, 1},
    [AOV_MOTION] = {{"motion.X", "motion.Y"}, 1},
    [AOV_SAMPLES] = {{"samples.Y"}, 1},
    [AOV_ERROR] = {{"error.R", "error.G", "error.B"}, 0},
};

/* In addition to AOV_ERROR's own: each tile's error in display codes, in all its pixels. */
static const struct exr_channel tile_error_channel = {"tileError.Y", 0};

static size_t list_channels(uint32_t aovs, struct exr_channel *out)
{
    size_t count = 0;

    for (int aov = 0; aov < AOV_COUNT; aov++)
        for (uint32_t c = 0; aovs >> aov & 1 && c < film_aov_channels((enum aov)aov); c++)
            out[count++] =
                (struct exr_channel){aov_layers[aov].names[c], aov_layers[aov].precise};
    if (aovs >> AOV_ERROR & 1)
        out[count++] = tile_error_channel;
    return count;
}

static void develop_tile_errors(const struct development *d, uint32_t y, uint32_t height, float *plane)
{
    uint32_t width = film_width(d->film), columns = (width + TILE_SIZE - 1) / TILE_SIZE;

    for (uint32_t row = y; row < y + height; row++)
        for (uint32_t x = 0; x < width; x++)
            *plane++ = d->tile_errors ? d->tile_errors[row / TILE_SIZE * columns + x / TILE_SIZE] : 0;
}

static void develop_lines(void *user, uint32_t y, uint32_t height, float *planes)
{
    const struct development *d = user;

    for (int aov = 0; aov < AOV_COUNT; aov++)
        if (d->settings.aovs >> aov & 1 && aov != AOV_ALPHA) { /* that is the picture's fourth channel */
            film_develop_aov(d->film, (enum aov)aov, y, height, planes);
            planes += (size_t)film_aov_channels((enum aov)aov) * film_width(d->film) * height;
        }
    if (d->settings.aovs >> AOV_ERROR & 1)
        develop_tile_errors(d, y, height, planes);
}

status develop_exr(struct development *d, struct buffer *exr, struct error *err)
{
    struct attributes a = {.count = 0};
    char scene[DIGEST_HEX_SIZE], seed[24];
    struct error_text text;
    char without[SETTINGS_TEXT_SIZE];
    struct exr_channel channels[EXR_CHANNELS_MAX];
    struct exr_channels more = {.channels = channels, .lines = develop_lines, .user = d};
    char first[HEALTH_KINDS][HEALTH_TEXT_SIZE];
    struct buffer measured = BUFFER_INIT, command = BUFFER_INIT;
    struct image with_alpha = {0};
    char region[SETTINGS_REGION_TEXT_SIZE];
    uint64_t clamped = 0;
    const struct exr_window window = {d->settings.whole_width, d->settings.whole_height,
                                      d->settings.region_x, d->settings.region_y};
    struct exr_options options = {.half = d->output.exr_half, .clamped = &clamped};
    status s;

    digest_to_hex(&d->scene, scene);
    snprintf(seed, sizeof seed, "%" PRIu64, d->settings.seed);
    add_text(&a, "azulejo:software", "azulejo " AZULEJO_VERSION);
    add_text(&a, "azulejo:scene", scene);
    add_text(&a, "azulejo:sceneName", d->scene_name);
    add_text(&a, "azulejo:jobName", d->name);
    add_number(&a, "azulejo:frame", d->frame);
    add_number(&a, "azulejo:spp", d->settings.spp);
    add_samples(&a, d);
    add_number(&a, "azulejo:maxDepth", d->settings.max_depth);
    add_text(&a, "azulejo:seed", seed);
    add_number(&a, "azulejo:camera", d->settings.camera);
    add_number(&a, "azulejo:envRotateDeg", d->settings.env_rotate_deg);
    add_number(&a, "azulejo:envStrength", d->settings.env_strength);
    add_text(&a, "azulejo:envSampling", env_sampling_name(d->settings.env_sampling));
    add_text(&a, "azulejo:isa", isa_name(d->settings.isa));
    add_extras(&a, &d->settings, without);
    add_choices(&a, d);
    add_text(&a, "azulejo:kernel", d->kernel);
    develop_command(d, &command);
    add_text(&a, "azulejo:command", buffer_text(&command));
    if (d->described)
        add_point(&a, "azulejo:origin", d->description.origin);
    if (d->schedule.size > 0)
        add_text(&a, SCHEDULE_ATTRIBUTE, buffer_text(&d->schedule));
    add_figures(&a, d, &text);
    add_work(&a, d, first);
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
    more.count = d->film ? list_channels(d->settings.aovs & ~(1u << AOV_ALPHA), channels) : 0;
    options.more = &more;
    s = d->alpha ? develop_with_alpha(&with_alpha, &d->image, d->alpha, err) : STATUS_OK;
    if (s == STATUS_OK)
        s = exr_encode(exr, d->alpha ? &with_alpha : &d->image, &options, err);
    image_release(&with_alpha);
    buffer_release(&measured);
    buffer_release(&command);
    if (s == STATUS_OK && clamped > 0)
        log_warn("job %" PRIu64 ", frame %u: %" PRIu64 " values were too large for half floats and "
                 "are 65504 in the EXR file",
                 d->job, d->frame, clamped);
    return s;
}
