/* world: from the scene description and its blobs to something that rays can be shot at. */
#include "worker/render/world.h"

#include <math.h>
#include <string.h>

#include "common/base/clock.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "worker/render/bounds.h"
#include "worker/render/interior.h"
#include "worker/render/kernel.h"
#include "worker/render/path.h"

/* A shared mesh is copied into the top BVH all the same while its copies hold no more
 * triangles than this in all: one BVH is faster than two levels. */
#define BAKE_TRIANGLES_MAX 65536

static status mesh_init(struct world_mesh *out, const struct scene_mesh *mesh, const uint8_t *data,
                        size_t size_bytes, struct error *err)
{
    struct scene_mesh_layout layout;
    size_t index_count = 3 * (size_t)mesh->triangle_count;

    scene_mesh_layout(mesh, &layout);
    if (size_bytes != layout.total_bytes)
        return error_set(err, STATUS_ERR_INPUT,
                         "mesh '%s': its blob holds %zu bytes, %zu are needed: the scene is "
                         "damaged, import it again",
                         mesh->name, size_bytes, layout.total_bytes);
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
            return error_set(err, STATUS_ERR_INPUT, "mesh '%s': vertex %zu is not finite",
                             mesh->name, i / 3);
    return STATUS_OK;
}

static status load_meshes(struct render_scene *w, const struct scene *scene,
                          struct blob_source blobs, struct error *err)
{
    w->meshes = mem_calloc(scene->mesh_count, sizeof *w->meshes);
    if (!w->meshes)
        return error_no_memory(err, "the meshes");
    w->mesh_count = scene->mesh_count;
    for (uint32_t i = 0; i < scene->mesh_count; i++) {
        const uint8_t *data;
        size_t size_bytes;
        status s = blobs.get(blobs.user, &scene->meshes[i].blob.digest, &data, &size_bytes, err);
        if (s == STATUS_OK)
            s = mesh_init(&w->meshes[i], &scene->meshes[i], data, size_bytes, err);
        if (s != STATUS_OK)
            return s;
        w->info.mesh_bytes += size_bytes;
    }
    return STATUS_OK;
}

static status load_images(struct render_scene *w, const struct scene *scene,
                          struct blob_source blobs, struct error *err)
{
    w->images = mem_calloc(scene->image_count, sizeof *w->images);
    if (!w->images)
        return error_no_memory(err, "the textures");
    w->image_count = scene->image_count;
    for (uint32_t i = 0; i < scene->image_count; i++) {
        const uint8_t *data;
        size_t size_bytes;
        status s = blobs.get(blobs.user, &scene->images[i].blob.digest, &data, &size_bytes, err);
        if (s == STATUS_OK)
            s = texture_image_new(&w->images[i], data, size_bytes, scene->images[i].name, err);
        if (s != STATUS_OK)
            return s;
        w->info.texture_bytes += texture_image_bytes(w->images[i]);
    }
    return STATUS_OK;
}

static void slot_init(struct world_slot *out, const struct render_scene *w,
                      const struct scene *scene, const struct scene_texture_slot *slot)
{
    static const float identity[2][3] = {{1, 0, 0}, {0, 1, 0}};

    memset(out, 0, sizeof *out);
    if (slot->texture < 0)
        return;
    out->texture = scene->textures[slot->texture];
    out->image = w->images[out->texture.image];
    out->uv_set = slot->uv_set;
    memcpy(out->m, slot->uv_transform, sizeof out->m);
    out->transformed = memcmp(out->m, identity, sizeof identity) != 0;
}

static float absorption(float color, float distance)
{
    if (!(distance < INFINITY) || color >= 1)
        return 0;
    /* A black attenuation colour lets nothing through; a finite stand-in avoids 0 * inf. */
    return -det_log(fmaxf(color, 1e-30f)) / fmaxf(distance, 1e-30f);
}

