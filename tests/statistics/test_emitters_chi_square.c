/* Chi-square: the directions in which next-event estimation looks for light follow the
 * density that multiple importance sampling divides by: a mixture of an environment map,
 * lamps of several triangles, one-sided and two-sided, one of them mirrored.
 * Family-wise level 0.01, Sidak. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "tests/support/chi_square.h"
#include "tests/support/scene_builder.h"
#include "worker/render/world.h"

enum { PLACES = 3, TESTS = 2 * PLACES };

struct view {
    const struct render_scene *scene;
    struct vec3 p;
};

static int sample(void *user, const float u[3], struct vec3 *direction)
{
    const struct view *view = user;
    struct light_sample light;

    const struct light_query query = {view->p, {0, 0, 0}, 0};

    (void)u[2];
    if (!emitters_sample(view->scene, &query, u[0], u[1], &light))
        return 0;
    *direction = light.direction;
    return 1;
}

/* The density by the other road: every lamp that the ray crosses, whatever is in front. */
static double density(void *user, struct vec3 direction)
{
    const struct view *view = user;
    const struct render_scene *scene = view->scene;
    const struct emitters *e = &scene->emitters;
    const struct light_query query = {view->p, {0, 0, 0}, 0};
    double sum = 0;

    if (e->has_environment)
        sum = (double)emitters_environment_pdf(scene, &query, direction);
    for (uint32_t i = 0; i < e->triangle_count; i++) {
        const struct world_instance *instance = &scene->instances[e->triangle_instance[i]];
        struct vec3 c[3], e1, e2, n, s, q, d = direction;
        double det, u, v, t, length;

        world_triangle(scene, instance, e->triangle_index[i], 0, c);
        e1 = vec3_sub(c[1], c[0]);
        e2 = vec3_sub(c[2], c[0]);
        n = vec3_cross(e1, e2);
        length = (double)vec3_length(n);
        det = -(double)vec3_dot(n, d);
        if (det == 0)
            continue;
        s = vec3_sub(view->p, c[0]);
        q = vec3_cross(s, d);
        u = (double)vec3_dot(e2, q) / det;
        v = -(double)vec3_dot(e1, q) / det;
        t = (double)vec3_dot(s, n) / det;
        /* A sample at an edge may round to just outside. */
        if (u < -1e-5 || v < -1e-5 || u + v > 1 + 2e-5 || t <= 0)
            continue;
        if ((det > 0) == instance->flipped &&
            !scene->materials[instance->material].m.double_sided)
            continue; /* its back, which shines nowhere */
        sum += (double)emitters_triangle_pdf(scene, &query, i, (float)(t * t), (float)(fabs(det) / length),
                                             (float)(0.5 * length));
    }
    return sum;
}

static void lamp(struct scene_builder *b, uint32_t mesh, float emission, int double_sided,
                 struct vec3 scale, struct vec3 at)
{
    struct scene_material *m = builder_lambert(b, 0.5f);

    m->double_sided = double_sided;
    m->emission[0] = m->emission[1] = m->emission[2] = emission;
    builder_place(b, mesh, builder_last_material(b), scale, at);
}

static void test_mixture(void **state)
{
    static const struct vec3 places[PLACES] = {{0, 0, 0}, {1.5f, 0.3f, -0.7f}, {-3, 4, 1}};

    (void)state;
    for (int with_map = 0; with_map < 2; with_map++) {
        static float map[16 * 8 * 3];
        struct render_settings settings = builder_settings(8, 8, 4);
        struct render_scene *scene;
        struct scene_builder b;
        uint32_t quad, ball;

        builder_init(&b);
        quad = builder_quad(&b);
        ball = builder_sphere(&b, 3, 0);
        lamp(&b, quad, 4, 0, vec3_make(1, -1, 0.6f), vec3_make(0, 2, 0));
        lamp(&b, quad, 2, 1, vec3_make(0.8f, 1, 0.8f), vec3_make(3, -1, 1));
        lamp(&b, ball, 1, 0, vec3_make(0.7f, 0.9f, 0.7f), vec3_make(-2, 0.5f, -2));
        builder_camera(&b, vec3_make(0, 0, 9), vec3_splat(0), 0.5f);
        if (with_map) {
            for (int i = 0; i < 16 * 8 * 3; i++)
                map[i] = 0.1f + (float)(i * 37 % 29) / 29;
            builder_environment_map(&b, map, 16, 8);
        }
        scene = builder_build(&b, &settings);
        for (int i = 0; i < PLACES; i++) {
            struct view view = {scene, places[i]};
            struct chi_square_setup setup = {.sample = sample, .pdf = density, .user = &view,
                                             .cos_cells = 10, .phi_cells = 20, .samples = 100000,
                                             .seed = 11 + (uint64_t)i, .axis = {0, 1, 0}};
            assert_true(chi_square_accept(&setup, 0.01, TESTS, with_map ? "lamps and map" : "lamps"));
        }
        render_scene_free(scene);
        builder_release(&b);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_mixture)};

    return cmocka_run_group_tests_name("emitters_chi_square", tests, NULL, NULL);
}
