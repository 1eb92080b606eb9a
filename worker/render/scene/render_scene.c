/* world: builds a render_scene from the scene description and its blobs. */
#include "worker/render/render_scene.h"

#include <math.h>
#include <stdatomic.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "common/scene/move.h"
#include "common/scene/scene_effects.h"
#include "common/scene/pose.h"
#include "common/scene/sight.h"
#include "common/scene/track.h"
#include "worker/render/base/bounds.h"
#include "worker/render/caustic/casters.h"
#include "worker/render/scene/image_share.h"
#include "worker/render/path/caustic_pilot.h"
#include "worker/render/path/enclosure.h"
#include "worker/render/path/interior.h"
#include "worker/render/path/kernel.h"
#include "worker/render/path/light_pilot.h"
#include "worker/render/medium/medium.h"
#include "worker/render/scene/render_material.h"
#include "worker/render/scene/render_memory.h"
#include "worker/render/scene/render_place.h"
#include "worker/render/scene/render_shape.h"
#include "worker/render/scene/render_touch.h"

static status mesh_init(struct render_mesh *out, const struct scene_mesh *mesh, const uint8_t *data, size_t size_bytes,
                        struct error *err)
{
    struct scene_mesh_layout layout;
    size_t index_count = 3 * (size_t)mesh->triangle_count;

    scene_mesh_layout(mesh, &layout);
    if (size_bytes != layout.total_bytes)
        return error_set(err, STATUS_ERR_INPUT,
                         "mesh '%s': its blob holds %zu bytes, %zu are needed: the scene is "
                         "damaged, import it again",
                         mesh->name, size_bytes, layout.total_bytes);
    out->blob = data;
    out->vertex_count = mesh->vertex_count;
    out->triangle_count = mesh->triangle_count;
#define ARRAY(field, offset) \
    out->field = (offset) == SIZE_MAX ? NULL : (const void *)(data + (offset))
    ARRAY(positions, layout.positions);
    ARRAY(normals, layout.normals);
    ARRAY(tangents, layout.tangents);
    ARRAY(uv[0], layout.uv0);
    ARRAY(uv[1], layout.uv1);
    ARRAY(colors, layout.colors);
    ARRAY(indices, layout.indices);
#undef ARRAY
    for (size_t i = 0; i < index_count; i++)
        if (out->indices[i] >= mesh->vertex_count)
            return error_set(err, STATUS_ERR_INPUT,
                             "mesh '%s': triangle %zu uses vertex %u of %u: the scene is damaged, "
                             "import it again",
                             mesh->name, i / 3, out->indices[i], mesh->vertex_count);
    for (size_t i = 0; i < 3 * (size_t)mesh->vertex_count; i++)
        if (!isfinite(out->positions[i]))
            return error_set(err, STATUS_ERR_INPUT, "mesh '%s': vertex %zu is not finite", mesh->name, i / 3);
    return STATUS_OK;
}

static status load_meshes(struct render_scene *w, const struct scene *scene, struct blob_source blobs,
                          struct error *err)
{
    w->meshes = mem_calloc(scene->mesh_count, sizeof *w->meshes);
    NEED(w->meshes, err, "the meshes");
    w->mesh_count = scene->mesh_count;
    for (uint32_t i = 0; i < scene->mesh_count; i++) {
        const uint8_t *data;
        size_t size_bytes;
        status s = blobs.get(blobs.user, &scene->meshes[i].blob.digest, &data, &size_bytes, err);
        if (s == STATUS_OK)
            s = mesh_init(&w->meshes[i], &scene->meshes[i], data, size_bytes, err);
        if (s != STATUS_OK)
            return s;
        if (w->settings.without & EFFECT_VERTEX_COLOR)
            w->meshes[i].colors = NULL;
        w->info.mesh_bytes += size_bytes;
    }
    return STATUS_OK;
}

static status load_environment(struct render_scene *w, const struct scene *scene, struct blob_source blobs,
                               struct error *err)
{
    const struct scene_environment *e = &scene->environment;
    const struct render_settings *settings = &w->settings;
    struct image_repairs repairs = {0};
    struct image map = {0};
    const uint8_t *data;
    size_t size_bytes;
    status s;

