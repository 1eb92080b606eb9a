/* What a display shows of a frame, and of stored frames again. */
#include "coordinator/pictures/develop_parts.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/image/image.h"
#include "coordinator/job/wire.h"
#include "coordinator/store/files/blobs.h"

status toning_begin(struct toning *t, const struct development *d, const struct store *store, struct error *err)
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

void toning_end(struct toning *t) { buffer_release(&t->file); }

/* Tone map what is shown. It is metered by the picture as it was rendered: with and without noise it is as bright. */
static status show(struct image *out, const struct development *d, const struct toning *t, const struct image *shown,
                   const struct image *raw, struct error *err)
{
    struct tonemap_context context = t->context;
    struct tonemap_state state;

    if (d->denoised.pixels && !context.state) {
        TRY(tonemap_measure(&state, raw, t->settings, &t->context, err));
        context.state = &state;
    }
    return tonemap_apply(out, shown, t->settings, &context, err);
}

/* With alpha, the PNG shows the colours themselves and has alpha beside them. */
static status encode_cut_out(const struct development *d, const struct toning *t, struct buffer *png, struct error *err)
{
    struct image straight = {0}, raw = {0}, display = {0}, whole = {0};
    status s = develop_straight(&straight, development_shown(d), d->alpha, err);

    if (s == STATUS_OK && d->denoised.pixels)
        s = develop_straight(&raw, &d->image, d->alpha, err);
    THEN(s, show(&display, d, t, &straight, &raw, err));
    image_release(&raw);
    image_release(&straight);
    THEN(s, develop_with_alpha(&whole, &display, d->alpha, err));
    image_release(&display);
    THEN(s, png_encode_as(png, &whole, &d->output.picture, err));
    image_release(&whole);
    return s;
}

/* Append the picture as PNG or JPEG, either of which may be NULL. */
status develop_encode_display(struct development *d, const struct toning *t, struct buffer *png, struct buffer *jpg,
                              struct error *err)
{
    struct image display = {0};
    struct picture_options how = d->output.picture;
    char covered[16], samples[32];
    const struct picture_text texts[] = {{"azulejo:covered", covered}, {"azulejo:samplesMean", samples}};
    status s;

    if (d->alpha && png) {
        s = encode_cut_out(d, t, png, err);
        if (s != STATUS_OK || !jpg)
            return s;
        png = NULL;
    }
    s = show(&display, d, t, development_shown(d), &d->image, err);
    if (d->image_ends)
        image_release(&d->image);
    if (d->is_preview) {
        snprintf(covered, sizeof covered, "%.4f", development_covered(d));
        snprintf(samples, sizeof samples, "%.2f", development_mean_samples(d));
        how.fast = 1;
        how.texts = texts;
        how.text_count = sizeof texts / sizeof *texts;
    }
    if (s == STATUS_OK && png)
        s = png_encode_as(png, &display, &how, err);
    if (s == STATUS_OK && jpg)
        s = jpeg_encode(jpg, &display, &d->output.picture, err);
    image_release(&display);
    return s;
}

status develop_write_display(struct development *d, const struct toning *t, struct store *store, struct error *err)
{
    struct buffer png = BUFFER_INIT, jpg = BUFFER_INIT;
    status s = STATUS_OK;

    if (d->output.png || d->output.jpg)
        s = develop_encode_display(d, t, d->output.png ? &png : NULL, d->output.jpg ? &jpg : NULL, err);
    if (s == STATUS_OK && d->output.png)
        s = store_output_write(store, d->job, d->frame, "png", &png, err);
    if (s == STATUS_OK && d->output.jpg)
        s = store_output_write(store, d->job, d->frame, "jpg", &jpg, err);
    buffer_release(&png);
    buffer_release(&jpg);
    return s;
}

/* ---- stored pictures ------------------------------------------------------------------------- */

#define PICTURE_EXTENSION "picture.exr"
#define STATE_EXTENSION "state"

/* The means in 32 bits are kept, so that the frame can be developed again. */
int development_picture_is_apart(const struct development *d) { return !d->output.exr || d->output.exr_half; }

status development_write_picture(const struct development *d, struct store *store, struct error *err)
{
    struct buffer exr = BUFFER_INIT;
    struct exr_options options = {0};
    struct image whole = {0};
    status s = d->alpha ? develop_with_alpha(&whole, &d->image, d->alpha, err) : STATUS_OK;

    THEN(s, exr_encode(&exr, d->alpha ? &whole : &d->image, &options, err));
    THEN(s, store_output_write(store, d->job, d->frame, PICTURE_EXTENSION, &exr, err));
    image_release(&whole);
    buffer_release(&exr);
    return s;
}

/* The alpha of a stored picture, in memory of its own. */
static status read_alpha(const struct buffer *exr, const char *name, int blender, float **alpha, struct error *err)
{
    struct image each = {0};
    status s = exr_decode_channel(&each, exr->data, exr->size, name, blender ? "Combined.A" : "A", err);
    size_t pixels = (size_t)each.width * each.height;

    *alpha = s == STATUS_OK ? mem_alloc_array(pixels, sizeof **alpha) : NULL;
    if (s == STATUS_OK && !*alpha)
        s = error_no_memory(err, "a picture's alpha");
    for (size_t i = 0; i < pixels && s == STATUS_OK; i++)
        (*alpha)[i] = each.pixels[3 * i];
    image_release(&each);
    return s;
}

