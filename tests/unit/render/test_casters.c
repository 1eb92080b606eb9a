/* Casters: every point of a triangle by which a lamp's light reaches a place is found, once, and the light's spread is
 * what rays traced beside it say; a caster's tree finds what its faces have, one by one. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "tests/support/scene_builder.h"
#include "worker/render/caustic/casters_parts.h"
#include "worker/render/render_scene.h"

static uint64_t state_of_numbers = 1;

static double number(void) /* 0..1, splitmix64 */
{
    uint64_t z = state_of_numbers += 0x9e3779b97f4a7c15u;

    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return (double)((z ^ z >> 31) >> 11) * 0x1p-53;
}

static void random_vector(double reach, double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = reach * (2 * number() - 1);
}

static void unit(double a[3])
{
    const double length = sqrt(exact_dot(a, a));

    for (int k = 0; k < 3; k++)
        a[k] /= length;
}

static void at(const double corner[3][3], double u, double v, double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = (1 - u - v) * corner[0][k] + u * corner[1][k] + v * corner[2][k];
}

/* Where the ray from `place` to the point of the plane goes on; 0: it is reflected totally, or shading and face
 * disagree about its sides. */
static int goes_on(const struct caster_face *face, const double own[3], const double place[3], double u, double v,
                   enum caster_event event, double eta, double out[3])
{
    double p[3], n[3], d[3], c, root;

    at(face->corner, u, v, p);
    at(face->normal, u, v, n);
    unit(n);
    exact_sub(p, place, d);
    unit(d);
    if (exact_dot(n, d) > 0)
        for (int k = 0; k < 3; k++)
            n[k] = -n[k];
    c = -exact_dot(n, d);
    if (event == CASTER_REFLECTS) {
        for (int k = 0; k < 3; k++)
            out[k] = d[k] + 2 * c * n[k];
    } else {
        root = 1 - eta * eta * (1 - c * c);
        if (!(root > 1e-4))
            return 0;
        for (int k = 0; k < 3; k++)
            out[k] = eta * d[k] + (eta * c - sqrt(root)) * n[k];
    }
    return exact_dot(n, own) * exact_dot(d, own) < 0 && c > 0.02 && fabs(exact_dot(d, own)) > 0.02 &&
           fabs(exact_dot(out, own)) > 0.02 &&
           (exact_dot(out, own) * exact_dot(d, own) > 0) == (event == CASTER_REFRACTS);
}

struct expected {
    double point[3], spread;
    enum caster_event event;
    int times, others;
};

static void look(void *user, const struct caster_solution *s)
{
    struct expected *e = user;
    double off[3];

    exact_sub(s->point, e->point, off);
    if (s->event != e->event)
        return;
    if (sqrt(exact_dot(off, off)) < 1e-6) {
        e->times++;
        e->spread = s->spread;
    } else {
        e->others++;
    }
}

/* The cross-section at the lamp, or of the directions there, of a cone around the ray: by rays beside it. */
static double spread_by_rays(const struct caster_face *face, const double own[3], const double place[3], double u,
                             double v, enum caster_event event, double eta, const double lamp[3], int infinite)
{
    const double small = 1e-5;
    double p[3], d[3], across[2][3], e[3], moved[2][3], least[3] = {1, 0, 0}, cross[3], up[3], beside[2][3];

    at(face->corner, u, v, p);
    exact_sub(p, place, d);
    unit(d);
    if (fabs(d[0]) > 0.6) {
        least[0] = 0;
        least[1] = 1;
    }
    exact_cross(d, least, across[0]);
    unit(across[0]);
    exact_cross(d, across[0], across[1]);
    assert_true(goes_on(face, own, place, u, v, event, eta, e));
    for (int i = 0; i < 2; i++)
        for (int sign = -1; sign <= 1; sign += 2) {
            double turned[3], hit[3], off[3], plane[3], raw[3], area, uu, vv, out[3], t;

            for (int k = 0; k < 3; k++)
                turned[k] = d[k] + sign * small * across[i][k];
            unit(turned);
            exact_sub(face->corner[0], place, off);
            t = exact_dot(off, own) / exact_dot(turned, own);
            for (int k = 0; k < 3; k++)
                hit[k] = place[k] + t * turned[k];
            double e1[3], e2[3];
            exact_sub(face->corner[1], face->corner[0], e1);
            exact_sub(face->corner[2], face->corner[0], e2);
            exact_cross(e1, e2, plane);
            area = exact_dot(plane, plane);
            exact_sub(hit, face->corner[0], off);
            exact_cross(off, e2, raw);
            uu = exact_dot(raw, plane) / area;
            exact_cross(e1, off, raw);
            vv = exact_dot(raw, plane) / area;
            (void)goes_on(face, own, place, uu, vv, event, eta, out);
            if (infinite) {
                memcpy(beside[sign > 0], out, sizeof out);
            } else { /* in the plane through the lamp across the ray */
                exact_sub(lamp, hit, off);
                t = exact_dot(off, e) / exact_dot(out, e);
                for (int k = 0; k < 3; k++)
                    beside[sign > 0][k] = hit[k] + t * out[k];
            }
            if (sign > 0)
                for (int k = 0; k < 3; k++)
                    moved[i][k] = (beside[1][k] - beside[0][k]) / (2 * small);
        }
    exact_cross(moved[0], moved[1], cross);
    memcpy(up, e, sizeof up);
    return fabs(exact_dot(cross, up));
}

