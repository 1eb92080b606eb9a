/* bench_tonemap: what each operator takes for a made picture of high contrast, the same every time.
 *
 *   bench_tonemap [--size WxH | --picture FILE] [--threads N] [--rounds N] [--operator NAME] [--param NAME=X]...
 *
 * Prints one line of JSON for each operator: megapixels a second by the clock, seconds by the clock
 * and of CPU, the median of the rounds. Everything that developing a frame needs is in it: statistics,
 * exposure, the operator, sRGB codes. level_us: microseconds for the statistics of one level of a tile
 * (common/film/levels.h), with the operator or what stands in for it.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "common/base/buffer.h"
#include "common/system/clock.h"
#include "common/system/file.h"
#include "common/cli/options.h"
#include "common/film/levels.h"
#include "common/film/tiles.h"
#include "common/math/elementary.h"
#include "common/tonemap/tonemap.h"

enum { ROUNDS_MAX = 99, CUBE_SIDE = 33 };

static void die(const struct error *err)
{
    fprintf(stderr, "bench_tonemap: %s\n", err->text);
    exit(1);
}

static double number(uint64_t *seed)
{
    *seed = *seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(*seed >> 40) * 0x1p-24;
}

/* Six orders of magnitude from left to right, waves and boxes of colour, noise, and lamps. */
static void make_picture(struct image *image, uint32_t width, uint32_t height)
{
    struct error err = {0};
    uint64_t seed = 1;
    float *p;

    if (image_init(image, width, height, 3, &err) != STATUS_OK)
        die(&err);
    p = image->pixels;
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++, p += 3) {
            double u = (double)x / width, v = (double)y / height;
            double ln = 13.8 * u - 8.0 + 0.5 * (double)det_sin((float)(97.0 * (u + v * v)));
            uint32_t box = (x >> 6) * 7 + (y >> 6) * 13;
            float light = det_exp((float)(ln + 0.1 * number(&seed)));

            light *= number(&seed) > 0.9999 ? 3000.0f : 1.0f;
            for (uint32_t c = 0; c < 3; c++)
                p[c] = light * (0.1f + 0.3f * (float)((box >> c) & 3));
        }
}

static void read_picture(struct image *image, const char *path)
{
    struct buffer file = BUFFER_INIT;
    struct image_repairs repairs = {0};
    struct error err = {0};

    if (file_read(path, IMAGE_BYTES_MAX, &file, &err) != STATUS_OK ||
        image_decode_hdr(image, file.data, file.size, path, &repairs, &err) != STATUS_OK)
        die(&err);
    buffer_release(&file);
}

/* A table for `lut`: a curve with some desaturation. */
static void make_cube(struct buffer *out)
{
    char line[100];
    const int last = CUBE_SIDE - 1;

    snprintf(line, sizeof line, "LUT_3D_SIZE %d\n", CUBE_SIDE);
    buffer_append(out, line, strlen(line));
    for (int i = 0; i < CUBE_SIDE * CUBE_SIDE * CUBE_SIDE; i++) {
        double r = (double)(i % CUBE_SIDE) / last, g = (double)(i / CUBE_SIDE % CUBE_SIDE) / last;
        double b = (double)(i / CUBE_SIDE / CUBE_SIDE) / last, grey = (r + g + b) / 3.0;

        snprintf(line, sizeof line, "%.6f %.6f %.6f\n", 0.9 * r * (2.0 - r) + 0.1 * grey,
                 0.9 * g * (2.0 - g) + 0.1 * grey, 0.9 * b * (2.0 - b) + 0.1 * grey);
        buffer_append(out, line, strlen(line));
    }
}

