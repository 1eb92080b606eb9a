/* Light of lamps without size by way of one smooth surface (worker/render/caustic) against closed forms: water over a
 * floor, lamps in and above it, mirrors flat and round.
 *
 * Where nothing is random but the place within a narrow pixel, pictures are compared within bounds; what is seen through
 * the surface by t-tests, of a family-wise significance of 0.01, Sidak-corrected. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "common/scene/effects.h"
#include "tests/support/radiance.h"
#include "worker/render/render_scene.h"

enum { COMPARISONS = 30 };
#define ALBEDO 0.6
#define WATER 1.33
#define RADIUS 0.5

static void expect_near(struct scene_builder *b, const struct render_settings *settings, double expected, double bound,
                        const char *what)
{
    struct running_stats found[3];

    radiance_measure(b, settings, found);
    for (int c = 0; c < 3; c++) {
        if (!(fabs(found[c].mean - expected) <= bound * expected + 1e-9))
            print_message("%s: %.7g, expected %.7g\n", what, found[c].mean, expected);
        assert_true(fabs(found[c].mean - expected) <= bound * expected + 1e-9);
    }
}

static struct render_settings shallow(uint32_t depth)
{
    struct render_settings s = builder_settings(4, 4, 4);

    s.max_depth = depth;
    return s;
}

/* A floor at y = 0, of which a camera at (x, height, 0) sees the spot at (x, 0, 0). */
static void floor_seen(struct scene_builder *b, double x, double height)
{
    builder_init(b);
    builder_lambert(b, (float)ALBEDO);
    builder_place(b, builder_quad(b), 0, vec3_make(20, 1, 20), vec3_splat(0));
    builder_camera(b, vec3_make((real)x, (real)height, 0), vec3_make((real)x, 0, 0), 0.0005f);
}

static struct scene_light *lamp_at(struct scene_builder *b, double x, double y)
{
    struct scene_light *l = builder_light(b, LIGHT_POINT);

    l->position[0] = (float)x;
    l->position[1] = (float)y;
    l->intensity[0] = l->intensity[1] = l->intensity[2] = 5;
    return l;
}

static struct scene_material *water(struct scene_builder *b)
{
    struct scene_material *m = builder_lambert(b, 1);

    m->roughness = 0;
    m->transmission = 1;
    m->refractive = 1;
    m->specular = m->specular_color[0] = m->specular_color[1] = m->specular_color[2] = 1;
    m->ior = (float)WATER;
    return m;
}

static struct scene_material *mirror(struct scene_builder *b, double reflectance)
{
    struct scene_material *m = builder_lambert(b, (float)reflectance);

    m->roughness = 0;
    m->metallic = 1;
    return m;
}

/* Fresnel's exact term. */
static double transmitted(double cos_i, double eta)
{
    const double sin2 = (1 - cos_i * cos_i) / (eta * eta), cos_t = sqrt(1 - sin2);
    const double s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t), p = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);

    return 1 - (s * s + p * p) / 2;
}

/* Where light that a lamp `h` above a layer of depth `d` sends down at the angle reaches the floor. */
static double lands(double angle, double h, double d, double eta)
{
    return h * tan(angle) + d * tan(asin(sin(angle) / eta));
}

/* Irradiance of the floor at a distance from the lamp's foot. */
static double layered(double r, double h, double d, double eta)
{
    double low = 0, high = M_PI / 2, angle, slope;

    if (eta < 1)
        high = asin(eta);
    for (int i = 0; i < 200; i++) {
        angle = (low + high) / 2;
        if (lands(angle, h, d, eta) > r)
            high = angle;
        else
            low = angle;
    }
    slope = (lands(angle + 1e-6, h, d, eta) - lands(angle - 1e-6, h, d, eta)) / 2e-6;
    return 5 * transmitted(cos(angle), eta) * (r > 0 ? sin(angle) / (r * slope) : 1 / (slope * slope));
}

