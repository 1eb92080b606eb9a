/* The same surfaces cut into other triangles, or the same triangles listed another way. What the
 * triangles are decides every bit; how they are stored decides none. What is demanded, and how it is
 * judged: tests/support/invariance.h. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <cmocka.h>

#include "tests/support/invariance.h"

struct cut {
    const char *what;
    unsigned flags;
    enum invariance_level level;
};

/* Pieces have other numbers, which decide where two things are met at one distance. */
static const struct cut cuts[] = {
    {"vertices reordered", WAY_SHUFFLE_VERTICES, INVARIANT_BITS},
    {"no vertex shared", WAY_UNINDEXED, INVARIANT_BITS},
    {"each mesh as three", WAY_PIECES, INVARIANT_ROUNDING},
    {"as three, of three materials", WAY_PIECES | WAY_OWN_MATERIALS, INVARIANT_ROUNDING},
    {"other first corners", WAY_TURN_CORNERS, INVARIANT_NOISE},
    {"triangles reordered", WAY_SHUFFLE_TRIANGLES, INVARIANT_NOISE},
    {"quads by the other diagonal", WAY_FLIP_QUADS, INVARIANT_NOISE},
    {"each triangle as four", WAY_SPLIT_FOUR, INVARIANT_NOISE},
    {"as four, reordered, in pieces", WAY_SPLIT_FOUR | WAY_SHUFFLE_TRIANGLES | WAY_PIECES,
     INVARIANT_NOISE},
};

/* What is blended asks a hash of its material's number. */
static void each_cut(const char *name, model_scene *model, enum model_format format, int blended)
{
    struct model_way way = MODEL_AS_IT_IS;
    struct invariance *inv;

    way.format = format;
    inv = invariance_new(name, model, &way);
    for (size_t i = 0; i < sizeof cuts / sizeof *cuts; i++) {
        way.flags = cuts[i].flags;
        invariance_check(inv, cuts[i].what, &way,
                         blended && way.flags & WAY_OWN_MATERIALS ? INVARIANT_NOISE : cuts[i].level);
    }
    invariance_free(inv);
}

static void test_room(void **state)
{
    (void)state;
    each_cut("room", model_room, MODEL_GLTF, 0);
}

static void test_room_pbrt(void **state)
{
    (void)state;
    each_cut("room, pbrt", model_room_pbrt, MODEL_PBRT, 0);
}

static void test_glass(void **state)
{
    (void)state;
    each_cut("glass", model_glass, MODEL_GLTF, 0);
}

static void test_fog(void **state)
{
    (void)state;
    each_cut("fog", model_fog, MODEL_PBRT, 0);
}

static void test_textures(void **state)
{
    (void)state;
    each_cut("textures", model_textures, MODEL_GLTF, 0);
}

static void test_veil(void **state)
{
    (void)state;
    each_cut("veil", model_veil, MODEL_GLTF, 1);
}

static void test_animation(void **state)
{
    (void)state;
    each_cut("animation", model_animation, MODEL_GLTF, 0);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_room),     cmocka_unit_test(test_room_pbrt),
        cmocka_unit_test(test_glass),    cmocka_unit_test(test_fog),
        cmocka_unit_test(test_textures), cmocka_unit_test(test_veil),
        cmocka_unit_test(test_animation),
    };

    invariance_arguments(argc, argv);
    return cmocka_run_group_tests_name("invariance, triangles", tests, NULL, NULL);
}
