#include "common/scene/scene_effects.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/scene/effects_material.h"
#include "common/scene/move.h"
#include "common/scene/pose.h"
#include "common/scene/settings.h"
#include "common/scene/track.h"

/* ---- the frame ---------------------------------------------------------------------------- */

/* One search: the scene after the settings have been applied. */
struct finder {
    const struct scene *scene;
    const struct render_settings *settings;
    struct effect_cause *causes; /* or NULL */
    struct scene_camera eye;     /* at the shutter's opening */
    int eye_moves;
    uint64_t found;
    uint32_t mix_parts; /* of the instance's material, checked so far */
    /* Effects of which a material or mesh is already a cause: many instances may use it. NULL: not
     * kept (the caller wants no causes, or memory is short: some are then counted twice). */
    uint64_t *named_material, *named_mesh;
    int last_known; /* effects_on_mesh */
    uint32_t last_material, last_mesh;
    struct material_effects last;
};

/* Nested mixes: beyond this many parts everything is assumed to be present. */
enum { MIX_PARTS_MAX = 1024 };

static void cause_add(struct effect_cause *cause, const char *kind, const char *name, uint32_t index)
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
    uint64_t *named = strcmp(kind, "material") == 0 ? f->named_material
                     : strcmp(kind, "mesh") == 0   ? f->named_mesh : NULL;

    set &= ~f->settings->without;
    f->found |= set;
    if (!f->causes)
        return;
    if (named) {
        set &= ~named[index];
        named[index] |= set;
    }
    for (int i = 0; i < EFFECT_COUNT; i++)
        if (set >> i & 1)
            cause_add(&f->causes[i], kind, name, index);
}

/* Can a ray of this camera start inside the instance's box? If so, it may meet the back of a closed mesh first. */
static int camera_may_be_inside(const struct finder *f, uint32_t instance)
{
    const struct scene_instance *thing = &f->scene->instances[instance];
    double low[3], high[3];

    if (f->eye.kind == CAMERA_ORTHOGRAPHIC)
        return 1; /* rays start on a plane whose extent depends on the job's aspect ratio */
    if (f->eye_moves || thing->node >= 0 || thing->skin >= 0 || !scene_instance_bounds(f->scene, instance, low, high))
        return 1;
    for (int i = 0; i < 3; i++) {
        double at = (double)f->eye.to_world.m[i][3];
        /* A box computed in double may be too small by the rounding of the hit in float; and the
         * lens has its own width. */
        double slack = 1e-4 * (high[i] - low[i]) + 1e-5 * fabs(at) + (double)f->eye.lens_radius;
        if (at < low[i] - slack || at > high[i] + slack)
            return 0;
    }
    return 1;
}

static int medium_acts(const struct scene_medium *m)
{
    return !scene_color_is(m->absorption, 0) || !scene_color_is(m->scattering, 0) || !scene_color_is(m->emission, 0);
}

static uint64_t medium_effects(const struct scene_medium *m)
{
    uint64_t set = EFFECT_MEDIUM;

    if (!medium_acts(m))
        return 0;
    if (m->has_grid)
        set |= EFFECT_MEDIUM_GRID;
    if (!scene_color_is(m->emission, 0))
        set |= EFFECT_MEDIUM_EMISSION;
    return set;
}

/* pbrt's rule for what fills the space before and behind a surface that separates two media. */
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

static void find_material(struct finder *f, uint32_t instance, uint32_t index);

static void find_mix(struct finder *f, uint32_t instance, uint32_t index, const struct scene_material *m)
{
    int textured = m->mix_texture.texture >= 0;

    add(f, EFFECT_MATERIAL_MIX | (textured ? EFFECT_TEXTURE : 0), "material", m->name, index);
    if (++f->mix_parts > MIX_PARTS_MAX) {
        add(f, EFFECTS_ALL & ~(EFFECT_PANORAMA | EFFECT_ORTHOGRAPHIC | EFFECT_DEPTH_OF_FIELD), "material", m->name,
            index);
        return;
    }
    if (m->mix_amount < 1 || textured)
        find_material(f, instance, m->mix_material[0]);
    if (m->mix_amount > 0)
        find_material(f, instance, m->mix_material[1]);
}

