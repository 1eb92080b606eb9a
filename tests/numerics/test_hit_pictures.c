/* What a hit is shaded with, in pictures whose values are known: bases, normals, windings, sides.
 *
 * Most figures are pictures of white things in a furnace, which are 1 everywhere. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <cmocka.h>

#include "tests/support/figure.h"
#include "tests/support/scene_builder.h"
#include "tests/support/statistics.h"
#include "worker/render/render_scene.h"

enum { SIDE = 16, PIXELS = SIDE * SIDE };

struct picture {
    double mean, darkest, lightest; /* of the red channel */
};

static struct picture render(struct scene_builder *b, const struct render_settings *settings)
{
    struct render_scene *scene = builder_build(b, settings);
    struct picture out = {0, INFINITY, -INFINITY};
    static double mean[3 * PIXELS];
    struct render_stats stats = {0};

    builder_render(scene, settings, 0, mean, NULL, &stats);
    for (size_t i = 0; i < PIXELS; i++) {
        out.mean += mean[3 * i] / PIXELS;
        out.darkest = fmin(out.darkest, mean[3 * i]);
        out.lightest = fmax(out.lightest, mean[3 * i]);
    }
    render_scene_free(scene);
    builder_release(b);
    return out;
}

/* One bounce by the cosine: in a furnace every pixel of a white surface is 1, without any noise. */
static struct render_settings furnace(void)
{
    struct render_settings settings = builder_settings(SIDE, SIDE, 16);

    settings.max_depth = 1;
    settings.env_sampling = ENV_SAMPLING_BSDF;
    return settings;
}

/* A white square from -1 to 1 in the xy plane, its winding towards -z (`back`) or +z, and its
 * vertices' normals, if any, all the same. */
static uint32_t square(struct scene_builder *b, int back, const struct vec3 *normal)
{
    static const float corners[12] = {-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0};
    static const uint32_t to_front[6] = {0, 1, 2, 0, 2, 3}, to_back[6] = {0, 2, 1, 0, 3, 2};
    float normals[12];

    for (int k = 0; k < 4 && normal; k++) {
        normals[3 * k] = normal->x;
        normals[3 * k + 1] = normal->y;
        normals[3 * k + 2] = normal->z;
    }
    return builder_mesh(b, corners, normal ? normals : NULL, 4, back ? to_back : to_front, 2, 0);
}

/* The square in a furnace, seen from `eye`. */
static struct picture in_furnace(int back, const struct vec3 *normal, struct vec3 scale, struct vec3 eye)
{
    struct render_settings settings = furnace();
    struct scene_builder b;

    builder_init(&b);
    builder_lambert(&b, 1);
    builder_place(&b, square(&b, back, normal), 0, scale, vec3_splat(0));
    builder_environment_constant(&b, vec3_splat(1));
    builder_camera(&b, eye, vec3_splat(0), 0.02f);
    return render(&b, &settings);
}

static void a_wall_may_face_any_way(void **state)
{
    struct picture front = in_furnace(0, NULL, vec3_splat(1), vec3_make(0.2f, 0.1f, 3));
    struct picture back = in_furnace(1, NULL, vec3_splat(1), vec3_make(0.2f, 0.1f, -3));

    (void)state;
    figure_within("white wall that faces +z, in a furnace", front.mean, 1 - 1e-5, 1 + 1e-5,
                  "closed form, tolerance 1e-5");
    figure_within("white wall that faces -z, in a furnace", back.mean, 1 - 1e-5, 1 + 1e-5,
                  "closed form, tolerance 1e-5");
}

static void normals_may_have_any_length(void **state)
{
    static const float lengths[] = {1, 1e-25f, 1e25f};
    double darkest = INFINITY;

    (void)state;
    for (size_t k = 0; k < sizeof lengths / sizeof *lengths; k++) {
        struct vec3 normal = vec3_make(0, 0, lengths[k]);
        darkest = fmin(darkest, in_furnace(0, &normal, vec3_splat(1), vec3_make(1, 0, 1)).darkest);
    }
    figure_within("darkest pixel of walls with normals of length 1e-25 to 1e25", darkest, 1 - 1e-5, 1 + 1e-5,
                  "closed form, tolerance 1e-5");
}

/* Where a normal has no direction, the face's own counts. Another, such as the direction to the
 * camera, would lose the light that it sends below the face. */
static void a_normal_without_length_is_the_faces(void **state)
{
    struct vec3 zero = {0, 0, 0};

    (void)state;
    figure_within("white wall with normals of length 0, in a furnace",
                  in_furnace(0, &zero, vec3_splat(1), vec3_make(2, 0, 1)).mean, 1 - 1e-5, 1 + 1e-5,
                  "closed form, tolerance 1e-5");
}