static double cpu_seconds(void)
{
    struct rusage usage;

    getrusage(RUSAGE_SELF, &usage);
    return (double)(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
           1e-6 * (double)(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

static int compare(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

static double median(double *values, int count)
{
    qsort(values, (size_t)count, sizeof *values, compare);
    return values[count / 2];
}

static void show(void *user, const float *rgb, uint32_t count, float *codes)
{
    tonemap_pixels_codes(user, rgb, count, codes);
}

/* Microseconds for a tile's level: the median of the rounds, over 200 tiles of the picture. */
static double level_us(const struct image *picture, const struct tonemap_settings *settings, const struct buffer *cube,
                       int rounds)
{
    enum { TILES = 200, PIXELS = TILE_PIXELS_MAX };
    static double sums[PIXELS * 3];
    static float second[PIXELS * 3];
    struct tonemap_context context = {.threads = 1};
    struct tonemap_settings stand_in;
    struct tonemap_pixels *pixels;
    struct tonemap_state state;
    struct error err = {0};
    double times[ROUNDS_MAX];

    tonemap_stand_in(&stand_in, settings);
    if (stand_in.has_file) {
        context.file_data = cube->data;
        context.file_size = cube->size;
    }
    if (tonemap_measure(&state, picture, &stand_in, &context, &err) != STATUS_OK ||
        tonemap_pixels_new(&pixels, &stand_in, &state, &context, &err) != STATUS_OK)
        die(&err);
    for (int i = 0; i < rounds; i++) {
        uint64_t spent_ns = 0;
        for (size_t t = 0; t < TILES; t++) {
            size_t from = (size_t)picture->width * picture->height / TILES * t * 3;
            struct film_level level = {0};
            uint64_t start_ns;

            for (size_t k = 0; k < PIXELS * 3; k++) {
                size_t values = (size_t)picture->width * picture->height * 3;
                second[k] = picture->pixels[(from + PIXELS * 3 + k) % values];
                sums[k] = (double)picture->pixels[(from + k) % values] + (double)second[k];
            }
            start_ns = clock_monotonic_ns();
            film_level_measure(&level, sums, second, TILE_SIZE, TILE_SIZE, 2, &(struct film_codes){show, pixels});
            spent_ns += clock_monotonic_ns() - start_ns;
        }
        times[i] = (double)spent_ns * 1e-3 / TILES;
    }
    tonemap_pixels_free(pixels);
    return median(times, rounds);
}

static void run(const struct image *picture, const char *name, const struct option_list *params,
                const struct buffer *cube, unsigned threads, int rounds)
{
    struct tonemap_context context = {.threads = threads};
    struct tonemap_settings settings;
    double wall[ROUNDS_MAX], cpu[ROUNDS_MAX], seconds;
    struct error err = {0};

    if (tonemap_settings_init(&settings, name, &err) != STATUS_OK)
        die(&err);
    for (size_t i = 0; i < params->count; i++) {
        char parameter[64] = "";
        const char *value = strchr(params->items[i], '=');

        if (!value || (size_t)(value - params->items[i]) >= sizeof parameter)
            exit(2);
        memcpy(parameter, params->items[i], (size_t)(value - params->items[i]));
        if (tonemap_settings_set_text(&settings, parameter, value + 1, &err) != STATUS_OK)
            die(&err);
    }
    if (settings.op->file_required) {
        settings.has_file = 1;
        context.file_data = cube->data;
        context.file_size = cube->size;
    }
    for (int i = 0; i < rounds; i++) {
        uint64_t start = clock_monotonic_ns();
        double cpu_start = cpu_seconds();
        struct image out;

        if (tonemap_apply(&out, picture, &settings, &context, &err) != STATUS_OK)
            die(&err);
        wall[i] = (double)(clock_monotonic_ns() - start) * 1e-9;
        cpu[i] = cpu_seconds() - cpu_start;
        image_release(&out);
    }
    seconds = median(wall, rounds);
    printf("{\"operator\": \"%s\", \"mpixel_per_s\": %.2f, \"wall_s\": %.4f, \"cpu_s\": %.4f, \"level_us\": %.1f}\n",
           name, (double)picture->width * picture->height * 1e-6 / seconds, seconds, median(cpu, rounds),
           level_us(picture, &settings, cube, rounds));
    fflush(stdout);
}

int main(int argc, char **argv)
{
    const char *size = "1920x1080", *name = NULL, *path = NULL;
    int64_t threads = 1, rounds = 3;
    struct option_list params = {0};
    const struct option table[] = {
        {"size", 0, OPTION_STRING, &size, "WxH", "pixels (default 1920x1080)", 0, 0, NULL},
        {"picture", 0, OPTION_STRING, &path, "FILE", "an EXR or HDR instead of the made picture", 0, 0,
         NULL},
        {"threads", 0, OPTION_INT, &threads, "N", "threads; 0: one a processor (default 1)", 0, 256,
         NULL},
        {"rounds", 0, OPTION_INT, &rounds, "N", "runs of each (default 3)", 1, ROUNDS_MAX, NULL},
        {"operator", 0, OPTION_STRING, &name, "NAME", "this one only", 0, 0, NULL},
        {"param", 0, OPTION_LIST, &params, "NAME=X", "a parameter of it", 0, 0, NULL},
        {0},
    };
    struct buffer cube = BUFFER_INIT;
    struct positionals rest;
    struct error err = {0};
    struct image picture;
    unsigned width, height;
    size_t count;
    const struct tonemap_operator *const *all = tonemap_operators(&count);
    int help;

    if (options_parse(table, argc, argv, &rest, &help, &err) != STATUS_OK)
        die(&err);
    if (help || rest.count != 0 || sscanf(size, "%ux%u", &width, &height) != 2 || (params.count > 0 && !name)) {
        options_print_help("bench_tonemap [options]", "Times the tone mapping operators.", table);
        return help ? 0 : 2;
    }
    if (path)
        read_picture(&picture, path);
    else
        make_picture(&picture, width, height);
    make_cube(&cube);
    for (size_t i = 0; i < count; i++)
        if (!name || strcmp(all[i]->name, name) == 0)
            run(&picture, all[i]->name, &params, &cube, (unsigned)threads, (int)rounds);
    image_release(&picture);
    buffer_release(&cube);
    return 0;
}
