/* The effects that a frame used, and where its time went. */
#include "coordinator/pictures/develop_parts.h"

#include <math.h>
#include <string.h>

#include "common/scene/scene_effects.h"
#include "common/scene/manifest.h"

/* The effects that the frame needs. The names of their causes belong to the description. */
static void find_effects(const struct development *d, struct manifest *m, struct effect_cause causes[EFFECT_COUNT])
{
    struct render_settings whole = d->settings;

    whole.without = 0;
    m->called_for = scene_effects(&d->description, &whole, d->frame, causes);
    m->causes = causes;
    /* The worker's answer is more precise: it has seen the textures and the motion. */
    if (!m->effects)
        m->effects = scene_effects(&d->description, &d->settings, d->frame, NULL);
}

status develop_manifest(struct development *d, const struct store *store, struct buffer *json, struct error *err)
{
    struct effect_cause causes[EFFECT_COUNT];
    char digest[DIGEST_HEX_SIZE];
    struct manifest m = {
        .job_name = d->name, .scene_name = d->scene_name, .renderer = d->ray_tracer,
        .scene_digest = digest, .job = d->job, .frame = d->frame, .effects = d->stats.effects,
        .without = d->settings.without, .frame_samples = d->coverage.samples, .complete = development_is_whole(d),
        .pixel_samples = {d->coverage.least, development_mean_samples(d), d->coverage.most},
        .tiles_empty = d->coverage.tiles_empty, .max_depth = d->settings.max_depth,
        .depth_known = depth_light_is_known(&d->work.depth),
        .depth = depth_light_report(&d->work.depth, d->work.samples, d->settings.max_depth),
        .work = &d->work, .cpu_ns = d->stats.cpu_ns,
    };

    m.audited = d->audited;
    m.health_rows = health_rows;
    m.error_known = d->point.figures.known && isfinite(d->point.figures.worst_part);
    if (m.error_known) {
        m.error.display = d->point.figures.display_error;
        m.error.display_all = d->point.figures.display_all;
        m.error.worst_part = d->point.figures.worst_part;
        m.error.fireflies = d->point.figures.fireflies;
        m.error.subject = d->point.figures.subject;
    }
    digest_to_hex(&d->scene, digest);
    memcpy(m.stages, d->stats.stages, sizeof m.stages);
    memcpy(m.accounts, d->stats.accounts, sizeof m.accounts);
    TRY(development_describe(d, store, err));
    if (d->described)
        find_effects(d, &m, causes);
    manifest_write(json, &m);
    return buffer_ok(json) ? STATUS_OK : error_no_memory(err, "a manifest");
}
