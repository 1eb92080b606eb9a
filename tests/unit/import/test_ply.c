/* PLY: the same quad and triangle in every format and with every type, odd headers, faces before
 * vertices, lists to skip, and files that lie. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "client/import/ply/ply.h"
#include "common/base/buffer.h"
#include "common/base/memory.h"
#include "tests/support/starve.h"

static void read_ok(const char *text, struct mesh_source *mesh, struct ply_report *report)
{
    struct error err = {0};
    status result = ply_read(text, strlen(text), NULL, mesh, report, &err);

    if (result != STATUS_OK)
        print_message("%s\n", err.text);
    assert_int_equal(result, STATUS_OK);
}

/* It must be refused with a message that holds `words`. */
static void refuse(const void *data, size_t size, status code, const char *words)
{
    struct mesh_source mesh;
    struct error err = {0};

    assert_int_equal(ply_read(data, size, NULL, &mesh, NULL, &err), code);
    assert_null(mesh.positions);
    if (!strstr(err.text, words))
        print_message("\"%s\" lacks \"%s\"\n", err.text, words);
    assert_non_null(strstr(err.text, words));
}

static void refuse_text(const char *text, status code, const char *words) { refuse(text, strlen(text), code, words); }

#define VERTICES(n) "element vertex " #n "\nproperty float x\nproperty float y\nproperty float z\n"
#define FACES(n) "element face " #n "\nproperty list uchar int vertex_indices\n"
#define ASCII "ply\nformat ascii 1.0\n"

static void ascii_quad(void **state)
{
    static const uint32_t wanted[] = {0, 1, 2, 0, 2, 3, 0, 1, 4};
    struct mesh_source mesh;
    struct ply_report report;

    (void)state;
    read_ok(ASCII "comment made by hand\nobj_info more\n" VERTICES(5)
                FACES(2) "end_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 -1 .5e0\n4 0 1 2 3\n3 0 1 4",
            &mesh, &report);
    assert_int_equal(mesh.vertex_count, 5);
    assert_int_equal(mesh.triangle_count, 3);
    assert_memory_equal(mesh.indices, wanted, sizeof wanted);
    assert_true(mesh.positions[14] == 0.5f);
    assert_null(mesh.normals);
    assert_null(mesh.uv[0]);
    assert_null(mesh.colors);
    assert_int_equal(report.faces_invalid + report.faces_fanned, 0);
    mesh_source_release(&mesh);
}

/* What no picture shows is named: properties, elements, and the second of two that mean the same. */
static void the_rest_is_named(void **state)
{
    struct mesh_source mesh;
    struct ply_report report;
    struct buffer text = BUFFER_INIT;

    (void)state;
    read_ok(ASCII "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty float confidence\n"
                  "property uchar red\nproperty uchar r\nelement face 1\nproperty list uchar int vertex_indices\n"
                  "property list uchar float uvs\nelement edge 1\nproperty int a\nelement none 0\nproperty int b\n"
                  "end_header\n0 0 0 1 9 9\n1 0 0 1 9 9\n0 1 0 1 9 9\n3 0 1 2 0\n7\n",
            &mesh, &report);
    assert_int_equal(mesh.triangle_count, 1);
    assert_string_equal(report.unread, "confidence of vertex, r of vertex, uvs of face, element edge");
    mesh_source_release(&mesh);
    buffer_puts(&text, ASCII "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n");
    for (int i = 0; i < 100; i++)
        buffer_printf(&text, "property float a-name-that-is-longer-than-any-that-is-shown-%d\n", i);
    buffer_puts(&text, "end_header\n");
    for (int i = 0; i < 103; i++)
        buffer_puts(&text, "1 ");
    read_ok(buffer_text(&text), &mesh, &report);
    assert_true(strlen(report.unread) <= PLY_UNREAD_BYTES_MAX);
    assert_string_equal(report.unread + strlen(report.unread) - 5, ", ...");
    buffer_release(&text);
    mesh_source_release(&mesh);
}

/* ---- binary --------------------------------------------------------------------------------- */

static void put(struct buffer *out, int big, uint64_t bits, size_t size)
{
    for (size_t i = 0; i < size; i++) {
        uint8_t byte = (uint8_t)(bits >> 8 * (big ? size - 1 - i : i));
        buffer_append(out, &byte, 1);
    }
}

