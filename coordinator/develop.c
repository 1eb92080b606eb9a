#include "coordinator/develop.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/base/log.h"
#include "common/base/memory.h"
#include "common/image/image.h"
#include "common/scene/effects.h"
#include "common/scene/manifest.h"
#include "common/scene/scene.h"
#include "coordinator/blobs.h"

enum { ATTRIBUTES_MAX = 26 };

struct development {
    uint64_t job;
    char name[JOB_NAME_MAX + 1], scene_name[JOB_NAME_MAX + 1], kernel[KERNEL_NAME_MAX + 1];
    struct digest scene;
    uint32_t frame;
    struct render_settings settings;
    struct output_settings output;
    uint64_t samples;
    double relative_mse;
    struct work_stats stats;
    const struct film *film; /* NULL: `image` holds a copy, and there are no AOVs */
    int taken;               /* `image` holds the film's means */
    struct image image;
};

static status development_new(struct development **out, const struct job_frame *frame,
                              struct error *err)
{
    const struct job *job = frame->job;
    struct development *d = mem_calloc(1, sizeof *d);

    *out = NULL;
    if (!d)
        return error_no_memory(err, "a picture");
    d->job = job->id;
    memcpy(d->name, job->name, sizeof d->name);
    memcpy(d->scene_name, job->scene_name, sizeof d->scene_name);
    memcpy(d->kernel, job->kernel, sizeof d->kernel);
    d->scene = job->scene;
    d->frame = frame->number;
    d->settings = job->settings;
    d->output = job->output;
    d->samples = film_samples(frame->film);
    d->relative_mse = film_relative_mse(frame->film);
    d->stats = frame->stats;
    d->film = frame->film;
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
    return development_new(out, frame, err);
}

status development_new_preview(struct development **out, const struct job_frame *frame,
                               struct error *err)
{
    status s = development_new(out, frame, err);

    if (s == STATUS_OK)
        s = take_pixels(*out, err);
    if (s == STATUS_OK)
        (*out)->film = NULL; /* which goes on changing */
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
    image_release(&development->image);
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

static size_t list_channels(uint32_t aovs, struct exr_channel *out)
{
    size_t count = 0;

    for (int aov = 0; aov < AOV_COUNT; aov++)
        for (uint32_t c = 0; aovs >> aov & 1 && c < film_aov_channels((enum aov)aov); c++)
            out[count++] =
                (struct exr_channel){aov_layers[aov].names[c], aov_layers[aov].precise};
    return count;
}

static void develop_lines(void *user, uint32_t y, uint32_t height, float *planes)
{
    const struct development *d = user;

    for (int aov = 0; aov < AOV_COUNT; aov++)
        if (d->settings.aovs >> aov & 1) {
            film_develop_aov(d->film, (enum aov)aov, y, height, planes);
            planes += (size_t)film_aov_channels((enum aov)aov) * film_width(d->film) * height;
        }
}

/* ---- files ---------------------------------------------------------------------------------- */

static status encode_exr(struct development *d, struct buffer *exr, struct error *err)
{
    struct attributes a = {.count = 0};
    char scene[DIGEST_HEX_SIZE], seed[24];
    char without[SETTINGS_TEXT_SIZE];
    struct exr_channel channels[EXR_CHANNELS_MAX];
    struct exr_channels more = {.channels = channels, .lines = develop_lines, .user = d};
    uint64_t clamped = 0;
    struct exr_options options = {.half = d->output.exr_half, .clamped = &clamped};
    status s;

    digest_to_hex(&d->scene, scene);
    snprintf(seed, sizeof seed, "%" PRIu64, d->settings.seed);
    add_text(&a, "azulejo:software", "azulejo " AZULEJO_VERSION);
    add_text(&a, "azulejo:scene", scene);
    add_text(&a, "azulejo:sceneName", d->scene_name);
    add_text(&a, "azulejo:jobName", d->name);
    add_number(&a, "azulejo:job", (double)d->job);
    add_number(&a, "azulejo:frame", d->frame);
    add_number(&a, "azulejo:spp", d->settings.spp);
    add_number(&a, "azulejo:samples", (double)d->samples);
    add_number(&a, "azulejo:maxDepth", d->settings.max_depth);
    add_text(&a, "azulejo:seed", seed);
    add_number(&a, "azulejo:camera", d->settings.camera);
    add_number(&a, "azulejo:envRotateDeg", d->settings.env_rotate_deg);
    add_number(&a, "azulejo:envStrength", d->settings.env_strength);
    add_text(&a, "azulejo:envSampling", env_sampling_name(d->settings.env_sampling));
    add_text(&a, "azulejo:isa", isa_name(d->settings.isa));
    add_extras(&a, &d->settings, without);
    add_text(&a, "azulejo:kernel", d->kernel);
    if (isfinite(d->relative_mse))
        add_number(&a, "azulejo:relativeMse", d->relative_mse);
    options.attributes = a.items;
    options.attribute_count = a.count;
    more.count = d->film ? list_channels(d->settings.aovs, channels) : 0;
    options.more = &more;
    s = exr_encode(exr, &d->image, &options, err);
    if (s == STATUS_OK && clamped > 0)
        log_warn("job %" PRIu64 ", frame %u: %" PRIu64 " values were too large for half floats and "
                 "are 65504 in the EXR file",
                 d->job, d->frame, clamped);
    return s;
}

static status encode_png(const struct development *d, struct buffer *png, struct error *err)
{
    struct image display = {0};
    status s = tonemap_apply(&display, &d->image, &d->output.tonemap, NULL, err);

    if (s == STATUS_OK)
        s = png_encode(png, &display, err);
    image_release(&display);
    return s;
}

status develop_encode(struct development *development, struct buffer *exr, struct buffer *png,
                      struct error *err)
{
    status s = take_pixels(development, err);

