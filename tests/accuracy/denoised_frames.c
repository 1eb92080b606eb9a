/* denoised_frames: an animation's pictures without their noise, each by itself and with the frames around it, against the truth:
 * one line of CSV for each number of frames, as in docs/DENOISING.md.
 *
 *   denoised_frames SCENE --cache FILE [--size WxH] [--spp N] [--seed N] [--reference-spp N] [--fast] [--pictures PREFIX]
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
#include "coordinator/pictures/view.h"
#include "common/system/clock.h"
#include "common/system/file.h"
#include "tests/support/imported.h"

enum {
    SHOWN = 2,                 /* frames that are denoised */
    AROUND = 2,                /* before and after */
    FRAMES = SHOWN + 2 * AROUND,
    FIRST = 10,
    REFERENCE_SEED = 1000000,
    PLANES = 4, /* of a group: radiance, albedo, normal, emission */
};
static const int plane_aov[PLANES] = {FILM_PICTURE, AOV_DENOISING_ALBEDO, AOV_DENOISING_NORMAL, AOV_EMISSION};

struct recorded {
    struct render_settings settings;
    uint32_t reference_spp;
    size_t values; /* of a picture */
    float *reference[SHOWN][2];
    float *planes[FRAMES][GROUPS][PLANES], *positions[FRAMES], *objects[FRAMES];
    struct import_result import;
};

static _Noreturn void die(const char *text)
{
    fprintf(stderr, "denoised_frames: %s\n", text);
    exit(2);
}

static float *values_of(const struct recorded *r)
{
    float *values = mem_calloc(r->values, sizeof(float));

    if (!values)
        die("out of memory");
    return values;
}

static struct film *rendered(struct recorded *r, uint32_t frame, uint32_t spp, uint64_t seed, uint32_t aovs)
{
    struct render_settings settings = r->settings;
    struct render_stats stats = {0};
    struct render_scene *scene;
    struct film *film;

    settings.spp = spp;
    settings.seed = seed;
    settings.aovs = aovs;
    scene = imported_build(&r->import, &settings, frame);
    film = film_new_aovs(settings.width, settings.height, spp, aovs);
    if (!film)
        die("out of memory");
    imported_render_film(scene, frame, film, &stats);
    render_scene_free(scene);
    return film;
}

static void record(struct recorded *r)
{
    for (uint32_t k = 0; k < FRAMES; k++) {
        struct film *film = rendered(r, FIRST + k, r->settings.spp, r->settings.seed, AOV_FOR_DENOISING | 1u << AOV_POSITION | 1u << AOV_OBJECT_ID);
        for (uint32_t tile = 0; tile < film_tile_count(film); tile++)
            for (uint32_t g = 0; g < GROUPS; g++)
                for (int plane = 0; plane < PLANES; plane++)
                    film_group_tile(film, tile, g, plane_aov[plane], r->planes[k][g][plane]);
        film_develop_aov(film, AOV_POSITION, 0, r->settings.height, r->positions[k]);
        film_develop_aov(film, AOV_OBJECT_ID, 0, r->settings.height, r->objects[k]);
        film_free(film);
    }
    for (uint32_t k = 0; k < SHOWN; k++) {
        struct film *film = rendered(r, FIRST + AROUND + k, r->reference_spp, REFERENCE_SEED, 0);
        for (uint32_t g = 0; g < GROUPS; g++)
            film_develop_group(film, g, r->reference[k][g]);
        film_free(film);
    }
}

/* Read or write everything. */
static int transfer(struct recorded *r, FILE *file, int out)
{
    const uint32_t head[5] = {r->settings.width, r->settings.height, r->settings.spp, r->reference_spp, (uint32_t)r->settings.seed};
    uint32_t found[5];
    float *all[SHOWN * 2 + FRAMES * (GROUPS * PLANES + 2)];
    size_t count = 0;
    int good = out ? fwrite(head, sizeof head, 1, file) == 1
                   : fread(found, sizeof found, 1, file) == 1 && memcmp(head, found, sizeof head) == 0;

    for (int k = 0; k < SHOWN; k++)
        for (int g = 0; g < 2; g++)
            all[count++] = r->reference[k][g];
    for (int k = 0; k < FRAMES; k++) {
        all[count++] = r->positions[k];
        all[count++] = r->objects[k];
        for (int g = 0; g < GROUPS; g++)
            for (int plane = 0; plane < PLANES; plane++)
                all[count++] = r->planes[k][g][plane];
    }
    for (size_t i = 0; i < count && good; i++)
        good = (out ? fwrite(all[i], sizeof(float), r->values, file) : fread(all[i], sizeof(float), r->values, file)) == r->values;
    return good;
}

