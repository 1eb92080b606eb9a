/* Many lights: the tree's choices follow the odds that it claims, nothing that reaches a point
 * has odds 0, ten thousand lamps give the sum of their light, and choosing by the tree beats
 * choosing by power. Family-wise level 0.01, Sidak. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "tests/support/scene_builder.h"
#include "tests/support/statistics.h"
#include "worker/render/light/tree.h"
#include "worker/render/render_scene.h"

enum { TESTS = 60 };

static struct vec3 random_direction(struct test_random *random)
{
    double y = 2 * test_random_double(random) - 1, phi = 2 * PI_D * test_random_double(random);
    double r = sqrt(1 - y * y);

    return vec3_make((float)(r * cos(phi)), (float)y, (float)(r * sin(phi)));
}

static struct vec3 random_point(struct test_random *random, float size)
{
    return vec3_make(size * (test_random_float(random) - 0.5f), size * (test_random_float(random) - 0.5f),
                     size * (test_random_float(random) - 0.5f));
}

/* Points, spots and lamps of all sizes; every tenth is dark. */
static struct light_bounds random_bounds(struct test_random *random, uint32_t i)
{
    struct light_bounds b = {.axis = random_direction(random), .emission_rad = PI_F / 2,
                             .reach = INFINITY, .lamp = i / 2};
    float size = test_random_float(random) * test_random_float(random);

    b.min = random_point(random, 10);
    b.max = vec3_add(b.min, vec3_make(size, size * test_random_float(random), size));
    b.intensity = i % 10 == 3 ? 0 : (float)pow(10, -2 + 4 * test_random_double(random));
    b.area = size;
    b.two_sided = i % 3 == 0;
    if (i % 3 == 1) {
        b.max = b.min;
        b.area = 0;
        b.spread_rad = i % 2 ? PI_F : 0.2f;
        b.emission_rad = i % 2 ? PI_F / 2 : 0.3f;
        b.reach = i % 5 ? INFINITY : 4;
    }
    return b;
}

static void test_choices_follow_odds(void **state)
{
    static const uint32_t counts[] = {1, 2, 3, 5, 40, 300};
    static struct light_bounds bounds[300];
    static double hits[300];
    struct test_random random = {5};
    struct error err = {0};

    (void)state;
    for (size_t c = 0; c < sizeof counts / sizeof *counts; c++) {
        uint32_t count = counts[c];
        struct light_tree tree;

        for (uint32_t i = 0; i < count; i++)
            bounds[i] = random_bounds(&random, i);
        assert_int_equal(light_tree_init(&tree, bounds, count, &err), STATUS_OK);
        for (int place = 0; place < 6; place++) {
            enum { SAMPLES = 100000 };
            struct vec3 p = random_point(&random, 12), n = {0, 0, 0};
            double none = 0, sum = 0, statistic = 0, pooled = 0, pooled_hits = 0;
            int cells = 0;

            if (place % 2)
                n = random_direction(&random);
            memset(hits, 0, sizeof hits);
            for (int k = 0; k < SAMPLES; k++) {
                float u = test_random_float(&random), v = test_random_float(&random), odds;
                uint32_t item;

                if (!light_tree_choose(&tree, NULL, p, n, &u, &v, &item, &odds)) {
                    none++;
                    continue;
                }
                assert_true(u >= 0 && u < 1 && v >= 0 && v < 1);
                assert_true(odds > 0 && odds == light_tree_odds(&tree, NULL, p, n, item));
                hits[item]++;
            }
            for (uint32_t i = 0; i <= count; i++) {
                double odds = i < count ? (double)light_tree_odds(&tree, NULL, p, n, i) : 1 - sum;
                double expected = odds * SAMPLES, got = i < count ? hits[i] : none;

                sum += odds;
                assert_true(i == count || bounds[i].intensity > 0 || odds == 0);
                if (expected < 10) {
                    pooled += expected;
                    pooled_hits += got;
                    continue;
                }
                statistic += (got - expected) * (got - expected) / expected;
                cells++;
            }
            if (pooled > 10) {
                statistic += (pooled_hits - pooled) * (pooled_hits - pooled) / pooled;
                cells++;
            } else {
                assert_true(pooled_hits < pooled + 6 * sqrt(fmax(pooled, 0)) + 12);
            }
            if (cells > 1)
                assert_true(chi_square_p_value(statistic, cells - 1) > sidak_alpha(0.01, TESTS));
        }
        light_tree_release(&tree);
    }
}

