#include "common/scene/effects.h"

#include <math.h>

#include "common/base/memory.h"

static const char *const names[EFFECT_COUNT] = {
#define EFFECT_NAME(name, text) text,
    EFFECT_MAP(EFFECT_NAME)
#undef EFFECT_NAME
};

const char *effect_name(enum effect_bit bit)
{
    return (unsigned)bit < EFFECT_COUNT ? names[bit] : "unknown";
}

/* What a material can be on one mesh; a texture can lower its factor to anything. */
struct surface {
    const struct scene_material *m;
    const struct scene_mesh *mesh;
};

static int has(const struct scene_texture_slot *slot)
{
    return slot->texture >= 0;
}

static int is_black(const float color[3])
{
    return color[0] == 0 && color[1] == 0 && color[2] == 0;
}

/* Can the surface let a ray through by its alpha? And is it never there at all? */
static int alpha_acts(const struct surface *s, int *invisible)
{
    const struct scene_material *m = s->m;
    int varies = has(&m->base_color_texture) || (s->mesh->arrays & MESH_COLORS);
    float alpha = m->base_color[3];

    *invisible = 0;
    if (m->alpha_mode == ALPHA_OPAQUE)
        return 0;
    if (m->alpha_mode == ALPHA_MASK) {
        if (m->alpha_cutoff <= 0)
            return 0;
        /* Textures and vertex colours can only lower alpha. */
        *invisible = alpha < m->alpha_cutoff;
        return varies || *invisible;
    }
    *invisible = alpha == 0;
    return varies || alpha < 1;
}

/* Lobes of a reflecting surface, by how rough it can be. */
static uint64_t by_roughness(const struct scene_material *m, uint64_t smooth, uint64_t rough)
{
    if (m->roughness < EFFECT_MIRROR_ROUGHNESS)
        return smooth;
    return has(&m->metallic_roughness_texture) ? smooth | rough : rough;
}

/* Is the material ever seen through (thin or refracting)? */
static int transmits(const struct scene_material *m)
{
    int all_metal = m->metallic == 1 && !has(&m->metallic_roughness_texture);

    return !m->unlit && m->transmission > 0 && !all_metal;
}

static uint64_t lobes(const struct scene_material *m)
{
    int textured_metal = has(&m->metallic_roughness_texture);
    int some_dielectric = m->metallic < 1 || textured_metal;
    int all_transmission = m->transmission == 1 && !has(&m->transmission_texture);
    uint64_t set = 0;

    if (m->metallic > 0)
        set |= by_roughness(m, EFFECT_MIRROR, EFFECT_GLOSSY);
    if (!some_dielectric)
        return set;
    if (!all_transmission && !is_black(m->base_color))
        set |= EFFECT_DIFFUSE;
    if (m->specular > 0)
        set |= by_roughness(m, EFFECT_MIRROR, EFFECT_GLOSSY);
    if (transmits(m)) {
        if (m->refractive) {
            int absorbs = isfinite(m->attenuation_distance) &&
                          (m->attenuation_color[0] != 1 || m->attenuation_color[1] != 1 ||
                           m->attenuation_color[2] != 1);
            /* From inside there is total reflection whatever `specular` says. */
            set |= by_roughness(m, EFFECT_MIRROR | EFFECT_DIELECTRIC,
                                EFFECT_GLOSSY | EFFECT_ROUGH_DIELECTRIC);
            if (m->ior == 1)
                set |= EFFECT_DIELECTRIC; /* nothing blurs without a change of index */
            if (absorbs)
                set |= EFFECT_ABSORPTION;
        } else {
            set |= EFFECT_THIN_TRANSMISSION;
        }
    }
    return set;
}

