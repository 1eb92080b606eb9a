/* Pictures as other programs write them: what is odd is read as most programs read it, and said with the file's name. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "client/import/import.h"
#include "common/system/file.h"
#include "tests/support/gltf_maker.h"
#include "tests/support/imported.h"
#include "tests/support/scratch.h"

#define TRIANGLE "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n"

static void write_text(const char *name, const char *text)
{
    struct error err = {0};

    assert_int_equal(file_write_atomic(path_of(name), text, strlen(text), &err), STATUS_OK);
}

static void import(const char *text, const char *name, const char *env, struct import_result *out)
{
    struct import_options options = defaults;
    struct error err = {0};
    status result;

    options.env_path = env;
    result = import_scene_memory(text, strlen(text), name, folder, &options, out, &err);
    if (result != STATUS_OK)
        print_error("%s\n", err.text);
    assert_int_equal(result, STATUS_OK);
}

/* ---- factors of a Radiance map --------------------------------------------------------------- */

static void exposure_of_zero_is_said(void **state)
{
    static const char *const scenes[][2] = {
        {"test.obj", "mtllib z.mtl\n" TRIANGLE "usemtl m\nf 1/1 2/1 3/1\n"},
        {"test.pbrt", "WorldBegin\nTexture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"zero.hdr\"\n"
                      "Material \"diffuse\" \"texture reflectance\" \"t\"\nShape \"sphere\"\n"},
    };
    struct import_result result;

    (void)state;
    write_text("zero.hdr", "#?RADIANCE\n# Made with FreeImage 3.17.0\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=0\n\n-Y 1 +X 2\n"
                           "\200\100\040\201\200\200\200\200");
    write_text("z.mtl", "newmtl m\nmap_Kd zero.hdr\n");
    for (size_t i = 0; i < 2; i++) {
        import(scenes[i][1], scenes[i][0], NULL, &result);
        assert_warned(&result, "zero.hdr: its EXPOSURE or COLORCORR line is not a positive number: taken as 1");
        import_result_release(&result);
    }
    import(TRIANGLE "f 1 2 3\n", "test.obj", path_of("zero.hdr"), &result);
    assert_warned(&result, "zero.hdr: its EXPOSURE or COLORCORR line is not a positive number: taken as 1");
    import_result_release(&result);
}

/* ---- pictures that cannot be had ------------------------------------------------------------- */

#define GLTF(images, material)                                                                                        \
    "{\"asset\":{\"version\":\"2.0\"},\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0}],"                              \
    "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"material\":0}]}],"                                   \
    "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"type\":\"VEC3\",\"count\":3}],"                           \
    "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36}],\"buffers\":[{\"byteLength\":36,\"uri\":\"data:;base64,"         \
    "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA\"}],\"textures\":[{\"source\":0}],\"images\":[" images             \
    "],\"materials\":[{" material "}]}"
#define COLORED "\"pbrMetallicRoughness\":{\"baseColorFactor\":[0.5,0.25,1,1],\"baseColorTexture\":{\"index\":0}}"

