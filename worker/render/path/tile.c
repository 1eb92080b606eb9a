/* tile: the one pixel loop. */
#include <float.h>
#include <string.h>

#include "common/base/safeguard.h"
#include "common/film/matte.h"
#include "worker/render/path/kernel.h"
#include "worker/render/path/path.h"
#include "worker/render/base/fault.h"
#include "worker/render/base/health_scope.h"
#include "worker/render/base/profile_scope.h"
#include "worker/render/camera/view.h"
#include "worker/render/path/record_path.h"
#include "worker/render/render_scene.h"

/* Distance along the camera's axis, which compositors call depth. */
static real tile_depth(const struct render_scene *scene, const struct ray *ray, real distance)
{
    const struct transform *view = &scene->camera.to_world;
    struct vec3 axis = {-view->m[0][2], -view->m[1][2], -view->m[2][2]};

    return scene->camera.kind == CAMERA_PANORAMA ? distance : distance * vec3_dot(ray->direction, axis);
}

/* Add one sample's output variables to the pixel's `values`, in the enum's order. */
static void tile_aovs(const struct render_scene *scene, uint32_t mask, const struct ray *ray,
                      const struct path_record *record, int first, double *values)
{
    const struct vec3 normal = {FAULT(NAN_AOV) ? NAN : record->normal.x, record->normal.y, record->normal.z};
    real sample[3], motion[2] = {0, 0};
    uint32_t at = 0;
    int bad = 0;

    for (int aov = 0; aov < AOV_COUNT; aov++) {
        uint32_t channels = aov_channels((enum aov)aov);
        if (!(mask >> aov & 1) || channels == 0)
            continue;
        if (AOV_MATTES >> aov & 1) { /* counted, not added */
            at += channels;
            continue;
        }
        memset(sample, 0, sizeof sample);
        if (record->hit)
            switch ((enum aov)aov) {
            case AOV_DEPTH: sample[0] = tile_depth(scene, ray, record->distance); break;
            case AOV_NORMAL: memcpy(sample, &normal, sizeof normal); break;
            case AOV_ALBEDO: memcpy(sample, &record->albedo, sizeof record->albedo); break;
            case AOV_POSITION: memcpy(sample, &record->position, sizeof record->position); break;
            case AOV_UV:
                sample[0] = record->u;
                sample[1] = record->v;
                break;
            case AOV_OBJECT_ID: sample[0] = (real)record->instance + 1; break;
            case AOV_MATERIAL_ID: sample[0] = (real)record->material + 1; break;
            case AOV_MOTION:
                view_motion(scene, record->instance, record->triangle, record->b1, record->b2, motion);
                memcpy(sample, motion, sizeof motion);
                break;
            case AOV_ALPHA:
            case AOV_DENOISING:
            case AOV_DENOISING_ALBEDO:
            case AOV_DENOISING_NORMAL:
            case AOV_EMISSION:
            case AOV_SAMPLES:
            case AOV_ERROR:
            case AOV_VARIANCE:
            case AOV_CRYPTOMATTE:
            case AOV_CRYPTO_OBJECT:
            case AOV_CRYPTO_MATERIAL:
            case AOV_CRYPTO_ASSET:
            case AOV_COUNT: break;
            }
        if (aov == AOV_ALPHA)
            sample[0] = 1 - record->passed;
        else if (aov == AOV_DENOISING)
            sample[0] = record->length;
        else if (aov == AOV_DENOISING_ALBEDO)
            memcpy(sample, &record->rough_albedo, sizeof record->rough_albedo);
        else if (aov == AOV_DENOISING_NORMAL)
            memcpy(sample, &record->rough_normal, sizeof record->rough_normal);
        else if (aov == AOV_EMISSION)
            memcpy(sample, &record->emission, sizeof record->emission);
        for (uint32_t c = 0; c < channels; c++, at++) {
            int good = isfinite(sample[c]) || !SAFEGUARD(FINITE_VARIABLE);
            real value = good ? sample[c] : 0;
            bad |= !good;
            if (!aov_is_point((enum aov)aov))
                values[at] += (double)value;
            else if (first)
                values[at] = (double)value;
        }
    }
    if (bad)
        health_note(HEALTH_DROPPED_AOVS);
}

