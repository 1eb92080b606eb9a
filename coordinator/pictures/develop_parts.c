#include "coordinator/pictures/develop_parts.h"

#include <inttypes.h>
#include <string.h>

#include "common/system/log.h"
#include "common/scene/scene_effects.h"
#include "coordinator/store/files/blobs.h"

double development_mean_samples(const struct development *d)
{
    return (double)d->coverage.samples / ((double)d->settings.width * d->settings.height);
}

double development_covered(const struct development *d)
{
    return 1 - (double)d->coverage.tiles_empty / (double)d->coverage.tiles;
}

int development_is_full(const struct development *d) { return d->coverage.least == d->settings.spp; }

/* Does the frame have all the samples that were asked for? */
int development_is_whole(const struct development *d) { return development_is_full(d) || frame_end_is_whole(d->end); }

uint64_t development_effects(const struct development *d)
{
    return d->described ? scene_effects(&d->description, &d->settings, d->frame, NULL) : 0;
}

status development_describe(struct development *d, const struct store *store, struct error *err)
{
    struct buffer packed = BUFFER_INIT;
    struct error why = {0};
    status s;

    if (d->looked || !store)
        return STATUS_OK;
    s = blobs_read(store_folder(store), &d->scene, SCENE_BYTES_MAX, &packed, &why);
    THEN(s, scene_unpack(&d->description, packed.data, packed.size, &why));
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

/* ---- alpha ----------------------------------------------------------------------------------- */

status develop_straight(struct image *out, const struct image *image, const float *alpha, struct error *err)
{
    size_t pixels = (size_t)image->width * image->height;
    status s = image_init(out, image->width, image->height, 3, err);

    for (size_t i = 0; i < pixels && s == STATUS_OK; i++)
        for (int c = 0; c < 3 && alpha[i] > 0; c++)
            out->pixels[3 * i + (size_t)c] = image->pixels[3 * i + (size_t)c] / alpha[i];
    return s;
}

status develop_with_alpha(struct image *out, const struct image *image, const float *alpha, struct error *err)
{
    size_t pixels = (size_t)image->width * image->height;
    status s = image_init(out, image->width, image->height, 4, err);

    for (size_t i = 0; i < pixels && s == STATUS_OK; i++) {
        memcpy(out->pixels + 4 * i, image->pixels + 3 * i, 3 * sizeof *out->pixels);
        out->pixels[4 * i + 3] = alpha[i];
    }
    return s;
}
