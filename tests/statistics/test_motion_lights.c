/* Lights that move while the shutter is open: what a plane below them receives is the mean over
 * time, in closed form. Family-wise significance 0.01, Sidak-corrected; seeds are fixed. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <cmocka.h>

#include "common/scene/effects.h"
#include "tests/support/scene_builder.h"
#include "tests/support/statistics.h"
#include "worker/render/render_scene.h"

enum { SIZE = 62, PIXELS = SIZE * SIZE, SPP = 16, COMPARISONS = 40 };

/* A turn is mixed from directions that may miss it by a thousandth (worker/render/scene/render_pose.h). */
#define CHORD 1e-3
#define HEIGHT 2.0
#define INTENSITY 5.0
#define ALBEDO 0.8

/* A plane, looked at at (x, 0, 0); a light 2 m above its middle that follows node 0. */
static struct scene_light *moving_light(struct scene_builder *b, enum scene_light_kind kind, double x)
{
    struct scene_light *l;

    builder_init(b);
    builder_lambert(b, (float)ALBEDO);
    builder_place(b, builder_quad(b), 0, vec3_make(20, 1, 20), vec3_splat(0));
    builder_camera(b, vec3_make((float)x, 9, 0), vec3_make((float)x, 0, 0), 0.00002f);
    builder_node(b, -1, 0);
    b->scene.nodes[0].translation[1] = (float)HEIGHT;
    l = builder_light(b, kind);
    l->node = 0;
    l->falloff = FALLOFF_SMOOTHSTEP;
    for (int c = 0; c < 3; c++)
        l->intensity[c] = (float)INTENSITY;
    return l;
}

/* In one second the light turns from `first` to `last`, radians from straight down towards +X. */
static void turn(struct scene_builder *b, double first, double last)
{
    static const float times[2] = {0, 1};
    double at[2] = {first, last}, s = sqrt(0.5);
    float values[8];

    for (int k = 0; k < 2; k++) {
        /* down, then about Z */
        double sine = sin(at[k] / 2), cosine = cos(at[k] / 2);
        values[4 * k] = (float)(-s * cosine);
        values[4 * k + 1] = (float)(-s * sine);
        values[4 * k + 2] = (float)(s * sine);
        values[4 * k + 3] = (float)(s * cosine);
    }
    builder_channel(b, 0, PATH_ROTATION, 2, times, values);
}

/* The picture's mean and its standard error: all pixels see one spot, and each pixel and each call has random
 * numbers of its own. */
static double measure(struct scene_builder *b, uint64_t without, double *error)
{
    struct render_settings settings = builder_settings(SIZE, SIZE, SPP);
    static double picture[PIXELS * 3];
    struct running_stats pixels = {0};
    struct render_stats stats = {0};
    struct render_scene *scene;
    static uint64_t calls;

    settings.seed = calls++;
    settings.fps = 1;
    settings.shutter = 1;
    settings.max_depth = 1;
    settings.without = without;
    scene = builder_build(b, &settings);
    builder_render(scene, &settings, 0, picture, NULL, &stats);
    render_scene_free(scene);
    for (int i = 0; i < PIXELS; i++)
        running_stats_add(&pixels, picture[3 * i]);
    *error = running_stats_error(&pixels);
    return pixels.mean;
}

/* z-test against the irradiance; what it would be with the light as at the shutter's opening is
 * rejected, unless motion blur is left out. */
