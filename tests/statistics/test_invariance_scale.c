/* test_invariance_scale [--wide] [--table] [SPP]
 *
 * A scene in other units: all lengths, and what goes with lengths, from 1e-9 to 1e9 times as large.
 * By powers of two nothing is rounded otherwise, so the bits are the same unless the code has a
 * length of its own. --wide goes beyond what is promised, and demands noise alone; not all of it holds.
 * What is demanded, and how it is judged: tests/support/invariance.h. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <cmocka.h>

#include "tests/support/invariance.h"

static const double scales[] = {0x1p-30, 1e-9, 0x1p-10, 1e-3, 0x1p10, 1e3, 0x1p30, 1e9};
static const double wide_scales[] = {0x1p-46, 0x1p-40, 0x1p-34, 0x1p34, 0x1p36, 0x1p40, 0x1p42};
enum { SCALES = sizeof scales / sizeof *scales, WIDE_SCALES = sizeof wide_scales / sizeof *wide_scales };
static int wide;

static int is_power_of_two(double x)
{
    int exponent;

    return frexp(x, &exponent) == 0.5;
}

static void each_scale_at(const char *name, model_scene *model, enum model_format format, unsigned flags, int blended)
{
    struct model_way way = MODEL_AS_IT_IS;
    struct invariance *inv;

    way.format = format;
    inv = invariance_new(name, model, &way);
    way.flags = flags;
    for (int i = 0; i < (wide ? WIDE_SCALES : SCALES); i++) {
        char what[64];
        int power;
        way.scale = wide ? wide_scales[i] : scales[i];
        power = is_power_of_two(way.scale);
        snprintf(what, sizeof what, "%s scaled by %s%.4g", flags & WAY_IN_MATRIX ? "node" : "vertices",
                 power ? "2^" : "", power ? log2(way.scale) : way.scale);
        invariance_check(inv, what, &way,
                         blended || wide ? INVARIANT_NOISE
                         : power         ? INVARIANT_BITS
                                         : INVARIANT_ROUNDING);
    }
    invariance_free(inv);
}

static void each_scale(const char *name, model_scene *model, enum model_format format, unsigned flags)
{
    each_scale_at(name, model, format, flags, 0);
}

static void test_room(void **state)
{
    (void)state;
    each_scale("room", model_room, MODEL_GLTF, 0);
}

static void test_room_lens(void **state)
{
    (void)state;
    each_scale("room, pbrt", model_room_pbrt, MODEL_PBRT, WAY_IN_MATRIX);
}

static void test_glass(void **state)
{
    (void)state;
    each_scale("glass", model_glass, MODEL_GLTF, 0);
}

static void test_fog(void **state)
{
    (void)state;
    each_scale("fog", model_fog, MODEL_PBRT, 0);
}

static void test_textures(void **state)
{
    (void)state;
    each_scale("textures", model_textures, MODEL_GLTF, 0);
}

/* Whether a ray passes a blended surface is a hash of the bits of its triangle's corners. */
static void test_veil(void **state)
{
    (void)state;
    each_scale_at("veil", model_veil, MODEL_GLTF, 0, 1);
}

static void test_animation(void **state)
{
    (void)state;
    each_scale("animation", model_animation, MODEL_GLTF, 0);
}

static void test_animation_node(void **state)
{
    (void)state;
    each_scale("animation", model_animation, MODEL_GLTF, WAY_IN_MATRIX);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_room),     cmocka_unit_test(test_room_lens),
        cmocka_unit_test(test_glass),    cmocka_unit_test(test_fog),
        cmocka_unit_test(test_textures), cmocka_unit_test(test_veil), cmocka_unit_test(test_animation),
        cmocka_unit_test(test_animation_node),
    };

    wide = argc > 1 && strcmp(argv[1], "--wide") == 0;
    invariance_arguments(argc - wide, argv + wide);
    return cmocka_run_group_tests_name("invariance, scale", tests, NULL, NULL);
}
