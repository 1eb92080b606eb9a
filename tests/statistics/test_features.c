/* Every effect has a small scene in scenes/features, and every such picture is compared with a
 * reference picture that comes with its standard error.
 *
 *   test_features                      the tests
 *   test_features --write [NAME...]    make the references again (all, or these): make_references.sh
 *   test_features --seeds N [NAME...]  the largest z of N other seeds, to judge the tests by
 *
 * What a reference is: tests/statistics/references/NAME.exr holds the mean of REFERENCE_RUNS
 * renders of SPP samples by the general kernel, with seeds of their own, and the standard
 * deviation of one such render, pixel by pixel, measured over those runs. It is an oracle for
 * regressions alone: it knows what the renderer did when it was made. That this was true is for
 * the closed forms (the other programs in this folder) and for other renderers (tests/peers).
 *
 * How it is compared: the test renders the scene once more, by the kernel that a user would get,
 * with another seed and the references' number of samples, so that the deviation in the file is
 * that of the picture under test: estimating it from the few samples of the test itself would call
 * every firefly that came a difference, and miss those that did not.
 *
 * Fireflies: a pixel that one caustic path in a thousand makes a thousand times brighter is no
 * normal variable, nor is the mean of 16 such. So each pixel has a cap, CAP_DEVIATIONS above its
 * mean, and what is above counts as the cap, in the references' runs and under test alike: the
 * same function of equally distributed variables. Mean and deviation are those of capped pixels (a
 * fixed point: see pixel_settle). The price is that the energy of the rarest paths is not compared
 * here, and that a renderer with other noise may want new references.
 *
 * Blocks of 4 x 4 pixels are compared, channel by channel, by z-tests. Pixels are independent of
 * one another, so a block's variance is the mean of its pixels' over 16. It has a floor for what
 * the file's half floats cannot say.
 * The mean picture is compared in the same way, for small differences everywhere; and the sum of a
 * channel's blocks' z^2 by a chi-square test, for differences that are small in each block, and for
 * noise: a portal is there for less of it alone.
 *
 * Single pixels are compared, too, for what a block hides: one that is wrong must be so by four
 * times as many deviations to show in its block. A pixel's mean of one run is far from normal, and
 * its cap is lower than a z that could be rejected; so PIXEL_RUNS runs are averaged, and the
 * variance is the larger of the reference's and that which these runs show (as in Welch's test):
 * where a rare bright or dark path came by chance, the seen one grows with it, and where none came
 * the reference's counts. What is rejected is what all runs agree upon. The worst that a two-valued
 * pixel can do to it is one false alarm in a million, and such pixels are few. The smallest z that is
 * rejected is 6.2: a pixel that is wrong by 3.1 deviations of one run. Tried with four
 * other seeds of each of ten noisy scenes (--seeds 4): the largest z of a pixel was 4.8; with eight runs and ten seeds
 * of 42 scenes it was 5.15 of 1.9 million, as of so many normal variables.
 * Blocks find most of the bites below by more; pixels find by more a thing that was moved
 * (51 to 29 deviations), glass of another index (21 to 17), rougher metal (41 to 34): outlines.
 *
 * The family-wise significance is 0.001 for the blocks and 0.001 for the pixels of all scenes, by
 * Sidak's correction. The seeds are fixed: what passes once, passes always. Tried with 40 other
 * seeds, coloured glass, fog and the Cornell box, which fireflies had failed before there were
 * caps, never did.
 *
 * Each comparison must also be able to fail: with the effect switched off (settings.without), or
 * taken out of the loaded scene where the user has no switch for it, the same tests must reject,
 * by far. All effects of common/scene/effects.h are on that list. Most do so by a block of the first tile:
 * tiles, and then more runs, are rendered until one does. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "client/import/import.h"
#include "common/system/file.h"
#include "common/film/film.h"
#include "common/image/image.h"
#include "common/scene/scene_effects.h"
#include "common/scene/kernel_sets.h"
#include "tests/support/exr_channels.h"
#include "tests/support/statistics.h"
#include "tests/support/imported.h"
#include "worker/render/render.h"

enum {
    WIDTH = 48,
    HEIGHT = 32,
    PIXELS = WIDTH * HEIGHT,
    BLOCK = 4,
    BLOCKS = PIXELS / (BLOCK * BLOCK),
    VALUES = PIXELS * 3,
    SPP = 64,
    REFERENCE_RUNS = 128,
    REFERENCE_SEED = 1000, /* and those that follow; the tests' is another */
    TEST_SEED = 1,
    OTHER_SEED = 100000,   /* and those that follow: --seeds */
    PIXEL_RUNS = 4,
    BITES_MAX = 8,
};
#define SIGNIFICANCE 0.001
/* A picture without its effect must be as unlikely as this after the correction. */
#define BITE 1e-6
/* What rounding to half may do to a block of a reference, and to its mean: a share, and radiance. */
#define CAP_DEVIATIONS 3
#define CAP_SLACK_SHARE 1e-3
#define BLOCK_FLOOR_SHARE 2e-4
#define MEAN_FLOOR_SHARE 2e-5
#define PIXEL_FLOOR_SHARE 5e-4
#define FLOOR 1e-6

