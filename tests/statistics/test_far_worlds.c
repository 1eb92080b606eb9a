/* A scene far from its file's origin: rebased in double at import, it gives the same bits as at the
 * origin wherever the file's digits allow (the shifts here are sums of powers of two, and so are
 * the coordinates). What is lost is said. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <jansson.h>

#include "tests/support/figure.h"
#include "tests/support/gltf_maker.h"
#include "tests/support/imported.h"

enum { WIDTH = 32, HEIGHT = 24, PIXELS = WIDTH * HEIGHT * 3 };

static const double shifts[][3] = {
    {0, 0, 0},
    {1024, -2048, 512},
    {500000, 0.25, -4649776},
    {1e9, 1e9, -1e9},
};
enum { SHIFTS = sizeof shifts / sizeof *shifts };

static void render(struct import_result *import, float picture[PIXELS])
{
    struct render_settings settings = imported_settings(WIDTH, HEIGHT, 8);

    imported_render(import, &settings, 0, picture);
}

/* Something was seen, and `picture` is `wanted`: to the bit, or within a share of itself. */
static void assert_same(const float wanted[PIXELS], const float picture[PIXELS], const char *what, int shift,
                        float share)
{
    char words[96], level[48] = "exact";
    double sum = 0;
    int apart = 0;

    for (int i = 0; i < PIXELS; i++) {
        sum += (double)wanted[i];
        apart += !(fabsf(wanted[i] - picture[i]) <= share * fabsf(wanted[i]));
    }
    assert_true(sum > 1);
    snprintf(words, sizeof words, "%s moved by %.7g m: values that differ", what,
             fmax(fabs(shifts[shift][0]), fabs(shifts[shift][2])));
    if (share > 0)
        snprintf(level, sizeof level, "by more than %g of themselves", (double)share);
    figure_within(words, apart, 0, 0, level);
}

static void print_points(char **at, const double points[][3], int count, const double shift[3])
{
    for (int i = 0; i < count; i++)
        *at += sprintf(*at, "%.17g %.17g %.17g ", points[i][0] + shift[0], points[i][1] + shift[1],
                       points[i][2] + shift[2]);
}

/* A ground and a wall that share an edge, in two shapes; the vertices, the camera, the light and a
 * fog's box are all given in the world. */
static void pbrt_text(char *text, const double shift[3], int in_matrix)
{
    static const double ground[4][3] = {{-2, 0, -2}, {2, 0, -2}, {2, 0, 2}, {-2, 0, 2}};
    static const double wall[4][3] = {{-2, 0, -2}, {2, 0, -2}, {2, 1.5, -2}, {-2, 1.5, -2}};
    static const double view[2][3] = {{0.25, 1, 4}, {0, 0.5, 0}}, lamp[1][3] = {{1, 3, 1}};
    static const double nowhere[3] = {0, 0, 0};
    const double *by = in_matrix ? nowhere : shift;

    text += sprintf(text, "Scale -1 1 1 LookAt ");
    print_points(&text, view, 2, shift);
    text += sprintf(text, "0 1 0 Camera \"perspective\" Film \"rgb\" WorldBegin ");
    if (in_matrix)
        text += sprintf(text, "Translate %.17g %.17g %.17g ", shift[0], shift[1], shift[2]);
    text += sprintf(text, "LightSource \"point\" \"rgb I\" [20 18 15] \"point3 from\" [");
    print_points(&text, lamp, 1, by);
    text += sprintf(text, "] Material \"diffuse\" Shape \"trianglemesh\" \"integer indices\" "
                          "[0 2 1 0 3 2] \"point3 P\" [");
    print_points(&text, ground, 4, by);
    text += sprintf(text, "] Shape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3] "
                          "\"point3 P\" [");
    print_points(&text, wall, 4, by);
    sprintf(text, "]\n");
}

/* LookAt's matrix is inverted, which at 1e9 costs the camera 1e-7 m. */
static void pbrt_shifts(int in_matrix)
{
    float first[PIXELS], picture[PIXELS];

    for (int i = 0; i < SHIFTS; i++) {
        struct import_result import;
        char text[2048];
        pbrt_text(text, shifts[i], in_matrix);
        imported_text(text, "far.pbrt", NULL, &import);
        for (int c = 0; c < 3; c++)
            assert_true(fabs(import.scene.origin[c] - shifts[i][c]) < 2);
        render(&import, i ? picture : first);
        if (i)
            assert_same(first, picture, in_matrix ? "matrices" : "vertices", i, i < SHIFTS - 1 ? 0 : 1e-4f);
        import_result_release(&import);
    }
}

static void test_vertices(void **state)
{
    (void)state;
    pbrt_shifts(0);
}

static void test_matrices(void **state)
{
    (void)state;
    pbrt_shifts(1);
}

/* The camera is one that we choose, and the light one that we add. */
static void test_obj(void **state)
{
    static const double corners[5][3] = {
        {0, 0, 0}, {1, 0, 0}, {1, 0, 1}, {0, 0, 1}, {0.5, 0.75, 0.5}};
    float first[PIXELS], picture[PIXELS];
    int rounded = 0;

    (void)state;
    for (int i = 0; i < SHIFTS; i++) {
        struct import_options options = IMPORT_OPTIONS_DEFAULT;
        struct import_result import;
        struct error err = {0};
        char text[1024], *at = text;
        status failed;
        for (int v = 0; v < 5; v++)
            at += sprintf(at, "v %.17g %.17g %.17g\n", corners[v][0] + shifts[i][0], corners[v][1] + shifts[i][1],
                          corners[v][2] + shifts[i][2]);
        sprintf(at, "f 1 2 3 4\nf 1 5 2\nf 2 5 3\nf 3 5 4\nf 4 5 1\n");
        /* An import without any triangle left fails. */
        failed = import_scene_memory(text, strlen(text), "far.obj", NULL, &options, &import, &err);
        figure_within("triangles lost of an OBJ file far off", failed ? 6 : (double)import.degenerate_triangles, 0, 0,
                      "exact");
        render(&import, i ? picture : first);
        if (i)
            assert_same(first, picture, "an OBJ file", i, 0);
        rounded += warned(&import, "steps");
        import_result_release(&import);
    }
    assert_int_equal(rounded, 0);
}