/* A slope stretched fourfold along y: its normals lean as the slope does. */
static void a_stretched_slope_keeps_its_normal(void **state)
{
    static const float corners[12] = {-1, -1, -1, 1, -1, -1, 1, 1, 1, -1, 1, 1};
    static const float normals[12] = {0, -1, 1, 0, -1, 1, 0, -1, 1, 0, -1, 1};
    static const uint32_t faces[6] = {0, 1, 2, 0, 2, 3};
    struct render_settings settings = furnace();
    struct scene_builder b;

    (void)state;
    builder_init(&b);
    builder_lambert(&b, 1);
    builder_place(&b, builder_mesh(&b, corners, normals, 4, faces, 2, 0), 0, vec3_make(1, 4, 1), vec3_splat(0));
    builder_environment_constant(&b, vec3_splat(1));
    builder_camera(&b, vec3_make(0, -1, 4), vec3_splat(0), 0.02f);
    figure_within("white slope with normals, stretched fourfold, in a furnace", render(&b, &settings).mean, 1 - 1e-5,
                  1 + 1e-5, "closed form, tolerance 1e-5");
}

/* A lamp shines from its front only, and a mirrored one's front is where the mirror puts it. */
static void a_mirrored_lamp_shines_forward(void **state)
{
    struct render_settings settings = furnace();
    struct scene_material *lamp;
    struct scene_builder b;

    (void)state;
    builder_init(&b);
    lamp = builder_lambert(&b, 0);
    lamp->double_sided = 0;
    lamp->emission[0] = lamp->emission[1] = lamp->emission[2] = 2;
    builder_place(&b, square(&b, 0, NULL), 0, vec3_make(-1, 1, 1), vec3_splat(0));
    builder_camera(&b, vec3_make(0.1f, 0.2f, 3), vec3_splat(0), 0.1f);
    figure_within("lamp of radiance 2, mirrored, from its front", render(&b, &settings).mean, 2 - 1e-5, 2 + 1e-5,
                  "closed form, tolerance 1e-5");
}

/* A coarse mirror ball with smooth normals, in a furnace: at its rim the mirror direction of the
 * smooth normal lies below the face. */
static void a_coarse_mirror_has_no_black_rim(void **state)
{
    struct render_settings settings = furnace();
    struct scene_material *mirror;
    struct scene_builder b;

    (void)state;
    builder_init(&b);
    mirror = builder_lambert(&b, 1);
    mirror->metallic = 1;
    mirror->specular = 1;
    mirror->roughness = 0;
    builder_place(&b, builder_sphere(&b, 8, 1), 0, vec3_splat(1), vec3_splat(0));
    builder_environment_constant(&b, vec3_splat(1));
    builder_camera(&b, vec3_make(0, 0, 5), vec3_splat(0), 0.45f);
    figure_within("darkest pixel of a white mirror ball of 128 faces, in a furnace", render(&b, &settings).darkest,
                  1 - 1e-4, 1 + 1e-4, "closed form, tolerance 1e-4");
}

/* A black wall before light that is behind it: its shading normal leans to that side by 80 degrees
 * and its back is white, yet nothing comes through. By a sun, and by a sky below. */
static void a_wall_keeps_light_out(void **state)
{
    const struct vec3 leaning = {0.9848f, 0, 0.1736f};
    static float sky[16 * 8 * 3];
    struct render_settings settings = furnace();
    struct scene_light *sun;
    struct scene_builder b;

    (void)state;
    builder_init(&b);
    builder_lambert(&b, 1);
    builder_place(&b, square(&b, 0, &leaning), 0, vec3_splat(1), vec3_splat(0));
    sun = builder_light(&b, LIGHT_DIRECTIONAL);
    sun->direction[0] = -0.9f; /* to where it shines */
    sun->direction[1] = 0;
    sun->direction[2] = 0.43589f;
    sun->intensity[0] = sun->intensity[1] = sun->intensity[2] = 3;
    builder_camera(&b, vec3_make(0.5f, 0, 1), vec3_splat(0), 0.02f);
    figure_within("wall with a sun behind it", render(&b, &settings).lightest, 0, 0, "exact");

    /* The wall faces +y here, up in the map, whose first row below the horizon stays dark: the filter
     * between rows would take it up. */
    for (size_t i = 5 * 16 * 3; i < sizeof sky / sizeof *sky; i++)
        sky[i] = 1;
    builder_init(&b);
    builder_lambert(&b, 1);
    {
        const float corners[12] = {-1, 0, -1, -1, 0, 1, 1, 0, 1, 1, 0, -1};
        const float n[12] = {leaning.x, leaning.z, 0, leaning.x, leaning.z, 0,
                             leaning.x, leaning.z, 0, leaning.x, leaning.z, 0};
        const uint32_t faces[6] = {0, 1, 2, 0, 2, 3};
        builder_place(&b, builder_mesh(&b, corners, n, 4, faces, 2, 0), 0, vec3_splat(1), vec3_splat(0));
    }
    builder_environment_map(&b, sky, 16, 8);
    builder_camera(&b, vec3_make(0.5f, 1, 0.01f), vec3_splat(0), 0.02f);
    figure_within("wall with a bright sky behind it", render(&b, &settings).lightest, 0, 0, "exact");
}

/* ---- bodies ---------------------------------------------------------------------------------- */

/* Two sheets of dyed glass of index 1 that face each other: a ray leaves the body before it enters it,
 * and is outside of it behind the second. A lamp is 5 m behind. */
