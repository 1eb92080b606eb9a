#include "scenes/gltf_writer.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#include "common/system/file.h"
#include "common/base/memory.h"

enum { FLOAT = 5126, UNSIGNED_SHORT = 5123, VERTICES = 34962, INDICES = 34963 };

unsigned shape_add_vertex(struct shape *shape, double x, double y, double z)
{
    float *p;

    assert(shape->vertex_count < SHAPE_VERTICES_MAX);
    p = shape->positions[shape->vertex_count];
    p[0] = (float)x;
    p[1] = (float)y;
    p[2] = (float)z;
    return shape->vertex_count++;
}

void shape_add_triangle(struct shape *shape, unsigned a, unsigned b, unsigned c)
{
    uint16_t *t;

    assert(shape->triangle_count < SHAPE_TRIANGLES_MAX);
    t = shape->triangles[shape->triangle_count++];
    t[0] = (uint16_t)a;
    t[1] = (uint16_t)b;
    t[2] = (uint16_t)c;
}

void shape_add_quad(struct shape *shape, const double corners[4][3])
{
    unsigned first = shape->vertex_count;

    for (int i = 0; i < 4; i++)
        shape_add_vertex(shape, corners[i][0], corners[i][1], corners[i][2]);
    shape_add_triangle(shape, first, first + 1, first + 2);
    shape_add_triangle(shape, first, first + 2, first + 3);
}

/* ---- the writer --------------------------------------------------------------------------- */

void gltf_writer_init(struct gltf_writer *w) { memset(w, 0, sizeof *w); }

void gltf_writer_release(struct gltf_writer *w)
{
    buffer_release(&w->bin);
    buffer_release(&w->views);
    buffer_release(&w->accessors);
    buffer_release(&w->materials);
    buffer_release(&w->meshes);
    buffer_release(&w->nodes);
    buffer_release(&w->textures);
    buffer_release(&w->images);
    buffer_release(&w->extensions);
}

static const char *separator(unsigned count)
{
    return count ? ",\n    " : "\n    ";
}

void gltf_writer_use_extension(struct gltf_writer *w, const char *name)
{
    buffer_printf(&w->extensions, "%s\"%s\"", w->extensions.size ? ", " : "", name);
}

unsigned gltf_writer_add_material(struct gltf_writer *w, const char *json)
{
    buffer_printf(&w->materials, "%s%s", separator(w->material_count), json);
    return w->material_count++;
}

unsigned gltf_writer_add_image(struct gltf_writer *w, const char *uri)
{
    buffer_printf(&w->images, "%s{\"uri\": \"%s\"}", separator(w->image_count), uri);
    buffer_printf(&w->textures, "%s{\"sampler\": 0, \"source\": %u}", separator(w->image_count), w->image_count);
    return w->image_count++;
}

/* Values little-endian, which every machine that this is built for is. */
static unsigned add_accessor(struct gltf_writer *w, const void *data, unsigned count, unsigned components, int type,
                             const char *type_name, int target, const char *bounds)
{
    size_t size = (size_t)count * components * (type == FLOAT ? 4 : 2);

    buffer_printf(&w->views, "%s{\"buffer\": 0, \"byteOffset\": %zu, \"byteLength\": %zu, \"target\": %d}",
                  separator(w->view_count), w->bin.size, size, target);
    buffer_append(&w->bin, data, size);
    while (w->bin.size % 4 != 0 && buffer_ok(&w->bin))
        buffer_append(&w->bin, "", 1);
    buffer_printf(&w->accessors,
                  "%s{\"bufferView\": %u, \"componentType\": %d, \"count\": %u, "
                  "\"type\": \"%s\"%s}",
                  separator(w->accessor_count), w->view_count++, type, count, type_name, bounds);
    return w->accessor_count++;
}