static void expect(struct scene_builder *b, double irradiance, double at_opening, double slack, const char *what)
{
    double scale = ALBEDO / M_PI, error, mean = measure(b, 0, &error), difference;

    difference = fmax(fabs(mean - scale * irradiance) - slack * scale * irradiance, 0);
    difference = fmax(difference - 1e-5 * scale * irradiance, 0); /* floats */
    if (difference > 0 && erfc(difference / error / sqrt(2)) < sidak_alpha(0.01, COMPARISONS))
        fail_msg("%s: %g instead of %g +- %g", what, mean, scale * irradiance, error);
    if (fabs(mean - scale * at_opening) < 10 * error + 0.01 * scale * irradiance)
        fail_msg("%s: %g is as if it stood as at the shutter's opening", what, mean);
    mean = measure(b, EFFECT_MOTION_BLUR, &error);
    if (fabs(mean - scale * at_opening) > 5 * error + 1e-4 * scale * at_opening)
        fail_msg("%s, without blur: %g instead of %g", what, mean, scale * at_opening);
}

/* Irradiance of the plane at x, by a point light above `at`. */
static double from_point(double x, double at)
{
    double r2 = (x - at) * (x - at) + HEIGHT * HEIGHT;

    return INTENSITY * HEIGHT / (r2 * sqrt(r2));
}

/* Along a line from -2 to 3: the integral of h / (s^2 + h^2)^(3/2) is s / (h sqrt(s^2 + h^2)). */
static double from_line(double x)
{
    double s = 3 - x, t = -2 - x;

    return INTENSITY / (5 * HEIGHT) * (s / sqrt(s * s + HEIGHT * HEIGHT) - t / sqrt(t * t + HEIGHT * HEIGHT));
}

static void test_point_on_a_line(void **state)
{
    static const double xs[] = {-3, -1, 1, 2.5};
    static const float times[2] = {0, 1},
                       line[6] = {-2, (float)HEIGHT, 0, 3, (float)HEIGHT, 0};

    (void)state;
    for (size_t k = 0; k < 4; k++)
        for (int round = 0; round < 2; round++) {
            struct scene_builder b;
            moving_light(&b, round ? LIGHT_GONIOMETRIC : LIGHT_POINT, xs[k]);
            builder_channel(&b, 0, PATH_TRANSLATION, 2, times, line);
            expect(&b, from_line(xs[k]), from_point(xs[k], -2), 0,
                   round ? "goniometric light on a line" : "point light on a line");
            builder_release(&b);
        }
}

/* A second light, which stands, to share the tree of lights: one alone is always chosen. */
static void company(struct scene_builder *b, double intensity)
{
    struct scene_light *l = builder_light(b, LIGHT_POINT);

    l->position[1] = (float)HEIGHT;
    for (int c = 0; c < 3; c++)
        l->intensity[c] = (float)intensity;
}

/* Up through the plane, from -1 to 2: from below it sends nothing to the side that is seen, and
 * whoever took it to stay there would never ask it. The integral of y / (x^2 + y^2)^(3/2) is
 * -1 / sqrt(x^2 + y^2). */
static void test_rising_point(void **state)
{
    static const float times[2] = {0, 1}, rise[6] = {0, -1, 0, 0, 2, 0};
    const double x = 1.5, other = from_point(x, 0) / 8;
    struct scene_builder b;

    (void)state;
    moving_light(&b, LIGHT_POINT, x);
    builder_channel(&b, 0, PATH_TRANSLATION, 2, times, rise);
    company(&b, INTENSITY / 8);
    expect(&b, other + INTENSITY / 3 * (1 / x - 1 / sqrt(x * x + 4)), other, 0, "rising point light");
    builder_release(&b);
}

/* A beam with a hard edge, `half` wide to either side, sweeps from `first` to `last`: the share of
 * the time in which it holds the angle. */
static double share_of_sweep(double angle, double half, double first, double last)
{
    double from = fmin(fmax(angle - half, first), last), to = fmin(fmax(angle + half, first), last);

    return (to - from) / (last - first);
}

/* At the opening the beam is far from what is looked at: a tree of lights that knew no more than
 * that would never choose it. */
