/* denoised: a scene's pictures before and after denoising, against the truth: one line of CSV for each seed and number
 * of samples, as in docs/DENOISING.md.
 *
 *   denoised SCENE --cache FILE [--size WxH] [--seeds N] [--reference-spp N] [--fast] [--pictures PREFIX]
 *
 * What is rendered is kept in FILE and used again if it is there. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/accuracy/quantile.h"
#include "common/base/memory.h"
#include "common/cli/options.h"
#include "common/denoise/denoise.h"
#include "common/image/color.h"
#include "common/image/image.h"
#include "common/system/clock.h"
#include "common/system/file.h"
#include "tests/support/imported.h"

enum {
    LEVELS = 3,
    REFERENCE_SEED = 1000000,
};
static const uint32_t level_spp[LEVELS] = {16, 64, 256};

enum { PLANES = 4 };
/* Of one group: radiance [height][width][3], then AOV_FOR_DENOISING in its order. */
struct shot {
    float *planes[PLANES];
};

struct recorded {
    uint32_t width, height, seeds, reference_spp;
    float *reference[2];
    struct shot *shots; /* [seeds][LEVELS][2] */
    uint64_t effects;
    double brightest, cpu_s;
};

static _Noreturn void die(const char *text)
{
    fprintf(stderr, "denoised: %s\n", text);
    exit(2);
}

static float *values_of(const struct recorded *r)
{
    float *values = mem_calloc((size_t)r->width * r->height * 3, sizeof(float));

    if (!values)
        die("out of memory");
    return values;
}

/* ---- rendering -------------------------------------------------------------------------------- */

/* Sums of `planes` pictures, beginning with radiance, as means into `shot`. */
static void keep_tile(const struct recorded *r, struct tile_rect rect, const double *sums, int planes, double samples,
                      struct shot *shot)
{
    const size_t pixels = (size_t)rect.width * rect.height;

    for (int k = 0; k < planes; k++)
        for (size_t i = 0; i < pixels * 3; i++) {
            const double count = (k == 1 || k == 2) && samples > FEATURE_SAMPLES ? FEATURE_SAMPLES : samples;
            const size_t x = rect.x + i / 3 % rect.width, y = rect.y + i / 3 / rect.width;
            shot->planes[k][(y * r->width + x) * 3 + i % 3] = (float)(sums[(size_t)k * pixels * 3 + i] / count);
        }
}

/* All passes of a group on a tile; what levels have on the way into shots[level][2]. */
static void render_group(const struct recorded *r, const struct render_scene *scene, uint32_t spp, uint32_t aovs,
                         uint32_t tile, uint32_t group, struct shot *shots, uint32_t levels)
{
    static float sums[TILE_FLOATS_MAX];
    static double total[TILE_FLOATS_MAX];
    const struct tile_rect rect = tile_rect_of(r->width, r->height, tile);
    const size_t values = (size_t)rect.width * rect.height * 3;
    struct render_stats stats = {0};

    memset(total, 0, sizeof total);
    for (uint32_t pass = 0; pass < pass_count(spp, group); pass++) {
        uint32_t begin, end;
        const size_t count = render_tile(scene, 0, tile, group, pass, sums, NULL, &stats);
        pass_range(spp, group, pass, &begin, &end);
        for (size_t i = 0; i < count; i++) { /* later passes have no features: emission follows radiance */
            const size_t plane = i / values, has = pass < FEATURE_PASSES || plane == 0 ? plane : PLANES - 1;
            total[has * values + i % values] += (double)sums[i];
        }
        for (uint32_t level = 0; level < levels; level++)
            if (end == (levels == 1 ? spp : level_spp[level]) / 2)
                keep_tile(r, rect, total, aovs ? PLANES : 1, end, &shots[level * 2 + group]);
    }
}