    if (!e->present || (settings->without & EFFECT_ENVIRONMENT))
        return STATUS_OK;
    if (e->constant)
        return environment_new_constant(&w->environment,
                                        vec3_scale(vec3_make(e->radiance[0], e->radiance[1], e->radiance[2]),
                                                   settings->env_strength),
                                        settings->env_sampling, err);
    s = blobs.get(blobs.user, &e->image.blob.digest, &data, &size_bytes, err);
    if (s != STATUS_OK)
        return s;
    TRY(image_decode_hdr(&map, data, size_bytes, e->image.name, &repairs, err));
    s = environment_new(&w->environment, &map, e->to_map, settings->env_rotate_deg,
                        vec3_scale(vec3_make(e->radiance[0], e->radiance[1], e->radiance[2]), settings->env_strength),
                        settings->env_sampling, err);
    if (s == STATUS_OK)
        w->info.texture_bytes += environment_bytes(w->environment);
    return s;
}

/* Create the media that are used; the others stay NULL. */
static status load_media(struct render_scene *w, const struct scene *scene, const struct render_used *used,
                         struct blob_source blobs, struct error *err)
{
    w->fog = w->settings.without & (EFFECT_FOG | EFFECT_MEDIUM) ? -1 : scene->fog;
    w->media = mem_calloc(scene->medium_count, sizeof *w->media);
    NEED(w->media, err, "the media");
    w->medium_count = scene->medium_count;
    for (uint32_t i = 0; i < scene->medium_count; i++) {
        struct scene_medium medium = scene->media[i];
        const uint8_t *grid = NULL;
        size_t size_bytes = 0, needed = sizeof(float32);
        status s = STATUS_OK;
        if (!used->media[i])
            continue;
        if (w->settings.without & EFFECT_MEDIUM_EMISSION)
            memset(medium.emission, 0, sizeof medium.emission);
        for (int a = 0; a < 3; a++)
            needed *= medium.grid_size[a]; /* each at most SCENE_GRID_SIDE_MAX */
        if (medium.has_grid)
            s = blobs.get(blobs.user, &medium.grid.digest, &grid, &size_bytes, err);
        if (s == STATUS_OK && medium.has_grid && size_bytes != needed)
            s = error_set(err, STATUS_ERR_INPUT,
                          "medium '%s': its grid's blob holds %zu bytes, %zu are needed: the scene "
                          "is damaged, import it again",
                          medium.name, size_bytes, needed);
        if (s == STATUS_OK)
            s = medium_new(&w->media[i], &medium, grid, err);
        if (s != STATUS_OK)
            return s;
        w->info.texture_bytes += medium_bytes(w->media[i]) + size_bytes;
    }
    return STATUS_OK;
}

/* Ritter's sphere around the corners of every instance's box, at every moment of the shutter. The
 * boxes are known without reading the vertices. */
/* A box around the corners, grown by a thousandth of its diagonal. Where there are many boundaries
 * the last box holds the rest. */
static void add_boundary(struct render_scene *w, const struct vec3 *corners, size_t count)
{
    struct render_box *box;
    struct vec3 low = vec3_splat(INFINITY), high = vec3_splat(-INFINITY);
    real margin;

    for (size_t i = 0; i < count; i++) {
        low = vec3_make(real_min(corners[i].x, low.x), real_min(corners[i].y, low.y), real_min(corners[i].z, low.z));
        high =
            vec3_make(real_max(corners[i].x, high.x), real_max(corners[i].y, high.y), real_max(corners[i].z, high.z));
    }
    margin = REAL(1e-3) * vec3_length(vec3_sub(high, low)) +
             0x1p-12f * real_max(real_max(real_abs(vec3_max(high)), real_abs(vec3_min(high))),
                                 real_max(real_abs(vec3_max(low)), real_abs(vec3_min(low))));
    if (w->boundaries.count < RENDER_BOXES_MAX) {
        box = &w->boundaries.box[w->boundaries.count++];
        *box = (struct render_box){{INFINITY, INFINITY, INFINITY},
                                  {-INFINITY, -INFINITY, -INFINITY}};
    } else {
        box = &w->boundaries.box[RENDER_BOXES_MAX - 1];
    }
    box->low[0] = real_min(low.x - margin, box->low[0]);
    box->low[1] = real_min(low.y - margin, box->low[1]);
    box->low[2] = real_min(low.z - margin, box->low[2]);
    box->high[0] = real_max(high.x + margin, box->high[0]);
    box->high[1] = real_max(high.y + margin, box->high[1]);
    box->high[2] = real_max(high.z + margin, box->high[2]);
}

