/* The ways, what each sets, and whether its question arises. */
#include "client/study/run_ways.h"
#include "common/scene/scene_effects.h"

static const char *const titles[KNOB_COUNT] = {
    "Adaptive sampling", "Sampler", "Environment sampling", "Choice of lights", "Path depth", "Russian roulette",
    "Clamping of fireflies", "Bits of the picture", "Robust traversal", "Quality of the BVH",
    "Texture filter", "Instruction set", "Precision", "Effects left out"};

/* Clamps are in multiples of the picture's mean. */
static const struct way ways[] = {
    {KNOB_ALLOCATION, 0, "uniform", "The same samples everywhere"},
    {KNOB_ALLOCATION, 1, "adaptive", "More samples where the grain is"},
    {KNOB_SAMPLER, SAMPLER_SOBOL, "Sobol", "Scrambled Sobol' points"},
    {KNOB_SAMPLER, SAMPLER_INDEPENDENT, "independent", "Independent random numbers"},
    {KNOB_ENVIRONMENT, ENV_SAMPLING_LEARNED, "learned", "Environment sampled by what arrives of it"},
    {KNOB_ENVIRONMENT, ENV_SAMPLING_IMPORTANCE, "importance", "Environment sampled by importance"},
    {KNOB_ENVIRONMENT, ENV_SAMPLING_UNIFORM, "uniform", "Environment sampled uniformly"},
    {KNOB_ENVIRONMENT, ENV_SAMPLING_BSDF, "BSDF", "Environment found by the surfaces' directions alone"},
    {KNOB_ENVIRONMENT, ENV_SAMPLING_IMPORTANCE_ONLY, "no MIS", "Environment sampled by importance alone"},
    {KNOB_ENVIRONMENT, ENV_SAMPLING_UNIFORM_ONLY, "uniform, no MIS", "Environment sampled uniformly, alone"},
    {KNOB_LIGHTS, LIGHT_CHOICE_LEARNED, "learned", "Lights chosen by a tree, and by what arrives of them"},
    {KNOB_LIGHTS, LIGHT_CHOICE_TREE, "tree", "Lights chosen by a tree alone"},
    {KNOB_LIGHTS, LIGHT_CHOICE_POWER, "power", "Lights chosen by power"},
    {KNOB_LIGHTS, LIGHT_CHOICE_UNIFORM, "uniform", "Lights chosen all alike"},
    {KNOB_DEPTH, 1, "1", "Paths of 1 edge"},
    {KNOB_DEPTH, 2, "2", "Paths of at most 2 edges"},
    {KNOB_DEPTH, 4, "4", "Paths of at most 4 edges"},
    {KNOB_DEPTH, 8, "8", "Paths of at most 8 edges"},
    {KNOB_DEPTH, 16, "16", "Paths of at most 16 edges"},
    {KNOB_ROULETTE, 0, "on", "Russian roulette on"},
    {KNOB_ROULETTE, 1, "off", "Russian roulette off"},
    {KNOB_CLAMP, 100, "100 x mean", "Samples above 100 times the picture's mean scaled down"},
    {KNOB_CLAMP, 10, "10 x mean", "Samples above 10 times the picture's mean scaled down"},
    {KNOB_HALF, 0, "32", "32-bit floats"},
    {KNOB_HALF, 1, "16", "16-bit floats"},
    {KNOB_ROBUST, 0, "on", "Robust traversal"},
    {KNOB_ROBUST, 1, "off", "Robust traversal off"},
    {KNOB_BVH, BVH_QUALITY_MEDIUM, "medium", "BVH of medium quality"},
    {KNOB_BVH, BVH_QUALITY_LOW, "low", "BVH of low quality"},
    {KNOB_BVH, BVH_QUALITY_HIGH, "high", "BVH of high quality, robust traversal off"},
    {KNOB_FILTER, TEXTURE_FILTER_CONE, "cone", "Textures filtered by the ray's cone"},
    {KNOB_FILTER, TEXTURE_FILTER_BILINEAR, "bilinear", "Textures interpolated at their finest level"},
    {KNOB_FILTER, TEXTURE_FILTER_NEAREST, "nearest", "Textures by their nearest texel"},
    {KNOB_ISA, ISA_SSE2, "sse2", "Rays traced with SSE2"},
    {KNOB_ISA, ISA_AVX2, "avx2", "Rays traced with AVX2"},
    {KNOB_ISA, ISA_AVX512, "avx512", "Rays traced with AVX-512"},
    {KNOB_PRECISION, 0, "float", "Arithmetic in float"},
    {KNOB_PRECISION, 1, "double", "Arithmetic in double"},
};

_Static_assert(sizeof ways / sizeof *ways == WAYS, "the plan has room for all ways");