static void render_shots(const struct recorded *r, struct import_result *import, uint64_t seed, uint32_t spp,
                         uint32_t aovs, struct shot *shots, uint32_t levels)
{
    struct render_settings settings = imported_settings(r->width, r->height, spp);
    struct render_scene *scene;

    settings.seed = seed;
    settings.aovs = aovs;
    scene = imported_build(import, &settings, 0);
    for (uint32_t tile = 0; tile < tile_count(r->width, r->height); tile++)
        for (uint32_t group = 0; group < 2; group++)
            render_group(r, scene, spp, aovs, tile, group, shots, levels);
    render_scene_free(scene);
}

static void recorded_new(struct recorded *r)
{
    r->shots = mem_calloc((size_t)r->seeds * LEVELS * 2, sizeof *r->shots);
    if (!r->shots)
        die("out of memory");
    for (int g = 0; g < 2; g++)
        r->reference[g] = values_of(r);
    for (size_t i = 0; i < (size_t)r->seeds * LEVELS * 2; i++)
        for (int k = 0; k < PLANES; k++)
            r->shots[i].planes[k] = values_of(r);
}

static void record(struct recorded *r, const char *scene_path)
{
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct import_result import;
    struct error err = {0};
    struct shot reference[2] = {{{r->reference[0]}}, {{r->reference[1]}}};

    if (import_scene(scene_path, &options, &import, &err) != STATUS_OK)
        die(err.text);
    for (uint32_t seed = 0; seed < r->seeds; seed++)
        render_shots(r, &import, seed + 1, level_spp[LEVELS - 1], AOV_FOR_DENOISING, r->shots + (size_t)seed * LEVELS * 2, LEVELS);
    render_shots(r, &import, REFERENCE_SEED, r->reference_spp, 0, reference, 1);
    import_result_release(&import);
}

/* Read or write everything. */
static int transfer(struct recorded *r, FILE *file, int out)
{
    const size_t count = (size_t)r->width * r->height * 3;
    uint32_t head[4] = {r->width, r->height, r->seeds, r->reference_spp}, found[4];
    int good = out ? fwrite(head, sizeof head, 1, file) == 1
                   : fread(found, sizeof found, 1, file) == 1 && memcmp(head, found, sizeof head) == 0;

    for (int g = 0; g < 2 && good; g++)
        good = (out ? fwrite(r->reference[g], sizeof(float), count, file)
                    : fread(r->reference[g], sizeof(float), count, file)) == count;
    for (size_t i = 0; i < (size_t)r->seeds * LEVELS * 2; i++)
        for (int k = 0; k < PLANES && good; k++)
            good = (out ? fwrite(r->shots[i].planes[k], sizeof(float), count, file)
                        : fread(r->shots[i].planes[k], sizeof(float), count, file)) == count;
    return good;
}

static void recorded_make(struct recorded *r, const char *scene_path, const char *cache)
{
    FILE *file = fopen(cache, "rb");

    recorded_new(r);
    if (file && transfer(r, file, 0)) {
        fclose(file);
        return;
    }
    if (file)
        fclose(file);
    record(r, scene_path);
    file = fopen(cache, "wb");
    if (!file || !transfer(r, file, 1) || fclose(file) != 0)
        die("cannot write the cache");
}

/* ---- judging ---------------------------------------------------------------------------------- */

static status srgb_codes(void *user, const float *rgb, uint32_t width, uint32_t height, float *codes, struct error *err)
{
    const float gain = *(const float *)user;

    (void)err;
    for (size_t i = 0; i < (size_t)width * height * 3; i++)
        codes[i] = 255 * srgb_encode(rgb[i] * gain);
    return STATUS_OK;
}

struct errors {
    double display, rms, rmse_percent;
};

/* Of a picture against the reference, whose own noise is taken off the RMSE. */
static struct errors errors_of(const struct recorded *r, const float *picture, float gain)
{
    const size_t pixels = (size_t)r->width * r->height;
    float *truth = values_of(r), *shown = values_of(r), *right = values_of(r), *largest = values_of(r);
    double squares = 0, codes = 0, mean = 0;
    struct errors out;

