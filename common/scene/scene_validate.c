/* Every index, count, enum and number of a scene, checked once, so that nothing that reads
 * a scene afterwards has to check again. */
#include <math.h>
#include <string.h>

#include "common/scene/scene.h"

/* Where a complaint belongs: the table and the row. */
struct place {
    const char *table;
    uint32_t row;
    struct error *err;
};

static status complain(const struct place *at, const char *field, const char *what)
{
    return error_set(at->err, STATUS_ERR_INPUT, "the scene's %s[%u].%s %s", at->table, at->row,
                     field, what);
}

/* UTF-8 without control characters: names are printed on terminals and web pages. */
static int name_is_clean(const char *name)
{
    const uint8_t *p = (const uint8_t *)name;

    for (; *p; p++) {
        uint32_t code = *p;
        int more = 0;

        if (code < 0x20 || code == 0x7f)
            return 0;
        if (code >= 0xf8 || (code >= 0x80 && code < 0xc0))
            return 0;
        if (code >= 0xf0)
            more = 3, code &= 0x07;
        else if (code >= 0xe0)
            more = 2, code &= 0x0f;
        else if (code >= 0xc0)
            more = 1, code &= 0x1f;
        for (int i = 0; i < more; i++) {
            if ((p[1] & 0xc0) != 0x80)
                return 0;
            code = code << 6 | (*++p & 0x3f);
        }
        /* Overlong forms, surrogates, C1 controls and what lies beyond Unicode. */
        if ((more == 1 && code < 0xa0) || (more == 2 && code < 0x800) ||
            (more == 3 && code < 0x10000) || code > 0x10ffff || (code >= 0xd800 && code < 0xe000))
            return 0;
    }
    return 1;
}

static status check_name(const struct place *at, const char *name)
{
    if (!name)
        return complain(at, "name", "is missing");
    if (strlen(name) > SCENE_NAME_MAX)
        return complain(at, "name", "is longer than 255 bytes");
    if (!name_is_clean(name))
        return complain(at, "name", "is not UTF-8 text without control characters");
    return STATUS_OK;
}

static status check_range(const struct place *at, const char *field, float value, float low,
                          float high)
{
    if (!(value >= low && value <= high))
        return error_set(at->err, STATUS_ERR_INPUT,
                         "the scene's %s[%u].%s is %g: must be %g to %g", at->table, at->row,
                         field, (double)value, (double)low, (double)high);
    return STATUS_OK;
}

static status check_ranges(const struct place *at, const char *field, const float *values,
                           int count, float low, float high)
{
    status result = STATUS_OK;

    for (int i = 0; i < count && result == STATUS_OK; i++)
        result = check_range(at, field, values[i], low, high);
    return result;
}

static status check_flag(const struct place *at, const char *field, int value)
{
    return value == 0 || value == 1 ? STATUS_OK : complain(at, field, "must be 0 or 1");
}

static status check_enum(const struct place *at, const char *field, unsigned value, unsigned count)
{
    return value < count ? STATUS_OK : complain(at, field, "is not a known kind");
}

static status check_index(const struct place *at, const char *field, uint32_t index,
                          uint32_t count)
{
    if (index < count)
        return STATUS_OK;
    return error_set(at->err, STATUS_ERR_INPUT, "the scene's %s[%u].%s is %u: there are %u",
                     at->table, at->row, field, index, count);
}

static status check_blob(const struct place *at, const struct scene_blob *blob)
{
    if (blob->size_bytes == 0 || blob->size_bytes > SCENE_BLOB_BYTES_MAX)
        return complain(at, "blob", "is empty or too large");
    return STATUS_OK;
}

#define CHECK(call)                    \
    do {                               \
        status result_ = (call);       \
        if (result_ != STATUS_OK)      \
            return result_;            \
    } while (0)

static status check_mesh(const struct place *at, const struct scene_mesh *mesh)
{
    struct scene_mesh_layout layout;

    CHECK(check_name(at, mesh->name));
    CHECK(check_blob(at, &mesh->blob));
    if (mesh->triangle_count < 1 || mesh->triangle_count > SCENE_TRIANGLES_MAX)
        return complain(at, "triangle_count", "is out of range");
    if (mesh->vertex_count < 3 || mesh->vertex_count > 3u * SCENE_TRIANGLES_MAX)
        return complain(at, "vertex_count", "is out of range");
    if (mesh->arrays & ~(uint32_t)MESH_ARRAYS_ALL)
        return complain(at, "arrays", "names an unknown vertex array");
    scene_mesh_layout(mesh, &layout);
    if (mesh->blob.size_bytes != layout.total_bytes)
        return complain(at, "blob", "has not the size that the counts call for");
    CHECK(check_ranges(at, "bounds_min", mesh->bounds_min, 3, -SCENE_COORDINATE_MAX,
                       SCENE_COORDINATE_MAX));
    CHECK(check_ranges(at, "bounds_max", mesh->bounds_max, 3, -SCENE_COORDINATE_MAX,
                       SCENE_COORDINATE_MAX));
    for (int i = 0; i < 3; i++)
        if (mesh->bounds_min[i] > mesh->bounds_max[i])
            return complain(at, "bounds_min", "lies beyond bounds_max");
    return check_flag(at, "closed", mesh->closed);
}