static double mean_radiance(const struct image *picture)
{
    const size_t count = (size_t)picture->width * picture->height * 3;
    double sum = 0;

    for (size_t i = 0; i < count; i++)
        sum += (double)picture->pixels[i];
    return sum / (double)count;
}

static void apply(struct job_request *request, const struct way *way, double mean)
{
    struct render_settings *s = &request->settings;

    switch (way->knob) {
    case KNOB_ALLOCATION: request->stop.adaptive = way->value; break;
    case KNOB_SAMPLER: s->sampler = (enum sampler_kind)way->value; break;
    case KNOB_ENVIRONMENT: s->env_sampling = (enum env_sampling)way->value; break;
    case KNOB_LIGHTS: s->light_choice = (enum light_choice)way->value; break;
    case KNOB_DEPTH: s->max_depth = (uint32_t)way->value; break;
    case KNOB_ROULETTE: s->no_roulette = way->value; break;
    case KNOB_CLAMP: s->clamp = (float)(mean * way->value); break;
    case KNOB_HALF: request->output.half = way->value; break;
    case KNOB_ROBUST: s->not_robust = way->value; break;
    case KNOB_BVH:
        s->bvh_quality = (enum bvh_quality)way->value;
        s->not_robust |= way->value == BVH_QUALITY_HIGH;
        break;
    case KNOB_FILTER: s->texture_filter = (enum texture_filter)way->value; break;
    case KNOB_ISA: s->isa = (enum isa)way->value; break;
    case KNOB_EFFECT: s->without |= (uint64_t)1 << way->value; break;
    case KNOB_PRECISION: /* of the worker, not of the job */
    case KNOB_COUNT: break;
    }
}

/* Does the question arise in this scene? */
static int arises(const struct study_run *run, const struct way *way, uint64_t set, double mean)
{
    const struct render_settings *s = &run->request->settings;

    switch (way->knob) {
    case KNOB_ENVIRONMENT: return (set & EFFECT_ENVIRONMENT) != 0;
    case KNOB_LIGHTS: return (set & (EFFECT_EMISSIVE_MESH | EFFECT_PUNCTUAL_LIGHT)) != 0;
    case KNOB_CLAMP: return mean > 0 && s->clamp <= 0;
    case KNOB_ROBUST: return way->value == 0 || s->bvh_quality != BVH_QUALITY_HIGH;
    case KNOB_FILTER: return (set & EFFECT_TEXTURE) != 0;
    /* The processors of other machines are not known here. */
    case KNOB_ISA: return (int)s->isa == way->value || (run->local && (isa_supported_mask() >> way->value & 1));
    case KNOB_PRECISION: return run->connect != NULL;
    case KNOB_EFFECT: return (set & EFFECTS_SWITCHABLE) >> way->value & 1;
    default: return 1;
    }
}

void plan_make(struct plan *plan, const struct study_run *run)
{
    const uint64_t set = scene_effects(&run->scene->scene, &run->request->settings, run->request->first_frame, NULL);
    const double mean = mean_radiance(&run->usual);

    plan->count = 0;
    for (size_t i = 0; i < PLAN_MAX; i++) {
        struct way way = {KNOB_EFFECT, (int)(i - WAYS), NULL, NULL};
        if (i < WAYS)
            way = ways[i];
        else
            way.name = way.words = effect_name((enum effect_bit)way.value);
        if (!arises(run, &way, set, mean))
            continue;
        plan->ways[plan->count] = way;
        plan->requests[plan->count] = *run->request;
        apply(&plan->requests[plan->count++], &way, mean);
    }
}

int plan_is_usual(const struct study_run *run, const struct plan *plan, size_t i)
{
    const struct job_request *request = &plan->requests[i];

    return !(plan->ways[i].knob == KNOB_PRECISION && plan->ways[i].value) &&
           render_settings_equal(&request->settings, &run->request->settings) &&
           request->output.half == run->request->output.half && request->stop.adaptive == run->request->stop.adaptive;
}

void plan_drop(struct plan *plan, enum knob knob)
{
    size_t kept = 0;

    for (size_t i = 0; i < plan->count; i++)
        if (plan->ways[i].knob != knob) {
            plan->ways[kept] = plan->ways[i];
            plan->requests[kept++] = plan->requests[i];
        }
    plan->count = kept;
}

const char *way_title(enum knob knob) { return titles[knob]; }

int way_is_unbiased(const struct way *way, const struct render_settings *usual)
{
    return usual->clamp <= 0 &&
           (way->knob == KNOB_ALLOCATION || way->knob == KNOB_SAMPLER || way->knob == KNOB_ENVIRONMENT ||
            way->knob == KNOB_LIGHTS || way->knob == KNOB_ROULETTE);
}