/* Planted solutions: a lamp where the ray goes on. */
static void test_random_triangles(void **state)
{
    enum { PAIRS = 100000 };
    int planted = 0, lost = 0, twice = 0, folds = 0;
    double worst = 0;

    (void)state;
    for (int i = 0; i < PAIRS; i++) {
        struct caster caster = {.events = i & 1 ? 3 : 1, .ior = 1.33};
        const enum caster_event event = (enum caster_event)(i & 1);
        const int infinite = i >> 1 & 1;
        struct caster_face face;
        const int flat = i % 5 == 0;
        struct expected expected = {.event = event};
        struct caster_pair pair;
        double own[3], place[3], lamp[3], out[3], u = number(), v = number(), eta, rough, far = 0.05 + 2 * number();

        if (u + v > 1) {
            u = 1 - u;
            v = 1 - v;
        }
        for (int k = 0; k < 3; k++)
            random_vector(1, face.corner[k]);
        exact_normal(face.corner, own);
        if (sqrt(exact_dot(own, own)) < 0.1)
            continue;
        unit(own);
        rough = 0.5 * number() * number();
        for (int k = 0; k < 3; k++) {
            double lean[3];

            random_vector(flat ? 0 : rough, lean);
            for (int j = 0; j < 3; j++)
                face.normal[k][j] = own[j] + lean[j];
        }
        caster_face_finish(&face);
        random_vector(3, place);
        at(face.corner, u, v, expected.point);
        double to_place[3];
        exact_sub(place, face.corner[0], to_place);
        eta = exact_dot(to_place, own) > 0 ? 1 / caster.ior : caster.ior;
        if (!goes_on(&face, own, place, u, v, event, eta, out))
            continue;
        for (int k = 0; k < 3; k++)
            lamp[k] = infinite ? out[k] : expected.point[k] + far * out[k];
        pair = (struct caster_pair){.place = place, .lamp = lamp, .infinite = infinite};
        planted++;
        caster_solve(&caster, &face, &pair, look, &expected);
        lost += expected.times == 0;
        twice += expected.times > 1;
        if (expected.times == 1) {
            const double truth = spread_by_rays(&face, own, place, u, v, event, eta, lamp, infinite);
            const double off = fabs(expected.spread - truth) / (truth + 1e-3);

            folds += truth < 1e-3;
            worst = off > worst ? off : worst;
        }
    }
    print_message("# %d planted, %d lost, %d twice, %d near a fold, spread off by %.2g at most\n", planted, lost, twice, folds, worst);
    assert_true(planted > PAIRS / 3);
    assert_int_equal(twice, 0);
    assert_true(lost * 3000 <= planted);
    assert_true(worst < 1e-2);
}

/* ---- a caster's tree ------------------------------------------------------------------------------- */

struct found {
    int count;
    double points;
};

static void count_found(void *user, const struct caster_solution *s)
{
    struct found *f = user;

    f->count++;
    f->points += s->point[0] + 2 * s->point[1] + 3 * s->point[2] + 5 * s->spread;
}

