#include "common/scene/simplify/simplify.h"

#include <string.h>

#include "common/base/memory.h"
#include "common/image/image.h"
#include "common/scene/simplify/simplify_parts.h"

static status simplify_environment(struct simplifier *w)
{
    struct scene_environment *e = &w->scene->environment;
    struct image_repairs repairs = {0};
    struct image map;
    const uint8_t *data;
    size_t size_bytes, count;
    int same = 1;
    status st;

    if (!e->present || e->constant || e->varies)
        return STATUS_OK;
    st = w->reader.get(w->reader.user, &e->image.blob.digest, &data, &size_bytes, w->err);
    THEN(st, image_decode_hdr(&map, data, size_bytes, e->image.name, &repairs, w->err));
    if (st != STATUS_OK)
        return st;
    count = (size_t)map.width * map.height;
    for (size_t i = 1; i < count && same; i++)
        same = memcmp(map.pixels, map.pixels + 3 * i, 3 * sizeof(float)) == 0;
    for (int c = 0; c < 3 && same; c++)
        same = e->radiance[c] * map.pixels[c] <= 1e30f;
    if (same) {
        e->constant = 1;
        e->brightest = 0;
        for (int c = 0; c < 3; c++)
            e->radiance[c] *= map.pixels[c];
        w->report->uniform_environment = 1;
        w->report->image_bytes += e->image.blob.size_bytes;
    }
    image_release(&map);
    return STATUS_OK;
}

static status simplify_materials(struct simplifier *w)
{
    status st;

    for (uint32_t i = 0; i < w->scene->track_count; i++)
        if (w->scene->tracks[i].target <= TRACK_UV_OFFSET)
            w->animated[w->scene->tracks[i].row] = 1;
    simplify_mixes(w);
    simplify_reach(w);
    simplify_survey_ahead(w);
    for (uint32_t i = 0; i < w->scene->material_count; i++) {
        struct scene_material *m = &w->scene->materials[i];

        if (!w->material_reached[i])
            continue;
        if (w->animated[i]) {
            TRY(simplify_survey_animated(w, m));
            continue;
        }
        simplify_drop_unseen(w, m);
        TRY(simplify_fold(w, m));
        simplify_drop_unseen(w, m);
        TRY(simplify_least_roughness(w, m));
    }
    simplify_mixes(w);
    simplify_reach(w);
    st = simplify_survey_colors(w);
    for (uint32_t i = 0; i < w->scene->material_count && st == STATUS_OK; i++)
        if (w->material_reached[i] && !w->animated[i]) {
            st = simplify_make_opaque(w, i);
            /* Without alpha there may be less to keep. */
            THEN(st, simplify_fold_slot(w, &w->scene->materials[i], MATERIAL_TEXTURE_base_color));
            if (st == STATUS_OK)
                simplify_drop_unseen(w, &w->scene->materials[i]);
        }
    return st;
}

status scene_simplify(struct scene *scene, struct scene_blob_reader reader, struct scene_simplify_report *report,
                      struct error *err)
{
    struct simplifier w = {.scene = scene, .reader = reader, .report = report, .err = err};
    status st;

    memset(report, 0, sizeof *report);
    w.images = mem_calloc(scene->image_count, sizeof *w.images);
    w.image_wanted = mem_calloc(scene->image_count, 1);
    w.material_reached = mem_calloc(scene->material_count, 1);
    w.animated = mem_calloc(scene->material_count, 1);
    w.alpha_colors = mem_calloc(scene->material_count, 1);
    w.mesh_alpha = mem_calloc(scene->mesh_count, 1);
    if (!w.images || !w.image_wanted || !w.material_reached || !w.animated || !w.alpha_colors || !w.mesh_alpha)
        st = error_no_memory(err, "what is known of the scene");
    else
        st = simplify_materials(&w);
    THEN(st, simplify_environment(&w));
    THEN(st, simplify_remove_unreached(&w));
    mem_free(w.mesh_alpha);
    mem_free(w.alpha_colors);
    mem_free(w.animated);
    mem_free(w.material_reached);
    mem_free(w.image_wanted);
    mem_free(w.images);
    return st;
}