#define REFERENCES "tests/statistics/references/"

typedef void edit_fn(struct scene *scene);
typedef void set_fn(struct render_settings *settings);

enum { NO_EFFECT = -1 };

/* One way to spoil a scene. */
struct bite {
    const char *what; /* NULL ends a list */
    int effect;       /* that is gone afterwards, enum effect_bit; NO_EFFECT: all stay */
    edit_fn *edit;    /* of the scene */
    set_fn *set;      /* of the settings; if both are NULL, settings.without */
};

struct feature {
    const char *path;
    const char *variant; /* of the materials */
    uint32_t frame;      /* of an animation, 24 a second */
    float shutter;       /* of a glTF's camera */
    size_t warnings;     /* that the importer gives */
    unsigned runs;       /* of the test, if not 1: the noisier ones need more to see anything */
    struct bite bites[BITES_MAX];
};

/* ---- what is changed where nothing can be switched off ------------------------------------- */

#define EACH_MATERIAL(scene, m)                                                               \
    for (struct scene_material *m = (scene)->materials, *m##_end = m + (scene)->material_count; \
         m < m##_end; m++)

static void scale3(float rgb[3], float by)
{
    for (int c = 0; c < 3; c++)
        rgb[c] *= by;
}

static void black(struct scene *scene)
{
    EACH_MATERIAL(scene, m)
    scale3(m->base_color, 0);
}

static void polished(struct scene *scene)
{
    EACH_MATERIAL(scene, m)
    m->roughness = m->clearcoat_roughness = 0;
}

static void roughened(struct scene *scene)
{
    EACH_MATERIAL(scene, m) {
        m->roughness = fmaxf(m->roughness, 0.3f);
        m->clearcoat_roughness = fmaxf(m->clearcoat_roughness, 0.3f);
    }
}

/* What is rough, not the mirrors. */
static void rougher(struct scene *scene)
{
    EACH_MATERIAL(scene, m)
    if (m->roughness >= EFFECT_MIRROR_ROUGHNESS)
        m->roughness = fminf(1, m->roughness * 2);
}

static void untransmitting(struct scene *scene)
{
    EACH_MATERIAL(scene, m)
    m->transmission = 0;
}

static void other_index(struct scene *scene)
{
    EACH_MATERIAL(scene, m)
    if (m->transmission > 0)
        m->ior *= 0.9f;
}

static void double_sided(struct scene *scene)
{
    EACH_MATERIAL(scene, m)
    m->double_sided = 1;
}

static void lit(struct scene *scene)
{
    EACH_MATERIAL(scene, m)
    m->unlit = 0;
}

static void metallic(struct scene *scene)
{
    EACH_MATERIAL(scene, m)
    if (m->kind == MATERIAL_CONDUCTOR) {
        m->kind = MATERIAL_SURFACE;
        m->metallic = 1;
    }
}

static void other_metal(struct scene *scene)
{
    EACH_MATERIAL(scene, m)
    scale3(m->conductor_k, 0.9f);
}

static void less_specular(struct scene *scene)
{
    EACH_MATERIAL(scene, m)
    m->specular *= 0.5f;
}

static void white_specular(struct scene *scene)
{
    EACH_MATERIAL(scene, m)
    m->specular_color[0] = m->specular_color[1] = m->specular_color[2] = 1;
}

static void brighter(struct scene *scene)
{
    EACH_MATERIAL(scene, m)
    scale3(m->emission, 1.1f);
}

static void some_bulbs_out(struct scene *scene)
{
    EACH_MATERIAL(scene, m)
    if (strncmp(m->name, "bulb 5", 6) == 0)
        scale3(m->emission, 0);
}

static void plain(struct scene *scene)
{
    EACH_MATERIAL(scene, m)
    if (m->base_color_texture.texture < 0)
        m->base_color[0] = m->base_color[1] = m->base_color[2] = 0.5f;
}

static void first_of_mix(struct scene *scene)
{
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        uint32_t *m = &scene->instances[i].material;
        while (scene->materials[*m].kind == MATERIAL_MIX)
            *m = scene->materials[*m].mix_material[0];
    }
}

static void other_mix(struct scene *scene)
{
    EACH_MATERIAL(scene, m)
    m->mix_amount *= 0.9f;
}

static void without_interreflection(struct scene *scene)
{
    EACH_MATERIAL(scene, m)
    m->base_interreflection = 0;
}

static void walls_for_interfaces(struct scene *scene)
{
    EACH_MATERIAL(scene, m)
    if (m->kind == MATERIAL_INTERFACE)
        m->kind = MATERIAL_SURFACE;
}

static void clearer(struct scene *scene)
{
    EACH_MATERIAL(scene, m)
    m->attenuation_distance *= 1.3f;
}

static void even_media(struct scene *scene)
{
    for (uint32_t i = 0; i < scene->medium_count; i++)
        scene->media[i].has_grid = 0;
}

static void thinner_media(struct scene *scene)
{
    for (uint32_t i = 0; i < scene->medium_count; i++) {
        scale3(scene->media[i].absorption, 0.7f);
        scale3(scene->media[i].scattering, 0.7f);
    }
}

