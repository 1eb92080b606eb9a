/* Profiles of luminaires: what the file says of a direction is what the picture has there. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/import/ies/ies.h"
#include "common/base/buffer.h"
#include "common/base/memory.h"
#include "common/math/transform.h"

#define PI 3.14159265358979323846

enum { TYPE_C = 1, TYPE_B = 2 };

/* Candela towards (x, y, z), where the luminaire shines along -z. */
typedef double shine(double x, double y, double z);

static double uneven(double x, double y, double z) { return 10 + 3 * x + 2 * y + x * y - 4 * z; }
static double in_halves(double x, double y, double z) { return uneven(x, fabs(y), z); }
static double in_halves_about_y(double x, double y, double z) { return uneven(fabs(x), y, z); }
static double in_quadrants(double x, double y, double z) { return uneven(fabs(x), fabs(y), z); }
static double around(double x, double y, double z) { (void)x, (void)y; return 10 - 4 * z; }

struct web {
    int type;
    double v0, v1, dv, h0, h1, dh; /* degrees */
    shine *shine;
};

static double towards(const struct web *w, double v_deg, double h_deg)
{
    const double v = v_deg * PI / 180, h = h_deg * PI / 180;

    if (w->type == TYPE_C)
        return w->shine(sin(v) * cos(h), sin(v) * sin(h), -cos(v));
    return w->shine(cos(h) * sin(v), -sin(h), -cos(h) * cos(v));
}

/* Half of the candela, and a multiplier of 4 with a ballast factor of .5. */
static void write_web(const struct web *w, struct buffer *out)
{
    const int nv = (int)lround((w->v1 - w->v0) / w->dv) + 1, nh = (int)lround((w->h1 - w->h0) / w->dh) + 1;

    buffer_puts(out, "IESNA:LM-63-2002\r\n[TEST] none\r\n[LUMINAIRE] 5 TILT of lamps\r\nTILT=NONE\r\n");
    buffer_printf(out, "1 -1 4 %d %d %d 2 0.5 .5 0\r\n0.5 1.0 100\r\n", nv, nh, w->type);
    for (int i = 0; i < nv; i++)
        buffer_printf(out, "%g%s", w->v0 + i * w->dv, i % 10 == 9 ? "\r\n" : " ");
    buffer_puts(out, "\r\n");
    for (int i = 0; i < nh; i++)
        buffer_printf(out, "%g,", w->h0 + i * w->dh);
    for (int h = 0; h < nh; h++)
        for (int v = 0; v < nv; v++)
            buffer_printf(out, "%s%.9g", v % 8 ? " " : "\r\n", towards(w, w->v0 + v * w->dv, w->h0 + h * w->dh) / 2);
    assert_true(buffer_ok(out));
}