static void put_value(struct buffer *out, int big, const char *type, double value)
{
    float single = (float)value;
    uint32_t low;
    uint64_t bits;

    if (strcmp(type, "float") == 0 || strcmp(type, "float32") == 0) {
        memcpy(&low, &single, 4);
        put(out, big, low, 4);
    } else if (strcmp(type, "double") == 0 || strcmp(type, "float64") == 0) {
        memcpy(&bits, &value, 8);
        put(out, big, bits, 8);
    } else {
        put(out, big, (uint64_t)(int64_t)value,
            strstr(type, "char") || strstr(type, "int8")  ? 1
            : strstr(type, "short") || strstr(type, "16") ? 2
                                                          : 4);
    }
}

/* Every scalar type as coordinate, as index and as count, in both byte orders. */
static void binary_in_every_type(void **state)
{
    static const char *const types[] = {"char",  "uchar",  "short",   "ushort", "int",   "uint",
                                        "float", "double", "int8",    "uint8",  "int16", "uint16",
                                        "int32", "uint32", "float32", "float64"};
    static const double xyz[] = {0, 0, 0, 100, 0, 0, 100, 50, 0, 0, 50, 1};
    static const uint32_t wanted[] = {0, 1, 2, 0, 2, 3};

    (void)state;
    for (int big = 0; big < 2; big++)
        for (size_t t = 0; t < sizeof types / sizeof *types; t++) {
            const char *count_type = strstr(types[t], "flo") || strstr(types[t], "dou") ? "int" : types[t];
            struct buffer file = BUFFER_INIT;
            struct mesh_source mesh;
            struct error err = {0};
            buffer_printf(&file,
                          "ply\r\nformat binary_%s_endian 1.0\r\nelement vertex 4\r\n"
                          "property %s x\r\nproperty list %s %s extra\r\nproperty %s y\r\n"
                          "property %s z\r\nelement face 1\r\nproperty uchar flags\r\n"
                          "property list %s %s vertex_index\r\nend_header\r\n",
                          big ? "big" : "little", types[t], count_type, types[t], types[t], types[t], count_type,
                          types[t]);
            for (int v = 0; v < 4; v++) {
                put_value(&file, big, types[t], xyz[3 * v]);
                put_value(&file, big, count_type, v); /* v values to skip */
                for (int i = 0; i < v; i++)
                    put_value(&file, big, types[t], 77);
                put_value(&file, big, types[t], xyz[3 * v + 1]);
                put_value(&file, big, types[t], xyz[3 * v + 2]);
            }
            put(&file, big, 1, 1);
            put_value(&file, big, count_type, 4);
            for (int i = 0; i < 4; i++)
                put_value(&file, big, types[t], i);
            assert_int_equal(ply_read(file.data, file.size, NULL, &mesh, NULL, &err), STATUS_OK);
            assert_int_equal(mesh.triangle_count, 2);
            assert_memory_equal(mesh.indices, wanted, sizeof wanted);
            for (int i = 0; i < 12; i++)
                assert_true(mesh.positions[i] == (float)xyz[i]);
            mesh_source_release(&mesh);
            /* Cut short anywhere it is refused. */
            for (size_t cut = 0; cut < file.size; cut++) {
                uint8_t *copy = mem_memdup(file.data, cut);
                assert_non_null(copy);
                assert_int_equal(ply_read(copy, cut, NULL, &mesh, NULL, &err), STATUS_ERR_INPUT);
                mem_free(copy);
            }
            buffer_release(&file);
        }
}

/* ---- attributes ----------------------------------------------------------------------------- */

