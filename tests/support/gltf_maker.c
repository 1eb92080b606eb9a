#include "tests/support/gltf_maker.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "tests/support/starve.h"

void maker_release(struct maker *m)
{
    buffer_release(&m->bytes);
    buffer_release(&m->views);
    buffer_release(&m->accessors);
    memset(m, 0, sizeof *m);
}

/* Returns the view's number. */
int put_view(struct maker *m, const void *data, size_t size, int stride)
{
    size_t offset;

    while (m->bytes.size % 4)
        buffer_append(&m->bytes, "", 1);
    offset = m->bytes.size;
    buffer_append(&m->bytes, data, size);
    buffer_printf(&m->views, "%s{\"buffer\":0,\"byteOffset\":%zu,\"byteLength\":%zu", m->view_count ? "," : "", offset,
                  size);
    if (stride)
        buffer_printf(&m->views, ",\"byteStride\":%d", stride);
    buffer_puts(&m->views, "}");
    return m->view_count++;
}

/* `more` is JSON that is appended to the accessor: "" or ",\"normalized\":true". */
int put_accessor(struct maker *m, int view, const char *type, int component_type, size_t count, const char *more)
{
    buffer_printf(&m->accessors, "%s{", m->accessor_count ? "," : "");
    if (view >= 0)
        buffer_printf(&m->accessors, "\"bufferView\":%d,", view);
    buffer_printf(&m->accessors, "\"componentType\":%d,\"count\":%zu,\"type\":\"%s\"%s}", component_type, count, type,
                  more);
    return m->accessor_count++;
}

int put_floats(struct maker *m, const char *type, const float *data, size_t floats, size_t count)
{
    return put_accessor(m, put_view(m, data, floats * sizeof *data, 0), type, 5126, count, "");
}

static void append_base64(struct buffer *out, const uint8_t *data, size_t size)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

    for (size_t i = 0; i < size; i += 3) {
        uint32_t bits = (uint32_t)data[i] << 16;
        char four[5] = "====";
        if (i + 1 < size)
            bits |= (uint32_t)data[i + 1] << 8;
        if (i + 2 < size)
            bits |= data[i + 2];
        for (size_t c = 0; c < 4; c++)
            if (c < 2 || i + c - 1 < size)
                four[c] = digits[bits >> (18 - 6 * c) & 63];
        buffer_puts(out, four);
    }
}

/* The whole file; `rest` holds the other tables. */
void maker_write(struct maker *m, const char *rest, struct buffer *out)
{
    buffer_puts(out, "{\"asset\":{\"version\":\"2.0\"}");
    if (m->bytes.size) {
        buffer_printf(out, ",\"buffers\":[{\"byteLength\":%zu,\"uri\":\"data:application/"
                           "octet-stream;base64,",
                      m->bytes.size);
        append_base64(out, m->bytes.data, m->bytes.size);
        buffer_printf(out, "\"}],\"bufferViews\":[%s]", buffer_text(&m->views));
    }
    if (m->accessor_count)
        buffer_printf(out, ",\"accessors\":[%s]", buffer_text(&m->accessors));
    buffer_printf(out, "%s%s}", *rest ? "," : "", rest);
    assert_true(buffer_ok(out));
}

const struct import_options defaults = IMPORT_OPTIONS_DEFAULT;

void import_ok_with(const void *data, size_t size, const char *name, const struct import_options *options,
                    struct import_result *out)
{
    struct error err = {0};

    if (import_scene_memory(data, size, name, NULL, options, out, &err) != STATUS_OK)
        fail_msg("%s\n%.*s", err.text, (int)size, (const char *)data);
    assert_int_equal(scene_validate(&out->scene, &err), STATUS_OK);
}

void maker_import(struct maker *m, const char *rest, struct import_result *out)
{
    struct buffer file = BUFFER_INIT;

    maker_write(m, rest, &file);
    import_ok_with(file.data, file.size, "test.gltf", &defaults, out);
    buffer_release(&file);
    maker_release(m);
}

