/* casters: which materials they are, and what is asked of them. */
#include "worker/render/caustic/casters.h"

#include <string.h>

#include "common/base/memory.h"
#include "worker/render/bsdf/bsdf.h"
#include "worker/render/caustic/casters_parts.h"
#include "worker/render/render_scene.h"

/* ---- which materials ------------------------------------------------------------------------------- */

static int is_smooth(float32 roughness) { return roughness * roughness < BSDF_ALPHA_MIN; }

int casters_may_be(const struct scene_material *m)
{
    return (m->kind == MATERIAL_SURFACE || m->kind == MATERIAL_CONDUCTOR) && !(m->dispersion > 0) &&
           (is_smooth(m->roughness) || (m->clearcoat > 0 && is_smooth(m->clearcoat_roughness)));
}

/* Bits of the events of a material; 0: it is no caster. */
static unsigned events_of(const struct render_material *material)
{
    const struct scene_material *m = &material->m;
    const unsigned reflects = 1u << CASTER_REFLECTS, refracts = 1u << CASTER_REFRACTS;

    if ((material->flags & MATERIAL_NORMAL_MAP) || !casters_may_be(m))
        return 0;
    if (!is_smooth(m->roughness)) /* a coat's mirror alone */
        return material->clearcoat_normal.image ? 0 : reflects;
    if (m->kind == MATERIAL_SURFACE && m->refractive && m->transmission > 0 && m->metallic < 1 && m->ior != 1 && m->ior > 0)
        return reflects | refracts;
    return m->kind == MATERIAL_CONDUCTOR || m->metallic > 0 || m->ior != 1 ? reflects : 0;
}

/* ---- casters ------------------------------------------------------------------------------------------- */

static void list_materials(struct casters *casters)
{
    for (uint32_t i = 0; i < casters->scene->material_count; i++) {
        const struct render_material *material = &casters->scene->materials[i];
        const unsigned events = events_of(material);

        if (events)
            casters->list[casters->count++] =
                (struct caster){.material = i, .events = events, .ior = (double)material->m.ior};
    }
}

/* Those without faces are left out. */
static status build_all(struct casters *casters, struct error *err)
{
    const uint32_t listed = casters->count;
    status s = STATUS_OK;

    casters->count = 0;
    for (uint32_t i = 0; i < listed && s == STATUS_OK; i++) {
        struct caster *caster = &casters->list[casters->count];

        *caster = casters->list[i];
        s = caster_build(caster, casters->scene, caster->material, err);
        if (s != STATUS_OK || caster->face_count > 0) {
            casters->count++;
            continue;
        }
        mem_free(caster->refs);
        mem_free(caster->nodes);
    }
    return s;
}

static status find_all(struct casters *casters, int other_lamps, struct error *err)
{
    list_materials(casters);
    TRY(caster_lamps_begin(casters, err));
    if (!other_lamps && casters->lamps.count == 0) { /* no tree is needed */
        casters->count = 0;
        return STATUS_OK;
    }
    TRY(build_all(casters, err));
    if (casters->count == 0)
        return STATUS_OK;
    TRY(casters_look_for_suns(casters, err));
    TRY(caster_lamps_finish(casters, err));
    return caster_cells_new(&casters->cells, err);
}

status casters_new(struct casters **out, const struct render_scene *scene, struct error *err)
{
    const int points = scene->emitters.punctual_count > 0;
    const int windows = scene->environment && environment_has_windows(scene->environment);
    struct casters *casters;
    status s;

    *out = NULL;
    if (!(scene->effects & EFFECT_CAUSTICS) || (!points && !windows && scene->emitters.face_count == 0))
        return STATUS_OK;
    casters = mem_calloc(1, sizeof *casters);
    NEED(casters, err, "what casts caustics");
    casters->scene = scene;
    casters->list = mem_calloc(scene->material_count, sizeof *casters->list);
    s = casters->list ? find_all(casters, points || windows, err) : error_no_memory(err, "what casts caustics");
    if (s != STATUS_OK || casters->count == 0 || (!casters->suns && casters->lamps.count == 0 && !points)) {
        casters_free(casters);
        return s;
    }
    *out = casters;
    return STATUS_OK;
}

