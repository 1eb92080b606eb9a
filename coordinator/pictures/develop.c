#include "coordinator/pictures/develop_parts.h"

#include <string.h>

#include "common/accuracy/schedule.h"
#include "common/base/memory.h"
#include "common/system/clock.h"
#include "common/system/parallel.h"
#include "common/scene/manifest.h"
#include "coordinator/pictures/fill.h"
#include "coordinator/pictures/measured.h"

static status take_schedule(struct development *d, struct error *err)
{
    uint32_t tiles = film_tile_count(d->film);
    struct buffer passes = BUFFER_INIT;
    uint8_t *each = buffer_append_space(&passes, (size_t)tiles * GROUPS);
    status s = each ? STATUS_OK : error_no_memory(err, "a schedule");

    for (uint32_t i = 0; i < tiles * GROUPS && each; i++)
        each[i] = (uint8_t)film_tile_passes(d->film, i / GROUPS, i % GROUPS);
    THEN(s, schedule_encode(&d->schedule, d->settings.width, d->settings.height, d->settings.spp, each, err));
    buffer_release(&passes);
    return s;
}

static status development_new(struct development **out, const struct job *job, uint32_t number,
                              const struct job_frame *frame, struct error *err)
{
    struct development *d = mem_calloc(1, sizeof *d);
    status s = STATUS_OK;

    *out = NULL;
    NEED(d, err, "a picture");
    scene_init(&d->description);
    d->job = job->id;
    d->epoch_floor = job->epoch_floor;
    memcpy(d->name, job->name, sizeof d->name);
    memcpy(d->scene_name, job->scene_name, sizeof d->scene_name);
    memcpy(d->ray_tracer, job->ray_tracer, sizeof d->ray_tracer);
    memcpy(d->source, job->source, sizeof d->source);
    d->stop = job->stop;
    d->scene = job->scene;
    d->submitted_at = job->submitted_at;
    d->frame = number;
    d->first_frame = job->first_frame;
    d->window_begin = job_window_begin(job, number);
    if (!frame) /* one in work is made by itself at first */
        d->around_count = job_frames_around(job, number, d->around);
    d->revision = job->revision;
    d->settings = job->settings;
    d->output = job->output;
    if (frame) {
        d->coverage = film_coverage(frame->film);
        d->end = frame->end;
        d->evidence = frame->evidence;
        d->history = frame->history;
        d->point = frame->spent;
        d->point.uneven = film_unevenness(frame->film);
        d->work = film_work(frame->film);
        d->stats = frame->stats;
        d->audited = frame->audited;
        d->stats.cpu_ns = job_frame_cpu_ns(frame); /* of all runs; the share that tracing had is that of this one */
        if (frame->stats.cpu_ns > 0)
            d->stats.trace_ns = (uint64_t)((double)d->stats.cpu_ns / (double)frame->stats.cpu_ns * (double)frame->stats.trace_ns);
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

/* For the film's means. */
static status begin_pixels(struct development *d, struct error *err)
{
    TRY(image_init(&d->image, film_width(d->film), film_height(d->film), 3, err));
    if (!(d->settings.aovs >> AOV_ALPHA & 1))
        return STATUS_OK;
    d->alpha = mem_calloc((size_t)film_width(d->film) * film_height(d->film), sizeof *d->alpha);
    NEED(d->alpha, err, "a picture's alpha");
    return STATUS_OK;
}

/* Copy the film's means into the image. */
static status take_pixels(struct development *d, struct error *err)
{
    if (d->taken)
        return STATUS_OK;
    TRY(begin_pixels(d, err));
    film_develop(d->film, d->image.pixels);
    if (d->alpha)
        film_develop_aov(d->film, AOV_ALPHA, 0, film_height(d->film), d->alpha);
    d->taken = 1;
    return STATUS_OK;
}

/* For which tiles have samples, if some have none. */
static status begin_holes(struct development *d, struct error *err)
{
    if (film_covered(d->film))
        return STATUS_OK;
    d->there = mem_calloc(film_tile_count(d->film), 1);
    NEED(d->there, err, "a preview");
    return STATUS_OK;
}

static void take_tile(struct development *d, uint32_t tile)
{
    if (d->measurement.groups[0])
        measurement_take_tile(&d->measurement, d->film, tile);
    if (d->there)
        d->there[tile] = film_tile_samples(d->film, tile) > 0;
    if (d->image.pixels)
        film_develop_tile(d->film, tile, d->image.pixels);
    if (d->alpha)
        film_develop_tile_aov(d->film, tile, AOV_ALPHA, d->alpha);
}

int development_take(struct development *d)
{
    const uint32_t tiles = film_tile_count(d->film);

    for (uint32_t i = 0; i < DEVELOP_TAKE_TILES && d->next_tile < tiles; i++)
        take_tile(d, d->next_tile++);
    if (d->next_tile < tiles)
        return 1;
    d->taken = d->image.pixels != NULL;
    d->film = NULL; /* a copy, because the film keeps changing */
    return 0;
}

static status fill_holes(struct development *d, struct error *err)
{
    status s = d->there ? fill_tiles(&d->image, d->there, err) : STATUS_OK;

    if (d->there && d->denoised.pixels)
        THEN(s, fill_tiles(&d->denoised, d->there, err));

    if (s == STATUS_OK) {
        mem_free(d->there);
        d->there = NULL;
    }
    return s;
}

status development_new_frame(struct development **out, const struct job_frame *frame, struct error *err)
{
    return development_new(out, frame->job, frame->number, frame, err);
}

status development_new_stored(struct development **out, const struct job *job, uint32_t frame, struct error *err)
{
    return development_new(out, job, frame, NULL, err);
}

status development_new_measure(struct development **out, const struct job_frame *frame, struct error *err)
{
    const int samples = frame->measure_tiles > 0 && measurement_sample(frame->film, frame->measure_tiles) > 0;
    status s = development_new(out, frame->job, frame->number, frame, err);

    if (s == STATUS_OK && samples)
        s = measurement_take_sample(&(*out)->measurement, frame->film, frame->measure_tiles, err);
    else
        THEN(s, measurement_begin(&(*out)->measurement, frame->film, 0, err));
    if (s == STATUS_OK && samples)
        (*out)->next_tile = film_tile_count(frame->film); /* a sample is small: it is there */
    if (s != STATUS_OK) {
        development_free(*out);
        *out = NULL;
    }
    return s;
}

/* Of a large picture the copies that a denoiser needs would take too much memory. */
static int is_denoised_at_once(const struct development *d)
{
    return d->output.tonemap.denoise != DENOISING_OFF &&
           (uint64_t)d->settings.width * d->settings.height <= DEVELOP_DENOISED_PIXELS_MAX;
}

status development_new_preview(struct development **out, const struct job_frame *frame,
                               const struct output_settings *look, struct error *err)
{
    status s = development_new(out, frame->job, frame->number, frame, err);

    if (s == STATUS_OK && look)
        development_look(*out, look);
    if (s == STATUS_OK)
        s = begin_holes(*out, err);
    THEN(s, begin_pixels(*out, err));
    if (s == STATUS_OK && is_denoised_at_once(*out))
        s = measurement_begin(&(*out)->measurement, frame->film, 1, err);
    if (s == STATUS_OK) {
        (*out)->is_preview = 1;
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
    image_release(&development->denoised);
    scene_release(&development->description);
    mem_free(development->tile_errors);
    development_mattes_end(development);
    mem_free(development->alpha);
    mem_free(development->there);
    mem_free(development);
}

void development_look(struct development *d, const struct output_settings *output)
{
    const uint32_t around = d->output.tonemap.denoise_around; /* what was kept for the job serves, too */

    d->output.tonemap = output->tonemap;
    d->output.tonemap.temporal = 1;
    d->output.tonemap.denoise_around = around;
    d->output.picture = output->picture;
    d->is_look = 1;
}

struct frame_evidence development_evidence(const struct development *d) { return d->evidence; }

const struct history_point *development_point(const struct development *d) { return d->measured ? &d->point : NULL; }

const struct accuracy_figures *development_denoised(const struct development *d)
{
    return d->denoised_known ? &d->point.denoised : NULL;
}

int development_is_as_before(const struct development *d) { return d->denoised_before; }

status develop_encode(struct development *d, const struct store *store, struct buffer *exr, struct buffer *png,
                      struct error *err)
{
    struct toning t;
    status s = d->film || d->taken ? take_pixels(d, err) : develop_take_stored(d, store, err);

    if (s == STATUS_OK && d->output.tonemap.denoise != DENOISING_OFF && !d->is_preview)
        s = development_describe(d, store, err);
    THEN(s, development_denoise(d, store, err));
    THEN(s, fill_holes(d, err));
    if (s == STATUS_OK && exr)
        s = development_describe(d, store, err);
    if (s == STATUS_OK && exr && d->film)
        s = development_find_figures(d, store, err);
    if (s == STATUS_OK && exr)
        s = develop_exr(d, exr, err);
    if (s != STATUS_OK || !png)
        return s;
    s = toning_begin(&t, d, store, err);
    THEN(s, develop_encode_display(d, &t, png, NULL, err));
    toning_end(&t);
    return s;
}

int64_t development_revision(const struct development *d)
{
    return d->film && tonemap_takes_frames(&d->output.tonemap) ? -1 : (int64_t)d->revision;
}

/* The display pictures, unless they are for develop_again. */
static status develop_display(struct development *d, struct store *store, struct error *err)
{
    struct toning t;
    status s;

    if (development_revision(d) < 0)
        return STATUS_OK;
    s = toning_begin(&t, d, store, err);
    THEN(s, develop_write_display(d, &t, store, err));
    toning_end(&t);
    return s;
}

/* Pixels of a frame whose files take little longer to make than a thread to begin. */
enum { ALONE_MAX = 1 << 14 };
/* From so many on, figures, EXR and display picture are made one after the other, each by all threads: what they hold at
 * the same time is about 30 bytes a pixel instead of 100. */
enum { IN_TURN_MIN = 1 << 21 };

/* The files of a frame: the EXR, with the figures in its header, and beside it what a display shows. */
struct making {
    struct development *development;
    struct store *store;
    status result[2];
    struct error error[2];
};

static status find_place(struct development *d, const struct store *store, struct error *err)
{
    if (d->placed)
        return STATUS_OK;
    TRY(development_find_figures(d, store, err));
    d->place = history_add(&d->history, &d->point);
    d->placed = 1;
    return STATUS_OK;
}

static status make_exr(struct development *d, struct store *store, struct error *err)
{
    struct buffer exr = BUFFER_INIT;
    status s = find_place(d, store, err);

    if (s == STATUS_OK && d->output.exr)
        s = develop_exr(d, &exr, err);
    if (s == STATUS_OK && d->output.exr)
        s = store_output_write(store, d->job, d->frame, "exr", &exr, err);
    if (s == STATUS_OK && development_picture_is_apart(d))
        s = development_write_picture(d, store, err);
    if (s == STATUS_OK && d->denoised.pixels)
        s = development_write_denoised(d, store, err);
    buffer_release(&exr);
    return s;
}

static void make_files(void *user, size_t begin, size_t end)
{
    struct making *m = user;

    for (size_t i = begin; i < end; i++) {
        m->result[i] = i == 0 ? make_exr(m->development, m->store, &m->error[i])
                              : develop_display(m->development, m->store, &m->error[i]);
        if (m->development->image_ends)
            mem_trim(); /* what the EXR took is not there while the display picture is made */
    }
}

status develop_frame(struct development *d, struct store *store, struct error *err)
{
    struct making making = {.development = d, .store = store};
    struct frame_makers makers = {.deliverers = BUFFER_INIT, .done_at = clock_wall_s()};
    struct buffer json = BUFFER_INIT;
    const uint64_t pixels = (uint64_t)film_width(d->film) * film_height(d->film);
    status s = development_describe(d, store, err);

    if (s == STATUS_OK && pixels >= IN_TURN_MIN && d->output.tonemap.denoise == DENOISING_OFF)
        s = find_place(d, store, err); /* while there is no picture yet */
    TRY(s);
    TRY(take_pixels(d, err));
    TRY(development_denoise(d, store, err));
    d->image_ends = pixels >= IN_TURN_MIN;
    parallel_for(pixels <= ALONE_MAX || pixels >= IN_TURN_MIN ? 1 : 2, 2, 1, make_files, &making);
    for (int i = 0; i < 2 && s == STATUS_OK; i++)
        if (making.result[i] != STATUS_OK)
            s = error_set(err, making.result[i], "%s", making.error[i].text);
    THEN(s, develop_manifest(d, store, &json, err));
    THEN(s, store_output_write(store, d->job, d->frame, MANIFEST_EXTENSION, &json, err));
    THEN(s, measured_deliverers(d->film, &makers.deliverers, err));
    THEN(s, store_frame_done(store,
                             &(struct frame_done){.job = d->job, .epoch_floor = d->epoch_floor, .frame = d->frame,
                                                  .revision = development_revision(d), .end = d->end,
                                                  .cut = development_is_full(d) ? NULL : &d->coverage, .work = &d->work,
                                                  .point = &d->point, .place = d->place, .makers = &makers},
                             err));
    buffer_release(&makers.deliverers);
    d->measured = s == STATUS_OK;
    buffer_release(&json);
    return s;
}