/* Around each shape, or each mesh, that bounds a volume. `corners`: room for an instance's. */
static void add_boundaries(struct render_scene *w, const struct scene *scene, int shapes, struct vec3 *corners)
{
    for (uint32_t i = 0; i < w->instance_count; i++) {
        const struct render_material *material = &w->materials[w->instances[i].material];

        if ((w->instances[i].shape != NULL) == shapes &&
            (material->flags & MATERIAL_BOUNDS || material->m.kind == MATERIAL_MIX))
            add_boundary(w, corners, place_hull(w, scene, i, corners));
    }
}

static status find_bounds(struct render_scene *w, const struct scene *scene, struct error *err)
{
    size_t count = 0, room = 0;
    struct vec3 *corners;
    struct sphere sphere;

    for (uint32_t i = 0; i < w->instance_count; i++)
        room += 8 * (size_t)(w->instances[i].motion_steps ? w->instances[i].motion_steps : 1);
    corners = mem_alloc_array(room, sizeof *corners);
    NEED(corners, err, "the bounding sphere");
    add_boundaries(w, scene, 0, corners);
    add_boundaries(w, scene, 1, corners);
    for (uint32_t i = 0; i < w->instance_count; i++)
        count += place_hull(w, scene, i, corners + count);
    sphere = sphere_around(corners, count);
    w->bounds_centre = sphere.centre;
    w->bounds_radius = sphere.radius > 0 && isfinite(sphere.radius) ? sphere.radius : 1;
    mem_free(corners);
    return STATUS_OK;
}

/* The sphere that fog fills contains all positions from which a camera ray may start. */
static void find_fog(struct render_scene *w)
{
    const struct camera *camera = &w->camera;
    uint32_t steps = camera->motion_steps ? camera->motion_steps : 1;
    real reach = camera->lens_radius;

    if (camera->kind == CAMERA_ORTHOGRAPHIC)
        reach += camera->half_width + camera->half_height;
    w->fog_radius = w->bounds_radius;
    for (uint32_t k = 0; k < steps; k++) {
        const struct transform *view = camera->motion_steps ? &camera->motion[k] : &camera->to_world;
        struct vec3 eye = {view->m[0][3], view->m[1][3], view->m[2][3]};
        real distance = vec3_length(vec3_sub(eye, w->bounds_centre)) + reach;
        w->fog_radius = real_max(w->fog_radius, distance * (1 + REAL(1e-5)));
    }
}

/* Can a ray meet a back face of the mesh first? On a closed mesh only if rays start inside: at the
 * camera, or behind a wall that lets them through. If in doubt, and for all that moves, yes. */
static int culling_shows(const struct render_scene *w, const struct scene *scene,
                         const struct render_instance *instance)
{
    const struct scene_mesh *mesh = &scene->meshes[instance->mesh];
    const struct render_material *material = &w->materials[instance->material];
    struct vec3 eye;
    real at[3];

    if (!mesh->closed || instance->motion_steps || instance->bounded || w->camera.motion_steps ||
        w->camera.kind == CAMERA_ORTHOGRAPHIC || (material->flags & MATERIAL_TWO_WAY) || material->m.transmission > 0 ||
        material->m.kind == MATERIAL_MIX)
        return 1;
    eye = transform_point(&w->camera.to_world, vec3_make(0, 0, 0));
    eye = transform_point(&instance->to_object, eye);
    at[0] = eye.x;
    at[1] = eye.y;
    at[2] = eye.z;
    for (int a = 0; a < 3; a++) {
        const real *row = instance->to_object.m[a];
        real lens = w->camera.lens_radius * vec3_length(vec3_make(row[0], row[1], row[2]));
        if (at[a] < mesh->bounds_min[a] - lens || at[a] > mesh->bounds_max[a] + lens)
            return 0;
    }
    return 1;
}

/* Closed together with other meshes, which have not moved since the import found that. */
static int is_sealed(const struct render_instance *instance, const struct scene *scene, uint32_t i)
{
    return scene->instances[i].sealed && !instance->motion_steps && !instance->bounded;
}

/* Rays get behind the faces of a closed mesh where its material lets them through, and get out only
 * through it again. (Around the camera: enclosure.h.) */