/* Seen from below the surface, and through it. */
static void test_water(void **state)
{
    static const double xs[] = {0, 0.7, 2.5, 6};

    (void)state;
    for (size_t i = 0; i < 4; i++)
        for (int above = 0; above < 2; above++) {
            struct render_settings settings = shallow(above ? 3 : 2);
            struct scene_builder b;
            double expected = ALBEDO / M_PI * layered(xs[i], 1.5, 0.8, WATER);

            floor_seen(&b, xs[i], above ? 3 : 0.4);
            (void)water(&b);
            builder_place(&b, builder_quad(&b), builder_last_material(&b), vec3_make(20, 1, 20), vec3_make(0, REAL(0.8), 0));
            (void)lamp_at(&b, 0, 2.3);
            if (above)
                expected *= transmitted(1, WATER) / (WATER * WATER);
            if (above)
                radiance_expect(&b, &settings, COMPARISONS, expected, "through the surface");
            else
                expect_near(&b, &settings, expected, 2e-5, "under water");
            settings.without = EFFECT_CAUSTICS;
            expect_near(&b, &settings, 0, 0, "without caustics");
            builder_release(&b);
        }
}

/* A lamp in water that absorbs lights the wall above it; beyond the angle of total reflection it does not. */
static void test_lamp_in_water(void **state)
{
    static const double xs[] = {0, 0.5, 1.5};

    (void)state;
    for (size_t i = 0; i < 3; i++)
        for (int absorbs = 0; absorbs < 2; absorbs++) {
            struct render_settings settings = shallow(2);
            struct scene_material *m;
            struct scene_builder b;
            double expected = ALBEDO / M_PI * layered(xs[i], 0.6, 0.9, 1 / WATER);

            floor_seen(&b, xs[i], 0.5); /* the "floor" is a ceiling upside down: water lies above y = 0.9 */
            m = water(&b);
            if (absorbs) {
                m->attenuation_distance = 2;
                m->attenuation_color[0] = m->attenuation_color[1] = m->attenuation_color[2] = 0.5f;
            }
            builder_place(&b, builder_quad(&b), builder_last_material(&b), vec3_make(20, -1, 20), vec3_make(0, REAL(0.9), 0));
            (void)lamp_at(&b, 0, 1.5);
            if (absorbs) {
                double angle = 0;
                for (int k = 0; k < 100000 && lands(angle, 0.6, 0.9, 1 / WATER) < xs[i]; k++)
                    angle = asin(1 / WATER) * k / 100000;
                expected *= pow(0.5, 0.6 / cos(angle) / 2);
            }
            expect_near(&b, &settings, expected, absorbs ? 1e-3 : 2e-5, absorbs ? "a lamp in absorbing water" : "a lamp in water");
            builder_release(&b);
        }
}

/* A caustic in dyed water fades once on its way, whatever media are elsewhere in the scene. */
static void test_dyed_water(void **state)
{
    (void)state;
    for (int media = 0; media < 2; media++) {
        struct render_settings settings = shallow(2);
        struct scene_material *m;
        struct scene_builder b;

        floor_seen(&b, 0, 0.4);
        m = water(&b);
        m->attenuation_distance = 2;
        m->attenuation_color[0] = m->attenuation_color[1] = m->attenuation_color[2] = 0.5f;
        builder_place(&b, builder_slab(&b), builder_last_material(&b), vec3_make(20, REAL(0.5), 20), vec3_make(0, REAL(0.3), 0));
        (void)lamp_at(&b, 0, 2.3);
        if (media) {
            builder_medium(&b)->absorption[0] = 1;
            m = builder_lambert(&b, 0);
            m->kind = MATERIAL_INTERFACE;
            m->medium = 0;
            builder_place(&b, builder_slab(&b), builder_last_material(&b), vec3_splat(1), vec3_make(0, 0, 50));
        }
        expect_near(&b, &settings, ALBEDO / M_PI * layered(0, 1.5, 0.8, WATER) * pow(0.5, (0.8 + 0.4) / 2), 1e-3,
                    media ? "under dyed water, and a medium elsewhere" : "under dyed water");
        builder_release(&b);
    }
}

/* The sun on water: a beam narrows as it enters. */
static void test_sun(void **state)
{
    (void)state;
    for (int i = 0; i < 4; i++) {
        const double angle = 0.4 * i;
        struct render_settings settings = shallow(2);
        struct scene_light *l;
        struct scene_builder b;

        floor_seen(&b, 0, 0.4);
        (void)water(&b);
        builder_place(&b, builder_quad(&b), builder_last_material(&b), vec3_make(20, 1, 20), vec3_make(0, REAL(0.8), 0));
        l = builder_light(&b, LIGHT_DIRECTIONAL);
        l->direction[0] = (float)sin(angle);
        l->direction[1] = (float)-cos(angle);
        l->direction[2] = 0;
        l->intensity[0] = l->intensity[1] = l->intensity[2] = 3;
        expect_near(&b, &settings, ALBEDO / M_PI * 3 * cos(angle) * transmitted(cos(angle), WATER), 2e-5, "the sun");
        builder_release(&b);
    }
}

