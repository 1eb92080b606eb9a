/* One sample rendered again (worker/render/record.h): it has the bits that the film got, in every scene that
 * shows an effect, and what was written down explains them. */
#include <dirent.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "tests/support/imported.h"
#include "worker/render/path/kernel.h"
#include "worker/render/record.h"

enum { WIDTH = 20, HEIGHT = 18, SPP = 7, SCENES_MAX = 128, TEXT = 300 };

static struct sample_record record;

/* Every scene file of these folders, whatever is added to them. */
static size_t list_scenes(char paths[SCENES_MAX][TEXT])
{
    static const char *const folders[] = {"scenes/features", "scenes/liquids", "scenes/cornell"};
    size_t count = 0;

    for (size_t i = 0; i < sizeof folders / sizeof *folders; i++) {
        DIR *folder = opendir(folders[i]);
        struct dirent *entry;

        assert_non_null(folder);
        while ((entry = readdir(folder))) {
            const char *dot = strrchr(entry->d_name, '.');
            if (!dot || (strcmp(dot, ".gltf") != 0 && strcmp(dot, ".pbrt") != 0))
                continue;
            assert_true(count < SCENES_MAX);
            assert_true(snprintf(paths[count++], TEXT, "%s/%s", folders[i], entry->d_name) < TEXT);
        }
        closedir(folder);
    }
    return count;
}

static float sum_in_order(const struct sample_record *r, int channel)
{
    float sum = 0;

    for (uint32_t i = 0; i < r->count; i++)
        for (int source = 0; source < PATH_SOURCES; source++) {
            const struct vec3 *added = &r->vertices[i].added[source];
            sum += channel == 0 ? added->x : channel == 1 ? added->y : added->z;
        }
    return sum;
}

/* The sums of a unit, from its samples rendered one by one, as tile_render adds them up. */
static void sum_samples(const struct render_scene *scene, const struct render_settings *settings, uint32_t tile,
                        uint32_t group, uint32_t pass, float *sums, struct render_stats *stats)
{
    struct tile_rect rect = tile_rect_of(settings->width, settings->height, tile);
    size_t pixels = (size_t)rect.width * rect.height;
    uint32_t begin, end;

    pass_range(settings->spp, group, pass, &begin, &end);
    for (uint32_t p = 0; p < pixels; p++) {
        double sum[3] = {0};
        for (uint32_t i = begin; i < end; i++) {
            float added[3], plain[3];
            struct render_stats unused = {0};
            uint32_t x = rect.x + p % rect.width, y = rect.y + p / rect.width;

            render_sample(scene, 1, x, y, i * GROUPS + group, added, &record, stats);
            render_sample(scene, 1, x, y, i * GROUPS + group, plain, NULL, &unused);
            assert_memory_equal(added, plain, sizeof added);
            assert_true(record.count > 0 && !record.truncated && record.end != PATH_GOES_ON);
            for (int c = 0; c < 3; c++) {
                float radiance = c == 0 ? record.radiance.x : c == 1 ? record.radiance.y : record.radiance.z;
                float parts = sum_in_order(&record, c);
                assert_memory_equal(&parts, &radiance, sizeof parts);
                assert_memory_equal(&added[c], &radiance, sizeof parts);
                sum[c] += (double)added[c];
            }
        }
        for (size_t c = 0; c < 3; c++)
            sums[p * 3 + c] = (float)sum[c];
    }
}

/* As imported_file, but warnings are of no interest. */
static void import_any(const char *path, struct import_result *import)
{
    const struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct error err = {0};

    if (import_scene(path, &options, import, &err) != STATUS_OK)
        fail_msg("%s: %s", path, err.text);
}