/* Smooth glass or metal that a point light lights: a ball of so many segments, and a slab. */
static struct render_scene *glass_scene(struct scene_builder *b, uint32_t segments, int metal)
{
    const struct render_settings settings = builder_settings(16, 16, 1);
    struct scene_material *m;
    struct render_scene *scene;

    builder_init(b);
    builder_lambert(b, 0.5f);
    builder_place(b, builder_quad(b), 0, vec3_splat(9), vec3_make(0, -3, 0));
    m = builder_lambert(b, 1);
    m->roughness = 0;
    m->transmission = metal ? 0 : 1;
    m->metallic = metal ? 1 : 0;
    m->refractive = 1;
    m->specular = m->specular_color[0] = 1;
    m->ior = 1.5f;
    builder_place(b, builder_sphere(b, segments, 1), 1, vec3_splat(1), vec3_splat(0));
    builder_place(b, builder_slab(b), 1, vec3_make(2, REAL(0.1), 2), vec3_make(0, 2, 0));
    builder_light(b, LIGHT_POINT)->intensity[0] = 1;
    builder_camera(b, vec3_make(0, 0, 5), vec3_splat(0), 1);
    scene = builder_build(b, &settings);
    assert_non_null(scene->casters);
    for (uint32_t k = 0; k < scene->casters->count; k++)
        for (uint32_t i = 0; i < scene->casters->list[k].node_count; i++)
            scene->casters->list[k].nodes[i].sunlit = 1;
    return scene;
}

/* From random places and lamps the tree finds what all faces have. */
static void test_tree(void **state)
{
    struct scene_builder b;
    struct render_scene *scene = glass_scene(&b, 24, 0);
    int seen = 0, several = 0;

    (void)state;
    for (int i = 0; i < 2000; i++) {
        struct caster_lamp lamp = {.kind = i & 1 ? CASTER_LAMP_FAR : CASTER_LAMP_NEAR, .moves = 1};
        struct found by_tree = {0}, by_faces = {0};
        double place[3];
        struct caster_pair pair = {.place = place, .lamp = lamp.at, .infinite = i & 1};

        random_vector(3, place);
        random_vector(3, lamp.at);
        if (pair.infinite)
            unit(lamp.at);
        casters_find(scene->casters, place, &lamp, count_found, &by_tree);
        for (uint32_t k = 0; k < scene->casters->count; k++)
            for (uint32_t f = 0; f < scene->casters->list[k].face_count; f++) {
                struct caster_face face;

                assert_true(caster_face_of(scene, &scene->casters->list[k].refs[f], &face));
                caster_solve(&scene->casters->list[k], &face, &pair, count_found, &by_faces);
            }
        assert_int_equal(by_tree.count, by_faces.count);
        assert_true(fabs(by_tree.points - by_faces.points) < 1e-6 * (1 + fabs(by_faces.points)));
        seen += by_tree.count;
        several += by_tree.count > 2;
    }
    print_message("# %d points of 2000 pairs, more than two of %d\n", seen, several);
    assert_true(seen > 2000 && several > 100);
    render_scene_free(scene);
    builder_release(&b);
}

static void move_a_little(const double from[3], double most, double out[3])
{
    random_vector(most, out);
    for (int k = 0; k < 3; k++)
        out[k] += from[k];
}

/* Places of one cell, and of its neighbours, find what a search from the root finds: near and far, of lamps of each kind.
 * A sun is never twice at quite the same place. */
