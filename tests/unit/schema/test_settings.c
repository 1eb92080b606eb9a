/* The table of settings: that it agrees with azulejo.proto, with what its help says, and with itself. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "common/accuracy/stop.h"
#include "common/scene/effects.h"
#include "common/scene/settings.h"
#include "protocol/message.h"
#include "protocol/output.h"
#include "protocol/fields.h"

/* Each row is a field of its type. */
static void check_rows(const struct setting *rows, int count, const ProtobufCMessageDescriptor *d)
{
    for (const struct setting *row = rows; row < rows + count; row++) {
        const ProtobufCFieldDescriptor *field = protobuf_c_message_descriptor_get_field_by_name(d, row->name);

        if (row->kind == SETTING_KIND_OWN)
            continue;
        if (!field)
            fail_msg("%s has no %s", d->short_name, row->name);
        if (field->type == PROTOBUF_C_TYPE_STRING) { /* OutputSettings says the words themselves */
            assert_int_equal(row->kind, SETTING_KIND_CHOICE);
            continue;
        }
        assert_int_equal(field_bytes(field), row->bytes);
        assert_int_equal(field->type == PROTOBUF_C_TYPE_FLOAT || field->type == PROTOBUF_C_TYPE_DOUBLE,
                         row->kind == SETTING_KIND_NUMBER);
        assert_int_equal(field->type == PROTOBUF_C_TYPE_BOOL, row->kind == SETTING_KIND_SWITCH);
        assert_int_equal(row->words != NULL, row->kind == SETTING_KIND_CHOICE || row->kind == SETTING_KIND_SWITCH);
        if (row->kind == SETTING_KIND_SET)
            assert_null(choice_word(row->choice, 8 * row->bytes));
        if (row->attribute)
            assert_int_equal(strncmp(row->attribute, "azulejo:", 8), 0);
    }
}

static void rows_are_the_fields(void **state)
{
    (void)state;
    check_rows(render_settings_rows, SETTING_COUNT, &azulejo__wire__render_settings__descriptor);
    check_rows(stop_rules_rows, STOP_COUNT, &azulejo__wire__stop_rules__descriptor);
    check_rows(job_needs_rows, NEED_COUNT, &azulejo__wire__job_submit__descriptor);
    check_rows(job_needs_rows, NEED_COUNT, &azulejo__wire__job_info__descriptor);
    check_rows(look_rows, LOOK_COUNT, &azulejo__wire__output_settings__descriptor);
    assert_int_equal(azulejo__wire__render_settings__descriptor.n_fields, SETTING_COUNT + 1); /* and pinhole */
}

static void durations(void **state)
{
    const struct setting *limit = &stop_rules_rows[STOP_time_limit_ms];
    struct stop_rules rules = {0}, again;
    Azulejo__Wire__StopRules wire;
    char text[SETTING_TEXT_SIZE];
    struct error err = {0};

    (void)state;
    assert_int_equal(setting_parse(limit, "1.5s", &rules, &err), STATUS_OK);
    assert_int_equal(rules.time_limit_ms, 1500);
    assert_string_equal(setting_text(limit, &rules, text), "1.5s");
    rules.core_limit_ms = STOP_LIMIT_MS_MAX;
    rules.spp_min = 7;
    wire_stop_set(&wire, &rules);
    assert_int_equal(wire_stop_get(&again, &wire, &err), STATUS_OK);
    assert_true(again.time_limit_ms == 1500 && again.core_limit_ms == STOP_LIMIT_MS_MAX && again.spp_min == 7);
    wire.core_limit_ms++;
    assert_int_equal(wire_stop_get(&again, &wire, &err), STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, "core-limit: 1099511627.78s is outside 1..1099511627776 milliseconds"));
    assert_int_equal(setting_parse(limit, "0s", &rules, &err), STATUS_ERR_USAGE);
    assert_int_equal(setting_parse(limit, "soon", &rules, &err), STATUS_ERR_USAGE);
    assert_non_null(strstr(err.text, "--time-limit"));
}