void casters_free(struct casters *casters)
{
    if (!casters)
        return;
    for (uint32_t i = 0; casters->list && i < casters->count; i++) {
        mem_free(casters->list[i].nodes);
        mem_free(casters->list[i].refs);
        mem_free(casters->list[i].faces);
    }
    mem_free(casters->list);
    caster_cells_free(casters->cells);
    caster_lamps_release(&casters->lamps);
    mem_free(casters->base);
    mem_free(casters->sunlit);
    mem_free(casters);
}

struct casters *casters_for_points(struct casters *casters)
{
    casters->suns = 0;
    casters->lamps.count = 0;
    if (casters->scene->emitters.punctual_count > 0)
        return casters;
    casters_free(casters);
    return NULL;
}

size_t casters_bytes(const struct casters *casters)
{
    size_t bytes = casters ? caster_cells_bytes(casters->cells) : 0;

    for (uint32_t i = 0; casters && i < casters->count; i++)
        bytes += casters->list[i].face_count * sizeof(struct caster_ref) +
                 casters->list[i].node_count * sizeof(struct caster_node) +
                 (casters->list[i].faces ? casters->list[i].face_count * sizeof(struct caster_face) : 0);
    return bytes;
}

int casters_have(const struct casters *casters, uint32_t material, enum caster_event event, double *ior)
{
    for (uint32_t i = 0; i < casters->count; i++)
        if (casters->list[i].material == material) {
            *ior = casters->list[i].ior;
            return casters->list[i].events >> event & 1;
        }
    return 0;
}

int casters_have_suns(const struct casters *casters) { return casters->suns; }

int casters_are_sunlit(const struct casters *casters, uint32_t instance, uint32_t triangle)
{
    uint64_t bit;

    if (!casters->suns)
        return 0;
    bit = casters->base[instance] + triangle;
    return casters->sunlit[bit / 8] >> bit % 8 & 1;
}

/* ---- finding --------------------------------------------------------------------------------------- */

static void solve_ref(const struct render_scene *scene, const struct caster *caster, uint32_t i,
                      struct caster_pair *pair, caster_visit *visit, void *user)
{
    struct caster_face made;
    const struct caster_face *face = &made;

    if (caster->faces)
        face = &caster->faces[i];
    else
        (void)caster_face_of(scene, &caster->refs[i], &made);
    caster_solve(caster, face, pair, visit, user);
}

static void find_below(const struct render_scene *scene, const struct caster *caster, uint32_t at,
                       struct caster_pair *pair, caster_visit *visit, void *user)
{
    uint32_t waiting[CASTER_DEPTH_MAX], count = 0;

    for (;;) {
        const struct caster_node *node = &caster->nodes[at];

        if (caster_node_may(caster, node, pair)) {
            if (node->count == 0) {
                waiting[count++] = node->first;
                at++;
                continue;
            }
            for (uint32_t i = 0; i < node->count; i++)
                solve_ref(scene, caster, node->first + i, pair, visit, user);
        }
        if (count == 0)
            return;
        at = waiting[--count];
    }
}

void casters_find(const struct casters *casters, const double place[3], const struct caster_lamp *lamp,
                  caster_visit *visit, void *user)
{
    struct caster_pair pair;

    pair.place = place;
    pair.lamp = lamp->at;
    pair.place_radius = pair.lamp_radius = pair.lamp_chord = 0;
    pair.kind = lamp->kind;
    pair.infinite = lamp->kind != CASTER_LAMP_NEAR;
    pair.met_count = 0;
    for (uint32_t i = 0; i < casters->count; i++) {
        const struct caster *caster = &casters->list[i];
        const uint32_t root = 0, *starts = &root;
        uint32_t count = 1;

        if (!lamp->moves)
            starts = caster_cells_find(casters->cells, caster, i, place, lamp, &count);
        for (uint32_t k = 0; k < count; k++)
            find_below(casters->scene, caster, starts[k], &pair, visit, user);
    }
}
