#include "worker/render/light/emitters.h"

#include <float.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "worker/render/render_scene.h"

/* A group's share of the choices if there are other groups. If all lights are weighed equally, the
 * bound only keeps the number that made the choice fine enough for the point on the light. */
#define GROUP_ODDS_MIN 0.25
#define GROUP_ODDS_MIN_ALIKE 0x1p-8

/* ---- weighing ---------------------------------------------------------------------------- */

/* Intensities in double, so that sums of the largest floats do not overflow. */
struct weights {
    struct light_bounds *bounds; /* [count] of the tree's items */
    double *intensity;           /* [count] */
    uint32_t count;
    double local_power, directional_power;
    uint32_t local_lit, directional_lit; /* how many have an intensity above 0 */
    enum light_choice choice;
};

static struct light_weight weight_of(const struct render_scene *scene, int kind, const void *light)
{
    struct light_weight out = {0};

    light_row(kind)->weigh(scene, light, &out);
    out.power = out.power > 0 && isfinite(out.power) ? out.power : 0;
    return out;
}

static void weigh_item(struct weights *w, uint32_t item, const struct light_weight *weight)
{
    w->bounds[item] = weight->bounds;
    w->intensity[item] = w->choice == LIGHT_CHOICE_POWER ? weight->power
                         : weight->power > 0             ? weight->intensity : 0;
    w->local_power += weight->power;
    w->local_lit += weight->power > 0;
}

static void weigh_lights(const struct emitters *e, const struct render_scene *scene, struct weights *w)
{
    uint32_t item = 0;

    for (uint32_t i = 0; i < e->punctual_count; i++) {
        const struct punctual *light = e->punctual[i];
        struct light_weight weight = weight_of(scene, (int)light->kind, light);

        if (i < e->directional_count) {
            w->directional_power += weight.power;
            w->directional_lit += weight.power > 0;
        } else {
            weigh_item(w, item++, &weight);
        }
    }
    for (uint32_t i = 0; i < e->face_count; i++, item++)
        if (!emitters_is_dark(e, i)) {
            const struct shape *shape = scene->instances[e->faces[i].instance].shape;
            struct light_weight weight = weight_of(scene, face_light_kind(shape), &e->faces[i]);

            weigh_item(w, item, &weight);
        }
}

/* Where each directional light's share of the choices begins. */
static void share_directional(struct emitters *e, const struct render_scene *scene, const struct weights *w)
{
    int alike = w->choice == LIGHT_CHOICE_UNIFORM;
    double total = alike ? w->directional_lit : w->directional_power, sum = 0;

    for (uint32_t i = 0; i < e->directional_count; i++) {
        double power = weight_of(scene, LIGHT_DIRECTIONAL, e->punctual[i]).power;

        e->directional_start[i] = total > 0 ? (real)(sum / total) : 0;
        sum += alike ? power > 0 : power;
    }
    e->directional_start[e->directional_count] = 1;
}

static double bounded_share(double part, double rest, double least)
{
    double share;

    if (!(part > 0) || !(rest > 0))
        return part > 0;
    share = part / (part + rest);
    return share < least ? least : share > 1 - least ? 1 - least : share;
}

static double environment_weight(const struct emitters *e, const struct render_scene *scene, int alike)
{
    double power;

    if (!e->has_environment || alike)
        return e->has_environment;
    power = weight_of(scene, LIGHT_ENVIRONMENT, &e->environment).power;
    return power > 0 ? power : DBL_MIN; /* the faintest environment is sampled too */
}

static void share_groups(struct emitters *e, const struct render_scene *scene, const struct weights *w)
{
    int alike = w->choice == LIGHT_CHOICE_UNIFORM;
    double directional_weight = alike ? w->directional_lit : w->directional_power;
    double local_weight = alike ? w->local_lit : w->local_power;
    double least = alike ? GROUP_ODDS_MIN_ALIKE : GROUP_ODDS_MIN;
    double share = bounded_share(environment_weight(e, scene, alike), directional_weight + local_weight, least);
    double directional = bounded_share(directional_weight, local_weight, least);

    e->environment_odds = (real)share;
    e->directional_odds = w->local_power > 0         ? (real)((1 - share) * directional)
                          : w->directional_power > 0 ? 1 - e->environment_odds
                                                     : 0;
    e->local_odds = w->local_power > 0 ? 1 - e->environment_odds - e->directional_odds : 0;
    if (share > 0 || w->directional_power > 0 || w->local_power > 0)
        e->count = e->punctual_count + e->face_count + (uint32_t)e->has_environment;
}

/* The local lights, ready to be chosen from. */
static status grow_tree(struct emitters *e, struct weights *w, struct error *err)
{
    double largest = 0;

    if (w->choice == LIGHT_CHOICE_UNIFORM)
        for (uint32_t i = 0; i < w->count; i++)
            w->intensity[i] = w->intensity[i] > 0;
    if (w->choice == LIGHT_CHOICE_POWER || w->choice == LIGHT_CHOICE_UNIFORM)
        return light_table_init(&e->table, w->intensity, w->count, err);
    for (uint32_t i = 0; i < w->count; i++)
        largest = w->intensity[i] > largest ? w->intensity[i] : largest;
    for (uint32_t i = 0; i < w->count; i++) {
        real relative = largest > 0 ? (real)(w->intensity[i] / largest) : 0;

        w->bounds[i].intensity = w->intensity[i] > 0 ? real_max(relative, FLT_MIN) : 0;
    }
    return light_tree_init(&e->tree, w->bounds, w->count, err);
}