static void missing_pictures_are_left_out(void **state)
{
    static const struct {
        const char *name, *text;
        float color[3];
        const char *words;
    } cases[] = {
        {"a.gltf", GLTF("{\"uri\":\"gone.png\"}", COLORED), {0.5f, 0.25f, 1}, "a.gltf: the texture \"gone.png\" cannot be used (images[0]: "},
        {"a.gltf", GLTF("{\"name\":\"w\",\"uri\":\"data:;base64,Qk0AAAAAAAAAAAAA\"}", COLORED), {0.5f, 0.25f, 1},
         "a.gltf: the texture \"w\" cannot be used (images[0]: w is a BMP file"},
        {"a.obj", "mtllib gone.mtl\n" TRIANGLE "usemtl m\nf 1/1 2/1 3/1\n", {0.5f, 0.25f, 1},
         "gone.mtl:3: the texture \"gone.png\" cannot be used ("},
        {"a.pbrt",
         "WorldBegin\nTexture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"gone.png\"\n"
         "Material \"diffuse\" \"texture reflectance\" \"t\"\nShape \"sphere\"\n",
         {0.5f, 0.5f, 0.5f}, "a.pbrt:2: the texture \"gone.png\" cannot be used (the file \"gone.png\" does not exist): left out"},
        {"a.pbrt",
         "WorldBegin\nTexture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"gone.mtl\"\n"
         "Material \"diffuse\" \"texture reflectance\" \"t\"\nShape \"sphere\"\n",
         {0.5f, 0.5f, 0.5f}, "a.pbrt:2: the texture \"gone.mtl\" cannot be used (it has a form that is not read: "},
    };

    (void)state;
    write_text("gone.mtl", "newmtl m\nKd 0.5 0.25 1\nmap_Kd gone.png\n");
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct import_options strict = defaults;
        struct import_result result;
        struct error err = {0};

        import(cases[i].text, cases[i].name, NULL, &result);
        assert_warned(&result, cases[i].words);
        assert_floats(result.scene.materials[0].base_color, cases[i].color, 3, 0);
        assert_int_equal(result.scene.materials[0].base_color_texture.texture, -1);
        import_result_release(&result);
        strict.strict = 1;
        assert_int_not_equal(import_scene_memory(cases[i].text, strlen(cases[i].text), cases[i].name, folder, &strict,
                                                 &result, &err),
                             STATUS_OK);
        assert_memory_equal(err.text, cases[i].words, strcspn(cases[i].words, " "));
    }
}

#define PLY(comment)                                                                                                  \
    "ply\nformat ascii 1.0\ncomment VCGLIB generated\ncomment " comment "\nelement vertex 3\nproperty float x\n"           \
    "property float y\nproperty float z\nproperty float s\nproperty float t\nproperty uchar red\n"                      \
    "property uchar green\nproperty uchar blue\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"  \
    "0 0 0 0 0 9 9 9\n1 0 0 1 0 9 9 9\n0 1 0 0 1 9 9 9\n3 0 1 2\n"

