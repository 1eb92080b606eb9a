/* What every output variable of the renderer says, against closed forms: a plane seen from above
 * by a tilted camera, and squares that move. Their way into layers of a file is test_store's. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "tests/support/imported.h"

enum {
    SIDE = 16, /* one tile */
    PIXELS = SIDE * SIDE,
    SPP = 4,
    EVERY = 1 << AOV_DEPTH | 1 << AOV_NORMAL | 1 << AOV_ALBEDO | 1 << AOV_POSITION | 1 << AOV_UV | 1 << AOV_OBJECT_ID |
            1 << AOV_MATERIAL_ID | 1 << AOV_MOTION,
};
#define FILTER_RADIUS 1.5f /* pixels */

/* One tile's variables, means divided. */
struct variables {
    float depth, normal[3], albedo[3], position[3], uv[2], object, material, motion[2];
};
_Static_assert(sizeof(struct variables) == 16 * sizeof(float), "those of the enum, in its order");

static void look(struct import_result *import, struct variables out[PIXELS])
{
    struct render_settings settings = imported_settings(SIDE, SIDE, SPP);
    float sums[TILE_FLOATS_MAX], *to = (float *)out;
    struct render_stats stats = {0};
    struct render_scene *scene;

    settings.aovs = EVERY;
    scene = imported_build(import, &settings, 0);
    memset(out, 0, PIXELS * sizeof *out);
    for (uint32_t unit = 0; unit < GROUPS * pass_count(SPP, 0); unit++) {
        uint32_t group = unit % GROUPS, pass = unit / GROUPS;
        uint32_t sent = unit_aovs(EVERY, group, pass);
        size_t at = 0;
        if (pass >= pass_count(SPP, group))
            continue;
        assert_int_equal(render_tile(scene, 0, 0, group, pass, sums, NULL, &stats),
                         PIXELS * (PIXEL_FLOATS + aov_floats(sent)));
        for (int aov = 0; aov < AOV_COUNT; aov++) {
            uint32_t n = EVERY >> aov & 1 ? aov_channels((enum aov)aov) : 0;
            const float *from = sums + tile_aov_offset(PIXELS, sent, (enum aov)aov);
            for (uint32_t c = 0; c < n; c++, at++)
                for (size_t i = 0; sent >> aov & 1 && i < PIXELS; i++)
                    to[i * 16 + at] += from[i * n + c] / (aov_is_point((enum aov)aov) ? 1 : SPP);
        }
        assert_int_equal(at, 16);
    }
    render_scene_free(scene);
}

static void assert_close(float got, float wanted, float tolerance) { assert_float_equal(got, wanted, tolerance); }

/* scenes/features/horizon.gltf: the plane y = 0 seen from (0, 1.5, 0), down by 0.25. */
static void test_plane(void **state)
{
    const float sine = sinf(0.25f), cosine = cosf(0.25f), half_height = tanf(0.3f);
    const float turn_sine = sinf(0.5f), turn_cosine = cosf(0.5f);
    struct variables v[PIXELS];
    struct import_result import;
    int hits = 0, misses = 0;

    (void)state;
    imported_file("scenes/features/horizon.gltf", &import);
    look(&import, v);
    import_result_release(&import);
    for (int i = 0; i < PIXELS; i++) {
        float x = v[i].position[0], y = v[i].position[1] - 1.5f, z = v[i].position[2];
        float ahead = -sine * y - cosine * z, up = cosine * y - sine * z;
        float column = (x / ahead / half_height + 1) * SIDE / 2;
        float row = (1 - up / ahead / half_height) * SIDE / 2;
        if (v[i].object == 0) {
            assert_true(v[i].depth == 0 && v[i].material == 0 && v[i].position[2] == 0);
            misses++;
            continue;
        }
        hits++;
        assert_true(v[i].object == 1 && v[i].material == 1);
        assert_close(v[i].position[1], 0, 1e-4f);
        assert_close(v[i].depth, ahead, 1e-4f * ahead);
        /* Where the filter put the pixel's first sample. */
        assert_close(column, (float)(i % SIDE) + 0.5f, FILTER_RADIUS);
        assert_close(row, (float)(i / SIDE) + 0.5f, FILTER_RADIUS);
        /* The file's quad, from -1 to 1, has (0, 3600) at (-1, 0, 1); it is turned by 0.5 rad. */
        assert_close(v[i].uv[0], ((turn_cosine * x - turn_sine * z) / 200 + 1) / 2 * 3600, 0.01f);
        assert_close(v[i].uv[1], ((turn_sine * x + turn_cosine * z) / 200 + 1) / 2 * 3600, 0.01f);
        assert_true(v[i].motion[0] == 0 && v[i].motion[1] == 0);
        if (i / SIDE < 6)
            continue; /* the means may hold samples beyond the horizon */
        assert_close(v[i].normal[0], 0, 1e-5f);
        assert_close(v[i].normal[1], 1, 1e-5f);
        assert_close(v[i].normal[2], 0, 1e-5f);
        assert_true(v[i].albedo[0] > v[i].albedo[1] && v[i].albedo[1] > v[i].albedo[2]);
    }
    assert_true(misses >= SIDE && hits >= 12 * SIDE);
}

