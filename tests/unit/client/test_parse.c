/* The command line's small languages: sizes, frame ranges, parameters, jobs, addresses. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "client/options/output.h"
#include "client/terminal/frame_list.h"
#include "client/terminal/parse.h"
#include "common/film/tiles.h"
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
        assert_int_equal(parse_size("--size", good[i].text, &width, &height, &err), STATUS_OK);
        assert_int_equal(width, good[i].width);
        assert_int_equal(height, good[i].height);
    }
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        width = height = 77;
        err.text[0] = 0;
        assert_int_equal(parse_size("--size", bad[i], &width, &height, &err), STATUS_ERR_USAGE);
        assert_non_null(strstr(err.text, "--size"));
        assert_int_equal(width, 77); /* untouched */
        assert_int_equal(height, 77);
    }
}

static void regions(void **state)
{
    static const char *const bad[] = {"", "1,2,3", "1,2,3,4,", "1,2,3,4,5", "1,2,0,4", "1,2,3,0", "-1,2,3,4",
                                      "1, 2,3,4", "a,2,3,4", "1,2,3,4 ", "1x2x3x4", "65537,0,1,1", "1,,2,3"};
    struct tile_rect r;
    struct error err = {0};

    (void)state;
    assert_int_equal(parse_region("7,0,65536,002", &r, &err), STATUS_OK);
    assert_true(r.x == 7 && r.y == 0 && r.width == 65536 && r.height == 2);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        assert_int_equal(parse_region(bad[i], &r, &err), STATUS_ERR_USAGE);
        assert_non_null(strstr(err.text, "--region"));
    }
}

/* The list's numbers in words; the caller's buffer. */
static const char *list_text(const struct frame_list *list, char out[256])
{
    size_t used = 0;

    out[0] = 0;
    for (size_t i = 0; i < list->count; i++)
        used += (size_t)snprintf(out + used, 256 - used, "%s%u", i ? " " : "", list->items[i]);
    return out;
}

static void frame_lists(void **state)
{
    static const struct { const char *text, *frames, *ends; } good[] = {
        {"1", "1", "1"}, {"0", "0", "0"}, {"7-7", "7", "7"}, {"3-4", "3 4", "3 4"},
        {"1-5", "1 2 3 4 5", "1 3 5"}, {"1,5,10-40x10", "1 5 10 20 30 40", "1 10 40"},
        {"10-25x10", "10 20", "10 20"}, {"5,1,3-5,4", "1 3 4 5", "1 3 5"},
        {"2147483647", "2147483647", "2147483647"}, {"1-9x100", "1", "1"},
    };
    static const char *const bad[] = {
        "", "-", "1-", "-1", "48-1", "1-2-3", "a", "1-b", "1 - 2", "1:2", "1-100001", "0-100000",
        "2147483648", "99999999999999999999", "+1", "1-+2", "1..5", ",1", "1,", "1,,2", "1x2",
        "1-9x", "1-9x0", "1-9x-1", "1-60000,1-60000",
    };
    struct frame_list list;
    struct error err = {0};
    char text[256];

    (void)state;
    for (size_t i = 0; i < sizeof good / sizeof good[0]; i++) {
        assert_int_equal(frame_list_parse(good[i].text, &list, &err), STATUS_OK);
        assert_string_equal(list_text(&list, text), good[i].frames);
        frame_list_ends(&list);
        assert_string_equal(list_text(&list, text), good[i].ends);
        frame_list_free(&list);
    }
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        err.text[0] = 0;
        assert_int_equal(frame_list_parse(bad[i], &list, &err), STATUS_ERR_USAGE);
        assert_non_null(strstr(err.text, "--frames"));
        frame_list_free(&list);
    }
    assert_int_equal(frame_list_parse("1-100000", &list, &err), STATUS_OK);
    assert_int_equal(list.count, 100000);
    frame_list_free(&list);
}

static void frames_of_a_job(void **state)
{
    static const struct { struct frame_choice choice; uint32_t first, last; const char *frames; } good[] = {
        {{NULL, 0}, 1, 48, ""}, {{NULL, 1}, 1, 48, "1 24 48"}, {{NULL, 1}, 7, 7, "7"},
        {{NULL, 1}, 7, 8, "7 8"}, {{"10-40x10", 0}, 1, 48, "10 20 30 40"},
        {{"10-40x10", 1}, 1, 48, "10 20 40"},
    };
    const struct frame_choice outside = {"47-49", 0};
    struct frame_list list;
    struct error err = {0};
    char text[256];

    (void)state;
    for (size_t i = 0; i < sizeof good / sizeof good[0]; i++) {
        assert_int_equal(frame_choice_of(&good[i].choice, good[i].first, good[i].last, &list, &err), STATUS_OK);
        assert_string_equal(list_text(&list, text), good[i].frames);
        frame_list_free(&list);
    }
    assert_int_equal(frame_choice_of(&outside, 1, 48, &list, &err), STATUS_ERR_USAGE);
    assert_non_null(strstr(err.text, "frames 1 to 48, not 49"));
    frame_list_free(&list);
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
    assert_int_equal(parse_parameter("eight888=1", name, sizeof name, &value, &err), STATUS_ERR_USAGE);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        err.text[0] = 0;
        assert_int_equal(parse_parameter(bad[i], name, sizeof name, &value, &err), STATUS_ERR_USAGE);
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
    assert_int_equal(parse_effects("dispersion,normal-map,multiple-scattering", &set, &err), STATUS_OK);
    assert_true(set == (EFFECT_CAUSTICS | EFFECT_DISPERSION | EFFECT_NORMAL_MAP | EFFECT_MULTIPLE_SCATTERING));
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(effects),
        cmocka_unit_test(sizes), cmocka_unit_test(regions),        cmocka_unit_test(frame_lists), cmocka_unit_test(frames_of_a_job),
        cmocka_unit_test(parameters), cmocka_unit_test(formats),    cmocka_unit_test(job_numbers),
        cmocka_unit_test(default_sizes),
    };

    return cmocka_run_group_tests_name("client/parse", tests, NULL, NULL);
}