static void find_enclosing(struct render_scene *w, const struct scene *scene)
{
    for (uint32_t i = 0; i < w->instance_count; i++) {
        struct render_instance *instance = &w->instances[i];
        unsigned flags = w->materials[instance->material].flags;

        instance->encloses = (scene->meshes[instance->mesh].closed || is_sealed(instance, scene, i)) &&
                             (flags & (MATERIAL_BOUNDS | MATERIAL_TWO_WAY)) &&
                             !(flags & (MATERIAL_ALPHA | MATERIAL_CULLED));
        if (instance->encloses)
            w->materials[instance->body].flags |= MATERIAL_ENCLOSES;
    }
    for (uint32_t i = 0; i < w->instance_count; i++)
        if (!w->instances[i].encloses)
            w->materials[w->instances[i].body].flags &= ~(unsigned)MATERIAL_ENCLOSES;
    /* One open part opens the whole body. */
    for (uint32_t i = 0; i < w->instance_count; i++)
        if (!scene->meshes[w->instances[i].mesh].closed)
            w->instances[i].encloses &= (w->materials[w->instances[i].body].flags & MATERIAL_ENCLOSES) != 0;
}

static status build_accel(struct render_scene *w, const struct scene *scene, struct error *err)
{
    /* One more: without triangles, for shapes. */
    struct accel_mesh *meshes = mem_calloc((size_t)w->mesh_count + 1, sizeof *meshes);
    struct accel_instance *instances = mem_calloc(w->instance_count, sizeof *instances);
    struct accel_input input = {meshes, instances, w->mesh_count + 1, w->instance_count, w->settings.isa,
                                w->kernel->accept, triangle_exact_corners, w,
                                w->settings.bvh_quality, w->settings.not_robust, w->digits,
                                w->build_threads};
    status s;

    if (!meshes || !instances) {
        s = error_no_memory(err, "the ray accelerator");
        goto done;
    }
    for (uint32_t i = 0; i < w->mesh_count; i++) {
        meshes[i].positions = w->meshes[i].positions;
        meshes[i].indices = w->meshes[i].indices;
        meshes[i].vertex_count = w->meshes[i].vertex_count;
        meshes[i].triangle_count = w->meshes[i].triangle_count;
    }
    for (uint32_t i = 0; i < w->instance_count; i++) {
        const struct render_instance *instance = &w->instances[i];
        const struct render_material *material = &w->materials[instance->material];
        instances[i] = (struct accel_instance){
            .mesh = instance->mesh,
            .instance_positions = instance->instance_positions,
            .to_world = instance->to_world,
            .filtered = (material->flags & MATERIAL_ALPHA) != 0 ||
                        ((material->flags & MATERIAL_CULLED) && culling_shows(w, scene, instance)),
            .motion_steps = instance->motion_steps,
            .motion_positions = instance->motion_positions,
            .motion_to_world = instance->motion_to_world,
        };
        shape_give(w, instance, &instances[i]);
    }
    s = accel_new(&w->accel, &input, err);
    if (s == STATUS_OK)
        w->info.bvh_bytes = accel_bytes(w->accel);
done:
    mem_free(meshes);
    mem_free(instances);
    return s;
}

static uint32_t lights_wanted(const struct render_scene *w, const struct scene *scene)
{
    return w->settings.without & EFFECT_PUNCTUAL_LIGHT ? 0 : scene->light_count;
}

static int lights_move(const struct render_scene *w, const struct render_poses *poses)
{
    struct punctual_pose steps[RENDER_STEPS_MAX];

    for (uint32_t i = 0; i < lights_wanted(w, poses->scene); i++)
        if (poses_light_motion(poses, i, steps))
            return 1;
    return 0;
}

static status load_light_motion(struct render_scene *w, const struct render_poses *poses, uint32_t light,
                                struct punctual_motion *out, struct error *err)
{
    struct punctual_pose steps[RENDER_STEPS_MAX];
    void *kept;

    out->steps = poses_light_motion(poses, light, steps);
    if (!out->steps)
        return STATUS_OK;
    kept = mem_memdup(steps, out->steps * sizeof *steps);
    NEED(render_scene_own(w, kept), err, "the lights");
    out->at = kept;
    return STATUS_OK;
}