static void find_by_cells(int metal)
{
    enum { LAMPS = 600, NEAR = 20 };
    struct scene_builder b;
    struct render_scene *scene = glass_scene(&b, 256, metal);
    int seen = 0;

    for (int i = 0; i < LAMPS; i++) {
        struct caster_lamp lamp = {.kind = (enum caster_lamp_kind)(i % 3)}, root;
        double about[3], sun[3], place[3];

        random_vector(i % 2 ? 3 : 40, about);
        random_vector(3, sun);
        if (lamp.kind != CASTER_LAMP_NEAR)
            unit(sun);
        memcpy(lamp.at, sun, sizeof sun);
        memcpy(lamp.middle, sun, sizeof sun);
        lamp.radius = lamp.kind == CASTER_LAMP_NEAR ? 0.05 : 0;
        for (int k = 0; k < NEAR; k++) {
            struct found by_cell = {0}, by_root = {0};

            move_a_little(about, i % 2 ? 0.01 : 1, place);
            if (lamp.kind == CASTER_LAMP_SUN) {
                move_a_little(sun, 0.03, lamp.at);
                unit(lamp.at);
            } else if (lamp.kind == CASTER_LAMP_NEAR) {
                move_a_little(sun, 0.05 / sqrt(3), lamp.at);
            }
            root = lamp;
            root.moves = 1;
            casters_find(scene->casters, place, &lamp, count_found, &by_cell);
            casters_find(scene->casters, place, &root, count_found, &by_root);
            assert_int_equal(by_cell.count, by_root.count);
            assert_true(by_cell.points == by_root.points);
            seen += by_cell.count;
        }
    }
    print_message("# %s: %d points of %d pairs\n", metal ? "metal" : "glass", seen, LAMPS * NEAR);
    assert_true(seen > LAMPS * NEAR / 2);
    render_scene_free(scene);
    builder_release(&b);
}

static void test_cells(void **state)
{
    (void)state;
    find_by_cells(0);
    find_by_cells(1);
}

/* ---- what is found out before a frame ---------------------------------------------------------- */

/* A floor, a ball of mirror and a lamp above them: its bits are the same for threads, instruction sets and parts of the
 * picture, for the share of vertices that ask does not depend on them, nor on seed and samples. */
static void test_alike(void **state)
{
    enum { SIDE = 32, PART = 16 };
    static double whole[3 * SIDE * SIDE], other[3 * SIDE * SIDE], part[3 * PART * PART];
    struct render_settings settings = builder_settings(SIDE, SIDE, 8), changed;
    struct render_stats stats = {0};
    struct render_scene *first, *second;
    struct scene_material *m;
    struct scene_builder b;

    (void)state;
    builder_init(&b);
    builder_lambert(&b, 0.5f);
    builder_place(&b, builder_quad(&b), 0, vec3_splat(9), vec3_make(0, -1, 0));
    m = builder_lambert(&b, 0.9f);
    m->roughness = 0;
    m->metallic = 1;
    builder_place(&b, builder_sphere(&b, 12, 1), 1, vec3_splat(REAL(0.3)), vec3_splat(0));
    builder_light(&b, LIGHT_POINT)->intensity[0] = 1;
    b.scene.lights[0].position[1] = 2;
    builder_camera(&b, vec3_make(0, 1, 5), vec3_splat(0), 1);
    first = builder_build(&b, &settings);
    assert_non_null(first->casters);
    print_message("# %.3f of the vertices ask\n", (double)first->caster_share);
    assert_true(first->caster_share > 0 && first->caster_share < 1);
    builder_render(first, &settings, 0, whole, NULL, &stats);
    for (int isa = 0; isa < ISA_COUNT; isa++) {
        if (!(isa_supported_mask() >> isa & 1))
            continue;
        changed = settings;
        changed.isa = (enum isa)isa;
        render_build_threads(3);
        second = builder_build(&b, &changed);
        render_build_threads(1);
        assert_true(second->caster_share == first->caster_share);
        builder_render(second, &changed, 0, other, NULL, &stats);
        assert_memory_equal(whole, other, sizeof whole);
        render_scene_free(second);
    }
    changed = settings;
    changed.whole_width = changed.whole_height = SIDE;
    changed.width = changed.height = changed.region_x = changed.region_y = PART;
    second = builder_build(&b, &changed);
    builder_render(second, &changed, 0, part, NULL, &stats);
    for (int y = 0; y < PART; y++)
        assert_memory_equal(&part[3 * PART * y], &whole[3 * (SIDE * (PART + y) + PART)], 3 * PART * sizeof *part);
    render_scene_free(second);
    changed = settings;
    changed.seed = 5;
    changed.spp = 64;
    second = builder_build(&b, &changed);
    assert_true(second->caster_share == first->caster_share);
    render_scene_free(second);
    render_scene_free(first);
    builder_release(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_random_triangles), cmocka_unit_test(test_tree),
        cmocka_unit_test(test_cells), cmocka_unit_test(test_alike)};

    return cmocka_run_group_tests(tests, NULL, NULL);
}
