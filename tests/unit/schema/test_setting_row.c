/* A new setting is a row of settings.h and a line of azulejo.proto. This program is compiled with a number and a choice
 * more than the others have (SETTING_ROWS in the Makefile), and finds that everything which treats all settings alike
 * knows them. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>
#include <jansson.h>

#include "client/options/job_options.h"
#include "coordinator/pictures/develop_parts.h"
#include "web/uploads/import_check.h"
#include "protocol/json/json_wire.h"
#include "protocol/message.h"

static void test_default_and_check(void **state)
{
    struct render_settings s, other;
    struct error err = {0};

    (void)state;
    render_settings_default(&s);
    other = s;
    assert_true(s.haze == 0.5f && s.dust == SAMPLER_INDEPENDENT);
    assert_int_equal(render_settings_validate(&s, 1, &err), STATUS_OK);
    other.haze = 0.25f;
    assert_false(render_settings_equal(&s, &other));
    s.haze = 3;
    assert_int_equal(render_settings_validate(&s, 1, &err), STATUS_ERR_INPUT);
    assert_string_equal(err.text, "haze: 3 is outside 0.1..2");
    s.haze = 1;
    s.dust = (enum sampler_kind)7;
    assert_int_equal(render_settings_validate(&s, 1, &err), STATUS_ERR_INPUT);
    assert_string_equal(err.text, "unknown fine dust 7");
}

static void test_option(void **state)
{
    struct job_options options = JOB_OPTIONS_INIT;
    const struct option table[] = {JOB_OPTION_ROWS(options), {0}};
    char *const argv[] = {(char[]){"submit"}, (char[]){"--haze"}, (char[]){"0.7"}, (char[]){"--dust=sobol"}, NULL};
    struct positionals rest;
    struct job_request request;
    struct error err = {0};
    int help;

    (void)state;
    assert_int_equal(options_parse(table, 4, argv, &rest, &help, &err), STATUS_OK);
    assert_int_equal(job_options_check(&options, &request, &err), STATUS_OK);
    assert_true(request.settings.haze == 0.7f && request.settings.dust == SAMPLER_SOBOL);
    job_request_release(&request);
    options.said[SETTING_haze].text = "2.5";
    assert_int_equal(job_options_check(&options, &request, &err), STATUS_ERR_USAGE);
    assert_string_equal(err.text, "--haze: 2.5 is outside 0.1..2");
    job_request_release(&request);
}

static void test_wire(void **state)
{
    Azulejo__Wire__RenderSettings wire;
    struct render_settings s, again;
    struct buffer text = BUFFER_INIT;
    struct error err = {0};

    (void)state;
    render_settings_default(&s);
    s.haze = 1.5f;
    s.dust = SAMPLER_SOBOL;
    wire_settings_set(&wire, &s);
    assert_true(wire.haze == 1.5f);
    assert_int_equal(wire_settings_get(&again, &wire, 1, &err), STATUS_OK);
    assert_true(render_settings_equal(&s, &again));
    json_wire_put(&text, &wire.base);
    assert_non_null(strstr(buffer_text(&text), "\"haze\":1.5"));
    assert_non_null(strstr(buffer_text(&text), "\"dust\":\"sobol\""));
    buffer_release(&text);
    wire.haze = 0; /* of an older client */
    assert_int_equal(wire_settings_get(&again, &wire, 1, &err), STATUS_OK);
    assert_true(again.haze == 0.5f);
}

static void test_shown(void **state)
{
    char text[SETTINGS_CHOICES_TEXT_SIZE];
    struct development d = {.output.tonemap.op = tonemap_find("linear")};
    struct buffer command = BUFFER_INIT, exr = BUFFER_INIT;
    float grey[3] = {1, 1, 1};
    struct error err = {0};

    (void)state;
    render_settings_default(&d.settings);
    assert_string_equal(settings_choices_text(&d.settings, text), "");
    d.settings.haze = 0.7f;
    d.settings.dust = SAMPLER_SOBOL;
    assert_string_equal(settings_choices_text(&d.settings, text), "haze 0.7, fine dust sobol");
    develop_command(&d, &command);
    assert_non_null(strstr(buffer_text(&command), " --haze 0.7 --dust sobol "));
    d.image = (struct image){1, 1, 3, grey};
    assert_int_equal(develop_exr(&d, &exr, &err), STATUS_OK);
    assert_non_null(memmem(exr.data, exr.size, "azulejo:haze", strlen("azulejo:haze")));
    buffer_clear(&command);
    assert_int_equal(exr_read_text(&command, exr.data, exr.size, "a frame", "azulejo:dust", &err), STATUS_OK);
    assert_string_equal(buffer_text(&command), "sobol");
    buffer_release(&exr);
    buffer_release(&command);
}

static void test_upload(void **state)
{
    json_t *options = json_pack("[s, s]", "--haze", "0.7");
    struct import_words words = {0};
    struct error err = {0};

    (void)state;
    assert_int_equal(import_words_read(&words, options, &err), STATUS_OK);
    assert_string_equal(words.items[0], "--haze=0.7");
    import_words_release(&words);
    json_decref(options);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_default_and_check), cmocka_unit_test(test_option), cmocka_unit_test(test_wire),
        cmocka_unit_test(test_shown),             cmocka_unit_test(test_upload),
    };

    return cmocka_run_group_tests_name("one more setting", tests, NULL, NULL);
}
