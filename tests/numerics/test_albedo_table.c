/* The table behind albedo.h against its definition, and what it promises. With --print it
 * writes worker/render/bsdf/albedo_table.c to standard output instead. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "worker/render/bsdf/albedo.h"
#include "worker/render/bsdf/bsdf.h"

enum { POINTS = 128 };

/* Directional albedo of GGX with unit Fresnel, *all, and with (1 - v.h)^5, *schlick: the
 * midpoint rule over the visible normals, whose weight is G2 / G1. */
static void ggx_albedo(double mu, double alpha, int points, double *all, double *schlick)
{
    double wo_x = sqrt(1 - mu * mu), length = hypot(alpha * wo_x, mu);
    double x = alpha * wo_x / length, z = mu / length, root_o = length;

    *all = *schlick = 0;
    for (int i = 0; i < points; i++)
        for (int j = 0; j < points; j++) {
            double height = (1 - (i + 0.5) / points) * (1 + z) - z, phi = M_PI * (j + 0.5) / points;
            double sine = sqrt(fmax(0, 1 - height * height));
            double h[3] = {alpha * (sine * cos(phi) + x), alpha * sine * sin(phi), height + z};
            double norm = sqrt(h[0] * h[0] + h[1] * h[1] + h[2] * h[2]);
            double cosine = (wo_x * h[0] + mu * h[2]) / norm;
            double mu_i = 2 * cosine * h[2] / norm - mu, root_i, weight;
            if (mu_i <= 0)
                continue;
            root_i = sqrt(alpha * alpha * (1 - mu_i * mu_i) + mu_i * mu_i);
            weight = mu_i * (mu + root_o) / (mu_i * root_o + mu * root_i);
            *all += weight;
            *schlick += weight * pow(1 - cosine, 5);
        }
    *all /= points * points;
    *schlick /= points * points;
}

static double row_alpha(double row)
{
    double first = sqrt(BSDF_ALPHA_MIN);
    double root = first + (1 - first) * row / (ALBEDO_ROWS - 1);
    return fmin(1, root * root);
}

static double table_entry(int row, int column)
{
    double s = (double)column / (ALBEDO_COLUMNS - 1), all, schlick;

    ggx_albedo(fmax(1e-4, s * s), row_alpha(row), POINTS, &all, &schlick);
    return fmin(1, ALBEDO_MARGIN * schlick / all);
}

/* Integral of 2 mu blend(mu) over mu in 0..1, with mu = s^2 and blend linear in s. */
static double row_average(const float *row)
{
    double sum = 0, step = 1.0 / (ALBEDO_COLUMNS - 1);

    for (int j = 0; j + 1 < ALBEDO_COLUMNS; j++) {
        double a = j * step, b = a + step, slope = (row[j + 1] - row[j]) / step;
        double constant = row[j] - slope * a;
        sum += constant * (pow(b, 4) - pow(a, 4)) + slope * 4 / 5 * (pow(b, 5) - pow(a, 5));
    }
    return sum;
}

static void print_table(void)
{
    static float table[ALBEDO_ROWS][ALBEDO_COLUMNS];

    printf("/* Written by tests/numerics/test_albedo_table.c --print; see albedo.h. */\n"
           "#include \"worker/render/bsdf/albedo.h\"\n\n"
           "const float albedo_blend[ALBEDO_ROWS][ALBEDO_COLUMNS] = {\n");
    for (int i = 0; i < ALBEDO_ROWS; i++) {
        printf("    {");
        for (int j = 0; j < ALBEDO_COLUMNS; j++) {
            char text[32];
            snprintf(text, sizeof text, "%.6ff", table_entry(i, j));
            sscanf(text, "%f", &table[i][j]);
            printf("%s%s", text, j + 1 == ALBEDO_COLUMNS ? "},\n" : j % 8 == 7 ? ",\n     " : ", ");
        }
    }
    printf("};\n\nconst float albedo_blend_average[ALBEDO_ROWS] = {\n");
    for (int i = 0; i < ALBEDO_ROWS; i++)
        printf("%s%.7ff,%s", i % 8 == 0 ? "    " : " ", row_average(table[i]),
               i % 8 == 7 ? "\n" : "");
    printf("};\n");
}

static void entries_match_their_definition(void **state)
{
    (void)state;
    for (int i = 0; i < ALBEDO_ROWS; i++)
        for (int j = 0; j < ALBEDO_COLUMNS; j++)
            if (fabs(albedo_blend[i][j] - table_entry(i, j)) > 2e-6)
                fail_msg("row %d column %d: %.7f in the table, %.7f computed", i, j,
                         (double)albedo_blend[i][j], table_entry(i, j));
    for (int i = 0; i < ALBEDO_ROWS; i++)
        assert_true(fabs(albedo_blend_average[i] - row_average(albedo_blend[i])) < 1e-6);
}

/* Between the entries: near the truth, and a plastic of ior 1.5 gains no energy. */
static void interpolation_is_close_and_gains_nothing(void **state)
{
    double sum = 0;
    int count = 0;

    (void)state;
    for (double row = 0.5; row < ALBEDO_ROWS - 1; row += 1.5)
        for (double s = 0.01; s < 1; s += 0.0213) {
            float alpha = (float)row_alpha(row), mu = (float)(s * s);
            struct albedo_row found = albedo_row_find(alpha);
            double all, schlick, blend = albedo_blend_at(&found, mu), total;
            ggx_albedo(mu, alpha, 64, &all, &schlick);
            sum += (blend - schlick / all) * (blend - schlick / all);
            count++;
            if (fabs(blend - schlick / all) > 0.01)
                fail_msg("alpha %g, mu %g: %g, should be %g", (double)alpha, (double)mu, blend,
                         schlick / all);
            total = 0.04 * (all - schlick) + schlick + 1 - (0.04 + 0.96 * blend);
            if (total > 1 + 2e-4)
                fail_msg("alpha %g, mu %g: sends out %g", (double)alpha, (double)mu, total);
        }
    assert_true(sqrt(sum / count) < 1e-3);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(entries_match_their_definition),
        cmocka_unit_test(interpolation_is_close_and_gains_nothing),
    };

    if (argc > 1 && strcmp(argv[1], "--print") == 0) {
        print_table();
        return 0;
    }
    return cmocka_run_group_tests_name("albedo_table", tests, NULL, NULL);
}