static void normals_uv_and_colors(void **state)
{
    struct mesh_source mesh;

    (void)state;
    read_ok(ASCII
            "element vertex 3\nproperty float nx\nproperty float ny\nproperty float nz\n"
            "property float z\nproperty float y\nproperty float x\n"
            "property float s\nproperty float t\nproperty uchar red\nproperty uchar green\n"
            "property uchar blue\nproperty uchar alpha\n" FACES(1) "end_header\n"
                                                                   "0 0 1 3 2 1 0.25 0.75 255 0 188 128\n"
                                                                   "0 0 1 3 3 1 0 0 255 255 255 255\n"
                                                                   "nan 0 1 3 2 2 0 inf 255 255 255 255\n3 0 1 2\n",
            &mesh, NULL);
    assert_true(mesh.positions[0] == 1 && mesh.positions[1] == 2 && mesh.positions[2] == 3);
    assert_true(mesh.normals[2] == 1);
    assert_true(mesh.normals[6] == 0); /* what is not finite */
    assert_true(mesh.uv[0][0] == 0.25f && mesh.uv[0][1] == 0.75f);
    assert_true(mesh.uv[0][5] == 0);
    assert_true(mesh.colors[0] == 1 && mesh.colors[1] == 0);
    assert_float_equal(mesh.colors[2], 0.5029, 1e-3); /* sRGB 188 */
    assert_float_equal(mesh.colors[3], 128.0 / 255, 1e-6);
    mesh_source_flip_v(&mesh);
    assert_true(mesh.uv[0][1] == 0.25f);
    mesh_source_release(&mesh);
}

static void float_colors_are_linear(void **state)
{
    struct mesh_source mesh;

    (void)state;
    read_ok(ASCII VERTICES(3) "property float red\nproperty float green\nproperty float blue\n" FACES(
                1) "end_header\n0 0 0 .5 -1 7\n0 1 0 1 1 nan\n1 0 0 1 1 1\n3 0 1 2\n",
            &mesh, NULL);
    assert_true(mesh.colors[0] == 0.5f && mesh.colors[1] == 0 && mesh.colors[2] == 1);
    assert_true(mesh.colors[3] == 1 && mesh.colors[6] == 0);
    mesh_source_release(&mesh);
    /* All white: as if there were none. */
    read_ok(ASCII VERTICES(3) "property uchar red\nproperty uchar green\nproperty uchar blue\n" FACES(
                1) "end_header\n0 0 0 255 255 255\n0 1 0 255 255 255\n1 0 0 255 255 255\n"
                   "3 0 1 2\n",
            &mesh, NULL);
    assert_null(mesh.colors);
    mesh_source_release(&mesh);
}

/* ---- odd files ------------------------------------------------------------------------------ */