/* A mirror on the wall beside a lamp. Irradiance of the spot at x, the mirror's share apart. */
static struct scene_instance *mirror_on_wall(struct scene_builder *b, double x, double reflectance, double *direct,
                                             double *mirrored)
{
    const double lit = 2 - x, r2 = (x - 1) * (x - 1) + 1.5 * 1.5, far2 = (lit + 1) * (lit + 1) + 1.5 * 1.5;
    struct scene_instance *wall;

    floor_seen(b, x, 1);
    (void)mirror(b, reflectance);
    wall = builder_place(b, builder_quad(b), builder_last_material(b), vec3_make(1, 1, 1), vec3_splat(0));
    /* the quad's +y becomes -x, at x = 2, from y = 0 to 4 */
    wall->to_world = (struct transform_d){{{0, -1, 0, 2}, {2, 0, 0, 2}, {0, 0, 2, 0}}};
    (void)lamp_at(b, 1, 1.5);
    *direct = 5 * 1.5 / (r2 * sqrt(r2));
    /* Schlick's term of a metal adds towards grazing */
    *mirrored = (reflectance + (1 - reflectance) * pow(1 - (lit + 1) / sqrt(far2), 5)) * 5 * 1.5 / (far2 * sqrt(far2));
    return wall;
}

/* The lamp's image behind it, beside the lamp itself. */
static void test_mirror(void **state)
{
    (void)state;
    for (int i = 0; i < 8; i++) {
        struct render_settings settings = shallow(2);
        struct scene_instance *wall;
        struct scene_builder b;
        double direct, mirrored;

        wall = mirror_on_wall(&b, 0.3 * (i & 3), 0.8, &direct, &mirrored);
        if (i & 4) /* its mirror image, which faces +x */
            wall->to_world.m[0][1] = 1;
        expect_near(&b, &settings, ALBEDO / M_PI * (direct + mirrored), 2e-5, i & 4 ? "a mirror's back" : "a mirror");
        builder_release(&b);
    }
}

/* Where casters send little, few vertices ask, and what they get counts the more. */
static void test_few_ask(void **state)
{
    struct render_settings settings = shallow(2);
    struct render_scene *scene;
    struct scene_builder b;
    double direct, mirrored;

    (void)state;
    settings.spp = 256;
    (void)mirror_on_wall(&b, 0, 0.1, &direct, &mirrored);
    scene = builder_build(&b, &settings);
    print_message("# %.3f of the vertices ask for %.4f of the light\n", (double)scene->caster_share,
                  mirrored / (direct + mirrored));
    assert_true(scene->caster_share < 1);
    render_scene_free(scene);
    radiance_expect(&b, &settings, COMPARISONS, ALBEDO / M_PI * (direct + mirrored), "few ask");
    builder_release(&b);
}

/* Where a ray that leaves the lamp, `h` above the centre of a ball on the axis beside it, at the angle, reaches the
 * floor at a distance `d` below the ball's centre, reflected: its distance from the axis. */
static double reflected(double angle, double h, double d)
{
    /* from (0, h), direction (sin, -cos), to the ball around the origin */
    const double s = sin(angle), c = cos(angle), t = h * c - sqrt(RADIUS * RADIUS - h * h * s * s);
    const double x = t * s / RADIUS, y = (h - t * c) / RADIUS, along = s * x - c * y;
    const double out_x = s - 2 * along * x, out_y = -c - 2 * along * y;

    return RADIUS * x + out_x * (RADIUS * y + d) / -out_y;
}

/* A round mirror under a spot light throws light onto the floor around it, which the light itself does not reach. The
 * mirror is of triangles with the ball's normals, each of which spreads its light evenly: hence the bound. */