/* Odds are 0 only where a light can send nothing: no point of it is above the context's
 * horizon, or none of its normals is within its emission angle of the context. */
static void zero_odds_are_earned(float longest_reach)
{
    enum { COUNT = 60, PLACES = 400 };
    static struct light_bounds bounds[COUNT];
    struct test_random random = {17};
    struct light_tree tree;
    struct error err = {0};
    int zeros = 0;

    for (uint32_t i = 0; i < COUNT; i++) {
        bounds[i] = random_bounds(&random, i);
        if (longest_reach > 0)
            bounds[i].reach = longest_reach * test_random_float(&random);
    }
    assert_int_equal(light_tree_init(&tree, bounds, COUNT, &err), STATUS_OK);
    for (int place = 0; place < PLACES; place++) {
        struct vec3 p = random_point(&random, 14), n = random_direction(&random);

        for (uint32_t i = 0; i < COUNT; i++) {
            const struct light_bounds *b = &bounds[i];

            if (b->intensity == 0 || light_tree_odds(&tree, NULL, p, n, i) > 0)
                continue;
            zeros++;
            for (int k = 0; k < 60; k++) { /* points of its box, and its extreme normals */
                struct vec3 q = vec3_make(b->min.x + (b->max.x - b->min.x) * test_random_float(&random),
                                          b->min.y + (b->max.y - b->min.y) * test_random_float(&random),
                                          b->min.z + (b->max.z - b->min.z) * test_random_float(&random));
                struct vec3 w = vec3_normalize(vec3_sub(p, q));
                double angle = acos(fmin(1, fmax(-1, (double)vec3_dot(w, b->axis))));

                if (b->two_sided)
                    angle = fmin(angle, PI_D - angle);
                if ((double)vec3_length(vec3_sub(p, q)) > (double)b->reach)
                    continue;
                if (angle < (double)(b->spread_rad + b->emission_rad) - 1e-3)
                    assert_true(vec3_dot(w, n) > -1e-3f); /* then it is below the horizon */
            }
        }
    }
    assert_true(zeros > COUNT * PLACES / 20);
    light_tree_release(&tree);
}

static void test_zero_odds_are_earned(void **state)
{
    (void)state;
    zero_odds_are_earned(0);
}

/* Clusters end where the last of their lamps does, in whatever corner that is. */
static void test_zero_odds_of_ranges(void **state)
{
    (void)state;
    zero_odds_are_earned(2);
    zero_odds_are_earned(8);
}

/* A light of every kind, still or moved while the shutter is open, with and without a range, beside one that shines everywhere. */
static struct render_scene *one_beside(struct scene_builder *b, struct test_random *random, enum scene_light_kind kind, int moves)
{
    static const float times[2] = {0, 1};
    struct render_settings settings = builder_settings(4, 4, 1);
    struct scene_light *l;

    settings.fps = 1;
    settings.shutter = 1;
    builder_init(b);
    builder_lambert(b, 0.5f);
    builder_place(b, builder_quad(b), 0, vec3_splat(20), vec3_make(0, -10, 0));
    builder_camera(b, vec3_make(0, 1, 0), vec3_make(0, 1, 5), 1);
    builder_node(b, -1, 0);
    for (int path = PATH_TRANSLATION; path <= PATH_ROTATION; path++) {
        float values[8];
        double length[2] = {0, 0};
        const int size = path == PATH_ROTATION ? 4 : 3;

        for (int i = 0; i < 2 * size; i++) {
            values[i] = 6 * test_random_float(random) - 3;
            length[i / size] += (double)(values[i] * values[i]);
        }
        for (int i = 0; i < size; i++) {
            values[i] = path == PATH_ROTATION ? (float)((double)values[i] / sqrt(length[0])) : values[i];
            values[size + i] = !moves ? values[i] : path == PATH_ROTATION ? (float)((double)values[size + i] / sqrt(length[1])) : values[size + i];
        }
        builder_channel(b, 0, (enum scene_channel_path)path, 2, times, values);
    }
    b->scene.nodes[0].scale[0] = test_random_float(random) < 0.5f ? -1 : 1; /* mirrored */
    l = builder_light(b, kind);
    l->node = 0;
    l->image = 0;
    (void)builder_texture(b, (const float[]){1, 0.5f, 0.25f}, 1, 1);
    l->intensity[0] = l->intensity[1] = l->intensity[2] = 1;
    l->inner_cone_rad = 0.6f * test_random_float(random);
    l->outer_cone_rad = l->inner_cone_rad + 0.01f + 0.9f * test_random_float(random);
    l->projection_yfov_rad = 0.1f + 2 * test_random_float(random);
    l->projection_aspect = 0.3f + 3 * test_random_float(random);
    l->range = test_random_float(random) < 0.5f ? 1 + 5 * test_random_float(random) : 0;
    l = builder_light(b, LIGHT_POINT);
    l->position[1] = 20;
    l->intensity[0] = l->intensity[1] = l->intensity[2] = 100;
    return builder_build(b, &settings);
}

