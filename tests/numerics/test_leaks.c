/* No ray escapes from inside a closed mesh, though it is aimed at a vertex or an edge
 * (docs/NUMERICS.md).
 *
 *   test_leaks [RAYS]          so many in all instead of some million
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <cmocka.h>

#include "tests/support/figure.h"
#include "tests/support/scene_builder.h"
#include "worker/render/base/exact.h"
#include "worker/render/path/path.h"
#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"

static uint64_t rays_wanted = 1000000;
/* With more, each case is printed and the large meshes are tried everywhere. */
#define RAYS_LONG 10000000

/* ---- closed bodies ------------------------------------------------------------------------ */

enum form { FORM_BOX, FORM_SPHERE_COARSE, FORM_SPHERE, FORM_SPHERE_FINE, FORM_SPIKES, FORMS };
static const char *const form_names[] = {"box", "coarse sphere", "sphere", "fine sphere", "spikes"};

struct place {
    const char *name;
    struct vec3 scale, at;
};
static const struct place places[] = {
    {"1 m", {1, 1, 1}, {0, 0, 0}},
    {"1 mm", {1e-3f, 1e-3f, 1e-3f}, {0, 0, 0}},
    {"3.3 m at 777", {3.3f, 3.3f, 3.3f}, {777.7f, -777.7f, 777.7f}},
    {"needle", {0.1f, 40, 0.7f}, {3, 2, 1}},
};
enum { PLACES = sizeof places / sizeof places[0] };

static uint32_t add_box(struct scene_builder *b)
{
    static const float corners[24] = {-1, -1, -1, 1, -1, -1, 1, 1, -1, -1, 1, -1,
                                      -1, -1, 1,  1, -1, 1,  1, 1, 1,  -1, 1, 1};
    static const uint32_t faces[36] = {0, 2, 1, 0, 3, 2, 4, 5, 6, 4, 6, 7, 0, 1, 5, 0, 5, 4,
                                       3, 6, 2, 3, 7, 6, 1, 2, 6, 1, 6, 5, 0, 4, 7, 0, 7, 3};

    return builder_mesh(b, corners, NULL, 8, faces, 12, 1);
}

/* A ball whose every point lies elsewhere: its middle still sees all of it. */
static uint32_t add_spikes(struct scene_builder *b)
{
    enum { RINGS = 24, SIDES = 31, COUNT = RINGS * SIDES + 2 };
    static float p[3 * COUNT];
    static uint32_t faces[6 * RINGS * SIDES];
    const double pi = 3.14159265358979;
    uint32_t n = 0;

    for (uint32_t i = 0; i < COUNT; i++) {
        uint32_t ring = i / SIDES;
        double polar = i == COUNT - 2 ? 0 : i == COUNT - 1 ? pi : pi * (ring + 1) / (RINGS + 1);
        double azimuth = 2 * pi * (i % SIDES) / SIDES;
        double radius = 0.6 + 0.4 * (double)(hash_u64(i) >> 40) * 0x1p-24;

        p[3 * i] = (float)(radius * sin(polar) * cos(azimuth));
        p[3 * i + 1] = (float)(radius * cos(polar));
        p[3 * i + 2] = (float)(-radius * sin(polar) * sin(azimuth));
    }
    for (uint32_t k = 0; k < SIDES; k++) {
        uint32_t next = (k + 1) % SIDES, last = (RINGS - 1) * SIDES;
        const uint32_t caps[6] = {COUNT - 2, k, next, COUNT - 1, last + next, last + k};
        for (int c = 0; c < 6; c++)
            faces[n++] = caps[c];
        for (uint32_t ring = 0; ring + 1 < RINGS; ring++) {
            uint32_t a = ring * SIDES + k, d = ring * SIDES + next;
            const uint32_t quad[6] = {a, a + SIDES, d, d, a + SIDES, d + SIDES};
            for (int c = 0; c < 6; c++)
                faces[n++] = quad[c];
        }
    }
    return builder_mesh(b, p, NULL, COUNT, faces, n / 3, 1);
}

static uint32_t add_form(struct scene_builder *b, enum form form)
{
    switch (form) {
    case FORM_BOX: return add_box(b);
    case FORM_SPHERE_COARSE: return builder_sphere(b, 6, 0);
    case FORM_SPHERE: return builder_sphere(b, 32, 0);
    case FORM_SPHERE_FINE: return builder_sphere(b, 128, 0); /* twice: instances */
    default: return add_spikes(b);
    }
}

