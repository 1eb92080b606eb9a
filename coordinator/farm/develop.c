#include "coordinator/farm/develop.h"

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
#include "common/scene/effects.h"
#include "common/scene/manifest.h"
#include "common/scene/scene.h"
#include "coordinator/store/blobs.h"
#include "coordinator/farm/measure.h"
#include "coordinator/farm/measured.h"
#include "coordinator/job/wire.h"

enum { ATTRIBUTES_MAX = 64 };

struct development {
    uint64_t job;
    char name[JOB_NAME_MAX + 1], scene_name[JOB_NAME_MAX + 1], kernel[KERNEL_NAME_MAX + 1];
    struct digest scene;
    int64_t submitted_at;
    uint32_t frame, first_frame, window_begin;
    uint32_t revision;       /* of `output` */
    struct render_settings settings;
    struct output_settings output;
    struct film_coverage coverage;
    enum frame_end end;      /* FRAME_END_NONE: a preview */
    struct history history;  /* before this development */
    struct history_point point; /* its figures, and what was spent by then */
    int measured;            /* `point` is of this development; else the newest there was, if any */
    double map_max;          /* as in struct job */
    struct measurement measurement; /* copied, if `film` is NULL */
    float *tile_errors;      /* [tiles] display codes, for AOV_ERROR; NULL: not wanted, or not known */
    struct unit_work work;
    struct work_stats stats;
    struct buffer schedule;  /* text (common/accuracy/schedule.h); empty: the rules give the picture again */
    const struct film *film; /* NULL: `image` holds a copy, and there are no AOVs */
    int taken;               /* `image` holds the film's means */
    struct image image;
    int looked, described;   /* `description` was read; it is the job's scene */
    struct scene description;
};

static status take_schedule(struct development *d, struct error *err)
{
    uint32_t tiles = film_tile_count(d->film);
    struct buffer passes = BUFFER_INIT;
    uint8_t *each = buffer_append_space(&passes, (size_t)tiles * GROUPS);
    status s = each ? STATUS_OK : error_no_memory(err, "a schedule");

    for (uint32_t i = 0; i < tiles * GROUPS && each; i++)
        each[i] = (uint8_t)film_tile_passes(d->film, i / GROUPS, i % GROUPS);
    if (s == STATUS_OK)
        s = schedule_encode(&d->schedule, d->settings.width, d->settings.height, d->settings.spp,
                            each, err);
    buffer_release(&passes);
    return s;
}

static status development_new(struct development **out, const struct job *job, uint32_t number,
                              const struct job_frame *frame, struct error *err)
{
    struct development *d = mem_calloc(1, sizeof *d);
    status s = STATUS_OK;

    *out = NULL;
    if (!d)
        return error_no_memory(err, "a picture");
    scene_init(&d->description);
    d->job = job->id;
    memcpy(d->name, job->name, sizeof d->name);
    memcpy(d->scene_name, job->scene_name, sizeof d->scene_name);
    memcpy(d->kernel, job->kernel, sizeof d->kernel);
    d->scene = job->scene;
    d->submitted_at = job->submitted_at;
    d->frame = number;
    d->first_frame = job->first_frame;
    d->window_begin = job_window_begin(job, number);
    d->revision = job->revision;
    d->settings = job->settings;
    d->output = job->output;
    d->map_max = job->map_max;
    if (frame) {
        d->coverage = film_coverage(frame->film);
        d->end = frame->end;
        d->history = frame->history;
        d->point = frame->spent;
        d->work = film_work(frame->film);
        d->stats = frame->stats;
        d->film = frame->film;
        if (frame->end != FRAME_END_NONE && !rounds_made(&frame->rounds, frame->film))
            s = take_schedule(d, err);
    }
    if (s != STATUS_OK) {
        development_free(d);
        return s;
    }
    *out = d;
    return STATUS_OK;
}

/* Copy the film's means into the image. */
static status take_pixels(struct development *d, struct error *err)
{
    status s = STATUS_OK;

    if (d->taken)
        return STATUS_OK;
    s = image_init(&d->image, film_width(d->film), film_height(d->film), 3, err);
    if (s == STATUS_OK)
        film_develop(d->film, d->image.pixels);
    d->taken = s == STATUS_OK;
    return s;
}

