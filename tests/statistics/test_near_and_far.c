/* What the camera sees near by does not depend on what else is in the scene: backdrops, far lamps, skyboxes,
 * terrains that reach to one side of it. Each picture is compared with that of the same scene without the
 * far thing, pixel by pixel and in blocks of 8x8.
 *
 *   test_near_and_far [--scene METRES]     print the pbrt scene with a card at this distance
 *
 * Family-wise significance 1e-4, Sidak-corrected over all blocks; seeds are fixed. With the same seed samples
 * take the same random numbers, so where only rounding differs nearly all pixels are equal. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "common/base/buffer.h"
#include "tests/support/figure.h"
#include "tests/support/imported.h"
#include "tests/support/groups.h"
#include "tests/support/statistics.h"

enum { SIDE = 48, BLOCK = 8, ACROSS = SIDE / BLOCK, VALUES = SIDE * SIDE * 3, SPP = 16 };
enum { BLOCKS = ACROSS * ACROSS, PICTURES_MAX = 100 };

static uint32_t settings_depth = 3;
static float settings_shutter = 0;

struct picture {
    double mean[VALUES], variance[VALUES];
};

/* ---- a scene's text --------------------------------------------------------------------------- */

/* One triangle mesh while it is written: pbrt wants the indices first. */
struct shape_text {
    struct buffer points, indices;
    int count;
};

static void shape_corners(struct shape_text *s, const double corner[4][3])
{
    for (int k = 0; k < 4; k++)
        buffer_printf(&s->points, "%.17g %.17g %.17g ", corner[k][0], corner[k][1], corner[k][2]);
    buffer_printf(&s->indices, "%d %d %d %d %d %d ", s->count, s->count + 1, s->count + 2, s->count, s->count + 2,
                  s->count + 3);
    s->count += 4;
}

static void shape_quad(struct shape_text *s, const double a[3], const double u[3], const double v[3])
{
    double corner[4][3];

    for (int k = 0; k < 4; k++)
        for (int c = 0; c < 3; c++)
            corner[k][c] = a[c] + (k == 1 || k == 2 ? u[c] : 0) + (k > 1 ? v[c] : 0);
    shape_corners(s, corner);
}

/* All sides but the bottom. */
static void shape_box(struct shape_text *s, const double low[3], const double high[3])
{
    const double dx = high[0] - low[0], dy = high[1] - low[1], dz = high[2] - low[2];

    shape_quad(s, (double[]){low[0], high[1], low[2]}, (double[]){0, 0, dz}, (double[]){dx, 0, 0});
    shape_quad(s, (double[]){low[0], low[1], low[2]}, (double[]){0, dy, 0}, (double[]){dx, 0, 0});
    shape_quad(s, (double[]){low[0], low[1], high[2]}, (double[]){dx, 0, 0}, (double[]){0, dy, 0});
    shape_quad(s, (double[]){low[0], low[1], low[2]}, (double[]){0, 0, dz}, (double[]){0, dy, 0});
    shape_quad(s, (double[]){high[0], low[1], low[2]}, (double[]){0, dy, 0}, (double[]){0, 0, dz});
}

static void shape_end(struct shape_text *s, struct buffer *text)
{
    buffer_printf(text, "Shape \"trianglemesh\" \"integer indices\" [%s] \"point3 P\" [%s]\n", buffer_text(&s->indices),
                  buffer_text(&s->points));
    buffer_release(&s->points);
    buffer_release(&s->indices);
    s->count = 0;
}

static void shape_begin(struct shape_text *s)
{
    buffer_init(&s->points);
    buffer_init(&s->indices);
    s->count = 0;
}

enum lighting { SUN, SKY, LAMPS, SKY_AND_LAMPS, LIGHTINGS, DARK };
static const char *const lighting_names[] = {"sun", "sky", "near lamps", "sky and near lamps"};

/* Of the camera, from the model; floats hold it up to 65 km from the origin. */
static const double eye_from[3] = {0.40625, 0.453125, 0.703125};

