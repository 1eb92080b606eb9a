/* Shading normals: when they are left as they are, and when they are bent. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "tests/support/scene_builder.h"
#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"

/* The shading normal of a triangle in the xy plane seen along `wo`, whose vertices' normal leans
 * towards +x by `lean` radians, and which reflects by `specular`. */
static struct vec3 shading_normal(double lean, struct vec3 wo, float specular)
{
    static const float positions[9] = {-1, -1, 0, 1, -1, 0, 0, 1, 0};
    static const uint32_t indices[3] = {0, 1, 2};
    const float x = (float)sin(lean), z = (float)cos(lean);
    const float normals[9] = {x, 0, z, x, 0, z, x, 0, z};
    const struct ray ray = {.origin = vec3_scale(wo, 5), .direction = vec3_neg(wo),
                            .t_max = INFINITY};
    struct render_settings settings = builder_settings(16, 16, 16);
    struct bsdf_params params;
    struct scene_builder b;
    struct render_scene *scene;
    struct surface s;
    struct hit hit;

    builder_init(&b);
    builder_lambert(&b, 0.5f)->specular = specular;
    builder_place(&b, builder_mesh(&b, positions, normals, 3, indices, 1, 0), 0, vec3_splat(1), vec3_splat(0));
    builder_camera(&b, vec3_make(0, 0, 9), vec3_splat(0), 1);
    scene = builder_build(&b, &settings);
    assert_true(accel_intersect(scene->accel, &ray, NULL, &hit));
    surface_from_hit(scene, &ray, &hit, &s);
    surface_shade(scene, &s, wo, &params);
    render_scene_free(scene);
    builder_release(&b);
    return s.basis.n;
}

static struct vec3 towards(double angle) { return vec3_make((float)sin(angle), 0, (float)cos(angle)); }

static double angle_of(struct vec3 n)
{
    assert_true(fabsf(n.y) < 1e-6f);
    return atan2((double)n.x, (double)n.z);
}

/* Of what only scatters, it is the file's normal, whatever the ray comes from. */
static void a_lambert_reflector_keeps_its_normal(void **state)
{
    (void)state;
    for (double lean = -1.2; lean < 1.25; lean += 0.15)
        for (double view = -1.2; view < 1.25; view += 0.15)
            if (cos(lean - view) > 0.01)
                assert_true(fabs(angle_of(shading_normal(lean, towards(view), 0)) - lean) < 1e-5);
}

/* Of what reflects, it is bent as far as the mirror direction needs to stay above the surface. */
static void a_mirror_direction_stays_above(void **state)
{
    int bent = 0;

    (void)state;
    for (double lean = -1.2; lean < 1.25; lean += 0.15)
        for (double view = -1.2; view < 1.25; view += 0.15) {
            double got = angle_of(shading_normal(lean, towards(view), 1));
            if (cos(2 * lean - view) > 0.01 && cos(lean - view) > 0.01) {
                assert_true(fabs(got - lean) < 1e-5);
            } else {
                bent++;
                assert_true(cos(2 * got - view) > 0 && cos(got - view) > 0);
            }
        }
    assert_true(bent > 50);
}

/* One that faces away from the ray is bent until it does not. */
static void a_normal_faces_the_ray(void **state)
{
    struct vec3 n = shading_normal(1.2, towards(-1.0), 0);

    (void)state;
    assert_true(vec3_dot(n, towards(-1.0)) > 0 && vec3_dot(n, towards(-1.0)) < 0.01f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_lambert_reflector_keeps_its_normal),
        cmocka_unit_test(a_mirror_direction_stays_above),
        cmocka_unit_test(a_normal_faces_the_ray),
    };

    return cmocka_run_group_tests_name("surface", tests, NULL, NULL);
}