/* The import must fail and the message must hold all of `words` ("a|b"). */
void assert_says(const struct error *err, const char *words)
{
    char copy[256];
    char *rest = copy;

    snprintf(copy, sizeof copy, "%s", words);
    for (char *word = strsep(&rest, "|"); word; word = strsep(&rest, "|"))
        if (!strstr(err->text, word))
            fail_msg("\"%s\" does not say \"%s\"", err->text, word);
}

void maker_refuse(struct maker *m, const char *rest, const char *words)
{
    struct buffer file = BUFFER_INIT;
    struct import_result result;
    struct error err = {0};

    maker_write(m, rest, &file);
    if (import_scene_memory(file.data, file.size, "test.gltf", NULL, &defaults, &result, &err) == STATUS_OK)
        fail_msg("accepted: %s", rest);
    assert_says(&err, "test.gltf: ");
    assert_says(&err, words);
    assert_null(result.blobs);
    assert_int_equal(result.scene.mesh_count, 0);
    buffer_release(&file);
    maker_release(m);
}

/* What is read without all of the memory is the whole scene. */
struct starved {
    struct buffer file;
    struct import_result whole;
};

static status read_starved(void *user)
{
    const struct starved *s = user;
    struct import_result r;
    struct error err = {0};
    status result = import_scene_memory(s->file.data, s->file.size, "a.gltf", NULL, &defaults, &r, &err);

    if (result == STATUS_OK && !digest_equal(&r.scene_digest, &s->whole.scene_digest))
        result = STATUS_ERR_INTERNAL;
    import_result_release(&r);
    return result;
}

void maker_starve(struct maker *m, const char *rest, long survivors)
{
    struct starved s = {.file = BUFFER_INIT};

    maker_write(m, rest, &s.file);
    maker_release(m);
    import_ok_with(s.file.data, s.file.size, "a.gltf", &defaults, &s.whole);
    assert_true(starve_each(read_starved, &s, survivors) > 50);
    import_result_release(&s.whole);
    buffer_release(&s.file);
}

void refuse_text(const char *text, const char *words)
{
    struct import_result result;
    struct error err = {0};

    assert_int_not_equal(import_scene_memory(text, strlen(text), "test.gltf", NULL, &defaults, &result, &err),
                         STATUS_OK);
    assert_says(&err, words);
}

const float corner_positions[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};

struct maker triangle_maker(void)
{
    struct maker m = {0};

    put_floats(&m, "VEC3", corner_positions, 9, 3);
    return m;
}

static const void *array_at(const uint8_t *data, size_t offset) { return offset == SIZE_MAX ? NULL : data + offset; }

struct mesh_view view_mesh(const struct import_result *result, uint32_t index)
{
    const struct scene_mesh *mesh = &result->scene.meshes[index];
    struct mesh_view view = {.mesh = mesh};
    struct scene_mesh_layout layout;

    scene_mesh_layout(mesh, &layout);
    for (size_t i = 0; i < result->blob_count; i++) {
        const struct import_blob *blob = &result->blobs[i];
        struct digest digest;
        if (!digest_equal(&blob->digest, &mesh->blob.digest))
            continue;
        assert_int_equal(blob->size_bytes, layout.total_bytes);
        assert_int_equal(digest_of(&digest, blob->data, blob->size_bytes), STATUS_OK);
        assert_true(digest_equal(&digest, &blob->digest));
        view.positions = array_at(blob->data, layout.positions);
        view.normals = array_at(blob->data, layout.normals);
        view.tangents = array_at(blob->data, layout.tangents);
        view.uv0 = array_at(blob->data, layout.uv0);
        view.uv1 = array_at(blob->data, layout.uv1);
        view.colors = array_at(blob->data, layout.colors);
        view.indices = array_at(blob->data, layout.indices);
        view.skin = array_at(blob->data, layout.skin);
        view.morphs = array_at(blob->data, layout.morphs);
        view.morph_floats = layout.morph_stride / sizeof(float);
        for (size_t z = 0; z < SCENE_MESH_PADDING_BYTES; z++)
            assert_int_equal(blob->data[layout.total_bytes - 1 - z], 0);
        return view;
    }
    fail_msg("the mesh's blob is missing");
    return view;
}

