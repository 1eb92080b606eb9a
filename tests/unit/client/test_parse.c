/* The command line's small languages: sizes, frame ranges, parameters, jobs, addresses. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "client/farm/output.h"
#include "client/terminal/parse.h"
#include "common/scene/effects.h"
#include "common/scene/settings.h"

static void sizes(void **state)
{
    static const struct { const char *text; uint32_t width, height; } good[] = {
        {"1x1", 1, 1}, {"1280x720", 1280, 720}, {"600X400", 600, 400}, {"65536x4096", 65536, 4096},
        {"0010x02", 10, 2},
    };
    static const char *const bad[] = {
        "", "x", "10", "10x", "x10", "0x10", "10x0", "-1x10", "10x-1", "+1x1", " 1x1", "1x1 ", "1 x 1",
        "10x10x10", "65537x1", "1x65537", "65536x65536", "4294967297x1", "99999999999999999999x1",
        "1e3x10", "10.5x10", "0x0x",
    };
    uint32_t width, height;
    struct error err = {0};

    (void)state;
    for (size_t i = 0; i < sizeof good / sizeof good[0]; i++) {
        assert_int_equal(parse_size(good[i].text, &width, &height, &err), STATUS_OK);
        assert_int_equal(width, good[i].width);
        assert_int_equal(height, good[i].height);
    }
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        width = height = 77;
        err.text[0] = 0;
        assert_int_equal(parse_size(bad[i], &width, &height, &err), STATUS_ERR_USAGE);
        assert_non_null(strstr(err.text, "--size"));
        assert_int_equal(width, 77); /* untouched */
        assert_int_equal(height, 77);
    }
}

static void frame_ranges(void **state)
{
    static const struct { const char *text; uint32_t first, last; } good[] = {
        {"1", 1, 1}, {"0", 0, 0}, {"1-48", 1, 48}, {"7-7", 7, 7}, {"1-100000", 1, 100000},
        {"2147483647", 2147483647, 2147483647},
    };
    static const char *const bad[] = {
        "", "-", "1-", "-1", "48-1", "1-2-3", "a", "1-b", "1 - 2", "1:2", "1-100001", "0-100000",
        "2147483648", "99999999999999999999", "+1", "1-+2", "1..5", "1,2",
    };
    uint32_t first, last;
    struct error err = {0};

    (void)state;
    for (size_t i = 0; i < sizeof good / sizeof good[0]; i++) {
        assert_int_equal(parse_frames(good[i].text, &first, &last, &err), STATUS_OK);
        assert_int_equal(first, good[i].first);
        assert_int_equal(last, good[i].last);
    }
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        err.text[0] = 0;
        assert_int_equal(parse_frames(bad[i], &first, &last, &err), STATUS_ERR_USAGE);
        assert_non_null(strstr(err.text, "--frames"));
    }
}

static void parameters(void **state)
{
    static const char *const bad[] = {"", "key", "=1", "key=", "averylongname=1"};
    const char *value;
    char name[8];
    struct error err = {0};

    (void)state;
    assert_int_equal(parse_parameter("key=0.18", name, sizeof name, &value, &err), STATUS_OK);
    assert_string_equal(name, "key");
    assert_string_equal(value, "0.18");
    assert_int_equal(parse_parameter("a=b=c", name, sizeof name, &value, &err), STATUS_OK);
    assert_string_equal(name, "a");
    assert_string_equal(value, "b=c");
    /* The longest name that fits, and one byte more. */
    assert_int_equal(parse_parameter("seven77=1", name, sizeof name, &value, &err), STATUS_OK);
    assert_int_equal(parse_parameter("eight888=1", name, sizeof name, &value, &err),
                     STATUS_ERR_USAGE);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        err.text[0] = 0;
        assert_int_equal(parse_parameter(bad[i], name, sizeof name, &value, &err),
                         STATUS_ERR_USAGE);
        assert_non_null(strstr(err.text, "--tonemap-param"));
    }
}

static void formats(void **state)
{
    static const char *const bad[] = {"", "exr,", ",exr", "tif", "exr png", "EXR", "exr,,png"};
    unsigned bits = 0;
    struct error err = {0};

    (void)state;
    assert_int_equal(parse_formats("png", &bits, &err), STATUS_OK);
    assert_int_equal(bits, OUTPUT_FORMAT_PNG);
    assert_int_equal(parse_formats("jpg,exr,jpg", &bits, &err), STATUS_OK);
    assert_int_equal(bits, OUTPUT_FORMAT_JPEG | OUTPUT_FORMAT_EXR);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        err.text[0] = 0;
        assert_int_equal(parse_formats(bad[i], &bits, &err), STATUS_ERR_USAGE);
        assert_non_null(strstr(err.text, "--format"));
    }
}