/* Two squares side by side before the camera; the left one moves right and up while the shutter
 * is open. The right one is seen from behind. */
static const char squares[] =
    "LookAt 0 0 -5  0 0 0  0 1 0\n"
    "Camera \"perspective\" \"float fov\" 20 \"float shutteropen\" 0 \"float shutterclose\" 1\n"
    "Film \"rgb\" WorldBegin\n"
    "LightSource \"infinite\" \"rgb L\" [1 1 1]\n"
    "AttributeBegin\n"
    "Material \"diffuse\" \"rgb reflectance\" [0.8 0.4 0.2]\n"
    "ActiveTransform EndTime Translate 0.2 0.1 0 ActiveTransform All\n"
    "Shape \"trianglemesh\" \"point3 P\" [-2 -2 0  0 -2 0  0 2 0  -2 2 0]\n"
    "  \"integer indices\" [0 1 2 0 2 3] \"point2 uv\" [0 0  1 0  1 1  0 1]\n"
    "AttributeEnd\n"
    "Material \"diffuse\" \"rgb reflectance\" [0.1 0.3 0.5]\n"
    "Shape \"trianglemesh\" \"point3 P\" [0 -2 1  2 -2 1  2 2 1  0 2 1]\n"
    "  \"integer indices\" [0 2 1 0 3 2]\n";

static void test_motion_and_numbers(void **state)
{
    static const float albedos[2][3] = {{0.8f, 0.4f, 0.2f}, {0.1f, 0.3f, 0.5f}};
    const float pixels_per_metre = SIDE / (2 * 5 * tanf(0.17453293f));
    struct variables v[PIXELS];
    struct import_result import;

    (void)state;
    imported_text(squares, "squares.pbrt", NULL, &import);
    look(&import, v);
    for (int i = 0; i < PIXELS; i++) {
        int right = i % SIDE >= SIDE / 2;
        const float *albedo = albedos[right];
        if (i % SIDE >= SIDE / 2 - 3 && i % SIDE < SIDE / 2 + 6)
            continue; /* the edge, and where it moves to */
        assert_true(v[i].object == 1 + (float)right);
        assert_true(v[i].material != 0 && (v[i].material == v[right ? SIDE - 1 : 0].material));
        assert_close(v[i].depth, right ? 6 : 5, 1e-5f);
        assert_close(v[i].motion[0], right ? 0 : 0.2f * pixels_per_metre, 1e-3f);
        assert_close(v[i].motion[1], right ? 0 : -0.1f * pixels_per_metre, 1e-3f);
        assert_close(v[i].normal[2], 1, 1e-6f); /* towards the camera, in a right-handed world */
        for (int c = 0; c < 3; c++)
            assert_close(v[i].albedo[c], albedo[c], 1e-6f);
        if (!right)
            assert_true(v[i].uv[0] > 0 && v[i].uv[0] < 1);
    }
    assert_true(v[0].material != v[SIDE - 1].material);
    import_result_release(&import);
}