void gltf_writer_add_shape(struct gltf_writer *w, const struct shape *shape, struct buffer *primitive)
{
    float low[3], high[3];
    struct buffer bounds = BUFFER_INIT;
    unsigned n = shape->vertex_count;

    for (int c = 0; c < 3; c++) {
        low[c] = high[c] = shape->positions[0][c];
        for (unsigned i = 1; i < n; i++) {
            low[c] = fminf(low[c], shape->positions[i][c]);
            high[c] = fmaxf(high[c], shape->positions[i][c]);
        }
    }
    buffer_printf(&bounds, ", \"min\": [%.9g, %.9g, %.9g], \"max\": [%.9g, %.9g, %.9g]", (double)low[0], (double)low[1],
                  (double)low[2], (double)high[0], (double)high[1], (double)high[2]);
    buffer_printf(primitive, "\"attributes\": {\"POSITION\": %u",
                  add_accessor(w, shape->positions, n, 3, FLOAT, "VEC3", VERTICES, buffer_text(&bounds)));
    if (shape->has_normals)
        buffer_printf(primitive, ", \"NORMAL\": %u",
                      add_accessor(w, shape->normals, n, 3, FLOAT, "VEC3", VERTICES, ""));
    if (shape->has_tangents)
        buffer_printf(primitive, ", \"TANGENT\": %u",
                      add_accessor(w, shape->tangents, n, 4, FLOAT, "VEC4", VERTICES, ""));
    if (shape->has_uvs)
        buffer_printf(primitive, ", \"TEXCOORD_0\": %u",
                      add_accessor(w, shape->uvs, n, 2, FLOAT, "VEC2", VERTICES, ""));
    buffer_printf(primitive, "}, \"indices\": %u",
                  add_accessor(w, shape->triangles, shape->triangle_count * 3, 1, UNSIGNED_SHORT, "SCALAR", INDICES,
                               ""));
    if (!buffer_ok(&bounds))
        primitive->failed = 1;
    buffer_release(&bounds);
}

unsigned gltf_writer_add_mesh(struct gltf_writer *w, const char *name, const char *primitive, unsigned material)
{
    buffer_printf(&w->meshes, "%s{\"name\": \"%s\", \"primitives\": [{%s, \"material\": %u}]}",
                  separator(w->mesh_count), name, primitive, material);
    return w->mesh_count++;
}

void gltf_writer_add_node(struct gltf_writer *w, const char *name, unsigned mesh, double x, double y, double z)
{
    buffer_printf(&w->nodes, "%s{\"name\": \"%s\", \"mesh\": %u", separator(w->node_count), name, mesh);
    if (x != 0 || y != 0 || z != 0)
        buffer_printf(&w->nodes, ", \"translation\": [%.9g, %.9g, %.9g]", x, y, z);
    buffer_puts(&w->nodes, "}");
    w->node_count++;
}

/* First a turn about +Y, then one about the camera's own +X: enough for a level horizon. */
void gltf_writer_add_camera(struct gltf_writer *w, double yfov_rad, const double eye[3], const double target[3])
{
    double dx = target[0] - eye[0], dy = target[1] - eye[1], dz = target[2] - eye[2];
    double yaw = atan2(-dx, -dz), pitch = atan2(dy, sqrt(dx * dx + dz * dz));
    double sy = sin(yaw / 2), cy = cos(yaw / 2), sx = sin(pitch / 2), cx = cos(pitch / 2);

    w->cameras = 1;
    w->camera_yfov_rad = yfov_rad;
    buffer_printf(&w->nodes, "%s{\"name\": \"camera\", \"camera\": 0, \"translation\": [%.9g, %.9g, %.9g]",
                  separator(w->node_count), eye[0], eye[1], eye[2]);
    if (yaw != 0 || pitch != 0)
        buffer_printf(&w->nodes, ", \"rotation\": [%.9g, %.9g, %.9g, %.9g]", cy * sx, sy * cx, -sy * sx, cy * cx);
    buffer_puts(&w->nodes, "}");
    w->node_count++;
}