static void a_body_left_first_ends(void **state)
{
    struct render_settings settings = furnace();
    struct scene_material *m;
    struct scene_builder b;

    (void)state;
    settings.max_depth = 8;
    builder_init(&b);
    m = builder_lambert(&b, 1);
    m->double_sided = 0;
    m->specular = 0;
    m->transmission = 1;
    m->roughness = 0;
    m->refractive = 1;
    m->ior = 1;
    m->attenuation_distance = 1;
    m->attenuation_color[0] = m->attenuation_color[1] = m->attenuation_color[2] = 0.5f;
    m = builder_lambert(&b, 0);
    m->emission[0] = m->emission[1] = m->emission[2] = 1;
    builder_place(&b, square(&b, 1, NULL), 0, vec3_splat(1), vec3_make(0, 0, 0.5f));
    builder_place(&b, square(&b, 0, NULL), 0, vec3_splat(1), vec3_make(0, 0, -0.5f));
    builder_place(&b, square(&b, 0, NULL), 1, vec3_splat(1), vec3_make(0, 0, -5.5f));
    builder_camera(&b, vec3_make(0, 0, 3), vec3_splat(0), 0.05f);
    figure_within("lamp of radiance 1 behind glass that is left before it is entered", render(&b, &settings).mean,
                  1 - 1e-5, 1 + 1e-5, "closed form, tolerance 1e-5");
}

/* ---- a sheet --------------------------------------------------------------------------------- */

enum { CELLS = 48, ACROSS = CELLS + 1 };

/* A bumpy sheet over the square from -1 to 1, open: what slips through is not traced again. */
static uint32_t bumpy_sheet(struct scene_builder *b, float p[3 * ACROSS * ACROSS], uint32_t indices[6 * CELLS * CELLS])
{
    struct test_random random = {5};

    for (uint32_t i = 0; i < ACROSS * ACROSS; i++) {
        p[3 * i] = 2 * (float)(i % ACROSS) / CELLS - 1;
        p[3 * i + 1] = 0.02f * test_random_float(&random);
        p[3 * i + 2] = 2 * (float)(i / ACROSS) / CELLS - 1;
    }
    for (uint32_t i = 0; i < CELLS * CELLS; i++) {
        uint32_t a = i / CELLS * ACROSS + i % CELLS;
        const uint32_t quad[6] = {a, a + ACROSS, a + 1, a + 1, a + ACROSS, a + ACROSS + 1};
        for (int k = 0; k < 6; k++)
            indices[6 * i + (uint32_t)k] = quad[k];
    }
    return builder_mesh(b, p, NULL, ACROSS * ACROSS, indices, 2 * CELLS * CELLS, 0);
}

/* Of rays aimed at the edges between its triangles. */
static void a_sheet_lets_nothing_through(void **state)
{
    static float p[3 * ACROSS * ACROSS];
    static uint32_t indices[6 * CELLS * CELLS];
    struct render_settings settings = builder_settings(1, 1, 1);
    struct test_random random = {6};
    struct render_scene *scene;
    struct scene_builder b;
    int through = 0;

    (void)state;
    builder_init(&b);
    builder_lambert(&b, 0);
    builder_place(&b, bumpy_sheet(&b, p, indices), 0, vec3_splat(1), vec3_splat(0));
    builder_camera(&b, vec3_make(0, 5, 0), vec3_splat(0), 0.4f);
    scene = builder_build(&b, &settings);
    for (int i = 0; i < 400000; i++) {
        uint32_t cell = (uint32_t)(test_random_u64(&random) % (CELLS * CELLS));
        const float *from = p + 3 * indices[6 * cell + 1], *to = p + 3 * indices[6 * cell + 2];
        float f = 0.01f + 0.98f * test_random_float(&random);
        struct vec3 at = vec3_make(from[0] + f * (to[0] - from[0]), from[1] + f * (to[1] - from[1]),
                                   from[2] + f * (to[2] - from[2]));
        struct ray ray = {.t_max = INFINITY,
                          .origin = {test_random_float(&random), 3, test_random_float(&random)}};
        struct hit hit;

        ray.direction = vec3_normalize(vec3_sub(at, ray.origin));
        through += !accel_intersect(scene->accel, &ray, NULL, &hit);
    }
    figure_within("of 400,000 rays at the edges of an open sheet, those that pass", through, 0, 0, "exact");
    render_scene_free(scene);
    builder_release(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_wall_may_face_any_way),
        cmocka_unit_test(normals_may_have_any_length),
        cmocka_unit_test(a_normal_without_length_is_the_faces),
        cmocka_unit_test(a_stretched_slope_keeps_its_normal),
        cmocka_unit_test(a_mirrored_lamp_shines_forward),
        cmocka_unit_test(a_coarse_mirror_has_no_black_rim),
        cmocka_unit_test(a_wall_keeps_light_out),
        cmocka_unit_test(a_body_left_first_ends),
        cmocka_unit_test(a_sheet_lets_nothing_through),
    };

    return cmocka_run_group_tests_name("hit_pictures", tests, NULL, NULL);
}
