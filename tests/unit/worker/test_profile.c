/* The profile: what a thread was found at, and for which effect. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "common/system/clock.h"
#include "tests/support/scene_builder.h"
#include "worker/profile.h"
#include "worker/render/base/profile_scope.h"

enum { SIZE = 32, SPP = 64 };
static const uint64_t LIMIT_NS = 60 * NS_PER_SECOND; /* for what takes a tenth of a second */

static int start(void **state)
{
    struct error err = {0};

    (void)state;
    if (profile_start(NS_PER_MS, &err) != STATUS_OK)
        return -1;
    profile_join();
    return 0;
}

static int stop(void **state)
{
    (void)state;
    profile_leave();
    profile_stop();
    return 0;
}

static uint64_t sum(const uint64_t *counts, int n)
{
    uint64_t all = 0;

    for (int i = 0; i < n; i++)
        all += counts[i];
    return all;
}

/* A thread that stays in one stage for one effect is found there and nowhere else. */
static void test_one_place(void **state)
{
    struct profile_counts before, now;
    uint64_t end = clock_monotonic_ns() + LIMIT_NS;

    (void)state;
    profile_counts(&before);
    PROFILE_STAGE(SCATTER);
    {
        PROFILE_EFFECT(SHEEN);
        do
            profile_counts(&now);
        while (now.accounts[PROFILE_ACCOUNT(SHEEN)] - before.accounts[PROFILE_ACCOUNT(SHEEN)] < 20 &&
               clock_monotonic_ns() < end);
    }
    PROFILE_IDLE();
    profile_counts(&now);
    for (int i = 0; i < EFFECT_ACCOUNTS; i++) {
        if (i == PROFILE_ACCOUNT(SHEEN))
            assert_true(now.accounts[i] - before.accounts[i] >= 20);
        else
            assert_int_equal(now.accounts[i], before.accounts[i]);
    }
    for (int i = 0; i < STAGE_COUNT; i++)
        if (i != STAGE_SCATTER)
            assert_int_equal(now.stages[i], before.stages[i]);
}

static void dress_plastic(struct scene_builder *b, struct scene_material *ball)
{
    (void)b;
    ball->specular = 1;
    ball->roughness = 0.3f;
}

static void dress_metal(struct scene_builder *b, struct scene_material *ball)
{
    (void)b;
    ball->metallic = 1;
    ball->roughness = 0.6f;
}

static void dress_glass(struct scene_builder *b, struct scene_material *ball)
{
    (void)b;
    ball->specular = ball->transmission = 1;
    ball->refractive = 1;
    ball->roughness = 0;
    ball->dispersion = 0.5f;
    ball->attenuation_distance = 2;
    ball->attenuation_color[0] = 0.5f;
}

static void dress_coat(struct scene_builder *b, struct scene_material *ball)
{
    dress_plastic(b, ball);
    ball->clearcoat = 0.8f;
    ball->clearcoat_roughness = 0.1f;
    ball->sheen_color[0] = 0.8f;
    ball->sheen_roughness = 0.4f;
}

static void dress_sheen(struct scene_builder *b, struct scene_material *ball)
{
    (void)b;
    ball->sheen_color[0] = 0.8f;
    ball->sheen_roughness = 0.4f;
}

static void dress_texture(struct scene_builder *b, struct scene_material *ball)
{
    static const float checks[12] = {1, 1, 1, 0.2f, 0.2f, 0.2f, 0.2f, 0.2f, 0.2f, 1, 1, 1};

    (void)ball;
    b->scene.materials[0].base_color_texture.texture = (int32_t)builder_texture(b, checks, 2, 2);
}

static void dress_alpha(struct scene_builder *b, struct scene_material *ball)
{
    (void)b;
    ball->alpha_mode = ALPHA_BLEND;
    ball->base_color[3] = 0.5f;
}

static void dress_fog(struct scene_builder *b, struct scene_material *ball)
{
    struct scene_medium *fog = builder_medium(b);

    (void)ball;
    for (int c = 0; c < 3; c++)
        fog->scattering[c] = 0.1f;
    b->scene.fog = 0;
}

#define STAGE_BIT(name) (1u << STAGE_##name)

