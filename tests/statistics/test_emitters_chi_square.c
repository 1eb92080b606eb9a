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
#include "worker/render/render_scene.h"

/* The first place asks from all sides, the others as surfaces with a normal; scenes: lamps,
 * lamps and map, lamps and map behind portals. */
enum { PLACES = 3, SCENES = 3, TESTS = SCENES * PLACES, TRIANGLES_MAX = 64 };

/* A lamp's triangle as seen from one place: with direction d, det = facing . d, u = us . d / det, v = vs . d / det and
 * t = height / det are Moeller and Trumbore's (1997), without what d has no part in. */
struct seen_triangle {
    double facing[3], us[3], vs[3], height, area2;
    int lit_front, lit_back;
};

struct view {
    const struct render_scene *scene;
    struct light_context query;
    struct seen_triangle lamps[TRIANGLES_MAX];
};

static int sample(void *user, const float u[3], struct vec3 *direction)
{
    const struct view *view = user;
    struct light_sample light;

    (void)u[2];
    if (!emitters_sample(view->scene, &view->query, u[0], u[1], &light))
        return 0;
    *direction = light.direction;
    return 1;
}

static void to_doubles(struct vec3 v, double out[3])
{
    out[0] = (double)v.x;
    out[1] = (double)v.y;
    out[2] = (double)v.z;
}

static void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* The density by the other road: every lamp that the ray crosses, whatever is in front. */
static double density(void *user, struct vec3 direction)
{
    const struct view *view = user;
    const struct render_scene *scene = view->scene;
    const struct emitters *e = &scene->emitters;
    const struct light_context *query = &view->query;
    float environment_pdf = 0;
    double sum, d[3];

    if (e->has_environment)
        (void)emitters_environment(scene, query, direction, &environment_pdf);
    sum = (double)environment_pdf;
    to_doubles(direction, d);
    for (uint32_t i = 0; i < e->face_count; i++) {
        const struct seen_triangle *lamp = &view->lamps[i];
        double det = dot(lamp->facing, d), u, v, t, slack;

        if (!(det > 0 ? lamp->lit_front : lamp->lit_back) || det == 0 || lamp->height / det <= 0)
            continue;
        u = dot(lamp->us, d) / det;
        v = dot(lamp->vs, d) / det;
        t = lamp->height / det;
        /* A sample's end is moved off the lamp along the normal: seen under a small angle, that
         * leads past an edge. */
        slack = 1e-5 + 1e-5 * lamp->area2 / fabs(det);
        if (u < -slack || v < -slack || u + v > 1 + 2 * slack)
            continue;
        sum += (double)emitters_face_pdf(scene, query, i, (float)(t * t), (float)(fabs(det) / lamp->area2),
                                         (float)(0.5 * lamp->area2));
    }
    return sum;
}

static void lamp(struct scene_builder *b, uint32_t mesh, float emission, int double_sided, struct vec3 scale,
                 struct vec3 at)
{
    struct scene_material *m = builder_lambert(b, 0.5f);

    m->double_sided = double_sided;
    m->emission[0] = m->emission[1] = m->emission[2] = emission;
    builder_place(b, mesh, builder_last_material(b), scale, at);
}

static void find_triangles(struct view *view)
{
    const struct render_scene *scene = view->scene;
    const struct emitters *e = &scene->emitters;

    assert_true(e->face_count <= TRIANGLES_MAX);
    for (uint32_t i = 0; i < e->face_count; i++) {
        const struct render_instance *instance = &scene->instances[e->faces[i].instance];
        int double_sided = scene->materials[instance->material].m.double_sided;
        struct seen_triangle *lamp = &view->lamps[i];
        double c[3][3], e1[3], e2[3], n[3], o[3];
        struct vec3 corner[3];

        triangle_of_instance(scene, instance, e->faces[i].triangle, 0, corner);
        for (int k = 0; k < 3; k++)
            to_doubles(corner[k], c[k]);
        to_doubles(view->query.p, o);
        for (int a = 0; a < 3; a++) {
            e1[a] = c[1][a] - c[0][a];
            e2[a] = c[2][a] - c[0][a];
            o[a] -= c[0][a];
        }
        cross(e1, e2, n);
        cross(e2, o, lamp->us);
        cross(o, e1, lamp->vs);
        for (int a = 0; a < 3; a++)
            lamp->facing[a] = -n[a];
        lamp->height = dot(o, n);
        lamp->area2 = sqrt(dot(n, n));
        lamp->lit_front = double_sided || !instance->flipped;
        lamp->lit_back = double_sided || instance->flipped;
    }
}

static void test_mixture(void **state)
{
    static const struct vec3 places[PLACES] = {{0, 0, 0}, {1.5f, 0.3f, -0.7f}, {-3, 4, 1}};
    static const struct vec3 normals[PLACES] = {{0, 0, 0}, {0.6f, 0, 0.8f}, {0.48f, -0.6f, -0.64f}};
    static const char *const names[SCENES] = {"lamps", "lamps and map", "lamps, map, portals"};
    static struct scene_portal portals[1] = {{{-1, -1, 4}, {2, 0, 0.5f}, {0, 3, 0}}};

    (void)state;
    for (int which = 0; which < SCENES; which++) {
        static float map[16 * 8 * 3];
        struct render_settings settings = builder_settings(8, 8, 4);
        struct render_scene *scene;
        struct scene_builder b;
        uint32_t quad, ball;

        builder_init(&b);
        quad = builder_quad(&b);
        ball = builder_sphere(&b, 3, 0);
        lamp(&b, quad, 4, 0, vec3_make(1, -1, 0.6f), vec3_make(0, 2, 0));
        if (which < 2)
            lamp(&b, quad, 2, 1, vec3_make(0.8f, 1, 0.8f), vec3_make(3, -1, 1));
        if (which < 2)
            lamp(&b, ball, 1, 0, vec3_make(0.7f, 0.9f, 0.7f), vec3_make(-2, 0.5f, -2));
        builder_camera(&b, vec3_make(0, 0, 9), vec3_splat(0), 0.5f);
        if (which > 0) {
            for (int i = 0; i < 16 * 8 * 3; i++)
                map[i] = 0.1f + (float)(i * 37 % 29) / 29;
            builder_environment_map(&b, map, 16, 8);
        }
        if (which > 1) {
            b.scene.environment.portal_count = 1;
            b.scene.environment.portals = portals;
        }
        scene = builder_build(&b, &settings);
        for (int i = 0; i < PLACES; i++) {
            static struct view view;
            struct chi_square_setup setup = {.sample = sample, .pdf = density, .user = &view,
                                             .cos_cells = 10, .phi_cells = 20, .samples = 100000,
                                             .seed = 11 + (uint64_t)i, .axis = {0, 1, 0}};

            view.scene = scene;
            view.query = (struct light_context){.p = places[i], .n = normals[i]};
            find_triangles(&view);
            assert_true(chi_square_accept(&setup, 0.01, TESTS, names[which]));
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