static void test_sweeping_beams(void **state)
{
    static const double angles[] = {-0.5, 0, 0.4, 0.85};
    const double first = -1.4, last = 0.7;

    (void)state;
    for (size_t k = 0; k < 4; k++)
        for (int kind = 0; kind < 4; kind++) {
            double x = HEIGHT * tan(angles[k]), half = 0.3, full = from_point(x, 0), other = 0;
            int projects = kind & 1, in_company = kind & 2;
            struct scene_builder b;
            struct scene_light *l = moving_light(&b, projects ? LIGHT_PROJECTION : LIGHT_SPOT, x);
            l->inner_cone_rad = (float)half - 1e-5f;
            l->outer_cone_rad = (float)half;
            l->projection_yfov_rad = (float)(2 * half);
            l->projection_aspect = 1;
            /* the image lies with its x along the sweep or across: square, so both are one */
            turn(&b, first, last);
            if (in_company) {
                company(&b, INTENSITY / 2);
                other = full / 2;
            }
            expect(&b, other + full * share_of_sweep(angles[k], half, first, last), other, 2 * CHORD / half,
                   projects ? "sweeping projector" : "sweeping spot light");
            builder_release(&b);
        }
}

/* The sun from one side of the sky to the other, below the horizon at first: the mean of the
 * positive part of a cosine. */
static void test_turning_sun(void **state)
{
    struct scene_builder b;
    const double first = -2, last = 1;

    (void)state;
    moving_light(&b, LIGHT_DIRECTIONAL, 0);
    turn(&b, first, last);
    expect(&b, INTENSITY * (sin(last) + 1) / (last - first), 0, 2 * CHORD, "turning sun");
    builder_release(&b);
}

/* At the moments between which a light is interpolated it is where it was put, in whatever way its node is mirrored. */
static void test_poses_at_their_moments(void **state)
{
    static const float white[3] = {1, 1, 1};

    (void)state;
    for (int k = 0; k < 16; k++) {
        struct render_settings settings = builder_settings(4, 4, 1);
        const struct punctual *light;
        struct render_scene *scene;
        struct scene_builder b;

        settings.fps = settings.shutter = 1;
        moving_light(&b, k & 1 ? LIGHT_PROJECTION : LIGHT_GONIOMETRIC, 0)->image = 0;
        (void)builder_texture(&b, white, 1, 1);
        turn(&b, -1.4, 0.9);
        for (int c = 0; c < 3; c++)
            b.scene.nodes[0].scale[c] = k >> (c + 1) & 1 ? -1 : 1;
        scene = builder_build(&b, &settings);
        light = scene->emitters.punctual[0];
        assert_true(light->motion.steps > 2);
        for (uint32_t i = 0; i < light->motion.steps; i++) {
            struct punctual_pose moved;
            const struct punctual_pose *got = punctual_pose_at(light, (real)i / (real)(light->motion.steps - 1), &moved);
            const struct punctual_pose *put = &light->motion.at[i];

            assert_true(vec3_length(vec3_sub(got->position, put->position)) < 1e-5f);
            for (int a = 0; a < 3; a++)
                if (!(vec3_length(vec3_sub(got->axis[a], put->axis[a])) < 1e-5f))
                    fail_msg("light %d, moment %u of %u, axis %d: (%g %g %g), not (%g %g %g)", k, i, light->motion.steps, a,
                             (double)got->axis[a].x, (double)got->axis[a].y, (double)got->axis[a].z, (double)put->axis[a].x,
                             (double)put->axis[a].y, (double)put->axis[a].z);
        }
        render_scene_free(scene);
        builder_release(&b);
    }
}

/* A lamp that travels: a small square that faces down, of half side 2 cm, from -2 to 3. The cosines at both
 * ends are h / r: the integral of h^2 / (s^2 + h^2)^2 is s / (2 (s^2 + h^2)) + atan(s / h) / (2 h). The lamp's
 * own size changes that by less than 1e-4. */
