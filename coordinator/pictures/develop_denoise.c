/* A frame's picture without its noise: from its film when the frame is done, and from what is kept of it later. */
#include "coordinator/pictures/develop_parts.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/image/image.h"
#include "common/system/log.h"
#include "coordinator/pictures/view.h"

/* Means in 32 bits, with a text that says what they were made of and how. */
#define DENOISED_EXTENSION "denoised.exr"
#define DENOISED_ATTRIBUTE "azulejo:denoisedOf"
enum { OF_TEXT_SIZE = 32 + DIGEST_HEX_SIZE + (12 + DIGEST_HEX_SIZE) * JOB_AROUND_MAX };

const char *denoise_method_name(enum denoise_method method) { return method == DENOISE_FAST ? "fast" : "full"; }

const char *development_guides_text(const struct development *d)
{
    return d->denoised_guided ? "albedo, normal, emission" : "none";
}

static enum denoise_method method_of(const struct development *d)
{
    return d->output.tonemap.denoise == DENOISING_FAST || d->is_preview ? DENOISE_FAST : DENOISE_FULL;
}

static status append_digest(const struct image *raw, char out[OF_TEXT_SIZE], struct error *err)
{
    const size_t bytes = (size_t)raw->width * raw->height * 3 * sizeof(float), length = strlen(out);
    struct digest digest;
    char hex[DIGEST_HEX_SIZE];

    if (digest_of(&digest, (const uint8_t *)raw->pixels, bytes) != STATUS_OK)
        return error_no_memory(err, "a digest");
    digest_to_hex(&digest, hex);
    snprintf(out + length, OF_TEXT_SIZE - length, "%s", hex);
    return STATUS_OK;
}

/* "full 2 DIGEST": the method, its version, and of which raw picture. */
static status own_text(const struct development *d, enum denoise_method method, char out[OF_TEXT_SIZE], struct error *err)
{
    snprintf(out, OF_TEXT_SIZE, "%s %d ", denoise_method_name(method), DENOISE_VERSION);
    return append_digest(&d->image, out, err);
}

/* " 11 DIGEST": one of the frames around. */
static status around_text(const struct development *d, const struct store *store, uint32_t frame,
                          char out[OF_TEXT_SIZE], struct error *err)
{
    struct image raw = {0};
    status s;

    snprintf(out, OF_TEXT_SIZE, " %u ", frame);
    s = develop_read_picture(store, d->job, frame, &raw, err);
    THEN(s, append_digest(&raw, out, err));
    image_release(&raw);
    return s;
}

/* "full 2 DIGEST 11 DIGEST 13 DIGEST": the same, and the frames around that have films. */
static status of_text(const struct development *d, const struct store *store, enum denoise_method method,
                      char out[OF_TEXT_SIZE], struct error *err)
{
    char other[OF_TEXT_SIZE];
    status s = own_text(d, method, out, err);

    for (uint32_t k = 0; k < d->around_count && s == STATUS_OK; k++) {
        if (!store_film_exists(store, d->job, d->around[k]))
            continue;
        s = around_text(d, store, d->around[k], other, err);
        if (s == STATUS_OK)
            snprintf(out + strlen(out), OF_TEXT_SIZE - strlen(out), "%s", other);
    }
    return s;
}

/* ---- what is kept ---------------------------------------------------------------------------- */

status development_write_denoised(const struct development *d, struct store *store, struct error *err)
{
    char of[OF_TEXT_SIZE];
    const struct exr_attribute attribute = {.name = DENOISED_ATTRIBUTE, .text = of};
    const struct exr_options options = {.attributes = &attribute, .attribute_count = 1};
    struct buffer exr = BUFFER_INIT;
    status s = of_text(d, store, d->denoise_method, of, err);

    if (s == STATUS_ERR_NOT_FOUND) /* a frame around has no picture any more: what this was made of cannot be noted */
        return STATUS_OK;
    THEN(s, exr_encode(&exr, &d->denoised, &options, err));
    THEN(s, store_output_write(store, d->job, d->frame, DENOISED_EXTENSION, &exr, err));
    buffer_release(&exr);
    return s;
}

