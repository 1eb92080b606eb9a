#include "tests/support/invariance.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/system/file.h"
#include "common/base/memory.h"
#include "tests/support/figure.h"
#include "tests/support/imported.h"
#include "tests/support/pbrt_text.h"
#include "tests/support/groups.h"
#include "tests/support/statistics.h"

enum {
    SIDE = 48,
    BLOCK = 8,
    ACROSS = SIDE / BLOCK,
    BLOCKS = ACROSS * ACROSS,
    VALUES = SIDE * SIDE * 3,
    LEVELS = INVARIANT_TURNED + 1,
    SEED = 1,
    OTHER_SEED = 100,
};
/* Of the difference of a pixel's two groups. */
#define PIXEL_DEGREES 1
/* Two pictures that differ by less than this share are the same but for rounding, in pixels but this
 * share of them. */
#define ROUNDING_SHARE 1e-3
#define PIXELS_SHARE 0.015
/* What floats cannot say of a block, or of the picture, is no difference. */
#define NO_SHARE 1e-5
#define FOLDER "scenes/features"

struct picture {
    double mean[VALUES], apart[VALUES]; /* half the difference of its groups */
};

struct invariance {
    const char *scene;
    struct model model;
    struct model_way way;
    int has[LEVELS]; /* its reference is made when it is wanted */
    struct picture reference[LEVELS];
};

/* Of a case and of its reference. */
static uint32_t samples[LEVELS][2] = {{8, 8}, {16, 16}, {16, 16}, {32, 128}};
static int table;

void invariance_arguments(int argc, char **argv)
{
    for (int i = 1; i < argc; i++)
        if (strcmp(argv[i], "--table") == 0)
            table = 1;
        else if (atoi(argv[i]) >= 4)
            for (int k = 0; k < 2 * LEVELS; k++)
                samples[k / 2][k % 2] = (uint32_t)atoi(argv[i]) * (k == 2 * INVARIANT_TURNED + 1 ? 4 : 1);
        else {
            fprintf(stderr, "\"%s\": arguments are --table and the samples a pixel, at least 4\n", argv[i]);
            exit(2);
        }
    if (table)
        printf("| scene | written as | demanded | pixels apart, same seed | largest z of a block, of "
               "%.2f | block's largest deviation | mean's |\n|---|---|---|---:|---:|---:|---:|\n",
               normal_quantile(1 - sidak_alpha(INVARIANCE_SIGNIFICANCE, INVARIANCE_TESTS) / 2));
}

void invariance_turn(unsigned index, int mirrored, double out[3][3])
{
    struct test_random random = {1000 + index};
    double q[4], length = 0;

    for (int i = 0; i < 4; i++)
        q[i] = normal_quantile((test_random_double(&random) + 1e-9) / (1 + 2e-9));
    for (int i = 0; i < 4; i++)
        length += q[i] * q[i];
    for (int i = 0; i < 4; i++)
        q[i] /= sqrt(length);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            double product = 2 * (q[r] * q[c]), cross = 0;
            if (r != c)
                cross = 2 * q[3] * q[3 - r - c] * ((c - r + 3) % 3 == 1 ? -1 : 1);
            else
                product += 2 * q[3] * q[3] - 1;
            out[r][c] = (product + cross) * (mirrored && c == 0 ? -1 : 1);
        }
}

/* ---- a picture -------------------------------------------------------------------------------- */

static double determinant(const double a[3][3])
{
    return a[0][0] * (a[1][1] * a[2][2] - a[1][2] * a[2][1]) - a[0][1] * (a[1][0] * a[2][2] - a[1][2] * a[2][0]) +
           a[0][2] * (a[1][0] * a[2][1] - a[1][1] * a[2][0]);
}

/* glTF and OBJ know no sky: it is the user's, who turns it with the scene. (A map cannot be mirrored
 * without making another of it.) */
static void set_sky(const struct model *m, const struct model_way *way, struct scene *scene)
{
    struct scene_environment *sky = &scene->environment;

    if (!(m->sky[0] > 0))
        return;
    if (!m->sky_map)
        sky->present = sky->constant = 1;
    for (int r = 0; r < 3; r++) {
        sky->radiance[r] = (float)m->sky[r];
        for (int c = 0; m->sky_map && c < 3; c++)
            sky->to_map[r][c] = (float)way->turn[c][r];
    }
}

/* An OBJ has no camera: this is the user's. */
static void set_camera(const struct model *varied, struct scene *scene)
{
    struct scene_camera *camera = &scene->cameras[0];
    double forward[3], columns[16];

    for (int c = 0; c < 3; c++)
        forward[c] = varied->target[c] - varied->eye[c];
    model_looking(varied->eye, forward, varied->up, columns);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            camera->to_world.m[r][c] = columns[4 * c + r] - (c == 3 ? scene->origin[r] : 0);
    camera->yfov_rad = (float)varied->yfov_rad;
}

