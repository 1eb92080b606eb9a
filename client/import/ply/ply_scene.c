/* A PLY file as a scene: one mesh, of grey, of its colours, or under its texture. */
#include <string.h>
#include <strings.h>

#include "client/import/ply/ply.h"
#include "client/import/ply/ply_scene.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "common/image/image.h"
#include "common/system/file.h"

static const float grey = 0.8f;

static int recognise(const void *data, size_t size_bytes, const char *name)
{
    return ply_recognise(data, size_bytes) || strcasecmp(file_extension(name), "ply") == 0;
}

static void warn(struct builder *b, const char *name, const struct ply_report *report)
{
    if (report->faces_invalid)
        builder_warn_at(b, name, 0, "PLY faces",
                        "%zu faces have fewer than three corners or one that is not a vertex: left out",
                        report->faces_invalid);
    if (report->faces_fanned)
        builder_warn_at(b, name, 0, "PLY fans", "%zu faces cross themselves or are too large to be cut cleanly",
                        report->faces_fanned);
    if (report->faces_elsewhere)
        builder_warn_at(b, name, 0, "PLY textures", "%zu faces name another than the first texture: it is not read",
                        report->faces_elsewhere);
    if (report->texcoords_odd)
        builder_warn_at(b, name, 0, "PLY texcoord",
                        "%zu faces have more or fewer texture coordinates than corners: the rest is not read, or 0",
                        report->texcoords_odd);
    if (report->face_colors_unread)
        builder_warn_at(b, name, 0, "PLY colours", "the colours of faces are not read beside those of vertices");
    if (report->unread[0])
        builder_warn_at(b, name, 0, "PLY properties", "not read: %s", report->unread);
}

/* The file may be named by its place on another computer, and lie beside this one. */
static status read_texture(struct builder *b, const char *folder, const char *texture, struct buffer *out)
{
    const char *last = texture + strlen(texture);
    char *path;
    status result;

    if (!folder)
        return error_set(b->err, STATUS_ERR_INPUT, "other files cannot be read here");
    while (last > texture && !strchr("/\\:", last[-1]))
        last--;
    path = must(file_join(folder, texture));
    if (!input_files_contain(b->files, path)) {
        char *beside = must(file_join(folder, last));
        if (input_files_contain(b->files, beside)) {
            mem_free(path);
            path = beside;
            beside = NULL;
        }
        mem_free(beside);
    }
    result = input_files_read(b->files, path, IMPORT_FILE_BYTES_MAX, out, b->err);
    mem_free(path);
    if (result == STATUS_OK && image_format_of(out->data, out->size) == IMAGE_UNKNOWN)
        result = error_set(b->err, STATUS_ERR_UNSUPPORTED, "is no picture that is read");
    return result == STATUS_OK ? builder_check_picture(b, file_basename(texture), out->data, out->size) : result;
}

/* A texture takes the place of colours, which photogrammetry makes of the same photographs. */
static status add_texture(struct builder *b, const char *name, const char *folder, const char *texture,
                          struct mesh_source *mesh, struct scene_material *material)
{
    struct scene_texture row = {.wrap_u = WRAP_REPEAT, .wrap_v = WRAP_REPEAT};
    struct buffer bytes = BUFFER_INIT;
    uint32_t added;
    status result;

    if (!texture[0])
        return STATUS_OK;
    if (!mesh->uv[0]) {
        builder_warn_at(b, name, 0, "PLY texture", "the file has no texture coordinates: \"%.200s\" is not used", texture);
        return STATUS_OK;
    }
    result = read_texture(b, folder, texture, &bytes);
    if (result != STATUS_OK) {
        buffer_release(&bytes);
        return builder_leave_out(b, name, 0, "texture", texture, result);
    }
    TRY(builder_add_image(b, file_basename(texture), bytes.data, bytes.size, &row.image));
    TRY(builder_add_texture(b, &row, &added));
    material->base_color_texture.texture = (int32_t)added;
    mem_free(mesh->colors);
    mesh->colors = NULL;
    return STATUS_OK;
}

static status add_mesh(struct builder *b, struct mesh_source *mesh, const char *name, struct scene_material *material)
{
    const struct mesh_tangents none = {0};
    struct scene_instance instance;
    int colored = mesh->colors || material->base_color_texture.texture >= 0;
    double origin[3];
    int64_t row;
    status result;

    memcpy(origin, mesh->origin, sizeof origin);
    mesh_source_flip_v(mesh);
    TRY(mesh_finish(b, mesh, name, &none, &row));
    if (row == BUILDER_NO_ROW)
        return builder_nothing(b, "the file has no face with an area");
    material->name = builder_name(b, "default");
    material->double_sided = 1;
    material->metallic = 0;
    material->specular = 0;
    for (int c = 0; c < 3; c++)
        material->base_color[c] = colored ? 1 : grey;
    scene_instance_default(&instance);
    instance.name = name;
    instance.mesh = (uint32_t)row;
    for (int c = 0; c < 3; c++)
        instance.to_world.m[c][3] = origin[c];
    result = builder_add_material(b, material, &instance.material);
    return result == STATUS_OK ? builder_add_instance(b, &instance) : result;
}

static status import(const void *data, size_t size_bytes, const char *name, const char *folder,
                     const struct import_options *options, struct builder *b)
{
    struct mesh_source mesh;
    struct ply_report report;
    struct scene_material material;
    status result = ply_read(data, size_bytes, NULL, &mesh, &report, b->err);

    scene_material_default(&material);
    if (result == STATUS_OK) {
        warn(b, name, &report);
        result = add_texture(b, name, folder, report.texture, &mesh, &material);
    }
    THEN(result, add_mesh(b, &mesh, builder_name(b, file_basename(name)), &material));
    mesh_source_release(&mesh);
    return result == STATUS_OK ? builder_finish(b, file_basename(name), options) : result;
}

const struct import_format format_ply = {"PLY (.ply)", recognise, import};
