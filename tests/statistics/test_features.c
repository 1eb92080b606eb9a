/* Every effect has a small scene in scenes/features, and every such picture is compared with a
 * reference picture that comes with its standard error.
 *
 *   test_features               the tests
 *   test_features --write [NAME...]   make the references anew (all, or these), some minutes
 *
 * A reference (tests/statistics/references/NAME.exr) is the mean of REFERENCE_RUNS renders by
 * the general kernel with seeds of their own, and the standard deviation of one such render,
 * pixel by pixel. A test renders the scene once more, by the kernel that it would be rendered
 * with, and compares blocks of 4 x 4 pixels, channel by channel, by z-tests: a block's mean is
 * nearly normal where a pixel's is not. Pixels are independent of one another, so a block's
 * variance is the mean of its pixels' over 16; it has a floor for what the file's half floats
 * cannot say.
 * The family-wise significance is 0.01 over all blocks of all scenes, by Sidak's correction.
 *
 * Each comparison must also be able to fail: with the effect switched off (settings.without), or
 * with its parameter changed where it cannot be, the same test must reject, by far. */
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
#include "common/base/file.h"
#include "common/image/image.h"
#include "common/scene/effects.h"
#include "common/scene/kernel_sets.h"
#include "tests/support/exr_channels.h"
#include "tests/support/scene_builder.h"
#include "tests/support/statistics.h"

enum {
    WIDTH = 48,
    HEIGHT = 32,
    BLOCK = 4,
    BLOCKS = WIDTH / BLOCK * (HEIGHT / BLOCK),
    VALUES = WIDTH * HEIGHT * 3,
    SPP = 32,
    REFERENCE_RUNS = 128,
    REFERENCE_SEED = 1000, /* and those that follow; the tests' is another */
};
#define SIGNIFICANCE 0.01
/* A picture without its effect must be off by this many standard errors somewhere. */
#define BITE 10
/* Share of a block's mean, and radiance: what rounding to half may do to a reference. */
#define FLOOR_SHARE 1e-3
#define FLOOR 1e-4

#define SCENES "scenes/features/"
#define REFERENCES "tests/statistics/references/"

typedef void edit_fn(struct scene *scene);

struct feature {
    const char *file;       /* in scenes/features */
    uint64_t effects;       /* all of these are called for */
    const char *kernel;     /* and this variant renders it */
    uint64_t without;       /* what is switched off to see whether that shows; 0: `edit` */
    edit_fn *edit;          /* or: a parameter that is changed */
    uint32_t frame;         /* of an animation, 24 a second */
    float shutter;          /* of a glTF's camera */
};

#define BIT(name) KERNEL_BIT(name)

/* ---- what is changed where nothing can be switched off ------------------------------------- */

static void rougher(struct scene *scene)
{
    for (uint32_t i = 0; i < scene->material_count; i++) {
        struct scene_material *m = &scene->materials[i];
        if (m->metallic > 0 || m->transmission > 0 || m->kind == MATERIAL_CONDUCTOR)
            m->roughness = fminf(1, m->roughness + 0.1f);
    }
}

static void other_metal(struct scene *scene)
{
    for (uint32_t i = 0; i < scene->material_count; i++)
        for (int c = 0; c < 3; c++)
            scene->materials[i].conductor_k[c] *= 0.7f;
}

static void less_specular(struct scene *scene)
{
    for (uint32_t i = 0; i < scene->material_count; i++)
        scene->materials[i].specular *= 0.7f;
}

static void brighter_unlit(struct scene *scene)
{
    for (uint32_t i = 0; i < scene->material_count; i++)
        if (scene->materials[i].unlit)
            scene->materials[i].base_color[0] *= 1.05f;
}

static void brighter_lamps(struct scene *scene)
{
    for (uint32_t i = 0; i < scene->material_count; i++)
        for (int c = 0; c < 3; c++)
            scene->materials[i].emission[c] *= 1.05f;
}

static void other_mix(struct scene *scene)
{
    for (uint32_t i = 0; i < scene->material_count; i++)
        if (scene->materials[i].kind == MATERIAL_MIX)
            scene->materials[i].mix_amount *= 0.7f;
}

static void uncoated(struct scene *scene)
{
    for (uint32_t i = 0; i < scene->material_count; i++) {
        scene->materials[i].base_interreflection = 0;
        scene->materials[i].thin_slab = 0;
    }
}

static void turned_camera(struct scene *scene)
{
    for (int r = 0; r < 3; r++) {
        float *row = scene->cameras[0].to_world.m[r], x = row[0], z = row[2];
        row[0] = 0.995f * x + 0.0998f * z;
        row[2] = 0.995f * z - 0.0998f * x;
    }
}

static void half_density(struct scene *scene)
{
    for (uint32_t i = 0; i < scene->medium_count; i++)
        if (scene->media[i].has_grid)
            for (int c = 0; c < 3; c++) {
                scene->media[i].absorption[c] *= 0.7f;
                scene->media[i].scattering[c] *= 0.7f;
            }
}