static void begin(struct buffer *text, enum lighting lighting, const double at[3])
{
    buffer_printf(text,
                  "Scale -1 1 1 LookAt %.17g %.17g %.17g %.17g %.17g %.17g 0 1 0 Camera \"perspective\" "
                  "\"float fov\" 40 Film \"rgb\" WorldBegin ",
                  at[0] + eye_from[0], at[1] + eye_from[1], at[2] + eye_from[2], at[0], at[1], at[2]);
    if (lighting == SUN)
        buffer_puts(text, "LightSource \"distant\" \"rgb L\" [3 3 3] \"point3 from\" [1 1 .3] "
                          "\"point3 to\" [0 0 0]\n");
    else if (lighting == SKY || lighting == SKY_AND_LAMPS)
        buffer_puts(text, "LightSource \"infinite\" \"rgb L\" [1 1 1]\n");
    for (int i = 0; (lighting == LAMPS || lighting == SKY_AND_LAMPS) && i < 2; i++)
        buffer_printf(text, "LightSource \"point\" \"rgb I\" [2 2 2] \"point3 from\" [%.17g %.17g %.17g]\n",
                      at[0] + (i ? -0.7 : 0.8), at[1] + 0.6, at[2] + 0.2);
    buffer_puts(text, "Material \"diffuse\" \"rgb reflectance\" [.7 .7 .7]\n");
}

/* A plate of 1.6 m with studs of 2 cm on a floor of 6 m; `beside`: and, in the same mesh, a black card so
 * far off, 0: no card. */
static void model_and(struct buffer *text, const double at[3], double beside)
{
    struct shape_text s;

    shape_begin(&s);
    shape_quad(&s, (double[]){at[0] - 3, at[1] - 0.04, at[2] - 3}, (double[]){0, 0, 6}, (double[]){6, 0, 0});
    shape_end(&s, text);
    shape_begin(&s);
    shape_box(&s, (double[]){at[0] - 0.8, at[1] - 0.04, at[2] - 0.8}, (double[]){at[0] + 0.8, at[1], at[2] + 0.8});
    for (int i = -10; i < 10; i++)
        for (int k = -10; k < 10; k++) {
            const double low[3] = {at[0] + 0.04 * i + 0.01, at[1], at[2] + 0.04 * k + 0.01};
            shape_box(&s, low, (double[]){low[0] + 0.02, low[1] + 0.02, low[2] + 0.02});
        }
    if (beside > 0)
        shape_quad(&s, (double[]){beside, -0.1 * beside, -0.05 * beside}, (double[]){0, 0, 0.1 * beside},
                   (double[]){0, 0.1 * beside, 0});
    shape_end(&s, text);
}

static void model(struct buffer *text, const double at[3]) { model_and(text, at, 0); }

/* An octahedron of triangles, each cut into 16 by 16, on a sphere. */
static void skybox(struct buffer *text, double radius)
{
    enum { CUTS = 16 };
    struct shape_text s;

    buffer_puts(text, "AttributeBegin Material \"diffuse\" \"rgb reflectance\" [0 0 0] "
                      "AreaLightSource \"diffuse\" \"rgb L\" [1 1 1] \"bool twosided\" true\n");
    shape_begin(&s);
    for (int i = 0; i < CUTS; i++)
        for (int k = 0; k < 2 * CUTS; k++) {
            double corner[4][3];
            for (int c = 0; c < 4; c++) {
                double polar = M_PI * (i + (c == 1 || c == 2)) / CUTS, turn = M_PI * (k + (c > 1)) / CUTS;
                corner[c][0] = radius * sin(polar) * cos(turn);
                corner[c][1] = radius * cos(polar);
                corner[c][2] = radius * sin(polar) * sin(turn);
            }
            shape_corners(&s, corner);
        }
    shape_end(&s, text);
    buffer_puts(text, "AttributeEnd\n");
}

/* A card of distance / 10 at `distance` to one side, `low` or just above the floor's plane. */
static void card(struct buffer *text, double distance, const char *material, double low)
{
    struct shape_text s;

    buffer_printf(text, "AttributeBegin %s\n", material);
    shape_begin(&s);
    shape_quad(&s, (double[]){distance, low * distance, -0.05 * distance}, (double[]){0, 0, 0.1 * distance},
               (double[]){0, 0.1 * distance, 0});
    shape_end(&s, text);
    buffer_puts(text, "AttributeEnd\n");
}

/* ---- pictures --------------------------------------------------------------------------------- */

/* Takes the text over. */
static void import_text(struct buffer *text, const char *name, struct import_result *import)
{
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct error err = {0};

    if (import_scene_memory(buffer_text(text), strlen(buffer_text(text)), name, NULL, &options, import, &err) !=
        STATUS_OK)
        fail_msg("%s", err.text);
    buffer_release(text);
}