status development_new_frame(struct development **out, const struct job_frame *frame,
                             struct error *err)
{
    return development_new(out, frame->job, frame->number, frame, err);
}

status development_new_stored(struct development **out, const struct job *job, uint32_t frame,
                              struct error *err)
{
    return development_new(out, job, frame, NULL, err);
}

status development_new_measure(struct development **out, const struct job_frame *frame,
                               struct error *err)
{
    status s = development_new(out, frame->job, frame->number, frame, err);

    if (s == STATUS_OK)
        s = measurement_take(&(*out)->measurement, frame->film, err);
    if (s == STATUS_OK)
        (*out)->film = NULL; /* which goes on changing */
    if (s != STATUS_OK) {
        development_free(*out);
        *out = NULL;
    }
    return s;
}

status development_new_preview(struct development **out, const struct job_frame *frame,
                               struct error *err)
{
    status s = development_new(out, frame->job, frame->number, frame, err);

    if (s == STATUS_OK)
        s = take_pixels(*out, err);
    if (s == STATUS_OK) {
        (*out)->film = NULL; /* which goes on changing */
        if (history_last(&frame->history))
            (*out)->point = *history_last(&frame->history);
    }
    if (s != STATUS_OK) {
        development_free(*out);
        *out = NULL;
    }
    return s;
}

void development_free(struct development *development)
{
    if (!development)
        return;
    measurement_release(&development->measurement);
    buffer_release(&development->schedule);
    image_release(&development->image);
    scene_release(&development->description);
    mem_free(development->tile_errors);
    mem_free(development);
}

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

static double mean_samples(const struct development *d)
{
    return (double)d->coverage.samples / ((double)d->settings.width * d->settings.height);
}

static int is_full(const struct development *d)
{
    return d->coverage.least == d->settings.spp;
}

/* Has it all that was asked for? */
static int is_whole(const struct development *d)
{
    return is_full(d) || frame_end_is_whole(d->end);
}

/* What there is: a frame of a cancelled job may have less than azulejo:spp, and not everywhere
 * alike. */
static void add_samples(struct attributes *a, const struct development *d)
{
    add_number(a, "azulejo:samples", (double)d->coverage.samples);
    add_number(a, "azulejo:complete", is_whole(d));
    add_number(a, "azulejo:samplesMin", d->coverage.least);
    add_number(a, "azulejo:samplesMean", mean_samples(d));
    add_number(a, "azulejo:samplesMax", d->coverage.most);
    add_number(a, "azulejo:tilesWithoutSamples", d->coverage.tiles_empty);
}

/* What is in the film, and what went wrong in it: the same on every farm. */
static void add_work(struct attributes *a, const struct unit_work *w)
{
    add_number(a, "azulejo:rays", (double)w->rays);
    add_number(a, "azulejo:vertices", (double)w->vertices);
    add_number(a, "azulejo:droppedSamples", (double)w->dropped_samples);
    add_number(a, "azulejo:leakedRays", (double)w->leaked_rays);
    add_number(a, "azulejo:clampedValues", (double)w->clamped_values);
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

/* Choices of algorithm that are not the default's; what clamping did with the frame. */
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

/* What the frame calls for, by its description: the same on every farm, and after a restart. */
static uint64_t effects_of(const struct development *d)
{
    return d->described ? scene_effects(&d->description, &d->settings, d->frame, NULL) : 0;
}

struct error_text {
    char transform[MEASURE_TEXT_MAX], reason[ACCURACY_WORDS_SIZE];
};

/* How wrong the picture is. A preview's are of the last time that they were computed. */
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
        add_text(a, "azulejo:errorReason", accuracy_reason_text(f, effects_of(d), text->reason));
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

/* Beside AOV_ERROR's own: each tile's error in display codes, in all its pixels. */
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
        if (d->settings.aovs >> aov & 1) {
            film_develop_aov(d->film, (enum aov)aov, y, height, planes);
            planes += (size_t)film_aov_channels((enum aov)aov) * film_width(d->film) * height;
        }
    if (d->settings.aovs >> AOV_ERROR & 1)
        develop_tile_errors(d, y, height, planes);
}

/* ---- files ---------------------------------------------------------------------------------- */

/* Read the job's scene, once. A damaged one does not hold the picture back: only its header and its
 * manifest say less then. What the environment did is an error. */