static void material_init(struct world_material *out, const struct render_scene *w,
                          const struct scene *scene, const struct scene_material *m)
{
    out->m = *m;
    out->m.name = NULL;
    slot_init(&out->base_color, w, scene, &m->base_color_texture);
    slot_init(&out->metallic_roughness, w, scene, &m->metallic_roughness_texture);
    slot_init(&out->normal, w, scene, &m->normal_texture);
    slot_init(&out->emission, w, scene, &m->emission_texture);
    slot_init(&out->specular, w, scene, &m->specular_texture);
    slot_init(&out->specular_color, w, scene, &m->specular_color_texture);
    slot_init(&out->transmission, w, scene, &m->transmission_texture);
    out->flags = 0;
    if (out->base_color.image || out->metallic_roughness.image || out->specular.image ||
        out->specular_color.image || out->transmission.image)
        out->flags |= MATERIAL_TEXTURED;
    if (m->emission[0] > 0 || m->emission[1] > 0 || m->emission[2] > 0)
        out->flags |= MATERIAL_EMISSIVE;
    if (out->normal.image && m->normal_scale != 0)
        out->flags |= MATERIAL_NORMAL_MAP;
    /* A refractive object is left through its back faces, whatever doubleSided says. */
    if (!m->double_sided && !(m->refractive && m->transmission > 0))
        out->flags |= MATERIAL_CULLED;
    out->absorption = vec3_make(absorption(m->attenuation_color[0], m->attenuation_distance),
                                absorption(m->attenuation_color[1], m->attenuation_distance),
                                absorption(m->attenuation_color[2], m->attenuation_distance));
}

/* Alpha matters unless every way to less than 1 is shut. Depends on the mesh's colours too,
 * hence per instance, recorded with the material that it shares. */
static int alpha_matters(const struct world_material *material, const struct world_mesh *mesh)
{
    if (material->m.alpha_mode == ALPHA_OPAQUE)
        return 0;
    if (material->base_color.image && !texture_image_is_opaque(material->base_color.image))
        return 1;
    if (mesh->colors)
        return 1;
    if (material->m.alpha_mode == ALPHA_MASK)
        return material->m.base_color[3] < material->m.alpha_cutoff;
    return material->m.base_color[3] < 1;
}

static status load_materials(struct render_scene *w, const struct scene *scene, struct error *err)
{
    w->materials = mem_calloc(scene->material_count, sizeof *w->materials);
    if (!w->materials)
        return error_no_memory(err, "the materials");
    w->material_count = scene->material_count;
    for (uint32_t i = 0; i < scene->material_count; i++)
        material_init(&w->materials[i], w, scene, &scene->materials[i]);
    return STATUS_OK;
}

/* The mesh's vertices in world space; 16 zero bytes follow the last, as Embree wants. */
static float *bake_positions(const struct world_mesh *mesh, const struct transform *to_world)
{
    size_t count = mesh->vertex_count;
    float *out = mem_calloc(3 * count + 4, sizeof *out);

    if (!out)
        return NULL;
    for (size_t i = 0; i < count; i++) {
        const float *p = mesh->positions + 3 * i;
        for (int a = 0; a < 3; a++) {
            const float *row = to_world->m[a];
            out[3 * i + (size_t)a] = (float)((double)row[0] * (double)p[0] +
                                             (double)row[1] * (double)p[1] +
                                             (double)row[2] * (double)p[2] + (double)row[3]);
        }
    }
    return out;
}

/* Bound on the rounding of positions and rays that go through an instance's transforms. */
static float instance_error(const struct scene_mesh *mesh, const struct transform *to_world)
{
    float largest = 0;

    for (int a = 0; a < 3; a++) {
        float sum = fabsf(to_world->m[a][3]);
        for (int c = 0; c < 3; c++)
            sum += fabsf(to_world->m[a][c]) *
                   fmaxf(fabsf(mesh->bounds_min[c]), fabsf(mesh->bounds_max[c]));
        largest = fmaxf(largest, sum);
    }
    return 16 * 0x1p-24f * largest;
}

