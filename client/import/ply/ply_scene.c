/* A PLY file as a scene: one mesh, of grey or of the colours of its vertices. */
#include <string.h>
#include <strings.h>

#include "client/import/ply/ply.h"
#include "client/import/ply/ply_scene.h"
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
}

static status add_mesh(struct builder *b, struct mesh_source *mesh, const char *name)
{
    const struct mesh_tangents none = {0};
    struct scene_material material;
    struct scene_instance instance;
    int colored = mesh->colors != NULL;
    double origin[3];
    int64_t row;
    status result;

    memcpy(origin, mesh->origin, sizeof origin);
    mesh_source_flip_v(mesh);
    TRY(mesh_finish(b, mesh, name, &none, &row));
    if (row == BUILDER_NO_ROW)
        return builder_nothing(b, "the file has no face with an area");
    scene_material_default(&material);
    material.name = builder_name(b, "default");
    material.double_sided = 1;
    material.metallic = 0;
    material.specular = 0;
    for (int c = 0; c < 3; c++)
        material.base_color[c] = colored ? 1 : grey;
    scene_instance_default(&instance);
    instance.name = name;
    instance.mesh = (uint32_t)row;
    for (int c = 0; c < 3; c++)
        instance.to_world.m[c][3] = origin[c];
    result = builder_add_material(b, &material, &instance.material);
    return result == STATUS_OK ? builder_add_instance(b, &instance) : result;
}

static status import(const void *data, size_t size_bytes, const char *name, const char *folder,
                     const struct import_options *options, struct builder *b)
{
    struct mesh_source mesh;
    struct ply_report report;
    status result = ply_read(data, size_bytes, NULL, &mesh, &report, b->err);

    (void)folder; /* a PLY file names no others */
    if (result == STATUS_OK) {
        warn(b, name, &report);
        result = add_mesh(b, &mesh, builder_name(b, file_basename(name)));
    }
    mesh_source_release(&mesh);
    return result == STATUS_OK ? builder_finish(b, file_basename(name), options) : result;
}

const struct import_format format_ply = {"PLY (.ply)", recognise, import};