static status describe(struct development *d, const struct store *store, struct error *err)
{
    struct buffer packed = BUFFER_INIT;
    struct error why = {0};
    status s;

    if (d->looked || !store)
        return STATUS_OK;
    s = blobs_read(store_folder(store), &d->scene, SCENE_BYTES_MAX, &packed, &why);
    if (s == STATUS_OK)
        s = scene_unpack(&d->description, packed.data, packed.size, &why);
    buffer_release(&packed);
    d->described = s == STATUS_OK;
    if (status_is_environment(s))
        return error_set(err, s, "%s", why.text);
    d->looked = 1;
    if (s != STATUS_OK)
        log_warn("job %" PRIu64 ", frame %u: its header lacks the scene's origin and its manifest "
                 "the causes of its effects: %s",
                 d->job, d->frame, why.text);
    return STATUS_OK;
}

static status encode_exr(struct development *d, struct buffer *exr, struct error *err)
{
    struct attributes a = {.count = 0};
    char scene[DIGEST_HEX_SIZE], seed[24];
    struct error_text text;
    char without[SETTINGS_TEXT_SIZE];
    struct exr_channel channels[EXR_CHANNELS_MAX];
    struct exr_channels more = {.channels = channels, .lines = develop_lines, .user = d};
    struct buffer measured = BUFFER_INIT;
    uint64_t clamped = 0;
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
    if (d->described)
        add_point(&a, "azulejo:origin", d->description.origin);
    if (d->schedule.size > 0)
        add_text(&a, SCHEDULE_ATTRIBUTE, buffer_text(&d->schedule));
    add_figures(&a, d, &text);
    add_work(&a, &d->work);
    write_measured(d, &measured);
    if (!buffer_ok(&measured)) {
        buffer_release(&measured);
        return error_no_memory(err, "the picture's header");
    }
    add_text(&a, MEASURED_ATTRIBUTE, buffer_text(&measured));
    options.attributes = a.items;
    options.attribute_count = a.count;
    more.count = d->film ? list_channels(d->settings.aovs, channels) : 0;
    options.more = &more;
    s = exr_encode(exr, &d->image, &options, err);
    buffer_release(&measured);
    if (s == STATUS_OK && clamped > 0)
        log_warn("job %" PRIu64 ", frame %u: %" PRIu64 " values were too large for half floats and "
                 "are 65504 in the EXR file",
                 d->job, d->frame, clamped);
    return s;
}

/* ---- display pictures ------------------------------------------------------------------------ */

/* Tone mapping of one development: its settings, and the operator's file. */
struct toning {
    const struct tonemap_settings *settings;
    struct tonemap_context context;
    struct buffer file;
};

static status toning_begin(struct toning *t, const struct development *d,
                           const struct store *store, struct error *err)
{
    status s;

    *t = (struct toning){.settings = &d->output.tonemap, .file = BUFFER_INIT};
    if (!t->settings->has_file || !store)
        return STATUS_OK;
    s = blobs_read(store_folder(store), &t->settings->file, TONEMAP_FILE_BYTES_MAX, &t->file, err);
    t->context.file_data = t->file.data;
    t->context.file_size = t->file.size;
    return s;
}

static void toning_end(struct toning *t)
{
    buffer_release(&t->file);
}

/* What of the environment's map a path may meet by chance; asked only where caustics are. What is wrong with
 * the map itself is the workers' to say. */
static status find_map_max(struct development *d, const struct store *store, struct error *err)
{
    const struct scene_environment *e = &d->description.environment;
    struct buffer file = BUFFER_INIT;
    struct image_repairs repairs = {0};
    struct image map = {0};
    float most = 0;
    status s;

    if (!isnan(d->map_max) || !d->described || !e->present || e->constant ||
        !(effects_of(d) & EFFECT_CAUSTICS))
        return STATUS_OK;
    s = blobs_read(store_folder(store), &e->image.blob.digest, IMAGE_BYTES_MAX, &file, err);
    if (s == STATUS_OK)
        s = image_decode_hdr(&map, file.data, file.size, "the environment", &repairs, err);
    for (size_t i = 0; s == STATUS_OK && i < (size_t)map.width * map.height * map.channels; i++)
        most = map.pixels[i] > most ? map.pixels[i] : most;
    d->map_max = (double)most;
    image_release(&map);
    buffer_release(&file);
    return status_is_environment(s) ? s : STATUS_OK;
}

