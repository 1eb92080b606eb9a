/* OBJ and MTL: indices, groups, normals and smoothing, odd text, materials and their maps, and
 * files that are missing or broken. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "client/import/import.h"
#include "common/base/buffer.h"
#include "common/system/file.h"
#include "common/base/memory.h"
#include "common/image/image.h"
#include "tests/support/gltf_maker.h"
#include "tests/support/scratch_folder.h"
#include "tests/support/starve.h"

static char folder[SCRATCH_PATH];
static char made[16][64]; /* files to delete */
static int made_count;

static int make_folder(void **state)
{
    (void)state;
    scratch_folder(folder);
    return 0;
}

static int delete_folder(void **state)
{
    (void)state;
    for (int i = 0; i < made_count; i++)
        unlink(made[i]);
    return rmdir(folder);
}

static void write_file(const char *name, const void *data, size_t size)
{
    struct error err = {0};
    char path[64];
    int known = 0;

    snprintf(path, sizeof path, "%s/%s", folder, name);
    assert_int_equal(file_write_atomic(path, data, size, &err), STATUS_OK);
    for (int i = 0; i < made_count; i++)
        known |= strcmp(made[i], path) == 0;
    if (!known)
        memcpy(made[made_count++], path, sizeof path);
}

static void import(const char *text, struct import_result *out)
{
    struct error err = {0};
    status result = import_scene_memory(text, strlen(text), "test.obj", folder, &defaults, out, &err);

    if (result != STATUS_OK)
        print_message("%s\n", err.text);
    assert_int_equal(result, STATUS_OK);
}

static void refuse(const char *text, size_t size, const char *words)
{
    struct import_result result;
    struct error err = {0};

    assert_int_not_equal(import_scene_memory(text, size, "test.obj", folder, &defaults, &result, &err), STATUS_OK);
    assert_says(&err, words);
}

/* A warning that begins with the place holds the words. */
static void assert_warned_at(const struct import_result *result, const char *place, const char *words)
{
    for (size_t i = 0; i < result->warning_count; i++)
        if (strncmp(result->warnings[i], place, strlen(place)) == 0 && strstr(result->warnings[i], words))
            return;
    for (size_t i = 0; i < result->warning_count; i++)
        print_error("warning: %s\n", result->warnings[i]);
    fail_msg("no warning of %s says \"%s\"", place, words);
}

#define QUAD "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"

/* ---- geometry ------------------------------------------------------------------------------- */

static void quad_in_every_spelling(void **state)
{
    static const char *const texts[] = {
        QUAD "f 1 2 3 4\n",
        QUAD "f -4 -3 -2 -1",
        QUAD "f 1// 2// 3// 4//\n",
        "\xef\xbb\xbf# text\r\nv  0 0\t0 \r\nv 1 0 0\r\nv 1 1 0\r\nv 0 1 0\r\n\r\nf 1 2 3 4\r\n",
        "v 0 0 0\rv 1 0 0\rv 1 1 0\rv 0 1 0\rf 1 2 3 4\r",
        QUAD "f 1 2 \\\n 3 \\\r\n4\n",
        "v 0 0 0\nf 1 2 3 4\nv 1 0 0 # after the face\nv 1.0e0 1 0 1.0\nv 0 1 -0\n",
        "V 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nF 1 2 3 4\n",
    };
    static const float wanted[] = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};
    static const uint32_t indices[] = {0, 1, 2, 0, 2, 3};

    (void)state;
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        struct import_result result;
        struct mesh_view view;
        import(texts[i], &result);
        assert_int_equal(result.scene.mesh_count, 1);
        assert_int_equal(result.scene.instance_count, 1);
        view = view_mesh(&result, 0);
        assert_int_equal(view.mesh->vertex_count, 4);
        assert_memory_equal(view.positions, wanted, sizeof wanted);
        assert_memory_equal(view.indices, indices, sizeof indices);
        import_result_release(&result);
    }
}

