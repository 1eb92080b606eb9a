#include "worker/render/light/emitters.h"

#include <float.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "worker/render/light/spherical.h"
#include "worker/render/surface.h"
#include "worker/render/texture_dark.h"
#include "worker/render/world.h"

/* A group's share of the choices where there are others; where all lights are alike, it is bounded
 * only so that the random number that was spent on the choice stays fine enough for the place. */
#define GROUP_ODDS_MIN 0.25
#define GROUP_ODDS_MIN_ALIKE 0x1p-8
/* An emissive texture is averaged over a triangle on a pattern about as fine as the texels of
 * an image of TEXELS_A_SIDE; what the pattern misses counts as at least this much of the
 * material's factor, so that no lit spot is ever without odds. Triangles that the texture leaves
 * dark throughout are none of the lights. */
enum { TEXELS_A_SIDE = 1024, PATTERN_MIN = 4, PATTERN_MAX = 48 };
#define UNSEEN_EMISSION 1e-4

/* ---- weighing ---------------------------------------------------------------------------- */

static uint32_t pattern_side(const struct world_slot *slot, const struct world_mesh *mesh,
                             const uint32_t vertex[3])
{
    const float *uv = mesh->uv[slot->uv_set];
    float longest = 0, side;

    for (int k = 0; uv && k < 3; k++)
        for (int axis = 0; axis < 2; axis++) {
            const float *a = uv + 2 * (size_t)vertex[k], *b = uv + 2 * (size_t)vertex[(k + 1) % 3];
            float du = b[0] - a[0], dv = b[1] - a[1];

            longest = float_max(longest,
                                fabsf(slot->m[axis][0] * du + slot->m[axis][1] * dv));
        }
    side = longest * TEXELS_A_SIDE;
    return side >= PATTERN_MAX ? PATTERN_MAX : side > PATTERN_MIN ? (uint32_t)side : PATTERN_MIN;
}

/* Is the slot's image black all over the triangle? */
static int slot_is_dark(const struct texture_dark *dark, const struct world_slot *slot,
                        const struct world_mesh *mesh, const uint32_t vertex[3])
{
    const float *uv = mesh->uv[slot->uv_set];
    double range[2][2];

    for (int axis = 0; axis < 2; axis++) {
        const float *m = slot->m[axis];
        double largest = 0, low = INFINITY, high = -INFINITY;

        for (int k = 0; k < 3; k++) {
            double u = uv ? (double)uv[2 * (size_t)vertex[k]] : 0;
            double v = uv ? (double)uv[2 * (size_t)vertex[k] + 1] : 0;
            double at = (double)m[0] * u + (double)m[1] * v + (double)m[2];

            low = fmin(low, at);
            high = fmax(high, at);
            largest = fmax(largest, fabs((double)m[0] * u) + fabs((double)m[1] * v) +
                                        fabs((double)m[2]));
        }
        /* Points in between are interpolated and transformed in float. */
        range[axis][0] = low - 0x1p-20 * largest;
        range[axis][1] = high + 0x1p-20 * largest;
    }
    return texture_dark_in(dark, &slot->texture, range[0], range[1]);
}

/* Mean emitted luminance of a triangle that is not dark. */
static double triangle_luminance(const struct world_material *material,
                                 const struct world_mesh *mesh, const uint32_t vertex[3])
{
    double whole = (double)vec3_luminance(vec3_make(
               material->m.emission[0], material->m.emission[1], material->m.emission[2])),
           sum = 0;
    uint32_t side, n = 0;

    if (!material->emission.image)
        return whole;
    side = pattern_side(&material->emission, mesh, vertex);
    for (uint32_t i = 0; i < side; i++)
        for (uint32_t j = 0; j < side - i; j++, n++) {
            float b1 = ((float)i + 1.0f / 3) / (float)side;
            float b2 = ((float)j + 1.0f / 3) / (float)side;

            sum += (double)vec3_luminance(world_emission(material, mesh, vertex, b1, b2));
        }
    sum /= n;
    return sum > UNSEEN_EMISSION * whole ? sum : UNSEEN_EMISSION * whole;
}

/* Twice the area as a vector, of the triangle with its first edge from one moment and its
 * second from another. */
static struct vec3 crossed(const struct vec3 a[3], const struct vec3 b[3])
{
    return vec3_cross(vec3_sub(a[1], a[0]), vec3_sub(b[2], b[0]));
}