static void scattering_backwards(struct scene *scene)
{
    for (uint32_t i = 0; i < scene->medium_count; i++)
        scene->media[i].g *= -1;
}

static void as_perspective(struct scene *scene)
{
    scene->cameras[0].kind = CAMERA_PERSPECTIVE;
    scene->cameras[0].yfov_rad = 0.6f;
}

/* By a degree, about its own axis of height. */
static void turned_camera(struct scene *scene)
{
    for (int r = 0; r < 3; r++) {
        double *row = scene->cameras[0].to_world.m[r], x = row[0], z = row[2];
        row[0] = 0.99985 * x - 0.01745 * z;
        row[2] = 0.01745 * x + 0.99985 * z;
    }
}

static void other_focus(struct scene *scene) { scene->cameras[0].focus_distance *= 1.5f; }

static void turned_sky(struct scene *scene)
{
    for (int c = 0; c < 3; c++) {
        float *a = &scene->environment.to_map[0][c], *b = &scene->environment.to_map[2][c];
        float x = *a, z = *b;
        *a = 0.9962f * x - 0.0872f * z;
        *b = 0.0872f * x + 0.9962f * z;
    }
}

/* Right on average, but the sun is found by chance: noise. */
static void sky_sampled_evenly(struct render_settings *settings) { settings->env_sampling = ENV_SAMPLING_UNIFORM; }

static void wider_spots(struct scene *scene)
{
    for (uint32_t i = 0; i < scene->light_count; i++) {
        scene->lights[i].inner_cone_rad *= 1.1f;
        scene->lights[i].outer_cone_rad *= 1.1f;
    }
}

static void without_sun(struct scene *scene)
{
    for (uint32_t i = 0; i < scene->light_count; i++)
        if (scene->lights[i].kind == LIGHT_DIRECTIONAL)
            scale3(scene->lights[i].intensity, 0);
}

/* Each mesh in one place only. */
static void first_of_each_mesh(struct scene *scene)
{
    uint32_t kept = 0;

    for (uint32_t i = 0; i < scene->instance_count; i++) {
        int again = 0;
        for (uint32_t k = 0; k < kept; k++)
            again |= scene->instances[k].mesh == scene->instances[i].mesh;
        if (!again)
            scene->instances[kept++] = scene->instances[i];
    }
    scene->instance_count = kept;
}

static void raised_instance(struct scene *scene)
{
    scene->instances[scene->instance_count - 1].to_world.m[1][3] += 0.1f;
}

static void stiff(struct scene *scene)
{
    uint32_t kept = 0;

    for (uint32_t i = 0; i < scene->instance_count; i++)
        scene->instances[i].skin = -1;
    for (uint32_t i = 0; i < scene->channel_count; i++)
        if (scene->channels[i].path != PATH_WEIGHTS)
            scene->channels[kept++] = scene->channels[i];
    scene->channel_count = kept;
}

/* What bends bends as at the start. */
static void unbent(struct scene *scene)
{
    for (uint32_t i = 0; i < scene->channel_count; i++)
        if (scene->channels[i].path == PATH_ROTATION)
            scene->channels[i].key_count = 1;
}

static void unmorphed(struct scene *scene)
{
    for (uint32_t i = 0; i < scene->channel_count; i++)
        if (scene->channels[i].path == PATH_WEIGHTS)
            scene->channels[i].key_count = 1;
}

static void without_slabs(struct scene *scene)
{
    EACH_MATERIAL(scene, m)
    m->thin_slab = 0;
}

static void unfiltered(struct scene *scene)
{
    for (uint32_t i = 0; i < scene->texture_count; i++)
        scene->textures[i].nearest = 1;
}

/* ---- the scenes ---------------------------------------------------------------------------- */

#define BIT(name) EFFECT_BIT_##name
#define WITHOUT(name) {"without " #name, BIT(name), NULL, NULL}
#define EDIT(name, fn) {#fn, BIT(name), fn, NULL}
#define ALTER(fn) {#fn, NO_EFFECT, fn, NULL}
#define SET(fn) {#fn, NO_EFFECT, NULL, fn}
#define SCENE(name) .path = "scenes/features/" name