status develop_read_picture(const struct store *store, uint64_t job, uint32_t frame, struct image *out,
                            struct error *err)
{
    struct buffer exr = BUFFER_INIT;
    char name[64];
    status s = store_output_read(store, job, frame, PICTURE_EXTENSION, IMAGE_BYTES_MAX, &exr, err);

    snprintf(name, sizeof name, "job %" PRIu64 ", frame %u", job, frame);
    if (s == STATUS_ERR_NOT_FOUND)
        s = store_output_read(store, job, frame, "exr", IMAGE_BYTES_MAX, &exr, err);
    THEN(s, exr_decode(out, exr.data, exr.size, name, err));
    buffer_release(&exr);
    return s;
}

/* Read a frame's stored picture, and the alpha of one that has it. */
static status read_picture(const struct development *d, const struct store *store, uint32_t frame, struct image *out,
                           float **alpha, struct error *err)
{
    struct buffer exr = BUFFER_INIT;
    struct image_repairs repairs = {0};
    char name[64];
    status s = STATUS_ERR_NOT_FOUND;

    snprintf(name, sizeof name, "job %" PRIu64 ", frame %u", d->job, frame);
    if (development_picture_is_apart(d))
        s = store_output_read(store, d->job, frame, PICTURE_EXTENSION, IMAGE_BYTES_MAX, &exr, err);
    if (s == STATUS_ERR_NOT_FOUND) { /* older stores have no such file */
        buffer_clear(&exr);
        s = store_output_read(store, d->job, frame, "exr", IMAGE_BYTES_MAX, &exr, err);
    }
    THEN(s, image_decode_hdr(out, exr.data, exr.size, name, &repairs, err));
    if (s == STATUS_OK && d->settings.aovs >> AOV_ALPHA & 1)
        s = read_alpha(&exr, name, d->settings.exr_names == EXR_NAMES_BLENDER, alpha, err);
    buffer_release(&exr);
    return s;
}

status develop_take_stored(struct development *d, const struct store *store, struct error *err)
{
    status s = read_picture(d, store, d->frame, &d->image, &d->alpha, err);

    d->taken = s == STATUS_OK;
    return s;
}

/* A state in a file: the digest of the settings that it was measured with, then its bytes in this
 * machine's byte order. If the file holds anything else, the state is measured again. */
struct stored_state {
    struct digest looks;
    struct tonemap_state state;
};

/* The state of this or another frame: read from the store, or else measured and stored. */
static status state_of(const struct development *d, const struct toning *t, struct store *store, uint32_t frame,
                       const struct digest *looks, struct tonemap_state *out, struct error *err)
{
    struct buffer file = BUFFER_INIT;
    struct image other = {0}, straight = {0};
    struct stored_state stored;
    float *alpha = NULL;
    status s;

    if (store_output_read(store, d->job, frame, STATE_EXTENSION, sizeof stored, &file, NULL) == STATUS_OK &&
        file.size == sizeof stored) {
        memcpy(&stored, file.data, sizeof stored);
        if (digest_equal(&stored.looks, looks)) {
            *out = stored.state;
            buffer_release(&file);
            return STATUS_OK;
        }
    }
    buffer_clear(&file);
    s = frame == d->frame ? STATUS_OK : read_picture(d, store, frame, &other, &alpha, err);
    memset(&stored, 0, sizeof stored);
    if (s == STATUS_OK && d->alpha)
        s = develop_straight(&straight, frame == d->frame ? &d->image : &other, frame == d->frame ? d->alpha : alpha,
                             err);
    THEN(s, tonemap_measure(&stored.state,
                            d->alpha            ? &straight
                            : frame == d->frame ? &d->image
                                                : &other,
                            t->settings, &t->context, err));
    if (s == STATUS_OK) {
        stored.looks = *looks;
        *out = stored.state;
        buffer_append(&file, &stored, sizeof stored);
        /* Without it the next frame measures again. */
        if (!buffer_ok(&file) || store_output_write(store, d->job, frame, STATE_EXTENSION, &file, NULL) != STATUS_OK)
            log_debug("job %" PRIu64 ", frame %u: its statistics were not kept", d->job, frame);
    }
    image_release(&straight);
    image_release(&other);
    mem_free(alpha);
    buffer_release(&file);
    return s;
}

/* The mean state of the frames from window_begin to the development's own. */
static status window_state(const struct development *d, const struct toning *t, struct store *store,
                           struct tonemap_state *out, struct error *err)
{
    uint32_t count = d->frame - d->window_begin + 1;
    struct tonemap_state *states = mem_alloc_array(count, sizeof *states);
    const struct tonemap_state **pointers = mem_alloc_array(count, sizeof *pointers);
    struct digest looks;
    status s =
        states && pointers ? wire_output_digest(&looks, &d->output, err) : error_no_memory(err, "frames' statistics");

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

    THEN(s, read_picture(d, store, d->frame, &d->image, &d->alpha, err));
    THEN(s, development_denoise(d, store, err));
    if (s == STATUS_OK && d->denoised_known) { /* it was made now */
        s = development_write_denoised(d, store, err);
        THEN(s, store_history_denoised(store, d->job, d->frame, &d->point.denoised, err));
    }
    THEN(s, toning_begin(&t, d, store, err));
    if (s == STATUS_OK) {
        if (d->output.tonemap.temporal > 1) {
            s = window_state(d, &t, store, state, err);
            t.context.state = state;
        }
        THEN(s, develop_write_display(d, &t, store, err));
        toning_end(&t);
    }
    THEN(s, store_frame_developed(store, d->job, d->frame, d->revision, err));
    mem_free(state);
    return s;
}