static void render_frame(struct import_result *import, uint32_t frame, struct picture *out)
{
    struct render_settings settings = imported_settings(SIDE, SIDE, SPP);
    struct render_stats stats = {0};
    struct render_scene *scene;

    settings.max_depth = settings_depth;
    settings.fps = 1;
    settings.shutter = settings_shutter;
    scene = imported_build(import, &settings, frame);
    groups_render(scene, &settings, frame, out->mean, out->variance, &stats);
    render_scene_free(scene);
}

static void render(struct buffer *text, struct picture *out)
{
    struct import_result import;

    import_text(text, "near.pbrt", &import);
    render_frame(&import, 0, out);
    import_result_release(&import);
}

static double luminance(const double *rgb) { return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]; }

/* The largest z of a block, with four standard errors of a pixel as the least of any: a block in which no
 * sample differs has no variance. */
static double worst_block(const struct picture *a, const struct picture *b, double *deviation)
{
    double worst = 0;

    *deviation = 0;
    for (size_t block = 0; block < BLOCKS; block++) {
        double difference = 0, variance = 0, sum = 0;
        for (size_t i = 0; i < BLOCK * BLOCK; i++) {
            size_t x = block % ACROSS * BLOCK + i % BLOCK, y = block / ACROSS * BLOCK + i / BLOCK;
            size_t at = 3 * (y * SIDE + x);
            sum += a->mean[at];
            difference += b->mean[at] - a->mean[at];
            variance += a->variance[at] + b->variance[at];
        }
        variance += 4e-8 * sum * sum;
        worst = fmax(worst, fabs(difference) / sqrt(variance + 1e-30));
        *deviation = fmax(*deviation, fabs(difference) / (sum + 1e-30));
    }
    return worst;
}

static double pixels_off(const struct picture *a, const struct picture *b, double by)
{
    int off = 0;

    for (size_t i = 0; i < SIDE * SIDE; i++) {
        double x = luminance(&a->mean[3 * i]), y = luminance(&b->mean[3 * i]);
        off += !(fabs(x - y) <= by * fmax(x, 1e-3));
    }
    return (double)off / (SIDE * SIDE);
}

static void compare(const char *what, const struct picture *wanted, const struct picture *got, double share)
{
    double z_max = normal_quantile(1 - sidak_alpha(1e-4, BLOCKS * PICTURES_MAX) / 2), deviation, z;
    char words[160];

    z = worst_block(wanted, got, &deviation);
    printf("# %s: pixels off by > 10 %%: %.2f %%, worst block %.2f %%, z %.1f\n", what,
           100 * pixels_off(wanted, got, 0.1), 100 * deviation, z);
    snprintf(words, sizeof words, "%s: z of the worst block", what);
    figure_within(words, z, 0, z_max, "significance 1e-4 over 3,600 blocks");
    snprintf(words, sizeof words, "%s: share of pixels off by more than a tenth", what);
    if (share >= 0)
        figure_within(words, pixels_off(wanted, got, 0.1), 0, share, "same seed");
}

static const double here[3] = {0, 0, 0};

/* ---- backdrops ------------------------------------------------------------------------------------ */

static void test_card(void **state)
{
    static struct picture wanted, got;

    (void)state;
    for (int lighting = 0; lighting < LIGHTINGS; lighting++) {
        struct buffer text = BUFFER_INIT;
        begin(&text, (enum lighting)lighting, here);
        model(&text, here);
        render(&text, &wanted);
        for (double distance = 100; distance < 2e9; distance *= 10) {
            char what[96];
            begin(&text, (enum lighting)lighting, here);
            model(&text, here);
            card(&text, distance, "Material \"diffuse\" \"rgb reflectance\" [0 0 0]", -0.1);
            snprintf(what, sizeof what, "%s, card at %g m", lighting_names[lighting], distance);
            render(&text, &got);
            compare(what, &wanted, &got, 0.005);
        }
    }
}

/* The card is part of the model's mesh. */
static void test_one_mesh(void **state)
{
    static struct picture wanted, got;
    struct buffer text = BUFFER_INIT;

    (void)state;
    begin(&text, SUN, here);
    model(&text, here);
    render(&text, &wanted);
    for (double distance = 100; distance < 2e9; distance *= 10) {
        char what[96];
        begin(&text, SUN, here);
        model_and(&text, here, distance);
        snprintf(what, sizeof what, "sun, one mesh with a card at %g m", distance);
        render(&text, &got);
        compare(what, &wanted, &got, 0.005);
    }
}