/* What a pixel's samples are of. */
struct tile_mattes {
    struct matte_tally objects, materials;
};

static __attribute__((noinline)) void tile_count_things(const struct path_record *record, struct tile_mattes *mattes)
{
    if (!record->hit)
        return;
    matte_tally_add(&mattes->objects, record->instance + 1);
    matte_tally_add(&mattes->materials, record->material + 1);
}

/* Into the pixel's `values`, in the enum's order. */
static __attribute__((noinline)) void tile_put_mattes(uint32_t mask, const struct tile_mattes *mattes, double *values)
{
    if (mask >> AOV_CRYPTO_OBJECT & 1)
        matte_tally_get(&mattes->objects, values + aov_floats(mask & ((1u << AOV_CRYPTO_OBJECT) - 1)));
    if (mask >> AOV_CRYPTO_MATERIAL & 1)
        matte_tally_get(&mattes->materials, values + aov_floats(mask & ((1u << AOV_CRYPTO_MATERIAL) - 1)));
}

/* For the shares of the light that clamping and --max-depth took: the light of one wavelength is outside
 * Rec. 709, and its luminance there may be less than none. */
static double tile_luminance(double r, double g, double b)
{
    return fmax(0.212656 * r + 0.715158 * g + 0.072186 * b, 0);
}

/* Scale the sample down so that its largest channel is `limit`. */
static __attribute__((cold, noinline)) struct vec3 tile_clamped(struct vec3 radiance, real limit,
                                                                struct render_stats *stats)
{
    double r = (double)radiance.x, g = (double)radiance.y, b = (double)radiance.z;
    double scale = (double)limit / (double)vec3_max(radiance);

    stats->work.clamped_samples++;
    stats->work.clamped_luminance += tile_luminance(r, g, b) * (1 - scale);
    return vec3_make((real)(r * scale), (real)(g * scale), (real)(b * scale));
}

/* What the pixel's samples added. Not inlined: it would change the code of the pixel loop. */
static __attribute__((noinline)) void tile_count_seen(const double sum[3], real limit, struct render_stats *stats)
{
    const double seen = tile_luminance(sum[0], sum[1], sum[2]);

    stats->work.depth.sum[DEPTH_SEEN] += seen;
    if (limit > 0)
        stats->work.kept_luminance += seen;
}

static float32 tile_float(double sum)
{
    if (!SAFEGUARD(SUM_RANGE) || sum < (double)FLT_MAX)
        return (float32)sum;
    health_note(HEALTH_CLAMPED_VALUES);
    return FLT_MAX;
}

/* What is directly seen must be no more of the sample than is added of it. */
static __attribute__((noinline)) void tile_match_emission(struct path_record *record, struct vec3 radiance, real limit)
{
    if (!vec3_is_finite(radiance))
        record->emission = vec3_splat(0);
    else if (limit > 0 && vec3_max(radiance) > limit)
        record->emission = vec3_scale(record->emission, limit / vec3_max(radiance));
}

/* ---- health ---------------------------------------------------------------------------------- */

static inline int tile_is_sound(struct vec3 radiance)
{
    return radiance.x >= 0 && radiance.y >= 0 && radiance.z >= 0 && radiance.x + radiance.y + radiance.z < INFINITY;
}

/* What was noted since the last call began with this sample. */
static __attribute__((cold, noinline)) void tile_examples(struct render_stats *stats, struct health_place place)
{
    for (int k = 0; k < HEALTH_KINDS; k++)
        if (health_scope.noted >> k & 1)
            health_example(&stats->work.health, (enum health_kind)k, 0, health_key(place));
    health_scope.noted = 0;
}

/* A sample that something was noted of, or that is not finite or negative: is it added all the same?
 * Wavelengths have colours with negative parts (dispersion.h). */
static __attribute__((cold, noinline)) int tile_keeps(const struct render_scene *scene, struct vec3 radiance,
                                                      struct health_place place, struct render_stats *stats)
{
    int finite = vec3_is_finite(radiance) || !SAFEGUARD(FINITE_SAMPLE);