static status load_lights(struct render_scene *w, const struct scene *scene, const struct render_poses *poses,
                          struct error *err)
{
    uint32_t count = lights_wanted(w, scene);
    struct scene_light *lights = mem_calloc(count, sizeof *lights);
    struct punctual_motion *motion = mem_calloc(count, sizeof *motion);
    status s = lights && motion ? STATUS_OK : error_no_memory(err, "the lights");

    for (uint32_t i = 0; i < count && s == STATUS_OK; i++) {
        poses_light(poses, i, &lights[i]);
        if (w->settings.without & EFFECT_LIGHT_IMAGE)
            lights[i].image = -1;
        s = load_light_motion(w, poses, i, &motion[i], err);
    }
    if (s == STATUS_OK)
        s = emitters_init(
            &w->emitters, w, lights, motion, count, scene->environment.portals,
            w->environment && !(w->settings.without & EFFECT_PORTAL) ? scene->environment.portal_count : 0, err);
    mem_free(lights);
    mem_free(motion);
    return s;
}

/* The camera, and what is known only when everything is placed. */
static void load_camera(struct render_scene *w, const struct render_poses *poses)
{
    struct transform steps[CAMERA_STEPS_MAX];
    struct scene_camera description;
    struct camera_motion motion;

    poses_camera(poses, w->settings.camera, &description, steps, &motion);
    /* What is animated need not move during this frame: then no ray needs a time. */
    motion.shutter_open &= motion.steps > 0 || place_moves(w) || lights_move(w, poses);
    camera_init(&w->camera, &description, &w->settings, &motion);
    w->effects &= ~EFFECT_MOTION_BLUR;
    if (motion.shutter_open)
        w->effects |= EFFECT_MOTION_BLUR;
    for (uint32_t i = 0; i < w->instance_count; i++)
        if (w->instances[i].deformed_normals || w->instances[i].deformed_tangents)
            w->effects |= EFFECT_DEFORMATION;
}

/* Coarser digits than those at so many times the distance of what is seen do not matter to faces in contact. */
#define DIGITS_REACH 16.0

static _Thread_local unsigned build_threads = 1;

void render_build_threads(unsigned threads) { build_threads = threads; }

static _Atomic(int) origin_kept;

void render_keep_origin(int on) { atomic_store(&origin_kept, on); }

/* The frame's own origin of coordinates. */
static status choose_origin(struct render_scene *w, const struct scene *scene, struct blob_source blobs,
                            struct error *err)
{
    const struct render_settings *settings = &w->settings;
    const double width = settings_whole_width(settings), height = settings_whole_height(settings);
    const struct scene_blob_reader reader = {blobs.get, blobs.user};
    struct scene_sight *sight = NULL;
    struct scene_pose pose;
    double open_s, close_s;
    status s;

    if (atomic_load(&origin_kept))
        return STATUS_OK;
    scene_shutter(scene, settings, w->frame, &open_s, &close_s);
    s = scene_pose_init(&pose, scene, open_s, err);
    if (s == STATUS_OK)
        s = scene_sight_new(&sight, scene, &pose, settings->camera, width / height, reader, err);
    if (s == STATUS_OK)
        w->digits.reach = DIGITS_REACH * scene_sight_origin(sight, w->digits.origin);
    scene_sight_free(sight);
    scene_pose_release(&pose);
    return s;
}

static status build(struct render_scene *w, const struct scene *scene, const struct render_used *used,
                    struct blob_source blobs, struct error *err)
{
    struct render_poses *poses = NULL;
    struct render_need need;
    status s;

    if ((s = need_of(&need, scene, &w->settings, used, blobs, err)) == STATUS_OK &&
        (s = need_check(&need, err)) == STATUS_OK && (s = load_meshes(w, scene, blobs, err)) == STATUS_OK &&
        (s = images_load(w, scene, used, blobs, err)) == STATUS_OK &&
        (s = materials_load(w, scene, err)) == STATUS_OK && (s = load_media(w, scene, used, blobs, err)) == STATUS_OK &&
        (s = poses_new(&poses, scene, &w->settings, w->frame, err)) == STATUS_OK &&
        (s = render_scene_place(w, poses, err)) == STATUS_OK) {
        materials_placed(w);
        find_enclosing(w, scene);
        load_camera(w, poses);
        w->kernel = kernel_for(w->effects);
        if ((s = shapes_find(w, scene, err)) == STATUS_OK &&
            (s = load_environment(w, scene, blobs, err)) == STATUS_OK &&
            (s = find_bounds(w, scene, err)) == STATUS_OK &&
            (s = load_lights(w, scene, poses, err)) == STATUS_OK &&
            (s = touch_find(w, err)) == STATUS_OK) {
            find_fog(w);
            s = build_accel(w, scene, err);
            if (s == STATUS_OK)
                s = near_find(w, err);
        }
    }
    poses_free(poses);
    return s;
}