/* A lamp of 1e-4 sr and irradiance 1. */
static void lamp(struct buffer *text, double distance)
{
    const double cosine = 1 / sqrt(1.25), radiance = 1.25 / 1e-4 / cosine;
    struct shape_text s;

    buffer_printf(text, "AttributeBegin AreaLightSource \"diffuse\" \"rgb L\" [%.9g %.9g %.9g] "
                        "\"bool twosided\" true\n", radiance, radiance, radiance);
    shape_begin(&s);
    shape_quad(&s, (double[]){distance, 0.495 * distance, -0.005 * distance}, (double[]){0, 0, 0.01 * distance},
               (double[]){0, 0.01 * distance, 0});
    shape_end(&s, text);
    buffer_puts(text, "AttributeEnd\n");
}

/* A lamp far off is a sun of the same irradiance but for its penumbra, however far. */
static void test_far_lamp(void **state)
{
    static struct picture sun, wanted, got;
    struct buffer text = BUFFER_INIT;
    double deviation;

    (void)state;
    begin(&text, DARK, here);
    buffer_puts(&text, "LightSource \"distant\" \"rgb L\" [1 1 1] \"point3 from\" [1 .5 0] \"point3 to\" [0 0 0]\n");
    model(&text, here);
    render(&text, &sun);
    for (double distance = 1e4; distance < 2e9; distance *= 10) {
        char what[96];
        begin(&text, DARK, here);
        model(&text, here);
        lamp(&text, distance);
        snprintf(what, sizeof what, "lamp at %g m", distance);
        render(&text, distance > 1e4 ? &got : &wanted);
        if (distance > 1e4)
            compare(what, &wanted, &got, 0.02);
    }
    (void)worst_block(&sun, &wanted, &deviation);
    figure_within("a lamp at 10 km against a sun: largest deviation of a block", deviation, 0, 0.02,
                  "closed form but for the penumbra");
}

/* A sphere of triangles that shines inwards, against a sky of the same radiance. */
static void test_skybox(void **state)
{
    static struct picture wanted, got;
    struct buffer text = BUFFER_INIT;

    (void)state;
    begin(&text, SKY, here);
    model(&text, here);
    render(&text, &wanted);
    for (double distance = 1000; distance < 2e9; distance *= 100) {
        char what[96];
        begin(&text, DARK, here);
        model(&text, here);
        skybox(&text, distance);
        snprintf(what, sizeof what, "skybox of %g m", distance);
        render(&text, &got);
        compare(what, &wanted, &got, -1);
    }
}

/* ---- terrains -------------------------------------------------------------------------------------- */

/* A terrain around the world's origin, flat within 300 m of `flat` (at the height of the model's floor). */
static void terrain(struct buffer *text, double half, double cell, const double flat[3])
{
    const int cells = (int)(2 * half / cell);
    struct shape_text s;

    shape_begin(&s);
    for (int i = 0; i < cells; i++)
        for (int k = 0; k < cells; k++) {
            double corner[4][3];
            for (int c = 0; c < 4; c++) {
                double x = -half + cell * (i + (c > 1)), z = -half + cell * (k + (c == 1 || c == 2));
                double away = fmax(fabs(x - flat[0]), fabs(z - flat[2]));
                corner[c][0] = x;
                corner[c][1] = flat[1] - 0.05 + (away > 300 ? 0.05 * cell * sin(0.9 * x / cell + 1.7 * z / cell) - 0.06 * cell : 0);
                corner[c][2] = z;
            }
            shape_corners(&s, corner);
        }
    shape_end(&s, text);
}

/* A yard in a corner of a terrain: the picture of the yard alone. The sun alone lights both, so the terrain's own
 * light plays no part. */
static void test_terrain(void **state)
{
    static const struct { double half, cell, yard[3]; } cases[] = {
        {5000, 50, {4500, 12, 300}}, {5000, 50, {-3000, 0, 4400}}, {50000, 500, {31000, 100, -45000}}};
    static struct picture wanted, got;

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct buffer text = BUFFER_INIT;
        char what[96];
        settings_depth = 1;
        begin(&text, SUN, cases[i].yard);
        model(&text, cases[i].yard);
        render(&text, &wanted);
        begin(&text, SUN, cases[i].yard);
        model(&text, cases[i].yard);
        terrain(&text, cases[i].half, cases[i].cell, cases[i].yard);
        render(&text, &got);
        settings_depth = 3;
        snprintf(what, sizeof what, "a yard in a terrain of %g m", 2 * cases[i].half);
        compare(what, &wanted, &got, 0.005);
    }
}

