/* The manifest's shares of the time. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>
#include <jansson.h>

#include "common/scene/manifest.h"

static struct manifest of_effects(uint64_t effects)
{
    return (struct manifest){.job_name = "job", .scene_name = "scene", .scene_digest = "00",
                             .renderer = "renderer", .effects = effects, .called_for = effects};
}

static json_t *written(const struct manifest *m)
{
    struct buffer out = BUFFER_INIT;
    json_error_t why;
    json_t *json;

    manifest_write(&out, m);
    assert_true(buffer_ok(&out));
    json = json_loadb((const char *)out.data, out.size, JSON_REJECT_DUPLICATES, &why);
    if (!json)
        fail_msg("line %d: %s", why.line, why.text);
    buffer_release(&out);
    return json;
}

/* The row of an effect that ran; NULL: none. */
static const json_t *row_of(const json_t *json, const char *effect)
{
    const json_t *row;
    size_t i;

    json_array_foreach(json_object_get(json, "ran"), i,
                       row) if (strcmp(json_string_value(json_object_get(row, "effect")), effect) == 0) return row;
    return NULL;
}

static double share_of(const json_t *json, const char *effect)
{
    const json_t *share = json_object_get(row_of(json, effect), "share");

    assert_true(json_is_number(share));
    return json_number_value(share);
}

static double no_effect(const json_t *json)
{
    return json_number_value(json_object_get(json_object_get(json, "time"), "no_effect"));
}

static void test_shares(void **state)
{
    struct manifest m = of_effects(EFFECT_DIFFUSE | EFFECT_TEXTURE | EFFECT_SHEEN | EFFECT_INSTANCING);
    json_t *json;

    (void)state;
    m.stages[STAGE_TRACE] = 200;
    m.accounts[0] = 60;
    m.accounts[EFFECT_BIT_DIFFUSE + 1] = 100;
    m.accounts[EFFECT_BIT_TEXTURE + 1] = 40;
    json = written(&m);
    assert_true(share_of(json, "diffuse") == 0.5);
    assert_true(share_of(json, "texture") == 0.2);
    assert_true(share_of(json, "sheen") == 0); /* nobody saw it, but it ran */
    assert_true(no_effect(json) == 0.3);
    assert_non_null(row_of(json, "instancing"));
    assert_null(json_object_get(row_of(json, "instancing"), "share"));
    json_decref(json);
}

/* What is charged to those that did not run, or cannot be told apart, is nobody's: the shares
 * are of the whole. */
static void test_whole(void **state)
{
    struct manifest m = of_effects(EFFECT_DIFFUSE | EFFECT_TEXTURE | EFFECT_CAUSTICS);
    double sum;
    json_t *json;
    const json_t *row;
    size_t i;

    (void)state;
    for (int k = 0; k < EFFECT_ACCOUNTS; k++)
        m.accounts[k] = (uint64_t)k * 7 % 13 + 1;
    json = written(&m);
    sum = no_effect(json);
    assert_int_equal(json_array_size(json_object_get(json, "ran")), 3);
    json_array_foreach(json_object_get(json, "ran"), i, row) sum += json_number_value(json_object_get(row, "share"));
    assert_true(fabs(sum - 1) < 5e-5 * 4);
    json_decref(json);
}

static void test_nobody_looked(void **state)
{
    struct manifest m = of_effects(EFFECT_DIFFUSE);
    json_t *json = written(&m);

    (void)state;
    assert_true(json_is_null(json_object_get(row_of(json, "diffuse"), "share")));
    assert_true(json_is_null(json_object_get(json_object_get(json, "time"), "no_effect")));
    json_decref(json);
}

/* What was switched off did nothing, and has no share. */
static void test_switched_off(void **state)
{
    struct manifest m = of_effects(EFFECT_DIFFUSE);
    json_t *json;
    const json_t *off;

    (void)state;
    m.called_for = EFFECT_DIFFUSE | EFFECT_SHEEN;
    m.without = EFFECT_SHEEN;
    m.accounts[0] = m.accounts[EFFECT_BIT_DIFFUSE + 1] = m.accounts[EFFECT_BIT_SHEEN + 1] = 1;
    json = written(&m);
    off = json_array_get(json_object_get(json, "switched_off"), 0);
    assert_string_equal(json_string_value(json_object_get(off, "effect")), "sheen");
    assert_null(json_object_get(off, "share"));
    assert_true(fabs(no_effect(json) - 2.0 / 3) < 1e-4);
    json_decref(json);
}

/* Every counter, under the key that it has in all JSON. */
static void test_work(void **state)
{
#define KEY(name, limit, attribute) #name,
    static const char *const keys[] = {WORK_COUNTERS(KEY)};
#undef KEY
    struct manifest m = of_effects(EFFECT_DIFFUSE);
    struct unit_work work = {.samples = 1};
    json_t *json;

    (void)state;
    for (int i = 0; i < WORK_COUNTER_COUNT; i++)
        work.count[i] = (uint64_t)i + 1;
    m.work = &work;
    json = written(&m);
    for (int i = 0; i < WORK_COUNTER_COUNT; i++)
        assert_int_equal(json_integer_value(json_object_get(json_object_get(json, "work"), keys[i])), i + 1);
    json_decref(json);
}

/* null where nothing is known, and where no deeper path is recommended. */
static void test_depth(void **state)
{
    struct manifest m = of_effects(EFFECT_DIFFUSE);
    const char *const key = "ended_by_depth";
    const json_t *depth;
    json_t *json = written(&m);

    (void)state;
    assert_true(json_is_null(json_object_get(json_object_get(json, "picture"), key)));
    json_decref(json);
    m.depth_known = 1;
    m.max_depth = 8;
    m.depth.share = 0.004;
    json = written(&m);
    depth = json_object_get(json_object_get(json, "picture"), key);
    assert_true(json_number_value(json_object_get(depth, "share")) == 0.004);
    assert_int_equal(json_integer_value(json_object_get(depth, "max_depth")), 8);
    assert_true(json_is_null(json_object_get(depth, "deeper")) && json_is_null(json_object_get(depth, "deeper_share")));
    json_decref(json);
    m.depth = (struct depth_report){0.25, 32, 0.0099};
    json = written(&m);
    depth = json_object_get(json_object_get(json, "picture"), key);
    assert_int_equal(json_integer_value(json_object_get(depth, "deeper")), 32);
    assert_true(json_number_value(json_object_get(depth, "deeper_share")) == 0.0099);
    json_decref(json);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_shares),
        cmocka_unit_test(test_whole),
        cmocka_unit_test(test_nobody_looked),
        cmocka_unit_test(test_switched_off),
        cmocka_unit_test(test_work), cmocka_unit_test(test_depth),
    };

    return cmocka_run_group_tests_name("manifest", tests, NULL, NULL);
}