static double brightest_of(const struct development *d)
{
    if (!d->described)
        return 0;
    return accuracy_brightest(&d->description, (double)d->settings.env_strength,
                              isnan(d->map_max) ? 0 : d->map_max);
}

static status find_figures(struct development *d, const struct store *store, struct error *err)
{
    struct accuracy_map map = {0};
    struct toning t;
    status s;

    if (d->film && d->settings.aovs >> AOV_ERROR & 1 && !d->tile_errors) {
        d->tile_errors = mem_calloc(tile_count(film_width(d->film), film_height(d->film)),
                                    sizeof *d->tile_errors);
        if (!d->tile_errors)
            return error_no_memory(err, "the tiles' errors");
    }
    map.display = d->tile_errors;
    s = describe(d, store, err);
    if (s == STATUS_OK)
        s = find_map_max(d, store, err);
    if (s == STATUS_OK && d->film)
        s = measurement_take(&d->measurement, d->film, err);
    if (s == STATUS_OK)
        s = toning_begin(&t, d, store, err);
    if (s == STATUS_OK) {
        t.context.threads = 1; /* rendering has the others */
        s = measurement_figures(&d->measurement, &d->output.tonemap, &t.context, effects_of(d),
                                brightest_of(d), &d->point.figures, &map, err);
        toning_end(&t);
    }
    measurement_release(&d->measurement);
    return s;
}

status develop_figures(struct development *d, struct store *store, struct error *err)
{
    status s = find_figures(d, store, err);

    if (s == STATUS_OK)
        s = store_history_add(store, d->job, d->frame, history_add(&d->history, &d->point),
                              &d->point, err);
    d->measured = s == STATUS_OK;
    return s;
}

double development_map_max(const struct development *d)
{
    return d->map_max;
}

const struct history_point *development_point(const struct development *d)
{
    return d->measured ? &d->point : NULL;
}

/* Append the picture as PNG or JPEG, either of which may be NULL. */
static status encode_display(const struct development *d, const struct toning *t,
                             struct buffer *png, struct buffer *jpg, struct error *err)
{
    struct image display = {0};
    status s = tonemap_apply(&display, &d->image, t->settings, &t->context, err);

    if (s == STATUS_OK && png)
        s = png_encode_as(png, &display, &d->output.picture, err);
    if (s == STATUS_OK && jpg)
        s = jpeg_encode(jpg, &display, &d->output.picture, err);
    image_release(&display);
    return s;
}

static status write_display(const struct development *d, const struct toning *t,
                            struct store *store, struct error *err)
{
    struct buffer png = BUFFER_INIT, jpg = BUFFER_INIT;
    status s = STATUS_OK;

    if (d->output.png || d->output.jpg)
        s = encode_display(d, t, d->output.png ? &png : NULL, d->output.jpg ? &jpg : NULL, err);
    if (s == STATUS_OK && d->output.png)
        s = store_output_write(store, d->job, d->frame, "png", &png, err);
    if (s == STATUS_OK && d->output.jpg)
        s = store_output_write(store, d->job, d->frame, "jpg", &jpg, err);
    buffer_release(&png);
    buffer_release(&jpg);
    return s;
}

status develop_encode(struct development *d, const struct store *store, struct buffer *exr,
                      struct buffer *png, struct error *err)
{
    struct toning t;
    status s = take_pixels(d, err);

    if (s == STATUS_OK && exr)
        s = d->film ? find_figures(d, store, err) : describe(d, store, err);
    if (s == STATUS_OK && exr)
        s = encode_exr(d, exr, err);
    if (s != STATUS_OK || !png)
        return s;
    s = toning_begin(&t, d, store, err);
    if (s == STATUS_OK)
        s = encode_display(d, &t, png, NULL, err);
    toning_end(&t);
    return s;
}

/* ---- stored pictures ------------------------------------------------------------------------- */

#define PICTURE_EXTENSION "picture.exr"
#define STATE_EXTENSION "state"

/* The means in 32 bits are kept, so that the frame can be developed again. */
static int picture_is_apart(const struct development *d)
{
    return !d->output.exr || d->output.exr_half;
}