static status check_image(const struct place *at, const struct scene_image *image)
{
    CHECK(check_name(at, image->name));
    return check_blob(at, &image->blob);
}

static status check_texture(const struct place *at, const struct scene_texture *texture,
                            uint32_t image_count)
{
    CHECK(check_index(at, "image", texture->image, image_count));
    CHECK(check_enum(at, "wrap_u", (unsigned)texture->wrap_u, WRAP_COUNT));
    CHECK(check_enum(at, "wrap_v", (unsigned)texture->wrap_v, WRAP_COUNT));
    return check_flag(at, "nearest", texture->nearest);
}

static status check_slot(const struct place *at, const char *field,
                         const struct scene_texture_slot *slot, uint32_t texture_count)
{
    if (slot->texture < 0)
        return slot->texture == -1 ? STATUS_OK : complain(at, field, "is below -1");
    CHECK(check_index(at, field, (uint32_t)slot->texture, texture_count));
    if (slot->uv_set > 1)
        return complain(at, field, "names a texture coordinate set other than 0 and 1");
    /* Times a texture coordinate this stays far below what a float can hold. */
    return check_ranges(at, field, &slot->uv_transform[0][0], 6, -1e6f, 1e6f);
}

static status check_material(const struct place *at, const struct scene_material *m,
                             uint32_t texture_count)
{
    const float unlimited = 1e30f; /* any finite radiance or weight that squares may be taken of */

    CHECK(check_name(at, m->name));
    CHECK(check_flag(at, "unlit", m->unlit));
    CHECK(check_flag(at, "double_sided", m->double_sided));
    CHECK(check_enum(at, "alpha_mode", (unsigned)m->alpha_mode, ALPHA_COUNT));
    CHECK(check_range(at, "alpha_cutoff", m->alpha_cutoff, 0, unlimited));
    CHECK(check_ranges(at, "base_color", m->base_color, 4, 0, 1));
    CHECK(check_slot(at, "base_color_texture", &m->base_color_texture, texture_count));
    CHECK(check_range(at, "metallic", m->metallic, 0, 1));
    CHECK(check_range(at, "roughness", m->roughness, 0, 1));
    CHECK(check_slot(at, "metallic_roughness_texture", &m->metallic_roughness_texture,
                     texture_count));
    CHECK(check_range(at, "normal_scale", m->normal_scale, -1e6f, 1e6f));
    CHECK(check_slot(at, "normal_texture", &m->normal_texture, texture_count));
    CHECK(check_ranges(at, "emission", m->emission, 3, 0, unlimited));
    CHECK(check_slot(at, "emission_texture", &m->emission_texture, texture_count));
    if (m->ior != 0)
        CHECK(check_range(at, "ior", m->ior, 1, 1e6f));
    CHECK(check_range(at, "specular", m->specular, 0, 1));
    CHECK(check_slot(at, "specular_texture", &m->specular_texture, texture_count));
    CHECK(check_ranges(at, "specular_color", m->specular_color, 3, 0, unlimited));
    CHECK(check_slot(at, "specular_color_texture", &m->specular_color_texture, texture_count));
    CHECK(check_range(at, "transmission", m->transmission, 0, 1));
    CHECK(check_slot(at, "transmission_texture", &m->transmission_texture, texture_count));
    CHECK(check_flag(at, "refractive", m->refractive));
    CHECK(check_ranges(at, "attenuation_color", m->attenuation_color, 3, 0, 1));
    if (!(m->attenuation_distance > 0))
        return complain(at, "attenuation_distance", "must be above 0");
    return STATUS_OK;
}

static status check_instance(const struct place *at, const struct scene *scene, uint32_t row)
{
    const struct scene_instance *instance = &scene->instances[row];
    struct transform_d to_world, inverse;
    double low[3], high[3];

    CHECK(check_name(at, instance->name));
    CHECK(check_index(at, "mesh", instance->mesh, scene->mesh_count));
    CHECK(check_index(at, "material", instance->material, scene->material_count));
    if (!transform_is_finite(&instance->to_world))
        return complain(at, "to_world", "is not finite");
    to_world = transform_to_d(&instance->to_world);
    if (!transform_d_invert(&to_world, &inverse))
        return complain(at, "to_world", "cannot be inverted");
    if (!scene_instance_bounds(scene, row, low, high))
        return complain(at, "to_world", "moves the mesh out of the range of numbers");
    for (int i = 0; i < 3; i++)
        if (!(low[i] >= -(double)SCENE_COORDINATE_MAX && high[i] <= (double)SCENE_COORDINATE_MAX))
            return complain(at, "to_world", "moves the mesh beyond 1e15 metres");
    return STATUS_OK;
}

