/* emitters_sample: choosing a light at a path's vertex, and the odds of that choice. */
#include "worker/render/base/fault.h"
#include "worker/render/base/profile_scope.h"
#include "worker/render/base/gate.h"
#include "worker/render/light/emitters.h"
#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"

/* The one place that samples lights by kind. A row of the table is a case; kernels without its effect leave it out. */
static inline int emitters_sample_light(const struct render_scene *scene, int kind, const void *light,
                                        const struct light_context *context, real u, real v, struct light_sample *out)
{
    out->kind = kind;
    out->light = light;
    switch (kind) {
#define LIGHT_CASE(KIND, prefix, EFFECT, ACCOUNT, MET)                                    \
    case LIGHT_##KIND:                                                                    \
        if (!calls_for(EFFECTS_ALL, EFFECT_##EFFECT))                                     \
            return 0;                                                                     \
        profile_account(calls_for(scene->effects, EFFECT_##ACCOUNT) ? PROFILE_ACCOUNT(ACCOUNT) \
                                                                    : PROFILE_ACCOUNT(EFFECT)); \
        return prefix##_sample(scene, light, context, u, v, out);
        LIGHT_KINDS(LIGHT_CASE)
#undef LIGHT_CASE
    }
    return 0;
}

/* The same of a face: by its shape, so that the kind is a constant wherever it is sampled. */
static inline int emitters_sample_face(const struct render_scene *scene, const struct hit *face,
                                       const struct light_context *context, real u, real v, struct light_sample *out)
{
    switch (shape_kind_of(scene->instances[face->instance].shape)) {
#define SHAPE_CASE(KIND, ...) \
    case SHAPE_##KIND:        \
        return emitters_sample_light(scene, LIGHT_##KIND, face, context, u, v, out);
        SHAPE_KINDS(SHAPE_CASE)
#undef SHAPE_CASE
    case SHAPE_KIND_COUNT: break;
    }
    return 0;
}

static int emitters_sample_punctual(const struct render_scene *scene, const struct punctual *light,
                                    const struct light_context *context, struct light_sample *out)
{
    return out->pdf > 0 && emitters_sample_light(scene, (int)light->kind, light, context, 0, 0, out);
}

static int emitters_sample_directional(const struct render_scene *scene, const struct light_context *context, real u,
                                       struct light_sample *out)
{
    const struct emitters *e = &scene->emitters;
    const real *start = e->directional_start;
    uint32_t low = 0, high = e->directional_count;

    /* The last that begins at or before u: start[low] <= u < start[high]. */
    while (high - low > 1) {
        uint32_t middle = low + (high - low) / 2;

        if (start[middle] <= u)
            low = middle;
        else
            high = middle;
    }
    out->pdf = e->directional_odds * (start[low + 1] - start[low]);
    return emitters_sample_punctual(scene, e->punctual[low], context, out);
}

int emitters_sample_item(const struct render_scene *scene, uint32_t item, const struct light_context *context,
                         real odds, real u, real v, struct light_sample *out)
{
    const struct emitters *e = &scene->emitters;
    const uint32_t punctual = emitters_local_punctual(e);

    out->pdf = odds;
    if (item < punctual)
        return emitters_sample_punctual(scene, e->punctual[e->directional_count + item], context, out);
    return emitters_sample_face(scene, &e->faces[item - punctual], context, u, v, out);
}

static int emitters_sample_local(const struct render_scene *scene, const struct light_context *context, real u, real v,
                                 struct light_sample *out)
{
    const struct emitters *e = &scene->emitters;
    uint32_t item;
    real odds;

    /* Choosing among lights of both kinds counts as the faces': they are the many. */
    profile_account(e->face_count ? PROFILE_ACCOUNT(EMISSIVE_MESH) : PROFILE_ACCOUNT(PUNCTUAL_LIGHT));
    if (e->tree.node_count == 0 ? !light_table_choose(&e->table, &u, &v, &item, &odds)
                                : !light_tree_choose(&e->tree, lamp_guide_seen(&e->guide, context), context->p,
                                                     context->n, &u, &v, &item, &odds))
        return 0;
    return emitters_sample_item(scene, item, context, odds * e->local_odds, u, v, out);
}

static int emitters_choose(const struct render_scene *scene, const struct light_context *context, real u, real v,
                           struct light_sample *out)
{
    const struct emitters *e = &scene->emitters;

    if (u < e->environment_odds) {
        out->pdf = e->environment_odds;
        return emitters_sample_light(scene, LIGHT_ENVIRONMENT, &e->environment, context,
                                     light_rescaled(u, 0, e->environment_odds), v, out);
    }
    u -= e->environment_odds;
    if (u < e->directional_odds)
        return emitters_sample_directional(scene, context, light_rescaled(u, 0, e->directional_odds), out);
    return emitters_sample_local(scene, context, light_rescaled(u, e->directional_odds, e->local_odds), v, out);
}

int emitters_sample(const struct render_scene *scene, const struct light_context *context, real u, real v,
                    struct light_sample *out)
{
    int found;

    PROFILE_STAGE(LIGHT);
    out->light = NULL;
    out->unread = NULL;
    out->on_face = 0;
    found = emitters_choose(scene, context, u, v, out);
    if (FAULT(ZERO_DENSITY))
        out->pdf = 0;
    return found;
}

int emitters_sample_one(const struct render_scene *scene, const struct punctual *light,
                        const struct light_context *context, real odds, struct light_sample *out)
{
    PROFILE_STAGE(LIGHT);
    out->light = NULL;
    out->unread = NULL;
    out->on_face = 0;
    out->pdf = odds;
    return emitters_sample_punctual(scene, light, context, out);
}

/* ---- densities of what scattered rays meet ------------------------------------------------- */

struct vec3 emitters_environment(const struct render_scene *scene, const struct light_context *context,
                                 struct vec3 direction, real *pdf)
{
    const struct emitters *e = &scene->emitters;
    struct vec3 radiance;

    *pdf = 0;
    if (!scene->environment)
        return vec3_splat(0);
    if (!e->has_environment)
        return environment_radiance(scene->environment, direction);
    radiance = environment_light_radiance(&e->environment, context, direction, pdf);
    *pdf *= e->environment_odds;
    return radiance;
}

uint32_t emitters_face_at(const struct render_scene *scene, const struct surface *s)
{
    const struct render_instance *instance = s->instance;

    /* The parts of a mix are not sampled as lights. */
    if (instance->light_base < 0 || s->material != &scene->materials[instance->material])
        return EMITTERS_NO_FACE;
    return (uint32_t)instance->light_base + s->triangle;
}

/* The odds of having chosen the face. */
static real emitters_face_odds(const struct emitters *e, const struct light_context *context, uint32_t face)
{
    uint32_t item = emitters_local_punctual(e) + face;

    return e->local_odds * (e->tree.node_count == 0 ? light_table_odds(&e->table, item)
                                                    : light_tree_odds(&e->tree, lamp_guide_seen(&e->guide, context),
                                                                      context->p, context->n, item));
}

real emitters_face_pdf(const struct render_scene *scene, const struct light_context *context, uint32_t face,
                       real distance_squared, real cosine, real area)
{
    const struct emitters *e = &scene->emitters;
    const struct light_meeting met = {emitters_face_odds(e, context, face), distance_squared, cosine,
                                      area};

    switch (face_light_kind(scene->instances[e->faces[face].instance].shape)) {
#define LIGHT_PDF_FACE(KIND, prefix) \
    case LIGHT_##KIND:               \
        return prefix##_pdf(scene, &e->faces[face], context, &met);
#define LIGHT_PDF_ESCAPE(KIND, prefix)
#define LIGHT_PDF_NEVER(KIND, prefix)
#define LIGHT_PDF(KIND, prefix, EFFECT, ACCOUNT, MET) LIGHT_PDF_##MET(KIND, prefix)
        LIGHT_KINDS(LIGHT_PDF)
#undef LIGHT_PDF
#undef LIGHT_PDF_FACE
#undef LIGHT_PDF_ESCAPE
#undef LIGHT_PDF_NEVER
    }
    return 0;
}