/* Hang the scene's nodes on one that is moved. */
static char *moved_gltf(const char *path, const double shift[3])
{
    json_error_t error;
    json_t *root = json_load_file(path, 0, &error), *scene, *nodes;
    char *text;

    assert_non_null(root);
    scene = json_array_get(json_object_get(root, "scenes"), 0);
    nodes = json_object_get(root, "nodes");
    json_array_append_new(nodes, json_pack("{s:[f,f,f], s:O}", "translation", shift[0], shift[1], shift[2], "children",
                                           json_object_get(scene, "nodes")));
    json_object_set_new(scene, "nodes", json_pack("[i]", (int)json_array_size(nodes) - 1));
    text = json_dumps(root, JSON_REAL_PRECISION(17));
    json_decref(root);
    assert_non_null(text);
    return text;
}

/* Things that stand still, that move along a path, that are deformed, media and lamps: the nodes'
 * chain is in double. Not every sum of it is exact at 1e9, where a double has steps of 1.2e-7. */
static void test_gltf(void **state)
{
    static const char *const names[] = {"motion", "deformation", "lights", "nested", "absorption"};

    (void)state;
    for (size_t n = 0; n < sizeof names / sizeof *names; n++) {
        float first[PIXELS], picture[PIXELS];
        char path[128], what[128];
        snprintf(path, sizeof path, "scenes/features/%s.gltf", names[n]);
        for (int i = 0; i < SHIFTS; i++) {
            char *text = moved_gltf(path, shifts[i]);
            struct import_result import;
            int apart = 0;
            imported_text(text, path, "scenes/features", &import);
            free(text);
            render(&import, i ? picture : first);
            import_result_release(&import);
            for (int k = 0; i && k < PIXELS; k++)
                apart += fabsf(picture[k] - first[k]) > 1e-3f * (1 + fabsf(first[k]));
            snprintf(what, sizeof what, "%s.gltf below a node far off: share of values that differ", names[n]);
            figure_within(what, (double)apart / PIXELS, 0, 0.02, "by more than 1e-3");
        }
    }
}

/* ---- what is lost ------------------------------------------------------------------------- */

static void import_with_square(const char *camera, double x, double z, double half, struct import_result *import)
{
    static const double nowhere[3] = {0, 0, 0};
    const double square[4][3] = {
        {x - half, 0.5 - half, z}, {x + half, 0.5 - half, z}, {x + half, 0.5 + half, z}, {x - half, 0.5 + half, z}};
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct error err = {0};
    char whole[2048], text[4096], *at;

    pbrt_text(whole, nowhere, 0);
    if (camera)
        snprintf(text, sizeof text, "Scale -1 1 1 LookAt .25 .5 4 0 .5 0 0 1 0 Camera %s %s", camera,
                 strstr(whole, "Film"));
    else
        strcpy(text, whole);
    at = text + strlen(text);
    at += sprintf(at, "Shape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3] \"point3 P\" [");
    print_points(&at, square, 4, nowhere);
    sprintf(at, "]\n");
    if (import_scene_memory(text, strlen(text), "wide.pbrt", NULL, &options, import, &err))
        fail_msg("%s", err.text);
}

/* Two things a thousand kilometres apart: a view of one needs no digits of the other (test_near_and_far). */
static void test_wide_world(void **state)
{
    struct import_result import;

    (void)state;
    import_with_square(NULL, 1e6, -2, 1, &import);
    assert_int_equal(import.warning_count, 0);
    assert_true(import.position_spacing_m == 0.03125);
    import_result_release(&import);
}

/* A hundredth of a degree shows a wall 6 m off and a chip half a metre away: no origin has digits for both. An
 * ordinary lens shows neither so large. */
static void test_near_and_far_at_once(void **state)
{
    struct import_result import;

    (void)state;
    import_with_square("\"perspective\" \"float fov\" .01", 0.21875, 3.5, 1e-5, &import);
    assert_warned(&import, "sees things near by and others");
    import_result_release(&import);
    import_with_square("\"perspective\" \"float fov\" 40", 0.21875, 3.5, 0.125, &import);
    assert_int_equal(import.warning_count, 0);
    import_result_release(&import);
}

/* Floats of a file that lie far from their mesh's origin have lost their digits before we see them. */
static void test_coarse_file(void **state)
{
    struct maker m = {0};
    struct import_result import;
    static const float corners[9] = {4e6f, 0, 0, 4000001.5f, 0, 0, 4e6f, 2, 0};

    (void)state;
    put_floats(&m, "VEC3", corners, 9, 3);
    maker_import(&m, "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0,\"name\":\"hut\"}]," ONE_TRIANGLE, &import);
    assert_warned(&import, "\"hut\": the file gives its positions in steps of");
    import_result_release(&import);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_vertices),   cmocka_unit_test(test_matrices),
        cmocka_unit_test(test_obj),        cmocka_unit_test(test_gltf),
        cmocka_unit_test(test_wide_world), cmocka_unit_test(test_coarse_file),
        cmocka_unit_test(test_near_and_far_at_once),
    };

    return cmocka_run_group_tests_name("far worlds", tests, NULL, NULL);
}