static void job_numbers(void **state)
{
    static const char *const bad[] = {"", "0", "-1", "1x", "x", "1.5", "9223372036854775808"};
    uint64_t job;
    struct error err = {0};

    (void)state;
    assert_int_equal(parse_job("17", &job, &err), STATUS_OK);
    assert_int_equal(job, 17);
    assert_int_equal(parse_job("9223372036854775807", &job, &err), STATUS_OK);
    assert_true(job == INT64_MAX);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        assert_int_equal(parse_job(bad[i], &job, &err), STATUS_ERR_USAGE);
}

static void default_sizes(void **state)
{
    static const struct { float aspect; uint32_t width; } cases[] = {
        {0, 1280}, {-1, 1280}, {NAN, 1280}, {INFINITY, 1280}, {1, 720}, {16.f / 9, 1280},
        {4.f / 3, 960}, {0.5f, 360}, {1.7f, 1224}, {1e-6f, 2}, {1e6f, SETTINGS_SIZE_MAX},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        uint32_t width, height;
        picture_size_default(cases[i].aspect, &width, &height);
        assert_int_equal(width, cases[i].width);
        assert_int_equal(width % 2, 0);
        assert_int_equal(height, 720);
    }
}

static void effects(void **state)
{
    static const char *const bad[] = {"", ",", "caustics,", ",caustics", "nonsense", "diffuse",
                                      "medium,nonsense", "Caustics", "a", "caustics dispersion"};
    struct error err = {0};
    uint64_t set = 0;

    (void)state;
    assert_int_equal(parse_effects("caustics", &set, &err), STATUS_OK);
    assert_true(set == EFFECT_CAUSTICS);
    assert_int_equal(parse_effects("dispersion,normal-map,multiple-scattering", &set, &err),
                     STATUS_OK);
    assert_true(set == (EFFECT_CAUSTICS | EFFECT_DISPERSION | EFFECT_NORMAL_MAP |
                        EFFECT_MULTIPLE_SCATTERING));
    /* Every name that an error lists is taken. */
    for (int i = 0; i < EFFECT_COUNT; i++) {
        char text[SETTINGS_TEXT_SIZE];
        uint64_t one = (uint64_t)1 << i;
        set = 0;
        settings_effects_text(one, text);
        assert_null(strchr(text, ' '));
        if (EFFECTS_SWITCHABLE & one) {
            assert_int_equal(parse_effects(text, &set, &err), STATUS_OK);
            assert_true(set == one);
        } else {
            assert_int_equal(parse_effects(text, &set, &err), STATUS_ERR_USAGE);
        }
    }
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        set = 0;
        assert_int_equal(parse_effects(bad[i], &set, &err), STATUS_ERR_USAGE);
        assert_non_null(strstr(err.text, "--without"));
        assert_non_null(strstr(err.text, "motion-blur"));
    }
}

static void aovs(void **state)
{
    struct error err = {0};
    uint32_t set = 0;
    char text[SETTINGS_TEXT_SIZE];

    (void)state;
    assert_int_equal(parse_aovs("depth,object-id", &set, &err), STATUS_OK);
    assert_int_equal(parse_aovs("error", &set, &err), STATUS_OK);
    assert_int_equal(set, 1u << AOV_DEPTH | 1u << AOV_OBJECT_ID | 1u << AOV_ERROR);
    assert_string_equal(settings_aovs_text(set, text), "depth,object-id,error");
    set = 0;
    assert_int_equal(parse_aovs(settings_aovs_text((1u << AOV_COUNT) - 1, text), &set, &err),
                     STATUS_OK);
    assert_int_equal(set, (1u << AOV_COUNT) - 1);
    set = 7;
    assert_int_equal(parse_aovs("depth,beauty", &set, &err), STATUS_ERR_USAGE);
    assert_int_equal(set, 7);
    assert_non_null(strstr(err.text, "'beauty'"));
    assert_non_null(strstr(err.text, "depth,normal,albedo"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(effects),
        cmocka_unit_test(aovs),
        cmocka_unit_test(sizes),         cmocka_unit_test(frame_ranges),
        cmocka_unit_test(parameters), cmocka_unit_test(formats),    cmocka_unit_test(job_numbers),
        cmocka_unit_test(default_sizes),
    };

    return cmocka_run_group_tests_name("client/parse", tests, NULL, NULL);
}
