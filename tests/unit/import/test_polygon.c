/* Cutting faces into triangles: areas add up, no triangle turns over, concave outlines stay what
 * they are. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "client/import/builder/polygon.h"
#include "client/import/builder/scan.h"
#include "common/math/vec.h"

enum { CORNERS_MAX = 600 };

struct face {
    float positions[3 * CORNERS_MAX];
    uint32_t corners[CORNERS_MAX];
    uint32_t triangles[3 * CORNERS_MAX];
    size_t count;
};

static void face_begin(struct face *face) { face->count = 0; }

static void face_add(struct face *face, float x, float y, float z)
{
    float *p = face->positions + 3 * face->count;

    p[0] = x, p[1] = y, p[2] = z;
    face->corners[face->count] = (uint32_t)face->count;
    face->count++;
}

static struct vec3 corner(const struct face *face, uint32_t i)
{
    const float *p = face->positions + 3 * (size_t)face->corners[i];

    return vec3_make(p[0], p[1], p[2]);
}

/* Cut it; returns how many fans were made for want of ears. */
static size_t cut(struct face *face)
{
    struct polygon_scratch scratch = {0};
    size_t fans;

    polygon_triangulate(&scratch, face->positions, face->corners, face->count, face->triangles);
    fans = scratch.fans;
    polygon_scratch_release(&scratch);
    for (size_t i = 0; i < 3 * (face->count - 2); i++)
        assert_true(face->triangles[i] < face->count);
    return fans;
}

/* The sum of the triangles' areas along `up`, all of which must be 0 or more. */
static float area_along(const struct face *face, struct vec3 up)
{
    float sum = 0;

    for (size_t t = 0; t + 2 < face->count; t++) {
        struct vec3 a = corner(face, face->triangles[3 * t]);
        struct vec3 b = corner(face, face->triangles[3 * t + 1]);
        struct vec3 c = corner(face, face->triangles[3 * t + 2]);
        float area = 0.5f * vec3_dot(vec3_cross(vec3_sub(b, a), vec3_sub(c, a)), up);
        assert_true(area >= 0);
        sum += area;
    }
    return sum;
}

static void convex_face_is_a_fan(void **state)
{
    struct face face;
    static const uint32_t wanted[] = {0, 1, 2, 0, 2, 3};

    (void)state;
    face_begin(&face);
    face_add(&face, 0, 0, 0), face_add(&face, 1, 0, 0), face_add(&face, 1, 1, 0);
    face_add(&face, 0, 1, 0);
    assert_int_equal(cut(&face), 0);
    assert_memory_equal(face.triangles, wanted, sizeof wanted);
}

static void concave_quad_is_cut_at_its_reflex_corner(void **state)
{
    struct face face;

    (void)state;
    /* An arrowhead in the plane x = 2, its reflex corner in each place in turn. */
    for (int first = 0; first < 4; first++) {
        static const float yz[4][2] = {{0, 0}, {4, 0}, {1, 1}, {0, 4}};
        face_begin(&face);
        for (int i = 0; i < 4; i++)
            face_add(&face, 2, yz[(first + i) % 4][0], yz[(first + i) % 4][1]);
        assert_int_equal(cut(&face), 0);
        assert_float_equal(area_along(&face, vec3_make(1, 0, 0)), 4, 1e-6);
    }
}

/* A comb of `teeth` teeth, seen along each axis from either side. */
static void concave_outlines_keep_their_area(void **state)
{
    struct face face;

    (void)state;
    for (int axis = 0; axis < 3; axis++)
        for (int flip = 0; flip < 2; flip++) {
            const int teeth = 50;
            float up[3] = {0, 0, 0};
            face_begin(&face);
            for (int i = 0; i < 4 * teeth + 2; i++) {
                int k = flip ? 4 * teeth + 1 - i : i;
                float x, y, p[3];
                if (k >= 4 * teeth) {
                    y = 5;
                    x = k == 4 * teeth ? (float)(2 * teeth - 1) : 0;
                } else {
                    x = (float)(k / 2);
                    y = (k + 1) % 4 < 2 ? 0 : 1;
                }
                p[axis] = 7, p[(axis + 1) % 3] = x, p[(axis + 2) % 3] = y;
                face_add(&face, p[0], p[1], p[2]);
            }
            up[axis] = flip ? -1 : 1;
            assert_int_equal(cut(&face), 0);
            /* 2 teeth - 1 wide and 5 high, less the gaps, of which one is 1 x 1. The first
             * gap is at the edge: the outline runs up there and down again. */
            assert_float_equal(area_along(&face, vec3_make(up[0], up[1], up[2])), (2 * teeth - 1) * 5 - teeth, 1e-3);
        }
}

static void star_with_many_points(void **state)
{
    struct face face;
    const int points = 250;
    double area = 0;

    (void)state;
    face_begin(&face);
    for (int i = 0; i < 2 * points; i++) {
        double angle = 3.14159265358979 * i / points, r = i % 2 ? 1 : 3;
        face_add(&face, (float)(r * cos(angle)), (float)(r * sin(angle)), 0);
    }
    for (size_t i = 0; i < face.count; i++) {
        const float *p = face.positions + 3 * i, *q = face.positions + 3 * ((i + 1) % face.count);
        area += 0.5 * ((double)p[0] * (double)q[1] - (double)p[1] * (double)q[0]);
    }
    assert_int_equal(cut(&face), 0);
    assert_float_equal(area_along(&face, vec3_make(0, 0, 1)), area, 1e-4);
}