static void test_ball(void **state)
{
    static const double angles[] = {0.33, 0.35, 0.36};

    (void)state;
    for (size_t i = 0; i < 3; i++) {
        const double h = 1.4, d = 1, angle = angles[i], r = reflected(angle, h, d);
        const double slope = (reflected(angle + 1e-6, h, d) - reflected(angle - 1e-6, h, d)) / 2e-6;
        const double s = sin(angle), t = h * cos(angle) - sqrt(RADIUS * RADIUS - h * h * s * s);
        const double mu = -(s * t * s - cos(angle) * (h - t * cos(angle))) / RADIUS;
        struct render_settings settings = shallow(2);
        struct scene_light *l;
        struct scene_builder b;

        floor_seen(&b, r, 0.2);
        (void)mirror(&b, 0.5);
        builder_place(&b, builder_sphere(&b, 200, 1), builder_last_material(&b), vec3_splat((real)RADIUS),
                      vec3_make(0, 1, 0));
        l = lamp_at(&b, 0, 1 + h);
        l->kind = LIGHT_SPOT;
        l->direction[1] = -1;
        l->inner_cone_rad = 0.4f;
        l->outer_cone_rad = 0.41f;
        expect_near(&b, &settings, 5 * ALBEDO / M_PI * (0.5 + 0.5 * pow(1 - mu, 5)) * s / (r * fabs(slope)), 0.03, "a ball");
        settings.without = EFFECT_CAUSTICS;
        expect_near(&b, &settings, 0, 0, "a ball without caustics");
        builder_release(&b);
    }
}

/* ---- suns of a map ----------------------------------------------------------------------------- */

/* A black map but for a disc of 0.7 degrees around (x, y, 0). */
static void sun_towards(struct scene_builder *b, double x, double y)
{
    enum { W = 1024, H = 512 };
    static float map[H * W * 3];
    const double length = sqrt(x * x + y * y);

    for (int row = 0; row < H; row++)
        for (int column = 0; column < W; column++) {
            const double v = M_PI * (row + 0.5) / H, u = 2 * M_PI * ((column + 0.5) / W - 0.5);
            const double cosine = (sin(v) * cos(u) * x + cos(v) * y) / length;

            for (int c = 0; c < 3; c++)
                map[3 * (row * W + column) + c] = cosine > cos(0.7 * M_PI / 180) ? 4000 : 0.01f;
        }
    builder_environment_map(b, map, W, H);
}

/* A spot in the shadow of a black wall, which a mirror lights; and what it sees of a sun behind the mirror's place. */
static void sunny_spot(struct scene_builder *b, int mirrored)
{
    struct scene_instance *wall;

    floor_seen(b, 0, 0.5);
    (void)builder_lambert(b, 0);
    wall = builder_place(b, builder_quad(b), 1, vec3_splat(1), vec3_splat(0));
    wall->to_world = (struct transform_d){{{0, 1, 0, -1}, {1.4, 0, 0, 1.6}, {0, 0, 3, 0}}};
    (void)mirror(b, 1);
    if (mirrored) {
        wall = builder_place(b, builder_quad(b), 2, vec3_splat(1), vec3_splat(0));
        wall->to_world = (struct transform_d){{{0, -1, 0, 2}, {3, 0, 0, 3}, {0, 0, 3, 0}}};
    }
    sun_towards(b, mirrored ? -1 : 1, 1);
}

static void test_sun_off_a_mirror(void **state)
{
    struct render_settings settings = shallow(2);
    struct running_stats found[3];
    struct scene_builder a, b;

    (void)state;
    settings.spp = 256;
    sunny_spot(&a, 1);
    sunny_spot(&b, 0);
    /* the sky's own light differs: it is a thousandth */
    radiance_measure(&a, &settings, found);
    print_message("# off the mirror: %.5g\n", found[0].mean);
    radiance_expect_same(&a, &b, &settings, COMPARISONS, "a sun off a mirror");
    builder_release(&a);
    builder_release(&b);
}

/* A sun that the camera sees in the mirror is met, not asked for. */
static void test_sun_in_a_mirror(void **state)
{
    struct render_settings settings = shallow(3);
    struct scene_builder b;

    (void)state;
    builder_init(&b);
    builder_lambert(&b, (float)ALBEDO);
    builder_place(&b, builder_quad(&b), 0, vec3_splat(1), vec3_make(5, 0, 0));
    (void)mirror(&b, 1);
    builder_place(&b, builder_quad(&b), 1, vec3_splat(1), vec3_splat(0));
    builder_camera(&b, vec3_make(-1, 1, 0), vec3_splat(0), 0.0005f);
    sun_towards(&b, 1, 1);
    expect_near(&b, &settings, 4000, 1e-4, "a sun in a mirror");
    builder_release(&b);
}