static status choose_odds(struct emitters *e, const struct render_scene *scene, struct error *err)
{
    struct weights w = {.choice = scene->settings.light_choice};
    status s;

    w.count = emitters_local_punctual(e) + e->face_count;
    w.bounds = mem_calloc(w.count, sizeof *w.bounds);
    w.intensity = mem_calloc(w.count, sizeof *w.intensity);
    if (w.bounds && w.intensity) {
        weigh_lights(e, scene, &w);
        share_directional(e, scene, &w);
        share_groups(e, scene, &w);
        s = grow_tree(e, &w, err);
    } else {
        s = error_no_memory(err, "the table of lights");
    }
    mem_free(w.bounds);
    mem_free(w.intensity);
    return s;
}

/* ---- making ------------------------------------------------------------------------------- */

static int is_lit(const struct scene_light *light) { return !scene_color_is(light->intensity, 0); }

/* Move the directional lights to the front, and leave the black ones out. */
static status make_punctual(struct emitters *e, const struct render_scene *scene, const struct scene_light *lights,
                            const struct punctual_motion *motion, uint32_t count, struct error *err)
{
    uint32_t at = 0;

    for (int directional = 1; directional >= 0; directional--)
        for (uint32_t i = 0; i < count; i++) {
            const struct scene_light *light = &lights[i];

            if ((light->kind == LIGHT_DIRECTIONAL) != directional || !is_lit(light))
                continue;
            e->punctual[at] =
                light_row((int)light->kind)->create(light, light->image >= 0 ? scene->images[light->image] : NULL);
            NEED(e->punctual[at], err, "the table of lights");
            e->punctual[at++]->motion = motion[i];
        }
    return STATUS_OK;
}

static status make_environment(struct emitters *e, const struct render_scene *scene, const struct scene_portal *portals,
                               uint32_t portal_count, struct error *err)
{
    enum env_sampling sampling = scene->settings.env_sampling;

    e->has_environment =
        scene->environment && !environment_is_black(scene->environment) && sampling != ENV_SAMPLING_BSDF;
    if (!e->has_environment)
        return STATUS_OK;
    e->environment.map = scene->environment;
    e->environment.alone = sampling == ENV_SAMPLING_IMPORTANCE_ONLY || sampling == ENV_SAMPLING_UNIFORM_ONLY;
    return portals_init(&e->environment.portals, portals, portal_count, err);
}

status emitters_init(struct emitters *e, struct render_scene *scene, const struct scene_light *lights,
                     const struct punctual_motion *motion, uint32_t light_count, const struct scene_portal *portals,
                     uint32_t portal_count, struct error *err)
{
    uint64_t faces = face_lights_count(scene);
    status s;

    memset(e, 0, sizeof *e);
    if (faces > INT32_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%llu emissive triangles and spheres: more than 2^31",
                         (unsigned long long)faces);
    e->face_count = (uint32_t)faces;
    for (uint32_t i = 0; i < light_count; i++) {
        e->punctual_count += (uint32_t)is_lit(&lights[i]);
        e->directional_count += is_lit(&lights[i]) && lights[i].kind == LIGHT_DIRECTIONAL;
    }
    e->punctual = mem_calloc(e->punctual_count, sizeof *e->punctual);
    e->directional_start = mem_calloc((size_t)e->directional_count + 1, sizeof *e->directional_start);
    e->faces = mem_alloc_array(e->face_count, sizeof *e->faces);
    e->dark = mem_calloc((size_t)e->face_count / 8 + 1, 1);
    if (!e->punctual || !e->directional_start || !e->faces || !e->dark)
        s = error_no_memory(err, "the table of lights");
    else if ((s = make_punctual(e, scene, lights, motion, light_count, err)) == STATUS_OK &&
             (s = face_lights_find(scene, e->faces, e->dark, err)) == STATUS_OK &&
             (s = make_environment(e, scene, portals, portal_count, err)) == STATUS_OK)
        s = choose_odds(e, scene, err);
    if (s != STATUS_OK)
        emitters_release(e);
    return s;
}

void emitters_release(struct emitters *e)
{
    portals_release(&e->environment.portals);
    sky_guide_release(&e->environment.guide);
    lamp_guide_release(&e->guide);
    light_tree_release(&e->tree);
    light_table_release(&e->table);
    for (uint32_t i = 0; e->punctual && i < e->punctual_count; i++)
        mem_free(e->punctual[i]);
    mem_free(e->punctual);
    mem_free(e->directional_start);
    mem_free(e->faces);
    mem_free(e->dark);
    memset(e, 0, sizeof *e);
}