/* Normals of a triangle whose corners move along straight lines are combinations, with positive
 * weights, of those at both ends and of the mean of the mixed ones (Bernstein's form): a
 * cone of less than a right angle around all those holds every normal in between. */
static void cone_add_normal(struct light_bounds *b, struct vec3 doubled)
{
    struct vec3 normal = vec3_normalize(doubled);
    float cosine;

    if (vec3_is_black(normal))
        return;
    if (vec3_is_black(b->axis)) {
        b->axis = normal;
        return;
    }
    cosine = vec3_dot(b->axis, normal);
    b->spread_rad = float_max(b->spread_rad, cosine >= 1 - 1e-6f ? 0 : det_acos(cosine) + 1e-3f);
}

/* Where a triangle is and which way it faces while the shutter is open; its largest area. */
static float triangle_bounds(const struct render_scene *scene,
                             const struct world_instance *instance, uint32_t triangle,
                             struct light_bounds *b)
{
    uint32_t steps = instance->motion_steps > 1 ? instance->motion_steps : 1;
    float sign = instance->flipped ? -1.0f : 1.0f, doubled_area = 0;
    struct vec3 before[3] = {{0, 0, 0}};

    b->min = vec3_splat(INFINITY);
    b->max = vec3_splat(-INFINITY);
    for (uint32_t k = 0; k < steps; k++) {
        float time = steps > 1 ? (float)k / (float)(steps - 1) : 0;
        struct vec3 corner[3], doubled;

        world_triangle(scene, instance, triangle, time, corner);
        for (int c = 0; c < 3; c++)
            light_bounds_add(b, corner[c]);
        doubled = crossed(corner, corner);
        cone_add_normal(b, vec3_scale(doubled, sign));
        if (k > 0)
            cone_add_normal(b, vec3_scale(vec3_add(crossed(before, corner),
                                                   crossed(corner, before)), sign));
        doubled_area = float_max(doubled_area, vec3_length(doubled));
        memcpy(before, corner, sizeof before);
    }
    if (b->spread_rad >= PI_F / 2)
        b->spread_rad = PI_F;
    return 0.5f * doubled_area;
}

/* First pass: number the emissive instances' triangles. */
static uint64_t count_triangles(struct render_scene *scene)
{
    uint64_t total = 0;

    for (uint32_t i = 0; i < scene->instance_count; i++) {
        struct world_instance *instance = &scene->instances[i];
        instance->light_base = -1;
        if (!(scene->materials[instance->material].flags & MATERIAL_EMISSIVE) ||
            scene->materials[instance->material].m.unlit)
            continue;
        instance->light_base = (int32_t)(total < INT32_MAX ? total : INT32_MAX);
        total += scene->meshes[instance->mesh].triangle_count;
    }
    return total;
}

/* Intensities in double, so that sums of the largest floats hold. */
struct weights {
    struct light_bounds *bounds; /* [count] of the tree's items */
    double *intensity;           /* [count] */
    uint32_t count;
    double local_power, directional_power;
    uint32_t local_lit, directional_lit; /* how many have any */
    enum light_choice choice;
};

/* Where the material's emissive texture is dark: made for the first that asks, NULL if it has
 * none. `maps`: [image_count]. */
static status dark_map(const struct world_material *material, struct texture_dark **maps,
                       const struct texture_dark **out, struct error *err)
{
    const struct world_slot *slot = &material->emission;
    status s = STATUS_OK;

    *out = NULL;
    if (!slot->image)
        return STATUS_OK;
    if (!maps[slot->texture.image])
        s = texture_dark_new(&maps[slot->texture.image], slot->image, err);
    *out = maps[slot->texture.image];
    return s;
}

/* Bounds of all triangles, from `next` on. */
static status weigh_triangles(struct emitters *e, const struct render_scene *scene,
                              struct texture_dark **maps, struct weights *w, uint32_t next,
                              struct error *err)
{
    uint32_t at = 0;

    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct world_instance *instance = &scene->instances[i];
        const struct world_mesh *mesh = &scene->meshes[instance->mesh];
        const struct world_material *material = &scene->materials[instance->material];
        const struct texture_dark *map;
        status s;