/* What arrives has odds: a light that shines at a place at some moment may be chosen there, whatever the moment. */
static void test_what_arrives_has_odds(void **state)
{
    static const enum scene_light_kind kinds[] = {LIGHT_POINT, LIGHT_SPOT, LIGHT_GONIOMETRIC, LIGHT_PROJECTION};
    struct test_random random = {29};

    (void)state;
    for (int i = 0; i < 400; i++) {
        const enum scene_light_kind kind = kinds[i % 4];
        struct scene_builder b;
        struct render_scene *scene = one_beside(&b, &random, kind, i / 4 % 2);
        const struct emitters *e = &scene->emitters;
        int arrived = 0;

        assert_int_equal(emitters_local_punctual(e), 2);
        for (int place = 0; place < 300; place++) {
            struct light_context context = {.p = random_point(&random, 12), .n = random_direction(&random), .time = test_random_float(&random)};
            struct light_sample out = {.pdf = 1};

            if (!emitters_sample_one(scene, e->punctual[0], &context, 1, &out) || vec3_is_black(out.radiance) ||
                vec3_dot(out.direction, context.n) < 1e-3f)
                continue;
            arrived++;
            if (!(light_tree_odds(&e->tree, NULL, context.p, context.n, 0) > 0))
                fail_msg("light %d of kind %d has no odds at (%g %g %g)", i, (int)kind, (double)context.p.x, (double)context.p.y, (double)context.p.z);
        }
        assert_true(arrived > 0 || kind == LIGHT_SPOT || kind == LIGHT_PROJECTION || scene->emitters.punctual[0]->range > 0);
        render_scene_free(scene);
        builder_release(&b);
    }
}

/* The same lights give the same tree; every failed allocation is survived. */
static void test_deterministic(void **state)
{
    enum { COUNT = 5000 };
    static struct light_bounds bounds[COUNT];
    struct test_random random = {3};
    struct light_tree a, b;
    struct error err = {0};
    int done = 0;

    (void)state;
    for (uint32_t i = 0; i < COUNT; i++)
        bounds[i] = random_bounds(&random, i);
    for (uint32_t i = 2000; i < 3000; i++) /* many in one place */
        bounds[i].min = bounds[i].max = vec3_make(1, 2, 3);
    assert_int_equal(light_tree_init(&a, bounds, COUNT, &err), STATUS_OK);
    for (long n = 0; n < 20 && !done; n++) {
        status s;

        mem_fault_arm(n, 1);
        s = light_tree_init(&b, bounds, COUNT, &err);
        done = mem_fault_count() == 0;
        mem_fault_arm(-1, 0);
        assert_int_equal(s, done ? STATUS_OK : STATUS_ERR_NO_MEMORY);
    }
    assert_true(done);
    assert_int_equal(a.node_count, b.node_count);
    assert_memory_equal(a.nodes, b.nodes, a.node_count * sizeof *a.nodes);
    assert_memory_equal(a.trail, b.trail, COUNT * sizeof *a.trail);
    light_tree_release(&a);
    light_tree_release(&b);
}

/* ---- ten thousand lamps ------------------------------------------------------------------ */

enum { LAMPS = 10000, SAMPLES = 200000 };

static struct render_scene *city(struct scene_builder *b, struct render_settings *settings)
{
    static float positions[LAMPS * 3 * 3];
    static uint32_t indices[LAMPS * 3];
    struct test_random random = {21};
    struct scene_material *m;