static void powers_of_ten(void **state)
{
    static const char *const bad[] = {"2.5", "1e-3", "1e16", "9e30", "e9", "2e9x", "-2e9", "2e", ""};
    const struct setting *limit = &stop_rules_rows[STOP_max_rays];
    struct stop_rules rules = {0};
    struct error err = {0};

    (void)state;
    assert_int_equal(setting_parse(limit, "2e9", &rules, &err), STATUS_OK);
    assert_true(rules.max_rays == 2000000000);
    assert_int_equal(setting_parse(limit, "1.5e3", &rules, &err), STATUS_OK);
    assert_true(rules.max_rays == 1500);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        assert_int_equal(setting_parse(limit, bad[i], &rules, &err), STATUS_ERR_USAGE);
}

/* "(default 24)", "(default 0: as long as the camera says)". */
static void help_tells_the_default(void **state)
{
    struct render_settings s;
    struct error err = {0};
    int told = 0;

    (void)state;
    render_settings_default(&s);
    assert_int_equal(render_settings_validate(&s, 1, &err), STATUS_OK);
    for (int i = 0; i < SETTING_COUNT; i++) {
        const struct setting *row = &render_settings_rows[i];
        const char *at = row->help ? strstr(row->help, "(default ") : NULL;
        char text[SETTING_TEXT_SIZE], value[64];
        if (!at)
            continue;
        assert_int_equal(sscanf(at, "(default %63[^:)]", value), 1);
        assert_string_equal(value, setting_text(row, &s, text));
        told++;
    }
    assert_in_range(told, 10, SETTING_COUNT);
}

/* Every row of a picture's look comes back out of the wire, numbers to the last bit; what is outside is refused. */
static void looks(void **state)
{
    static const char *const values[LOOK_COUNT] = {
        [LOOK_exposure_ev] = "0.10000000000000001", [LOOK_metering] = "percentile", [LOOK_metering_percentile] = "12.5",
        [LOOK_white_kelvin] = "3200.0000000000005", [LOOK_temporal] = "7",
        [LOOK_denoise] = "fast", [LOOK_denoise_around] = "2"};
    static const char *const bad[LOOK_COUNT] = {
        [LOOK_exposure_ev] = "100.5", [LOOK_metering] = "sun", [LOOK_metering_percentile] = "101",
        [LOOK_white_kelvin] = "0", [LOOK_temporal] = "241", [LOOK_denoise] = "much", [LOOK_denoise_around] = "3"};
    struct output_settings o = {.exr = 1}, again;
    struct wire_output wire;
    struct error err = {0};

    (void)state;
    assert_int_equal(tonemap_settings_init(&o.tonemap, "linear", &err), STATUS_OK);
    for (int i = 0; i < LOOK_COUNT; i++) {
        char text[SETTING_TEXT_SIZE];
        struct tonemap_settings refused = o.tonemap;

        assert_true(setting_is_default(&look_rows[i], &o.tonemap));
        assert_int_equal(setting_parse(&look_rows[i], values[i], &o.tonemap, &err), STATUS_OK);
        wire_output_set(&wire, &o);
        assert_int_equal(wire_output_get(&again, &wire.message, &err), STATUS_OK);
        assert_string_equal(setting_text(&look_rows[i], &again.tonemap, text), values[i]);
        assert_int_equal(setting_parse(&look_rows[i], bad[i], &refused, &err), STATUS_ERR_USAGE);
    }
    wire.message.white_kelvin = 3;
    assert_int_equal(wire_output_get(&again, &wire.message, &err), STATUS_ERR_INPUT);
    wire.message.white_kelvin = 0;
    wire.message.metering = (char[]){"sun"};
    assert_int_equal(wire_output_get(&again, &wire.message, &err), STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, "off|key|percentile"));
    wire.message.metering = (char[]){""};
    wire.message.metering_percentile = 0; /* of a message without them */
    assert_int_equal(wire_output_get(&again, &wire.message, &err), STATUS_OK);
    assert_true(again.tonemap.metering == TONEMAP_METERING_OFF && again.tonemap.metering_percentile == 99);
}