void assert_floats(const float *got, const float *wanted, size_t count, float tolerance)
{
    assert_non_null(got);
    for (size_t i = 0; i < count; i++)
        if (!(fabsf(got[i] - wanted[i]) <= tolerance))
            fail_msg("value %zu is %.9g instead of %.9g", i, (double)got[i], (double)wanted[i]);
}

void assert_doubles(const double *got, const double *wanted, size_t count, double tolerance)
{
    assert_non_null(got);
    for (size_t i = 0; i < count; i++)
        if (!(fabs(got[i] - wanted[i]) <= tolerance))
            fail_msg("value %zu is %.17g instead of %.17g", i, got[i], wanted[i]);
}

void assert_in_file(const struct scene *scene, const double at[3], const double wanted[3], double tolerance)
{
    double there[3];

    for (int i = 0; i < 3; i++)
        there[i] = at[i] + scene->origin[i];
    assert_doubles(there, wanted, 3, tolerance);
}

void assert_matrix_in_file(const struct scene *scene, const struct transform_d *to_world, const double wanted[12],
                           double tolerance)
{
    struct transform_d m = *to_world;

    for (int r = 0; r < 3; r++)
        m.m[r][3] += scene->origin[r];
    assert_doubles(&m.m[0][0], wanted, 12, tolerance);
}

struct vec3 in_file(const struct scene *scene, const struct transform_d *to_world, struct vec3 p)
{
    const double from[3] = {(double)p.x, (double)p.y, (double)p.z};
    double to[3];

    transform_d_point(to_world, from, to);
    return vec3_make((float)(to[0] + scene->origin[0]), (float)(to[1] + scene->origin[1]),
                     (float)(to[2] + scene->origin[2]));
}

int warned(const struct import_result *result, const char *words)
{
    for (size_t i = 0; i < result->warning_count; i++)
        if (strstr(result->warnings[i], words))
            return 1;
    return 0;
}

void assert_warned(const struct import_result *result, const char *words)
{
    if (warned(result, words))
        return;
    for (size_t i = 0; i < result->warning_count; i++)
        print_error("warning: %s\n", result->warnings[i]);
    fail_msg("no warning says \"%s\"", words);
}

void put_box(struct maker *m, int inside_out)
{
    float positions[24];
    uint16_t indices[36];
    static const uint16_t quads[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                         {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};

    for (int i = 0; i < 8; i++)
        for (int c = 0; c < 3; c++)
            positions[3 * i + c] = (float)(i >> c & 1);
    for (int q = 0; q < 6; q++) {
        static const int order[6] = {0, 1, 2, 0, 2, 3};
        for (int i = 0; i < 6; i++)
            indices[6 * q + (inside_out ? 5 - i : i)] = quads[q][order[i]];
    }
    put_floats(m, "VEC3", positions, 24, 8);
    put_accessor(m, put_view(m, indices, sizeof indices, 0), "SCALAR", 5123, 36, "");
}

void put_mirrored_quads(struct maker *m)
{
    static const float positions[18] = {0, 0, 0, 1, 0, 0, 2, 0, 0, 0, 1, 0, 1, 1, 0, 2, 1, 0};
    static const float normals[18] = {0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1};
    static const float uv[12] = {0, 1, 1, 1, 0, 1, 0, 0, 1, 0, 0, 0};
    static const uint8_t indices[12] = {0, 1, 4, 0, 4, 3, 1, 2, 5, 1, 5, 4};

    put_floats(m, "VEC3", positions, 18, 6);
    put_floats(m, "VEC3", normals, 18, 6);
    put_floats(m, "VEC2", uv, 12, 6);
    put_accessor(m, put_view(m, indices, sizeof indices, 0), "SCALAR", 5121, 12, "");
}