static status check_light(const struct place *at, const struct scene_light *light)
{
    const struct vec3 d = {light->direction[0], light->direction[1], light->direction[2]};
    const float half_pi = 1.5707964f;

    CHECK(check_name(at, light->name));
    CHECK(check_enum(at, "kind", (unsigned)light->kind, LIGHT_KIND_COUNT));
    CHECK(check_ranges(at, "position", light->position, 3, -SCENE_COORDINATE_MAX,
                       SCENE_COORDINATE_MAX));
    if (!(fabsf(vec3_length(d) - 1) < 1e-3f))
        return complain(at, "direction", "is not a unit vector");
    CHECK(check_ranges(at, "intensity", light->intensity, 3, 0, 1e30f));
    CHECK(check_range(at, "range", light->range, 0, SCENE_COORDINATE_MAX));
    if (light->kind == LIGHT_SPOT) {
        CHECK(check_range(at, "outer_cone_rad", light->outer_cone_rad, 0, half_pi));
        CHECK(check_range(at, "inner_cone_rad", light->inner_cone_rad, 0, half_pi));
        if (!(light->inner_cone_rad < light->outer_cone_rad))
            return complain(at, "inner_cone_rad", "must be below outer_cone_rad");
    }
    return STATUS_OK;
}

static status check_camera(const struct place *at, const struct scene_camera *camera)
{
    CHECK(check_name(at, camera->name));
    CHECK(check_enum(at, "kind", (unsigned)camera->kind, CAMERA_KIND_COUNT));
    for (int r = 0; r < 3; r++)
        CHECK(check_range(at, "to_world", camera->to_world.m[r][3], -SCENE_COORDINATE_MAX,
                          SCENE_COORDINATE_MAX));
    for (int a = 0; a < 3; a++)
        for (int b = a; b < 3; b++) {
            float dot = 0;
            for (int r = 0; r < 3; r++)
                dot += camera->to_world.m[r][a] * camera->to_world.m[r][b];
            if (!(fabsf(dot - (a == b ? 1.0f : 0.0f)) < 1e-3f))
                return complain(at, "to_world", "is not a rotation and a translation");
        }
    {
        const struct transform_d m = transform_to_d(&camera->to_world);
        if (!(transform_d_determinant(&m) > 0))
            return complain(at, "to_world", "mirrors");
    }
    if (camera->kind == CAMERA_PERSPECTIVE) {
        /* The tangent of half the angle must be a useful number. */
        CHECK(check_range(at, "yfov_rad", camera->yfov_rad, 1e-5f, 3.1415f));
    } else {
        CHECK(check_range(at, "xmag", camera->xmag, 1e-12f, SCENE_COORDINATE_MAX));
        CHECK(check_range(at, "ymag", camera->ymag, 1e-12f, SCENE_COORDINATE_MAX));
    }
    return check_range(at, "aspect", camera->aspect, 0, 1e6f);
}

static status check_count(struct error *err, const char *table, uint32_t count, uint32_t maximum)
{
    if (count <= maximum)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_LIMIT, "the scene has %u %s: at most %u are taken", count,
                     table, maximum);
}

status scene_validate(const struct scene *scene, struct error *err)
{
    struct place at = {"scene", 0, err};

    CHECK(check_name(&at, scene->name));
    CHECK(check_count(err, "meshes", scene->mesh_count, SCENE_MESHES_MAX));
    CHECK(check_count(err, "images", scene->image_count, SCENE_IMAGES_MAX));
    CHECK(check_count(err, "textures", scene->texture_count, SCENE_TEXTURES_MAX));
    CHECK(check_count(err, "materials", scene->material_count, SCENE_MATERIALS_MAX));
    CHECK(check_count(err, "instances", scene->instance_count, SCENE_INSTANCES_MAX));
    CHECK(check_count(err, "lights", scene->light_count, SCENE_LIGHTS_MAX));
    CHECK(check_count(err, "cameras", scene->camera_count, SCENE_CAMERAS_MAX));
    if (scene->camera_count == 0)
        return error_set(err, STATUS_ERR_INPUT, "the scene has no camera");
#define EACH_ROW(name, count, call)                  \
    at.table = name;                                 \
    for (at.row = 0; at.row < (count); at.row++)     \
        CHECK(call);
    EACH_ROW("meshes", scene->mesh_count, check_mesh(&at, &scene->meshes[at.row]))
    EACH_ROW("images", scene->image_count, check_image(&at, &scene->images[at.row]))
    EACH_ROW("textures", scene->texture_count,
             check_texture(&at, &scene->textures[at.row], scene->image_count))
    EACH_ROW("materials", scene->material_count,
             check_material(&at, &scene->materials[at.row], scene->texture_count))
    EACH_ROW("instances", scene->instance_count, check_instance(&at, scene, at.row))
    EACH_ROW("lights", scene->light_count, check_light(&at, &scene->lights[at.row]))
    EACH_ROW("cameras", scene->camera_count, check_camera(&at, &scene->cameras[at.row]))
#undef EACH_ROW
    at = (struct place){"environment", 0, err};
    CHECK(check_flag(&at, "present", scene->environment.present));
    if (!scene->environment.present)
        return STATUS_OK;
    CHECK(check_flag(&at, "constant", scene->environment.constant));
    if (scene->environment.constant)
        return check_ranges(&at, "radiance", scene->environment.radiance, 3, 0, 1e30f);
    return check_image(&at, &scene->environment.image);
}
