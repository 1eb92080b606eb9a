/* Cameras in whole pictures: the blur of a lens and the places on a panorama.
 *
 * Family-wise significance 0.01, Sidak-corrected over all comparisons; seeds are fixed. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "common/scene/effects.h"
#include "tests/support/radiance.h"

enum { COMPARISONS = 40, SIDE = 28 };

#define LAMP 0.02f /* half its width */
#define RADIANCE 1000
#define FIELD 0.3f /* radians */

/* Second moment about the picture's middle, across and up together, of all that is seen. */
static double moment(const double *picture, const struct render_settings *settings, const void *user)
{
    double sum = 0, half = 0.5 * settings->width;

    (void)user;
    for (uint32_t y = 0; y < settings->height; y++)
        for (uint32_t x = 0; x < settings->width; x++)
            sum += picture[3 * (y * settings->width + x)] * (pow(x + 0.5 - half, 2) + pow(y + 0.5 - half, 2));
    return sum;
}

static double total(const double *picture, const struct render_settings *settings, const void *user)
{
    double sum = 0;

    (void)user;
    for (uint32_t i = 0; i < settings->width * settings->height; i++)
        sum += picture[3 * i];
    return sum;
}

/* The pixel filter, a Blackman-Harris window 3 pixels wide (its integral is 3 * 0.35875). */
static double filter_weight(double x)
{
    double turn = (x / 1.5 + 1) * M_PI;

    if (fabs(x) >= 1.5)
        return 0;
    return (0.35875 - 0.48829 * cos(turn) + 0.14128 * cos(2 * turn) - 0.01168 * cos(3 * turn)) / (3 * 0.35875);
}

/* What a strip of light of this width with its middle at p adds to the pixels' sum and to their
 * second moment, along one side of the picture; pixels' middles are at n + 1/2. */
enum { STRIP_STEPS = 2048, STRIP_REACH = 8 };
struct strip {
    double sum[STRIP_STEPS], moment[STRIP_STEPS];
};

static void strip_fill(struct strip *strip, double width)
{
    const int parts = 24;

    memset(strip, 0, sizeof *strip);
    for (int i = 0; i < STRIP_STEPS; i++)
        for (int k = 0; k < parts; k++) {
            double p = (double)i / STRIP_STEPS * STRIP_REACH + width * ((k + 0.5) / parts - 0.5);
            for (int n = (int)floor(p) - 2; n <= (int)floor(p) + 2; n++) {
                double w = filter_weight(n + 0.5 - p) * width / parts;
                strip->sum[i] += w;
                strip->moment[i] += w * (n + 0.5) * (n + 0.5);
            }
        }
}

/* Sum and second moment of a square lamp's picture of this width behind an aperture whose image,
 * for a point of light, has this radius; all in pixels. Both are even in p. */
static void blurred(double width, double radius, uint32_t blades, double rotation, double *sum, double *second)
{
    static struct strip strip;
    const int rings = 60, turns = 360;
    double area = 0;

    strip_fill(&strip, width);
    *sum = *second = 0;
    for (int i = 0; i < rings; i++)
        for (int k = 0; k < turns; k++) {
            double angle = 2 * M_PI * (k + 0.5) / turns, edge = 1, r, w;
            size_t x, y;
            if (blades) { /* distance of the polygon's edge in this direction */
                double part = 2 * M_PI / blades, within = fmod(angle, part) - part / 2;
                edge = cos(part / 2) / cos(within);
            }
            r = edge * (i + 0.5) / rings;
            w = r * edge;
            x = (size_t)lround(fabs(r * radius * cos(angle + rotation)) / STRIP_REACH * STRIP_STEPS);
            y = (size_t)lround(fabs(r * radius * sin(angle + rotation)) / STRIP_REACH * STRIP_STEPS);
            assert_true(x < STRIP_STEPS && y < STRIP_STEPS);
            area += w;
            *sum += w * strip.sum[x] * strip.sum[y];
            *second += w * (strip.sum[x] * strip.moment[y] + strip.moment[x] * strip.sum[y]);
        }
    *sum /= area;
    *second /= area;
}

/* A small lamp at `away`, before a lens that is focused elsewhere. */
static void lamp_scene(struct scene_builder *b, float away, float focus, uint32_t blades)
{
    struct scene_camera *camera;
    struct scene_material *m;

    builder_init(b);
    m = builder_lambert(b, 0);
    m->emission[0] = m->emission[1] = m->emission[2] = RADIANCE;
    builder_place(b, builder_quad(b), 0, vec3_make(LAMP, 1, LAMP), vec3_splat(0));
    builder_camera(b, vec3_make(0, away, 0), vec3_splat(0), FIELD);
    camera = &b->scene.cameras[0];
    camera->lens_radius = 0.2f;
    camera->focus_distance = focus;
    camera->blades = blades;
    camera->blade_rotation_rad = 0.3f;
}