static void recorded_make(struct recorded *r, const char *scene, const char *cache)
{
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct error err = {0};
    FILE *file = fopen(cache, "rb");

    if (import_scene(scene, &options, &r->import, &err) != STATUS_OK)
        die(err.text);
    for (int k = 0; k < SHOWN * 2; k++)
        r->reference[k / 2][k % 2] = values_of(r);
    for (int k = 0; k < FRAMES; k++) {
        r->positions[k] = values_of(r);
        r->objects[k] = values_of(r); /* a third of it is used */
        for (int i = 0; i < GROUPS * PLANES; i++)
            r->planes[k][i / PLANES][i % PLANES] = values_of(r);
    }
    if (file && transfer(r, file, 0)) {
        fclose(file);
        return;
    }
    if (file)
        fclose(file);
    record(r);
    file = fopen(cache, "wb");
    if (!file || !transfer(r, file, 1) || fclose(file) != 0)
        die("cannot write the cache");
}

/* ---- judging ---------------------------------------------------------------------------------- */

static struct denoise_input input_of(const struct recorded *r, int frame)
{
    struct denoise_input input = {.width = r->settings.width, .height = r->settings.height};

    for (int g = 0; g < 2; g++) {
        input.groups[g] = r->planes[frame][g][0];
        input.albedo[g] = r->planes[frame][g][1];
        input.normal[g] = r->planes[frame][g][2];
        input.direct[g] = r->planes[frame][g][3];
    }
    return input;
}

/* The frames around one, as the denoiser asks for them. */
struct around {
    const struct recorded *r;
    int frame, frames;
    struct denoise_input picture;
    int32_t *source;
};

static status other_frame(void *user, uint32_t k, struct denoise_other *out, struct error *err)
{
    struct around *a = user;
    const int frame = a->frame - a->frames + (int)k + ((int)k >= a->frames);
    struct scene_way way;

    TRY(scene_way_find(&a->r->import.scene, &a->r->settings, (uint32_t)(FIRST + a->frame), (uint32_t)(FIRST + frame), &way, err));
    a->picture = input_of(a->r, frame);
    *out = (struct denoise_other){&a->picture, NULL};
    if (!scene_way_is_still(&way)) {
        scene_way_follow(&way, &a->r->settings, a->r->positions[a->frame], a->r->objects[a->frame], a->source);
        out->source = a->source;
    }
    scene_way_release(&way);
    return STATUS_OK;
}

static float *denoised(const struct recorded *r, int frame, int frames, int fast, double *rmse, double *cpu_us)
{
    const struct denoise_options options = {.method = fast ? DENOISE_FAST : DENOISE_FULL, .threads = 1,
                                            .evidence = &(struct accuracy_evidence){.samples = r->settings.spp}};
    struct around around = {.r = r, .frame = frame, .frames = frames, .source = mem_alloc_array(r->values / 3, sizeof(int32_t))};
    struct denoise_input input = input_of(r, frame);
    struct denoise_result result;
    struct error err = {0};
    uint64_t start = clock_thread_cpu_ns();

    input.other_count = 2 * (uint32_t)frames;
    input.other = other_frame;
    input.other_user = &around;
    if (!around.source || denoise(&input, &options, &result, &err) != STATUS_OK)
        die(err.text);
    *cpu_us += (double)(clock_thread_cpu_ns() - start) * 1e-3 / (double)(r->values / 3) / SHOWN;
    *rmse += result.figures.rmse_percent / SHOWN;
    mem_free(around.source);
    return result.image;
}

static double code(float value, double gain) { return 255 * (double)srgb_encode((float)((double)value * gain)); }

static void write_picture(const struct recorded *r, const float *rgb, double gain, const char *prefix, const char *name)
{
    struct image8 image = {.width = r->settings.width, .height = r->settings.height, .channels = 3, .bits = 8};
    struct buffer file = {0};
    struct error err = {0};
    char path[512];

    image.pixels = mem_alloc(r->values);
    for (size_t i = 0; image.pixels && i < r->values; i++)
        image.pixels[i] = (uint8_t)(code(rgb[i], gain) + 0.5);
    snprintf(path, sizeof path, "%s%s.png", prefix, name);
    if (!image.pixels || png_encode_8(&file, &image, 0, &err) != STATUS_OK ||
        file_write_atomic(path, file.data, file.size, &err) != STATUS_OK)
        die(err.text);
    buffer_release(&file);
    mem_free(image.pixels);
}