static void faces_may_come_first(void **state)
{
    struct mesh_source mesh;

    (void)state;
    /* The quad is concave: it cannot be cut before the vertices are known. */
    read_ok(ASCII FACES(1) "element material 2\nproperty list int float many\n" VERTICES(
                4) "element edge 1\nproperty int v1\nend_header\n"
                   "4 0 1 2 3\n0\n2 1 2\n0 0 0\n4 0 0\n1 1 0\n0 4 0\nrubbish at the end",
            &mesh, NULL);
    assert_int_equal(mesh.triangle_count, 2);
    for (size_t t = 0; t < 2; t++) {
        const float *a = mesh.positions + 3 * (size_t)mesh.indices[3 * t];
        const float *b = mesh.positions + 3 * (size_t)mesh.indices[3 * t + 1];
        const float *c = mesh.positions + 3 * (size_t)mesh.indices[3 * t + 2];
        assert_true((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0);
    }
    mesh_source_release(&mesh);
}

static void bad_faces_are_dropped(void **state)
{
    struct mesh_source mesh;
    struct ply_report report;

    (void)state;
    read_ok(ASCII VERTICES(3) FACES(6) "element tristrips 0\nproperty list int int vertex_indices\nend_header\n"
                                       "0 0 0\n1 0 0\n0 1 0\n2 0 1\n3 0 1 3\n3 0 1 -1\n3 0 1 .5\n0\n3 2 1 0\n",
            &mesh, &report);
    assert_int_equal(mesh.triangle_count, 1);
    assert_int_equal(mesh.indices[0], 2);
    assert_int_equal(report.faces_invalid, 5);
    mesh_source_release(&mesh);
    /* A cloud of points is a mesh without triangles. */
    read_ok(ASCII VERTICES(1) "end_header\n1 2 3\n", &mesh, &report);
    assert_int_equal(mesh.vertex_count, 1);
    assert_int_equal(mesh.triangle_count, 0);
    mesh_source_release(&mesh);
    read_ok(ASCII VERTICES(0) FACES(0) "end_header\n", &mesh, &report);
    mesh_source_release(&mesh);
}

/* Every second triangle of a strip is turned round, and a negative number begins a new strip. A triangle that has one corner
 * twice is left out. */
static void strips_are_triangles(void **state)
{
    static const uint32_t wanted[] = {0, 1, 2, 2, 1, 3, 2, 3, 4, 5, 6, 7, 1, 2, 0};
    struct mesh_source mesh;
    struct ply_report report;

    (void)state;
    read_ok(ASCII VERTICES(8) "element odd 1\nproperty int n\nelement tristrips 2\nproperty list int int vertex_indices\n"
                              "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
                              "0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 2 0\n5 0 0\n6 0 0\n5 1 0\n7\n"
                              "11 0 1 2 3 4 -1 5 6 7 7 7\n3 -1 0 1\n3 1 2 0\n",
            &mesh, &report);
    assert_int_equal(mesh.triangle_count, 5);
    assert_memory_equal(mesh.indices, wanted, sizeof wanted);
    assert_int_equal(report.faces_invalid, 0);
    mesh_source_release(&mesh);
    read_ok(ASCII VERTICES(3) "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
                              "0 0 0\n1 0 0\n0 1 0\n4 0 1 2 9\n",
            &mesh, &report);
    assert_int_equal(mesh.triangle_count, 1);
    assert_int_equal(report.faces_invalid, 1);
    mesh_source_release(&mesh);
    refuse_text(ASCII VERTICES(3) "element tristrips 1\nproperty list int int v\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
                STATUS_ERR_INPUT, "element tristrips lacks the list vertex_indices");
}

static void liars_are_refused(void **state)
{
    (void)state;
    refuse("", 0, STATUS_ERR_INPUT, "cut short");
    refuse_text("plx\nend_header\n", STATUS_ERR_INPUT, "not a PLY");
    refuse_text("ply\nformat ascii 1.0\n", STATUS_ERR_INPUT, "end_header");
    refuse_text("ply\nend_header\n", STATUS_ERR_INPUT, "format");
    refuse_text("ply\nformat ascii 2.0\nend_header\n", STATUS_ERR_UNSUPPORTED, "line 2");
    refuse_text(ASCII "end_header\n", STATUS_ERR_INPUT, "vertex");
    refuse_text(ASCII "elemen vertex 2\n", STATUS_ERR_INPUT, "line 3");
    refuse_text(ASCII "element vertex -2\nend_header\n", STATUS_ERR_INPUT, "line 3");
    refuse_text(ASCII "element vertex\nend_header\n", STATUS_ERR_INPUT, "line 3");
    refuse_text(ASCII "property float x\nend_header\n", STATUS_ERR_INPUT, "before any element");
    refuse_text(ASCII "element vertex 1\nproperty quad x\n", STATUS_ERR_INPUT, "known type");
    refuse_text(ASCII "element vertex 1\nproperty list float int x\n", STATUS_ERR_INPUT, "known type");
    refuse_text(ASCII "element vertex 1\nproperty float x\nend_header\n1\n", STATUS_ERR_INPUT, "lacks x, y or z");
    refuse_text(ASCII VERTICES(1) "element face 1\nproperty int a\nend_header\n1 1 1 5\n", STATUS_ERR_INPUT,
                "vertex_indices");
    refuse_text(ASCII VERTICES(1) "end_header\n1 b 3\n", STATUS_ERR_INPUT, "line 8");
    refuse_text(ASCII VERTICES(1) "end_header\n1 2 nan\n", STATUS_ERR_INPUT, "vertex 0");
    refuse_text(ASCII VERTICES(1) "end_header\n1 2 1e16\n", STATUS_ERR_INPUT, "vertex 0");
    refuse_text(ASCII VERTICES(4000000000) "end_header\n1 2 3\n", STATUS_ERR_INPUT, "cut short");
    refuse_text(ASCII VERTICES(99999999999) "end_header\n1 2 3\n", STATUS_ERR_LIMIT, "too many");
    refuse_text(ASCII VERTICES(1) FACES(9999999999) "end_header\n1 2 3\n", STATUS_ERR_INPUT, "cut short");
    refuse_text(ASCII VERTICES(1) FACES(1) "end_header\n1 2 3\n4000000000 1", STATUS_ERR_INPUT, "cut short");
    refuse_text(ASCII VERTICES(1) FACES(1) "end_header\n1 2 3\n-1 1", STATUS_ERR_INPUT, "list");
}

static void plain_origin(void *user, const double first[3], double origin[3])
{
    (void)user;
    mesh_origin_choose(first, origin);
}

/* ---- what faces say of their corners ---------------------------------------------------------- */

/* The attributes of corner `i` of the triangles. */
static const float *at_corner(const struct mesh_source *mesh, const float *array, size_t width, size_t i)
{
    return array + width * mesh->indices[i];
}

static void corners_have_texture_coordinates(void **state)
{
    /* Beside vertex 0 of the first face, that of the second has another place in the picture. The list may come first. */
    static const char *const files[] = {
        ASCII "comment TextureFile  my skin.png \n" VERTICES(4) FACES(2) "property list uchar float texcoord\n"
              "end_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 6 0 0 1 0 1 1\n3 0 2 3 6 .5 0 1 1 0 1\n",
        ASCII "comment TextureFile my skin.png\ncomment TextureFile other.png\n" VERTICES(4) "element face 2\n"
              "property list uchar float texcoord\nproperty list uchar int vertex_indices\nproperty int texnumber\n"
              "end_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n6 0 0 1 0 1 1 3 0 1 2 0\n6 .5 0 1 1 0 1 3 0 2 3 1\n"};
    static const float wanted[6][2] = {{0, 0}, {1, 0}, {1, 1}, {.5f, 0}, {1, 1}, {0, 1}};
    static const float places[6][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 0, 0}, {1, 1, 0}, {0, 1, 0}};

    (void)state;
    for (size_t k = 0; k < 2; k++) {
        struct mesh_source mesh;
        struct ply_report report;

        read_ok(files[k], &mesh, &report);
        assert_int_equal(mesh.vertex_count, 5); /* vertex 2 is the same for both */
        assert_non_null(mesh.uv[0]);
        for (size_t i = 0; i < 6; i++) {
            assert_memory_equal(at_corner(&mesh, mesh.uv[0], 2, i), wanted[i], sizeof wanted[i]);
            assert_memory_equal(at_corner(&mesh, mesh.positions, 3, i), places[i], sizeof places[i]);
        }
        assert_string_equal(report.texture, "my skin.png");
        assert_int_equal(report.faces_elsewhere, k);
        assert_int_equal(report.texcoords_odd, 0);
        mesh_source_release(&mesh);
    }
}