static const struct {
    const char *name;
    void (*dress)(struct scene_builder *b, struct scene_material *ball);
    uint64_t found;  /* of the effects, these are sure to be met in a while */
    unsigned stages; /* and of the stages, beside those of every room */
} rooms[] = {
    {"lambert", NULL, EFFECT_DIFFUSE | EFFECT_EMISSIVE_MESH | EFFECT_ENVIRONMENT, 0},
    {"plastic", dress_plastic, EFFECT_GLOSSY, 0}, /* its compensation goes with its base */
    {"metal", dress_metal, EFFECT_GLOSSY | EFFECT_MULTIPLE_SCATTERING, 0},
    {"glass", dress_glass, EFFECT_DIELECTRIC | EFFECT_ABSORPTION, STAGE_BIT(MEDIUM)},
    {"coat", dress_coat, EFFECT_CLEARCOAT | EFFECT_SHEEN, 0},
    {"sheen", dress_sheen, EFFECT_DIFFUSE | EFFECT_SHEEN, 0},
    {"texture", dress_texture, EFFECT_TEXTURE, 0},
    {"alpha", dress_alpha, EFFECT_ALPHA, 0},
    {"fog", dress_fog, EFFECT_FOG, STAGE_BIT(MEDIUM)},
};

static uint64_t found_since(const struct profile_counts *before)
{
    struct profile_counts now;
    uint64_t set = 0;

    profile_counts(&now);
    for (int i = 1; i < EFFECT_ACCOUNTS; i++)
        if (now.accounts[i] > before->accounts[i])
            set |= (uint64_t)1 << (i - 1);
    return set;
}

static unsigned stages_since(const struct profile_counts *before)
{
    struct profile_counts now;
    unsigned set = 0;

    profile_counts(&now);
    for (int i = 0; i < STAGE_COUNT; i++)
        if (now.stages[i] > before->stages[i])
            set |= 1u << i;
    return set;
}

/* Every stage is found, and rendering is charged to effects of the scene that have an account, and to nothing else, whichever
 * kernel runs. */
static void test_rooms(void **state)
{
    static float sums[2 * 3 * 256];

    (void)state;
    for (size_t i = 0; i < 2 * sizeof rooms / sizeof *rooms; i++) {
        size_t k = i / 2;
        struct render_settings settings = builder_settings(SIZE, SIZE, SPP);
        struct profile_counts before, after;
        struct render_stats stats = {0};
        struct render_scene *scene;
        struct scene_builder b;
        uint64_t found = 0, end, allowed;
        unsigned stages = STAGE_BIT(CAMERA) | STAGE_BIT(TRACE) | STAGE_BIT(SURFACE) | STAGE_BIT(SCATTER) |
                          STAGE_BIT(LIGHT) | rooms[k].stages;

        builder_room(&b, rooms[k].dress);
        render_force_general(i % 2);
        scene = builder_build(&b, &settings);
        render_force_general(0);
        allowed = render_effects(scene) & ~EFFECTS_WITHOUT_TIME;
        assert_int_equal(rooms[k].found & ~allowed, 0);
        profile_counts(&before);
        end = clock_monotonic_ns() + LIMIT_NS;
        for (uint32_t unit = 0;
             (rooms[k].found & ~found || stages & ~stages_since(&before)) && clock_monotonic_ns() < end; unit++) {
            uint32_t tiles = tile_count(SIZE, SIZE);
            render_tile(scene, 0, unit % tiles, 0, unit / tiles % pass_count(SPP, 0), sums, NULL, &stats);
            found = found_since(&before);
        }
        profile_counts(&after);
        if (rooms[k].found & ~found || found & ~allowed)
            fail_msg("%s: %llx were charged of %llx that ran, and %llx should have been", rooms[k].name,
                     (unsigned long long)found, (unsigned long long)allowed, (unsigned long long)rooms[k].found);
        assert_int_equal(stages & ~stages_since(&before), 0);
        assert_int_equal(sum(after.stages, STAGE_COUNT) - sum(before.stages, STAGE_COUNT),
                         sum(after.accounts, EFFECT_ACCOUNTS) - sum(before.accounts, EFFECT_ACCOUNTS));
        assert_int_equal(profile_place.stage, 0);
        render_scene_free(scene);
        builder_release(&b);
    }
}

/* A thread that did not join is not counted. */
static void test_not_joined(void **state)
{
    struct profile_counts counts;

    profile_leave();
    profile_counts(&counts);
    assert_int_equal(sum(counts.stages, STAGE_COUNT) + sum(counts.accounts, EFFECT_ACCOUNTS), 0);
    profile_join();
    (void)state;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_one_place),
        cmocka_unit_test(test_rooms),
        cmocka_unit_test(test_not_joined),
    };

    return cmocka_run_group_tests_name("profile", tests, start, stop);
}