/* ---- cameras --------------------------------------------------------------------------------------- */

/* The view from `away` metres that shows what the near camera would show, were it parallel. */
static void look(struct buffer *text, const double at[3], double away, const char *camera)
{
    const double way[3] = {0.4 / 0.9, 0.45 / 0.9, 0.7 / 0.9};

    buffer_printf(text, "Scale -1 1 1 LookAt %.17g %.17g %.17g %.17g %.17g %.17g 0 1 0 Camera %s Film \"rgb\" WorldBegin "
                  "LightSource \"distant\" \"rgb L\" [3 3 3] \"point3 from\" [1 1 .3] \"point3 to\" [0 0 0]\n"
                  "Material \"diffuse\" \"rgb reflectance\" [.7 .7 .7]\n",
                  at[0] + away * way[0], at[1] + away * way[1], at[2] + away * way[2], at[0], at[1], at[2], camera);
}

static void test_cameras(void **state)
{
    static const struct { const char *name, *camera; double away; } cases[] = {
        {"a lens of 1 degree", "\"perspective\" \"float fov\" 1", 40},
        {"a lens of .03 degrees", "\"perspective\" \"float fov\" .03", 1400},
        {"an orthographic camera", "\"orthographic\" \"float screenwindow\" [-.4 .4 -.4 .4]", 5},
        {"an orthographic camera far off", "\"orthographic\" \"float screenwindow\" [-.4 .4 -.4 .4]", 2000},
        {"a panorama", "\"spherical\" \"string mapping\" \"equirectangular\"", 0.4},
    };
    static struct picture wanted, got;

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        for (double distance = 1e4; distance < 2e9; distance *= 100) {
            struct buffer text = BUFFER_INIT;
            char what[96];
            look(&text, here, cases[i].away, cases[i].camera);
            model(&text, here);
            render(&text, &wanted);
            look(&text, here, cases[i].away, cases[i].camera);
            model(&text, here);
            card(&text, distance, "Material \"diffuse\" \"rgb reflectance\" [0 0 0]", -0.2);
            render(&text, &got);
            snprintf(what, sizeof what, "%s, card at %g m", cases[i].name, distance);
            compare(what, &wanted, &got, 0.005);
        }
}

/* ---- a camera that travels ------------------------------------------------------------------------- */

enum { STOPS = 3 };
static const double stops[STOPS][3] = {{-49152, 12, 300}, {0, 0, 0}, {49152, -7, -45056}};

/* A unit quaternion x y z w of a rotation whose trace is positive. */
static void quaternion_of(const struct transform_d *m, double out[4])
{
    double w = sqrt(1 + m->m[0][0] + m->m[1][1] + m->m[2][2]) / 2;

    out[0] = (m->m[2][1] - m->m[1][2]) / (4 * w);
    out[1] = (m->m[0][2] - m->m[2][0]) / (4 * w);
    out[2] = (m->m[1][0] - m->m[0][1]) / (4 * w);
    out[3] = w;
}

/* What `follows` says follows a node that is at `places[k]` + `from` at k seconds, turned as it is. */
static void travel(struct import_result *import, int32_t *follows, const struct transform_d *turned,
                   const double places[STOPS][3], const double from[3], enum scene_interpolation way)
{
    static struct scene_node node;
    static struct scene_channel channel;
    static float times[STOPS], values[STOPS][3];
    struct scene *scene = &import->scene;

    scene_node_default(&node);
    quaternion_of(turned, node.rotation);
    for (int k = 0; k < STOPS; k++) {
        times[k] = (float)k;
        for (int c = 0; c < 3; c++)
            values[k][c] = (float)(places[k][c] + from[c]);
    }
    channel = (struct scene_channel){0, PATH_TRANSLATION, way, STOPS, 3, times, values[0]};
    scene->nodes = &node;
    scene->node_count = 1;
    scene->channels = &channel;
    scene->channel_count = 1;
    *follows = 0;
}

