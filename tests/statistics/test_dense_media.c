/* Balls of a medium from thin to so dense that a free path is a millionth of the spacing of floats,
 * against a walk of its own in double: the exact planes of the ball's faces, no BVH, no floats.
 *
 * Family-wise significance 0.01, Sidak-corrected over all comparisons; seeds are fixed. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <cmocka.h>

#include "tests/support/figure.h"
#include "tests/support/radiance.h"

enum { SEGMENTS = 4, PLANES_MAX = 4 * SEGMENTS * SEGMENTS, COMPARISONS = 12 };
enum { BATCHES = 40, WALKS = 1000 /* a batch */ };

static const double albedo = 0.9;

/* ---- the reference ------------------------------------------------------------------------ */

struct ball {
    double plane[PLANES_MAX][4]; /* outward normal and its distance from the origin */
    int count;
};

/* The faces of builder_sphere: it is convex. */
static void ball_read(struct ball *ball, const struct scene_builder *b)
{
    const struct scene_mesh *mesh = &b->scene.meshes[0];
    struct scene_mesh_layout layout;
    const float *p;
    const uint32_t *index;

    scene_mesh_layout(mesh, &layout);
    p = (const float *)(const void *)(b->blobs[0].data + layout.positions);
    index = (const uint32_t *)(const void *)(b->blobs[0].data + layout.indices);
    ball->count = (int)mesh->triangle_count;
    assert_true(ball->count <= PLANES_MAX);
    for (int i = 0; i < ball->count; i++) {
        double e[2][3], *n = ball->plane[i], length;
        for (int k = 0; k < 2; k++)
            for (int a = 0; a < 3; a++)
                e[k][a] = (double)p[3 * index[3 * i + k + 1] + (uint32_t)a] - (double)p[3 * index[3 * i] + (uint32_t)a];
        n[0] = e[0][1] * e[1][2] - e[0][2] * e[1][1];
        n[1] = e[0][2] * e[1][0] - e[0][0] * e[1][2];
        n[2] = e[0][0] * e[1][1] - e[0][1] * e[1][0];
        length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        n[3] = 0;
        for (int a = 0; a < 3; a++) {
            n[a] /= length;
            n[3] += n[a] * (double)p[3 * index[3 * i] + (uint32_t)a];
        }
        if (n[3] < 0)
            for (int a = 0; a < 4; a++)
                n[a] = -n[a];
    }
}

/* Along the line: where it enters and leaves. */
static void ball_cross(const struct ball *ball, const double at[3], const double way[3], double *enter, double *leave)
{
    *enter = -INFINITY;
    *leave = INFINITY;
    for (int i = 0; i < ball->count; i++) {
        const double *n = ball->plane[i];
        double height = n[3] - (n[0] * at[0] + n[1] * at[1] + n[2] * at[2]);
        double speed = n[0] * way[0] + n[1] * way[1] + n[2] * way[2];
        if (speed > 0)
            *leave = fmin(*leave, height / speed);
        else if (speed < 0)
            *enter = fmax(*enter, height / speed);
    }
}

/* A new direction by Henyey and Greenstein's function. */
static void scatter(double way[3], double g, struct test_random *random)
{
    double u = test_random_double(random), angle = 2 * M_PI * test_random_double(random);
    double q = g != 0 ? (1 - g * g) / (1 - g + 2 * g * u) : 0;
    double cosine = g != 0 ? (1 + g * g - q * q) / (2 * g) : 2 * u - 1;
    double sine = sqrt(fmax(0, 1 - cosine * cosine)), s[3], t[3], length;
    int axis = fabs(way[0]) < 0.6 ? 0 : 1;

    for (int a = 0; a < 3; a++)
        s[a] = (a == axis) - way[axis] * way[a];
    length = sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2]);
    for (int a = 0; a < 3; a++)
        s[a] /= length;
    t[0] = way[1] * s[2] - way[2] * s[1];
    t[1] = way[2] * s[0] - way[0] * s[2];
    t[2] = way[0] * s[1] - way[1] * s[0];
    for (int a = 0; a < 3; a++)
        way[a] = cosine * way[a] + sine * (cos(angle) * s[a] + sin(angle) * t[a]);
}