/* ---- rays --------------------------------------------------------------------------------- */

struct shooter {
    struct render_scene *scene;
    struct vec3 at, scale; /* of instance 0, around whose middle the rays start */
    uint64_t counter;
    struct render_stats stats;
};

static double number(struct shooter *sh) { return (double)(hash_u64(++sh->counter) >> 11) * 0x1p-53; }

static uint32_t any_triangle(struct shooter *sh)
{
    const struct render_mesh *mesh = &sh->scene->meshes[sh->scene->instances[0].mesh];

    return (uint32_t)(number(sh) * mesh->triangle_count);
}

/* A vertex of the triangle, or a point of one of its edges. */
static void any_target(struct shooter *sh, uint32_t triangle, int edge, double out[3])
{
    double c[3][3], f = edge ? number(sh) : 0;
    int a = (int)(3 * number(sh)), b = (a + 1) % 3;

    triangle_exact_corners(sh->scene, 0, triangle, 0, c);
    for (int k = 0; k < 3; k++)
        out[k] = c[a][k] + f * (c[b][k] - c[a][k]);
}

/* From somewhere around the middle, in mid-air. */
static void start_in_air(struct shooter *sh, struct ray *ray)
{
    *ray = (struct ray){.t_max = INFINITY};
    ray->origin = vec3_make((float)(number(sh) - 0.5), (float)(number(sh) - 0.5), (float)(number(sh) - 0.5));
    ray->origin = vec3_add(sh->at, vec3_mul(vec3_scale(ray->origin, 0.5f), sh->scale));
}

/* From a face, as paths leave it; the ray is the one that came there. */
static void start_on_face(struct shooter *sh, struct ray *ray, struct surface *s)
{
    double c[3][3], p[3], from[3], u = number(sh), v = number(sh);
    struct hit hit = {0, any_triangle(sh)};

    start_in_air(sh, ray);
    triangle_exact_corners(sh->scene, 0, hit.triangle, 0, c);
    if (u + v > 1) {
        u = 1 - u;
        v = 1 - v;
    }
    exact_origin(ray, from);
    for (int k = 0; k < 3; k++)
        p[k] = c[0][k] + u * (c[1][k] - c[0][k]) + v * (c[2][k] - c[0][k]) - from[k];
    ray->direction = vec3_normalize(vec3_make((float)p[0], (float)p[1], (float)p[2]));
    surface_from_hit(sh->scene, ray, &hit, s);
}

/* The direction from a place; 0: it is there already. */
static int direction_to(const double target[3], const double from[3], struct vec3 *direction)
{
    double to[3], length;

    exact_sub(target, from, to);
    length = sqrt(exact_dot(to, to));
    if (!(length > 0))
        return 0;
    *direction = vec3_make((float)(to[0] / length), (float)(to[1] / length), (float)(to[2] / length));
    return 1;
}

/* 0: the target is outside as seen from the face. */
static int aim_from_face(const struct surface *s, const double target[3], struct ray *ray)
{
    struct vec3 direction;
    double from[3];

    exact_vec(s->p, from);
    for (int k = 0; k < 3; k++)
        from[k] += s->rest[k];
    if (s->front || !direction_to(target, from, &direction) || !(vec3_dot(direction, s->ng) > 1e-5f))
        return 0;
    surface_leave(s, direction, ray);
    return 1;
}

static int aim(const double target[3], struct ray *ray)
{
    double from[3];

    exact_origin(ray, from);
    return direction_to(target, from, &ray->direction);
}

/* Does light arrive along the ray? It comes from outside only. */
static int is_lit(struct shooter *sh, const struct ray *ray)
{
    const struct camera_cone cone = {0, 0};
    struct sampler sampler;
    struct vec3 light;

    sampler_start(&sampler, 1, 0, 0, 0, 0, 0);
    light = path_radiance(sh->scene, &sampler, ray, cone, NULL, &sh->stats);
    return !(light.x == 0);
}

/* Does it meet nothing at all? (One that meets glass may pass it.) */
static int escapes(struct shooter *sh, const struct ray *ray)
{
    uint64_t before = sh->stats.work.rays;

    return is_lit(sh, ray) && sh->stats.work.rays == before + 1;
}

/* The same of a ray that the sun would send in through a vertex or an edge: the ray looks at the
 * place where it would arrive. */