/* The 95 % error, the RMS of codes, the RMSE, and what 95 % of the pixels change by from frame to frame beyond what should. */
static void measure(const struct recorded *r, const char *scene, int around, int fast, const char *pictures)
{
    float *shown[SHOWN], *largest = values_of(r);
    double mean = 0, gain, squares = 0, codes = 0, flicker = 0, display = 0, stated = 0, cpu_us = 0;
    const size_t pixels = r->values / 3;

    for (int k = 0; k < SHOWN; k++) {
        if (around >= 0)
            shown[k] = denoised(r, AROUND + k, around, fast, &stated, &cpu_us);
        else {
            shown[k] = values_of(r);
            for (size_t i = 0; i < r->values; i++)
                shown[k][i] = (r->planes[AROUND + k][0][0][i] + r->planes[AROUND + k][1][0][i]) / 2;
        }
        for (size_t i = 0; i < r->values; i++)
            mean += (double)(r->reference[k][0][i] + r->reference[k][1][i]) / 2 / (double)r->values / SHOWN;
    }
    gain = mean > 0 ? 0.18 / mean : 1;
    for (int k = 0; k < SHOWN; k++) {
        memset(largest, 0, r->values * sizeof *largest);
        for (size_t i = 0; i < r->values; i++) {
            const float truth = (r->reference[k][0][i] + r->reference[k][1][i]) / 2;
            const double off = (double)shown[k][i] - (double)truth;
            const double noise = ((double)r->reference[k][0][i] - (double)r->reference[k][1][i]) / 2;
            const double d = fabs(code(shown[k][i], gain) - code(truth, gain));
            squares += off * off - noise * noise;
            codes += d * d;
            largest[i / 3] = (float)d > largest[i / 3] ? (float)d : largest[i / 3];
        }
        display += (double)quantile_select(largest, pixels, (size_t)((double)(pixels - 1) * 0.95)) / SHOWN;
    }
    memset(largest, 0, r->values * sizeof *largest);
    for (size_t i = 0; i < r->values; i++) {
        const double change = code((r->reference[1][0][i] + r->reference[1][1][i]) / 2, gain) -
                              code((r->reference[0][0][i] + r->reference[0][1][i]) / 2, gain);
        const double d = code(shown[1][i], gain) - code(shown[0][i], gain) - change;
        largest[i / 3] = (float)fabs(d) > largest[i / 3] ? (float)fabs(d) : largest[i / 3];
    }
    flicker = (double)quantile_select(largest, pixels, (size_t)((double)(pixels - 1) * 0.95));
    printf("%s,%u,%d,%.4g,%.4g,%.4g,%.4g,%.4g,%.4g\n", scene, r->settings.spp, around < 0 ? 0 : 2 * around + 1, display,
           sqrt(codes / (double)r->values / SHOWN),
           squares > 0 ? 100 * sqrt(squares / (double)r->values / SHOWN) / mean : 0, stated, flicker, cpu_us);
    fflush(stdout);
    for (int k = 0; k < SHOWN; k++) {
        char name[64];
        snprintf(name, sizeof name, "%s-%u-%d-%d", scene, r->settings.spp, 2 * around + 1, k);
        if (pictures)
            write_picture(r, shown[k], gain, pictures, name);
        mem_free(shown[k]);
    }
    mem_free(largest);
}

int main(int argc, char **argv)
{
    const char *size = "128x96", *cache = NULL, *pictures = NULL, *name;
    int64_t spp = 16, reference_spp = 1024, seed = 1;
    int help = 0, fast = 0, header = 0;
    const struct option table[] = {
        {"size", 0, OPTION_STRING, &size, "WxH", "pixels; default: 128x96", 0, 0, NULL},
        {"spp", 0, OPTION_INT, &spp, "N", "of the pictures; default: 16", 4, 65536, NULL},
        {"seed", 0, OPTION_INT, &seed, "N", "of the pictures; default: 1", 0, 999999, NULL},
        {"reference-spp", 0, OPTION_INT, &reference_spp, "N", "of the truth; default: 1024", 4, 65536, NULL},
        {"cache", 0, OPTION_STRING, &cache, "FILE", "keep the pictures here", 0, 0, NULL},
        {"pictures", 0, OPTION_STRING, &pictures, "PREFIX", "write PNG files", 0, 0, NULL},
        {"fast", 0, OPTION_FLAG, &fast, NULL, "the method for previews", 0, 0, NULL},
        {"header", 0, OPTION_FLAG, &header, NULL, "print the columns' names and end", 0, 0, NULL},
        {0},
    };
    static struct recorded r;
    struct positionals rest;
    struct error err = {0};
    uint32_t width, height;

    if (options_parse(table, argc, argv, &rest, &help, &err) != STATUS_OK)
        die(err.text);
    if (header) {
        puts("scene,spp,frames,display,rms,rmse,rmse_stated,flicker,us_per_pixel");
        return 0;
    }
    if (help || rest.count != 1 || !cache || sscanf(size, "%ux%u", &width, &height) != 2) {
        options_print_help("denoised_frames SCENE --cache FILE [options]", "Denoised animations against truth.", table);
        return help ? 0 : 2;
    }
    r.settings = imported_settings(width, height, (uint32_t)spp);
    r.reference_spp = (uint32_t)reference_spp;
    r.settings.seed = (uint64_t)seed;
    r.values = (size_t)width * height * 3;
    recorded_make(&r, rest.items[0], cache);
    name = strrchr(rest.items[0], '/') ? strrchr(rest.items[0], '/') + 1 : rest.items[0];
    for (int around = -1; around <= AROUND; around++)
        measure(&r, name, around, fast, pictures);
    import_result_release(&r.import);
    return 0;
}
