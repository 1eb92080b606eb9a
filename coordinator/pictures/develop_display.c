/* What a display shows of a frame. */
#include "coordinator/pictures/develop_parts.h"

#include <stdio.h>

#include "common/image/image.h"
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
