/* bench_render: the renderer alone on one scene: samples/s, rays/s, share of Embree, memory.
 *
 *   bench_render SCENE [--env FILE] [--size WxH] [--spp N] [--threads N] [--max-depth N]
 *                [--env-sampling MODE] [--isa ISA] [--frame N] [--shutter S] [--without LIST]
 *                [--sampler NAME] [--light-choice HOW] [--roulette on|off] [--clamp X]
 *                [--texture-filter HOW] [--bvh-quality HOW] [--robust on|off]
 *                [--seed N] [--aovs] [--general] [--trace] [--json] [--out FILE.exr]
 *                [--groups FILE.exr]
 *
 * --trace times every Embree call (and slows the run down a little, so take samples/s from a
 * run without it). --general runs the general kernel instead of the smallest one.
 * --groups keeps the two groups' means, one below the other.
 * CPU time is that of the rendering threads. */
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "client/import/import.h"
#include "common/accuracy/figures.h"
#include "common/system/clock.h"
#include "common/system/file.h"
#include "common/base/memory.h"
#include "common/cli/options.h"
#include "common/film/film.h"
#include "common/image/image.h"
#include "common/scene/effects.h"
#include "tests/support/imported.h"
#include "worker/render/render.h"

struct bench {
    const struct render_scene *scene;
    struct render_settings settings;
    struct film *film;
    pthread_mutex_t lock;
    atomic_uint next;
    uint32_t frame, tiles, passes;
    struct render_stats stats;
    uint64_t cpu_ns;
};

static status srgb_codes(void *user, const float *rgb, uint32_t width, uint32_t height, float *codes, struct error *err)
{
    (void)err;
    film_codes_plain(user, rgb, width * height, codes);
    return STATUS_OK;
}

static void estimate(const struct film *film, struct accuracy_figures *out)
{
    const struct accuracy_transform transform = {.apply = srgb_codes, .user = NULL};
    struct accuracy_picture picture = {.width = film_width(film), .height = film_height(film)};
    size_t values = (size_t)picture.width * picture.height * 3;
    float *all = mem_alloc_array(values * GROUPS, sizeof *all);
    struct error err = {0};

    if (!all)
        exit(1);
    for (uint32_t g = 0; g < GROUPS; g++) {
        film_develop_group(film, g, all + g * values);
        picture.groups[g] = all + g * values;
    }
    if (accuracy_figures_of(out, &picture, &transform, NULL, NULL, &err) != STATUS_OK)
        exit(1);
    mem_free(all);
}

static void *run(void *user)
{
    struct bench *b = user;
    struct render_stats stats = {0};
    uint64_t start = clock_thread_cpu_ns();
    float sums[TILE_FLOATS_MAX];

    for (;;) {
        uint32_t unit = atomic_fetch_add(&b->next, 1);
        enum film_merge_result merged;
        struct unit_result result = {.tile = unit % b->tiles, .group = unit / b->tiles % GROUPS,
                                     .pass = unit / b->tiles / GROUPS, .sums = sums};
        struct error err;
        if (unit >= b->tiles * GROUPS * b->passes)
            break;
        if (result.pass >= film_pass_count(b->film, result.group))
            continue;
        result.count =
            render_tile(b->scene, b->frame, result.tile, result.group, result.pass, sums, &result.tail, &stats);
        pthread_mutex_lock(&b->lock);
        if (film_merge(b->film, &result, 0, &merged, &err) != STATUS_OK) {
            fprintf(stderr, "bench_render: %s\n", err.text);
            exit(1);
        }
        pthread_mutex_unlock(&b->lock);
    }
    pthread_mutex_lock(&b->lock);
    b->cpu_ns += clock_thread_cpu_ns() - start;
    b->stats.work.samples += stats.work.samples;
    b->stats.work.rays += stats.work.rays;
    b->stats.work.vertices += stats.work.vertices;
    health_add(&b->stats.work.health, &stats.work.health);
    b->stats.work.leaked_rays += stats.work.leaked_rays;
    b->stats.work.clamped_samples += stats.work.clamped_samples;
    b->stats.work.clamped_luminance += stats.work.clamped_luminance;
    b->stats.work.kept_luminance += stats.work.kept_luminance;
    depth_light_add(&b->stats.work.depth, &stats.work.depth);
    b->stats.trace_ns += stats.trace_ns;
    pthread_mutex_unlock(&b->lock);
    return NULL;
}