/* ---- lamps with area --------------------------------------------------------------------------- */

/* A ball of triangles, small for what is a unit away. */
static struct scene_material *small_lamp(struct scene_builder *b, double x, double y, double radius)
{
    struct scene_material *m = builder_lambert(b, 0);

    m->emission[0] = 900;
    m->emission[1] = 800;
    m->emission[2] = 700;
    builder_place(b, builder_sphere(b, 8, 1), builder_last_material(b), vec3_splat((real)radius),
                  vec3_make((real)x, (real)y, 0));
    return m;
}

/* Two lamps' images in a mirror, against lamps there. */
static void test_lamp_off_a_mirror(void **state)
{
    struct render_settings settings = shallow(2);
    struct scene_instance *wall;
    struct scene_builder a, b;

    (void)state;
    settings.spp = 64;
    floor_seen(&a, 0, 1);
    (void)mirror(&a, 1);
    wall = builder_place(&a, builder_quad(&a), 1, vec3_splat(1), vec3_splat(0));
    wall->to_world = (struct transform_d){{{0, -1, 0, 2}, {2, 0, 0, 2}, {0, 0, 2, 0}}};
    (void)small_lamp(&a, 1, 1.5, 0.05);
    (void)small_lamp(&a, 0.5, 1.2, 0.03);
    floor_seen(&b, 0, 1);
    (void)small_lamp(&b, 1, 1.5, 0.05);
    (void)small_lamp(&b, 3, 1.5, 0.05);
    (void)small_lamp(&b, 0.5, 1.2, 0.03);
    (void)small_lamp(&b, 3.5, 1.2, 0.03);
    radiance_expect_same(&a, &b, &settings, COMPARISONS, "a lamp off a mirror");
    builder_release(&a);
    builder_release(&b);
}

/* A spot under water, or beside a round mirror, and a small lamp in the air. */
static struct scene_material *lamp_scene(struct scene_builder *b, int ball)
{
    floor_seen(b, ball ? 0.9 : 0, 0.4);
    if (ball) {
        (void)mirror(b, 0.9);
        builder_place(b, builder_sphere(b, 40, 1), 1, vec3_splat((real)RADIUS), vec3_make(0, REAL(0.6), 0));
        return small_lamp(b, 0.9, 1.9, 0.06);
    }
    (void)water(b);
    builder_place(b, builder_quad(b), 1, vec3_make(20, 1, 20), vec3_make(0, REAL(0.8), 0));
    return small_lamp(b, 0.3, 2, 0.067);
}

/* A lamp with a trace of coat is left to the paths that meet it by chance. */
static void test_asked_or_by_chance(void **state)
{
    (void)state;
    for (int ball = 0; ball < 2; ball++) {
        struct render_settings settings = shallow(3), few = settings;
        struct scene_builder asked, chance;
        struct render_scene *scene;

        settings.spp = ball ? 1024 : 4096;
        few.spp = settings.spp / (ball ? 8 : 32); /* it has little noise of its own */
        (void)lamp_scene(&asked, ball);
        lamp_scene(&chance, ball)->clearcoat = 1e-6f;
        scene = builder_build(&asked, &settings);
        assert_non_null(scene->casters);
        render_scene_free(scene);
        scene = builder_build(&chance, &settings);
        assert_null(scene->casters);
        render_scene_free(scene);
        radiance_expect_same_at(&asked, &few, &chance, &settings, COMPARISONS, ball ? "a ball beside a lamp" : "water under a lamp");
        builder_release(&asked);
        builder_release(&chance);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_water), cmocka_unit_test(test_lamp_in_water), cmocka_unit_test(test_dyed_water),
                                       cmocka_unit_test(test_sun), cmocka_unit_test(test_mirror),
                                       cmocka_unit_test(test_ball), cmocka_unit_test(test_few_ask),
                                       cmocka_unit_test(test_sun_in_a_mirror),
                                       cmocka_unit_test(test_sun_off_a_mirror),
                                       cmocka_unit_test(test_lamp_off_a_mirror), cmocka_unit_test(test_asked_or_by_chance)};

    return cmocka_run_group_tests(tests, NULL, NULL);
}
