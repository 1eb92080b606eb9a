/* Pairs of opaque faces closer than float can tell, as exports have them: floors twice, walls of two sheets.
 * One of the two is seen, and light that arrives at it leaves it again.
 *
 * Rays meet pairs of square sheets of 10 m from some metres to 10 km away, whose order Embree often
 * swaps, and leave them in all directions: there is nothing else to meet. Then the converse: a card that
 * hangs closer over a floor than Embree can tell, but which the ray did not pass, keeps its shadow. The
 * sheets are turned at random, so that their corners are rounded. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "tests/support/figure.h"
#include "tests/support/radiance.h"
#include "tests/support/scene_builder.h"
#include "tests/support/statistics.h"
#include "worker/render/base/exact.h"
#include "worker/render/light/emitters.h"
#include "worker/render/path/path.h"
#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"

enum { SIDE_CELLS_MAX = 7, VERTICES_MAX = 64, LEAVE = 4 };
#define HALF 5.0

static const double distances[] = {3, 8, 100, 1e3, 1e4};
static const double gaps[] = {0, 1e-8, 1e-7, 4e-7, 1e-6, 1e-5, 1e-4, 1e-3};

enum { DISTANCES = sizeof distances / sizeof *distances, GAPS = sizeof gaps / sizeof *gaps };

/* How the second sheet is written. */
struct pair {
    const char *what;
    uint32_t cells; /* of the second; the first has one */
    int reversed, one_sided, in_mesh;
};

static const struct pair pairs[] = {
    {"two sheets", 1, 0, 0, 0},
    {"one of 49 cells", 7, 0, 0, 0},
    {"wound the other way", 1, 1, 0, 0},
    {"in one mesh", 3, 0, 0, 1},
    {"one-sided", 2, 0, 1, 0},
    {"one-sided, back to back", 1, 1, 1, 0},
};

/* Of two that face away from each other the second hides the first's light, if floats can tell. */
static int is_dark(const struct pair *p, double gap) { return p->one_sided && p->reversed && gap > 1e-6; }

static struct test_random source;

static double number(double low, double high) { return low + (high - low) * test_random_double(&source); }

static double turn[3][3]; /* the columns are the sheet's axes, the last its normal */

/* 0: along the axes; else turned by random numbers. */
static void choose_turn(unsigned index)
{
    double n[3] = {0, 0, 1}, a[3] = {1, 0, 0}, b[3];

    source.state = index;
    for (int k = 0; k < 3 && index; k++) {
        n[k] = number(-1, 1);
        a[k] = number(-1, 1);
    }
    exact_cross(n, a, b);
    exact_cross(b, n, a);
    for (int k = 0; k < 3; k++) {
        turn[k][0] = a[k] / sqrt(exact_dot(a, a));
        turn[k][1] = b[k] / sqrt(exact_dot(b, b));
        turn[k][2] = n[k] / sqrt(exact_dot(n, n));
    }
}

static void place(const double at[3], float out[3])
{
    for (int r = 0; r < 3; r++)
        out[r] = (float)(turn[r][0] * at[0] + turn[r][1] * at[1] + turn[r][2] * at[2]);
}

/* A sheet of cells x cells quads from `low` to `high`, `height` along the normal. */
static void add_sheet(float (*vertices)[3], uint32_t *vertex_count, uint32_t *indices, uint32_t *triangles,
                      uint32_t cells, double low, double high, double height, int reversed)
{
    const uint32_t first = *vertex_count, row = cells + 1;

    for (uint32_t i = 0; i < row * row; i++)
        place((double[3]){low + (high - low) * (i % row) / cells, low + (high - low) * (double)(i / row) / cells,
                          height},
              vertices[(*vertex_count)++]);
    for (uint32_t i = 0; i < 2 * cells * cells; i++) {
        uint32_t a = first + i / 2 / cells * row + i / 2 % cells, c = a + row + 1;
        uint32_t b = i % 2 ? c : a + 1, d = i % 2 ? a + row : c;
        uint32_t *t = indices + 3 * (*triangles)++;
        t[0] = a;
        t[1] = reversed ? d : b;
        t[2] = reversed ? b : d;
    }
}