static int sun_arrives(struct shooter *sh, struct vec3 sun, const double target[3])
{
    const struct path_query query = {0};
    struct ray ray = {.t_max = INFINITY};
    double size = (double)vec3_max(sh->scale), p[3], c[3][3], n[3], d[3], t;
    struct hit hit;

    exact_vec(sun, d);
    for (int k = 0; k < 3; k++)
        p[k] = target[k] + 0.01 * size * d[k];
    ray.origin = exact_round(p, ray.rest);
    ray.direction = sun;
    if (!accel_intersect(sh->scene->accel, &ray, &query, &hit))
        return 0;
    triangle_exact_corners(sh->scene, hit.instance, hit.triangle, 0, c);
    exact_normal(c, n);
    t = exact_crossing(c, n, target, d);
    for (int k = 0; k < 3; k++)
        p[k] = target[k] + t * d[k];
    if (!(exact_dot(n, d) > 0) || !(t < INFINITY))
        return 0;
    start_in_air(sh, &ray);
    return aim(p, &ray) && is_lit(sh, &ray);
}

static uint64_t shoot(struct shooter *sh, uint64_t count, int on_face)
{
    uint64_t escaped = 0;

    for (uint64_t i = 0; i < count; i++) {
        double target[3];
        struct surface s;
        struct ray ray;
        int aimed;

        if (on_face)
            start_on_face(sh, &ray, &s);
        else
            start_in_air(sh, &ray);
        /* Some graze the face from which they come, on their way to its neighbour. */
        any_target(sh, on_face && i % 8 == 5 ? s.triangle ^ 1 : any_triangle(sh), i % 4 == 3, target);
        aimed = on_face ? aim_from_face(&s, target, &ray) : aim(target, &ray);
        escaped += (uint64_t)(aimed && escapes(sh, &ray));
    }
    return escaped;
}

/* ---- tests -------------------------------------------------------------------------------- */

static struct scene_material *add_glass(struct scene_builder *b)
{
    struct scene_material *m = builder_lambert(b, 1);

    m->transmission = 1;
    m->refractive = 1;
    m->ior = 1.5f;
    m->specular = 1;
    m->roughness = 0.3f;
    return m;
}

/* Of one form in one place. The camera is inside it but for GLASS; BLACK has nothing to see there. */
enum { BLACK, GLASS, GLASS_AROUND };

static struct render_scene *build(struct scene_builder *b, enum form form, const struct place *place, enum isa isa,
                                  int glass)
{
    struct render_settings settings = builder_settings(16, 16, 1);
    uint32_t mesh;

    settings.max_depth = 0;
    settings.isa = isa;
    builder_init(b);
    if (glass)
        add_glass(b);
    else
        builder_lambert(b, 0);
    mesh = add_form(b, form);
    builder_place(b, mesh, 0, place->scale, place->at);
    if (form == FORM_SPHERE_FINE)
        builder_place(b, mesh, 0, place->scale, vec3_add(place->at, vec3_scale(place->scale, 3)));
    builder_environment_constant(b, vec3_splat(1));
    builder_camera(b, vec3_add(place->at, vec3_scale(place->scale, glass == GLASS ? 5 : 0.01f)), place->at, 1);
    return builder_build(b, &settings);
}

static uint64_t leaked; /* in all, and put right */