static status load_instances(struct render_scene *w, const struct scene *scene, struct error *err)
{
    static const struct transform identity = {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
    uint32_t *uses = mem_calloc(scene->mesh_count, sizeof *uses);
    status result = STATUS_OK;

    w->instances = mem_calloc(scene->instance_count, sizeof *w->instances);
    w->baked = mem_calloc(scene->instance_count, sizeof *w->baked);
    if (!uses || !w->instances || !w->baked) {
        result = error_no_memory(err, "the instances");
        goto done;
    }
    w->instance_count = scene->instance_count;
    for (uint32_t i = 0; i < scene->instance_count; i++)
        uses[scene->instances[i].mesh]++;
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct scene_instance *description = &scene->instances[i];
        const struct scene_mesh *mesh = &scene->meshes[description->mesh];
        struct world_instance *instance = &w->instances[i];
        struct transform_d forward = transform_to_d(&description->to_world), inverse;
        int flat = !transform_d_invert(&forward, &inverse);

        instance->mesh = description->mesh;
        instance->material = description->material;
        instance->to_world = description->to_world;
        instance->to_object = transform_from_d(&inverse);
        instance->flipped = transform_d_determinant(&forward) < 0;
        w->info.triangles += mesh->triangle_count;
        if (alpha_matters(&w->materials[instance->material], &w->meshes[instance->mesh]))
            w->materials[instance->material].flags |= MATERIAL_ALPHA;
        if (memcmp(&instance->to_world, &identity, sizeof identity) == 0) {
            instance->world_positions = w->meshes[instance->mesh].positions;
        } else if (flat || uses[instance->mesh] == 1 ||
                   (uint64_t)uses[instance->mesh] * mesh->triangle_count <= BAKE_TRIANGLES_MAX) {
            w->baked[i] = bake_positions(&w->meshes[instance->mesh], &instance->to_world);
            if (!w->baked[i]) {
                result = error_no_memory(err, "the instances");
                goto done;
            }
            instance->world_positions = w->baked[i];
            w->info.mesh_bytes += 3 * sizeof(float) * (size_t)mesh->vertex_count;
        } else {
            instance->position_error = instance_error(mesh, &instance->to_world);
        }
    }
    w->info.instances = scene->instance_count;
done:
    mem_free(uses);
    return result;
}

static status load_environment(struct render_scene *w, const struct scene *scene,
                               struct blob_source blobs, struct error *err)
{
    const struct scene_environment *e = &scene->environment;
    const struct render_settings *settings = &w->settings;
    struct image_repairs repairs = {0};
    struct image map = {0};
    const uint8_t *data;
    size_t size_bytes;
    status s;

    if (!e->present)
        return STATUS_OK;
    if (e->constant)
        return environment_new_constant(
            &w->environment,
            vec3_scale(vec3_make(e->radiance[0], e->radiance[1], e->radiance[2]),
                       settings->env_strength),
            settings->env_sampling, err);
    s = blobs.get(blobs.user, &e->image.blob.digest, &data, &size_bytes, err);
    if (s != STATUS_OK)
        return s;
    s = image_decode_hdr(&map, data, size_bytes, e->image.name, &repairs, err);
    if (s != STATUS_OK)
        return s;
    s = environment_new(&w->environment, &map, settings->env_rotate_deg, settings->env_strength,
                        settings->env_sampling, err);
    if (s == STATUS_OK)
        w->info.texture_bytes += environment_bytes(w->environment);
    return s;
}

/* Ritter's sphere around the corners of every instance's box: the boxes are known without
 * touching the vertices. */
static status find_bounds(struct render_scene *w, const struct scene *scene, struct error *err)
{
    struct vec3 *corners = mem_alloc_array((size_t)scene->instance_count * 8, sizeof *corners);
    struct sphere sphere;

    if (!corners)
        return error_no_memory(err, "the bounding sphere");
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct scene_mesh *mesh = &scene->meshes[scene->instances[i].mesh];
        for (int k = 0; k < 8; k++) {
            struct vec3 p = {k & 1 ? mesh->bounds_max[0] : mesh->bounds_min[0],
                             k & 2 ? mesh->bounds_max[1] : mesh->bounds_min[1],
                             k & 4 ? mesh->bounds_max[2] : mesh->bounds_min[2]};
            corners[(size_t)i * 8 + (size_t)k] = transform_point(&scene->instances[i].to_world, p);
        }
    }
    sphere = sphere_around(corners, (size_t)scene->instance_count * 8);
    w->bounds_centre = sphere.centre;
    w->bounds_radius = sphere.radius > 0 && isfinite(sphere.radius) ? sphere.radius : 1;
    mem_free(corners);
    return STATUS_OK;
}

/* Can a ray meet a back face of the mesh first? Of a closed one only if rays start inside:
 * at the camera, or past a wall that lets them through. */