/* Files of which the beginning is there. */
static const struct {
    const char *name, *reason;
    size_t size;
    const char *bytes;
} damaged[] = {
    {"bad.png", "bad.png: ", 33, "\211PNG\r\n\032\n\0\0\0\rIHDR\0\0\0\001\0\0\0\001\010\002\0\0\0\220wS\336"},
    {"bad.jpg", "bad.jpg: ", 12, "\377\330\377\340\0\020JFIF\0\001"},
    {"bad.exr", "bad.exr: ", 12, "v/1\001\002\0\0\0chan"},
    {"bad.hdr", "bad.hdr: ", 49, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 9 +X 8\n\200\200"},
};

enum { FILLED = 1500 };

/* `text` with `name` where it has an @. */
static void fill(char out[FILLED], const char *text, const char *name)
{
    const char *at = strchr(text, '@');

    snprintf(out, FILLED, "%.*s%s%s", (int)(at - text), text, name, at + 1);
}

/* As a picture that is missing: the same scene, and a warning that says what is wrong with it. */
static void damaged_pictures_are_left_out(void **state)
{
    static const struct {
        const char *name, *text, *place;
    } cases[] = {
        {"a.gltf", GLTF("{\"uri\":\"@\"}", COLORED), "a.gltf"},
        {"a.gltf", GLTF("{\"uri\":\"@\"}", "\"emissiveFactor\":[1,1,1],\"emissiveTexture\":{\"index\":0}"), "a.gltf"},
        {"a.gltf",
         GLTF("{\"uri\":\"@\"}", "\"extensions\":{\"KHR_materials_pbrSpecularGlossiness\":{"
                                 "\"specularGlossinessTexture\":{\"index\":0}}}"),
         "a.gltf"},
        {"a.obj", "mtllib @.mtl\n" TRIANGLE "usemtl m\nf 1/1 2/1 3/1\n", ".mtl:3"},
        {"a.ply", PLY("TextureFile @"), "a.ply"},
        {"a.pbrt",
         "WorldBegin\nTexture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"@\"\n"
         "Material \"diffuse\" \"texture reflectance\" \"t\"\nShape \"sphere\"\n",
         "a.pbrt:2"},
        {"a.pbrt",
         "WorldBegin\nTexture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"@\"\n"
         "Texture \"s\" \"spectrum\" \"checkerboard\" \"texture tex1\" \"t\"\n"
         "Material \"diffuse\" \"texture reflectance\" \"s\"\nShape \"sphere\"\n",
         "a.pbrt:2"},
        {"a.pbrt", "WorldBegin\nLightSource \"goniometric\" \"string filename\" \"@\"\nShape \"sphere\"\n", "a.pbrt:2"},
        {"a.pbrt", "WorldBegin\nLightSource \"infinite\" \"string filename\" \"@\"\nShape \"sphere\"\n", "a.pbrt:2"},
    };

    (void)state;
    for (size_t k = 0; k < sizeof damaged / sizeof *damaged; k++) {
        char mtl[2][40], library[100];
        struct error err = {0};

        assert_int_equal(file_write_atomic(path_of(damaged[k].name), damaged[k].bytes, damaged[k].size, &err), STATUS_OK);
        for (int gone = 0; gone < 2; gone++) {
            const char *picture = gone ? "gone.png" : damaged[k].name;
            snprintf(mtl[gone], sizeof mtl[gone], "%s.mtl", picture);
            snprintf(library, sizeof library, "newmtl m\nKd 0.5 0.25 1\nmap_Kd %s\n", picture);
            write_text(mtl[gone], library);
        }
        for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
            struct import_options strict = defaults;
            struct import_result result, missing;
            char text[2][FILLED], words[200];

            fill(text[0], cases[i].text, damaged[k].name);
            fill(text[1], cases[i].text, "gone.png");
            snprintf(words, sizeof words, "%s: the texture \"%s\" cannot be used (%s", cases[i].place, damaged[k].name,
                     damaged[k].reason);
            import(text[0], cases[i].name, NULL, &result);
            import(text[1], cases[i].name, NULL, &missing);
            assert_warned(&result, words);
            assert_int_equal(result.warning_count, missing.warning_count);
            assert_memory_equal(&result.scene_digest, &missing.scene_digest, sizeof result.scene_digest);
            import_result_release(&missing);
            import_result_release(&result);
            strict.strict = 1;
            assert_int_not_equal(import_scene_memory(text[0], strlen(text[0]), cases[i].name, folder, &strict, &result, &err),
                                 STATUS_OK);
            assert_says(&err, damaged[k].reason);
        }
    }
}

