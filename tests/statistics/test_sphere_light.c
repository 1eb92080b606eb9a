/* Sphere lamps: the directions in which light sampling looks follow the density that multiple
 * importance sampling divides by (chi-square), and pictures of what they light against closed forms
 * (t-tests over frames). Family-wise level 0.01, Sidak, in each of the two. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include <cmocka.h>

#include "common/base/buffer.h"
#include "tests/support/chi_square.h"
#include "tests/support/imported.h"
#include "tests/support/pbrt_text.h"
#include "tests/support/statistics.h"
#include "worker/render/shape/sphere.h"
#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"

#define GLOW "AreaLightSource \"diffuse\" \"rgb L\" [3 3 3] "

/* ---- directions ------------------------------------------------------------------------------- */

struct view {
    const struct render_scene *scene;
    struct light_context context;
};

static int sample(void *user, const float u[3], struct vec3 *direction)
{
    const struct view *view = user;
    struct light_sample light;

    (void)u[2];
    if (!emitters_sample(view->scene, &view->context, u[0], u[1], &light))
        return 0;
    *direction = light.direction;
    return 1;
}

/* By the other road: where the ray crosses the lamps. */
static double density(void *user, struct vec3 direction)
{
    const struct view *view = user;
    const struct emitters *e = &view->scene->emitters;
    double sum = 0, o[3], d[3];

    exact_vec(view->context.p, o);
    exact_vec(direction, d);
    for (uint32_t i = 0; i < e->face_count; i++) {
        const struct render_instance *lamp = &view->scene->instances[e->faces[i].instance];
        struct sphere_chord chord;
        double t, n[3];

        sphere_chord_find(sphere_of(lamp->shape), o, d, &chord);
        t = chord.middle > chord.half ? chord.middle - chord.half : chord.middle + chord.half;
        if (!chord.meets || !(t > 0))
            continue;
        for (int k = 0; k < 3; k++)
            n[k] = (chord.foot[k] + (t - chord.middle) * d[k]) / sphere_of(lamp->shape)->radius;
        sum +=
            (double)emitters_face_pdf(view->scene, &view->context, i, (float)(t * t), (float)fabs(exact_dot(n, d)), 0);
    }
    return sum;
}

static void test_directions(void **state)
{
    static const struct {
        const char *world;
        struct vec3 from; /* from the first lamp's centre, in its radii */
        double focus;
    } cases[] = {
        {GLOW "Shape \"sphere\"", {0, 0, 2}, 1},
        {GLOW "Shape \"sphere\"", {0.3f, 1.001f, -0.2f}, 1},
        {GLOW "Shape \"sphere\" \"float radius\" 0.01", {12, 16, 0}, 8},
        {"ReverseOrientation " GLOW "Shape \"sphere\" \"float radius\" 4", {0.1f, -0.7f, 0.5f}, 1},
        {"ReverseOrientation " GLOW "Shape \"sphere\" \"float radius\" 4", {0, 0, 0}, 1},
        /* One on each side, so that the edges of both cones are circles around the axis. */
        {GLOW "Shape \"sphere\" Translate 0 0 5 Shape \"sphere\" \"float radius\" 0.7", {0, 0, 2}, 1},
    };
    enum { CASES = sizeof cases / sizeof *cases };
    struct render_settings settings = imported_settings(8, 8, 4);

    (void)state;
    for (size_t i = 0; i < CASES; i++) {
        struct import_result import;
        struct view view = {0};
        struct chi_square_setup setup = {.sample = sample, .pdf = density, .user = &view,
                                         .samples = 40000, .seed = 31 + i,
                                         .focus = cases[i].focus, .aligned = 1};
        const struct sphere_shape *shape;
        struct render_scene *scene;
        struct vec3 centre;

        pbrt_world(cases[i].world, &import);
        scene = imported_build(&import, &settings, 0);
        assert_non_null(scene->instances[0].shape);
        shape = sphere_of(scene->instances[0].shape);
        centre = vec3_make((float)shape->centre[0], (float)shape->centre[1], (float)shape->centre[2]);
        view.scene = scene;
        view.context.p = vec3_mad(centre, cases[i].from, (float)shape->radius);
        setup.axis = vec3_is_black(cases[i].from) ? vec3_make(0, 0, 1) : vec3_normalize(vec3_neg(cases[i].from));
        assert_true(chi_square_accept(&setup, 0.01, CASES, cases[i].world));
        render_scene_free(scene);
        import_result_release(&import);
    }
}

