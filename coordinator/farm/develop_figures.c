/* How wrong a frame may be. */
#include "coordinator/farm/develop_parts.h"

#include <math.h>

#include "common/accuracy/word.h"
#include "common/base/memory.h"
#include "common/image/image.h"
#include "common/scene/effects.h"
#include "coordinator/store/blobs.h"

/* The part of the environment map that a path may hit by chance; needed only for frames with
 * caustics. Errors in the map itself are reported by the workers. */
static status find_map_max(struct development *d, const struct store *store, struct error *err)
{
    const struct scene_environment *e = &d->description.environment;
    struct buffer file = BUFFER_INIT;
    struct image_repairs repairs = {0};
    struct image map = {0};
    float most = 0;
    status s;

    if (!isnan(d->map_max) || !d->described || !e->present || e->constant ||
        !(development_effects(d) & EFFECT_CAUSTICS))
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

status development_find_figures(struct development *d, const struct store *store, struct error *err)
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
    s = development_describe(d, store, err);
    if (s == STATUS_OK)
        s = find_map_max(d, store, err);
    if (s == STATUS_OK && d->film)
        s = measurement_take(&d->measurement, d->film, err);
    if (s == STATUS_OK)
        s = toning_begin(&t, d, store, err);
    if (s == STATUS_OK) {
        t.context.threads = 1; /* the other threads render */
        s = measurement_figures(&d->measurement, &d->output.tonemap, &t.context, development_effects(d),
                                brightest_of(d), &d->point.figures, &map, err);
        toning_end(&t);
    }
    measurement_release(&d->measurement);
    return s;
}

status develop_figures(struct development *d, struct store *store, struct error *err)
{
    status s = development_find_figures(d, store, err);

    if (s == STATUS_OK)
        s = store_history_add(store, d->job, d->frame, history_add(&d->history, &d->point),
                              &d->point, err);
    d->measured = s == STATUS_OK;
    return s;
}