/* The circle of confusion on the plane that is sharp has the radius lens * |focus - away| / away.
 * Its picture's sum and second moment, against quadrature over the aperture. */
static void test_circle_of_confusion(void **state)
{
    static const struct { float away, focus; uint32_t blades; } cases[] = {
        {4, 6, 0}, {6, 4, 0}, {5, 5, 0}, {3, 6, 3}, {3, 6, 6},
    };
    const double rotation = (double)0.3f;

    (void)state;
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        struct render_settings settings = builder_settings(SIDE, SIDE, 64);
        double away = (double)cases[k].away, focus = (double)cases[k].focus;
        double pixel = 2 * focus * tan((double)FIELD / 2) / SIDE;
        double width = 2 * (double)LAMP * focus / away / pixel, sum, second;
        double radius = (double)0.2f * fabs(focus - away) / away / pixel;
        struct scene_builder b;
        settings.max_depth = 0;
        lamp_scene(&b, cases[k].away, cases[k].focus, cases[k].blades);
        blurred(width, radius, cases[k].blades, rotation, &sum, &second);
        radiance_expect_value(&b, &settings, COMPARISONS, total, NULL, RADIANCE * sum, "a lamp's picture");
        radiance_expect_value(&b, &settings, COMPARISONS, moment, NULL, RADIANCE * second, "circle of confusion");
        settings.without = EFFECT_DEPTH_OF_FIELD;
        blurred(width, 0, 0, 0, &sum, &second);
        radiance_expect_value(&b, &settings, COMPARISONS, moment, NULL, RADIANCE * second, "without a lens");
        builder_release(&b);
    }
}

/* Six lamps about the camera, each of a colour of its own: where each is seen. */
static void test_panorama(void **state)
{
    static const struct {
        float direction[3];
        uint32_t x, y; /* of 64 x 32, a pixel next to its middle */
    } lamps[6] = {
        {{0, 0, -1}, 32, 16}, {{1, 0, 0}, 48, 16}, {{0, 0, 1}, 0, 16},
        {{-1, 0, 0}, 16, 16}, {{0, 1, 0}, 20, 0},  {{0, -1, 0}, 50, 31},
    };

    (void)state;
    for (int turned = 0; turned < 2; turned++) {
        struct render_settings settings = builder_settings(64, 32, 4);
        double picture[64 * 32 * 3];
        struct render_scene *scene;
        struct render_stats stats = {0};
        struct scene_builder b;
        uint32_t ball;
        settings.max_depth = 0;
        builder_init(&b);
        ball = builder_sphere(&b, 8, 0);
        for (int i = 0; i < 6; i++) {
            struct scene_material *m = builder_lambert(&b, 0);
            const float *d = lamps[i].direction;
            m->emission[0] = (float)(1 + (i & 1));
            m->emission[1] = (float)(1 + (i >> 1 & 1));
            m->emission[2] = (float)(1 + (i >> 2 & 1));
            builder_place(&b, ball, (uint32_t)i, vec3_splat(1.5f), vec3_make(1 + 4 * d[0], 2 + 4 * d[1], 3 + 4 * d[2]));
        }
        builder_environment_constant(&b, vec3_make(0.25f, 0.5f, 0.75f));
        builder_camera(&b, vec3_make(1, 2, 3), vec3_make(turned ? 2 : 1, 2, turned ? 3 : 2), 1);
        b.scene.cameras[0].kind = CAMERA_PANORAMA;
        scene = builder_build(&b, &settings);
        builder_render(scene, &settings, 0, picture, NULL, &stats);
        for (int i = 0; i < 6; i++) {
            /* Looking along +X everything is seen a quarter of the way further left. */
            uint32_t x = (lamps[i].x + (turned ? 48 : 0)) % 64;
            const double *p = picture + 3 * (lamps[i].y * 64 + x);
            for (int c = 0; c < 3; c++)
                assert_true(fabs(p[c] - (double)b.scene.materials[i].emission[c]) < 1e-6);
        }
        /* Between four of them there is but sky. */
        for (uint32_t x = 8; x < 64; x += 16) {
            const double *p = picture + 3 * (16 * 64 + x);
            assert_true(fabs(p[0] - 0.25) < 1e-6 && fabs(p[1] - 0.5) < 1e-6 && fabs(p[2] - 0.75) < 1e-6);
        }
        render_scene_free(scene);
        builder_release(&b);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_circle_of_confusion),
        cmocka_unit_test(test_panorama),
    };
    return cmocka_run_group_tests_name("lens radiance", tests, NULL, NULL);
}