static void add_mesh(struct scene_builder *b, float (*vertices)[3], uint32_t vertex_count, const uint32_t *indices,
                     uint32_t triangles, uint32_t material)
{
    builder_place(b, builder_mesh(b, vertices[0], NULL, vertex_count, indices, triangles, 0), material, vec3_splat(1),
                  vec3_splat(0));
}

/* In a furnace, half of it seen from `distance` away. */
static void build_pair(struct scene_builder *b, const struct pair *p, double gap, double distance)
{
    float vertices[2 * VERTICES_MAX][3], eye[3], target[3];
    uint32_t indices[12 * SIDE_CELLS_MAX * SIDE_CELLS_MAX], vertex_count = 0, triangles = 0;

    builder_init(b);
    builder_lambert(b, 1)->double_sided = !p->one_sided;
    add_sheet(vertices, &vertex_count, indices, &triangles, 1, -HALF, HALF, 0, 0);
    if (!p->in_mesh) {
        add_mesh(b, vertices, vertex_count, indices, triangles, 0);
        vertex_count = triangles = 0;
    }
    add_sheet(vertices, &vertex_count, indices, &triangles, p->cells, -HALF, HALF, gap, p->reversed);
    add_mesh(b, vertices, vertex_count, indices, triangles, 0);
    builder_environment_constant(b, vec3_splat(1));
    place((double[3]){1, 2, distance}, eye);
    place((double[3]){0.1, 0.2, 0}, target);
    builder_camera(b, vec3_make(eye[0], eye[1], eye[2]), vec3_make(target[0], target[1], target[2]),
                   (float)(HALF / distance));
}

/* ---- rays ------------------------------------------------------------------------------------- */

/* From one place in the sheet's coordinates towards another; they are rounded. */
static struct ray ray_between(const double from[3], const double to[3])
{
    struct ray ray = {.t_max = INFINITY};
    float a[3], b[3];
    double way[3], length;

    place(from, a);
    place(to, b);
    for (int k = 0; k < 3; k++)
        way[k] = (double)b[k] - (double)a[k];
    length = sqrt(exact_dot(way, way));
    ray.origin = vec3_make(a[0], a[1], a[2]);
    ray.direction = vec3_make((real)(way[0] / length), (real)(way[1] / length), (real)(way[2] / length));
    return ray;
}

static struct vec3 any_direction(struct vec3 n)
{
    struct basis frame = basis_from_normal(n);
    double z = number(0.01, 1), r = sqrt(1 - z * z), phi = number(0, 6.283185307179586);

    return vec3_normalize(basis_to_world(&frame, vec3_make((real)(r * cos(phi)), (real)(r * sin(phi)), (real)z)));
}

struct count {
    uint64_t left, caught, repaired, second;
};

/* Somewhere on a sheet, or about as far from the edge of one of its cells as the sheets are apart. */
static double any_place(uint32_t cells, double gap, int near_edge)
{
    double edge = HALF * (2 * floor(number(0, cells)) / cells - 1);

    return near_edge && edge > -HALF ? edge + 2 * gap * number(-1, 1) : number(-0.9 * HALF, 0.9 * HALF);
}

/* Meet the pair from `distance` away, above the middle, and leave it. */
static void meet_pair(const struct render_scene *scene, const struct pair *p, double gap, double distance,
                      int near_edge, struct count *count)
{
    const double from[3] = {number(-1, 1), number(-1, 1), distance};
    const double to[3] = {any_place(p->cells, gap, near_edge), number(-0.9 * HALF, 0.9 * HALF), 0};
    struct ray ray = ray_between(from, to), next;
    struct path_query query = {NULL, 0};
    struct surface s;
    struct hit hit, other;

    assert_true(accel_intersect(scene->accel, &ray, &query, &hit));
    surface_from_hit(scene, &ray, &hit, &s);
    count->second += hit.instance == 0 && scene->instance_count > 1;
    for (int i = 0; i < LEAVE; i++) {
        surface_leave(&s, any_direction(s.ng), &next);
        count->left++;
        count->caught +=
            accel_intersect(scene->accel, &next, &query, &other) || accel_occluded(scene->accel, &next, &query);
        /* At an edge the repair believes what stands up there. */
        count->repaired += !near_edge && accel_intersect_enclosed(scene->accel, &next, &query, &other);
    }
}