/* Are the material's back faces ever met and passed? Refractive volumes have two sides by
 * definition (KHR_materials_volume). */
static int culls(const struct finder *f, uint32_t instance, const struct scene_material *m,
                 const struct material_effects *what)
{
    int open = !f->scene->meshes[f->scene->instances[instance].mesh].closed || what->transmits ||
               (what->set & (EFFECT_ALPHA | EFFECT_DIFFUSE_TRANSMISSION));

    return !m->double_sided && !what->bounds_volume && (open || camera_may_be_inside(f, instance));
}

/* Successive instances often share material and mesh: the result is kept for the next. */
static struct material_effects effects_on_mesh(struct finder *f, const struct scene_material *m, uint32_t material,
                                               uint32_t mesh)
{
    if (!f->last_known || f->last_material != material || f->last_mesh != mesh)
        effects_of_material(m, &f->scene->meshes[mesh], &f->last);
    f->last_known = 1;
    f->last_material = material;
    f->last_mesh = mesh;
    return f->last;
}

static void find_material(struct finder *f, uint32_t instance, uint32_t index)
{
    const struct scene *scene = f->scene;
    struct scene_material m = scene->materials[index];
    struct material_effects what;

    scene_material_reduce(&m, f->settings->without);
    if (m.kind == MATERIAL_MIX) {
        find_mix(f, instance, index, &m);
        return;
    }
    what = effects_on_mesh(f, &m, index, scene->instances[instance].mesh);
    if (!what.invisible) {
        if (culls(f, instance, &m, &what))
            what.set |= EFFECT_CULLING;
        if (what.bounds_volume && m.medium >= 0)
            what.set |= medium_effects(&scene->media[m.medium]);
        /* Volumes may overlap, also with parts of their own, or contain other objects, or the
         * camera. Boxes cannot decide that, so the path always counts them. */
        if (scene->volume_rule == VOLUMES_BOUNDARIES)
            what.set |= either_side(scene, &m);
        else if (m.kind == MATERIAL_SURFACE && what.bounds_volume)
            what.set |= EFFECT_NESTED_DIELECTRIC;
    }
    add(f, what.set, "material", m.name, index);
}

/* Is a mesh placed more than once? Meshes far apart in the table share a bit: if in doubt, yes. */
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

/* Everything whose position now differs from that at the shutter's opening. */
static void find_moved(struct finder *f, const struct scene_pose *open, const struct scene_pose *now)
{
    const struct scene *scene = f->scene;

    if (node_differs(f->eye.node, open, now))
        add(f, EFFECT_MOTION_BLUR, "camera", f->eye.name, f->settings->camera);
    for (uint32_t i = 0; i < scene->instance_count; i++)
        if (node_differs(scene->instances[i].node, open, now) && !scene_instance_deforms(scene, i))
            add(f, EFFECT_MOTION_BLUR, "instance", scene->instances[i].name, i);
    for (uint32_t i = 0; i < scene->light_count; i++)
        if (node_differs(scene->lights[i].node, open, now) && !scene_color_is(scene->lights[i].intensity, 0) &&
            !(f->settings->without & EFFECT_PUNCTUAL_LIGHT))
            add(f, EFFECT_MOTION_BLUR, "light", scene->lights[i].name, i);
}

/* Does anything visible move while the shutter is open? The moments are not evenly spaced, so that
 * a rotating object is not always caught in the same position. */