static void check_everywhere(int on_face, int glass, const char *what)
{
    uint64_t runs = 0, share, all = 0, unsure = 0;

    for (int isa = 0; isa < ISA_COUNT; isa++)
        runs += isa_supported_mask() >> isa & 1;
    share = rays_wanted / (3 * runs * FORMS * PLACES);
    for (int isa = 0; isa < ISA_COUNT; isa++)
        for (int form = 0; form < FORMS && isa_supported_mask() >> isa & 1; form++)
            for (int place = 0; place < PLACES; place++) {
                int large = form == FORM_SPHERE_FINE && (place > 0 || glass);
                struct scene_builder b;
                struct shooter sh = {.at = places[place].at, .scale = places[place].scale};
                uint64_t escaped;

                if (large && rays_wanted < RAYS_LONG)
                    continue;
                sh.scene = build(&b, (enum form)form, &places[place], (enum isa)isa, glass);
                if (sh.scene->enclosed == glass)
                    printf("# %s, %s: the camera is %s\n", form_names[form], places[place].name,
                           glass ? "not outside" : "not inside");
                unsure += sh.scene->enclosed == glass;
                escaped = shoot(&sh, share, on_face);
                leaked += sh.stats.work.leaked_rays;
                if (rays_wanted >= RAYS_LONG)
                    printf("# %s, %s, %s, from %s: %llu rays, %llu leaked, %llu escaped\n",
                           isa_name((enum isa)isa), form_names[form], places[place].name,
                           glass ? "a face of glass" : on_face ? "a face" : "mid-air",
                           (unsigned long long)sh.stats.work.rays,
                           (unsigned long long)sh.stats.work.leaked_rays, (unsigned long long)escaped);
                if (escaped)
                    printf("# %s, %s, %s: %llu of %llu rays escaped\n", isa_name((enum isa)isa), form_names[form],
                           places[place].name, (unsigned long long)escaped, (unsigned long long)share);
                all += escaped;
                render_scene_free(sh.scene);
                builder_release(&b);
            }
    figure_within(what, (double)all, 0, 0, "exact");
    assert_int_equal(unsure, 0); /* rooms and glass are told apart */
}

static void test_room_from_mid_air(void **state)
{
    (void)state;
    check_everywhere(0, 0, "rays that escape from the air of rooms");
}

static void test_room_from_its_faces(void **state)
{
    (void)state;
    check_everywhere(1, 0, "rays that escape from the walls of rooms");
}

static void test_glass_from_its_faces(void **state)
{
    (void)state;
    check_everywhere(1, 1, "rays that escape from inside glass");
}

/* A path that begins in glass leaves no face: that the body is closed has to tell. */
static void test_glass_from_mid_air(void **state)
{
    uint64_t escaped = 0, repaired = 0;

    (void)state;
    for (int isa = 0; isa < ISA_COUNT; isa++)
        for (int form = FORM_SPHERE; form < FORMS && isa_supported_mask() >> isa & 1; form++) {
            struct shooter sh = {.at = places[0].at, .scale = places[0].scale};
            struct scene_builder b;

            sh.scene = build(&b, (enum form)form, &places[0], (enum isa)isa, GLASS_AROUND);
            assert_int_equal(sh.scene->enclosed, 0);
            assert_int_equal(sh.scene->camera_interior.count, 1);
            escaped += shoot(&sh, rays_wanted / 12, 0);
            repaired += sh.stats.work.leaked_rays;
            render_scene_free(sh.scene);
            builder_release(&b);
        }
    figure_within("rays that escape from the middle of glass", (double)escaped, 0, 0, "exact");
    assert_true(repaired > 0);
}

/* A ball of glass that four meshes close only together, in patches of 8 by 8 quads: rays from the faces
 * of one, aimed at its vertices and edges, many of which are others' as well. */
static uint64_t glass_in_parts(enum isa isa, uint64_t share, uint64_t *repaired)
{
    enum { SEGMENTS = 64, PARTS = 4, ACROSS = SEGMENTS + 1 };
    static float p[3 * ACROSS * ACROSS];
    static uint32_t indices[6 * SEGMENTS * SEGMENTS];
    const double pi = 3.14159265358979;
    struct render_settings settings = builder_settings(16, 16, 1);
    struct shooter sh = {.at = places[2].at, .scale = places[2].scale};
    uint64_t escaped;
    struct scene_builder b;

    settings.max_depth = 0;
    settings.isa = isa;
    builder_init(&b);
    add_glass(&b);
    for (uint32_t i = 0; i < ACROSS * ACROSS; i++) {
        uint32_t ring = i / ACROSS, side = i % ACROSS % SEGMENTS;
        double polar = pi * ring / SEGMENTS, azimuth = 2 * pi * side / SEGMENTS;
        double radius = ring == 0 || ring == SEGMENTS ? 0 : sin(polar);
        p[3 * i] = (float)(radius * cos(azimuth));
        p[3 * i + 1] = (float)cos(polar);
        p[3 * i + 2] = (float)(-radius * sin(azimuth));
    }
    for (uint32_t part = 0; part < PARTS; part++) {
        uint32_t n = 0;
        for (uint32_t k = 0; k < SEGMENTS * SEGMENTS; k++) {
            uint32_t ring = k / SEGMENTS, side = k % SEGMENTS, a = ring * ACROSS + side;
            const uint32_t quad[6] = {a, a + ACROSS, a + 1, a + 1, a + ACROSS, a + ACROSS + 1};
            if ((ring / 8 + side / 8) % PARTS != part)
                continue;
            /* At the poles one of the two has no area. */
            for (int c = ring == 0 ? 3 : 0; c < (ring == SEGMENTS - 1 ? 3 : 6); c++)
                indices[n++] = quad[c];
        }
        builder_place(&b, builder_mesh(&b, p, NULL, ACROSS * ACROSS, indices, n / 3, 0), 0, sh.scale, sh.at)->sealed =
            1;
    }
    builder_environment_constant(&b, vec3_splat(1));
    builder_camera(&b, vec3_add(sh.at, vec3_scale(sh.scale, 5)), sh.at, 1);
    sh.scene = builder_build(&b, &settings);
    escaped = shoot(&sh, share, 1);
    *repaired += sh.stats.work.leaked_rays;
    render_scene_free(sh.scene);
    builder_release(&b);
    return escaped;
}