static void rays_leave_a_pair(void **state)
{
    struct render_settings settings = builder_settings(8, 8, 4);
    struct count all = {0};

    (void)state;
    for (unsigned p = 0; p < sizeof pairs / sizeof *pairs; p++)
        for (unsigned g = 0; g < GAPS && !is_dark(&pairs[p], gaps[g]); g++)
            for (unsigned t = 0; t < 3; t++) {
                struct scene_builder b;
                struct render_scene *scene;
                struct count count = {0};
                choose_turn(t);
                build_pair(&b, &pairs[p], gaps[g], 10);
                scene = builder_build(&b, &settings);
                for (unsigned d = 0; d < DISTANCES; d++)
                    for (int i = 0; i < 100; i++)
                        meet_pair(scene, &pairs[p], gaps[g], distances[d], i % 4 == 0, &count);
                if (count.caught > 0 || count.repaired > 0)
                    printf("# %s, gap %g: of %lu rays %lu caught, %lu caught by the repair; %lu met the second sheet\n",
                           pairs[p].what, gaps[g], count.left, count.caught, count.repaired, count.second);
                all.left += count.left;
                all.caught += count.caught;
                all.repaired += count.repaired;
                all.second += count.second;
                render_scene_free(scene);
                builder_release(&b);
            }
    printf("# %lu rays, of %lu that met the second sheet\n", all.left, LEAVE * all.second);
    assert_true(all.second > 1000);
    figure_within("rays that a pair of faces catches", (double)all.caught, 0, (double)all.left * 1e-5, "share 1e-5");
    figure_within("rays that a pair of faces catches when they are traced again", (double)all.repaired, 0,
                  (double)all.left * 1e-5, "share 1e-5");
}

/* ---- a card over a floor ---------------------------------------------------------------------- */

/* The card's half side is 1 m, the height in metres. From `distance` away Embree cannot tell them apart. */
/* Which of two faces was passed is uncertain within so many of their distances from a rim (accel_decide.c). */
#define RIM 8.5
static const struct { double height, distance; } cards[] = {{5e-5, 100}, {3e-4, 1e3}, {3e-3, 1e4}};

static void build_card(struct scene_builder *b, double height)
{
    float vertices[VERTICES_MAX][3];
    uint32_t indices[6 * SIDE_CELLS_MAX], vertex_count = 0, triangles = 0;

    builder_init(b);
    builder_lambert(b, 1);
    add_sheet(vertices, &vertex_count, indices, &triangles, 1, -HALF, HALF, 0, 0);
    add_mesh(b, vertices, vertex_count, indices, triangles, 0);
    vertex_count = triangles = 0;
    add_sheet(vertices, &vertex_count, indices, &triangles, 1, -1, 1, height, 0);
    add_mesh(b, vertices, vertex_count, indices, triangles, 0);
    builder_environment_constant(b, vec3_splat(1));
    builder_camera(b, vec3_make(20, 20, 20), vec3_splat(0), 0.5f);
}

/* Where the line is in the sheets' coordinates when it is `height` over the floor. */
static void at_height(const struct ray *ray, double height, double out[3])
{
    double from[3], direction[3], a[3] = {0, 0, 0}, d[3] = {0, 0, 0};

    exact_origin(ray, from);
    exact_vec(ray->direction, direction);
    for (int k = 0; k < 3; k++)
        for (int r = 0; r < 3; r++) {
            a[k] += turn[r][k] * from[r];
            d[k] += turn[r][k] * direction[r];
        }
    for (int k = 0; k < 3; k++)
        out[k] = a[k] + (height - a[2]) / d[2] * d[k];
}

/* A ray that passes below the card's rim, and clear of it by what counts as passed (8 heights), meets the
 * floor there, and what leaves it upwards the card. */
static void look_under(const struct render_scene *scene, double height, double distance, struct count *count)
{
    const double inside = 20 * height, slope = height / inside * number(0.3, 0.6), y = number(-0.9, 0.9);
    const double to[3] = {1 - inside, y, 0}, from[3] = {to[0] + distance, y, distance * slope};
    struct ray ray = ray_between(from, to), next;
    struct path_query query = {NULL, 0};
    double rim[3], at[3];
    struct surface s;
    struct hit hit;

    at_height(&ray, height, rim);
    if (!accel_intersect(scene->accel, &ray, &query, &hit) || hit.instance != 0 || !(rim[0] > 1 + RIM * height))
        return;
    surface_from_hit(scene, &ray, &hit, &s);
    surface_leave(&s, any_direction(s.ng), &next);
    at_height(&next, height, at);
    if (!(fabs(at[0]) < 1 - height && fabs(at[1]) < 1 - height))
        return;
    count->left++;
    count->caught += accel_intersect(scene->accel, &next, &query, &hit) && accel_occluded(scene->accel, &next, &query);
}