static void find_motion(struct finder *f, uint32_t frame)
{
    static const double moments[] = {1, 0.5, 0.3125, 0.1875};
    const struct scene *scene = f->scene;
    struct scene_pose open = {0};
    double open_s, close_s;
    struct error ignored;

    for (uint32_t i = 0; i < scene->instance_count; i++)
        if (scene_instance_deforms(scene, i))
            add(f, EFFECT_DEFORMATION, "mesh", scene->meshes[scene->instances[i].mesh].name, scene->instances[i].mesh);
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
        if (!scene_color_is(scene->lights[i].intensity, 0)) {
            add(f, EFFECT_PUNCTUAL_LIGHT, "light", scene->lights[i].name, i);
            if (scene->lights[i].image >= 0)
                add(f, EFFECT_LIGHT_IMAGE, "light", scene->lights[i].name, i);
        }
    if (!env->present || scene_color_is(env->radiance, 0) || f->settings->env_strength == 0)
        return;
    add(f, EFFECT_ENVIRONMENT, "environment", env->constant ? "constant" : env->image.name, 0);
    if (env->portal_count > 0 && !(f->settings->without & EFFECT_ENVIRONMENT))
        add(f, EFFECT_PORTAL, "environment", env->constant ? "constant" : env->image.name, 0);
}

static void find_camera(struct finder *f, uint32_t frame UNUSED)
{
    const struct scene *scene = f->scene;
    uint32_t camera = f->settings->camera < scene->camera_count ? f->settings->camera : 0;
    const struct render_settings *settings = f->settings;
    float lens;

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

static uint64_t find_effects(const struct scene *scene, const struct render_settings *settings, uint32_t frame,
                             struct effect_cause *causes)
{
    struct finder f = {.scene = scene, .settings = settings, .causes = causes};
    uint64_t scatters, mirrors, shines;

    if (causes) {
        memset(causes, 0, EFFECT_COUNT * sizeof *causes);
        f.named_material = mem_calloc(scene->material_count, sizeof *f.named_material);
        f.named_mesh = mem_calloc(scene->mesh_count, sizeof *f.named_mesh);
    }
    find_camera(&f, frame);
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        f.mix_parts = 0;
        find_material(&f, i, scene->instances[i].material);
    }
    if (scene->fog >= 0 && !(settings->without & (EFFECT_FOG | EFFECT_MEDIUM)) &&
        medium_acts(&scene->media[scene->fog]))
        add(&f, EFFECT_FOG | medium_effects(&scene->media[scene->fog]), "medium", scene->media[scene->fog].name,
            (uint32_t)scene->fog);
    find_lights(&f);
    find_instancing(&f);
    find_motion(&f, frame);
    scatters = EFFECT_DIFFUSE | EFFECT_GLOSSY | EFFECT_ROUGH_DIELECTRIC | EFFECT_SHEEN | EFFECT_DIFFUSE_TRANSMISSION |
               EFFECT_MEDIUM;
    mirrors = EFFECT_MIRROR | EFFECT_DIELECTRIC | EFFECT_THIN_TRANSMISSION;
    shines = EFFECT_EMISSIVE_MESH | EFFECT_ENVIRONMENT | EFFECT_PUNCTUAL_LIGHT;
    if ((f.found & scatters) && (f.found & mirrors) && (f.found & shines))
        add(&f, EFFECT_CAUSTICS, "scene", scene->name, 0);
    mem_free(f.named_material);
    mem_free(f.named_mesh);
    return f.found;
}

uint64_t scene_effects(const struct scene *scene, const struct render_settings *settings, uint32_t frame,
                       struct effect_cause *causes)
{
    struct error ignored;
    struct scene at;
    uint64_t found;

    if (scene_at_frame(&at, scene, settings, frame, &ignored) == STATUS_OK)
        found = find_effects(&at, settings, frame, causes);
    else
        found = find_effects(scene, settings, frame, causes); /* of the largest keys */
    scene_copy_release(&at);
    return found;
}

uint64_t scene_effects_default(const struct scene *scene, uint32_t camera)
{
    struct render_settings settings;

    render_settings_default(&settings);
    settings.camera = camera;
    return scene_effects(scene, &settings, 0, NULL);
}
