/* How wrong a frame may be. */
#include "coordinator/pictures/develop_parts.h"

#include "common/accuracy/word.h"
#include "common/base/memory.h"
#include "common/scene/effects.h"

double development_brightest(const struct development *d)
{
    return d->described ? accuracy_brightest(&d->description, (double)d->settings.env_strength) : 0;
}

/* Once a frame, however often its figures are computed. */
static status find_evidence(struct development *d, const struct store *store, struct error *err)
{
    if (d->evidence.known)
        return STATUS_OK;
    TRY(development_describe(d, store, err));
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
