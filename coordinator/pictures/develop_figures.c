/* How wrong a frame may be. */
#include "coordinator/pictures/develop_parts.h"

#include <math.h>

#include "common/accuracy/word.h"
#include "common/base/memory.h"
#include "common/image/image.h"
#include "common/scene/effects.h"
#include "coordinator/store/files/blobs.h"

/* The part of the environment map that a path may hit by chance; needed only for frames with
 * caustics. Errors in the map itself are reported by the workers. */
status development_find_map_max(struct development *d, const struct store *store, struct error *err)
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
    THEN(s, image_decode_hdr(&map, file.data, file.size, "the environment", &repairs, err));
    for (size_t i = 0; s == STATUS_OK && i < (size_t)map.width * map.height * map.channels; i++)
        most = map.pixels[i] > most ? map.pixels[i] : most;
    d->map_max = (double)most;
    image_release(&map);
    buffer_release(&file);
    return status_is_environment(s) ? s : STATUS_OK;
}

double development_brightest(const struct development *d)
{
    if (!d->described)
        return 0;
    return accuracy_brightest(&d->description, (double)d->settings.env_strength, isnan(d->map_max) ? 0 : d->map_max);
}

/* Once a frame, however often its figures are computed. */
static status find_evidence(struct development *d, const struct store *store, struct error *err)
{
    if (d->evidence.known)
        return STATUS_OK;
    TRY(development_describe(d, store, err));
    TRY(development_find_map_max(d, store, err));
    d->evidence = (struct frame_evidence){1, development_effects(d), development_brightest(d)};
    return STATUS_OK;
}

status development_find_figures(struct development *d, const struct store *store, struct error *err)
{
    struct accuracy_map map = {0};
    struct toning t;
    status s;

    if (d->film && d->settings.aovs >> AOV_ERROR & 1 && !d->tile_errors) {
        d->tile_errors = mem_calloc(tile_count(film_width(d->film), film_height(d->film)), sizeof *d->tile_errors);
        NEED(d->tile_errors, err, "the tiles' errors");
    }
    map.display = d->tile_errors;
    s = find_evidence(d, store, err);
    if (s == STATUS_OK && d->film)
        s = measurement_of(&d->measurement, d->film, err);
    THEN(s, toning_begin(&t, d, store, err));
    if (s == STATUS_OK) {
        t.context.threads = d->film ? 0 : 1; /* while the frame is rendered, the other threads do that */
        s = measurement_figures(&d->measurement, &d->output.tonemap, &t.context, d->evidence.effects,
                                d->evidence.brightest, &d->point.figures, &map, err);
        toning_end(&t);
    }
    measurement_release(&d->measurement);
    return s;
}

status develop_figures(struct development *d, struct store *store, struct error *err)
{
    status s = development_find_figures(d, store, err);

    THEN(s, store_history_add(store, d->job, d->frame, history_add(&d->history, &d->point), &d->point, err));
    d->measured = s == STATUS_OK;
    return s;
}