static void read_web(const struct web *w, struct image *image, double *candela)
{
    struct buffer file = BUFFER_INIT;
    struct error err;

    write_web(w, &file);
    if (ies_read(image, candela, file.data, file.size, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    buffer_release(&file);
}

/* The luminaire's direction of a texel. */
static void direction_of(const struct image *image, uint32_t px, uint32_t py, double d[3])
{
    const double longitude = 2 * PI * ((px + 0.5) / image->width - 0.5), polar = PI * (py + 0.5) / image->height;
    const double origin[3] = {0, 0, 0}, ones[3] = {1, 1, 1};
    const double local[3] = {sin(polar) * cos(longitude), cos(polar), sin(polar) * sin(longitude)};
    const struct transform_d frame = transform_d_from_trs(origin, ies_frame, ones);

    for (int r = 0; r < 3; r++)
        d[r] = frame.m[r][0] * local[0] + frame.m[r][1] * local[1] + frame.m[r][2] * local[2];
}

static void webs_are_where_they_shine(void **state)
{
    static const struct web webs[] = {
        {TYPE_C, 0, 180, 2.5, 0, 0, 1, around},
        {TYPE_C, 0, 180, 2.5, 0, 90, 5, in_quadrants},
        {TYPE_C, 0, 180, 2.5, 0, 180, 5, in_halves},
        {TYPE_C, 0, 180, 2.5, 90, 270, 5, in_halves_about_y},
        {TYPE_C, 0, 180, 2.5, 0, 360, 5, uneven},
        {TYPE_C, 0, 180, 2.5, 0, 355, 5, uneven},
        {TYPE_C, 0, 180, 2.5, 5, 355, 5, uneven},
        {TYPE_C, 0, 90, 2.5, 0, 360, 5, uneven},
        {TYPE_C, 90, 180, 2.5, 0, 360, 5, uneven},
        {TYPE_B, -90, 90, 2.5, -90, 90, 2.5, uneven},
        {TYPE_B, -90, 90, 2.5, 0, 90, 2.5, in_halves},
        {TYPE_B, 0, 90, 2.5, -90, 90, 2.5, uneven},
    };

    (void)state;
    for (size_t i = 0; i < sizeof webs / sizeof *webs; i++) {
        const struct web *w = &webs[i];
        struct image image;
        double candela, most = 0;

        read_web(w, &image, &candela);
        for (uint32_t y = 0; y < image.height; y++)
            for (uint32_t x = 0; x < image.width; x++) {
                const double value = (double)image.pixels[3 * ((size_t)y * image.width + x)];
                double d[3], v, wanted;

                direction_of(&image, x, y, d);
                v = (w->type == TYPE_C ? acos(-d[2]) : atan2(d[0], -d[2])) * 180 / PI;
                wanted = v < w->v0 || v > w->v1 ? 0 : w->shine(d[0], d[1], d[2]);
                if (fabs(v - w->v0) > 0.01 && fabs(v - w->v1) > 0.01 && fabs(value * candela - wanted) > 0.02)
                    fail_msg("web %zu: %g towards %g %g %g, not %g", i, value * candela, d[0], d[1], d[2], wanted);
                most = fmax(most, value);
            }
        assert_true(most <= 1 && most > 0.9);
        image_release(&image);
    }
}

/* A lamp of Lambert's law: pi I0 in all. */
static void flux_is_kept(void **state)
{
    static const char file[] = "TILT=INCLUDE\n1\n3\n0 45 90\n1 .9 .8\n1 1000 1 19 1 1 1 0 0 0\n1 1 10\n"
                               "0 5 10 15 20 25 30 35 40 45 50 55 60 65 70 75 80 85 90\n0\n"
                               "100 99.6195 98.4808 96.5926 93.9693 90.6308 86.6025 81.9152 76.6044 70.7107 64.2788 57.3576 50 "
                               "42.2618 34.2020 25.8819 17.3648 8.7156 0";
    struct image image;
    double candela, flux = 0;
    struct error err;

    (void)state;
    assert_int_equal(ies_read(&image, &candela, file, sizeof file - 1, &err), STATUS_OK);
    assert_int_equal(image.width, 1);
    for (uint32_t y = 0; y < image.height; y++)
        flux += (double)image.pixels[3 * (size_t)y * image.width] * candela * 2 * PI *
                (cos(PI * y / image.height) - cos(PI * (y + 1) / image.height));
    assert_true(fabs(flux / (100 * PI) - 1) < 2e-3);
    image_release(&image);
}

static void refuse(const char *text, size_t size, const char *words)
{
    struct image image;
    struct error err = {0};
    double candela;

    assert_int_not_equal(ies_read(&image, &candela, text, size, &err), STATUS_OK);
    if (!strstr(err.text, words))
        fail_msg("\"%s\" does not say \"%s\"", err.text, words);
    image_release(&image);
}

static void damaged_profiles(void **state)
{
    static const struct {
        const char *text, *words;
    } cases[] = {
        {"", "no line \"TILT=\""},
        {"IESNA91\n[TEST] 1\n", "no line \"TILT=\""},
        {"TILT=NONE\n", "ends before its lamps and lumens"},
        {"TILT=NONE\n1 1 1 2 1 3 1 0 0 0 1 1 1 0 90 0 1 1", "type A"},
        {"TILT=NONE\n1 1 1 2 1 4 1 0 0 0 1 1 1 0 90 0 1 1", "line 2 of the IES profile: the photometric type is 4"},
        {"TILT=NONE\n1 1 1 0 1 1 1 0 0 0 1 1 1 0", "number of vertical angles is 0"},
        {"TILT=NONE\n1 1 1 2.5 1 1 1 0 0 0 1 1 1 0", "number of vertical angles is 2.5"},
        {"TILT=NONE\n1 1 1 9999999999 1 1 1 0 0 0 1 1 1 0", "number of vertical angles"},
        {"TILT=NONE\n1 1 1 4096 4096 1 1 0 0 0\n1 1 1 0", "vertical angles"},
        {"TILT=NONE\n1 1 1 2 1 1 1 0 0 0\n1 1 1\n90 0 0 1 1", "line 4 of the IES profile: the vertical angles must ascend"},
        {"TILT=NONE\n1 1 1 2 1 1 1 0 0 0\n1 1 1\n0 nan 0 1 1", "is not a number"},
        {"TILT=NONE\n1 1 1 2 1 1 1 0 0 0\n1 1 1\n0 90x 0 1 1", "is not a number"},
        {"TILT=NONE\n1 1 -1 2 1 1 1 0 0 0\n1 1 1\n0 90 0 1 1", "factors' product is -1"},
        {"TILT=NONE\n1 1 1 2 1 1 1 0 0 0\n1 1 1\n0 90 0 1", "ends before its candela"},
        {"TILT=INCLUDE\n1\n0\n", "number of tilts"},
    };
    struct buffer file = BUFFER_INIT;
    const struct web web = {TYPE_C, 0, 180, 30, 0, 360, 30, uneven};

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        refuse(cases[i].text, strlen(cases[i].text), cases[i].words);
    /* Cut anywhere, in memory that ends there. */
    write_web(&web, &file);
    for (size_t size = 0; size < file.size - 10; size++) {
        char *cut = mem_memdup(file.data, size);
        struct image image;
        struct error err;
        double candela;

        assert_int_not_equal(ies_read(&image, &candela, cut, size, &err), STATUS_OK);
        image_release(&image);
        mem_free(cut);
    }
    buffer_release(&file);
}

static void a_lamp_that_is_off(void **state)
{
    static const char file[] = "TILT=NONE\n1 1 1 2 1 1 1 0 0 0 1 1 1 0 90 0 0 -3";
    struct image image;
    struct error err;
    double candela;

    (void)state;
    assert_int_equal(ies_read(&image, &candela, file, sizeof file - 1, &err), STATUS_OK);
    assert_true(candela == 0 && image.pixels[0] == 0);
    image_release(&image);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(webs_are_where_they_shine), cmocka_unit_test(flux_is_kept), cmocka_unit_test(damaged_profiles),
        cmocka_unit_test(a_lamp_that_is_off),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