/* Those within the file as well; one without a name is named by its row. */
static void damaged_pictures_within_the_file(void **state)
{
    static const char *const cases[][2] = {
        {GLTF("{\"name\":\"w\",\"uri\":\"data:;base64,UklGRgAAAABXRUJQ\"}", COLORED), "\"w\" cannot be used (w: the WebP"},
        {GLTF("{\"name\":\"w\",\"uri\":\"data:,%89PNG%0D%0A%1A%0Ax\"}", COLORED), "\"w\" cannot be used (w: the PNG"},
        {GLTF("{\"name\":\"w\",\"uri\":\"data:;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mP8\"}", COLORED),
         "\"w\" cannot be used (w: the PNG"},
        {GLTF("{\"uri\":\"data:,%89PNG%0D%0A%1A%0Ax\"}", COLORED), "\"images[0]\" cannot be used (images[0]: the PNG"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct import_result result;

        import(cases[i][0], "a.gltf", NULL, &result);
        assert_warned(&result, cases[i][1]);
        assert_int_equal(result.scene.image_count, 0);
        import_result_release(&result);
    }
}

/* A texture whose only form is not read, nor named: a warning as well. */
static void strict_wants_every_form(void **state)
{
    static const char text[] = GLTF("{\"uri\":\"gone.png\"}", COLORED);
    char *ktx = strdup(text), *source = strstr(ktx, "{\"source\":0}");
    struct import_options strict = defaults;
    struct import_result result;
    struct error err = {0};

    (void)state;
    memcpy(source, "{\"name\":\"k\"}", strlen("{\"name\":\"k\"}"));
    import(ktx, "a.gltf", NULL, &result);
    assert_warned(&result, "textures[0] has no image: left out");
    import_result_release(&result);
    strict.strict = 1;
    assert_int_equal(import_scene_memory(ktx, strlen(ktx), "a.gltf", folder, &strict, &result, &err), STATUS_ERR_UNSUPPORTED);
    assert_says(&err, "textures[0]|no image in a form that is read");
    free(ktx);
}

/* A texture may say which small part glows: without it nothing does. */
static void missing_emission_is_dark(void **state)
{
    static const char *const texts[][2] = {
        {"a.gltf", GLTF("{\"uri\":\"gone.png\"}", "\"emissiveFactor\":[1,1,1],\"emissiveTexture\":{\"index\":0}")},
        {"a.obj", "mtllib dark.mtl\n" TRIANGLE "usemtl m\nf 1/1 2/1 3/1\n"},
    };

    (void)state;
    write_text("dark.mtl", "newmtl m\nKe 1 1 1\nmap_Ke gone.png\n");
    for (size_t i = 0; i < 2; i++) {
        struct import_result result;

        import(texts[i][1], texts[i][0], NULL, &result);
        assert_warned(&result, "\"gone.png\" cannot be used");
        for (size_t m = 0; m < result.scene.material_count; m++)
            assert_floats(result.scene.materials[m].emission, (const float[]){0, 0, 0}, 3, 0);
        import_result_release(&result);
    }
}

/* ---- the picture that a PLY file names -------------------------------------------------------- */

static void ply_files_have_textures(void **state)
{
    static const char *const names[] = {"TextureFile skin 0.hdr", "TextureFile C:\\scan\\skin 0.hdr", "TextureFile ./skin 0.hdr"};
    struct import_result result;

    (void)state;
    write_text("skin 0.hdr", "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n\200\100\040\201\200\200\200\200");
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        char text[1024];

        snprintf(text, sizeof text, PLY("%s"), names[i]);
        import(text, "a.ply", NULL, &result);
        assert_int_equal(result.scene.materials[0].base_color_texture.texture, 0);
        assert_non_null(strstr(result.scene.images[0].name, "skin 0.hdr"));
        assert_null(view_mesh(&result, 0).colors);
        assert_floats(view_mesh(&result, 0).uv0, (const float[]){0, 1, 1, 1, 0, 0}, 6, 0);
        assert_floats(result.scene.materials[0].base_color, (const float[]){1, 1, 1}, 3, 0);
        import_result_release(&result);
    }
    import(PLY("TextureFile gone.png"), "a.ply", NULL, &result);
    assert_warned(&result, "a.ply: the texture \"gone.png\" cannot be used (");
    assert_int_equal(result.scene.materials[0].base_color_texture.texture, -1);
    assert_non_null(view_mesh(&result, 0).colors);
    import_result_release(&result);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(exposure_of_zero_is_said),
        cmocka_unit_test(missing_pictures_are_left_out),
        cmocka_unit_test(damaged_pictures_are_left_out),
        cmocka_unit_test(damaged_pictures_within_the_file),
        cmocka_unit_test(strict_wants_every_form),
        cmocka_unit_test(missing_emission_is_dark),
        cmocka_unit_test(ply_files_have_textures),
    };

    return cmocka_run_group_tests(tests, folder_set_up, folder_tear_down);
}