/* Three yards on 100 km of terrain: each frame shows one as if it were alone. */
static void test_travel(void **state)
{
    static struct picture wanted, got;
    struct import_result all;
    struct buffer text = BUFFER_INIT;

    (void)state;
    settings_depth = 1;
    begin(&text, SUN, stops[0]);
    for (int k = 0; k < STOPS; k++)
        model(&text, stops[k]);
    terrain(&text, 50000, 1000, stops[1]);
    import_text(&text, "near.pbrt", &all);
    for (uint32_t k = 0; k < STOPS; k++) {
        struct import_result alone;
        char what[96];
        begin(&text, SUN, stops[k]);
        model(&text, stops[k]);
        import_text(&text, "near.pbrt", &alone);
        travel(&alone, &alone.scene.cameras[0].node, &alone.scene.cameras[0].to_world, stops, eye_from,
               INTERPOLATE_STEP);
        render_frame(&alone, k, &wanted);
        travel(&all, &all.scene.cameras[0].node, &all.scene.cameras[0].to_world, stops, eye_from, INTERPOLATE_STEP);
        render_frame(&all, k, &got);
        snprintf(what, sizeof what, "a camera on its way, frame %u", k);
        compare(what, &wanted, &got, 0.005);
        import_result_release(&alone);
    }
    import_result_release(&all);
    settings_depth = 3;
}

/* The model moves by 4 cm a second while the shutter is open. */
static void test_motion(void **state)
{
    static const double places[STOPS][3] = {{0, 0, 0}, {0.03125, 0, 0.03125}, {0.0625, 0, 0}};
    static struct picture wanted, got;

    (void)state;
    settings_shutter = 1;
    for (double distance = 10; distance < 2e9; distance *= 100) {
        struct buffer text = BUFFER_INIT;
        struct import_result import;
        const struct transform_d still = transform_d_identity();
        char what[96];
        begin(&text, SUN, here);
        model(&text, here);
        if (distance > 10)
            card(&text, distance, "Material \"diffuse\" \"rgb reflectance\" [0 0 0]", -0.1);
        import_text(&text, "near.pbrt", &import);
        travel(&import, &import.scene.instances[1].node, &still, places, here, INTERPOLATE_LINEAR);
        render_frame(&import, 1, distance > 10 ? &got : &wanted);
        import_result_release(&import);
        snprintf(what, sizeof what, "a model that moves, card at %g m", distance);
        if (distance > 10)
            compare(what, &wanted, &got, 0.005);
    }
    settings_shutter = 0;
}

/* ---- other near things ----------------------------------------------------------------------------- */

/* A box of 1 m on a floor of 6 m, and a glass ball's worth of water in a tumbler. */
static void box_on_floor(struct buffer *text, const double at[3])
{
    struct shape_text s;

    shape_begin(&s);
    shape_quad(&s, (double[]){at[0] - 3, at[1], at[2] - 3}, (double[]){0, 0, 6}, (double[]){6, 0, 0});
    shape_end(&s, text);
    shape_begin(&s);
    shape_box(&s, (double[]){at[0] - 0.5, at[1], at[2] - 0.5}, (double[]){at[0] + 0.5, at[1] + 1, at[2] + 0.5});
    shape_end(&s, text);
}

static void far_box(struct buffer *text, const double at[3])
{
    buffer_printf(text, "Scale -1 1 1 LookAt %.17g %.17g %.17g %.17g %.17g %.17g 0 1 0 Camera \"perspective\" "
                  "\"float fov\" 50 Film \"rgb\" WorldBegin LightSource \"distant\" \"rgb L\" [3 3 3] \"point3 from\" [1 1 .3] "
                  "\"point3 to\" [0 0 0] LightSource \"infinite\" \"rgb L\" [.3 .3 .3]\n"
                  "Material \"diffuse\" \"rgb reflectance\" [.7 .7 .7]\n",
                  at[0] + 2, at[1] + 2.5, at[2] + 3, at[0], at[1], at[2]);
    box_on_floor(text, at);
}

static void test_box(void **state)
{
    static struct picture wanted, got;
    struct buffer text = BUFFER_INIT;

    (void)state;
    far_box(&text, here);
    render(&text, &wanted);
    for (double distance = 100; distance < 2e9; distance *= 10) {
        char what[96];
        far_box(&text, here);
        card(&text, distance, "Material \"diffuse\" \"rgb reflectance\" [0 0 0]", -0.1);
        snprintf(what, sizeof what, "a box of 1 m, card at %g m", distance);
        render(&text, &got);
        compare(what, &wanted, &got, 0.005);
    }
}