    if (!finite)
        health_note(HEALTH_DROPPED_SAMPLES);
    else if (vec3_min(radiance) < 0 && !(scene->effects & EFFECT_DISPERSION))
        health_note(HEALTH_NEGATIVE_SAMPLES);
    tile_examples(stats, place);
    return finite;
}

/* The radiance of one sample, which may be no number. */
static inline __attribute__((always_inline)) struct vec3 tile_trace(
    const struct render_scene *scene, uint32_t x, uint32_t y, uint32_t number, const struct sampler *sampler,
    const struct ray *ray, struct camera_cone cone, struct path_record *record, struct render_stats *stats)
{
    struct vec3 radiance;

    FAULT_BEGIN(x, y, number);
    radiance = path_radiance(scene, sampler, ray, cone, record, stats);
    stats->work.samples++;
    PROFILE_STAGE(REST);
    if (FAULT(NAN_RADIANCE))
        radiance.y = NAN;
    if (FAULT(NEGATIVE_RADIANCE))
        radiance.z = -1;
    if (FAULT(HUGE_RADIANCE))
        radiance.x = FLT_MAX;
    return radiance;
}

/* Start several of a pixel's samples together. Each one's arithmetic is a chain of dependent steps;
 * the processor overlaps independent chains. */
static void tile_start(const struct render_scene *scene, uint32_t frame, uint32_t x, uint32_t y, uint32_t group,
                       uint32_t first, uint32_t count, struct sampler *samplers, struct sampler_batch *batch,
                       struct ray *rays)
{
    PROFILE_STAGE(CAMERA);
    sampler_start(&samplers[0], scene->settings.seed, frame, x, y, group, first);
    if (count > 1)
        sampler_start_batch(samplers, first, count, sampler_batch_pays() ? batch : NULL);
    if (scene->settings.sampler == SAMPLER_INDEPENDENT)
        for (uint32_t k = 0; k < count; k++)
            sampler_isolate(&samplers[k]);
    for (uint32_t k = 0; k < count; k++)
        camera_ray(&scene->camera, x, y, &samplers[k], &rays[k]);
}

size_t tile_render(const struct render_scene *scene, uint32_t frame, uint32_t tile, uint32_t group, uint32_t pass,
                   float32 *sums, struct tail *tail, struct render_stats *stats)
{
    const struct render_settings *settings = &scene->settings;
    struct tile_rect rect = tile_rect_of(settings->width, settings->height, tile);
    size_t pixels = (size_t)rect.width * rect.height, index = 0;
    size_t aov_base = PIXEL_FLOATS * pixels;
    uint32_t begin, end, aovs = unit_aovs(settings->aovs, group, pass), extra = aov_floats(aovs);
    struct camera_cone cone = camera_cone(&scene->camera);
    const real limit = settings->clamp;
    struct sampler samplers[SAMPLER_LANES];
    struct ray rays[SAMPLER_LANES];
    struct sampler_batch batch;
    struct tile_mattes mattes;

    pass_range(settings->spp, group, pass, &begin, &end);
    health_scope = (struct health_scope){stats->work.health.count, 0};
    if (tail)
        tail->count = 0;
    rect.x += settings->region_x; /* from here on, pixels are the whole picture's */
    rect.y += settings->region_y;
    for (uint32_t y = rect.y; y < rect.y + rect.height; y++)
        for (uint32_t x = rect.x; x < rect.x + rect.width; x++, index++) {
            double sum[3] = {0}, values[AOV_FLOATS_MAX] = {0};
            if (aovs & AOV_MATTES)
                mattes.objects.count = mattes.objects.lost = mattes.materials.count = mattes.materials.lost = 0;
            for (uint32_t i = begin, at = 0, ready = 0; i < end; i++, at++) {
                struct path_record record;
                struct vec3 radiance;
                if (at == ready) {
                    at = 0;
                    ready = end - i < SAMPLER_LANES ? end - i : SAMPLER_LANES;
                    tile_start(scene, frame, x, y, group, i, ready, samplers, &batch, rays);
                }
                if (extra)
                    memset(&record, 0, sizeof record);
                radiance = tile_trace(scene, x, y, i * GROUPS + group, &samplers[at], &rays[at], cone,
                                      extra ? &record : NULL, stats);
                if (aovs >> AOV_EMISSION & 1)
                    tile_match_emission(&record, radiance, limit);
                if (extra) {
                    tile_aovs(scene, aovs, &rays[at], &record, i == 0, values);
                    if (aovs & AOV_MATTES)
                        tile_count_things(&record, &mattes);
                }
                if ((health_scope.noted || !tile_is_sound(radiance)) &&
                    !tile_keeps(scene, radiance, (struct health_place){pass, tile, (uint32_t)index, i * GROUPS + group},
                                stats))
                    continue;
                if (limit > 0 && vec3_max(radiance) > limit)
                    radiance = tile_clamped(radiance, limit, stats);
                sum[0] += (double)radiance.x;
                sum[1] += (double)radiance.y;
                sum[2] += (double)radiance.z;
                if (tail)
                    tail_add(tail, (float32)vec3_luminance(radiance), (uint32_t)index);
            }
            for (size_t c = 0; c < 3; c++)
                sums[index * 3 + c] = tile_float(sum[c]);
            tile_count_seen(sum, limit, stats);
            if (aovs & AOV_MATTES)
                tile_put_mattes(aovs, &mattes, values);
            for (uint32_t aov = 0, at = 0; extra && aov < AOV_COUNT; aov++) {
                uint32_t channels = aovs >> aov & 1 ? aov_channels((enum aov)aov) : 0;
                for (uint32_t c = 0; c < channels; c++)
                    sums[aov_base + at * pixels + index * channels + c] = tile_float(values[at + c]);
                at += channels;
            }
            if (health_scope.noted) /* by sums: they begin with the pass */
                tile_examples(stats, (struct health_place){pass, tile, (uint32_t)index, begin * GROUPS + group});
        }
    PROFILE_IDLE();
    health_scope.count = NULL;
    return aov_base + extra * pixels;
}