static const struct feature features[] = {
    {SCENE("absorption.gltf"), .bites = {WITHOUT(ABSORPTION), WITHOUT(CAUSTICS), ALTER(clearer)}},
    {SCENE("alpha.gltf"), .bites = {WITHOUT(ALPHA)}},
    {SCENE("anisotropy.gltf"), .bites = {WITHOUT(ANISOTROPY)}},
    {SCENE("clearcoat.gltf"), .bites = {WITHOUT(CLEARCOAT)}},
    {SCENE("coated.pbrt"), .runs = 4,
     .bites = {WITHOUT(CLEARCOAT), ALTER(without_interreflection)}},
    {SCENE("conductor.pbrt"), .bites = {EDIT(CONDUCTOR, metallic), ALTER(other_metal)}},
    {SCENE("culling.gltf"), .bites = {EDIT(CULLING, double_sided)}},
    {SCENE("deformation.gltf"), .frame = 16,
     .bites = {EDIT(DEFORMATION, stiff), ALTER(unbent), ALTER(unmorphed)}},
    {SCENE("diffuse-transmission.gltf"), .bites = {WITHOUT(DIFFUSE_TRANSMISSION)}},
    {SCENE("diffuse-roughness.gltf"), .bites = {WITHOUT(ROUGH_DIFFUSE)}},
    {SCENE("dispersion.gltf"), .runs = 16, .bites = {WITHOUT(DISPERSION)}},
    {SCENE("emissive-strength.gltf"), .bites = {WITHOUT(EMISSIVE_MESH), ALTER(brighter)}},
    {SCENE("fire.pbrt"), .bites = {WITHOUT(MEDIUM_EMISSION), WITHOUT(MEDIUM)}},
    {SCENE("fog.pbrt"), .bites = {WITHOUT(FOG), ALTER(scattering_backwards)}},
    {SCENE("glass.gltf"), .runs = 2,
     .bites = {EDIT(DIELECTRIC, roughened), EDIT(ROUGH_DIELECTRIC, polished), ALTER(other_index)}},
    {SCENE("horizon.gltf"), .bites = {EDIT(UNLIT, lit), ALTER(unfiltered)}},
    {SCENE("instances.pbrt"),
     .bites = {EDIT(INSTANCING, first_of_each_mesh), ALTER(raised_instance)}},
    {SCENE("iridescence.gltf"), .bites = {WITHOUT(IRIDESCENCE)}},
    {SCENE("lens.pbrt"), .bites = {WITHOUT(DEPTH_OF_FIELD), ALTER(other_focus)}},
    {SCENE("lights.gltf"),
     .bites = {WITHOUT(PUNCTUAL_LIGHT), ALTER(wider_spots), ALTER(without_sun)}},
    {SCENE("many-lights.gltf"), .bites = {ALTER(some_bulbs_out)}},
    {SCENE("media.pbrt"),
     .bites = {WITHOUT(MEDIUM), EDIT(MEDIUM_GRID, even_media),
               EDIT(INTERFACE, walls_for_interfaces), ALTER(thinner_media)}},
    {SCENE("metal.gltf"),
     .bites = {EDIT(GLOSSY, polished), WITHOUT(MULTIPLE_SCATTERING), ALTER(rougher)}},
    {SCENE("mix.pbrt"), .bites = {EDIT(MATERIAL_MIX, first_of_mix), ALTER(other_mix)}},
    {SCENE("motion.gltf"), .frame = 3, .shutter = 1, .bites = {WITHOUT(MOTION_BLUR)}},
    {SCENE("nested.gltf"), .runs = 2, .bites = {WITHOUT(NESTED_DIELECTRIC)}},
    {SCENE("normal-map.gltf"), .bites = {WITHOUT(NORMAL_MAP)}},
    {SCENE("orthographic.gltf"), .bites = {EDIT(ORTHOGRAPHIC, as_perspective)}},
    {SCENE("panorama.pbrt"), .bites = {EDIT(PANORAMA, as_perspective), ALTER(turned_camera)}},
    {SCENE("panes.pbrt"), .bites = {EDIT(THIN_TRANSMISSION, untransmitting), ALTER(without_slabs)}},
    {SCENE("sheen.gltf"), .bites = {WITHOUT(SHEEN)}},
    {SCENE("shutter.pbrt"), .bites = {WITHOUT(MOTION_BLUR)}},
    {SCENE("sky.pbrt"), .warnings = 1 /* the map is not square */,
     .bites = {WITHOUT(ENVIRONMENT), ALTER(turned_sky), SET(sky_sampled_evenly)}},
    {SCENE("slides.pbrt"), .bites = {WITHOUT(LIGHT_IMAGE)}},
    {SCENE("specular.gltf"), .bites = {ALTER(less_specular), ALTER(white_specular)}},
    {SCENE("texture-filter.gltf"), .bites = {WITHOUT(TEXTURE)}},
    {SCENE("thin-transmission.gltf"), .bites = {EDIT(THIN_TRANSMISSION, untransmitting)}},
    {SCENE("unlit.gltf"), .bites = {EDIT(UNLIT, lit)}},
    {SCENE("variants.gltf"), .variant = "red", .bites = {ALTER(plain)}},
    {SCENE("vertex-color.gltf"), .bites = {WITHOUT(VERTEX_COLOR)}},
    {SCENE("window.pbrt"), .bites = {WITHOUT(PORTAL)}},
    {.path = "scenes/cornell/cornell-area.gltf",
     .bites = {EDIT(DIFFUSE, black), ALTER(brighter)}},
    {.path = "scenes/cornell/cornell-mirror.gltf", .warnings = 1 /* it has no light of its own */,
     .bites = {EDIT(MIRROR, roughened), WITHOUT(CAUSTICS)}},
};
enum { FEATURES = sizeof features / sizeof *features };

/* "sheen" of "scenes/features/sheen.gltf". */
static void feature_name(const struct feature *f, char name[64])
{
    const char *slash = strrchr(f->path, '/') + 1;

    snprintf(name, 64, "%.*s", (int)strcspn(slash, "."), slash);
}

/* ---- rendering ----------------------------------------------------------------------------- */