/* Every option's text comes back, out of the wire, too. */
static void texts_come_back(void **state)
{
    static const char *const values[] = {"0.25", "1", "33.3", "9", "12345678901234567890", "sse2", "uniform", "independent",
                                         "power", "nearest", "low", "off", "depth,uv", "blender", "triangle"};
    char text[SETTING_TEXT_SIZE];

    (void)state;
    for (int i = 0; i < SETTING_COUNT; i++) {
        const struct setting *row = &render_settings_rows[i];
        int taken = 0;
        for (size_t k = 0; row->help && k < sizeof values / sizeof *values; k++) {
            struct render_settings s, again;
            Azulejo__Wire__RenderSettings wire;
            struct error err = {0};

            render_settings_default(&s);
            if ((row->kind == SETTING_KIND_NUMBER && strlen(values[k]) > 9) ||
                setting_parse(row, values[k], &s, &err) != STATUS_OK)
                continue;
            assert_string_equal(setting_text(row, &s, text), values[k]);
            assert_int_equal(setting_check(row, &s, &err), STATUS_OK);
            wire_settings_set(&wire, &s);
            assert_int_equal(wire_settings_get(&again, &wire, 1, &err), STATUS_OK);
            assert_true(render_settings_equal(&s, &again));
            taken++;
        }
        if (row->help && !taken && i != SETTING_without)
            fail_msg("--%s takes none of the values", row->option);
    }
}

static void bad_texts_are_refused(void **state)
{
    static const struct {
        enum setting_name name;
        const char *text, *says;
    } bad[] = {
        {SETTING_max_depth, "1025", "--max-depth: 1025 is outside 0..1024"},
        {SETTING_max_depth, "-1", "--max-depth: '-1' is not a whole number"},
        {SETTING_max_depth, "4294967296", "--max-depth: 4294967296 is outside"},
        {SETTING_seed, "18446744073709551616", "not a whole number"},
        {SETTING_seed, "", "not a whole number"},
        {SETTING_shutter, "1.5", "--shutter: 1.5 is outside 0..1"},
        {SETTING_focus_distance, "0", "--focus: 0 is outside 1e-12..1e+12"},
        {SETTING_lens_radius, "-1", "--lens: -1 is outside"},
        {SETTING_clamp, "nan", "--clamp: 'nan' is not a number"},
        {SETTING_clamp, "1x", "--clamp: '1x' is not a number"},
        {SETTING_sampler, "halton", "--sampler: 'halton' is not one of sobol|independent"},
        {SETTING_not_robust, "maybe", "--robust: 'maybe' is not one of on|off"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct render_settings s;
        struct error err = {0};

        render_settings_default(&s);
        assert_int_equal(setting_parse(&render_settings_rows[bad[i].name], bad[i].text, &s, &err), STATUS_ERR_USAGE);
        if (!strstr(err.text, bad[i].says))
            fail_msg("\"%s\" does not say \"%s\"", err.text, bad[i].says);
    }
}

static void sets(void **state)
{
    const struct setting *aovs = &render_settings_rows[SETTING_aovs];
    struct render_settings s;
    struct error err = {0};
    char text[SETTING_TEXT_SIZE];

    (void)state;
    render_settings_default(&s);
    assert_int_equal(setting_parse(aovs, "depth,object-id", &s, &err), STATUS_OK);
    assert_int_equal(setting_parse(aovs, "error", &s, &err), STATUS_OK);
    assert_int_equal(s.aovs, 1u << AOV_DEPTH | 1u << AOV_OBJECT_ID | 1u << AOV_ERROR);
    assert_string_equal(setting_text(aovs, &s, text), "depth,object-id,error");
    assert_int_equal(setting_parse(aovs, settings_aovs_text((1u << AOV_COUNT) - 1, text), &s, &err), STATUS_OK);
    assert_int_equal(s.aovs, (1u << AOV_COUNT) - 1);
    s.aovs = 7;
    assert_int_equal(setting_parse(aovs, "uv,beauty", &s, &err), STATUS_ERR_USAGE);
    assert_int_equal(s.aovs, 7);
    assert_non_null(strstr(err.text, "'beauty'"));
    assert_non_null(strstr(err.text, "depth,normal,albedo"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rows_are_the_fields), cmocka_unit_test(powers_of_ten),   cmocka_unit_test(help_tells_the_default), cmocka_unit_test(texts_come_back),
        cmocka_unit_test(bad_texts_are_refused), cmocka_unit_test(sets),
        cmocka_unit_test(durations), cmocka_unit_test(looks),
    };

    return cmocka_run_group_tests_name("the table of settings", tests, NULL, NULL);
}