/* Too many, too few, none, and a face that is left out: the other corners keep their own. */
static void odd_lists_of_texture_coordinates(void **state)
{
    struct mesh_source mesh;
    struct ply_report report;

    (void)state;
    read_ok(ASCII VERTICES(3) FACES(5) "property list uchar float texcoord\n"
            "end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 8 1 1 1 1 1 1 9 9\n3 0 1 2 2 2 2\n3 0 1 7 6 4 4 4 4 4 4\n"
            "3 0 1 2 0\n3 0 1 2 6 3 3 3 3 3 3\n",
            &mesh, &report);
    assert_int_equal(mesh.triangle_count, 4);
    assert_int_equal(report.faces_invalid, 1);
    assert_int_equal(report.texcoords_odd, 3);
    for (size_t i = 0; i < 12; i++) {
        static const float wanted[] = {1, 1, 1, 2, 0, 0, 0, 0, 0, 3, 3, 3};
        assert_true(at_corner(&mesh, mesh.uv[0], 2, i)[0] == wanted[i]);
        assert_true(at_corner(&mesh, mesh.uv[0], 2, i)[1] == wanted[i]);
    }
    mesh_source_release(&mesh);
    /* A corner that is like one behind others that were met before. */
    read_ok(ASCII VERTICES(4) FACES(3) "property list uchar float texcoord\n"
            "end_header\n0 0 0\n1 0 0\n2 2 0\n3 0 3\n3 0 1 2 6 0 0 1 0 2 2\n3 0 2 3 6 0 0 2 2 3 0\n3 3 1 0 6 3 0 1 0 0 0\n",
            &mesh, &report);
    assert_int_equal(mesh.vertex_count, 4);
    for (size_t i = 0; i < 9; i++) {
        static const float x[] = {0, 1, 2, 0, 2, 3, 3, 1, 0};
        assert_true(at_corner(&mesh, mesh.positions, 3, i)[0] == x[i] && at_corner(&mesh, mesh.uv[0], 2, i)[0] == x[i]);
    }
    mesh_source_release(&mesh);
}