/* Textures that can change what the lobes do. */
static uint64_t textures(const struct surface *s, uint64_t set, int alpha)
{
    const struct scene_material *m = s->m;
    int some_dielectric = m->metallic < 1 || has(&m->metallic_roughness_texture);
    int colored = !is_black(m->base_color);
    int lit = !m->unlit;
    int any = 0;
    uint64_t found = 0;

    any |= has(&m->base_color_texture) && (colored || alpha);
    any |= lit && has(&m->metallic_roughness_texture) && (m->metallic > 0 || m->roughness > 0);
    any |= lit && has(&m->emission_texture) && !is_black(m->emission);
    if (lit && some_dielectric) {
        any |= has(&m->specular_texture) && m->specular > 0;
        any |= has(&m->specular_color_texture) && m->specular > 0 && !is_black(m->specular_color);
        any |= has(&m->transmission_texture) && m->transmission > 0;
    }
    if (lit && has(&m->normal_texture) && m->normal_scale != 0 &&
        (s->mesh->arrays & MESH_TANGENTS) && set != 0) {
        found |= EFFECT_NORMAL_MAP;
        any = 1;
    }
    if (any)
        found |= EFFECT_TEXTURE;
    if ((s->mesh->arrays & MESH_COLORS) && (colored || alpha))
        found |= EFFECT_VERTEX_COLOR;
    return found;
}

/* Can a ray of this camera start inside the instance's box? Then it may meet the back of
 * a closed mesh first. */
static int camera_may_be_inside(const struct scene *scene, const struct scene_camera *camera,
                                uint32_t instance)
{
    double low[3], high[3];

    if (camera->kind == CAMERA_ORTHOGRAPHIC)
        return 1; /* rays start on a plane whose extent the job's aspect decides */
    if (!scene_instance_bounds(scene, instance, low, high))
        return 1;
    for (int i = 0; i < 3; i++) {
        double at = (double)camera->to_world.m[i][3];
        /* A box computed in double may be short by the rounding of the hit in float. */
        double slack = 1e-4 * (high[i] - low[i]) + 1e-5 * fabs(at);
        if (at < low[i] - slack || at > high[i] + slack)
            return 0;
    }
    return 1;
}

static uint64_t instance_effects(const struct scene *scene, const struct scene_camera *camera,
                                 uint32_t index)
{
    const struct scene_instance *instance = &scene->instances[index];
    const struct surface s = {&scene->materials[instance->material],
                              &scene->meshes[instance->mesh]};
    uint64_t set = 0;
    int invisible, alpha;

    alpha = alpha_acts(&s, &invisible);
    if (invisible)
        return EFFECT_ALPHA; /* no ray ever sees more of it than that it is not there */
    if (s.m->unlit) {
        set = EFFECT_UNLIT;
    } else {
        set = lobes(s.m);
        if (!is_black(s.m->emission))
            set |= EFFECT_EMISSIVE_MESH;
    }
    set |= textures(&s, set, alpha);
    if (alpha)
        set |= EFFECT_ALPHA;
    /* Refractive volumes have two sides by definition (KHR_materials_volume). */
    if (!s.m->double_sided && !(transmits(s.m) && s.m->refractive)) {
        int sealed = s.mesh->closed && !alpha && !transmits(s.m);
        if (!sealed || camera_may_be_inside(scene, camera, index))
            set |= EFFECT_CULLING;
    }
    return set;
}

/* Is a mesh placed more than once? */
static int any_mesh_repeats(const struct scene *scene)
{
    uint8_t *seen;
    int repeats = 0;

    if (scene->instance_count > scene->mesh_count)
        return 1;
    seen = mem_calloc(scene->mesh_count, 1);
    if (!seen)
        return 1; /* the safe answer: instancing is then simulated for nothing */
    for (uint32_t i = 0; i < scene->instance_count && !repeats; i++)
        repeats = seen[scene->instances[i].mesh]++ != 0;
    mem_free(seen);
    return repeats;
}

uint64_t scene_effects(const struct scene *scene, uint32_t camera)
{
    const struct scene_camera *eye = &scene->cameras[camera < scene->camera_count ? camera : 0];
    const struct scene_environment *env = &scene->environment;
    uint64_t set = 0;

    for (uint32_t i = 0; i < scene->instance_count; i++)
        set |= instance_effects(scene, eye, i);
    for (uint32_t i = 0; i < scene->light_count; i++)
        if (!is_black(scene->lights[i].intensity))
            set |= EFFECT_PUNCTUAL_LIGHT;
    if (env->present && !(env->constant && is_black(env->radiance)))
        set |= EFFECT_ENVIRONMENT;
    if (eye->kind == CAMERA_ORTHOGRAPHIC)
        set |= EFFECT_ORTHOGRAPHIC;
    if (any_mesh_repeats(scene))
        set |= EFFECT_INSTANCING;
    return set;
}
