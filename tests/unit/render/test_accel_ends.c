/* What lies right before and behind the end of a ray, and the order of faces in one place. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "tests/support/scene_builder.h"
#include "worker/render/base/exact.h"
#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"

#define ULP 0x1p-23f /* of floats from 1 to 2 */

struct bench {
    struct scene_builder b;
    struct render_scene *scene;
};

static void bench_init(struct bench *t)
{
    builder_init(&t->b);
    builder_lambert(&t->b, 0.5f);
}

static void bench_build(struct bench *t)
{
    struct render_settings settings = builder_settings(1, 1, 1);

    builder_camera(&t->b, vec3_make(0, 5, 0), vec3_splat(0), 1);
    t->scene = builder_build(&t->b, &settings);
}

static void bench_release(struct bench *t)
{
    render_scene_free(t->scene);
    builder_release(&t->b);
}

/* A level triangle around (0, y, 0), seen from above; or with one more that is wound in reverse. */
static void add_level(struct bench *t, float y, int folded)
{
    static const uint32_t indices[6] = {0, 1, 2, 0, 2, 1};
    const float p[9] = {-4, y, -4, 0, y, 8, 4, y, -4};

    builder_place(&t->b, builder_mesh(&t->b, p, NULL, 3, indices, folded ? 2 : 1, 0), 0, vec3_splat(1), vec3_splat(0));
}

/* A triangle in the plane x = 0. */
static void add_upright(struct bench *t)
{
    static const uint32_t indices[3] = {0, 1, 2};
    static const float p[9] = {0, 0, -1, 0, 0, 1, 0, 3, 0};

    builder_place(&t->b, builder_mesh(&t->b, p, NULL, 3, indices, 1, 0), 0, vec3_splat(1), vec3_splat(0));
}

static struct ray downwards(int number)
{
    struct ray ray = {.origin = {0.1f, 2, 0.2f}};

    ray.direction = vec3_normalize(vec3_make((float)(number % 9 - 4) / 8, -1, (float)(number / 9 - 4) / 8));
    return ray;
}

/* Along the ray, to this height. */
static float distance_to(const struct ray *ray, float y)
{
    return (float)(((double)y - (double)ray->origin.y) / (double)ray->direction.y);
}

/* A lamp 2 to 1024 ulp from a wall: nothing behind it counts, all before it does. Embree's error
 * is some 60 ulp here. */
static void test_lamp_before_a_wall(void **state)
{
    (void)state;
    for (int ulps = 2; ulps <= 1024; ulps *= 2)
        for (int behind = 0; behind < 2; behind++) {
            struct bench t;

            bench_init(&t);
            add_level(&t, 1, 0);
            add_level(&t, 1 + (float)(behind ? -ulps : ulps) * ULP, 0);
            bench_build(&t);
            for (int k = 0; k < 81; k++) {
                struct ray ray = downwards(k);

                ray.reaches = 1;
                ray.end_cosine = -ray.direction.y;
                ray.t_max = distance_to(&ray, 1);
                assert_int_equal(accel_occluded(t.scene->accel, &ray, NULL), !behind);
            }
            bench_release(&t);
        }
}

/* The same of a place in mid-air, for rays that leave the middle of a face; those start for Embree by
 * its error, some 60 ulp, nearer to their end. */
static void test_point_before_a_wall(void **state)
{
    (void)state;
    for (int ulps = 128; ulps <= 1024; ulps *= 2)
        for (int behind = 0; behind < 2; behind++) {
            struct bench t;

            bench_init(&t);
            add_level(&t, 2, 0);
            add_level(&t, 1 + (float)(behind ? -ulps : ulps) * ULP, 0);
            bench_build(&t);
            for (int k = 0; k < 81; k++) {
                struct ray ray = downwards(k);

                ray.left_count = 1;
                ray.inset = 1;
                ray.off = vec3_make(0, -1, 0);
                ray.t_max = distance_to(&ray, 1);
                assert_int_equal(accel_occluded(t.scene->accel, &ray, NULL), !behind);
            }
            bench_release(&t);
        }
}

/* A ray in the plane of the face that it ends on has no crossing with it: its length counts. */
static void test_along_the_end(void **state)
{
    struct bench t;

    (void)state;
    bench_init(&t);
    add_level(&t, 1, 0);
    add_upright(&t);
    bench_build(&t);
    for (int beyond = 0; beyond < 2; beyond++) {
        struct ray ray = {.origin = {-2, 1, 0.1f}, .direction = {1, 0, 0}, .reaches = 1,
                          .t_max = beyond ? 1.5f : 2.5f};
        assert_int_equal(accel_occluded(t.scene->accel, &ray, NULL), !beyond);
    }
    bench_release(&t);
}

static uint32_t contacts_at(const struct bench *t, struct contact *out, uint32_t capacity)
{
    struct ray ray = {.origin = {0.1f, 2, 0.2f}, .direction = {0, -1, 0}, .t_max = INFINITY};
    double place[3];
    struct surface s;
    struct hit hit;

    assert_true(accel_intersect(t->scene->accel, &ray, NULL, &hit));
    surface_from_hit(t->scene, &ray, &hit, &s);
    exact_vec(s.p, place);
    return accel_coincident(t->scene->accel, &ray, &hit, place, NULL, out, capacity);
}

/* Contacts at one distance are sorted by name, whatever order Embree proposes them in; and by distance
 * where that is the reverse of the order of names. */
static void test_order(void **state)
{
    enum { COUNT = 12 };

    (void)state;
    for (int apart = 0; apart < 2; apart++) {
        struct contact found[COUNT];
        struct bench t;
        uint32_t count;

        bench_init(&t);
        for (int i = 0; i < COUNT; i++)
            add_level(&t, 1 + (float)(apart && i > 0 ? (i - COUNT) / 2 : 0) * ULP, 0);
        bench_build(&t);
        count = contacts_at(&t, found, COUNT);
        for (uint32_t i = 1; i < count; i++)
            if (found[i].gap == found[i - 1].gap)
                assert_true(found[i].hit.instance > found[i - 1].hit.instance);
            else
                assert_true(found[i].gap > found[i - 1].gap);
        assert_int_equal(count, COUNT - 1);
        bench_release(&t);
    }
}

/* A sheet folded flat has two faces in one place that share their corners: both are to be crossed. */
static void test_folded(void **state)
{
    struct contact found[4];
    struct bench t;

    (void)state;
    bench_init(&t);
    add_level(&t, 1, 1);
    bench_build(&t);
    assert_int_equal(contacts_at(&t, found, 4), 1);
    assert_int_equal(found[0].repeats, 0);
    bench_release(&t);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_lamp_before_a_wall), cmocka_unit_test(test_point_before_a_wall),
        cmocka_unit_test(test_along_the_end),      cmocka_unit_test(test_order),
        cmocka_unit_test(test_folded),
    };
    return cmocka_run_group_tests_name("accel ends", tests, NULL, NULL);
}
