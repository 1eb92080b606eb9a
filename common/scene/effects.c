#include "common/scene/effects.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/scene/pose.h"
#include "common/scene/settings.h"

static const char *const names[EFFECT_COUNT] = {
#define EFFECT_NAME(name, text) text,
    EFFECT_MAP(EFFECT_NAME)
#undef EFFECT_NAME
};

const char *effect_name(enum effect_bit bit)
{
    return (unsigned)bit < EFFECT_COUNT ? names[bit] : "unknown";
}

int effect_parse(const char *name)
{
    for (int i = 0; i < EFFECT_COUNT; i++) {
        const char *a = names[i], *b = name;
        while (*a && (*a == *b || (*a == ' ' && *b == '-')))
            a++, b++;
        if (!*a && !*b)
            return i;
    }
    return -1;
}

void scene_material_reduce(struct scene_material *m, uint64_t without)
{
    struct scene_texture_slot *slots[] = {
        &m->base_color_texture, &m->metallic_roughness_texture, &m->normal_texture,
        &m->emission_texture, &m->specular_texture, &m->specular_color_texture,
        &m->transmission_texture, &m->anisotropy_texture, &m->clearcoat_texture,
        &m->clearcoat_roughness_texture, &m->clearcoat_normal_texture, &m->sheen_color_texture,
        &m->sheen_roughness_texture, &m->iridescence_texture, &m->iridescence_thickness_texture,
        &m->diffuse_transmission_texture, &m->diffuse_transmission_color_texture,
        &m->mix_texture,
    };

    if (without & EFFECT_TEXTURE)
        for (size_t i = 0; i < sizeof slots / sizeof *slots; i++)
            slots[i]->texture = -1;
    if (without & EFFECT_NORMAL_MAP)
        m->normal_texture.texture = m->clearcoat_normal_texture.texture = -1;
    if (without & EFFECT_ALPHA)
        m->alpha_mode = ALPHA_OPAQUE;
    if (without & EFFECT_ABSORPTION)
        m->attenuation_distance = INFINITY;
    if (without & EFFECT_EMISSIVE_MESH)
        memset(m->emission, 0, sizeof m->emission);
    if (without & EFFECT_ANISOTROPY)
        m->anisotropy = 0;
    if (without & EFFECT_CLEARCOAT)
        m->clearcoat = 0;
    if (without & EFFECT_SHEEN)
        memset(m->sheen_color, 0, sizeof m->sheen_color);
    if (without & EFFECT_IRIDESCENCE)
        m->iridescence = 0;
    if (without & EFFECT_DIFFUSE_TRANSMISSION)
        m->diffuse_transmission = 0;
    if (without & EFFECT_DISPERSION)
        m->dispersion = 0;
    if (without & EFFECT_MEDIUM)
        m->medium = m->medium_outside = -1;
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

/* Lobes of a reflecting surface, by how rough it can be: a stretched mirror is rough along one
 * axis, where the mesh has tangents and the texture stretches it. */
static uint64_t by_roughness(const struct scene_material *m, uint64_t smooth, uint64_t rough)
{
    if (m->roughness < EFFECT_MIRROR_ROUGHNESS)
        return m->anisotropy > 0 ? smooth | rough : smooth;
    return has(&m->metallic_roughness_texture) ? smooth | rough : rough;
}

/* Is the material ever seen through (thin or refracting)? */
static int transmits(const struct scene_material *m)
{
    int all_metal = m->metallic == 1 && !has(&m->metallic_roughness_texture);

    return !m->unlit && m->transmission > 0 && !all_metal;
}

/* The extensions that lie over or change the base. */
static uint64_t layers(const struct scene_material *m)
{
    uint64_t set = 0;

    if (m->clearcoat > 0) {
        set |= EFFECT_CLEARCOAT;
        if (m->clearcoat_roughness < EFFECT_MIRROR_ROUGHNESS || has(&m->clearcoat_roughness_texture))
            set |= EFFECT_MIRROR;
        if (m->clearcoat_roughness >= EFFECT_MIRROR_ROUGHNESS)
            set |= EFFECT_GLOSSY;
    }
    if (!is_black(m->sheen_color))
        set |= EFFECT_SHEEN;
    if (m->iridescence > 0)
        set |= EFFECT_IRIDESCENCE;
    if (m->anisotropy > 0 && m->roughness < 1)
        set |= EFFECT_ANISOTROPY;
    if (m->diffuse_transmission > 0 && !is_black(m->diffuse_transmission_color))
        set |= EFFECT_DIFFUSE_TRANSMISSION;
    if (m->dispersion > 0 && transmits(m) && m->refractive)
        set |= EFFECT_DISPERSION;
    return set;
}

static uint64_t lobes(const struct scene_material *m)
{
    int textured_metal = has(&m->metallic_roughness_texture);
    int some_dielectric = m->metallic < 1 || textured_metal;
    int all_transmission = m->transmission == 1 && !has(&m->transmission_texture);
    uint64_t set = 0;

    if (m->kind == MATERIAL_INTERFACE)
        return EFFECT_INTERFACE;
    set |= layers(m);
    if (m->kind == MATERIAL_CONDUCTOR)
        return set | EFFECT_CONDUCTOR | by_roughness(m, EFFECT_MIRROR, EFFECT_GLOSSY);
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
    if (lit && (set & EFFECT_CLEARCOAT))
        any |= has(&m->clearcoat_texture) || has(&m->clearcoat_roughness_texture);
    if (lit && (set & EFFECT_SHEEN))
        any |= has(&m->sheen_color_texture) || has(&m->sheen_roughness_texture);
    if (lit && (set & EFFECT_IRIDESCENCE))
        any |= has(&m->iridescence_texture) || has(&m->iridescence_thickness_texture);
    if (lit && (set & EFFECT_DIFFUSE_TRANSMISSION))
        any |= has(&m->diffuse_transmission_texture) ||
               has(&m->diffuse_transmission_color_texture);
    if (lit && (set & EFFECT_ANISOTROPY))
        any |= has(&m->anisotropy_texture);
    if (lit && (set & EFFECT_CLEARCOAT) && has(&m->clearcoat_normal_texture) &&
        m->clearcoat_normal_scale != 0 && (s->mesh->arrays & MESH_TANGENTS)) {
        found |= EFFECT_NORMAL_MAP;
        any = 1;
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

/* ---- the frame ---------------------------------------------------------------------------- */

/* One search: the scene as the settings leave it. */
struct finder {
    const struct scene *scene;
    const struct render_settings *settings;
    struct effect_cause *causes;    /* or NULL */
    struct scene_camera eye;        /* at the shutter's opening */
    int eye_moves;
    uint64_t found;
    uint32_t mix_parts;             /* of the instance's material looked at so far */
    /* What is told already of each material and mesh, which many instances may use; NULL: not
     * kept (no causes are asked for, or no memory: then some are counted twice). */
    uint64_t *told_material, *told_mesh;
};

/* Mixes of mixes of mixes: behind so many parts everything is taken to be there. */
enum { MIX_PARTS_MAX = 1024 };

static void cause_add(struct effect_cause *cause, const char *kind, const char *name,
                      uint32_t index)
{
    if (cause->count == 0) {
        cause->kind = kind;
        cause->name = name;
        cause->index = index;
    } else if (cause->count <= EFFECT_CAUSES_ALSO) {
        cause->also[cause->count - 1] = (struct effect_caller){kind, name, index};
    }
    cause->count++;
}

static void add(struct finder *f, uint64_t set, const char *kind, const char *name, uint32_t index)
{
    uint64_t *told = strcmp(kind, "material") == 0 ? f->told_material
                     : strcmp(kind, "mesh") == 0   ? f->told_mesh : NULL;

    set &= ~f->settings->without;
    f->found |= set;
    if (!f->causes)
        return;
    if (told) {
        set &= ~told[index];
        told[index] |= set;
    }
    for (int i = 0; i < EFFECT_COUNT; i++)
        if (set >> i & 1)
            cause_add(&f->causes[i], kind, name, index);
}

/* Can a ray of this camera start inside the instance's box? Then it may meet the back of
 * a closed mesh first. */
static int camera_may_be_inside(const struct finder *f, uint32_t instance)
{
    const struct scene_instance *thing = &f->scene->instances[instance];
    double low[3], high[3];

    if (f->eye.kind == CAMERA_ORTHOGRAPHIC)
        return 1; /* rays start on a plane whose extent the job's aspect decides */
    if (f->eye_moves || thing->node >= 0 || thing->skin >= 0 ||
        !scene_instance_bounds(f->scene, instance, low, high))
        return 1;
    for (int i = 0; i < 3; i++) {
        double at = (double)f->eye.to_world.m[i][3];
        /* A box computed in double may be short by the rounding of the hit in float; and a
         * lens is as wide as it is. */
        double slack = 1e-4 * (high[i] - low[i]) + 1e-5 * fabs(at) + (double)f->eye.lens_radius;
        if (at < low[i] - slack || at > high[i] + slack)
            return 0;
    }
    return 1;
}

static int medium_acts(const struct scene_medium *m)
{
    return !is_black(m->absorption) || !is_black(m->scattering) || !is_black(m->emission);
}

static uint64_t medium_effects(const struct scene_medium *m)
{
    uint64_t set = EFFECT_MEDIUM;

    if (!medium_acts(m))
        return 0;
    if (m->has_grid)
        set |= EFFECT_MEDIUM_GRID;
    if (!is_black(m->emission))
        set |= EFFECT_MEDIUM_EMISSION;
    return set;
}

/* pbrt's rule: what fills the space before and behind a surface that separates two media. */
static uint64_t either_side(const struct scene *scene, const struct scene_material *m)
{
    uint64_t set = 0;

    if (m->medium == m->medium_outside)
        return 0;
    if (m->medium >= 0)
        set |= medium_effects(&scene->media[m->medium]);
    if (m->medium_outside >= 0)
        set |= medium_effects(&scene->media[m->medium_outside]);
    return set;
}

/* Does the material bound a volume that the path must keep count of? */
static int bounds_volume(const struct scene_material *m)
{
    return m->kind == MATERIAL_INTERFACE ||
           (m->kind == MATERIAL_SURFACE && transmits(m) && m->refractive);
}

static void find_material(struct finder *f, uint32_t instance, uint32_t index)
{
    const struct scene *scene = f->scene;
    struct scene_material m = scene->materials[index];
    const struct surface s = {&m, &scene->meshes[scene->instances[instance].mesh]};
    uint64_t set = 0;
    int invisible, alpha;

    scene_material_reduce(&m, f->settings->without);
    if (m.kind == MATERIAL_MIX) {
        add(f, EFFECT_MATERIAL_MIX | (has(&m.mix_texture) ? EFFECT_TEXTURE : 0), "material",
            m.name, index);
        if (++f->mix_parts > MIX_PARTS_MAX) {
            add(f, EFFECTS_ALL & ~(EFFECT_PANORAMA | EFFECT_ORTHOGRAPHIC | EFFECT_DEPTH_OF_FIELD),
                "material", m.name, index);
            return;
        }
        if (m.mix_amount < 1 || has(&m.mix_texture))
            find_material(f, instance, m.mix_material[0]);
        if (m.mix_amount > 0)
            find_material(f, instance, m.mix_material[1]);
        return;
    }
    alpha = alpha_acts(&s, &invisible);
    if (invisible) { /* no ray ever sees more of it than that it is not there */
        add(f, EFFECT_ALPHA, "material", m.name, index);
        return;
    }
    if (m.unlit) {
        set = EFFECT_UNLIT;
    } else {
        set = lobes(&m);
        if (!is_black(m.emission) && m.kind != MATERIAL_INTERFACE)
            set |= EFFECT_EMISSIVE_MESH;
    }
    set |= textures(&s, set, alpha);
    if (alpha)
        set |= EFFECT_ALPHA;
    if (set & (EFFECT_GLOSSY | EFFECT_ROUGH_DIELECTRIC))
        set |= EFFECT_MULTIPLE_SCATTERING;
    /* Refractive volumes have two sides by definition (KHR_materials_volume). */
    if (!m.double_sided && !bounds_volume(&m)) {
        int sealed = s.mesh->closed && !alpha && !transmits(&m) &&
                     !(set & EFFECT_DIFFUSE_TRANSMISSION);
        if (!sealed || camera_may_be_inside(f, instance))
            set |= EFFECT_CULLING;
    }
    if (bounds_volume(&m) && m.medium >= 0)
        set |= medium_effects(&scene->media[m.medium]);
    /* Volumes may overlap, with parts of their own too, or hold other things, or the camera: that
     * takes more than boxes to tell, so the path always counts them. */
    if (scene->volume_rule == VOLUMES_BOUNDARIES)
        set |= either_side(scene, &m);
    else if (m.kind == MATERIAL_SURFACE && bounds_volume(&m))
        set |= EFFECT_NESTED_DIELECTRIC;
    add(f, set, "material", m.name, index);
}

/* Is a mesh placed more than once? Meshes far apart in the table share a bit: in doubt, yes. */
static void find_instancing(struct finder *f)
{
    enum { SEEN_BITS = 1 << 16 };
    const struct scene *scene = f->scene;
    uint8_t seen[SEEN_BITS / 8] = {0};

    for (uint32_t i = 0; i < scene->instance_count; i++) {
        uint32_t mesh = scene->instances[i].mesh, bit = mesh % SEEN_BITS;
        if (seen[bit / 8] >> (bit % 8) & 1)
            add(f, EFFECT_INSTANCING, "mesh", scene->meshes[mesh].name, mesh);
        seen[bit / 8] |= (uint8_t)(1u << (bit % 8));
    }
}

static int node_differs(int32_t node, const struct scene_pose *a, const struct scene_pose *b)
{
    return node >= 0 && memcmp(&a->to_world[node], &b->to_world[node], sizeof *a->to_world) != 0;
}

/* Whatever stands elsewhere at this moment than at the shutter's opening. */
static void find_moved(struct finder *f, const struct scene_pose *open, const struct scene_pose *now)
{
    const struct scene *scene = f->scene;

    if (node_differs(f->eye.node, open, now))
        add(f, EFFECT_MOTION_BLUR, "camera", f->eye.name, f->settings->camera);
    for (uint32_t i = 0; i < scene->instance_count; i++)
        if (node_differs(scene->instances[i].node, open, now) && !scene_instance_deforms(scene, i))
            add(f, EFFECT_MOTION_BLUR, "instance", scene->instances[i].name, i);
    for (uint32_t i = 0; i < scene->light_count; i++)
        if (node_differs(scene->lights[i].node, open, now) &&
            !is_black(scene->lights[i].intensity) &&
            !(f->settings->without & EFFECT_PUNCTUAL_LIGHT))
            add(f, EFFECT_MOTION_BLUR, "light", scene->lights[i].name, i);
}

/* Does anything that is seen move while the shutter is open? The moments are not evenly spaced,
 * so that what turns round and round is not always met at the same place. */
static void find_motion(struct finder *f, uint32_t frame)
{
    static const double moments[] = {1, 0.5, 0.3125, 0.1875};
    const struct scene *scene = f->scene;
    struct scene_pose open = {0};
    double open_s, close_s;
    struct error ignored;

    for (uint32_t i = 0; i < scene->instance_count; i++)
        if (scene_instance_deforms(scene, i))
            add(f, EFFECT_DEFORMATION, "mesh", scene->meshes[scene->instances[i].mesh].name,
                scene->instances[i].mesh);
    scene_shutter(scene, f->settings, frame, &open_s, &close_s);
    if (scene->node_count == 0 || !(close_s > open_s))
        return;
    for (uint32_t i = 0; i < scene->instance_count; i++)
        if (scene_instance_deforms(scene, i))
            add(f, EFFECT_MOTION_BLUR, "instance", scene->instances[i].name, i);
    if (scene_pose_init(&open, scene, open_s, &ignored) != STATUS_OK) {
        add(f, EFFECT_MOTION_BLUR, "camera", f->eye.name, f->settings->camera);
        return;
    }
    for (size_t i = 0; i < sizeof moments / sizeof *moments; i++) {
        double time_s = open_s + moments[i] * (close_s - open_s);
        struct scene_pose now = {0};
        if (i > 0 && (f->found & EFFECT_MOTION_BLUR))
            break;
        if (scene_pose_init(&now, scene, time_s, &ignored) == STATUS_OK)
            find_moved(f, &open, &now);
        else
            add(f, EFFECT_MOTION_BLUR, "camera", f->eye.name, f->settings->camera);
        scene_pose_release(&now);
    }
    scene_pose_release(&open);
}

static void find_lights(struct finder *f)
{
    const struct scene *scene = f->scene;
    const struct scene_environment *env = &scene->environment;

    for (uint32_t i = 0; i < scene->light_count; i++)
        if (!is_black(scene->lights[i].intensity)) {
            add(f, EFFECT_PUNCTUAL_LIGHT, "light", scene->lights[i].name, i);
            if (scene->lights[i].image >= 0)
                add(f, EFFECT_LIGHT_IMAGE, "light", scene->lights[i].name, i);
        }
    if (!env->present || is_black(env->radiance) || f->settings->env_strength == 0)
        return;
    add(f, EFFECT_ENVIRONMENT, "environment", env->constant ? "constant" : env->image.name, 0);
    if (env->portal_count > 0 && !(f->settings->without & EFFECT_ENVIRONMENT))
        add(f, EFFECT_PORTAL, "environment", env->constant ? "constant" : env->image.name, 0);
}

static void find_camera(struct finder *f, uint32_t frame)
{
    const struct scene *scene = f->scene;
    uint32_t camera = f->settings->camera < scene->camera_count ? f->settings->camera : 0;
    const struct render_settings *settings = f->settings;
    float lens;

    (void)frame;
    f->eye = scene->cameras[camera];
    f->eye_moves = f->eye.node >= 0;
    lens = settings->lens_radius >= 0 ? settings->lens_radius : f->eye.lens_radius;
    f->eye.lens_radius = lens;
    if (f->eye.kind == CAMERA_ORTHOGRAPHIC)
        add(f, EFFECT_ORTHOGRAPHIC, "camera", f->eye.name, camera);
    if (f->eye.kind == CAMERA_PANORAMA)
        add(f, EFFECT_PANORAMA, "camera", f->eye.name, camera);
    else if (lens > 0)
        add(f, EFFECT_DEPTH_OF_FIELD, "camera", f->eye.name, camera);
}

uint64_t scene_effects(const struct scene *scene, const struct render_settings *settings,
                       uint32_t frame, struct effect_cause *causes)
{
    struct finder f = {.scene = scene, .settings = settings, .causes = causes};
    uint64_t scatters, mirrors, shines;

    if (causes) {
        memset(causes, 0, EFFECT_COUNT * sizeof *causes);
        f.told_material = mem_calloc(scene->material_count, sizeof *f.told_material);
        f.told_mesh = mem_calloc(scene->mesh_count, sizeof *f.told_mesh);
    }
    find_camera(&f, frame);
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        f.mix_parts = 0;
        find_material(&f, i, scene->instances[i].material);
    }
    if (scene->fog >= 0 && !(settings->without & (EFFECT_FOG | EFFECT_MEDIUM)) &&
        medium_acts(&scene->media[scene->fog]))
        add(&f, EFFECT_FOG | medium_effects(&scene->media[scene->fog]), "medium",
            scene->media[scene->fog].name, (uint32_t)scene->fog);
    find_lights(&f);
    find_instancing(&f);
    find_motion(&f, frame);
    scatters = EFFECT_DIFFUSE | EFFECT_GLOSSY | EFFECT_ROUGH_DIELECTRIC | EFFECT_SHEEN |
               EFFECT_DIFFUSE_TRANSMISSION | EFFECT_MEDIUM;
    mirrors = EFFECT_MIRROR | EFFECT_DIELECTRIC | EFFECT_THIN_TRANSMISSION;
    shines = EFFECT_EMISSIVE_MESH | EFFECT_ENVIRONMENT;
    if ((f.found & scatters) && (f.found & mirrors) && (f.found & shines))
        add(&f, EFFECT_CAUSTICS, "scene", scene->name, 0);
    mem_free(f.told_material);
    mem_free(f.told_mesh);
    return f.found;
}

uint64_t scene_effects_default(const struct scene *scene, uint32_t camera)
{
    struct render_settings settings;

    render_settings_default(&settings);
    settings.camera = camera;
    return scene_effects(scene, &settings, 0, NULL);
}
