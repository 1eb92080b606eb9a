/* The same scene by other names, in another order, in another format. What is demanded, and how it is
 * judged: tests/support/invariance.h. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <cmocka.h>

#include "tests/support/invariance.h"

/* Names decide nothing. The order of lights decides which of them a random number chooses. The order of
 * everything else decides only which of several things at one distance counts: where faces touch
 * that is a matter of rounding. What is blended asks a hash of the material's number besides. */
enum order { FREE, TOUCHING, BLENDED };

static void each_order(const char *name, model_scene *model, enum model_format format, enum order order)
{
    static const enum invariance_level levels[] = {INVARIANT_BITS, INVARIANT_ROUNDING,
                                                   INVARIANT_NOISE};
    struct model_way way = MODEL_AS_IT_IS;
    struct invariance *inv;

    way.format = format;
    inv = invariance_new(name, model, &way);
    way.flags = WAY_RENAMED;
    invariance_check(inv, "renamed", &way, INVARIANT_BITS);
    way.flags = WAY_RENAMED | WAY_REORDERED;
    invariance_check(inv, "renamed, all but lamps reordered", &way, levels[order]);
    way.flags = WAY_RENAMED | WAY_REORDERED | WAY_LIGHTS_TOO;
    invariance_check(inv, "renamed, all reordered", &way, INVARIANT_NOISE);
    invariance_free(inv);
}

static void test_order(void **state)
{
    (void)state;
    each_order("room", model_room, MODEL_GLTF, FREE);
    each_order("room, pbrt", model_room_pbrt, MODEL_PBRT, FREE);
    each_order("fog", model_fog, MODEL_PBRT, FREE);
    each_order("textures", model_textures, MODEL_GLTF, FREE);
    each_order("animation", model_animation, MODEL_GLTF, FREE);
    each_order("plain, OBJ", model_plain, MODEL_OBJ, FREE);
}

static void test_order_touching(void **state)
{
    (void)state;
    each_order("glass", model_glass, MODEL_GLTF, TOUCHING);
}

static void test_order_blended(void **state)
{
    (void)state;
    each_order("veil", model_veil, MODEL_GLTF, BLENDED);
}

static void test_formats(void **state)
{
    struct model_way way = MODEL_AS_IT_IS;
    struct invariance *inv = invariance_new("plain, glTF", model_plain, &way);

    (void)state;
    way.format = MODEL_PBRT;
    invariance_check(inv, "as pbrt", &way, INVARIANT_ROUNDING);
    way.format = MODEL_OBJ;
    invariance_check(inv, "as OBJ", &way, INVARIANT_ROUNDING);
    invariance_free(inv);
    way.format = MODEL_GLTF;
    inv = invariance_new("plain with glass, glTF", model_plain_glass, &way);
    way.format = MODEL_PBRT;
    invariance_check(inv, "as pbrt", &way, INVARIANT_ROUNDING);
    invariance_free(inv);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_order),
        cmocka_unit_test(test_order_touching),
        cmocka_unit_test(test_order_blended),
        cmocka_unit_test(test_formats),
    };

    invariance_arguments(argc, argv);
    return cmocka_run_group_tests_name("invariance, files", tests, NULL, NULL);
}