static _Noreturn void fail_now(const char *name, const char *why)
{
    fprintf(stderr, "test_features: %s: %s\n", name, why);
    exit(1);
}

static void import_feature(const struct feature *f, struct import_result *import)
{
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct error err = {0};

    options.variant = f->variant;
    if (import_scene(f->path, &options, import, &err) != STATUS_OK)
        fail_now(f->path, err.text);
    if (import->warning_count != f->warnings)
        fail_now(f->path, import->warning_count ? import->warnings[0] : "a warning is missing");
}

static struct render_settings settings_of(const struct feature *f, uint64_t seed)
{
    struct render_settings s;

    render_settings_default(&s);
    s.width = WIDTH;
    s.height = HEIGHT;
    s.spp = SPP;
    if (!(isa_supported_mask() >> s.isa & 1))
        s.isa = ISA_SSE2;
    s.seed = seed;
    s.fps = 24;
    s.shutter = f->shutter;
    return s;
}

static struct film *wanted_film(const struct feature *f)
{
    struct film *film = film_new(WIDTH, HEIGHT, SPP);

    if (!film)
        fail_now(f->path, "out of memory");
    imported_want_film(film);
    return film;
}

static struct render_scene *made_ready(const struct feature *f, struct import_result *import,
                                       const struct render_settings *settings)
{
    struct render_scene *scene;
    struct error err = {0};

    if (scene_validate(&import->scene, &err) != STATUS_OK ||
        render_scene_new(&scene, &import->scene, settings, f->frame, imported_source(import), &err) != STATUS_OK)
        fail_now(f->path, err.text);
    return scene;
}

static void render_one(const struct feature *f, const struct render_scene *scene, uint32_t tile, struct film *film)
{
    struct render_stats stats = {0};

    imported_render_tile(scene, f->frame, tile, film, &stats);
    if (stats.work.dropped_samples > 0)
        fail_now(f->path, "samples that are not finite");
}

/* The picture [HEIGHT][WIDTH][3]. */
static void render(const struct feature *f, struct import_result *import, const struct render_settings *settings,
                   float *picture, int general)
{
    struct film *film = wanted_film(f);
    struct render_scene *scene;

    render_force_general(general);
    scene = made_ready(f, import, settings);
    for (uint32_t tile = 0; tile < film_tile_count(film); tile++)
        render_one(f, scene, tile, film);
    film_develop(film, picture);
    render_force_general(0);
    render_scene_free(scene);
    film_free(film);
}

/* ---- references ---------------------------------------------------------------------------- */

struct reference {
    double mean[VALUES];
    double deviation[VALUES]; /* of one render of SPP samples */
};

/* What a pixel counts at most. The slack is for values that do not vary, rounded to half. */
static double pixel_cap(double mean, double deviation)
{
    return mean + CAP_DEVIATIONS * deviation + CAP_SLACK_SHARE * mean + FLOOR;
}

static const char *const plane_names[2][3] = {{"R", "G", "B"},
                                              {"deviation.R", "deviation.G", "deviation.B"}};

static void reference_path(const struct feature *f, char path[256])
{
    char name[64];

    feature_name(f, name);
    snprintf(path, 256, REFERENCES "%s.exr", name);
}

static void deviation_lines(void *user, uint32_t y, uint32_t height, float *planes)
{
    const struct reference *r = user;

    for (uint32_t c = 0; c < 3; c++)
        for (uint32_t i = 0; i < height * WIDTH; i++)
            planes[c * height * WIDTH + i] = (float)r->deviation[(y * WIDTH + i) * 3 + c];
}

static void reference_save(const struct feature *f, struct reference *r)
{
    static float pixels[VALUES];
    const struct exr_channel channels[3] = {
        {plane_names[1][0], 0}, {plane_names[1][1], 0}, {plane_names[1][2], 0}};
    const struct exr_channels more = {channels, 3, deviation_lines, r};
    const struct exr_attribute attributes[] = {{.name = "samples", .number = SPP},
                                               {.name = "runs", .number = REFERENCE_RUNS}};
    const struct exr_options options = {
        .half = 1, .attributes = attributes, .attribute_count = 2, .more = &more};
    struct image image = {WIDTH, HEIGHT, 3, pixels};
    struct buffer bytes = BUFFER_INIT;
    struct error err = {0};
    char path[256];

    for (size_t i = 0; i < VALUES; i++)
        pixels[i] = (float)r->mean[i];
    reference_path(f, path);
    if (exr_encode(&bytes, &image, &options, &err) != STATUS_OK ||
        file_write_atomic(path, bytes.data, bytes.size, &err) != STATUS_OK)
        fail_now(path, err.text);
    printf("%s: %zu bytes\n", path, bytes.size);
    fflush(stdout);
    buffer_release(&bytes);
}

/* Mean and deviation of the runs' values, capped by themselves: caps fall until they stand. */
static void pixel_settle(const float *runs, double *mean, double *deviation)
{
    double cap = INFINITY;

    for (int round = 0; round < 100; round++) {
        struct running_stats stats = {0};
        for (size_t k = 0; k < REFERENCE_RUNS; k++)
            running_stats_add(&stats, fmin((double)runs[k * VALUES], cap));
        *mean = stats.mean;
        *deviation = sqrt(running_stats_variance(&stats));
        cap = pixel_cap(*mean, *deviation);
    }
}