/* Places, texture coordinates and normals are each counted from the end of their own list, as it is at the face. */
static void corners_from_the_end(void **state)
{
    static const char lists[] = QUAD "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt .5 .5\nvn 0 0 1\nvn 0 1 0\nvn 1 0 0\n";
    static const char more[] = "v 9 9 9\nvt .25 .75\nvt .75 .25\nvn -1 0 0\nvn 0 -1 0\nvn 0 0 -1\n";
    static const char *const faces[][2] = {
        {"f 1/2/1 2/3/2 3/4/3 4/5/1\n", "f -4/-4/-3 -3/-3/-2 -2/-2/-1 -1/-1/-3\n"},
        {"f 1//3 2//2 3//1\n", "f -4//-1 -3//-2 -2//-3\n"},
        {"f 1/5 3/4 4/1\n", "f -4/-1 -2/-2 -1/-5\n"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof faces / sizeof *faces; i++) {
        struct digest digests[2];
        for (int way = 0; way < 2; way++) {
            struct import_result result;
            char text[512];
            snprintf(text, sizeof text, "%s%s%s", lists, faces[i][way], more);
            import(text, &result);
            assert_int_equal(result.scene.mesh_count, 1);
            digests[way] = result.scene.meshes[0].blob.digest;
            import_result_release(&result);
        }
        assert_true(digest_equal(&digests[0], &digests[1]));
    }
}

static void very_long_line(void **state)
{
    struct buffer text = BUFFER_INIT;
    struct import_result result;
    const int corners = 5000;

    (void)state;
    for (int i = 0; i < corners; i++) {
        double angle = 6.283185307179586 * i / corners;
        buffer_printf(&text, "v %.9f %.9f 0\n", cos(angle), sin(angle));
    }
    buffer_puts(&text, "f");
    for (int i = 0; i < corners; i++)
        buffer_printf(&text, " %*d", 40, i + 1);
    import(buffer_text(&text), &result);
    assert_int_equal(result.triangles, corners - 2);
    import_result_release(&result);
    buffer_release(&text);
}

static void attributes_make_vertices(void **state)
{
    struct import_result result;
    struct mesh_view view;

    (void)state;
    import(QUAD "vt 0 0.25\nvt 1 1 0\nvn 0 0 2\nvn 1 0 0\n"
                "f 1/1/1 2/2/1 3/1/1\nf 1/1/1 3/1/1 4/2/2\nf 1//1 2//1 4//1\n",
           &result);
    view = view_mesh(&result, 0);
    /* (1 1 1) is shared by two faces, (1 - 1) is another. */
    assert_int_equal(view.mesh->vertex_count, 7);
    assert_float_equal(view.uv0[1], 0.75, 1e-6); /* v from the top */
    assert_float_equal(view.normals[2], 1, 1e-6);
    import_result_release(&result);
}

static void groups_and_materials_make_meshes(void **state)
{
    struct import_result result;

    (void)state;
    import(QUAD "v 0 0 1\no one\nf 1 2 3\no two\nf 1 2 4\ng three\nf 1 2 5\no one\nf 2 3 4\n"
                "usemtl nowhere\nf 1 3 5\n",
           &result);
    assert_int_equal(result.scene.mesh_count, 4);
    assert_string_equal(result.scene.instances[0].name, "one");
    assert_int_equal(result.scene.meshes[0].triangle_count, 2);
    assert_string_equal(result.scene.instances[2].name, "three");
    assert_string_equal(result.scene.instances[3].name, "one");
    assert_warned_at(&result, "test.obj:15", "nowhere");
    import_result_release(&result);
}

static void vertex_colors(void **state)
{
    struct import_result result;
    struct mesh_view view;

    (void)state;
    import("v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0 0.5 0.5 0.5\nf 1 2 3\n", &result);
    view = view_mesh(&result, 0);
    assert_non_null(view.colors);
    assert_float_equal(view.colors[0], 1, 1e-6);
    assert_float_equal(view.colors[1], 0, 1e-6);
    assert_float_equal(view.colors[5], 1, 1e-6);
    assert_float_equal(view.colors[8], 0.2140, 1e-3); /* sRGB 0.5 */
    assert_float_equal(result.scene.materials[0].base_color[0], 1, 0);
    import_result_release(&result);
}

/* Colours of 0 to 255 are read as if they were 0 to 1, with a warning; those that are only bright are clamped. */
static void vertex_colors_of_255(void **state)
{
    struct import_result result;
    struct mesh_view view;

    (void)state;
    import("v 0 0 0 255 0 51\nv 1 0 0 1 1 1\nv 0 1 0\nf 1 2 3\n", &result);
    assert_warned_at(&result, "test.obj: ", "vertex colours go up to 255");
    view = view_mesh(&result, 0);
    assert_true(view.colors[0] == 1 && view.colors[1] == 0);
    assert_float_equal(view.colors[2], 0.0331, 1e-4); /* sRGB 0.2 */
    assert_float_equal(view.colors[4], 0.000304, 1e-6);
    assert_true(view.colors[8] == 1 && view.colors[3] == 1);
    import_result_release(&result);
    import("v 0 0 0 3 0 0.5\nv 1 0 0 255 1 1\nv 0 1 0\nf 1 2 3\n", &result);
    assert_false(warned(&result, "vertex colours"));
    assert_true(view_mesh(&result, 0).colors[0] == 1);
    import_result_release(&result);
}

/* A tent of two slopes that meet at a right angle along x = 0. */
#define TENT "v -1 0 0\nv 0 0 1\nv 0 1 1\nv -1 1 0\nv 1 0 0\nv 1 1 0\n"

static void smoothing(void **state)
{
    static const struct {
        const char *text;
        int has_normals;
        int ridge_is_round;
    } cases[] = {
        {TENT "s 1\nf 1 2 3 4\nf 2 5 6 3\n", 1, 1},
        {TENT "s 1\nf 1 2 3 4\ns 2\nf 2 5 6 3\n", 1, 0},
        {TENT "s off\nf 1 2 3 4\nf 2 5 6 3\n", 0, 0},
        {TENT "s 0\nf 1 2 3 4\ns on\nf 2 5 6 3\n", 1, 0},
        {TENT "f 1 2 3 4\nf 2 5 6 3\n", 1, 0}, /* sharper than the crease */
        {"v -1 0 0\nv 0 0 0.2\nv 0 1 0.2\nv -1 1 0\nv 1 0 0\nv 1 1 0\nf 1 2 3 4\nf 2 5 6 3\n", 1, 1},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct import_result result;
        struct mesh_view view;
        import(cases[i].text, &result);
        view = view_mesh(&result, 0);
        assert_int_equal(view.normals != NULL, cases[i].has_normals);
        for (size_t v = 0; view.normals && v < view.mesh->vertex_count; v++)
            if (view.positions[3 * v] == 0)
                assert_int_equal(fabsf(view.normals[3 * v]) < 1e-6f, cases[i].ridge_is_round);
        import_result_release(&result);
    }
}

/* Smoothing does not stop where the material changes. */
static void smoothing_crosses_materials(void **state)
{
    struct import_result result;

    (void)state;
    import(TENT "s 1\nusemtl a\nf 1 2 3 4\nusemtl b\nf 2 5 6 3\n", &result);
    assert_int_equal(result.scene.mesh_count, 2);
    for (uint32_t m = 0; m < 2; m++) {
        struct mesh_view view = view_mesh(&result, m);
        for (size_t v = 0; v < 4; v++)
            if (view.positions[3 * v] == 0)
                assert_float_equal(view.normals[3 * v + 2], 1, 1e-6);
    }
    import_result_release(&result);
}

static void what_cannot_be_drawn_is_warned_of(void **state)
{
    struct import_result result;

    (void)state;
    import(QUAD "v nan 0 0\nv 1 2\nf 1 2 3\nf 1 2 9\nf 1 2 -9\nf 0 1 2\nf 1 2 5\nf 1 2 6\nf 1 2\n"
                "f 1/7/7 2/7/7 3/7/7\nl 1 2\np 1\ncstype bezier\ncurv2 1 2\nwobble 1\ncall x.obj\n"
                "f 1 b 3\nbevel off\nusemap x\n",
           &result);
    assert_int_equal(result.triangles, 2);
    assert_warned_at(&result, "test.obj:5", "finite");
    assert_warned_at(&result, "test.obj:8", "names a vertex");
    assert_warned_at(&result, "test.obj:13", "three corners");
    assert_warned_at(&result, "test.obj:14", "vt or vn");
    assert_warned_at(&result, "test.obj:15", "points and lines");
    assert_warned_at(&result, "test.obj:17", "free-form");
    assert_warned_at(&result, "test.obj:19", "wobble");
    assert_warned_at(&result, "test.obj:23", "the statement \"usemap\" is not read");
    import_result_release(&result);
}

static void nothing_left_is_an_error(void **state)
{
    static const char utf16[] = "\xfe\xff\0v\0 \0";

    (void)state;
    refuse(QUAD, strlen(QUAD), "test.obj|nothing to render|4 vertices");
    refuse("v 0 0 0\nf 1 1 1\n", 16, "nothing to render");
    refuse("\xef\xbb\xbf", 3, "nothing to render");
    refuse(utf16, sizeof utf16, "UTF-16");
    refuse("", 0, "empty");
}

/* "1,5" of programs that write numbers as their user's country does. What is no number is said, with its line. */
static void numbers_as_others_write_them(void **state)
{
    struct import_result result;
    struct mesh_view view;

    (void)state;
    import("v 0,0 0,0 0,0\nv 1,5 0 0\nv 1,5e-1, 2.5f 0\nf 1 2 3\n", &result);
    view = view_mesh(&result, 0);
    assert_true(view.positions[3] == 1.5f && view.positions[6] == 1 && view.positions[7] == 2.5f);
    assert_warned_at(&result, "test.obj:1", "decimal commas: \"0,0\" is read as 0 ");
    assert_warned_at(&result, "test.obj:3", "\"1,5e-1,\" is read as far as it is a number");
    import_result_release(&result);
    import("v 0 0 0\nv 1 0 0 1,0\nv 0.5x 1 0\nf 1 2 3\n", &result);
    assert_true(view_mesh(&result, 0).positions[6] == 0.5f);
    assert_warned_at(&result, "test.obj:3", "\"0.5x\"");
    import_result_release(&result);
    refuse(QUAD "f 1,001 2 3\n", strlen(QUAD "f 1,001 2 3\n"), "test.obj:5: a face names a vertex that does not exist (the file has 4), or by no");
}

/* ---- materials ------------------------------------------------------------------------------ */

#define USE(name) "mtllib m.mtl\n" QUAD "vt 0 0\nvt 1 0\nvt 1 1\nusemtl " name "\nf 1/1 2/2 3/3\n"

static void material_of(const char *library, struct import_result *result, struct scene_material *out)
{
    write_file("m.mtl", library, strlen(library));
    import(USE("it"), result);
    *out = result->scene.materials[0];
}

/* The only material of a library as the scene has it. */
static struct scene_material convert(const char *library)
{
    struct import_result result;
    struct scene_material material;

    material_of(library, &result, &material);
    material.name = "";
    import_result_release(&result);
    return material;
}

static void values_become_the_model(void **state)
{
    struct scene_material m;

    (void)state;
    m = convert("newmtl it\nKd 0.1 0.2 0.3\nKa 1 1 1\n");
    assert_float_equal(m.base_color[2], 0.3, 1e-6);
    assert_true(m.specular == 0 && m.metallic == 0 && m.roughness == 1 && m.double_sided);
    assert_int_equal(m.alpha_mode, ALPHA_OPAQUE);
    m = convert("newmtl other\nKd 1 0 0\nnewmtl it\nKd 0 1 0\nnewmtl it\nKd 0 0 1\n");
    assert_true(m.base_color[1] == 1); /* the first of the name */
    m = convert("newmtl it\nillum 2\nKs 0.5 0.5 0.5\nNs 6\n");
    assert_float_equal(m.specular_color[0], 1, 1e-6);
    assert_float_equal(m.roughness, pow(2.0 / 8, 0.25), 1e-6);
    m = convert("newmtl it\nillum 5\nKs 0.5\nNs 1000\n");
    assert_float_equal(m.specular_color[2], 0.5 / 0.04, 1e-4);
    assert_true(m.roughness == 0);
    m = convert("newmtl it\nillum 1\nKs 1 1 1\n");
    assert_true(m.specular == 0);
    m = convert("newmtl it\nKe 7 8 9\n");
    assert_true(m.emission[0] == 7 && m.emission[2] == 9);
    m = convert("newmtl it\nd 0.25\n");
    assert_true(m.alpha_mode == ALPHA_BLEND && m.base_color[3] == 0.25f);
    m = convert("newmtl it\nTr 0.25\n");
    assert_true(m.alpha_mode == ALPHA_BLEND && m.base_color[3] == 0.75f);
    m = convert("newmtl it\nillum 7\nNi 1.33\nTf 0.5 1 1\nKd 0 0 0\n");
    assert_true(m.transmission == 1 && m.refractive && m.ior == 1.33f && m.base_color[0] == 0.5f);
    assert_int_equal(m.alpha_mode, ALPHA_OPAQUE);
    m = convert("newmtl it\nPr 0.3\nPm 0.9\nPc 0.5\nPcr 0.1\nPs 0.2\naniso 0.4\nanisor 1.25\n"
                "Ns 10\nKs 0 0 0\nNi 1.4\n");
    assert_true(m.roughness == 0.3f && m.metallic == 0.9f && m.clearcoat == 0.5f);
    assert_true(m.clearcoat_roughness == 0.1f && m.sheen_color[1] == 0.2f && m.ior == 1.4f);
    assert_true(m.anisotropy == 0.4f && m.specular == 1);
    assert_float_equal(m.anisotropy_rotation_rad, 1.5707963, 1e-5);
    /* Nonsense is within range or left out. */
    m = convert("newmtl it\nKd -1 nan 7\nNs -5\nd 3\nNi 0\nillum 99\nKe -1 1e30 inf\nPm x\nPc 9\n");
    assert_true(m.base_color[0] == 0 && m.base_color[1] == 0 && m.base_color[2] == 1);
    assert_true(m.roughness == 1 && m.metallic == 0 && m.clearcoat == 1);
}

static void mtl_faults_are_warned_of(void **state)
{
    struct import_result result;
    struct scene_material m;

    (void)state;
    material_of("Kd 1 1 1\nnewmtl it\nKd\nfrobnicate 3\nrefl -type sphere x.png\n"
                "map_Kd gone.png\nmap_Ks -s 1 2\n",
                &result, &m);
    assert_warned_at(&result, "m.mtl:1", "newmtl");
    assert_warned_at(&result, "m.mtl:3", "Kd");
    assert_warned_at(&result, "m.mtl:4", "frobnicate");
    assert_warned_at(&result, "m.mtl:5", "refl");
    assert_warned_at(&result, "m.mtl:6", "gone.png");
    assert_true(m.base_color_texture.texture < 0);
    import_result_release(&result);
    import("mtllib none.mtl also none.mtl\n" QUAD "f 1 2 3\n", &result);
    assert_warned_at(&result, "test.obj:1", "none.mtl");
    assert_warned_at(&result, "test.obj:1", "also");
    import_result_release(&result);
    write_file("with space.mtl", "newmtl a b \nKd 1 0 0\n", 21);
    import(QUAD "mtllib with space.mtl\nusemtl a b\nf 1 2 3\n", &result);
    assert_string_equal(result.scene.materials[0].name, "a b");
    assert_true(result.scene.materials[0].base_color[1] == 0);
    import_result_release(&result);
}

static void opacity_counts_once(void **state)
{
    struct import_result result;
    struct scene_material m;

    (void)state;
    material_of("newmtl it\nKd 0,8 0,8 0,8\nd 1.0\nTr 1.0\n", &result, &m);
    assert_true(m.alpha_mode == ALPHA_OPAQUE && m.base_color[0] == 0.8f);
    assert_warned_at(&result, "m.mtl:1", "d 1 and Tr 1 contradict each other: d counts");
    assert_warned_at(&result, "m.mtl:2", "\"0,8\" is read as 0.8");
    import_result_release(&result);
    material_of("newmtl it\nTr 0.75\nd 0.25\n", &result, &m);
    assert_true(m.base_color[3] == 0.25f);
    for (size_t i = 0; i < result.warning_count; i++)
        assert_null(strstr(result.warnings[i], "contradict"));
    import_result_release(&result);
    assert_true(convert("newmtl it\nTr 0.75\n").base_color[3] == 0.25f);
    material_of("newmtl it\nd 0\n", &result, &m);
    assert_warned(&result, "the material \"it\" is invisible: its opacity is 0");
    import_result_release(&result);
}

/* ---- maps ----------------------------------------------------------------------------------- */

/* A PNG of 2 x 2 pixels with these values of each channel. */
static void write_picture_of(const char *name, uint32_t channels, const float *values)
{
    struct image image;
    struct buffer png = BUFFER_INIT;
    struct error err = {0};

    assert_int_equal(image_init(&image, 2, 2, channels, &err), STATUS_OK);
    memcpy(image.pixels, values, 4 * channels * sizeof *values);
    assert_int_equal(png_encode(&png, &image, &err), STATUS_OK);
    write_file(name, png.data, png.size);
    buffer_release(&png);
    image_release(&image);
}

static void write_picture(const char *name, const float rgb[12]) { write_picture_of(name, 3, rgb); }

/* Grey, 8 x 8, higher by 16 codes to the right and by 8 downwards. */
static void write_heights(const char *name)
{
    struct image heights;
    struct buffer png = BUFFER_INIT;
    struct error err = {0};

    assert_int_equal(image_init(&heights, 8, 8, 3, &err), STATUS_OK);
    for (size_t y = 0; y < 8; y++)
        for (size_t x = 0; x < 8; x++)
            for (size_t c = 0; c < 3; c++)
                heights.pixels[3 * (8 * y + x) + c] = (float)(16 * x + 8 * y) / 255;
    assert_int_equal(png_encode(&png, &heights, &err), STATUS_OK);
    write_file(name, png.data, png.size);
    buffer_release(&png);
    image_release(&heights);
}

/* The pixels of the image behind a slot. */
static struct image8 picture_of(const struct import_result *result, const struct scene_texture_slot *slot)
{
    struct image8 image = {0};
    const struct digest *digest;
    struct error err = {0};

    assert_true(slot->texture >= 0);
    digest = &result->scene.images[result->scene.textures[slot->texture].image].blob.digest;
    for (size_t i = 0; i < result->blob_count; i++)
        if (memcmp(&result->blobs[i].digest, digest, sizeof *digest) == 0)
            assert_int_equal(image_decode_8(&image, result->blobs[i].data, result->blobs[i].size_bytes, "blob", &err),
                             STATUS_OK);
    assert_non_null(image.pixels);
    return image;
}

static void maps_become_textures(void **state)
{
    static const float color[12] = {1, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 1};
    static const float steps[12] = {0, 0, 0, 1, 1, 1, 0, 0, 0, 1, 1, 1};
    static const float bumpy[12] = {0.5f, 0.5f, 1, 0.75f, 0.5f, 0.9f, 0.5f, 0.5f, 1, 0.5f, 0.5f, 1};
    struct import_result result;
    struct scene_material m;
    struct image8 picture;

    (void)state;
    write_picture("c.png", color);
    write_picture("g.png", steps);
    write_picture("n.png", bumpy);
    material_of("newmtl it\nKd 0 0 0\nmap_Kd -s 2 3 1 -o 0.5 0.25 -clamp on c.png\n"
                "map_Ke C:\\made\\elsewhere\\c.png\nmap_d -s 2 3 1 -o 0.5 0.25 -clamp on g.png\nmap_Pr g.png\nPm 0.5\n"
                "map_Bump -bm 0.5 n.png\n",
                &result, &m);
    assert_true(m.base_color[0] == 1 && m.emission[0] == 1 && m.metallic == 0.5f);
    assert_true(m.roughness == 1 && m.normal_scale == 0.5f && m.specular == 1);
    assert_int_equal(m.alpha_mode, ALPHA_BLEND);
    assert_float_equal(m.base_color_texture.uv_transform[0][0], 2, 0);
    assert_float_equal(m.base_color_texture.uv_transform[0][2], 0.5, 0);
    assert_float_equal(m.base_color_texture.uv_transform[1][2], 1 - 3 - 0.25, 1e-6);
    assert_int_equal(result.scene.textures[m.base_color_texture.texture].wrap_u, WRAP_CLAMP);
    picture = picture_of(&result, &m.base_color_texture);
    assert_int_equal(picture.channels, 4);
    assert_true(picture.pixels[0] == 255 && picture.pixels[3] == 0 && picture.pixels[7] == 255);
    image8_release(&picture);
    picture = picture_of(&result, &m.metallic_roughness_texture);
    assert_true(picture.pixels[1] == 0 && picture.pixels[5] == 255 && picture.pixels[2] == 255);
    image8_release(&picture);
    assert_true(m.emission_texture.texture >= 0 && m.normal_texture.texture >= 0);
    assert_non_null(view_mesh(&result, 0).tangents);
    import_result_release(&result);
}

/* Expect the channel c of the first row of the slot's image, and that it covers texture coordinates of `scale` and `shift`. */
static void assert_row(const struct import_result *result, const struct scene_texture_slot *slot, uint32_t c,
                       const char *row, double scale, double shift)
{
    struct image8 picture = picture_of(result, slot);

    assert_int_equal(picture.width, strlen(row));
    for (uint32_t x = 0; x < picture.width; x++)
        assert_true(abs(picture.pixels[picture.channels * x + c] - (row[x] == '1' ? 255 : row[x] == 'h' ? 128 : 0)) <= 1);
    assert_float_equal(slot->uv_transform[0][0], scale, 1e-6);
    assert_float_equal(slot->uv_transform[0][2], shift, 1e-6);
    image8_release(&picture);
}

/* Maps that share an image keep their own scales, offsets and channels. */
static void maps_keep_their_options(void **state)
{
    static const float steps[12] = {0, 0, 0, 1, 1, 1, 0, 0, 0, 1, 1, 1};
    static const float packed[12] = {0, 1, 0.5f, 1, 0, 0.5f, 0, 1, 0.5f, 1, 0, 0.5f};
    struct import_result result;
    struct scene_material m;

    (void)state;
    write_picture("s.png", steps);
    write_picture("p.png", packed);
    /* A period of both: that of the one that repeats less, or of several. */
    material_of("newmtl it\nmap_Pr s.png\nmap_Pm -s 2 1 1 s.png\n", &result, &m);
    assert_row(&result, &m.metallic_roughness_texture, 1, "0011", 1, 0);
    assert_row(&result, &m.metallic_roughness_texture, 2, "0101", 1, 0);
    import_result_release(&result);
    material_of("newmtl it\nmap_Pr -s 3 1 1 s.png\nmap_Pm -s 2 1 1 s.png\n", &result, &m);
    assert_row(&result, &m.metallic_roughness_texture, 1, "010101", 1, 0);
    assert_row(&result, &m.metallic_roughness_texture, 2, "011011", 1, 0); /* of 4 texels the nearest to 6 pixels */
    import_result_release(&result);
    material_of("newmtl it\nmap_Pr -o 0.5 0 0 s.png\nmap_Pm s.png\n", &result, &m);
    assert_row(&result, &m.metallic_roughness_texture, 1, "01", 1, 0.5);
    assert_row(&result, &m.metallic_roughness_texture, 2, "10", 1, 0.5);
    import_result_release(&result);
    /* Only one is clamped: right for texture coordinates of 0 to 1, and said. */
    material_of("newmtl it\nmap_Kd -s 2 2 1 -clamp on s.png\nmap_d s.png\n", &result, &m);
    assert_row(&result, &m.base_color_texture, 0, "0111", 1, 0);
    assert_row(&result, &m.base_color_texture, 3, "0011", 1, 0);
    assert_warned_at(&result, "m.mtl:3", "hold together for texture coordinates of 0 to 1 only");
    import_result_release(&result);
    /* The channel that is named, else the mean. */
    material_of("newmtl it\nmap_Pr -imfchan g p.png\nmap_Pm -imfchan b p.png\nmap_d -imfchan r p.png\nbump -imfchan r p.png\n", &result,
                &m);
    assert_row(&result, &m.metallic_roughness_texture, 1, "10", 1, 0);
    assert_row(&result, &m.metallic_roughness_texture, 2, "hh", 1, 0);
    assert_row(&result, &m.base_color_texture, 3, "01", 1, 0);
    assert_true(m.normal_scale == 1);
    import_result_release(&result);
    material_of("newmtl it\nmap_Pr -imfchan z p.png\n", &result, &m);
    assert_row(&result, &m.metallic_roughness_texture, 1, "hh", 1, 0);
    assert_warned_at(&result, "m.mtl:2", "-imfchan z is not applied");
    import_result_release(&result);
}

/* Of a picture with alpha: that, if no channel is named. */
static void a_channel_beside_alpha(void **state)
{
    static const float rgba[16] = {0, 1, 0, 1, 1, 1, 1, 0, 0, 1, 0, 1, 1, 1, 1, 0};
    struct import_result result;
    struct scene_material m;

    (void)state;
    write_picture_of("a.png", 4, rgba);
    material_of("newmtl it\nmap_d -imfchan r a.png\n", &result, &m);
    assert_row(&result, &m.base_color_texture, 3, "01", 1, 0);
    import_result_release(&result);
    material_of("newmtl it\nmap_d a.png\n", &result, &m);
    assert_row(&result, &m.base_color_texture, 3, "10", 1, 0);
    import_result_release(&result);
    material_of("newmtl it\nmap_d -imfchan m a.png\n", &result, &m);
    assert_row(&result, &m.base_color_texture, 3, "10", 1, 0);
    import_result_release(&result);
}

/* A material without its name, and with pictures and samplers in place of textures' numbers. */
static void print_material(struct buffer *to, const struct import_result *result, size_t index)
{
    struct scene_material m = result->scene.materials[index];

    for (size_t i = 0; i < MATERIAL_TEXTURES; i++)
        if (m.textures[i].texture >= 0) {
            const struct scene_texture *t = &result->scene.textures[m.textures[i].texture];
            buffer_append(to, &result->scene.images[t->image].blob.digest, sizeof(struct digest));
            buffer_append(to, &t->wrap_u, sizeof *t - offsetof(struct scene_texture, wrap_u));
            m.textures[i].texture = 0;
        }
    m.name = "";
    buffer_append(to, &m, sizeof m);
}

/* Two materials whose maps name the same pictures: each is what it is alone. */
static void maps_of_two_materials(void **state)
{
    static const float rgba[16] = {0, 1, 0, 1, 1, .5f, .25f, 0, 0, 1, 0, 1, 1, 0, .75f, .5f};
    static const char *const maps[] = {
        "map_Kd a.png", "map_Kd -s 2 2 1 a.png", "map_Kd -clamp on a.png", "map_d a.png", "map_d -imfchan r a.png", "map_Kd a.png\nmap_d a.png",
        "map_Pr a.png", "map_Pm a.png", "map_Pr -mm .5 .5 a.png", "map_Pr a.png\nmap_Pm -imfchan b a.png", "map_Ke a.png", "bump a.png",
        "bump h.png", "bump -bm 2 h.png", "bump -bm .5 h.png", "bump -imfchan g h.png", "norm a.png", "map_Ks a.png", "map_Ns a.png",
    };
    enum { MAPS = sizeof maps / sizeof *maps };
    struct buffer alone[MAPS];
    struct import_result result;
    struct scene_material m;
    char library[512];

    (void)state;
    write_heights("h.png");
    write_picture_of("a.png", 4, rgba);
    for (size_t i = 0; i < MAPS; i++) {
        alone[i] = (struct buffer)BUFFER_INIT;
        snprintf(library, sizeof library, "newmtl it\nKd .5 .5 .5\nillum 2\n%s\n", maps[i]);
        material_of(library, &result, &m);
        print_material(&alone[i], &result, 0);
        import_result_release(&result);
    }
    for (size_t i = 0; i < MAPS * MAPS; i++) {
        const size_t pair[2] = {i / MAPS, i % MAPS};
        snprintf(library, sizeof library, "newmtl one\nKd .5 .5 .5\nillum 2\n%s\nnewmtl two\nKd .5 .5 .5\nillum 2\n%s\n", maps[pair[0]],
                 maps[pair[1]]);
        write_file("m.mtl", library, strlen(library));
        import(USE("one") "usemtl two\nf 1/1 3/3 4/1\n", &result);
        assert_int_equal(result.scene.material_count, 2);
        for (size_t k = 0; k < 2; k++) {
            struct buffer is = BUFFER_INIT;
            print_material(&is, &result, k);
            if (is.size != alone[pair[k]].size || memcmp(is.data, alone[pair[k]].data, is.size) != 0)
                fail_msg("\"%s\" beside \"%s\" is not what it is alone", maps[pair[k]], maps[pair[1 - k]]);
            buffer_release(&is);
        }
        import_result_release(&result);
    }
    for (size_t i = 0; i < MAPS; i++)
        buffer_release(&alone[i]);
}

static int holds_blob(const struct import_result *result, const void *data, size_t size)
{
    for (size_t i = 0; i < result->blob_count; i++)
        if (result->blobs[i].size_bytes == size && memcmp(result->blobs[i].data, data, size) == 0)
            return 1;
    return 0;
}

/* A TGA stays as it is: the workers read it. */
static void a_tga_map_is_kept(void **state)
{
    /* 2x2, bottom row first: blue and white, red and green. */
    static const uint8_t tga[18 + 12] = {0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2, 0, 2, 0, 24, 0,
                                         255, 0, 0, 255, 255, 255, 0, 0, 255, 0, 255, 0};
    static const uint8_t rgb[12] = {255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255};
    struct import_result result;
    struct scene_material m;
    struct image8 picture;

    (void)state;
    write_file("c.tga", tga, sizeof tga);
    material_of("newmtl it\nmap_Kd c.tga\n", &result, &m);
    picture = picture_of(&result, &m.base_color_texture);
    assert_true(picture.width == 2 && picture.height == 2 && picture.channels == 3);
    assert_memory_equal(picture.pixels, rgb, sizeof rgb);
    assert_true(holds_blob(&result, tga, sizeof tga));
    image8_release(&picture);
    import_result_release(&result);
    write_file("c.tga", tga, sizeof tga - 1);
    material_of("newmtl it\nmap_Kd c.tga\n", &result, &m);
    assert_int_equal(m.base_color_texture.texture, -1);
    assert_warned_at(&result, "m.mtl", "cut short");
    import_result_release(&result);
}

/* A ramp that rises to the right leans its normals to the left, in glTF's sense of both axes. */
static void height_maps_become_normal_maps(void **state)
{
    struct import_result result;
    struct scene_material m;
    struct image8 picture;

    (void)state;
    write_heights("h.png");
    material_of("newmtl it\nbump h.png -bm 2\n", &result, &m);
    assert_warned(&result, "h.png -bm 2"); /* options stand before the name */
    import_result_release(&result);
    material_of("newmtl it\nbump -bm 2 h.png\n", &result, &m);
    picture = picture_of(&result, &m.normal_texture);
    for (size_t y = 1; y < 7; y++)
        for (size_t x = 1; x < 7; x++) {
            const uint8_t *p = picture.pixels + 4 * (8 * y + x);
            double du = 16.0 / 255 * 8 * 2, dv = -8.0 / 255 * 8 * 2;
            double length = sqrt(du * du + dv * dv + 1);
            assert_float_equal(p[0], 127.5 - 127.5 * du / length, 4);
            assert_float_equal(p[1], 127.5 - 127.5 * dv / length, 4);
            assert_float_equal(p[2], 127.5 + 127.5 / length, 4);
        }
    image8_release(&picture);
    assert_true(m.normal_scale == 1);
    import_result_release(&result);
}

static void ply_is_a_scene(void **state)
{
    static const char text[] = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
                               "property float z\nproperty float u\nproperty float v\nelement face 2\n"
                               "property list uchar int vertex_indices\nend_header\n"
                               "0 0 0 0 0.25\n1 0 0 1 1\n0 1 0 0 1\n3 0 1 2\n3 0 1 7\n";
    static const char cloud[] = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n"
                                "property float y\nproperty float z\nend_header\n1 2 3\n";
    struct import_result result;
    struct error err = {0};

    (void)state;
    assert_int_equal(import_scene_memory(text, sizeof text - 1, "a.bin", NULL, &defaults, &result, &err), STATUS_OK);
    assert_int_equal(result.triangles, 1);
    assert_float_equal(view_mesh(&result, 0).uv0[1], 0.75, 1e-6);
    assert_warned_at(&result, "a.bin", "1 faces");
    import_result_release(&result);
    assert_int_equal(import_scene_memory(cloud, sizeof cloud - 1, "a.ply", NULL, &defaults, &result, &err),
                     STATUS_ERR_INPUT);
    assert_says(&err, "a.ply|nothing to render");
}

static status read_all_of_it(void *user)
{
    const char *text = user;
    struct import_result out;
    struct error err = {0};
    status result = import_scene_memory(text, strlen(text), "test.obj", folder, &defaults, &out, &err);

    import_result_release(&out);
    return result;
}

static void out_of_memory_is_said(void **state)
{
    static char text[] = "mtllib m.mtl\n" TENT "vt 0 0\nusemtl it\nf 1/1 2/1 3/1 4/1\n"
                         "o b\nf 2 5 6 3\n";
    static const char library[] = "newmtl it\nmap_Kd c.png\nmap_d g.png\nbump g.png\n";

    (void)state;
    write_file("m.mtl", library, sizeof library - 1);
    assert_true(starve_each(read_all_of_it, text, 0) > 50);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(quad_in_every_spelling),
        cmocka_unit_test(corners_from_the_end),
        cmocka_unit_test(very_long_line),
        cmocka_unit_test(attributes_make_vertices),
        cmocka_unit_test(groups_and_materials_make_meshes),
        cmocka_unit_test(vertex_colors),
        cmocka_unit_test(vertex_colors_of_255),
        cmocka_unit_test(smoothing),
        cmocka_unit_test(smoothing_crosses_materials),
        cmocka_unit_test(what_cannot_be_drawn_is_warned_of),
        cmocka_unit_test(nothing_left_is_an_error),
        cmocka_unit_test(numbers_as_others_write_them),
        cmocka_unit_test(values_become_the_model),
        cmocka_unit_test(opacity_counts_once),
        cmocka_unit_test(mtl_faults_are_warned_of),
        cmocka_unit_test(maps_become_textures),
        cmocka_unit_test(maps_keep_their_options),
        cmocka_unit_test(a_channel_beside_alpha),
        cmocka_unit_test(maps_of_two_materials),
        cmocka_unit_test(a_tga_map_is_kept),
        cmocka_unit_test(height_maps_become_normal_maps),
        cmocka_unit_test(ply_is_a_scene),
        cmocka_unit_test(out_of_memory_is_said),
    };

    return cmocka_run_group_tests(tests, make_folder, delete_folder);
}