    for (size_t i = 0; i < pixels * 3; i++) {
        const double d = ((double)r->reference[0][i] - (double)r->reference[1][i]) / 2;
        truth[i] = (r->reference[0][i] + r->reference[1][i]) / 2;
        mean += (double)truth[i] / (double)(pixels * 3);
        squares += ((double)picture[i] - (double)truth[i]) * ((double)picture[i] - (double)truth[i]) - d * d;
    }
    if (srgb_codes(&gain, picture, r->width, r->height, shown, NULL) != STATUS_OK ||
        srgb_codes(&gain, truth, r->width, r->height, right, NULL) != STATUS_OK)
        die("codes");
    for (size_t p = 0; p < pixels; p++)
        for (size_t c = 0; c < 3; c++) {
            const float d = fabsf(shown[p * 3 + c] - right[p * 3 + c]);
            codes += (double)(d * d);
            largest[p] = d > largest[p] ? d : largest[p];
        }
    out.display = (double)quantile_select(largest, pixels, (size_t)((double)(pixels - 1) * 0.95));
    out.rms = sqrt(codes / (double)(pixels * 3));
    out.rmse_percent = squares > 0 ? 100 * sqrt(squares / (double)(pixels * 3)) / mean : 0;
    mem_free(largest);
    mem_free(right);
    mem_free(shown);
    mem_free(truth);
    return out;
}

static void write_picture(const struct recorded *r, const float *rgb, float gain, const char *prefix, const char *name)
{
    struct image8 image = {.width = r->width, .height = r->height, .channels = 3, .bits = 8};
    struct buffer file = {0};
    struct error err = {0};
    char path[512];

    image.pixels = mem_alloc((size_t)r->width * r->height * 3);
    for (size_t i = 0; image.pixels && i < (size_t)r->width * r->height * 3; i++)
        image.pixels[i] = (uint8_t)(255 * srgb_encode(rgb[i] * gain) + 0.5f);
    snprintf(path, sizeof path, "%s%s.png", prefix, name);
    if (!image.pixels || png_encode_8(&file, &image, 0, &err) != STATUS_OK ||
        file_write_atomic(path, file.data, file.size, &err) != STATUS_OK)
        die(err.text);
    buffer_release(&file);
    mem_free(image.pixels);
}