    builder_init(b);
    for (uint32_t i = 0; i < LAMPS; i++) {
        struct vec3 at = random_point(&random, 100);

        at.y = 3 + 5 * test_random_float(&random);
        for (uint32_t k = 0; k < 3; k++) {
            struct vec3 d = vec3_mad(at, random_direction(&random), 0.05f);

            positions[9 * i + 3 * k] = d.x;
            positions[9 * i + 3 * k + 1] = d.y;
            positions[9 * i + 3 * k + 2] = d.z;
            indices[3 * i + k] = 3 * i + k;
        }
    }
    m = builder_lambert(b, 0.5f);
    m->double_sided = 0;
    m->emission[0] = m->emission[1] = m->emission[2] = 100;
    builder_place(b, builder_mesh(b, positions, NULL, LAMPS * 3, indices, LAMPS, 0), 0, vec3_splat(1), vec3_splat(0));
    builder_camera(b, vec3_make(0, 1, 0), vec3_make(0, 1, 5), 1);
    *settings = builder_settings(4, 4, 1);
    return builder_build(b, settings);
}

/* Irradiance from one lamp, unoccluded: it is small and far, or cut into 16 that are. */
static double lamp_irradiance(const struct render_scene *scene, uint32_t lamp, struct vec3 p, struct vec3 n)
{
    struct vec3 c[3], normal;
    double sum = 0;

    triangle_of_instance(scene, &scene->instances[0], lamp, 0, c);
    normal = vec3_cross(vec3_sub(c[1], c[0]), vec3_sub(c[2], c[0]));
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 7 - 2 * i; j++) {
            float b1 = ((float)i + (j % 2 ? 2 : 1) / 3.0f) / 4;
            float b2 = ((float)(j / 2) + (j % 2 ? 2 : 1) / 3.0f) / 4;
            struct vec3 q =
                vec3_add(vec3_scale(c[0], 1 - b1 - b2), vec3_add(vec3_scale(c[1], b1), vec3_scale(c[2], b2)));
            struct vec3 d = vec3_sub(q, p);
            double r2 = (double)vec3_length_squared(d);
            double at_lamp = -(double)vec3_dot(d, normal) / 2, at_p = (double)vec3_dot(d, n);

            sum += at_lamp > 0 && at_p > 0 ? 100.0 * at_lamp * at_p / (r2 * r2) / 16 : 0;
        }
    return sum;
}

static void test_ten_thousand_lamps(void **state)
{
    static const struct vec3 places[] = {{0, 0, 0}, {20, 1, -13}, {-30, 6, 30}};
    struct render_settings settings;
    struct scene_builder b;
    struct render_scene *scene = city(&b, &settings);
    struct test_random random = {8};

    (void)state;
    for (int k = 0; k < 6; k++) {
        struct vec3 up = {0, 1, 0}, none = {0, 0, 0};
        struct light_context query = {.p = places[k / 2], .n = k % 2 ? up : none};
        struct running_stats stats = {0};
        double want = 0, power_moment = 0, power = 0;

        for (uint32_t i = 0; i < LAMPS; i++) {
            double e = lamp_irradiance(scene, i, query.p, up);
            struct vec3 c[3];
            double weight;

            triangle_of_instance(scene, &scene->instances[0], i, 0, c);
            weight = (double)vec3_length(vec3_cross(vec3_sub(c[1], c[0]), vec3_sub(c[2], c[0])));
            want += e;
            power += weight;
            power_moment += weight > 0 ? e * e / weight : 0;
        }
        for (int i = 0; i < SAMPLES; i++) {
            struct light_sample light;
            double value = 0;

            if (emitters_sample(scene, &query, test_random_float(&random), test_random_float(&random), &light))
                value = (double)light.radiance.x * fmax(0, (double)vec3_dot(light.direction, up)) / (double)light.pdf;
            running_stats_add(&stats, value);
        }
        print_message("# place %d%s: relative variance a sample %.3g, by power alone %.3g\n", k / 2,
                      k % 2 ? ", normal known" : "", running_stats_variance(&stats) / (want * want),
                      power_moment * power / (want * want) - 1);
        /* 2e-3: quadrature over the nearest lamps, and offsets of the samples' ends. */
        if (fabs(stats.mean - want) > 2e-3 * want)
            assert_true(mean_test_p_value(&stats, want) > sidak_alpha(0.01, TESTS));
        assert_true(running_stats_variance(&stats) < (k % 2 ? 0.15 : 0.2) * (power_moment * power - want * want));
    }
    render_scene_free(scene);
    builder_release(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_choices_follow_odds),
        cmocka_unit_test(test_zero_odds_are_earned),
        cmocka_unit_test(test_zero_odds_of_ranges),
        cmocka_unit_test(test_what_arrives_has_odds),
        cmocka_unit_test(test_deterministic),
        cmocka_unit_test(test_ten_thousand_lamps),
    };

    return cmocka_run_group_tests_name("emitters_many", tests, NULL, NULL);
}