static void import_obj(const struct model *varied, struct buffer *text, struct import_result *out)
{
    const struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct buffer mtl = BUFFER_INIT;
    struct error err = {0};
    char *folder = pbrt_folder_make();
    struct buffer image = BUFFER_INIT;

    model_write_obj(varied, text, &mtl);
    assert_int_equal(file_read(FOLDER "/checker.png", 1 << 20, &image, &err), STATUS_OK);
    pbrt_folder_put(folder, "checker.png", image.data, image.size);
    pbrt_folder_put(folder, "scene.mtl", mtl.data, mtl.size);
    if (import_scene_memory(text->data, text->size, "model.obj", folder, &options, out, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    pbrt_folder_remove(folder);
    buffer_release(&image);
    buffer_release(&mtl);
}

static void import_model(const struct model *m, const struct model_way *way, struct import_result *out)
{
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct model varied;
    struct buffer text = BUFFER_INIT;
    struct error err = {0};

    model_vary(m, way, &varied);
    if (way->format == MODEL_OBJ) {
        import_obj(&varied, &text, out);
        set_camera(&varied, &out->scene);
    } else {
        int pbrt = way->format == MODEL_PBRT;
        char path[64];
        if (m->sky_map && !pbrt) {
            snprintf(path, sizeof path, FOLDER "/%s", m->sky_map);
            options.env_path = path;
        }
        (pbrt ? model_write_pbrt : model_write_gltf)(&varied, way, &text);
        if (import_scene_memory(text.data, text.size, pbrt ? "model.pbrt" : "model.gltf", FOLDER, &options, out,
                                &err) != STATUS_OK)
            fail_msg("%s", err.text);
    }
    if (way->format != MODEL_PBRT)
        set_sky(m, way, &out->scene);
    assert_int_equal(out->degenerate_triangles, 0);
    model_release(&varied);
    buffer_release(&text);
}

/* Turn the picture of a mirrored world over. */
static void turn_over(double *values)
{
    for (int i = 0; i < VALUES; i++) {
        int y = i / (3 * SIDE), x = i / 3 % SIDE, other = (y * SIDE + SIDE - 1 - x) * 3 + i % 3;
        if (x < SIDE / 2) {
            double swap = values[i];
            values[i] = values[other];
            values[other] = swap;
        }
    }
}

static void take_picture(const struct model *m, const struct model_way *way, uint64_t seed, uint32_t spp,
                         struct picture *out)
{
    struct render_settings settings = imported_settings(SIDE, SIDE, spp);
    struct render_stats stats = {0};
    struct import_result import;
    struct render_scene *scene;

    settings.seed = seed;
    settings.shutter = 0.5f;
    /* What is learned of a scaled scene has other rounding errors: other noise. */
    settings.env_sampling = ENV_SAMPLING_IMPORTANCE;
    settings.light_choice = LIGHT_CHOICE_TREE;
    import_model(m, way, &import);
    scene = imported_build(&import, &settings, 0);
    groups_render_apart(scene, &settings, 0, out->mean, out->apart, &stats);
    assert_int_equal(stats.work.dropped_samples, 0);
    render_scene_free(scene);
    import_result_release(&import);
    if (determinant(way->turn) < 0) {
        turn_over(out->mean);
        turn_over(out->apart);
    }
}

struct invariance *invariance_new(const char *scene, model_scene *model, const struct model_way *reference)
{
    struct invariance *inv = mem_calloc(1, sizeof *inv);

    assert_non_null(inv);
    inv->scene = scene;
    inv->way = *reference;
    model(&inv->model);
    return inv;
}

void invariance_free(struct invariance *inv)
{
    model_release(&inv->model);
    mem_free(inv);
}

/* ---- comparing two ---------------------------------------------------------------------------- */

/* The difference of some pixels' channel, its variance, and the sum of squares for the degrees of freedom. */
struct estimate {
    double sum, variance, squares;
    double reference;
};

/* Of a pixel. */
static void add_variance(struct estimate *e, double apart)
{
    e->variance += apart * apart;
    /* The square of a variance with d degrees of freedom is on average 1 + 2 / d times as large. */
    e->squares += apart * apart * apart * apart / (PIXEL_DEGREES + 2);
}

static void estimate_add(struct estimate *e, const struct picture *a, const struct picture *b, int at, int paired)
{
    e->sum += a->mean[at] - b->mean[at];
    e->reference += b->mean[at];
    add_variance(e, a->apart[at] - (paired ? b->apart[at] : 0));
    if (!paired)
        add_variance(e, b->apart[at]);
}

struct difference {
    double p_value, z; /* the z of the same probability */
    double share;      /* of the reference's mean */
};

static struct difference student(const struct estimate *e)
{
    struct difference d = {1, 0, 0};
    double apart = fabs(e->sum);

    if (apart == 0)
        return d;
    d.share = apart / fmax(fabs(e->reference), DBL_MIN);
    if (d.share <= NO_SHARE)
        return d;
    d.p_value = e->variance > 0 ? 2 * student_cdf(-apart / sqrt(e->variance), e->variance * e->variance / e->squares) : 0;
    d.z = d.p_value <= 1e-300 ? 37 : d.p_value >= 1 ? 0 : -normal_quantile(d.p_value / 2);
    return d;
}

struct result {
    struct difference block, mean; /* the worst */
    double deviation;              /* the largest share by which a block differs */
    double pixels_apart;           /* share */
    unsigned numbers_apart;        /* not equal to the bit */
};

static void compare_blocks(const struct picture *a, const struct picture *b, int paired, struct result *out)
{
    for (int c = 0; c < 3; c++) {
        struct estimate all = {0};
        struct difference d;
        for (int k = 0; k < BLOCKS; k++) {
            struct estimate of = {0};
            for (int i = 0; i < BLOCK * BLOCK; i++) {
                int y = k / ACROSS * BLOCK + i / BLOCK, x = k % ACROSS * BLOCK + i % BLOCK;
                estimate_add(&of, a, b, (y * SIDE + x) * 3 + c, paired);
                estimate_add(&all, a, b, (y * SIDE + x) * 3 + c, paired);
            }
            d = student(&of);
            if (d.p_value < out->block.p_value)
                out->block = d;
            out->deviation = fmax(out->deviation, d.share);
        }
        d = student(&all);
        if (d.p_value < out->mean.p_value || c == 0)
            out->mean = d;
    }
}

static void compare_bits(const struct picture *a, const struct picture *b, struct result *out)
{
    unsigned apart = 0;

    for (int i = 0; i < VALUES; i++) {
        out->numbers_apart += a->mean[i] != b->mean[i];
        if (i % 3 == 2) {
            double difference = 0, size = 0;
            for (int c = 0; c < 3; c++) {
                difference = fmax(difference, fabs(a->mean[i - c] - b->mean[i - c]));
                size = fmax(size, fabs(b->mean[i - c]));
            }
            apart += difference > ROUNDING_SHARE * size;
        }
    }
    out->pixels_apart = (double)apart / (SIDE * SIDE);
}

static void put_row(const struct invariance *inv, const char *what, enum invariance_level level, const struct result *r)
{
    static const char *const levels[] = {"bits", "rounding", "noise", "noise"};

    printf("| %s | %s | %s | ", inv->scene, what, levels[level]);
    if (r->numbers_apart == 0)
        printf("none, to the bit |");
    else
        printf("%.2g %% |", 100 * r->pixels_apart);
    if (level == INVARIANT_BITS && r->numbers_apart == 0)
        printf(" | | |\n");
    else
        printf(" %.2f | %.2g %% | %.2g %% |\n", r->block.z, 100 * r->deviation, 100 * r->mean.share);
    fflush(stdout);
}

static void judge(const struct invariance *inv, const char *what, enum invariance_level level, const struct result *r)
{
    double limit = normal_quantile(1 - sidak_alpha(INVARIANCE_SIGNIFICANCE, INVARIANCE_TESTS) / 2);
    char name[160], words[64];

    if (level == INVARIANT_BITS) {
        snprintf(name, sizeof name, "%s, %s: numbers that differ", inv->scene, what);
        figure_within(name, r->numbers_apart, 0, 0, "exact");
        return;
    }
    if (level == INVARIANT_ROUNDING) {
        snprintf(name, sizeof name, "%s, %s: share of pixels apart", inv->scene, what);
        figure_within(name, r->pixels_apart, 0, PIXELS_SHARE, "by more than 1e-3, same seed");
    }
    snprintf(words, sizeof words, "significance %g over %d tests", INVARIANCE_SIGNIFICANCE, INVARIANCE_TESTS);
    snprintf(name, sizeof name, "%s, %s: largest z of a block", inv->scene, what);
    figure_within(name, r->block.z, 0, limit, words);
    snprintf(name, sizeof name, "%s, %s: z of the mean", inv->scene, what);
    figure_within(name, r->mean.z, 0, limit, words);
}

static const struct picture *reference_of(struct invariance *inv, enum invariance_level level)
{
    if (!inv->has[level])
        take_picture(&inv->model, &inv->way, level == INVARIANT_TURNED ? OTHER_SEED : SEED, samples[level][1],
                     &inv->reference[level]);
    inv->has[level] = 1;
    return &inv->reference[level];
}

void invariance_check(struct invariance *inv, const char *what, const struct model_way *way,
                      enum invariance_level level)
{
    static unsigned tests;
    struct picture *picture = mem_calloc(1, sizeof *picture);
    const struct picture *reference;
    struct result result = {.block = {1, 0, 0}, .mean = {1, 0, 0}};

    assert_non_null(picture);
    tests += 3 * (BLOCKS + 1);
    assert_true(tests <= INVARIANCE_TESTS / 4); /* there are four programs */
    reference = reference_of(inv, level);
    take_picture(&inv->model, way, SEED, samples[level][0], picture);
    compare_bits(picture, reference, &result);
    compare_blocks(picture, reference, level != INVARIANT_TURNED, &result);
    mem_free(picture);
    if (table)
        put_row(inv, what, level, &result);
    else
        judge(inv, what, level, &result);
}