/* An outline with a hole, joined by a bridge that runs there and back. */
static void hole_by_a_bridge(void **state)
{
    static const float xy[][2] = {{0, 0}, {4, 0}, {4, 4}, {0, 4}, {0, 0},
                                  {1, 1}, {1, 3}, {3, 3}, {3, 1}, {1, 1}};
    struct face face;

    (void)state;
    face_begin(&face);
    for (size_t i = 0; i < sizeof xy / sizeof *xy; i++)
        face_add(&face, xy[i][0], xy[i][1], 0);
    assert_int_equal(cut(&face), 0);
    assert_float_equal(area_along(&face, vec3_make(0, 0, 1)), 12, 1e-5);
}

/* Corners on straight edges become corners of triangles, so that neighbours fit. */
static void straight_corners_are_kept(void **state)
{
    static const float xy[][2] = {{0, 0}, {1, 0}, {2, 0}, {2, 1}, {2, 2}, {1, 2}, {0, 2}, {0, 1}};
    struct face face;
    int used[8] = {0};

    (void)state;
    face_begin(&face);
    for (size_t i = 0; i < 8; i++)
        face_add(&face, xy[i][0], xy[i][1], 0);
    assert_int_equal(cut(&face), 0);
    assert_float_equal(area_along(&face, vec3_make(0, 0, 1)), 4, 1e-6);
    for (size_t t = 0; t < 6; t++) {
        struct vec3 a = corner(&face, face.triangles[3 * t]);
        struct vec3 b = corner(&face, face.triangles[3 * t + 1]);
        struct vec3 c = corner(&face, face.triangles[3 * t + 2]);
        if (vec3_cross(vec3_sub(b, a), vec3_sub(c, a)).z > 0)
            for (size_t i = 0; i < 3; i++)
                used[face.triangles[3 * t + i]] = 1;
    }
    for (int i = 0; i < 8; i++)
        assert_true(used[i]);
}

static void hopeless_faces_are_cut_somehow(void **state)
{
    struct face face;

    (void)state;
    face_begin(&face); /* no area at all */
    for (int i = 0; i < 5; i++)
        face_add(&face, 1, 2, 3);
    cut(&face);
    face_begin(&face); /* a bow tie: as much left as right */
    face_add(&face, 0, 0, 0), face_add(&face, 1, 1, 0), face_add(&face, 1, 0, 0);
    face_add(&face, 0, 1, 0);
    cut(&face);
    face_begin(&face); /* a pentagram turns left at every corner, twice around */
    for (int i = 0; i < 5; i++)
        face_add(&face, (float)cos(i * 2.51327412), (float)sin(i * 2.51327412), 0);
    cut(&face);
}

/* ---- numbers ------------------------------------------------------------------------------- */

static void numbers_are_those_of_strtod(void **state)
{
    static const char *const texts[] = {
        "0",
        "-0",
        "1",
        "+1.5",
        ".5",
        "5.",
        "1e3",
        "1E-3",
        "-1.e+2",
        "123456789.123456789",
        "0.1",
        "3.4028234664e38",
        "1e22",
        "1e23",
        "9007199254740993",
        "9007199254740993e5",
        "2.2250738585072014e-308",
        "4.9e-324",
        "1e-400",
        "1e400",
        "0.000000000000000000000000000000001",
        "100000000000000000000000000000",
        "0e99999999999999999999",
        "1e-99999999999999999999",
        "179769313486231570000000000000000000000000000000000000000000000"};
    char longest[1200];
    double got;

    (void)state;
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        size_t length = strlen(texts[i]);
        double wanted = strtod(texts[i], NULL);
        assert_int_equal(scan_double(texts[i], texts[i] + length, &got), length);
        assert_memory_equal(&got, &wanted, sizeof got);
    }
    memset(longest, '3', sizeof longest);
    longest[0] = '0', longest[1] = '.';
    assert_int_equal(scan_double(longest, longest + sizeof longest, &got), sizeof longest);
    assert_true(got == 1.0 / 3);
    longest[1] = '1';
    assert_int_equal(scan_double(longest, longest + sizeof longest, &got), sizeof longest);
    assert_true(isinf(got));
}

static size_t number(const char *text, double *out) { return scan_double(text, text + strlen(text), out); }

static size_t integer(const char *text, int64_t *out) { return scan_integer(text, text + strlen(text), out); }

static void numbers_end_where_they_end(void **state)
{
    double got;
    int64_t value;

    (void)state;
    assert_int_equal(number("12/3", &got), 2);
    assert_int_equal(number("1e", &got), 1);
    assert_int_equal(number("1.2.3", &got), 3);
    assert_int_equal(number("", &got), 0);
    assert_int_equal(number("-", &got), 0);
    assert_int_equal(number(".", &got), 0);
    assert_int_equal(number("x", &got), 0);
    assert_int_equal(number("-inf", &got), 4);
    assert_true(isinf(got) && got < 0);
    assert_int_equal(number("-nan(ind)", &got), 9);
    assert_true(isnan(got));
    assert_int_equal(number("1.#QNAN", &got), 7);
    assert_true(isnan(got));
    assert_int_equal(number("-1.#INF00", &got), 9);
    assert_true(isinf(got) && got < 0);
    assert_int_equal(integer("-12/", &value), 3);
    assert_int_equal(value, -12);
    assert_int_equal(integer("99999999999999999999", &value), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(convex_face_is_a_fan),
        cmocka_unit_test(concave_quad_is_cut_at_its_reflex_corner),
        cmocka_unit_test(concave_outlines_keep_their_area),
        cmocka_unit_test(star_with_many_points),
        cmocka_unit_test(hole_by_a_bridge),
        cmocka_unit_test(straight_corners_are_kept),
        cmocka_unit_test(hopeless_faces_are_cut_somehow),
        cmocka_unit_test(numbers_are_those_of_strtod),
        cmocka_unit_test(numbers_end_where_they_end),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