static int culling_shows(const struct render_scene *w, const struct scene *scene,
                         const struct world_instance *instance)
{
    const struct scene_mesh *mesh = &scene->meshes[instance->mesh];
    struct vec3 eye;

    if (!mesh->closed || w->materials[instance->material].m.transmission > 0 ||
        w->camera.kind != CAMERA_PERSPECTIVE)
        return 1;
    eye = transform_point(&w->camera.to_world, vec3_make(0, 0, 0));
    eye = transform_point(&instance->to_object, eye);
    return eye.x >= mesh->bounds_min[0] && eye.x <= mesh->bounds_max[0] &&
           eye.y >= mesh->bounds_min[1] && eye.y <= mesh->bounds_max[1] &&
           eye.z >= mesh->bounds_min[2] && eye.z <= mesh->bounds_max[2];
}

static status build_accel(struct render_scene *w, const struct scene *scene, struct error *err)
{
    struct accel_mesh *meshes = mem_calloc(w->mesh_count, sizeof *meshes);
    struct accel_instance *instances = mem_calloc(w->instance_count, sizeof *instances);
    struct accel_input input = {meshes,          instances,        w->mesh_count, w->instance_count,
                                w->settings.isa, path_accept, w};
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
        const struct world_instance *instance = &w->instances[i];
        const struct world_material *material = &w->materials[instance->material];
        instances[i].mesh = instance->mesh;
        instances[i].world_positions = instance->world_positions;
        instances[i].to_world = instance->to_world;
        instances[i].filtered =
            (material->flags & MATERIAL_ALPHA) != 0 ||
            ((material->flags & MATERIAL_CULLED) && culling_shows(w, scene, instance));
    }
    s = accel_new(&w->accel, &input, err);
    if (s == STATUS_OK)
        w->info.bvh_bytes = accel_bytes(w->accel);
done:
    mem_free(meshes);
    mem_free(instances);
    return s;
}

status render_scene_new(struct render_scene **out, const struct scene *scene,
                        const struct render_settings *settings, uint32_t frame,
                        struct blob_source blobs, struct error *err)
{
    uint64_t start_ns = clock_monotonic_ns();
    struct render_scene *w;
    status s;

    *out = NULL;
    s = render_settings_validate(settings, scene->camera_count, err);
    if (s != STATUS_OK)
        return s;
    w = mem_calloc(1, sizeof *w);
    if (!w)
        return error_no_memory(err, "the scene");
    w->settings = *settings;
    w->frame = frame;
    w->effects = scene_effects(scene, settings, frame, NULL);
    camera_init(&w->camera, &scene->cameras[settings->camera], settings, NULL);
    if ((s = load_meshes(w, scene, blobs, err)) != STATUS_OK ||
        (s = load_images(w, scene, blobs, err)) != STATUS_OK ||
        (s = load_materials(w, scene, err)) != STATUS_OK ||
        (s = load_instances(w, scene, err)) != STATUS_OK ||
        (s = load_environment(w, scene, blobs, err)) != STATUS_OK ||
        (s = find_bounds(w, scene, err)) != STATUS_OK ||
        (s = emitters_init(&w->emitters, w, scene->lights, scene->light_count,
                           scene->environment.portals,
                           scene->environment.present ? scene->environment.portal_count : 0,
                           err)) != STATUS_OK ||
        (s = build_accel(w, scene, err)) != STATUS_OK) {
        render_scene_free(w);
        return s;
    }
    if (w->effects & (EFFECT_NESTED_DIELECTRIC | EFFECT_INTERFACE | EFFECT_MEDIUM))
        interior_find_camera(w);
    w->kernel = kernel_for(w->effects);
    w->info.emissive_triangles = w->emitters.triangle_count;
    w->info.build_ns = clock_monotonic_ns() - start_ns;
    *out = w;
    return STATUS_OK;
}

void render_scene_free(struct render_scene *w)
{
    if (!w)
        return;
    accel_free(w->accel);
    emitters_release(&w->emitters);
    environment_free(w->environment);
    if (w->baked)
        for (uint32_t i = 0; i < w->instance_count; i++)
            mem_free(w->baked[i]);
    if (w->images)
        for (uint32_t i = 0; i < w->image_count; i++)
            texture_image_free(w->images[i]);
    mem_free(w->baked);
    mem_free(w->images);
    mem_free(w->instances);
    mem_free(w->materials);
    mem_free(w->meshes);
    mem_free(w);
}

void render_scene_info(const struct render_scene *w, struct render_scene_info *info)
{
    *info = w->info;
}