static status build_moved(struct render_scene *w, const struct scene *scene, const struct render_used *used,
                          struct blob_source blobs, struct error *err)
{
    struct scene moved;
    status s = choose_origin(w, scene, blobs, err);

    if (s == STATUS_OK && w->digits.reach == 0)
        return build(w, scene, used, blobs, err);
    if (s == STATUS_OK)
        s = scene_copy_movable(&moved, scene, err);
    if (s != STATUS_OK)
        return s;
    scene_move(&moved, w->digits.origin);
    s = build(w, &moved, used, blobs, err);
    scene_copy_release(&moved);
    return s;
}

/* `scene`: in this frame; `animated`: it may differ in others. */
static status new_at_frame(struct render_scene **out, const struct scene *scene, const struct render_settings *settings,
                           uint32_t frame, int animated, struct blob_source blobs, struct error *err)
{
    uint64_t start_ns = clock_monotonic_ns();
    struct render_used used;
    struct render_scene *w = mem_calloc(1, sizeof *w);
    status s;

    NEED(w, err, "the scene");
    w->settings = *settings;
    w->build_threads = build_threads;
    w->roulette_depth = settings->no_roulette ? UINT32_MAX : ROULETTE_DEPTH;
    w->frame = frame;
    w->animated = animated;
    w->volume_rule = scene->volume_rule;
    w->effects = scene_effects(scene, settings, frame, NULL);
    s = used_init(&used, scene, settings, err);
    if (s == STATUS_OK)
        s = build_moved(w, scene, &used, blobs, err);
    if (s == STATUS_OK)
        place_keys(w, scene);
    used_release(&used);
    if (s != STATUS_OK) {
        render_scene_free(w);
        return s;
    }
    enclosure_find(w);
    if (w->effects & (EFFECT_NESTED_DIELECTRIC | EFFECT_INTERFACE | EFFECT_MEDIUM))
        interior_find_camera(w);
    s = casters_new(&w->casters, w, err);
    w->info.bvh_bytes += casters_bytes(w->casters);
    if (s == STATUS_OK)
        s = caustic_pilot_run(w, err);
    if (s == STATUS_OK)
        s = light_pilot_run(w, err);
    if (s != STATUS_OK) {
        render_scene_free(w);
        return s;
    }
    w->info.build_ns = clock_monotonic_ns() - start_ns;
    *out = w;
    return STATUS_OK;
}

status render_scene_new(struct render_scene **out, const struct scene *scene, const struct render_settings *settings,
                        uint32_t frame, struct blob_source blobs, struct error *err)
{
    struct scene at;
    status s;

    *out = NULL;
    TRY(render_settings_validate(settings, scene->camera_count, err));
    s = scene_at_frame(&at, scene, settings, frame, err);
    if (s == STATUS_OK)
        s = new_at_frame(out, &at, settings, frame, scene_is_animated(scene, settings), blobs, err);
    scene_copy_release(&at);
    return s;
}

void render_scene_free(struct render_scene *w)
{
    if (!w)
        return;
    casters_free(w->casters);
    accel_free(w->accel);
    emitters_release(&w->emitters);
    environment_free(w->environment);
    for (size_t i = 0; i < w->owned_count; i++)
        mem_free(w->owned[i]);
    for (uint32_t i = 0; i < w->image_count; i++)
        image_share_put(w->image_shares[i]);
    for (uint32_t i = 0; i < w->medium_count; i++)
        medium_free(w->media[i]);
    mem_free(w->owned);
    mem_free(w->images);
    mem_free(w->image_shares);
    mem_free(w->media);
    mem_free(w->instances);
    mem_free(w->materials);
    mem_free(w->meshes);
    mem_free(w);
}

void render_scene_info(const struct render_scene *w, struct render_scene_info *info) { *info = w->info; }
