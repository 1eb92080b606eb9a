/* From options to tone mapping: direct parameters, --percentile's two meanings, and pictures'
 * formats on the wire and in files. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "client/follow/picture_file.h"
#include "common/system/file.h"
#include "tests/support/scratch_folder.h"

struct line {
    struct tonemap_options o;
    struct tonemap_settings settings;
    struct positionals rest;
    struct error err;
    int taken;      /* of an option that is in the way of a parameter */
    char text[256]; /* what the options point into */
};

/* Parse the words and check them. */
static status run(struct line *l, const char *words)
{
    const struct option table[] = {
        TONEMAP_OPTION_ROWS(l->o),
        {"gain", 0, OPTION_FLAG, &l->taken, NULL, "in the way", 0, 0, NULL},
        {0},
    };
    struct option rows[TONEMAP_ROWS_MAX];
    struct buffer file = BUFFER_INIT;
    char *argv[32];
    int argc = 0, help;
    status result;

    memset(l, 0, sizeof *l);
    snprintf(l->text, sizeof l->text, "program %s", words);
    for (char *word = strtok(l->text, " "); word; word = strtok(NULL, " "))
        argv[argc++] = word;
    result = options_parse(tonemap_options_table(&l->o, table, rows), argc, argv, &l->rest, &help, &l->err);
    if (result == STATUS_OK)
        result = tonemap_options_check(&l->o, &l->settings, &file, &l->err);
    assert_int_equal(file.size, 0);
    buffer_release(&file);
    return result;
}

static double value_of(const struct line *l, const char *name)
{
    for (size_t i = 0; i < l->settings.op->parameter_count; i++)
        if (strcmp(l->settings.op->parameters[i].name, name) == 0)
            return l->settings.values[i];
    fail_msg("no parameter %s", name);
    return 0;
}

static void direct(void **state)
{
    struct line l;

    (void)state;
    assert_int_equal(run(&l, "-t gamma --gamma 1.5"), STATUS_OK);
    assert_true(value_of(&l, "gamma") == 1.5 && value_of(&l, "gain") == 1);
    assert_int_equal(run(&l, "--gamma=1.5 --tonemap=gamma -p gain=2"), STATUS_OK);
    assert_true(value_of(&l, "gamma") == 1.5 && value_of(&l, "gain") == 2);
    /* An option of the command goes before a parameter of its name. */
    assert_int_equal(run(&l, "-t gamma --gain"), STATUS_OK);
    assert_true(l.taken && value_of(&l, "gain") == 1);
    assert_int_equal(run(&l, "-t linear --gamma 1.5"), STATUS_ERR_USAGE);
    assert_non_null(strstr(l.err.text, "linear"));
    assert_int_equal(run(&l, "-t gamma --key 0.5"), STATUS_ERR_USAGE);
    assert_non_null(strstr(l.err.text, "gain"));
    assert_int_equal(run(&l, "-t gamma --gamma 1e9"), STATUS_ERR_USAGE);
    assert_int_equal(run(&l, "-t gamma --gamma wide"), STATUS_ERR_USAGE);
    assert_int_equal(run(&l, "-t gamma --gamma nan"), STATUS_ERR_USAGE);
    assert_int_equal(run(&l, "--no-such-parameter 1"), STATUS_ERR_USAGE);
    assert_int_equal(run(&l, "-t linear --lut x.cube"), STATUS_ERR_USAGE);
}

/* Every parameter of every operator is an option, unless its name is taken. */
static void every_parameter(void **state)
{
    size_t count;
    const struct tonemap_operator *const *operators = tonemap_operators(&count);
    const struct option none[] = {{0}};
    struct tonemap_options o = {0};
    struct option rows[TONEMAP_ROWS_MAX];

    (void)state;
    tonemap_options_table(&o, none, rows);
    for (size_t i = 0; i < count; i++) {
        for (size_t k = 0; k < operators[i]->parameter_count; k++) {
            size_t found = 0;

            for (const struct option *row = rows; row->name; row++)
                if (strcmp(row->name, operators[i]->parameters[k].name) == 0)
                    found += strstr(row->help, operators[i]->name) != NULL;
            assert_int_equal(found, 1);
        }
    }
}

static void common(void **state)
{
    struct line l;

    (void)state;
    assert_int_equal(run(&l, "--exposure -1.5 --white-balance 3200"), STATUS_OK);
    assert_string_equal(l.settings.op->name, TONEMAP_DEFAULT);
    assert_true(l.settings.exposure_ev == -1.5 && l.settings.white_kelvin == 3200);
    assert_int_equal(l.settings.metering, TONEMAP_METERING_OFF);
    assert_int_equal(run(&l, "--auto-exposure percentile --percentile 90"), STATUS_OK);
    assert_int_equal(l.settings.metering, TONEMAP_METERING_PERCENTILE);
    assert_true(l.settings.metering_percentile == 90);
    assert_int_equal(run(&l, "--auto-exposure percentile"), STATUS_OK);
    assert_true(l.settings.metering_percentile == 99);
    assert_int_equal(run(&l, "-t linear --percentile 90"), STATUS_ERR_USAGE);
    assert_non_null(strstr(l.err.text, "--auto-exposure"));
    assert_int_equal(run(&l, "--auto-exposure sun"), STATUS_ERR_USAGE);
    assert_int_equal(run(&l, "--white-balance 10"), STATUS_ERR_USAGE);
    assert_int_equal(run(&l, "--exposure 101"), STATUS_ERR_USAGE);
}