/* RFC 4648. */
static void append_base64(struct buffer *out, const struct buffer *in)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
                                 "abcdefghijklmnopqrstuvwxyz0123456789+/";

    for (size_t i = 0; i < in->size; i += 3) {
        size_t left = in->size - i;
        uint32_t bits = (uint32_t)in->data[i] << 16;
        char four[4];

        if (left > 1)
            bits |= (uint32_t)in->data[i + 1] << 8;
        if (left > 2)
            bits |= in->data[i + 2];
        four[0] = digits[bits >> 18];
        four[1] = digits[bits >> 12 & 63];
        four[2] = left > 1 ? digits[bits >> 6 & 63] : '=';
        four[3] = left > 2 ? digits[bits & 63] : '=';
        buffer_append(out, four, 4);
    }
}

static void append_list(struct buffer *out, const char *name, const struct buffer *items)
{
    if (items->size)
        buffer_printf(out, ",\n  \"%s\": [%s\n  ]", name, buffer_text(items));
    if (items->failed)
        out->failed = 1;
}

static void append_document(struct gltf_writer *w, const char *bin_name, struct buffer *out)
{
    buffer_puts(out, "{\n  \"asset\": {\"version\": \"2.0\", \"generator\": \"azulejo scenes\", "
                     "\"copyright\": \"Azulejo authors, Apache-2.0\"}");
    if (w->extensions.size)
        buffer_printf(out, ",\n  \"extensionsUsed\": [%s]", buffer_text(&w->extensions));
    buffer_puts(out, ",\n  \"scene\": 0,\n  \"scenes\": [{\"nodes\": [");
    for (unsigned i = 0; i < w->node_count; i++)
        buffer_printf(out, "%s%u", i ? ", " : "", i);
    buffer_puts(out, "]}]");
    if (w->cameras)
        buffer_printf(out,
                      ",\n  \"cameras\": [\n    {\"type\": \"perspective\", \"perspective\": "
                      "{\"yfov\": %.9g, \"aspectRatio\": 1, \"znear\": 0.01}}\n  ]",
                      w->camera_yfov_rad);
    append_list(out, "nodes", &w->nodes);
    append_list(out, "meshes", &w->meshes);
    append_list(out, "materials", &w->materials);
    if (w->image_count)
        buffer_puts(out, ",\n  \"samplers\": [\n    {\"magFilter\": 9729, \"minFilter\": 9729, "
                         "\"wrapS\": 10497, \"wrapT\": 10497}\n  ]");
    append_list(out, "textures", &w->textures);
    append_list(out, "images", &w->images);
    append_list(out, "accessors", &w->accessors);
    append_list(out, "bufferViews", &w->views);
    buffer_printf(out, ",\n  \"buffers\": [\n    {\"byteLength\": %zu, \"uri\": \"", w->bin.size);
    if (bin_name) {
        buffer_puts(out, bin_name);
    } else {
        buffer_puts(out, "data:application/octet-stream;base64,");
        append_base64(out, &w->bin);
    }
    buffer_puts(out, "\"}\n  ]\n}\n");
    if (w->bin.failed)
        out->failed = 1;
}

static status write_file(const char *folder, const char *name, const struct buffer *data, struct error *err)
{
    char *path = file_join(folder, name);
    status st;

    if (!path)
        return error_no_memory(err, "a path");
    st = file_write_atomic(path, data->data, data->size, err);
    mem_free(path);
    return st;
}

status gltf_writer_save(struct gltf_writer *w, const char *folder, const char *name, const char *bin_name,
                        struct error *err)
{
    struct buffer text = BUFFER_INIT, file_name = BUFFER_INIT;
    status st;

    append_document(w, bin_name, &text);
    buffer_printf(&file_name, "%s.gltf", name);
    if (!buffer_ok(&text) || !buffer_ok(&file_name))
        st = error_no_memory(err, "a glTF file");
    else
        st = write_file(folder, buffer_text(&file_name), &text, err);
    if (st == STATUS_OK && bin_name)
        st = write_file(folder, bin_name, &w->bin, err);
    buffer_release(&text);
    buffer_release(&file_name);
    return st;
}