static size_t begins_with(const char *text, const char *begin)
{
    return strncmp(text, begin, strlen(begin)) == 0 ? strlen(begin) : 0;
}

/* Was it made of the same samples? A frame around whose film is gone counts if it took part then, and need not. */
static int is_of(const struct development *d, const struct store *store, const char *kept, int by_itself)
{
    char of[OF_TEXT_SIZE];
    size_t size = own_text(d, method_of(d), of, NULL) == STATUS_OK ? begins_with(kept, of) : 0;

    if (size == 0 || by_itself)
        return size > 0;
    for (uint32_t k = 0; k < d->around_count; k++) {
        kept += size;
        size = around_text(d, store, d->around[k], of, NULL) == STATUS_OK ? begins_with(kept, of) : 0;
        if (size == 0 && store_film_exists(store, d->job, d->around[k]))
            return 0;
    }
    return kept[size] == 0;
}

/* `by_itself`: the frames around it may have changed since. 0: there is none. */
static int read_kept(const struct development *d, const struct store *store, int by_itself, struct image *out)
{
    const struct image *raw = &d->image;
    struct buffer exr = BUFFER_INIT, text = BUFFER_INIT;
    const char name[] = "a denoised picture";
    status s = store_output_read(store, d->job, d->frame, DENOISED_EXTENSION, IMAGE_BYTES_MAX, &exr, NULL);

    THEN(s, exr_read_text(&text, exr.data, exr.size, name, DENOISED_ATTRIBUTE, NULL));
    if (s == STATUS_OK && (!buffer_ok(&text) || !is_of(d, store, buffer_text(&text), by_itself)))
        s = STATUS_ERR_NOT_FOUND; /* of other samples, or made in another way */
    THEN(s, exr_decode(out, exr.data, exr.size, name, NULL));
    if (s == STATUS_OK && (out->width != raw->width || out->height != raw->height || out->channels != 3)) {
        image_release(out);
        s = STATUS_ERR_NOT_FOUND;
    }
    buffer_release(&text);
    buffer_release(&exr);
    return s == STATUS_OK;
}

/* ---- making it ------------------------------------------------------------------------------- */

static status make(struct development *d, const struct measurement *m, const struct measurement_others *others,
                   struct error *err)
{
    const struct measurement_evidence evidence = {development_effects(d), development_brightest(d)};
    struct denoise_result result;

    d->denoise_method = d->is_look ? DENOISE_FAST : method_of(d); /* what was kept is as good as it was asked for */
    TRY(measurement_denoise(m, others, &d->image, d->denoise_method, d->is_preview ? 1 : 0, /* the other threads render */
                            d->is_look || d->is_preview ? NULL : &evidence, &result, err));
    d->denoised = (struct image){.width = m->width, .height = m->height, .channels = 3, .pixels = result.image};
    d->denoised_known = 1;
    d->denoised_guided = measurement_is_guided(m);
    d->denoised_frames = 1 + (others ? others->count : 0);
    d->denoise_counts = result.counts;
    d->point.denoised = result.figures;
    return STATUS_OK;
}

/* The frames around one, as far as their films are kept and can be followed. */
struct around {
    const struct development *development;
    const struct store *store;
    const float *positions, *objects; /* of the frame's own points */
    uint32_t count, frames[JOB_AROUND_MAX];
    struct scene_way ways[JOB_AROUND_MAX];
    struct measurement measurement; /* of the one that was found last, as the next two */
    struct denoise_input picture;
    int32_t *source;
};

static status find_other(void *user, uint32_t k, struct denoise_other *out, struct error *err)
{
    struct around *a = user;
    const struct development *d = a->development;
    struct film_reader *reader;
    status s = store_film_reader(a->store, d->job, a->frames[k], &d->settings, &reader, err);

    measurement_release(&a->measurement);
    THEN(s, measurement_read_guided(&a->measurement, reader, 0, err));
    film_reader_close(reader);
    TRY(s);
    a->picture = measurement_input(&a->measurement);
    *out = (struct denoise_other){&a->picture, NULL};
    if (!scene_way_is_still(&a->ways[k]) && a->positions && a->ways[k].here.has_screen) {
        scene_way_follow(&a->ways[k], &d->settings, a->positions, a->objects, a->source);
        out->source = a->source;
    }
    return STATUS_OK;
}