static void on_the_wire(void **state)
{
    struct output_options o = {0};
    struct output_request request;
    struct wire_output out;
    struct error err = {0};

    (void)state;
    o.formats = "jpg,png";
    o.png_bits = "16";
    o.tone.said[LOOK_temporal].text = "5";
    o.no_dither = 1;
    o.tone.tonemap = "gamma";
    assert_int_equal(output_options_check(&o, &request, &err), STATUS_OK);
    request.camera_ev = 2;
    output_message_set(&out, &request, request.formats);
    assert_int_equal(output_message_formats(&out.message), OUTPUT_FORMAT_PNG | OUTPUT_FORMAT_JPEG);
    assert_string_equal(out.message.tonemap, "gamma");
    assert_int_equal(out.message.n_parameters, 2);
    assert_int_equal(out.message.png_bits, 16);
    assert_int_equal(out.message.jpeg_quality, 0); /* the default */
    assert_int_equal(out.message.temporal, 5);
    assert_true(out.message.no_dither && out.message.camera_ev == 2);
    assert_string_equal(out.message.metering, "off");
    assert_true(output_percentile(&out.message) == 99);
    assert_int_equal(out.message.tonemap_file.len, 0);
    output_request_release(&request);
}

static void by_extension(void **state)
{
    (void)state;
    assert_int_equal(output_format_of("a.b/c.PNG"), OUTPUT_FORMAT_PNG);
    assert_int_equal(output_format_of("c.jpg"), OUTPUT_FORMAT_JPEG);
    assert_int_equal(output_format_of("c.jpeg"), OUTPUT_FORMAT_JPEG);
    assert_int_equal(output_format_of("c.exr"), OUTPUT_FORMAT_EXR);
    assert_int_equal(output_format_of("c.png/d"), 0);
    assert_int_equal(output_format_of("c.tif"), 0);
}

static void read_back(const char *path, struct image8 *out)
{
    struct buffer file = BUFFER_INIT;
    struct error err = {0};

    assert_int_equal(file_read(path, 1 << 20, &file, &err), STATUS_OK);
    assert_int_equal(image_decode_8(out, file.data, file.size, path, &err), STATUS_OK);
    buffer_release(&file);
}

/* What is written can be read, in every format. */
static void files(void **state)
{
    enum { WIDTH = 32, HEIGHT = 8 };
    const struct picture_options deep = {.bits = 16}, good = {.quality = 95};
    char folder[SCRATCH_PATH];
    char path[64];
    struct image image, back = {0};
    struct image8 coded;
    struct error err = {0};

    (void)state;
    scratch_folder(folder);
    assert_int_equal(image_init(&image, WIDTH, HEIGHT, 3, &err), STATUS_OK);
    for (size_t i = 0; i < WIDTH * HEIGHT * 3; i++)
        image.pixels[i] = (float)(i / 3 % WIDTH) / (WIDTH - 1);
    snprintf(path, sizeof path, "%s/a.png", folder);
    assert_int_equal(picture_write(path, &image, OUTPUT_FORMAT_PNG, &deep, &err), STATUS_OK);
    read_back(path, &coded);
    assert_int_equal(coded.bits, 16);
    for (size_t i = 0; i < WIDTH * HEIGHT * 3; i++)
        assert_float_equal(((const uint16_t *)(const void *)coded.pixels)[i] / 65535.0, image.pixels[i], 1.01 / 65535);
    image8_release(&coded);
    unlink(path);
    snprintf(path, sizeof path, "%s/a.jpg", folder);
    assert_int_equal(picture_write(path, &image, OUTPUT_FORMAT_JPEG, &good, &err), STATUS_OK);
    read_back(path, &coded);
    assert_true(coded.width == WIDTH && coded.height == HEIGHT && coded.channels == 3);
    for (size_t i = 0; i < WIDTH * HEIGHT * 3; i++)
        assert_float_equal(coded.pixels[i] / 255.0, image.pixels[i], 0.03);
    image8_release(&coded);
    unlink(path);
    snprintf(path, sizeof path, "%s/a.exr", folder);
    assert_int_equal(picture_write(path, &image, OUTPUT_FORMAT_EXR, &deep, &err), STATUS_OK);
    assert_int_equal(picture_read(&back, path, &err), STATUS_OK);
    assert_memory_equal(back.pixels, image.pixels, WIDTH * HEIGHT * 3 * sizeof(float));
    image_release(&back);
    unlink(path);
    image_release(&image);
    assert_int_equal(rmdir(folder), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(direct),      cmocka_unit_test(every_parameter), cmocka_unit_test(common),
        cmocka_unit_test(on_the_wire), cmocka_unit_test(by_extension),    cmocka_unit_test(files),
    };
    return cmocka_run_group_tests_name("client/tonemap_options", tests, NULL, NULL);
}