static void test_glass_in_parts(void **state)
{
    uint64_t repaired = 0, escaped = 0;

    (void)state;
    for (int isa = 0; isa < ISA_COUNT; isa++)
        if (isa_supported_mask() >> isa & 1)
            escaped += glass_in_parts((enum isa)isa, rays_wanted / 8, &repaired);
    figure_within("rays that escape from glass in four meshes", (double)escaped, 0, 0, "exact");
    assert_true(repaired > 0);
}

/* A white ball, inside of which no sun shines. */
static void test_shadow_rays(void **state)
{
    const struct vec3 sun = vec3_normalize(vec3_make(0.3f, -0.8f, 0.52f));
    uint64_t repaired = 0, all = 0;

    (void)state;
    for (int isa = 0; isa < ISA_COUNT; isa++)
        for (int place = 0; place < 2 && isa_supported_mask() >> isa & 1; place++) {
            struct render_settings settings = builder_settings(16, 16, 1);
            struct shooter sh = {.at = places[place].at, .scale = places[place].scale};
            struct scene_builder b;
            struct scene_light *light;
            uint64_t lit = 0;

            settings.max_depth = 1;
            settings.isa = (enum isa)isa;
            builder_init(&b);
            builder_lambert(&b, 1);
            builder_place(&b, builder_sphere(&b, 64, 0), 0, sh.scale, sh.at);
            builder_camera(&b, vec3_add(sh.at, vec3_scale(sh.scale, 0.01f)), sh.at, 1);
            light = builder_light(&b, LIGHT_DIRECTIONAL);
            for (int k = 0; k < 3; k++)
                light->intensity[k] = 1;
            light->direction[0] = sun.x;
            light->direction[1] = sun.y;
            light->direction[2] = sun.z;
            sh.scene = builder_build(&b, &settings);
            for (uint64_t i = 0; i < rays_wanted / 20; i++) {
                double target[3];
                any_target(&sh, any_triangle(&sh), i % 4 == 3, target);
                lit += (uint64_t)sun_arrives(&sh, sun, target);
            }
            if (rays_wanted >= RAYS_LONG)
                printf("# %s, %s, to the sun: %llu rays, %llu leaked, %llu escaped\n", isa_name((enum isa)isa),
                       places[place].name, (unsigned long long)sh.stats.work.rays,
                       (unsigned long long)sh.stats.work.leaked_rays, (unsigned long long)lit);
            all += lit;
            repaired += sh.stats.work.leaked_rays;
            render_scene_free(sh.scene);
            builder_release(&b);
        }
    figure_within("places inside a ball that the sun reaches", (double)all, 0, 0, "exact");
    assert_true(repaired > 0);
}

/* The tests above show nothing if no ray leaks in the first place. */
static void test_rays_leak(void **state)
{
    (void)state;
    assert_true(leaked > 0);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_room_from_mid_air),
        cmocka_unit_test(test_room_from_its_faces),
        cmocka_unit_test(test_glass_from_its_faces),
        cmocka_unit_test(test_glass_from_mid_air),
        cmocka_unit_test(test_glass_in_parts),
        cmocka_unit_test(test_shadow_rays),
        cmocka_unit_test(test_rays_leak),
    };

    if (argc > 1)
        rays_wanted = (uint64_t)strtod(argv[1], NULL);
    render_keep_origin(1); /* rays and places here are in the scenes' own coordinates */
    return cmocka_run_group_tests_name("leaks", tests, NULL, NULL);
}