/* ---- pictures --------------------------------------------------------------------------------- */

enum { FRAMES = 24 };

/* The mean of the first channel over `frames` pictures of a view that shows one value. */
static struct running_stats picture_means(const char *text, uint32_t spp)
{
    struct render_settings settings = imported_settings(8, 8, spp);
    struct running_stats out = {0};
    struct import_result import;
    struct render_scene *scene;
    float picture[8 * 8 * 3];

    imported_text(text, "a.pbrt", NULL, &import);
    settings.max_depth = 64;
    scene = imported_build(&import, &settings, 0);
    for (uint32_t frame = 0; frame < FRAMES; frame++) {
        double sum = 0;

        imported_render_scene(scene, &settings, frame, picture);
        for (int i = 0; i < 64; i++)
            sum += (double)picture[3 * i];
        running_stats_add(&out, sum / 64);
    }
    render_scene_free(scene);
    import_result_release(&import);
    return out;
}

/* The camera looks straight down at the middle of a large square through a tiny angle. */
#define LOOK_DOWN "LookAt 0 -3 0.5  0 0 0  0 0 1 Camera \"perspective\" \"float fov\" 0.02\nFilm \"rgb\" WorldBegin\n"
#define SQUARE "Shape \"trianglemesh\" \"point3 P\" [-9 -9 0 9 -9 0 9 9 0 -9 9 0] " \
               "\"integer indices\" [0 1 2 0 2 3]\n"
#define GREY "Material \"diffuse\" \"rgb reflectance\" [.5 .5 .5] "
/* Mostly found by the BSDF: without the lamp's own light path both ways must share it. */
#define BLACK "Material \"diffuse\" \"rgb reflectance\" [0 0 0] "

static void test_pictures(void **state)
{
    static const struct {
        const char *text;
        double expected;
    } cases[] = {
        /* albedo / pi times pi L (r / d)^2 */
        {LOOK_DOWN GREY SQUARE "Translate 0 0 4 " BLACK GLOW "Shape \"sphere\"", 0.5 * 3 / 16},
        {LOOK_DOWN GREY SQUARE "Translate 0 0 400 " BLACK GLOW "Shape \"sphere\"", 0.5 * 3 / 160000},
        {LOOK_DOWN GREY SQUARE "Translate 0 0 1.05 " BLACK GLOW "Shape \"sphere\"", 0.5 * 3 / (1.05 * 1.05)},
        /* Inside a black lamp that fills the view: all of its radiance, times the albedo. */
        {LOOK_DOWN GREY "Shape \"sphere\" \"float radius\" 0.3 ReverseOrientation " BLACK GLOW
                   "Shape \"sphere\" \"float radius\" 20", 0.5 * 3},
        /* Glass lets all light through; seen in a furnace it vanishes. */
        {LOOK_DOWN "Material \"dielectric\" Shape \"sphere\" \"float radius\" 0.3 "
                   "ReverseOrientation " BLACK GLOW "Shape \"sphere\" \"float radius\" 20", 3},
        {LOOK_DOWN "Material \"dielectric\" \"float roughness\" 0 Shape \"sphere\" "
                   "LightSource \"infinite\" \"rgb L\" [2 2 2]", 2},
    };
    enum { CASES = sizeof cases / sizeof *cases };

    (void)state;
    for (size_t i = 0; i < CASES; i++) {
        struct running_stats s = picture_means(cases[i].text, 64);

        if (fabs(s.mean / cases[i].expected - 1) > 1e-5 &&
            mean_test_p_value(&s, cases[i].expected) < sidak_alpha(0.01, CASES))
            fail_msg("%s: mean %.7g +- %.2g, not %.7g", cases[i].text, s.mean, running_stats_error(&s),
                     cases[i].expected);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_directions),
                                       cmocka_unit_test(test_pictures)};

    return cmocka_run_group_tests_name("sphere_light", tests, NULL, NULL);
}