static void check_scene(const char *path)
{
    static float film[TILE_FLOATS_MAX], again[TILE_FLOATS_MAX], whole[TILE_FLOATS_MAX];
    struct render_settings settings = imported_settings(WIDTH, HEIGHT, SPP);
    struct import_result import;
    struct render_scene *scene;

    import_any(path, &import);
    scene = imported_build(&import, &settings, 1);
    for (uint32_t tile = 0; tile < tile_count(WIDTH, HEIGHT); tile++)
        for (uint32_t group = 0; group < GROUPS; group++)
            for (uint32_t pass = 0; pass < pass_count(SPP, group); pass++) {
                struct render_stats a = {0}, b = {0}, c = {0};
                size_t floats = render_tile(scene, 1, tile, group, pass, film, NULL, &a);
                kernel_recording.tile_render(scene, 1, tile, group, pass, whole, NULL, &b);
                sum_samples(scene, &settings, tile, group, pass, again, &c);
                if (memcmp(film, whole, floats * sizeof *film) != 0)
                    fail_msg("%s: the kernel that records differs in tile %u", path, tile);
                if (memcmp(film, again, floats * sizeof *film) != 0)
                    fail_msg("%s: its samples one by one differ in tile %u, group %u, pass %u", path, tile, group,
                             pass);
                if (a.work.rays != c.work.rays || a.work.vertices != c.work.vertices || a.work.samples != c.work.samples ||
                    memcmp(&a.work.health, &c.work.health, sizeof a.work.health) != 0)
                    fail_msg("%s: counted differently in tile %u", path, tile);
            }
    render_scene_free(scene);
    import_result_release(&import);
}

static void every_effect_has_the_same_bits(void **state)
{
    static char paths[SCENES_MAX][TEXT];
    size_t count = list_scenes(paths);

    (void)state;
    assert_true(count > 40);
    for (size_t i = 0; i < count; i++)
        check_scene(paths[i]);
}

/* ---- what is written down --------------------------------------------------------------------- */

struct seen {
    uint32_t ends[PATH_ENDS], kinds[4], lights, hidden, lobes, bodies, media, weighted;
};

static void check_near(struct vec3 a, struct vec3 b)
{
    assert_true(vec3_length(vec3_sub(a, b)) <= 1e-5f * (1 + vec3_length(b)));
}

/* A vertex, and the next one if there is one. */
static void check_vertex(const struct record_vertex *v, const struct record_vertex *next, struct seen *seen)
{
    seen->kinds[v->met]++;
    seen->bodies += v->body_count > 0;
    seen->media += v->medium >= 0;
    seen->weighted += v->met_weight < 1;
    assert_true(v->met_weight >= 0 && v->met_weight <= 1 && v->survival > 0 && v->survival <= 1);
    if (v->met == PATH_MET_SURFACE)
        assert_true(v->instance >= 0 && v->material >= 0 && fabsf(vec3_length(v->ng) - 1) < 1e-5f);
    if (v->light.found) {
        seen->lights++;
        assert_true(v->light.pdf > 0 && v->light.kind[0] && v->light.weight >= 0 && v->light.weight <= 1);
    }
    if (v->light.traced && vec3_is_black(v->light.visible)) {
        seen->hidden++;
        assert_true(vec3_is_black(v->added[FROM_LIGHT]));
    }
    if (!v->scattered)
        return;
    seen->lobes += v->lobe[0] != 0;
    assert_true(v->lobe[0] && fabsf(vec3_length(v->direction) - 1) < 1e-5f && v->delta == !(v->pdf > 0));
    if (next && v->met != PATH_MET_BOUNDARY && next->met != PATH_MET_ESCAPE && next->medium < 0 &&
        next->met == PATH_MET_SURFACE && v->met == PATH_MET_SURFACE && next->body_count == 0) {
        check_near(next->throughput, vec3_scale(vec3_mul(v->throughput, v->weight), 1 / v->survival));
        check_near(next->p, vec3_mad(v->p, v->direction, next->t));
    }
}