/* Many boxes by reference: Embree has a tree for the mesh, and matrices of floats. */
static void instances(struct buffer *text)
{
    enum { ACROSS_BOXES = 24, SIDES = 24 };
    struct shape_text s;

    buffer_puts(text, "ObjectBegin \"pin\"\n");
    shape_begin(&s);
    for (int i = 0; i < 12 * SIDES; i++) {
        double a = 2 * M_PI * (i % SIDES) / SIDES, b = 2 * M_PI * (i % SIDES + 1) / SIDES, low = i / SIDES / 600.0;
        shape_quad(&s, (double[]){0.01 * cos(a), low, 0.01 * sin(a)},
                   (double[]){0.01 * (cos(b) - cos(a)), 0, 0.01 * (sin(b) - sin(a))}, (double[]){0, 1 / 600.0, 0});
    }
    shape_end(&s, text);
    buffer_puts(text, "ObjectEnd\n");
    for (int i = 0; i < ACROSS_BOXES * ACROSS_BOXES; i++)
        buffer_printf(text, "AttributeBegin Translate %.17g 0 %.17g Rotate %d 0 1 0 ObjectInstance \"pin\" AttributeEnd\n",
                      0.04 * (i % ACROSS_BOXES - ACROSS_BOXES / 2), 0.04 * (i / ACROSS_BOXES - ACROSS_BOXES / 2),
                      17 * i % 360);
}

static void test_instances(void **state)
{
    static struct picture wanted, got;
    struct buffer text = BUFFER_INIT;
    struct shape_text s;

    (void)state;
    for (double distance = 10; distance < 2e9; distance *= 100) {
        char what[96];
        begin(&text, SUN, here);
        shape_begin(&s);
        shape_quad(&s, (double[]){-3, 0, -3}, (double[]){0, 0, 6}, (double[]){6, 0, 0});
        shape_end(&s, &text);
        instances(&text);
        if (distance > 10)
            card(&text, distance, "Material \"diffuse\" \"rgb reflectance\" [0 0 0]", -0.1);
        snprintf(what, sizeof what, "instances, card at %g m", distance);
        render(&text, distance > 10 ? &got : &wanted);
        if (distance > 10)
            compare(what, &wanted, &got, 0.005);
    }
}

/* A tumbler: a ring of glass with water in it, faces that touch. */
static void test_glass(void **state)
{
    static struct picture wanted, got;

    (void)state;
    for (double distance = 10; distance < 2e9; distance *= 100) {
        struct buffer text = BUFFER_INIT;
        struct shape_text s;
        char what[96];
        begin(&text, SKY_AND_LAMPS, here);
        shape_begin(&s);
        shape_quad(&s, (double[]){-3, 0, -3}, (double[]){0, 0, 6}, (double[]){6, 0, 0});
        shape_end(&s, &text);
        buffer_puts(&text, "AttributeBegin Material \"dielectric\" \"float eta\" 1.5 Translate 0 .151 0 "
                           "Shape \"sphere\" \"float radius\" .15 AttributeEnd\n"
                           "AttributeBegin Material \"dielectric\" \"float eta\" 1.33\n");
        shape_begin(&s);
        shape_box(&s, (double[]){0.15, 0.0001, -0.1}, (double[]){0.35, 0.2, 0.1});
        shape_quad(&s, (double[]){0.15, 0.0001, -0.1}, (double[]){0.2, 0, 0}, (double[]){0, 0, 0.2});
        shape_end(&s, &text);
        buffer_puts(&text, "AttributeEnd\n");
        if (distance > 10)
            card(&text, distance, "Material \"diffuse\" \"rgb reflectance\" [0 0 0]", -0.1);
        snprintf(what, sizeof what, "glass, card at %g m", distance);
        settings_depth = 8;
        render(&text, distance > 10 ? &got : &wanted);
        settings_depth = 3;
        if (distance > 10)
            compare(what, &wanted, &got, 0.01);
    }
}

/* ---- OBJ ------------------------------------------------------------------------------------------- */