/* ---- what guides a denoiser ------------------------------------------------------------------ */

enum { GUIDES = AOV_FEATURES | 1 << AOV_EMISSION };
struct guides {
    float depth, albedo[3], normal[3], emission[3];
};
_Static_assert(sizeof(struct guides) == 10 * sizeof(float), "those of the enum, in its order");

/* Of all pixels, means over the samples that hold them. */
static struct guides look_for_guides(const char *text, uint32_t spp)
{
    struct render_settings settings = imported_settings(SIDE, SIDE, spp);
    float sums[TILE_FLOATS_MAX];
    double total[10] = {0}, samples[10] = {0};
    struct render_stats stats = {0};
    struct import_result import;
    struct render_scene *scene;
    struct guides out;

    imported_text(text, "guides.pbrt", NULL, &import);
    settings.aovs = GUIDES;
    settings.max_depth = 8;
    scene = imported_build(&import, &settings, 0);
    for (uint32_t group = 0; group < GROUPS; group++)
        for (uint32_t pass = 0; pass < pass_count(spp, group); pass++) {
            const uint32_t sent = unit_aovs(GUIDES, group, pass);
            uint32_t begin, end;
            size_t at = 0;
            pass_range(spp, group, pass, &begin, &end);
            assert_int_equal(sent >> AOV_DENOISING_ALBEDO & 1, begin < FEATURE_SAMPLES);
            assert_true(sent >> AOV_EMISSION & 1);
            assert_int_equal(render_tile(scene, 0, 0, group, pass, sums, NULL, &stats),
                             PIXELS * (PIXEL_FLOATS + aov_floats(sent)));
            for (int aov = 0; aov < AOV_COUNT; aov++) {
                const uint32_t n = GUIDES >> aov & 1 ? aov_channels((enum aov)aov) : 0;
                const float *from = sums + tile_aov_offset(PIXELS, sent, (enum aov)aov);
                for (uint32_t c = 0; c < n; c++, at++) {
                    samples[at] += sent >> aov & 1 ? (double)(end - begin) * PIXELS : 0;
                    for (size_t i = 0; sent >> aov & 1 && i < PIXELS; i++)
                        total[at] += (double)from[i * n + c];
                }
            }
            assert_int_equal(at, 10);
        }
    for (int i = 0; i < 10; i++)
        ((float *)&out)[i] = (float)(total[i] / samples[i]);
    render_scene_free(scene);
    import_result_release(&import);
    return out;
}

#define GUIDES_CAMERA \
    "LookAt 0 0 0  0 0 5  0 1 0\nCamera \"perspective\" \"float fov\" 20\nFilm \"rgb\" WorldBegin\n" \
    "LightSource \"point\" \"rgb I\" [1 1 1]\n"
#define GUIDES_SQUARE(z, turned) \
    "Shape \"trianglemesh\" \"point3 P\" [-9 -9 " z "  9 -9 " z "  9 9 " z "  -9 9 " z "]\n" \
    "  \"integer indices\" [" turned "]\n"
#define GUIDES_FRONT "0 2 1 0 3 2"

/* A wall straight ahead, bare; seen in a mirror; seen through a pane. Each time its own colour and normal, and what the
 * smooth surface leaves of it. */