static double from_lamp(double x, double from, double to)
{
    const double area = 0.0016, h2 = HEIGHT * HEIGHT;
    double s = to - x, t = from - x;

    if (from == to)
        return INTENSITY * area * h2 / ((s * s + h2) * (s * s + h2));
    return INTENSITY * area / (to - from) *
           (s / (2 * (s * s + h2)) + atan(s / HEIGHT) / (2 * HEIGHT) - t / (2 * (t * t + h2)) -
            atan(t / HEIGHT) / (2 * HEIGHT));
}

static void test_lamp_on_a_line(void **state)
{
    static const double xs[] = {-3, -1, 2.5};
    static const float times[2] = {0, 1},
                       line[6] = {-2, (float)HEIGHT, 0, 3, (float)HEIGHT, 0};

    (void)state;
    for (size_t k = 0; k < 3; k++) {
        struct scene_builder b;
        struct scene_material *m;
        struct scene_light *l = moving_light(&b, LIGHT_POINT, xs[k]);

        for (int c = 0; c < 3; c++)
            l->intensity[c] = 0;
        m = builder_lambert(&b, 0);
        m->double_sided = 0;
        m->emission[0] = m->emission[1] = m->emission[2] = (float)INTENSITY;
        builder_place(&b, 0, 1, vec3_make(0.02f, -1, 0.02f), vec3_make(0, (float)HEIGHT, 0))->node = 0;
        builder_channel(&b, 0, PATH_TRANSLATION, 2, times, line);
        b.scene.nodes[0].scale[0] = b.scene.nodes[0].scale[2] = 0.02f;
        b.scene.nodes[0].scale[1] = -1;
        expect(&b, from_lamp(xs[k], -2, 3), from_lamp(xs[k], -2, -2), 2e-3, "lamp on a line");
        builder_release(&b);
    }
}

/* Fog that a light travels through: what it scatters once is the mean over the light's places. */
static void fog_scene(struct scene_builder *b, double at)
{
    static const float times[2] = {0, 1}, line[6] = {-2, (float)HEIGHT, 0, 3, (float)HEIGHT, 0};
    struct scene_medium *fog;

    moving_light(b, LIGHT_POINT, 4.5); /* seen from above, beside its path */
    fog = builder_medium(b);
    for (int c = 0; c < 3; c++)
        fog->scattering[c] = 0.2f;
    b->scene.fog = (int32_t)(b->scene.medium_count - 1);
    if (at < 0)
        builder_channel(b, 0, PATH_TRANSLATION, 2, times, line);
    else
        b->scene.nodes[0].translation[0] = (float)(-2 + 5 * at);
}

static void test_light_in_fog(void **state)
{
    enum { PLACES = 16 };
    double error, mean, places = 0, variance = 0, opening, z;
    struct scene_builder b;

    (void)state;
    for (int i = 0; i < PLACES; i++) {
        double one;

        fog_scene(&b, (i + 0.5) / PLACES);
        places += measure(&b, 0, &one) / PLACES;
        variance += one * one / PLACES / PLACES;
        builder_release(&b);
    }
    fog_scene(&b, -1);
    mean = measure(&b, 0, &error);
    opening = measure(&b, EFFECT_MOTION_BLUR, &z);
    builder_release(&b);
    z = fabs(mean - places) / sqrt(error * error + variance);
    if (erfc(z / sqrt(2)) < sidak_alpha(0.01, COMPARISONS))
        fail_msg("fog: %g +- %g instead of %g +- %g", mean, error, places, sqrt(variance));
    if (!(fabs(mean - opening) > 10 * error))
        fail_msg("fog: %g +- %g is as if the light stood as at the opening, %g", mean, error, opening);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_point_on_a_line),
        cmocka_unit_test(test_rising_point),
        cmocka_unit_test(test_sweeping_beams),
        cmocka_unit_test(test_turning_sun),
        cmocka_unit_test(test_poses_at_their_moments),
        cmocka_unit_test(test_lamp_on_a_line),
        cmocka_unit_test(test_light_in_fog),
    };

    return cmocka_run_group_tests_name("lights that move", tests, NULL, NULL);
}