static void reference_write(const struct feature *f)
{
    static struct reference r;
    static float runs[REFERENCE_RUNS * VALUES];
    struct import_result import;

    import_feature(f, &import);
    for (uint64_t k = 0; k < REFERENCE_RUNS; k++) {
        struct render_settings settings = settings_of(f, REFERENCE_SEED + k);
        render(f, &import, &settings, runs + k * VALUES, 1);
    }
    for (size_t i = 0; i < VALUES; i++)
        pixel_settle(runs + i, &r.mean[i], &r.deviation[i]);
    reference_save(f, &r);
    import_result_release(&import);
}

static void reference_read(const struct feature *f, struct reference *r)
{
    struct buffer bytes = BUFFER_INIT;
    struct error err = {0};
    char path[256];

    reference_path(f, path);
    if (file_read(path, 1 << 20, &bytes, &err) != STATUS_OK)
        fail_now(err.text, "tests/statistics/make_references.sh makes it");
    for (int k = 0; k < 2; k++)
        for (size_t c = 0; c < 3; c++) {
            int half;
            float *plane = exr_channel_read(bytes.data, bytes.size, plane_names[k][c], &half);
            if (!plane)
                fail_now(path, "a channel is missing");
            for (size_t i = 0; i < PIXELS; i++)
                (k ? r->deviation : r->mean)[3 * i + c] = (double)plane[i];
            free(plane);
        }
    buffer_release(&bytes);
}

/* ---- comparing ----------------------------------------------------------------------------- */

/* Renders of SPP samples each, capped. */
struct picture {
    struct running_stats values[VALUES]; /* over the runs */
    unsigned runs;
    size_t lacking; /* blocks that are not there yet: */
    unsigned char lacks[BLOCKS];
};

static void picture_add(struct picture *p, const float *values, const struct reference *r)
{
    p->runs++;
    for (size_t i = 0; i < VALUES; i++)
        running_stats_add(&p->values[i], fmin((double)values[i], pixel_cap(r->mean[i], r->deviation[i])));
}

/* One run more. */
static void picture_run(struct picture *p, const struct feature *f, struct import_result *import,
                        const struct render_settings *settings, const struct reference *r)
{
    struct render_settings s = *settings;
    static float values[VALUES];

    s.seed = settings->seed + p->runs;
    render(f, import, &s, values, 0);
    picture_add(p, values, r);
}

/* As many runs as the scene wants, but no fewer than those that pixels need. */
static void picture_render(struct picture *p, const struct feature *f, struct import_result *import,
                           const struct render_settings *settings, const struct reference *r)
{
    memset(p, 0, sizeof *p);
    while (p->runs < f->runs || p->runs < PIXEL_RUNS)
        picture_run(p, f, import, settings, r);
}

/* The least likely of all tests of a picture's blocks, and of its pixels. */
struct verdict {
    double p;              /* after Sidak's correction over all scenes' tests */
    double z;              /* the largest of a block or of the mean picture, and where it is: */
    size_t block, channel; /* block BLOCKS: the mean picture */
    double seen, expected;
    double pixel_p; /* corrected in the same way; 1 if there are too few runs */
    double pixel_z; /* the largest, and where it is: */
    size_t pixel;   /* value number */
};

/* Sums over `count` pixels of one channel. */
struct sums {
    double seen, expected, variance, count;
};

static void sums_add(struct sums *s, const struct picture *p, const struct reference *r, size_t at)
{
    double variance = r->deviation[at] * r->deviation[at];

    s->seen += p->values[at].mean;
    s->expected += r->mean[at];
    s->variance += variance / p->runs + variance / REFERENCE_RUNS;
    s->count++;
}

static double sums_z(const struct sums *s, double floor_share)
{
    double floor = s->count * FLOOR + floor_share * fabs(s->expected);

    return (s->seen - s->expected) / sqrt(s->variance + floor * floor);
}

/* The chance of a p-value as low as this among all tests of all scenes. */
static double corrected(double p) { return -expm1(FEATURES * (BLOCKS + 2) * 3 * log1p(-fmin(p, 1 - 1e-9))); }

static void verdict_note(struct verdict *v, const struct sums *s, double z, size_t block, size_t channel)
{
    if (fabs(z) <= fabs(v->z))
        return;
    v->z = z;
    v->block = block;
    v->channel = channel;
    v->seen = s->seen / s->count;
    v->expected = s->expected / s->count;
    v->p = fmin(v->p, corrected(erfc(fabs(z) / sqrt(2))));
}