        if (instance->light_base < 0)
            continue;
        s = dark_map(material, maps, &map, err);
        if (s != STATUS_OK)
            return s;
        for (uint32_t t = 0; t < mesh->triangle_count; t++, at++) {
            struct light_bounds *b = &w->bounds[next + at];
            double intensity, power;

            e->triangle_instance[at] = i;
            e->triangle_index[at] = t;
            if (map && slot_is_dark(map, &material->emission, mesh, world_vertices(mesh, t))) {
                e->dark[at / 8] |= (uint8_t)(1 << at % 8);
                continue;
            }

            b->area = triangle_bounds(scene, instance, t, b);
            b->emission_rad = PI_F / 2;
            b->reach = INFINITY;
            b->lamp = i;
            b->two_sided = material->m.double_sided;
            intensity = (double)b->area *
                        triangle_luminance(material, mesh, world_vertices(mesh, t));
            w->intensity[next + at] = intensity > 0 && isfinite(intensity) ? intensity : 0;
            power = w->intensity[next + at] * PI_D * (b->two_sided ? 2 : 1);
            w->local_power += power;
            w->local_lit += power > 0;
            if (w->choice == LIGHT_CHOICE_POWER)
                w->intensity[next + at] = power;
        }
    }
    return STATUS_OK;
}