static void a_card_keeps_its_shadow(void **state)
{
    struct render_settings settings = builder_settings(8, 8, 4);

    (void)state;
    for (unsigned c = 0; c < sizeof cards / sizeof *cards; c++)
        for (unsigned t = 0; t < 3; t++) {
            struct scene_builder b;
            struct render_scene *scene;
            struct count count = {0};
            char what[96];
            choose_turn(t);
            build_card(&b, cards[c].height);
            scene = builder_build(&b, &settings);
            for (int i = 0; i < 2000; i++)
                look_under(scene, cards[c].height, cards[c].distance, &count);
            assert_true(count.left > 200);
            snprintf(what, sizeof what, "rays of %lu that pass a card %g m above", count.left, cards[c].height);
            figure_within(what, (double)(count.left - count.caught), 0, 0, "exact");
            render_scene_free(scene);
            builder_release(&b);
        }
}

/* ---- pictures --------------------------------------------------------------------------------- */

enum { COMPARISONS = 64 };

static void a_pair_sends_out_what_arrives(void **state)
{
    const struct render_settings settings = builder_settings(16, 16, 16);
    static const double close[] = {0, 1e-8, 1e-7, 4e-7};

    (void)state;
    for (unsigned p = 0; p < sizeof pairs / sizeof *pairs; p++)
        for (unsigned g = 0; g < sizeof close / sizeof *close; g++)
            for (unsigned t = 0; t < 2; t++) {
                struct scene_builder b;
                char what[96];
                choose_turn(t);
                build_pair(&b, &pairs[p], close[g], 10);
                snprintf(what, sizeof what, "%s, gap %g%s, in a furnace", pairs[p].what, close[g], t ? ", turned" : "");
                radiance_figure(&b, &settings, COMPARISONS, 1, 1, what);
                builder_release(&b);
            }
}

/* A black layer that lets half of the light through, so close that Embree cannot tell: it does so twice. */
static void a_veil_shades_what_is_behind(void **state)
{
    const struct render_settings settings = builder_settings(16, 16, 16);
    struct scene_material *veil;
    struct scene_builder b;

    (void)state;
    choose_turn(0);
    build_pair(&b, &pairs[0], 5e-5, 100);
    veil = builder_lambert(&b, 0);
    veil->alpha_mode = ALPHA_BLEND;
    veil->base_color[3] = 0.5f;
    b.scene.instances[1].material = builder_last_material(&b);
    radiance_figure(&b, &settings, COMPARISONS, 1, 0.25, "a veil of one half before a white wall");
    builder_release(&b);
}

static void render_pair(const struct pair *p, int both, double *mean)
{
    const struct render_settings settings = builder_settings(16, 16, 16);
    struct render_stats stats = {0};
    struct render_scene *scene;
    struct scene_builder b;

    build_pair(&b, p, 0, 10);
    b.scene.instance_count -= !both;
    scene = builder_build(&b, &settings);
    builder_render(scene, &settings, 0, mean, NULL, &stats);
    render_scene_free(scene);
    builder_release(&b);
}

/* What is printed of one picture of a white wall may well be 1.0006: that is its noise. */
static void an_exact_copy_changes_no_bit(void **state)
{
    static double one[16 * 16 * 3], two[16 * 16 * 3];
    unsigned apart = 0;

    (void)state;
    choose_turn(1);
    render_pair(&pairs[0], 0, one);
    render_pair(&pairs[0], 1, two);
    for (int i = 0; i < 16 * 16 * 3; i++)
        apart += one[i] != two[i];
    figure_within("numbers that an exact copy changes", apart, 0, 0, "exact");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rays_leave_a_pair),
        cmocka_unit_test(a_card_keeps_its_shadow),
        cmocka_unit_test(a_pair_sends_out_what_arrives),
        cmocka_unit_test(a_veil_shades_what_is_behind),
        cmocka_unit_test(an_exact_copy_changes_no_bit),
    };

    return cmocka_run_group_tests_name("pairs of faces", tests, NULL, NULL);
}