static void test_guides_through_smooth_surfaces(void **state)
{
    static const char bare[] =
        GUIDES_CAMERA "Material \"diffuse\" \"rgb reflectance\" [0.8 0.4 0.2]\n" GUIDES_SQUARE("5", GUIDES_FRONT);
    static const char mirror[] =
        GUIDES_CAMERA "Material \"conductor\" \"rgb reflectance\" [0.5 0.5 0.5] \"float roughness\" 0\n" GUIDES_SQUARE(
            "5", GUIDES_FRONT) "Material \"diffuse\" \"rgb reflectance\" [0.8 0.4 0.2]\n" GUIDES_SQUARE("-3",
                                                                                                        "0 1 2 0 2 3");
    static const char pane[] = GUIDES_CAMERA "Material \"thindielectric\" \"float eta\" 1.5\n" GUIDES_SQUARE(
        "2", GUIDES_FRONT) "Material \"diffuse\" \"rgb reflectance\" [0.8 0.4 0.2]\n" GUIDES_SQUARE("5", GUIDES_FRONT);
    struct guides g;

    (void)state;
    g = look_for_guides(bare, 4);
    assert_close(g.albedo[0], 0.8f, 1e-4f);
    assert_close(g.albedo[2], 0.2f, 1e-4f);
    assert_close(fabsf(g.normal[2]), 1, 1e-4f);
    assert_true(g.depth > 5 && g.depth < 5.2f);
    assert_true(g.emission[0] == 0);
    g = look_for_guides(mirror, 4);
    assert_close(g.albedo[0], 0.4f, 0.01f);
    assert_close(g.albedo[1], 0.2f, 0.01f);
    assert_close(fabsf(g.normal[2]), 1, 1e-4f);
    assert_true(g.depth > 13 && g.depth < 13.6f);
    /* A pane reflects 8 % of it, where nothing is. 32 samples in 256 pixels: a standard error of 0.3 %. */
    g = look_for_guides(pane, 32);
    assert_close(g.albedo[0], 0.8f * 0.92f, 0.02f);
    assert_true(fabsf(g.normal[2]) > 0.9f && fabsf(g.normal[2]) < 1);
}

/* A lamp is emission where it is seen, in a mirror too, and none where it lights a wall; nothing is exactly nothing; of
 * many samples only the first are features. */
static void test_guides_of_lights(void **state)
{
    static const char lamp[] = GUIDES_CAMERA
        "AttributeBegin\nAreaLightSource \"diffuse\" \"rgb L\" [3 2 1]\n" GUIDES_SQUARE("5",
                                                                                        GUIDES_FRONT) "AttributeEnd\n";
    static const char mirrored[] =
        GUIDES_CAMERA "Material \"conductor\" \"rgb reflectance\" [0.5 0.5 0.5] \"float roughness\" 0\n" GUIDES_SQUARE(
            "5",
            GUIDES_FRONT) "AttributeBegin\nAreaLightSource \"diffuse\" \"rgb L\" [3 2 1]\n" GUIDES_SQUARE("-3",
                                                                                                          "0 1 2 0 2 3") "AttributeEnd\n";
    static const char lit[] = GUIDES_CAMERA "Material \"diffuse\" \"rgb reflectance\" [0.8 0.4 0.2]\n" GUIDES_SQUARE(
        "5",
        GUIDES_FRONT) "AttributeBegin\nAreaLightSource \"diffuse\" \"rgb L\" [3 2 1]\n" GUIDES_SQUARE("-3",
                                                                                                      "0 1 2 0 2 3") "AttributeEnd\n";
    static const char sky[] =
        GUIDES_CAMERA "LightSource \"infinite\" \"rgb L\" [1 2 3]\n" GUIDES_SQUARE("-3", "0 1 2 0 2 3");
    struct guides g;

    (void)state;
    g = look_for_guides(lamp, 4);
    assert_close(g.emission[0] / g.emission[2], 3, 1e-3f);
    assert_true(g.emission[0] > 0);
    g = look_for_guides(mirrored, 4);
    assert_close(g.emission[0] / g.emission[2], 3, 1e-2f);
    assert_true(g.emission[0] > 0);
    g = look_for_guides(lit, 48);
    assert_true(g.emission[0] == 0);
    assert_close(g.albedo[1], 0.4f, 1e-4f);
    g = look_for_guides(sky, 4);
    assert_true(g.albedo[0] == 0 && g.normal[2] == 0 && g.depth == 0 && g.emission[2] > g.emission[0]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_plane),
        cmocka_unit_test(test_motion_and_numbers),
        cmocka_unit_test(test_guides_through_smooth_surfaces),
        cmocka_unit_test(test_guides_of_lights),
    };
    return cmocka_run_group_tests_name("output variables", tests, NULL, NULL);
}