/* The directional lights to the front, each with its share; bounds of the others. */
static void weigh_punctual(struct emitters *e, const struct render_scene *scene,
                           const struct scene_light *lights,
                           const struct punctual_motion *motion, struct weights *w)
{
    double radius = (double)scene->bounds_radius, sum = 0;
    int alike = w->choice == LIGHT_CHOICE_UNIFORM;
    uint32_t at = 0;

    for (int directional = 1; directional >= 0; directional--)
        for (uint32_t i = 0; i < e->punctual_count; i++)
            if ((lights[i].kind == LIGHT_DIRECTIONAL) == directional) {
                punctual_init(&e->punctual[at], &lights[i],
                              lights[i].image >= 0 ? scene->images[lights[i].image] : NULL);
                e->punctual[at++].motion = motion[i];
            }
    for (uint32_t i = 0; i < e->punctual_count; i++) {
        double power = punctual_power(&e->punctual[i], radius);

        power = power > 0 && isfinite(power) ? power : 0;
        if (i < e->directional_count) {
            w->directional_power += power;
            w->directional_lit += power > 0;
        } else {
            struct light_bounds *b = &w->bounds[i - e->directional_count];

            punctual_bounds(&e->punctual[i], b);
            w->intensity[i - e->directional_count] =
                w->choice == LIGHT_CHOICE_POWER ? power : power > 0 ? (double)b->intensity : 0;
            w->local_power += power;
            w->local_lit += power > 0;
        }
    }
    for (uint32_t i = 0; i < e->directional_count; i++) {
        double power = punctual_power(&e->punctual[i], radius);
        double total = alike ? w->directional_lit : w->directional_power;

        power = power > 0 && isfinite(power) ? power : 0;
        e->directional_start[i] = total > 0 ? (float)(sum / total) : 0;
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

static void share_groups(struct emitters *e, const struct render_scene *scene,
                         const struct weights *w)
{
    int alike = w->choice == LIGHT_CHOICE_UNIFORM;
    double directional_weight = alike ? w->directional_lit : w->directional_power;
    double local_weight = alike ? w->local_lit : w->local_power;
    double least = alike ? GROUP_ODDS_MIN_ALIKE : GROUP_ODDS_MIN;
    double radius = (double)scene->bounds_radius, environment = 0, share, directional;

    if (e->has_environment)
        environment = 4 * PI_D * PI_D * radius * radius *
                      (double)environment_mean_luminance(scene->environment);
    /* The faintest environment is sampled too. */
    environment = e->has_environment && !(environment > 0) ? DBL_MIN : environment;
    if (alike)
        environment = e->has_environment;
    share = bounded_share(environment, directional_weight + local_weight, least);
    directional = bounded_share(directional_weight, local_weight, least);
    e->environment_odds = (float)share;
    e->directional_odds =
        w->local_power > 0 ? (float)((1 - share) * directional)
        : w->directional_power > 0 ? 1 - e->environment_odds : 0;
    e->local_odds = w->local_power > 0 ? 1 - e->environment_odds - e->directional_odds : 0;
    if (share > 0 || w->directional_power > 0 || w->local_power > 0)
        e->count = e->punctual_count + e->triangle_count + (uint32_t)e->has_environment;
}

/* The lights with a place, made ready to be chosen from. */
static status grow_tree(struct emitters *e, struct weights *w, struct error *err)
{
    double largest = 0;

    if (w->choice == LIGHT_CHOICE_UNIFORM)
        for (uint32_t i = 0; i < w->count; i++)
            w->intensity[i] = w->intensity[i] > 0;
    if (w->choice != LIGHT_CHOICE_TREE)
        return light_table_init(&e->table, w->intensity, w->count, err);
    for (uint32_t i = 0; i < w->count; i++)
        largest = w->intensity[i] > largest ? w->intensity[i] : largest;
    for (uint32_t i = 0; i < w->count; i++) {
        float relative = largest > 0 ? (float)(w->intensity[i] / largest) : 0;

        w->bounds[i].intensity = w->intensity[i] > 0 ? float_max(relative, FLT_MIN) : 0;
    }
    return light_tree_init(&e->tree, w->bounds, w->count, err);
}

status emitters_init(struct emitters *e, struct render_scene *scene,
                     const struct scene_light *lights, const struct punctual_motion *motion,
                     uint32_t light_count, const struct scene_portal *portals,
                     uint32_t portal_count, struct error *err)
{
    uint64_t triangles = count_triangles(scene);
    struct texture_dark **maps = NULL;
    struct weights w = {.choice = scene->settings.light_choice};
    status s;

    memset(e, 0, sizeof *e);
    if (triangles > INT32_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%llu emissive triangles: more than 2^31",
                         (unsigned long long)triangles);
    e->triangle_count = (uint32_t)triangles;
    e->punctual_count = light_count;
    for (uint32_t i = 0; i < light_count; i++)
        e->directional_count += lights[i].kind == LIGHT_DIRECTIONAL;
    e->has_environment = scene->environment && !environment_is_black(scene->environment) &&
                         scene->settings.env_sampling != ENV_SAMPLING_BSDF;
    e->environment_alone = e->has_environment &&
                           (scene->settings.env_sampling == ENV_SAMPLING_IMPORTANCE_ONLY ||
                            scene->settings.env_sampling == ENV_SAMPLING_UNIFORM_ONLY);
    w.count = light_count - e->directional_count + e->triangle_count;
    w.bounds = mem_calloc(w.count, sizeof *w.bounds);
    w.intensity = mem_calloc(w.count, sizeof *w.intensity);
    e->punctual = mem_calloc(light_count, sizeof *e->punctual);
    e->directional_start = mem_calloc((size_t)e->directional_count + 1,
                                      sizeof *e->directional_start);
    e->triangle_instance = mem_alloc_array(e->triangle_count, sizeof *e->triangle_instance);
    e->triangle_index = mem_alloc_array(e->triangle_count, sizeof *e->triangle_index);
    e->dark = mem_calloc((size_t)e->triangle_count / 8 + 1, 1);
    maps = mem_calloc((size_t)scene->image_count + 1, sizeof *maps);
    if (!w.bounds || !w.intensity || !e->punctual || !e->directional_start ||
        !e->triangle_instance || !e->triangle_index || !e->dark || !maps) {
        s = error_no_memory(err, "the table of lights");
        goto done;
    }
    weigh_punctual(e, scene, lights, motion, &w);
    s = weigh_triangles(e, scene, maps, &w, light_count - e->directional_count, err);
    if (s != STATUS_OK)
        goto done;
    share_groups(e, scene, &w);
    s = grow_tree(e, &w, err);
    if (s == STATUS_OK && e->has_environment)
        s = portals_init(&e->portals, portals, portal_count, err);
done:
    for (uint32_t i = 0; maps && i < scene->image_count; i++)
        texture_dark_free(maps[i]);
    mem_free(maps);
    mem_free(w.bounds);
    mem_free(w.intensity);
    if (s != STATUS_OK)
        emitters_release(e);
    return s;
}

void emitters_release(struct emitters *e)
{
    portals_release(&e->portals);
    light_tree_release(&e->tree);
    light_table_release(&e->table);
    mem_free(e->directional_start);
    mem_free(e->punctual);
    mem_free(e->triangle_instance);
    mem_free(e->triangle_index);
    mem_free(e->dark);
    memset(e, 0, sizeof *e);
}
