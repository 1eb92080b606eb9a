/* A frame's picture without its noise: from its film when the frame is done, and from what is kept of it later. */
#include "coordinator/pictures/develop_parts.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/image/image.h"
#include "common/system/log.h"

/* Means in 32 bits, with a text that says what they were made of and how. */
#define DENOISED_EXTENSION "denoised.exr"
#define DENOISED_ATTRIBUTE "azulejo:denoisedOf"
enum { OF_TEXT_SIZE = DIGEST_HEX_SIZE + 32 };

const char *denoise_method_name(enum denoise_method method) { return method == DENOISE_FAST ? "fast" : "full"; }

const char *development_guides_text(const struct development *d)
{
    return d->denoised_guided ? "albedo, normal, emission" : "none";
}

static enum denoise_method method_of(const struct development *d)
{
    return d->output.tonemap.denoise == DENOISING_FAST || d->is_preview ? DENOISE_FAST : DENOISE_FULL;
}

/* "full 1 DIGEST": the method, its version, and of which raw picture. */
static status of_text(const struct image *raw, enum denoise_method method, char out[OF_TEXT_SIZE], struct error *err)
{
    char hex[DIGEST_HEX_SIZE];
    struct digest digest;

    if (digest_of(&digest, (const uint8_t *)raw->pixels, (size_t)raw->width * raw->height * 3 * sizeof(float)) !=
        STATUS_OK)
        return error_no_memory(err, "a digest");
    digest_to_hex(&digest, hex);
    snprintf(out, OF_TEXT_SIZE, "%s %d %s", denoise_method_name(method), DENOISE_VERSION, hex);
    return STATUS_OK;
}

/* ---- what is kept ---------------------------------------------------------------------------- */

status development_write_denoised(const struct development *d, struct store *store, struct error *err)
{
    char of[OF_TEXT_SIZE];
    const struct exr_attribute attribute = {.name = DENOISED_ATTRIBUTE, .text = of};
    const struct exr_options options = {.attributes = &attribute, .attribute_count = 1};
    struct buffer exr = BUFFER_INIT;
    status s = of_text(&d->image, d->denoise_method, of, err);

    THEN(s, exr_encode(&exr, &d->denoised, &options, err));
    THEN(s, store_output_write(store, d->job, d->frame, DENOISED_EXTENSION, &exr, err));
    buffer_release(&exr);
    return s;
}

/* 0: there is none. */
static int read_kept(const struct development *d, const struct store *store, struct image *out)
{
    const struct image *raw = &d->image;
    char of[OF_TEXT_SIZE];
    struct buffer exr = BUFFER_INIT, text = BUFFER_INIT;
    const char name[] = "a denoised picture";
    status s = store_output_read(store, d->job, d->frame, DENOISED_EXTENSION, IMAGE_BYTES_MAX, &exr, NULL);

    THEN(s, exr_read_text(&text, exr.data, exr.size, name, DENOISED_ATTRIBUTE, NULL));
    THEN(s, of_text(raw, method_of(d), of, NULL));
    if (s == STATUS_OK && (!buffer_ok(&text) || strcmp(buffer_text(&text), of) != 0))
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

static status make(struct development *d, const struct measurement *m, struct error *err)
{
    const struct measurement_evidence evidence = {development_effects(d), development_brightest(d)};
    struct denoise_result result;

    d->denoise_method = d->is_look ? DENOISE_FAST : method_of(d); /* what was kept is as good as it was asked for */
    TRY(measurement_denoise(m, &d->image, d->denoise_method, d->is_preview ? 1 : 0, /* the other threads render */
                            d->is_look || d->is_preview ? NULL : &evidence, &result, err));
    d->denoised = (struct image){.width = m->width, .height = m->height, .channels = 3, .pixels = result.image};
    d->denoised_known = 1;
    d->denoised_guided = measurement_is_guided(m);
    d->denoise_counts = result.counts;
    d->point.denoised = result.figures;
    return STATUS_OK;
}

static status make_of_kept(struct development *d, const struct store *store, struct error *err)
{
    struct film_reader *reader;
    struct measurement m = {0};
    status s = store_film_reader(store, d->job, d->frame, &d->settings, &reader, err);

    if (s == STATUS_ERR_NOT_FOUND)
        return error_set(err, STATUS_ERR_NOT_FOUND,
                         "frame %u cannot be denoised any more: its samples were not kept, only their mean; submit the "
                         "job again with --denoise, or develop it with --denoise off",
                         d->frame);
    THEN(s, measurement_read_guided(&m, reader, err));
    film_reader_close(reader);
    if (s == STATUS_OK && (m.width != d->image.width || m.height != d->image.height))
        s = error_set(err, STATUS_ERR_CORRUPT, "frame %u: its picture and its film differ in size", d->frame);
    THEN(s, development_describe(d, store, err));
    THEN(s, make(d, &m, err));
    measurement_release(&m);
    return s;
}

status development_denoise(struct development *d, const struct store *store, struct error *err)
{
    status s;

    if (d->output.tonemap.denoise == DENOISING_OFF || d->denoised.pixels)
        return STATUS_OK;
    if (d->film) {
        s = measurement_take_guided(&d->measurement, d->film, err);
        THEN(s, make(d, &d->measurement, err));
        measurement_release(&d->measurement);
        return s;
    }
    if (d->is_preview)
        return d->measurement.groups[0] ? make(d, &d->measurement, err) : STATUS_OK;
    if (read_kept(d, store, &d->denoised))
        return STATUS_OK;
    return make_of_kept(d, store, err);
}