    if (s == STATUS_OK && exr)
        s = encode_exr(development, exr, err);
    if (s == STATUS_OK && png)
        s = encode_png(development, png, err);
    return s;
}

/* What the frame calls for, from its stored scene. The causes' names belong to `scene`. */
static status find_effects(const struct development *d, const struct store *store,
                           struct scene *scene, struct manifest *m,
                           struct effect_cause causes[EFFECT_COUNT], struct error *err)
{
    struct render_settings whole = d->settings;
    struct buffer packed = BUFFER_INIT;
    status s = blobs_read(store_folder(store), &d->scene, SCENE_BYTES_MAX, &packed, err);

    if (s == STATUS_OK)
        s = scene_unpack(scene, packed.data, packed.size, err);
    buffer_release(&packed);
    if (s != STATUS_OK)
        return s;
    whole.without = 0;
    m->called_for = scene_effects(scene, &whole, d->frame, causes);
    m->causes = causes;
    /* The worker knows best: it has seen the textures and the motion. */
    if (!m->effects)
        m->effects = scene_effects(scene, &d->settings, d->frame, NULL);
    return STATUS_OK;
}

status develop_manifest(const struct development *d, const struct store *store,
                        struct buffer *json, struct error *err)
{
    struct effect_cause causes[EFFECT_COUNT];
    char digest[DIGEST_HEX_SIZE];
    struct manifest m = {
        .job_name = d->name, .scene_name = d->scene_name, .renderer = d->kernel,
        .scene_digest = digest, .job = d->job, .frame = d->frame, .effects = d->stats.effects,
        .without = d->settings.without, .frame_samples = d->samples, .samples = d->stats.samples,
        .rays = d->stats.rays, .vertices = d->stats.vertices, .cpu_ns = d->stats.cpu_ns,
    };
    struct error why = {0};
    struct scene scene;

    digest_to_hex(&d->scene, digest);
    memcpy(m.stages, d->stats.stages, sizeof m.stages);
    scene_init(&scene);
    /* The picture is what counts: a manifest that names nobody must not keep it back. */
    if (find_effects(d, store, &scene, &m, causes, &why) != STATUS_OK)
        log_warn("job %" PRIu64 ", frame %u: its manifest will not tell who called for which "
                 "effect: %s",
                 d->job, d->frame, why.text);
    manifest_write(json, &m);
    scene_release(&scene);
    return buffer_ok(json) ? STATUS_OK : error_no_memory(err, "a manifest");
}

status develop_frame(struct development *d, struct store *store, struct error *err)
{
    struct buffer exr = BUFFER_INIT, png = BUFFER_INIT, json = BUFFER_INIT;
    status s = develop_encode(d, d->output.exr ? &exr : NULL, d->output.png ? &png : NULL, err);

    if (s == STATUS_OK && d->output.exr)
        s = store_output_write(store, d->job, d->frame, "exr", &exr, err);
    if (s == STATUS_OK && d->output.png)
        s = store_output_write(store, d->job, d->frame, "png", &png, err);
    if (s == STATUS_OK)
        s = develop_manifest(d, store, &json, err);
    if (s == STATUS_OK)
        s = store_output_write(store, d->job, d->frame, MANIFEST_EXTENSION, &json, err);
    if (s == STATUS_OK)
        s = store_frame_done(store, d->job, d->frame, d->relative_mse, err);
    buffer_release(&exr);
    buffer_release(&png);
    buffer_release(&json);
    return s;
}

status develop_preview(struct development *development, struct buffer *png, struct error *err)
{
    return develop_encode(development, NULL, png, err);
}