static status write_picture(const struct development *d, struct store *store, struct error *err)
{
    struct buffer exr = BUFFER_INIT;
    struct exr_options options = {0};
    status s = exr_encode(&exr, &d->image, &options, err);

    if (s == STATUS_OK)
        s = store_output_write(store, d->job, d->frame, PICTURE_EXTENSION, &exr, err);
    buffer_release(&exr);
    return s;
}

/* Read a frame's stored picture. */
static status read_picture(const struct development *d, const struct store *store, uint32_t frame,
                           struct image *out, struct error *err)
{
    struct buffer exr = BUFFER_INIT;
    struct image_repairs repairs = {0};
    char name[64];
    status s = STATUS_ERR_NOT_FOUND;

    snprintf(name, sizeof name, "job %" PRIu64 ", frame %u", d->job, frame);
    if (picture_is_apart(d))
        s = store_output_read(store, d->job, frame, PICTURE_EXTENSION, IMAGE_BYTES_MAX, &exr, err);
    if (s == STATUS_ERR_NOT_FOUND) { /* stores of before have no such file */
        buffer_clear(&exr);
        s = store_output_read(store, d->job, frame, "exr", IMAGE_BYTES_MAX, &exr, err);
    }
    if (s == STATUS_OK)
        s = image_decode_hdr(out, exr.data, exr.size, name, &repairs, err);
    buffer_release(&exr);
    return s;
}

/* A state in a file: the digest of the settings that it was measured with, then its bytes, which
 * only this machine reads again; anything else there is measured again. */
struct stored_state {
    struct digest looks;
    struct tonemap_state state;
};

/* The state of another frame, or of this one: as stored, else measured and stored. */
static status state_of(const struct development *d, const struct toning *t, struct store *store,
                       uint32_t frame, const struct digest *looks, struct tonemap_state *out,
                       struct error *err)
{
    struct buffer file = BUFFER_INIT;
    struct image other = {0};
    struct stored_state stored;
    status s;

    if (store_output_read(store, d->job, frame, STATE_EXTENSION, sizeof stored, &file, NULL) ==
            STATUS_OK &&
        file.size == sizeof stored) {
        memcpy(&stored, file.data, sizeof stored);
        if (digest_equal(&stored.looks, looks)) {
            *out = stored.state;
            buffer_release(&file);
            return STATUS_OK;
        }
    }
    buffer_clear(&file);
    s = frame == d->frame ? STATUS_OK : read_picture(d, store, frame, &other, err);
    memset(&stored, 0, sizeof stored);
    if (s == STATUS_OK)
        s = tonemap_measure(&stored.state, frame == d->frame ? &d->image : &other, t->settings,
                            &t->context, err);
    if (s == STATUS_OK) {
        stored.looks = *looks;
        *out = stored.state;
        buffer_append(&file, &stored, sizeof stored);
        /* Without it the next frame measures again. */
        if (!buffer_ok(&file) ||
            store_output_write(store, d->job, frame, STATE_EXTENSION, &file, NULL) != STATUS_OK)
            log_debug("job %" PRIu64 ", frame %u: its statistics were not kept", d->job, frame);
    }
    image_release(&other);
    buffer_release(&file);
    return s;
}

/* The mean state of the frames from window_begin to the development's own. */
static status window_state(const struct development *d, const struct toning *t,
                           struct store *store, struct tonemap_state *out, struct error *err)
{
    uint32_t count = d->frame - d->window_begin + 1;
    struct tonemap_state *states = mem_alloc_array(count, sizeof *states);
    const struct tonemap_state **pointers = mem_alloc_array(count, sizeof *pointers);
    struct digest looks;
    status s = states && pointers ? wire_output_digest(&looks, &d->output, err)
                                  : error_no_memory(err, "frames' statistics");

    for (uint32_t i = 0; i < count && s == STATUS_OK; i++) {
        pointers[i] = &states[i];
        s = state_of(d, t, store, d->window_begin + i, &looks, &states[i], err);
    }
    if (s == STATUS_OK)
        tonemap_state_mean(out, pointers, count, &d->output.tonemap);
    mem_free(pointers);
    mem_free(states);
    return s;
}