static void compare_channel(struct verdict *v, const struct picture *picture, const struct reference *r, size_t c)
{
    struct sums whole = {0};
    double squares = 0;

    for (size_t block = 0; block < BLOCKS; block++) {
        size_t x0 = block % (WIDTH / BLOCK) * BLOCK, y0 = block / (WIDTH / BLOCK) * BLOCK;
        struct sums part = {0};
        double z;
        if (picture->lacks[block])
            continue;
        for (size_t i = 0; i < BLOCK * BLOCK; i++) {
            size_t at = 3 * ((y0 + i / BLOCK) * WIDTH + x0 + i % BLOCK) + c;
            sums_add(&part, picture, r, at);
            sums_add(&whole, picture, r, at);
        }
        z = sums_z(&part, BLOCK_FLOOR_SHARE);
        squares += z * z;
        verdict_note(v, &part, z, block, c);
    }
    if (picture->lacking > 0)
        return;
    verdict_note(v, &whole, sums_z(&whole, MEAN_FLOOR_SHARE), BLOCKS, c);
    v->p = fmin(v->p, corrected(chi_square_p_value(squares, BLOCKS)));
}

static double pixel_z(const struct picture *p, const struct reference *r, size_t at)
{
    double known = r->deviation[at] * r->deviation[at];
    double seen = running_stats_variance(&p->values[at]);
    double floor = FLOOR + PIXEL_FLOOR_SHARE * fabs(r->mean[at]);

    return (p->values[at].mean - r->mean[at]) /
           sqrt(fmax(known, seen) / p->runs + known / REFERENCE_RUNS + floor * floor);
}

/* By Student's t of the runs that the reference's deviations come from. */
static void compare_pixels(struct verdict *v, const struct picture *picture, const struct reference *r)
{
    for (size_t at = 0; at < VALUES; at++) {
        double z = pixel_z(picture, r, at);
        if (fabs(z) > fabs(v->pixel_z)) {
            v->pixel_z = z;
            v->pixel = at;
        }
    }
    v->pixel_p = 2 * student_cdf(-fabs(v->pixel_z), REFERENCE_RUNS - 1);
    v->pixel_p = -expm1((double)FEATURES * VALUES * log1p(-fmin(v->pixel_p, 1 - 1e-9)));
}

static struct verdict compare(const struct picture *picture, const struct reference *r)
{
    struct verdict v = {.p = 1, .pixel_p = 1};

    for (size_t c = 0; c < 3; c++)
        compare_channel(&v, picture, r, c);
    if (picture->runs >= PIXEL_RUNS)
        compare_pixels(&v, picture, r);
    return v;
}

/* ---- the tests ----------------------------------------------------------------------------- */

static void picture_gains(struct picture *p, uint32_t tile)
{
    const struct tile_rect rect = tile_rect_of(WIDTH, HEIGHT, tile);

    for (size_t block = 0; block < BLOCKS; block++) {
        size_t x = block % (WIDTH / BLOCK) * BLOCK, y = block / (WIDTH / BLOCK) * BLOCK;
        if (x >= rect.x && x < rect.x + rect.width && y >= rect.y && y < rect.y + rect.height) {
            p->lacking -= p->lacks[block];
            p->lacks[block] = 0;
        }
    }
}

/* Of one run, tile after tile, until a block rejects: the whole picture has that block, too. */
static struct verdict first_run(const struct feature *f, struct import_result *import,
                                const struct render_settings *settings, const struct reference *reference)
{
    static const uint32_t from_the_middle[] = {1, 4, 0, 2, 3, 5};
    enum { TILES = sizeof from_the_middle / sizeof *from_the_middle };
    struct render_scene *scene = made_ready(f, import, settings);
    struct film *film = wanted_film(f);
    static struct picture picture;
    static float values[VALUES];
    struct verdict v = {.p = 1};

    assert_int_equal(film_tile_count(film), TILES);
    picture.lacking = BLOCKS;
    memset(picture.lacks, 1, sizeof picture.lacks);
    for (int i = 0; i < TILES && !(v.p < BITE); i++) {
        render_one(f, scene, from_the_middle[i], film);
        film_develop(film, values);
        picture.runs = 0;
        memset(picture.values, 0, sizeof picture.values);
        picture_add(&picture, values, reference);
        picture_gains(&picture, from_the_middle[i]);
        v = compare(&picture, reference);
    }
    render_scene_free(scene);
    film_free(film);
    return v;
}

/* The scene without the effect is not the reference's. */
static void test_bite(const struct feature *f, const struct bite *bite, const struct reference *reference)
{
    struct render_settings settings = settings_of(f, TEST_SEED);
    static struct picture picture;
    struct import_result import;
    struct verdict v;
    uint64_t before, after, bit = bite->effect >= 0 ? (uint64_t)1 << bite->effect : 0;

    import_feature(f, &import);
    before = scene_effects(&import.scene, &settings, f->frame, NULL);
    if (bit & ~before)
        fail_msg("%s: %s is not among its effects", f->path, effect_name(bite->effect));
    if (bite->edit)
        bite->edit(&import.scene);
    else if (bite->set)
        bite->set(&settings);
    else
        settings.without = bit;
    assert_int_equal(settings.without & ~EFFECTS_SWITCHABLE, 0);
    after = scene_effects(&import.scene, &settings, f->frame, NULL);
    if (bit & after)
        fail_msg("%s, %s: the effect is still there", f->path, bite->what);
    v = first_run(f, &import, &settings, reference);
    memset(&picture, 0, sizeof picture);
    while (!(v.p < BITE) && picture.runs < f->runs) {
        picture_run(&picture, f, &import, &settings, reference);
        v = compare(&picture, reference);
    }
    if (!(v.p < BITE))
        fail_msg("%s, %s: the picture is the same (p = %.2g, z = %.1f)", f->path, bite->what, v.p, v.z);
    import_result_release(&import);
}