static void first_frame(struct scene *scene)
{
    for (uint32_t i = 0; i < scene->channel_count; i++)
        scene->channels[i].key_count = 1;
}

static const struct feature features[] = {
#include "tests/statistics/test_features.inc"
};
enum { FEATURES = sizeof features / sizeof *features };

/* ---- rendering ----------------------------------------------------------------------------- */

static status find_blob(void *user, const struct digest *digest, const uint8_t **data,
                        size_t *size_bytes, struct error *err)
{
    const struct import_result *import = user;

    for (size_t i = 0; i < import->blob_count; i++)
        if (digest_equal(&import->blobs[i].digest, digest)) {
            *data = import->blobs[i].data;
            *size_bytes = import->blobs[i].size_bytes;
            return STATUS_OK;
        }
    return error_set(err, STATUS_ERR_NOT_FOUND, "a blob is missing");
}

static void import_feature(const struct feature *f, struct import_result *import)
{
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct error err = {0};
    char path[256];

    snprintf(path, sizeof path, SCENES "%s", f->file);
    if (import_scene(path, &options, import, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    if (import->warning_count > 0)
        fail_msg("%s: %s", f->file, import->warnings[0]);
}

static struct render_settings settings_of(const struct feature *f, uint64_t seed)
{
    struct render_settings s = builder_settings(WIDTH, HEIGHT, SPP);

    s.seed = seed;
    s.fps = 24;
    s.shutter = f->shutter;
    return s;
}

/* The picture [HEIGHT][WIDTH][3]; *kernel, if not NULL, is the variant that made it. */
static void render(const struct feature *f, struct import_result *import,
                   const struct render_settings *settings, double *picture, const char **kernel)
{
    struct render_stats stats = {0};
    struct render_scene *scene;
    struct error err = {0};

    if (scene_validate(&import->scene, &err) != STATUS_OK ||
        render_scene_new(&scene, &import->scene, settings, f->frame,
                         (struct blob_source){find_blob, import}, &err) != STATUS_OK)
        fail_msg("%s: %s", f->file, err.text);
    builder_render(scene, settings, f->frame, picture, NULL, &stats);
    assert_int_equal(stats.dropped_samples, 0);
    if (kernel)
        *kernel = render_kernel_variant(scene);
    render_scene_free(scene);
}

/* ---- references ---------------------------------------------------------------------------- */

struct reference {
    double mean[VALUES];
    double deviation[VALUES]; /* of one render of SPP samples */
};

static const char *const deviation_names[3] = {"deviation.R", "deviation.G", "deviation.B"};

static void reference_path(const struct feature *f, char path[256])
{
    snprintf(path, 256, REFERENCES "%.*s.exr", (int)strcspn(f->file, "."), f->file);
}

static void deviation_lines(void *user, uint32_t y, uint32_t height, float *planes)
{
    const struct reference *r = user;

    for (uint32_t c = 0; c < 3; c++)
        for (uint32_t i = 0; i < height * WIDTH; i++)
            planes[c * height * WIDTH + i] = (float)r->deviation[(y * WIDTH + i) * 3 + c];
}

static void reference_write(const struct feature *f)
{
    static struct reference r;
    static struct running_stats stats[VALUES];
    static float pixels[VALUES];
    const struct exr_channel channels[3] = {{deviation_names[0], 0}, {deviation_names[1], 0},
                                            {deviation_names[2], 0}};
    const struct exr_channels more = {channels, 3, deviation_lines, &r};
    const struct exr_options options = {.half = 1, .more = &more};
    struct image image = {WIDTH, HEIGHT, 3, pixels};
    struct buffer bytes = BUFFER_INIT;
    struct import_result import;
    struct error err = {0};
    double picture[VALUES];
    char path[256];

    memset(stats, 0, sizeof stats);
    import_feature(f, &import);
    render_force_general(1);
    for (uint64_t k = 0; k < REFERENCE_RUNS; k++) {
        struct render_settings settings = settings_of(f, REFERENCE_SEED + k);
        render(f, &import, &settings, picture, NULL);
        for (size_t i = 0; i < VALUES; i++)
            running_stats_add(&stats[i], picture[i]);
    }
    render_force_general(0);
    for (size_t i = 0; i < VALUES; i++) {
        pixels[i] = (float)stats[i].mean;
        r.deviation[i] = sqrt(running_stats_variance(&stats[i]));
    }
    reference_path(f, path);
    if (exr_encode(&bytes, &image, &options, &err) != STATUS_OK ||
        file_write_atomic(path, bytes.data, bytes.size, &err) != STATUS_OK) {
        fprintf(stderr, "test_features: %s\n", err.text);
        exit(1);
    }
    printf("%s: %zu bytes\n", path, bytes.size);
    fflush(stdout);
    buffer_release(&bytes);
    import_result_release(&import);
}

static void reference_read(const struct feature *f, struct reference *r)
{
    static const char *const names[2][3] = {{"R", "G", "B"},
                                            {"deviation.R", "deviation.G", "deviation.B"}};
    struct buffer bytes = BUFFER_INIT;
    struct error err = {0};
    char path[256];

    reference_path(f, path);
    if (file_read(path, 1 << 20, &bytes, &err) != STATUS_OK)
        fail_msg("%s (test_features --write makes it)", err.text);
    for (int k = 0; k < 2; k++)
        for (size_t c = 0; c < 3; c++) {
            float *plane = exr_channel_read(bytes.data, bytes.size, names[k][c], NULL);
            assert_non_null(plane);
            for (size_t i = 0; i < WIDTH * HEIGHT; i++)
                (k ? r->deviation : r->mean)[3 * i + c] = (double)plane[i];
            free(plane);
        }
    buffer_release(&bytes);
}

/* ---- comparing ----------------------------------------------------------------------------- */

struct verdict {
    double z;       /* the largest, by size */
    size_t block, channel;
    double seen, expected;
};

static struct verdict compare(const double *picture, const struct reference *r)
{
    struct verdict worst = {0};

    for (size_t block = 0; block < BLOCKS; block++)
        for (size_t c = 0; c < 3; c++) {
            size_t x0 = block % (WIDTH / BLOCK) * BLOCK, y0 = block / (WIDTH / BLOCK) * BLOCK;
            double seen = 0, expected = 0, variance = 0, floor, z;
            for (size_t i = 0; i < BLOCK * BLOCK; i++) {
                size_t at = ((y0 + i / BLOCK) * WIDTH + x0 + i % BLOCK) * 3 + c;
                seen += picture[at] / (BLOCK * BLOCK);
                expected += r->mean[at] / (BLOCK * BLOCK);
                variance += pow(r->deviation[at] / (BLOCK * BLOCK), 2);
            }
            floor = FLOOR + FLOOR_SHARE * fabs(expected);
            z = (seen - expected) /
                sqrt(variance * (1 + 1.0 / REFERENCE_RUNS) + floor * floor);
            if (fabs(z) > fabs(worst.z))
                worst = (struct verdict){z, block, c, seen, expected};
        }
    return worst;
}

static void test_feature(void **state)
{
    const struct feature *f = *state;
    struct render_settings settings = settings_of(f, 1);
    double limit = -normal_quantile(sidak_alpha(SIGNIFICANCE, FEATURES * BLOCKS * 3) / 2);
    static struct reference reference;
    struct import_result import;
    double picture[VALUES];
    const char *kernel;
    struct verdict v;
    uint64_t effects;

    import_feature(f, &import);
    reference_read(f, &reference);
    effects = scene_effects(&import.scene, &settings, f->frame, NULL);
    if (f->effects & ~effects)
        fail_msg("%s: %s is not among its effects", f->file,
                 effect_name((enum effect_bit)__builtin_ctzll(f->effects & ~effects)));
    render(f, &import, &settings, picture, &kernel);
    assert_string_equal(kernel, f->kernel);
    v = compare(picture, &reference);
    if (fabs(v.z) > limit)
        fail_msg("%s: block %zu, channel %zu: %.5g, expected %.5g (z = %.1f, limit %.1f)", f->file,
                 v.block, v.channel, v.seen, v.expected, v.z, limit);

    settings.without = f->without;
    if (f->without) {
        assert_int_equal(f->without & ~EFFECTS_SWITCHABLE, 0);
        effects = scene_effects(&import.scene, &settings, f->frame, NULL);
        if (f->without & effects)
            fail_msg("%s: what was switched off is still among its effects", f->file);
    } else {
        f->edit(&import.scene);
    }
    render(f, &import, &settings, picture, NULL);
    v = compare(picture, &reference);
    if (!(fabs(v.z) > BITE))
        fail_msg("%s: without the effect the picture is the same (z = %.1f)", f->file, v.z);
    import_result_release(&import);
}

int main(int argc, char **argv)
{
    struct CMUnitTest tests[FEATURES];

    if (argc > 1 && strcmp(argv[1], "--write") == 0) {
        for (size_t i = 0; i < FEATURES; i++) {
            int wanted = argc == 2;
            for (int k = 2; k < argc; k++)
                wanted |= strncmp(argv[k], features[i].file, strcspn(features[i].file, ".")) == 0 &&
                          strlen(argv[k]) == strcspn(features[i].file, ".");
            if (wanted)
                reference_write(&features[i]);
        }
        return 0;
    }
    for (size_t i = 0; i < FEATURES; i++)
        tests[i] = (struct CMUnitTest){features[i].file, test_feature, NULL, NULL,
                                       (void *)(uintptr_t)&features[i]};
    return cmocka_run_group_tests_name("features", tests, NULL, NULL);
}
