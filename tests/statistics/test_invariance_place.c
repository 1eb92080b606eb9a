/* A scene in another place of the world: moved, turned, mirrored; by its vertices or by a matrix above
 * them. Moves by sums of powers of two lose no digit, so the bits stay the same. What is
 * demanded, and how it is judged: tests/support/invariance.h. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <cmocka.h>

#include "tests/support/invariance.h"

static struct model_way way;

/* ---- moved ------------------------------------------------------------------------------------- */

struct move {
    double shift[3];
    int floats; /* a float holds the moved coordinates, so a glTF's vertices may be moved */
};

static const struct move moves[] = {
    {{1024, -512, 256}, 1},
    {{500000, 0.25, -4649776}, 0},
    {{1e9, 1e9, -1e9}, 0},
};

/* At 1e9 m doubles have steps of 1.2e-7 m: enough for the coordinates, but not for sums of a
 * matrix. pbrt's camera is the inverse of such a matrix, so it is off by rounding before. */
static enum invariance_level level_of(const struct move *m, enum model_format format)
{
    double reach = fabs(m->shift[0]) + fabs(m->shift[1]) + fabs(m->shift[2]);

    return reach < (format == MODEL_PBRT ? 1e5 : 1e8) ? INVARIANT_BITS : INVARIANT_ROUNDING;
}

static void move_all(struct invariance *inv)
{
    for (size_t i = 0; i < sizeof moves / sizeof *moves; i++)
        for (int in_matrix = 0; in_matrix < 2; in_matrix++) {
            char what[96];
            if (!in_matrix && !moves[i].floats && way.format == MODEL_GLTF)
                continue;
            memcpy(way.shift, moves[i].shift, sizeof way.shift);
            way.flags = in_matrix ? WAY_IN_MATRIX : 0;
            snprintf(what, sizeof what, "%s moved by %g %g %g", in_matrix ? "node" : "vertices", way.shift[0],
                     way.shift[1], way.shift[2]);
            invariance_check(inv, what, &way, level_of(&moves[i], way.format));
        }
    memset(way.shift, 0, sizeof way.shift);
}

/* ---- turned and mirrored ------------------------------------------------------------------------ */

static void turn(struct invariance *inv, unsigned number, int mirrored)
{
    for (unsigned in_matrix = 0; in_matrix < 2; in_matrix++) {
        char what[96];
        way.flags = in_matrix ? WAY_IN_MATRIX : 0;
        invariance_turn(4 * number + 2 * (unsigned)mirrored + in_matrix, mirrored, way.turn);
        snprintf(what, sizeof what, "%s turned%s", in_matrix ? "node" : "vertices", mirrored ? " and mirrored" : "");
        invariance_check(inv, what, &way, INVARIANT_TURNED);
    }
}

static void everything(struct invariance *inv, unsigned number)
{
    way.flags = WAY_IN_MATRIX;
    way.scale = 0.037;
    memcpy(way.shift, (double[3]){12345.678, -777.7, 3.1}, sizeof way.shift);
    invariance_turn(100 + number, 0, way.turn);
    invariance_check(inv, "node scaled, turned and moved", &way, INVARIANT_TURNED);
}

/* `mirrored`: if another model (no option mirrors the sky of a glTF). */
static void each_place(const char *name, model_scene *model, model_scene *mirrored, enum model_format format,
                       unsigned number)
{
    struct invariance *inv;

    way = (struct model_way)MODEL_AS_IT_IS;
    way.format = format;
    inv = invariance_new(name, model, &way);
    move_all(inv);
    turn(inv, number, 0);
    if (!mirrored)
        turn(inv, number, 1);
    everything(inv, number);
    invariance_free(inv);
    if (!mirrored)
        return;
    way = (struct model_way)MODEL_AS_IT_IS;
    way.format = format;
    inv = invariance_new(name, mirrored, &way);
    turn(inv, number, 1);
    invariance_free(inv);
}

static void test_room(void **state)
{
    (void)state;
    each_place("room", model_room, model_room_plain_sky, MODEL_GLTF, 0);
}

static void test_room_pbrt(void **state)
{
    (void)state;
    each_place("room, pbrt", model_room_pbrt, NULL, MODEL_PBRT, 1);
}

static void test_glass(void **state)
{
    (void)state;
    each_place("glass", model_glass, NULL, MODEL_GLTF, 2);
}

static void test_fog(void **state)
{
    (void)state;
    each_place("fog", model_fog, NULL, MODEL_PBRT, 3);
}

static void test_textures(void **state)
{
    (void)state;
    each_place("textures", model_textures, NULL, MODEL_GLTF, 4);
}

static void test_animation(void **state)
{
    (void)state;
    each_place("animation", model_animation, NULL, MODEL_GLTF, 5);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_room),     cmocka_unit_test(test_room_pbrt),
        cmocka_unit_test(test_glass),    cmocka_unit_test(test_fog),
        cmocka_unit_test(test_textures), cmocka_unit_test(test_animation),
    };

    invariance_arguments(argc, argv);
    return cmocka_run_group_tests_name("invariance, place", tests, NULL, NULL);
}
