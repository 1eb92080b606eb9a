/* emitters: all lights of a scene, and how next-event estimation chooses among them.
 *
 * Three groups share the choices with fixed odds: the environment (if it is sampled), the directional lights, and
 * everything that has a place: the other lights of the scene's list and the faces of emissive instances (face_light.h),
 * among which a tree chooses by what they can do at the light sampling context (tree.h). Groups share by power, but
 * each within bounds, because power says nothing about which light a point can see.
 * If the job sets another light choice, a table (light_table.h) replaces the tree. It weighs lights by their power, or
 * all equally.
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"
#include "common/math/vec.h"
#include "common/scene/scene.h"
#include "worker/render/light/environment/environment_light.h"
#include "worker/render/light/face_light.h"
#include "worker/render/light/light.h"
#include "worker/render/light/lamp_guide.h"
#include "worker/render/light/light_table.h"
#include "worker/render/light/punctual.h"
#include "worker/render/light/tree.h"

struct render_scene;
struct surface;

struct emitters {
    uint32_t count; /* lights; 0: nothing to sample */
    uint32_t punctual_count, face_count;
    int has_environment;
    real environment_odds, directional_odds, local_odds; /* of the groups; their sum is 1 */
    struct environment_light environment;
    struct punctual **punctual; /* [punctual_count], the directional ones first */
    uint32_t directional_count;
    real *directional_start;  /* [directional_count + 1] where each one's share begins */
    struct light_tree tree;   /* items: punctual lights with a place, then the faces */
    struct light_table table; /* of the same items, in place of the tree */
    struct lamp_guide guide;  /* of the tree */
    struct hit *faces;        /* [face_count] of emissive instances */
    uint8_t *dark;            /* [face_count] bits: the emissive texture is black there */
};

/* Needs the scene's instances (with their motion), materials, images, environment and bounding sphere. `lights`: at the
 * shutter's opening; motion[i] of each must outlive *e. Portals have an effect only with an environment. */
status emitters_init(struct emitters *e, struct render_scene *scene, const struct scene_light *lights,
                     const struct punctual_motion *motion, uint32_t light_count, const struct scene_portal *portals,
                     uint32_t portal_count, struct error *err) MUST_CHECK;
void emitters_release(struct emitters *e);

/* Does the face, by its number, send out nothing at all? */
static inline int emitters_is_dark(const struct emitters *e, uint32_t face)
{
    return e->dark[face / 8] >> face % 8 & 1;
}

/* How many items of the tree are not faces. */
static inline uint32_t emitters_local_punctual(const struct emitters *e)
{
    return e->punctual_count - e->directional_count;
}

/* Sample a light for the context. The same numbers choose the light and, rescaled, the point on it;
 * each in [0, 1). Returns 0 for "no sample". light_radiance() tells the sample's radiance. Charges the kind of light (profile_scope.h). */
int emitters_sample(const struct render_scene *scene, const struct light_context *context, real u, real v,
                    struct light_sample *out);

/* Sample a point of this item of the tree; the item was chosen with these odds among all lights. As emitters_sample. */
int emitters_sample_item(const struct render_scene *scene, uint32_t item, const struct light_context *context,
                         real odds, real u, real v, struct light_sample *out);

/* Sample this light of the scene's list; the sample's pdf is `odds`. As emitters_sample. */
int emitters_sample_one(const struct render_scene *scene, const struct punctual *light,
                        const struct light_context *context, real odds, struct light_sample *out);

/* The environment's radiance, and the solid-angle density (odds included) with which
 * emitters_sample picks `direction` on it: the two share work. */
struct vec3 emitters_environment(const struct render_scene *scene, const struct light_context *context,
                                 struct vec3 direction, real *pdf);

/* The number of the face that was met; EMITTERS_NO_FACE: light sampling does not know it. */
#define EMITTERS_NO_FACE UINT32_MAX
uint32_t emitters_face_at(const struct render_scene *scene, const struct surface *s);

/* Solid-angle density (odds included) with which emitters_sample would have picked the point that was
 * met on that face. `cosine`: absolute, at the light; `area`: the triangle's, m^2. */
real emitters_face_pdf(const struct render_scene *scene, const struct light_context *context, uint32_t face,
                       real distance_squared, real cosine, real area);