status develop_again(struct development *d, struct store *store, struct error *err)
{
    struct tonemap_state *state = mem_alloc(sizeof *state);
    struct toning t;
    status s = state ? STATUS_OK : error_no_memory(err, "a frame's statistics");

    if (s == STATUS_OK)
        s = read_picture(d, store, d->frame, &d->image, err);
    if (s == STATUS_OK)
        s = toning_begin(&t, d, store, err);
    if (s == STATUS_OK) {
        if (d->output.tonemap.temporal > 1) {
            s = window_state(d, &t, store, state, err);
            t.context.state = state;
        }
        if (s == STATUS_OK)
            s = write_display(d, &t, store, err);
        toning_end(&t);
    }
    if (s == STATUS_OK)
        s = store_frame_developed(store, d->job, d->frame, d->revision, err);
    mem_free(state);
    return s;
}

/* ---- the manifest ---------------------------------------------------------------------------- */

/* What the frame calls for. The causes' names belong to the description. */
static void find_effects(const struct development *d, struct manifest *m,
                         struct effect_cause causes[EFFECT_COUNT])
{
    struct render_settings whole = d->settings;

    whole.without = 0;
    m->called_for = scene_effects(&d->description, &whole, d->frame, causes);
    m->causes = causes;
    /* The worker knows best: it has seen the textures and the motion. */
    if (!m->effects)
        m->effects = scene_effects(&d->description, &d->settings, d->frame, NULL);
}

status develop_manifest(struct development *d, const struct store *store, struct buffer *json,
                        struct error *err)
{
    struct effect_cause causes[EFFECT_COUNT];
    char digest[DIGEST_HEX_SIZE];
    struct manifest m = {
        .job_name = d->name, .scene_name = d->scene_name, .renderer = d->kernel,
        .scene_digest = digest, .job = d->job, .frame = d->frame, .effects = d->stats.effects,
        .without = d->settings.without, .frame_samples = d->coverage.samples, .complete = is_whole(d),
        .pixel_samples = {d->coverage.least, mean_samples(d), d->coverage.most},
        .tiles_empty = d->coverage.tiles_empty, .samples = d->work.samples,
        .rays = d->work.rays, .vertices = d->work.vertices, .cpu_ns = d->stats.cpu_ns,
    };
    status s;

    digest_to_hex(&d->scene, digest);
    memcpy(m.stages, d->stats.stages, sizeof m.stages);
    memcpy(m.accounts, d->stats.accounts, sizeof m.accounts);
    s = describe(d, store, err);
    if (s != STATUS_OK)
        return s;
    if (d->described)
        find_effects(d, &m, causes);
    manifest_write(json, &m);
    return buffer_ok(json) ? STATUS_OK : error_no_memory(err, "a manifest");
}

int64_t development_revision(const struct development *d)
{
    return d->film && d->output.tonemap.temporal > 1 ? -1 : (int64_t)d->revision;
}

/* The display pictures, unless they are for develop_again. */
static status develop_display(const struct development *d, struct store *store, struct error *err)
{
    struct toning t;
    status s;

    if (development_revision(d) < 0)
        return STATUS_OK;
    s = toning_begin(&t, d, store, err);
    if (s == STATUS_OK)
        s = write_display(d, &t, store, err);
    toning_end(&t);
    return s;
}

status develop_frame(struct development *d, struct store *store, struct error *err)
{
    struct buffer exr = BUFFER_INIT, json = BUFFER_INIT;
    status s = take_pixels(d, err);

    if (s == STATUS_OK)
        s = describe(d, store, err);
    if (s == STATUS_OK)
        s = develop_figures(d, store, err);
    if (s == STATUS_OK && d->output.exr)
        s = encode_exr(d, &exr, err);
    if (s == STATUS_OK && d->output.exr)
        s = store_output_write(store, d->job, d->frame, "exr", &exr, err);
    if (s == STATUS_OK && picture_is_apart(d))
        s = write_picture(d, store, err);
    if (s == STATUS_OK)
        s = develop_display(d, store, err);
    if (s == STATUS_OK)
        s = develop_manifest(d, store, &json, err);
    if (s == STATUS_OK)
        s = store_output_write(store, d->job, d->frame, MANIFEST_EXTENSION, &json, err);
    if (s == STATUS_OK)
        s = store_frame_done(store, d->job, d->frame, development_revision(d), d->end,
                             is_full(d) ? NULL : &d->coverage, &d->work, err);
    buffer_release(&exr);
    buffer_release(&json);
    return s;
}