static void die(const struct error *err)
{
    fprintf(stderr, "bench_render: %s\n", err->text);
    exit(status_exit_code(err->code));
}

static struct image new_picture(uint32_t width, uint32_t height)
{
    struct image image;
    struct error err = {0};

    if (image_init(&image, width, height, 3, &err) != STATUS_OK)
        die(&err);
    return image;
}

/* Writes the picture and frees it. */
static void keep(const char *path, struct image *image)
{
    struct buffer bytes = BUFFER_INIT;
    struct exr_options exr = {0};
    struct error err = {0};

    if (exr_encode(&bytes, image, &exr, &err) != STATUS_OK ||
        file_write_atomic(path, bytes.data, bytes.size, &err) != STATUS_OK)
        die(&err);
    buffer_release(&bytes);
    image_release(image);
}

int main(int argc, char **argv)
{
    const char *env = NULL, *size = "400x400", *out = NULL, *sampling = "learned", *isa = "avx2";
    int64_t spp = 100, threads = 1, depth = 12;
    int trace = 0, json = 0, help = 0, general = 0;
    int64_t frame = 0, seed = 0;
    const char *groups = NULL;
    int aovs = 0;
    double shutter = 0;
    const char *without = NULL, *sampler = "sobol", *light_choice = "learned", *roulette = "on";
    const char *texture_filter = "cone", *bvh_quality = "medium", *robust = "on";
    double clamp = 0;
    const struct option table[] = {
        {"env", 0, OPTION_STRING, &env, "FILE", "environment map", 0, 0, NULL},
        {"size", 0, OPTION_STRING, &size, "WxH", "pixels", 0, 0, NULL},
        {"spp", 0, OPTION_INT, &spp, "N", "samples a pixel", 1, SETTINGS_SPP_MAX, NULL},
        {"threads", 0, OPTION_INT, &threads, "N", "rendering threads", 1, 256, NULL},
        {"max-depth", 0, OPTION_INT, &depth, "N", "path depth", 0, SETTINGS_DEPTH_MAX, NULL},
        {"env-sampling", 0, OPTION_CHOICE, &sampling, "MODE", "strategy", 0, 0,
         "importance|uniform|bsdf|importance-only|uniform-only|learned"},
        {"sampler", 0, OPTION_CHOICE, &sampler, "NAME", "random numbers", 0, 0, "sobol|independent"},
        {"light-choice", 0, OPTION_CHOICE, &light_choice, "HOW", "odds of lights", 0, 0,
         "learned|tree|power|uniform"},
        {"roulette", 0, OPTION_CHOICE, &roulette, "HOW", "Russian roulette", 0, 0, "on|off"},
        {"clamp", 0, OPTION_REAL, &clamp, "X", "radiance of a sample at most", 0,
         (double)SETTINGS_CLAMP_MAX, NULL},
        {"texture-filter", 0, OPTION_CHOICE, &texture_filter, "HOW", "of surfaces", 0, 0,
         "cone|bilinear|nearest"},
        {"bvh-quality", 0, OPTION_CHOICE, &bvh_quality, "HOW", "Embree's", 0, 0, "low|medium|high"},
        {"robust", 0, OPTION_CHOICE, &robust, "HOW", "Embree's flag", 0, 0, "on|off"},
        {"isa", 0, OPTION_CHOICE, &isa, "ISA", "Embree's instruction set", 0, 0, "sse2|avx2|avx512"},
        {"frame", 0, OPTION_INT, &frame, "N", "of an animation", 0, SETTINGS_FRAMES_MAX, NULL},
        {"shutter", 0, OPTION_REAL, &shutter, "S", "share of the frame's time", 0, 1, NULL},
        {"without", 0, OPTION_STRING, &without, "EFFECT", "switch one effect off", 0, 0, NULL},
        {"seed", 0, OPTION_INT, &seed, "N", "of the random numbers", 0, INT32_MAX, NULL},
        {"groups", 0, OPTION_STRING, &groups, "FILE.exr", "keep the groups' means", 0, 0, NULL},
        {"aovs", 0, OPTION_FLAG, &aovs, NULL, "all output variables, too", 0, 0, NULL},
        {"general", 0, OPTION_FLAG, &general, NULL, "run the general kernel", 0, 0, NULL},
        {"trace", 0, OPTION_FLAG, &trace, NULL, "time Embree's calls", 0, 0, NULL},
        {"json", 0, OPTION_FLAG, &json, NULL, "one line of JSON", 0, 0, NULL},
        {"out", 0, OPTION_STRING, &out, "FILE.exr", "keep the picture", 0, 0, NULL},
        {0},
    };
    struct positionals rest;
    struct error err = {0};
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct import_result import;
    struct render_scene_info info;
    struct render_scene *scene;
    struct bench b = {.lock = PTHREAD_MUTEX_INITIALIZER};
    pthread_t ids[256];
    struct accuracy_figures figures;
    struct depth_report ended;
    struct rusage usage;
    uint64_t start;
    double wall, cpu;
    unsigned width, height;

    if (options_parse(table, argc, argv, &rest, &help, &err) != STATUS_OK)
        die(&err);
    if (help || rest.count != 1 || sscanf(size, "%ux%u", &width, &height) != 2) {
        options_print_help("bench_render SCENE [options]", "Times the renderer alone.", table);
        return help ? 0 : 2;
    }
    options.env_path = env;
    if (import_scene(rest.items[0], &options, &import, &err) != STATUS_OK)
        die(&err);
    render_settings_default(&b.settings);
    b.settings.width = width;
    b.settings.height = height;
    b.settings.spp = (uint32_t)spp;
    b.settings.max_depth = (uint32_t)depth;
    if (seed)
        b.settings.seed = (uint64_t)seed;
    b.settings.env_sampling = (enum env_sampling)env_sampling_parse(sampling);
    b.settings.isa = (enum isa)isa_parse(isa);
    b.settings.shutter = (float)shutter;
    b.settings.sampler = (enum sampler_kind)sampler_parse(sampler);
    b.settings.light_choice = (enum light_choice)light_choice_parse(light_choice);
    b.settings.no_roulette = strcmp(roulette, "off") == 0;
    b.settings.clamp = (float)clamp;
    b.settings.texture_filter = (enum texture_filter)texture_filter_parse(texture_filter);
    b.settings.bvh_quality = (enum bvh_quality)bvh_quality_parse(bvh_quality);
    b.settings.not_robust = strcmp(robust, "off") == 0;
    if (aovs)
        b.settings.aovs = (1u << AOV_COUNT) - 1;
    if (without) {
        int effect = effect_parse(without);
        if (effect < 0) {
            fprintf(stderr, "bench_render: no effect is called \"%s\"\n", without);
            return 2;
        }
        b.settings.without = (uint64_t)1 << effect;
    }
    render_force_general(general);
    render_build_threads((unsigned)threads);
    if (render_scene_new(&scene, &import.scene, &b.settings, (uint32_t)frame, imported_source(&import), &err) !=
        STATUS_OK)
        die(&err);
    render_scene_info(scene, &info);
    b.scene = scene;
    b.frame = (uint32_t)frame;
    b.tiles = tile_count(width, height);
    b.passes = pass_count(b.settings.spp, 0);
    b.film = film_new_aovs(width, height, b.settings.spp, b.settings.aovs);
    if (!b.film)
        return 1;
    film_want_all(b.film);
    for (uint32_t g = 0; g < GROUPS; g++)
        film_freeze(b.film, g, NULL);
    render_measure_trace(trace);
    start = clock_monotonic_ns();
    for (int64_t i = 0; i < threads; i++)
        if (pthread_create(&ids[i], NULL, run, &b) != 0)
            return 1;
    for (int64_t i = 0; i < threads; i++)
        pthread_join(ids[i], NULL);
    wall = (double)(clock_monotonic_ns() - start) * 1e-9;
    cpu = (double)b.cpu_ns * 1e-9;
    estimate(b.film, &figures);
    ended = depth_light_report(&b.stats.work.depth, b.stats.work.samples, b.settings.max_depth);
    getrusage(RUSAGE_SELF, &usage);
    printf(json ? "{\"kernel\": \"%s\", \"effects\": \"0x%llx\", \"samples_per_cpu_s\": %.0f, \"rays_per_cpu_s\": %.0f, \"rays_per_sample\": %.3f, "
                  "\"trace_share\": %.3f, \"cpu_s\": %.3f, \"wall_s\": %.3f, \"build_s\": %.3f, "
                  "\"peak_mib\": %.1f, \"scene_mib\": %.1f, \"squared_error\": %.4g, \"display_error\": %.4g, \"dropped\": %llu, "
                  "\"leaked_rays\": %llu, \"clamped_samples\": %llu, \"clamped_share\": %.4g, \"depth_share\": %.4g}\n"
                : "kernel %s, effects 0x%llx\n"
                  "samples/CPU-s %.0f  rays/CPU-s %.0f  rays/sample %.2f  Embree's share %.3f\n"
                  "CPU %.2f s  wall %.2f s  build %.3f s  peak %.1f MiB (mesh+textures+BVH %.1f MiB)\n"
                  "squared error over squared mean %.4g  display error %.4g/255  dropped samples %llu  leaked rays %llu\n"
                  "clamped samples %llu, %.4g of the light\nended by depth %.4g of the light\n",
           render_kernel_variant(scene), (unsigned long long)render_effects(scene), (double)b.stats.work.samples / cpu,
           (double)b.stats.work.rays / cpu,
           (double)b.stats.work.rays / (double)b.stats.work.samples,
           trace ? (double)b.stats.trace_ns * 1e-9 / cpu : 0.0, cpu, wall,
           (double)info.build_ns * 1e-9, (double)usage.ru_maxrss / 1024,
           (double)(info.mesh_bytes + info.texture_bytes + info.bvh_bytes) / (1 << 20),
           figures.rmse_percent * figures.rmse_percent / 1e4, figures.display_error, (unsigned long long)b.stats.work.dropped_samples,
           (unsigned long long)b.stats.work.leaked_rays, (unsigned long long)b.stats.work.clamped_samples,
           b.stats.work.clamped_samples ? b.stats.work.clamped_luminance /
                                         (b.stats.work.clamped_luminance + b.stats.work.kept_luminance) : 0,
           ended.share);
    for (int k = 0; k < HEALTH_KINDS && !json; k++) {
        char text[HEALTH_TEXT_SIZE];
        if (b.stats.work.health.count[k])
            printf("%s\n", health_text(text, &b.stats.work.health, (enum health_kind)k, (struct tile_rect){0, 0, width, height}, 0));
    }
    if (out) {
        struct image image = new_picture(width, height);
        film_develop(b.film, image.pixels);
        keep(out, &image);
    }
    if (groups) {
        struct image image = new_picture(width, height * GROUPS);
        for (uint32_t g = 0; g < GROUPS; g++)
            film_develop_group(b.film, g, image.pixels + (size_t)g * width * height * 3);
        keep(groups, &image);
    }
    film_free(b.film);
    render_scene_free(scene);
    import_result_release(&import);
    return 0;
}