static void look_at(const char *path, uint32_t max_depth, struct seen *seen)
{
    struct render_settings settings = imported_settings(WIDTH, HEIGHT, SPP);
    struct import_result import;
    struct render_scene *scene;
    struct render_stats stats = {0};

    imported_file(path, &import);
    settings.max_depth = max_depth;
    scene = imported_build(&import, &settings, 1);
    memset(seen, 0, sizeof *seen);
    for (uint32_t p = 0; p < WIDTH * HEIGHT; p++)
        for (uint32_t n = 0; n < SPP; n++) {
            float added[3];
            render_sample(scene, 1, p % WIDTH, p / WIDTH, n, added, &record, &stats);
            seen->ends[record.end]++;
            for (uint32_t i = 0; i < record.count; i++)
                check_vertex(&record.vertices[i], i + 1 < record.count ? &record.vertices[i + 1] : NULL, seen);
            assert_true(record.count <= max_depth + 2 || seen->kinds[PATH_MET_BOUNDARY] > 0);
        }
    render_scene_free(scene);
    import_result_release(&import);
}

static void paths_are_explained(void **state)
{
    struct seen seen;

    (void)state;
    look_at("scenes/cornell/cornell-area.gltf", 12, &seen);
    assert_true(seen.lights > 100 && seen.hidden > 10 && seen.lobes > 100 && seen.weighted > 10);
    assert_true(seen.ends[PATH_ROULETTE] > 100);
    assert_int_equal(seen.ends[PATH_GOES_ON], 0);
    look_at("scenes/cornell/cornell-area.gltf", 1, &seen);
    assert_true(seen.ends[PATH_DEPTH] > 100 && seen.ends[PATH_ROULETTE] == 0);
    look_at("scenes/features/media.pbrt", 12, &seen);
    assert_true(seen.kinds[PATH_MET_MEDIUM] > 50 && seen.media > 50 && seen.kinds[PATH_MET_BOUNDARY] > 0);
    look_at("scenes/features/nested.gltf", 12, &seen);
    assert_true(seen.bodies > 50 && seen.ends[PATH_ESCAPED] > 50);
    look_at("scenes/features/unlit.gltf", 12, &seen);
    assert_true(seen.ends[PATH_UNLIT] > 0);
}

/* The emitters put directional lights first. */
static void lights_keep_their_numbers(void **state)
{
    struct scene_light lights[4] = {{.kind = LIGHT_POINT}, {.kind = LIGHT_DIRECTIONAL},
                                    {.kind = LIGHT_SPOT}, {.kind = LIGHT_DIRECTIONAL}};
    const struct scene scene = {.lights = lights, .light_count = 4};
    static const uint32_t order[] = {1, 3, 0, 2, 4};

    (void)state;
    for (uint32_t i = 0; i < 5; i++)
        assert_int_equal(record_scene_light(&scene, i), order[i]);
}

/* What the film scales down, render_sample scales down; the path's own radiance is told beside it. */
static void clamping_is_the_films(void **state)
{
    struct render_settings settings = imported_settings(WIDTH, HEIGHT, SPP);
    struct import_result import;
    struct render_scene *scene;
    struct render_stats stats = {0};
    uint32_t clamped = 0;

    (void)state;
    imported_file("scenes/cornell/cornell-area.gltf", &import);
    settings.clamp = 0.25f;
    scene = imported_build(&import, &settings, 1);
    for (uint32_t p = 0; p < WIDTH * HEIGHT; p++) {
        float added[3];
        render_sample(scene, 1, p % WIDTH, p / WIDTH, 3, added, &record, &stats);
        assert_true(added[0] <= 0.25f && added[1] <= 0.25f && added[2] <= 0.25f);
        clamped += added[0] < record.radiance.x;
    }
    assert_true(clamped > 10 && stats.work.clamped_samples == clamped);
    render_scene_free(scene);
    import_result_release(&import);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_effect_has_the_same_bits),
        cmocka_unit_test(paths_are_explained),
        cmocka_unit_test(lights_keep_their_numbers),
        cmocka_unit_test(clamping_is_the_films),
    };
    return cmocka_run_group_tests_name("recorded samples", tests, NULL, NULL);
}