static void measure(const struct recorded *r, const char *scene, uint32_t seed, uint32_t level, int fast,
                    const char *pictures)
{
    const size_t values = (size_t)r->width * r->height * 3;
    const struct shot *shot = &r->shots[((size_t)seed * LEVELS + level) * 2];
    float *raw = values_of(r), gain;
    struct denoise_input input = {.width = r->width, .height = r->height,
                                  .groups = {shot[0].planes[0], shot[1].planes[0]},
                                  .albedo = {shot[0].planes[1], shot[1].planes[1]},
                                  .normal = {shot[0].planes[2], shot[1].planes[2]},
                                  .direct = {shot[0].planes[3], shot[1].planes[3]}};
    struct accuracy_transform transform = {.apply = srgb_codes, .user = &gain};
    struct accuracy_evidence evidence = {.samples = level_spp[level]};
    struct denoise_options options = {.method = fast ? DENOISE_FAST : DENOISE_FULL, .threads = 1, .transform = &transform,
                                      .evidence = &evidence};
    struct denoise_result result;
    struct error err = {0};
    struct errors before, after;
    double mean = 0;
    uint64_t start;

    for (size_t i = 0; i < values; i++) {
        raw[i] = (shot[0].planes[0][i] + shot[1].planes[0][i]) / 2;
        mean += (double)(r->reference[0][i] + r->reference[1][i]) / 2 / (double)values;
    }
    gain = mean > 0 ? (float)(0.18 / mean) : 1;
    start = clock_thread_cpu_ns();
    if (denoise(&input, &options, &result, &err) != STATUS_OK)
        die(err.text);
    start = clock_thread_cpu_ns() - start;
    before = errors_of(r, raw, gain);
    after = errors_of(r, result.image, gain);
    printf("%s,%u,%u,%.4g,%.4g,%.4g,%.4g,%.4g,%.4g,%.4g,%.4g,%.4g,%.4g,%.4g,%d,%u,%.4g,%.4g\n", scene, seed + 1,
           level_spp[level], before.display, after.display, result.figures.display_error, before.rms, after.rms,
           255 * pow(10, -result.figures.psnr_db / 20), before.rmse_percent, after.rmse_percent,
           result.figures.rmse_percent, result.figures.display_lo, result.figures.display_hi, result.figures.reliable,
           result.figures.reasons, (double)result.counts.raw / result.counts.tiles,
           (double)start * 1e-3 / (double)(values / 3));
    fflush(stdout);
    if (pictures) {
        char name[64];
        snprintf(name, sizeof name, "%s-%u-raw", scene, level_spp[level]);
        write_picture(r, raw, gain, pictures, name);
        snprintf(name, sizeof name, "%s-%u-%s", scene, level_spp[level], fast ? "fast" : "full");
        write_picture(r, result.image, gain, pictures, name);
        snprintf(name, sizeof name, "%s-truth", scene);
        write_picture(r, r->reference[0], gain, pictures, name);
    }
    denoise_result_release(&result);
    mem_free(raw);
}

int main(int argc, char **argv)
{
    const char *size = "128x96", *cache = NULL, *pictures = NULL, *name;
    int64_t seeds = 2, reference_spp = 2048;
    int help = 0, fast = 0, header = 0;
    const struct option table[] = {
        {"size", 0, OPTION_STRING, &size, "WxH", "pixels; default: 128x96", 0, 0, NULL},
        {"seeds", 0, OPTION_INT, &seeds, "N", "pictures; default: 2", 1, 1000, NULL},
        {"reference-spp", 0, OPTION_INT, &reference_spp, "N", "of the truth; default: 2048", 4, 65536, NULL},
        {"cache", 0, OPTION_STRING, &cache, "FILE", "keep the pictures here", 0, 0, NULL},
        {"pictures", 0, OPTION_STRING, &pictures, "PREFIX", "write PNG files of the first seed", 0, 0, NULL},
        {"fast", 0, OPTION_FLAG, &fast, NULL, "the method for previews", 0, 0, NULL},
        {"header", 0, OPTION_FLAG, &header, NULL, "print the columns' names and end", 0, 0, NULL},
        {0},
    };
    struct recorded r = {0};
    struct positionals rest;
    struct error err = {0};

    if (options_parse(table, argc, argv, &rest, &help, &err) != STATUS_OK)
        die(err.text);
    if (header) {
        puts("scene,seed,spp,raw,display_true,display,rms_raw,rms_true,rms,rmse_raw,rmse_true,rmse,lo,hi,reliable,reasons,"
             "raw_tiles,us_per_pixel");
        return 0;
    }
    if (help || rest.count != 1 || !cache || sscanf(size, "%ux%u", &r.width, &r.height) != 2) {
        options_print_help("denoised SCENE --cache FILE [options]", "Denoised pictures against truth.", table);
        return help ? 0 : 2;
    }
    r.seeds = (uint32_t)seeds;
    r.reference_spp = (uint32_t)reference_spp;
    recorded_make(&r, rest.items[0], cache);
    name = strrchr(rest.items[0], '/') ? strrchr(rest.items[0], '/') + 1 : rest.items[0];
    for (uint32_t seed = 0; seed < r.seeds; seed++)
        for (uint32_t level = 0; level < LEVELS; level++)
            measure(&r, name, seed, level, fast, seed == 0 ? pictures : NULL);
    return 0;
}
