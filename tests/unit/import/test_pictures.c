/* Pictures as other programs write them: what is odd is read as most programs read it, and said with the file's name. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(exposure_of_zero_is_said),
    };

    return cmocka_run_group_tests(tests, folder_set_up, folder_tear_down);
}
