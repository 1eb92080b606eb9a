/* What is kept of a frame's picture: its means in 32 bits. */
#include "coordinator/pictures/develop_parts.h"

#include <inttypes.h>
#include <stdio.h>

#include "common/base/memory.h"
#include "common/image/image.h"

#define PICTURE_EXTENSION "picture.exr"

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

int development_picture_digest(const struct development *d, const struct store *store, uint32_t frame, struct digest *out)
{
    return store_output_digest(store, d->job, frame, development_picture_is_apart(d) ? PICTURE_EXTENSION : "exr", out);
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

status development_read_picture(const struct development *d, const struct store *store, uint32_t frame,
                                struct image *out, float **alpha, struct error *err)
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
    status s = development_read_picture(d, store, d->frame, &d->image, &d->alpha, err);

    d->taken = s == STATUS_OK;
    return s;
}