/* Without positions a frame takes part only if its camera stands where this one's does. */
static status take_frame(struct around *a, uint32_t frame, struct error *err)
{
    const struct development *d = a->development;
    struct scene_way *way = &a->ways[a->count];
    struct film_reader *reader = NULL;
    status s = scene_way_find(&d->description, &d->settings, d->frame, frame, way, err);

    if (s == STATUS_OK && scene_way_is_known(way) && (a->positions || scene_way_camera_stands(way)) &&
        store_film_reader(a->store, d->job, frame, &d->settings, &reader, NULL) == STATUS_OK)
        a->frames[a->count++] = frame;
    else
        scene_way_release(way);
    film_reader_close(reader);
    return s;
}

static status make_with_others(struct development *d, const struct store *store, const struct measurement *m, struct error *err)
{
    struct around a = {.development = d, .store = store, .positions = m->guides.position, .objects = m->guides.object};
    struct measurement_others others = {.find = find_other, .user = &a};
    status s = STATUS_OK;

    for (uint32_t k = 0; s == STATUS_OK && d->described && k < d->around_count; k++)
        s = take_frame(&a, d->around[k], err);
    others.count = a.count;
    if (s == STATUS_OK && a.count > 0) {
        a.source = mem_alloc_array((size_t)m->width * m->height, sizeof *a.source);
        if (!a.source)
            s = error_no_memory(err, "frames around one");
    }
    THEN(s, make(d, m, &others, err));
    for (uint32_t k = 0; k < a.count; k++)
        scene_way_release(&a.ways[k]);
    mem_free(a.source);
    measurement_release(&a.measurement);
    return s;
}

static status make_of_kept(struct development *d, const struct store *store, struct error *err)
{
    const int alone = d->is_look || d->around_count == 0;
    struct film_reader *reader;
    struct measurement m = {0};
    status s = store_film_reader(store, d->job, d->frame, &d->settings, &reader, err);

    if (s == STATUS_ERR_NOT_FOUND)
        return error_set(err, STATUS_ERR_NOT_FOUND,
                         "frame %u cannot be denoised any more: its samples were not kept, only their mean; submit the "
                         "job again with --denoise, or develop it with --denoise off",
                         d->frame);
    THEN(s, measurement_read_guided(&m, reader, !alone, err));
    film_reader_close(reader);
    if (s == STATUS_OK && (m.width != d->image.width || m.height != d->image.height))
        s = error_set(err, STATUS_ERR_CORRUPT, "frame %u: its picture and its film differ in size", d->frame);
    THEN(s, development_describe(d, store, err));
    THEN(s, alone ? make(d, &m, NULL, err) : make_with_others(d, store, &m, err));
    measurement_release(&m);
    return s;
}

status development_denoise(struct development *d, const struct store *store, struct error *err)
{
    status s;

    if (d->output.tonemap.denoise == DENOISING_OFF || d->denoised.pixels)
        return STATUS_OK;
    if (d->film && tonemap_around(&d->output.tonemap) > 0 && !d->output.exr)
        return STATUS_OK; /* made with the frames around it, when they are there */
    if (d->film) {
        s = measurement_take_guided(&d->measurement, d->film, err);
        THEN(s, make(d, &d->measurement, NULL, err));
        measurement_release(&d->measurement);
        return s;
    }
    if (d->is_preview)
        return d->measurement.groups[0] ? make(d, &d->measurement, NULL, err) : STATUS_OK;
    if (read_kept(d, store, 0, &d->denoised))
        return STATUS_OK;
    s = make_of_kept(d, store, err);
    if (s == STATUS_ERR_NOT_FOUND && d->around_count > 0 && read_kept(d, store, 1, &d->denoised)) {
        d->denoised_before = 1;
        return STATUS_OK;
    }
    return s;
}