/* What a path from `eye` along `way` sees of a white sky. */
static double walk(const struct ball *ball, const double eye[3], const double along[3], double density, double g,
                   struct test_random *random)
{
    double at[3] = {eye[0], eye[1], eye[2]}, way[3] = {along[0], along[1], along[2]};
    double weight = 1, enter, leave;

    ball_cross(ball, at, way, &enter, &leave);
    if (!(enter < leave))
        return 1;
    for (int a = 0; a < 3; a++)
        at[a] += enter * way[a];
    while (weight > 1e-7) {
        double path = -log1p(-test_random_double(random)) / density;
        ball_cross(ball, at, way, &enter, &leave);
        if (path >= leave)
            return weight;
        for (int a = 0; a < 3; a++)
            at[a] += path * way[a];
        weight *= albedo;
        scatter(way, g, random);
    }
    return 0;
}

/* ---- the comparison ----------------------------------------------------------------------- */

static const struct vec3 eye = {0.3f, 1, 4};

static void ball_scene(struct scene_builder *b, float density, float g, struct vec3 target)
{
    struct scene_medium *m;
    struct scene_material *wall;

    builder_init(b);
    m = builder_medium(b);
    m->g = g;
    for (int c = 0; c < 3; c++) {
        m->scattering[c] = (float)albedo * density;
        m->absorption[c] = (float)(1 - albedo) * density;
    }
    wall = builder_lambert(b, 0);
    wall->kind = MATERIAL_INTERFACE;
    wall->medium = 0;
    builder_place(b, builder_sphere(b, SEGMENTS, 0), 0, vec3_splat(1), vec3_splat(0));
    builder_environment_constant(b, vec3_splat(1));
    builder_camera(b, eye, target, 2e-5f);
}

static void reference(const struct scene_builder *b, double density, double g, struct vec3 target,
                      struct running_stats *out)
{
    const struct vec3 way = vec3_sub(target, eye);
    const double from[3] = {(double)eye.x, (double)eye.y, (double)eye.z};
    double along[3] = {(double)way.x, (double)way.y, (double)way.z}, length = 0;
    struct test_random random = {4};
    struct ball ball;

    for (int a = 0; a < 3; a++)
        length += along[a] * along[a];
    for (int a = 0; a < 3; a++)
        along[a] /= sqrt(length);
    ball_read(&ball, b);
    for (int i = 0; i < BATCHES; i++) {
        double sum = 0;
        for (int k = 0; k < WALKS; k++)
            sum += walk(&ball, from, along, density, g, &random);
        running_stats_add(out, sum / WALKS);
    }
}

static void compare(const struct running_stats *a, const struct running_stats *b, const char *what)
{
    figure_z(what, a->mean, hypot(running_stats_error(a), running_stats_error(b)), b->mean, RADIANCE_SIGNIFICANCE,
             COMPARISONS);
}

/* Along the middle, and near the rim. Once the ball is opaque its density no longer counts. */
static void test_balls(void **state)
{
    static const struct vec3 targets[] = {{0.05f, 0.03f, 0}, {0.7f, 0.45f, 0}};
    static const float densities[] = {1, 1e3f, 1e6f, 1e9f}, gs[] = {0, 0.6f};
    enum { DENSITIES = sizeof densities / sizeof *densities };

    (void)state;
    for (int i = 0; i < 2; i++) {
        struct render_settings settings = builder_settings(8, 8, 32);
        struct running_stats opaque = {0};
        settings.max_depth = 1024;
        for (int k = 0; k < DENSITIES; k++) {
            struct running_stats seen[3] = {{0}}, expected = {0};
            struct scene_builder b;
            char what[80];
            ball_scene(&b, densities[k], gs[i], targets[i]);
            reference(&b, (double)densities[k], (double)gs[i], targets[i], &expected);
            radiance_measure(&b, &settings, seen);
            snprintf(what, sizeof what, "%s, g %g, optical radius %g", i ? "rim" : "middle", (double)gs[i],
                     (double)densities[k]);
            compare(&seen[0], &expected, what);
            if (k == 1)
                opaque = seen[0];
            else if (k > 1) {
                strcat(what, ", against 1000");
                compare(&seen[0], &opaque, what);
            }
            builder_release(&b);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_balls)};

    return cmocka_run_group_tests_name("dense media", tests, NULL, NULL);
}