/* The pass that sample i of a group is in. */
static uint32_t pass_with(uint32_t i)
{
    uint32_t pass = 0;

    while (pass_boundary(pass) <= i)
        pass++;
    return pass;
}

struct vec3 sample_render(const struct render_scene *scene, uint32_t frame, uint32_t x, uint32_t y, uint32_t number,
                          struct vec3 *radiance, struct render_stats *stats)
{
    const struct render_settings *s = &scene->settings;
    const uint32_t column = x - s->region_x, row = y - s->region_y;
    const uint32_t tile = row / TILE_SIZE * tiles_across(s->width) + column / TILE_SIZE;
    const struct tile_rect rect = tile_rect_of(s->width, s->height, tile);
    const uint32_t group = number % GROUPS, i = number / GROUPS;
    const struct health_place place = {pass_with(i), tile,
                                       (row - rect.y) * rect.width + column - rect.x, number};
    const real limit = scene->settings.clamp;
    struct sampler sampler;
    struct vec3 added;
    struct ray ray;

    health_scope = (struct health_scope){stats->work.health.count, 0};
    tile_start(scene, frame, x, y, group, i, 1, &sampler, NULL, &ray);
    added = tile_trace(scene, x, y, number, &sampler, &ray, camera_cone(&scene->camera), NULL, stats);
    if (radiance)
        *radiance = added;
    /* As in tile_render, where a function of both would cost each sample a few instructions. */
    if ((health_scope.noted || !tile_is_sound(added)) && !tile_keeps(scene, added, place, stats))
        added = vec3_splat(0);
    if (limit > 0 && vec3_max(added) > limit)
        added = tile_clamped(added, limit, stats);
    PROFILE_IDLE();
    health_scope.count = NULL;
    return added;
}

#ifdef KERNEL_NAME
#if __has_attribute(externally_visible) /* gcc's -fwhole-program needs it */
#define KERNEL_ROW __attribute__((externally_visible))
#else
#define KERNEL_ROW
#endif
/* The kernel that these files are compiled into: others see it as kernel_NAME (Makefile). */
extern const struct kernel kernel_row KERNEL_ROW;
const struct kernel kernel_row = {KERNEL_NAME, KERNEL_EFFECTS, tile_render, path_accept,
                                  KERNEL_RECORDS ? sample_render : NULL, KERNEL_RECORDS ? path_arrives : NULL};
#endif
