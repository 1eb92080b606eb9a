/* make_sky: writes a clear sky as an environment map (latitude-longitude, OpenEXR, float). */
#include <stdio.h>
#include <stdlib.h>

#include "common/base/buffer.h"
#include "common/system/file.h"
#include "common/cli/options.h"
#include "scenes/sky/sky.h"

/* "1024x512". */
static status read_size(const char *text, struct sky_settings *s, struct error *err)
{
    unsigned width, height;
    char rest;

    if (sscanf(text, "%6ux%6u%c", &width, &height, &rest) != 2 || width < 1 || height < 1)
        return error_set(err, STATUS_ERR_USAGE, "--size must be like 1024x512, and is \"%s\"", text);
    s->width = width;
    s->height = height;
    return STATUS_OK;
}

static status write_map(const char *path, const struct image *map, const struct sky_settings *s, struct error *err)
{
    const struct exr_attribute attributes[] = {
        /* the field's first */
        {.name = "fieldSeed", .number = s->seed},
        {.name = "sunElevation", .number = s->sun_elevation_deg},
        {.name = "sunAzimuth", .number = s->sun_azimuth_deg},
        {.name = "turbidity", .number = s->turbidity},
        {.name = "groundAlbedo", .number = s->ground_albedo},
        {.name = "candelasPerUnit", .number = SKY_CANDELAS_PER_UNIT},
    };
    const struct exr_options options = {.attributes = attributes + !s->field,
                                        .attribute_count =
                                            sizeof attributes / sizeof *attributes - !s->field};
    struct buffer file = BUFFER_INIT;
    status st = exr_encode(&file, map, &options, err);

    if (st == STATUS_OK)
        st = file_write_atomic(path, file.data, file.size, err);
    buffer_release(&file);
    return st;
}

int main(int argc, char **argv)
{
    const char *size = "1024x512", *path = "sky.exr";
    int64_t seed = 5;
    struct sky_settings s = {
        .sun_elevation_deg = 40, .sun_azimuth_deg = 60, .turbidity = 2.5, .ground_albedo = 0.2};
    const struct option table[] = {
        {"sun-elevation", 'e', OPTION_REAL, &s.sun_elevation_deg, "DEG",
         "the sun above the horizon (default 40)", -5, 90, NULL},
        {"sun-azimuth", 'a', OPTION_REAL, &s.sun_azimuth_deg, "DEG",
         "0 is +X, the picture's middle, 90 is +Z (default 60)", -360, 360, NULL},
        {"turbidity", 't', OPTION_REAL, &s.turbidity, "T",
         "1 is air alone, 2.5 a clear day, 10 haze (default 2.5)", 1, 10, NULL},
        {"ground-albedo", 'g', OPTION_REAL, &s.ground_albedo, "A",
         "the ground reflects this share: grey, and to the sky (default 0.2)", 0, 1, NULL},
        {"field", 'f', OPTION_FLAG, &s.field, NULL,
         "a wheat field with hills and clouds instead of grey ground", 0, 0, NULL},
        {"seed", 0, OPTION_INT, &seed, "N",
         "of the field: another one, another landscape (default 5)", 0, 1e6, NULL},
        {"no-sun", 0, OPTION_FLAG, &s.no_sun, NULL, "leave out the sun's disc", 0, 0, NULL},
        {"size", 's', OPTION_STRING, &size, "WxH", "pixels (default 1024x512)", 0, 0, NULL},
        {"output", 'o', OPTION_STRING, &path, "FILE", "where to write (default sky.exr)", 0, 0,
         NULL},
        {0},
    };
    struct positionals rest;
    struct sky_report report;
    struct image map = {0};
    struct error err = {0};
    int help = 0;
    status st = options_parse(table, argc, argv, &rest, &help, &err);

    if (st == STATUS_OK && help) {
        options_print_help("make_sky [options]",
                           "Write a clear sky with sun, or a summer's field under it, as an environment map; "
                           "1 unit is 10 kcd/m2.",
                           table);
        return 0;
    }
    if (st == STATUS_OK && rest.count > 0)
        st = error_set(&err, STATUS_ERR_USAGE, "make_sky takes options only");
    if (st == STATUS_OK)
        st = read_size(size, &s, &err);
    s.seed = (uint32_t)seed;
    if (st == STATUS_OK)
        st = sky_make(&map, &s, &report, &err);
    if (st == STATUS_OK)
        st = write_map(path, &map, &s, &err);
    image_release(&map);
    if (st != STATUS_OK)
        fprintf(stderr, "make_sky: %s\n", err.text);
    else
        printf("%s: %u x %u, sun %.1f klx, sky %.1f klx on the ground\n", path, (unsigned)s.width, (unsigned)s.height,
               report.sun_lux / 1000, report.sky_lux / 1000);
    return status_exit_code(st);
}