/* One wrong pixel is found, which its block hides. */
static void expect_one_pixel(struct picture *picture, const struct reference *reference)
{
    const size_t at = 3 * (HEIGHT / 2 * WIDTH + WIDTH / 2);
    struct verdict v;

    for (size_t c = 0; c < 3; c++)
        picture->values[at + c].mean -= 10 * reference->deviation[at + c] / sqrt(picture->runs);
    v = compare(picture, reference);
    assert_true(v.p >= SIGNIFICANCE);
    assert_true(v.pixel_p < BITE);
    assert_int_equal(v.pixel / 3, at / 3);
}

static void test_feature(void **state)
{
    const struct feature *f = *state;
    struct render_settings settings = settings_of(f, TEST_SEED);
    static struct reference reference;
    static struct picture picture;
    struct import_result import;
    struct verdict v;

    import_feature(f, &import);
    reference_read(f, &reference);
    picture_render(&picture, f, &import, &settings, &reference);
    import_result_release(&import);
    v = compare(&picture, &reference);
    if (v.pixel_p < SIGNIFICANCE)
        fail_msg("%s: p = %.2g; pixel (%zu, %zu), channel %zu: %.5g, expected %.5g (z = %.1f)", f->path, v.pixel_p,
                 v.pixel / 3 % WIDTH, v.pixel / 3 / WIDTH, v.pixel % 3, picture.values[v.pixel].mean,
                 reference.mean[v.pixel], v.pixel_z);
    if (v.p < SIGNIFICANCE)
        fail_msg("%s: p = %.2g; block %zu, channel %zu: %.5g, expected %.5g (z = %.1f)", f->path, v.p, v.block,
                 v.channel, v.seen, v.expected, v.z);
    assert_non_null(f->bites[0].what);
    for (const struct bite *bite = f->bites; bite < f->bites + BITES_MAX && bite->what; bite++)
        test_bite(f, bite, &reference);
    if (f == features)
        expect_one_pixel(&picture, &reference);
}

/* No effect is without a scene that calls for it and shows that it is missing. */
static void test_all_effects(void **state)
{
    uint64_t covered = 0;

    (void)state;
    for (size_t i = 0; i < FEATURES; i++)
        for (size_t k = 0; k < BITES_MAX && features[i].bites[k].what; k++)
            if (features[i].bites[k].effect >= 0)
                covered |= (uint64_t)1 << features[i].bites[k].effect;
    for (int bit = 0; bit < EFFECT_COUNT; bit++)
        if (!(covered >> bit & 1))
            fail_msg("no scene is tested without %s", effect_name((enum effect_bit)bit));
}

/* ---- by hand ------------------------------------------------------------------------------- */

static void try_seeds(const struct feature *f, uint64_t seeds)
{
    static struct reference reference;
    static struct picture picture;
    struct import_result import;
    double most = 0, pixel = 0, least = 1;
    int rejected = 0;

    import_feature(f, &import);
    reference_read(f, &reference);
    for (uint64_t k = 0; k < seeds; k++) {
        struct render_settings settings = settings_of(f, OTHER_SEED + 100 * k);
        struct verdict v;
        picture_render(&picture, f, &import, &settings, &reference);
        v = compare(&picture, &reference);
        most = fmax(most, fabs(v.z));
        pixel = fmax(pixel, fabs(v.pixel_z));
        least = fmin(least, fmin(v.p, v.pixel_p));
        rejected += v.p < SIGNIFICANCE || v.pixel_p < SIGNIFICANCE;
    }
    printf("%-42s largest z %5.2f, of a pixel %5.2f, least p %.2g, %d of %d rejected\n", f->path, most, pixel, least,
           rejected, (int)seeds);
    fflush(stdout);
    import_result_release(&import);
}

/* Is the scene named after the options, or is none? */
static int is_wanted(const struct feature *f, char **names)
{
    char name[64];

    feature_name(f, name);
    for (char **n = names; *n; n++)
        if (strcmp(*n, name) == 0)
            return 1;
    return !*names;
}

int main(int argc, char **argv)
{
    struct CMUnitTest tests[FEATURES + 1] = {cmocka_unit_test(test_all_effects)};
    int write = argc > 1 && strcmp(argv[1], "--write") == 0;
    int seeds = argc > 2 && strcmp(argv[1], "--seeds") == 0 ? atoi(argv[2]) : 0;

    for (size_t i = 0; i < FEATURES; i++) {
        tests[i + 1] = (struct CMUnitTest){strrchr(features[i].path, '/') + 1, test_feature, NULL,
                                           NULL, (void *)(uintptr_t)&features[i]};
        if (write && is_wanted(&features[i], argv + 2))
            reference_write(&features[i]);
        if (seeds > 0 && is_wanted(&features[i], argv + 3))
            try_seeds(&features[i], (uint64_t)seeds);
    }
    return write || seeds > 0 ? 0 : cmocka_run_group_tests_name("features", tests, NULL, NULL);
}
