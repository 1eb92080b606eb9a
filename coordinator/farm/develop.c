#include "coordinator/farm/develop_parts.h"

#include <string.h>

#include "common/accuracy/schedule.h"
#include "common/base/memory.h"
#include "common/scene/manifest.h"
#include "coordinator/farm/fill.h"

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
    d->epoch_floor = job->epoch_floor;
    memcpy(d->name, job->name, sizeof d->name);
    memcpy(d->scene_name, job->scene_name, sizeof d->scene_name);
    memcpy(d->kernel, job->kernel, sizeof d->kernel);
    memcpy(d->source, job->source, sizeof d->source);
    d->stop = job->stop;
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
    if (s == STATUS_OK && d->settings.aovs >> AOV_ALPHA & 1) {
        d->alpha = mem_alloc_array((size_t)film_width(d->film) * film_height(d->film),
                                   sizeof *d->alpha);
        if (!d->alpha)
            return error_no_memory(err, "a picture's alpha");
        film_develop_aov(d->film, AOV_ALPHA, 0, film_height(d->film), d->alpha);
    }
    d->taken = s == STATUS_OK;
    return s;
}

/* Note which tiles have no samples, if there are any. */
static status take_holes(struct development *d, struct error *err)
{
    if (film_covered(d->film))
        return STATUS_OK;
    d->there = mem_alloc(film_tile_count(d->film));
    if (!d->there)
        return error_no_memory(err, "a preview");
    for (uint32_t i = 0; i < film_tile_count(d->film); i++)
        d->there[i] = film_tile_samples(d->film, i) > 0;
    return STATUS_OK;
}

static status fill_holes(struct development *d, struct error *err)
{
    status s = d->there ? fill_tiles(&d->image, d->there, err) : STATUS_OK;

    if (s == STATUS_OK) {
        mem_free(d->there);
        d->there = NULL;
    }
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
        (*out)->film = NULL; /* a copy, because the film keeps changing */
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
        s = take_holes(*out, err);
    if (s == STATUS_OK)
        s = take_pixels(*out, err);
    if (s == STATUS_OK) {
        (*out)->is_preview = 1;
        (*out)->film = NULL; /* a copy, because the film keeps changing */
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
    mem_free(development->alpha);
    mem_free(development->there);
    mem_free(development);
}

void development_look(struct development *d, const struct output_settings *output)
{
    d->output.tonemap = output->tonemap;
    d->output.tonemap.temporal = 1;
    d->output.picture = output->picture;
}

double development_map_max(const struct development *d)
{
    return d->map_max;
}

const struct history_point *development_point(const struct development *d)
{
    return d->measured ? &d->point : NULL;
}

status develop_encode(struct development *d, const struct store *store, struct buffer *exr,
                      struct buffer *png, struct error *err)
{
    struct toning t;
    status s = d->film || d->taken ? take_pixels(d, err) : develop_take_stored(d, store, err);

    if (s == STATUS_OK)
        s = fill_holes(d, err);
    if (s == STATUS_OK && exr)
        s = d->film ? development_find_figures(d, store, err) : development_describe(d, store, err);
    if (s == STATUS_OK && exr)
        s = develop_exr(d, exr, err);
    if (s != STATUS_OK || !png)
        return s;
    s = toning_begin(&t, d, store, err);
    if (s == STATUS_OK)
        s = develop_encode_display(d, &t, png, NULL, err);
    toning_end(&t);
    return s;
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
        s = develop_write_display(d, &t, store, err);
    toning_end(&t);
    return s;
}

status develop_frame(struct development *d, struct store *store, struct error *err)
{
    struct buffer exr = BUFFER_INIT, json = BUFFER_INIT;
    status s = take_pixels(d, err);

    if (s == STATUS_OK)
        s = development_describe(d, store, err);
    if (s == STATUS_OK)
        s = develop_figures(d, store, err);
    if (s == STATUS_OK && d->output.exr)
        s = develop_exr(d, &exr, err);
    if (s == STATUS_OK && d->output.exr)
        s = store_output_write(store, d->job, d->frame, "exr", &exr, err);
    if (s == STATUS_OK && development_picture_is_apart(d))
        s = development_write_picture(d, store, err);
    if (s == STATUS_OK)
        s = develop_display(d, store, err);
    if (s == STATUS_OK)
        s = develop_manifest(d, store, &json, err);
    if (s == STATUS_OK)
        s = store_output_write(store, d->job, d->frame, MANIFEST_EXTENSION, &json, err);
    if (s == STATUS_OK)
        s = store_frame_done(store, d->job, d->epoch_floor, d->frame, development_revision(d), d->end,
                             development_is_full(d) ? NULL : &d->coverage, &d->work, err);
    buffer_release(&exr);
    buffer_release(&json);
    return s;
}