static void faces_have_colors(void **state)
{
    static const char colored[] = ASCII VERTICES(4)
        FACES(2) "property uchar red\nproperty uchar green\nproperty uchar blue\nelement tristrips 1\n"
                 "property list uchar int vertex_indices\n"
                 "end_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 255 0 0\n3 0 2 3 0 255 0\n3 0 1 3\n";
    const struct ply_origin plain = {plain_origin, NULL, 1};
    struct mesh_source mesh;
    struct ply_report report;
    struct error err = {0};

    (void)state;
    read_ok(colored, &mesh, &report);
    assert_int_equal(mesh.triangle_count, 3);
    for (size_t i = 0; i < 9; i++) { /* a strip has none: white */
        const float *rgba = at_corner(&mesh, mesh.colors, 4, i);
        assert_true(rgba[0] == (i / 3 != 1) && rgba[1] == (i / 3 != 0) && rgba[2] == (i / 3 == 2) && rgba[3] == 1);
    }
    mesh_source_release(&mesh);
    assert_int_equal(ply_read(colored, sizeof colored - 1, &plain, &mesh, NULL, &err), STATUS_OK);
    assert_int_equal(mesh.vertex_count, 4);
    assert_null(mesh.colors);
    mesh_source_release(&mesh);
    read_ok(ASCII VERTICES(3) "property uchar red\nproperty uchar green\nproperty uchar blue\n" FACES(
                1) "property uchar red\nend_header\n0 0 0 0 0 255\n1 0 0 0 0 255\n0 1 0 0 0 255\n3 0 1 2 255\n",
            &mesh, &report);
    assert_true(mesh.colors[0] == 0 && mesh.colors[2] == 1);
    assert_int_equal(report.face_colors_unread, 1);
    mesh_source_release(&mesh);
}

static void headers_have_limits(void **state)
{
    struct buffer file = BUFFER_INIT;

    (void)state;
    buffer_puts(&file, ASCII);
    for (int i = 0; i <= PLY_ELEMENTS_MAX; i++)
        buffer_printf(&file, "element e%d 0\n", i);
    refuse(file.data, file.size, STATUS_ERR_LIMIT, "elements");
    buffer_clear(&file);
    buffer_puts(&file, ASCII "element vertex 1\n");
    for (int i = 0; i <= PLY_PROPERTIES_MAX; i++)
        buffer_printf(&file, "property float p%d\n", i);
    refuse(file.data, file.size, STATUS_ERR_LIMIT, "properties");
    buffer_clear(&file);
    buffer_puts(&file, "ply\ncomment ");
    for (int i = 0; i < PLY_HEADER_LINE_BYTES_MAX; i++)
        buffer_puts(&file, "x");
    buffer_puts(&file, "\n");
    refuse(file.data, file.size, STATUS_ERR_LIMIT, "longer");
    buffer_release(&file);
}

static status read_a_face(void *user)
{
    static const char text[] = ASCII VERTICES(5)
        FACES(1) "property list uchar float texcoord\nproperty uchar red\nend_header\n0 0 0\n1 0 0\n1 1 0\n"
                 "0.5 0.5 0\n0 1 0\n5 0 1 2 3 4 10 0 0 1 0 1 1 .5 .5 0 1 9\n";
    struct mesh_source mesh;
    struct error err = {0};
    status result = ply_read(text, sizeof text - 1, NULL, &mesh, NULL, &err);

    (void)user;
    mesh_source_release(&mesh);
    return result;
}

static void out_of_memory_ends_it(void **state)
{
    (void)state;
    assert_true(starve_each(read_a_face, NULL, 0) > 5);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ascii_quad),
        cmocka_unit_test(binary_in_every_type),
        cmocka_unit_test(normals_uv_and_colors),
        cmocka_unit_test(float_colors_are_linear),
        cmocka_unit_test(faces_may_come_first),
        cmocka_unit_test(bad_faces_are_dropped),
        cmocka_unit_test(strips_are_triangles),
        cmocka_unit_test(liars_are_refused),
        cmocka_unit_test(corners_have_texture_coordinates),
        cmocka_unit_test(odd_lists_of_texture_coordinates),
        cmocka_unit_test(faces_have_colors),
        cmocka_unit_test(the_rest_is_named),
        cmocka_unit_test(headers_have_limits),
        cmocka_unit_test(out_of_memory_ends_it),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