/* Two boxes; a card before or behind them in the file, in their group or in its own. */
static void obj_text(struct buffer *text, const double at[3], double distance, int card_first, int grouped)
{
    static const int faces[6][4] = {{1, 3, 4, 2}, {5, 6, 8, 7}, {1, 2, 6, 5}, {3, 7, 8, 4}, {1, 5, 7, 3}, {2, 4, 8, 6}};

    for (int part = 0; part < 3; part++) {
        int box = card_first ? part - 1 : part;
        if (box < 0 || box > 1) {
            for (int k = 0; k < 4 && distance > 0; k++)
                buffer_printf(text, "v %.17g %.17g %.17g\n", at[0] + distance, at[1] - 0.01 * distance * (1 + (k > 1)),
                              at[2] + 0.01 * distance * (k == 1 || k == 2));
            buffer_puts(text, distance > 0 ? grouped ? "g card\nf -4 -3 -2 -1\n" : "f -4 -3 -2 -1\n" : "");
            continue;
        }
        for (int k = 0; k < 8; k++)
            buffer_printf(text, "v %.17g %.17g %.17g\n", at[0] + (box ? 0.1 : 1.5) * (k & 1 ? 0.5 : -0.5),
                          at[1] + (box ? 0.1 : -0.1) * (k >> 1 & 1), at[2] + (box ? 0.1 : 1.5) * (k & 4 ? 0.5 : -0.5));
        buffer_puts(text, grouped ? "g boxes\n" : "");
        for (int f = 0; f < 6; f++)
            buffer_printf(text, "f %d %d %d %d\n", faces[f][0] - 9, faces[f][1] - 9, faces[f][2] - 9, faces[f][3] - 9);
    }
}

static void render_obj(struct buffer *text, const double at[3], struct picture *out)
{
    struct import_result import;
    struct scene_camera *camera;
    struct transform_d view;
    static const double way[3] = {0.4, 0.45, 0.7};
    struct vec3 z = vec3_normalize(vec3_make((float)way[0], (float)way[1], (float)way[2])), x, y;

    import_text(text, "near.obj", &import);
    x = vec3_normalize(vec3_cross(vec3_make(0, 1, 0), z));
    y = vec3_cross(z, x);
    view = (struct transform_d){{{x.x, y.x, z.x, 0}, {x.y, y.y, z.y, 0}, {x.z, y.z, z.z, 0}}};
    for (int c = 0; c < 3; c++)
        view.m[c][3] = at[c] + way[c] - import.scene.origin[c];
    camera = &import.scene.cameras[0];
    camera->to_world = view;
    camera->yfov_rad = 0.5f;
    render_frame(&import, 0, out);
    import_result_release(&import);
}

static void test_obj(void **state)
{
    static const double places[2][3] = {{0, 0, 0}, {500000.25, 3, -4649776.5}};
    static struct picture wanted, got;

    (void)state;
    for (int i = 0; i < 16; i++) {
        const double *at = places[i & 1], distance = i & 2 ? 1e7 : 1e5;
        struct buffer text = BUFFER_INIT;
        char what[96];
        obj_text(&text, at, 0, 0, 0);
        render_obj(&text, at, &wanted);
        obj_text(&text, at, distance, i >> 2 & 1, i >> 3);
        render_obj(&text, at, &got);
        snprintf(what, sizeof what, "OBJ%s, card at %g m %s in the file, %s", i & 1 ? " in map coordinates" : "",
                 distance, i >> 2 & 1 ? "first" : "last", i >> 3 ? "a group" : "no group");
        compare(what, &wanted, &got, 0.01);
    }
}

/* The model under a sun with a card so far off. */
static int print_scene(const char *distance)
{
    struct buffer text = BUFFER_INIT;

    begin(&text, SUN, here);
    model(&text, here);
    if (atof(distance) > 0)
        card(&text, atof(distance), "Material \"diffuse\" \"rgb reflectance\" [0 0 0]", -0.1);
    fputs(buffer_text(&text), stdout);
    buffer_release(&text);
    return 0;
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_card),
        cmocka_unit_test(test_one_mesh),
        cmocka_unit_test(test_far_lamp),
        cmocka_unit_test(test_skybox),
        cmocka_unit_test(test_terrain),
        cmocka_unit_test(test_cameras),
        cmocka_unit_test(test_travel),
        cmocka_unit_test(test_motion),
        cmocka_unit_test(test_box),
        cmocka_unit_test(test_instances),
        cmocka_unit_test(test_glass),
        cmocka_unit_test(test_obj),
    };

    if (argc == 3 && strcmp(argv[1], "--scene") == 0)
        return print_scene(argv[2]);
    return cmocka_run_group_tests_name("near and far", tests, NULL, NULL);
}
