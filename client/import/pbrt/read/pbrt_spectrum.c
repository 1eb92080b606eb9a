#include "client/import/pbrt/read/pbrt_spectrum.h"

#include <math.h>
#include <string.h>

#include "common/math/elementary.h"

/* ---- tables ------------------------------------------------------------------------------- */

enum { CIE_FIRST_NM = 380, CIE_STEP_NM = 10, CIE_COUNT = 41 };

/* CIE 1931 2 degree colour matching functions (ISO/CIE 11664-1) and the relative power of the
 * standard illuminant D65 (ISO/CIE 11664-2), every 10 nm from 380 nm. */
static const double cie[CIE_COUNT][4] = {
    {0.0014, 0.0000, 0.0065, 49.9755}, {0.0042, 0.0001, 0.0201, 54.6482},
    {0.0143, 0.0004, 0.0679, 82.7549}, {0.0435, 0.0012, 0.2074, 91.4860},
    {0.1344, 0.0040, 0.6456, 93.4318}, {0.2839, 0.0116, 1.3856, 86.6823},
    {0.3483, 0.0230, 1.7471, 104.865}, {0.3362, 0.0380, 1.7721, 117.008},
    {0.2908, 0.0600, 1.6692, 117.812}, {0.1954, 0.0910, 1.2876, 114.861},
    {0.0956, 0.1390, 0.8130, 115.923}, {0.0320, 0.2080, 0.4652, 108.811},
    {0.0049, 0.3230, 0.2720, 109.354}, {0.0093, 0.5030, 0.1582, 107.802},
    {0.0633, 0.7100, 0.0782, 104.790}, {0.1655, 0.8620, 0.0422, 107.689},
    {0.2904, 0.9540, 0.0203, 104.405}, {0.4334, 0.9950, 0.0087, 104.046},
    {0.5945, 0.9950, 0.0039, 100.000}, {0.7621, 0.9520, 0.0021, 96.3342},
    {0.9163, 0.8700, 0.0017, 95.7880}, {1.0263, 0.7570, 0.0011, 88.6856},
    {1.0622, 0.6310, 0.0008, 90.0062}, {1.0026, 0.5030, 0.0003, 89.5991},
    {0.8544, 0.3810, 0.0002, 87.6987}, {0.6424, 0.2650, 0.0000, 83.2886},
    {0.4479, 0.1750, 0.0000, 83.6992}, {0.2835, 0.1070, 0.0000, 80.0268},
    {0.1649, 0.0610, 0.0000, 80.2146}, {0.0874, 0.0320, 0.0000, 82.2778},
    {0.0468, 0.0170, 0.0000, 78.2842}, {0.0227, 0.0082, 0.0000, 69.7213},
    {0.0114, 0.0041, 0.0000, 71.6091}, {0.0058, 0.0021, 0.0000, 74.3490},
    {0.0029, 0.0010, 0.0000, 61.6040}, {0.0014, 0.0005, 0.0000, 69.8856},
    {0.0007, 0.0002, 0.0000, 75.0870}, {0.0003, 0.0001, 0.0000, 63.5927},
    {0.0002, 0.0001, 0.0000, 46.4182}, {0.0001, 0.0000, 0.0000, 66.8054},
    {0.0000, 0.0000, 0.0000, 63.3828},
};

/* Complex indices of silver, aluminium, gold and copper at photon energies of 3.3, 3.2 ...
 * 1.6 eV, as compiled at luxpop.com from Palik's handbook: pbrt's values. In nm. */
#define BY_ENERGY(a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p, q, r)                         \
    {375.710, a, 387.451, b, 399.949, c, 413.281, d, 427.532, e, 442.801, f, 459.201, g,        \
     476.862, h, 495.937, i, 516.601, j, 539.062, k, 563.564, l, 590.401, m, 619.920, n,        \
     652.548, o, 688.801, p, 729.319, q, 774.901, r}
static const double ag_eta[] =
    BY_ENERGY(0.200, 0.192, 0.173, 0.173, 0.160, 0.157, 0.144, 0.132, 0.130, 0.130, 0.129, 0.120,
              0.121, 0.131, 0.140, 0.140, 0.148, 0.143);
static const double ag_k[] =
    BY_ENERGY(1.67, 1.81, 1.95, 2.11, 2.26, 2.40, 2.56, 2.72, 2.88, 3.07, 3.25, 3.45, 3.66, 3.88,
              4.15, 4.44, 4.74, 5.09);
static const double al_eta[] =
    BY_ENERGY(0.432, 0.460, 0.490, 0.523, 0.558, 0.598, 0.644, 0.695, 0.755, 0.826, 0.912, 1.02,
              1.15, 1.30, 1.49, 1.74, 2.14, 2.63);
static const double al_k[] =
    BY_ENERGY(4.56, 4.71, 4.86, 5.02, 5.20, 5.38, 5.58, 5.80, 6.03, 6.28, 6.55, 6.85, 7.15, 7.48,
              7.82, 8.21, 8.57, 8.60);
static const double au_eta[] =
    BY_ENERGY(1.696, 1.674, 1.658, 1.636, 1.616, 1.562, 1.426, 1.242, 0.916, 0.608, 0.402, 0.306,
              0.236, 0.194, 0.166, 0.160, 0.164, 0.176);
static const double au_k[] =
    BY_ENERGY(1.906, 1.936, 1.956, 1.958, 1.940, 1.904, 1.846, 1.796, 1.840, 2.120, 2.540, 2.880,
              2.970, 3.060, 3.150, 3.800, 4.357, 4.860);
static const double cu_eta[] =
    BY_ENERGY(1.225, 1.180, 1.175, 1.180, 1.175, 1.170, 1.160, 1.150, 1.135, 1.120, 1.040, 0.826,
              0.468, 0.272, 0.214, 0.213, 0.223, 0.250);
static const double cu_k[] =
    BY_ENERGY(2.015, 2.210, 2.130, 2.210, 2.289, 2.362, 2.433, 2.504, 2.564, 2.605, 2.583, 2.599,
              2.809, 3.240, 3.670, 4.050, 4.430, 4.817);
/* Brass (70 % Cu, 30 % Zn): Querry 1985, by way of refractiveindex.info. */
static const double cuzn_eta[] = {380, 1.487, 400, 1.445, 420, 1.350, 440, 1.191, 460, 0.994,
                                  480, 0.816, 500, 0.686, 520, 0.602, 540, 0.549, 560, 0.505,
                                  580, 0.468, 600, 0.450, 620, 0.449, 640, 0.444, 660, 0.445,
                                  680, 0.444, 700, 0.446, 720, 0.450, 740, 0.455, 760, 0.458,
                                  780, 0.464};
static const double cuzn_k[] = {380, 1.818, 400, 1.805, 420, 1.786, 440, 1.797, 460, 1.883,
                                480, 2.046, 500, 2.250, 520, 2.464, 540, 2.668, 560, 2.860,
                                580, 3.059, 600, 3.253, 620, 3.434, 640, 3.609, 660, 3.778,
                                680, 3.943, 700, 4.106, 720, 4.266, 740, 4.424, 760, 4.579,
                                780, 4.737};
/* Magnesium and titanium oxide: luxpop.com, clear in visible light. */
static const double mgo_eta[] = {386.7, 1.7655,  430.9, 1.7557,  478.0, 1.7483,
                                 499.9, 1.7454,  546.2, 1.74077, 589.3, 1.73737,
                                 632.9, 1.73460, 690.7, 1.73191, 767.7, 1.72872};
static const double tio2_eta[] = {388, 3.49, 400, 3.40, 420, 3.29, 440, 3.20, 460, 3.13,
                                  480, 3.08, 500, 3.03, 520, 3.00, 540, 2.96, 560, 2.94,
                                  580, 2.92, 600, 2.90, 620, 2.88, 640, 2.87, 660, 2.85,
                                  680, 2.84, 700, 2.83, 720, 2.82, 740, 2.81, 780, 2.80};
static const double clear_k[] = {380, 0, 780, 0};

#define NAMED(name, table) {name, {table, sizeof(table) / (2 * sizeof *(table)), 1}}
static const struct named_spectrum {
    const char *name;
    struct spectrum spectrum;
} named[] = {
    NAMED("metal-Ag-eta", ag_eta),     NAMED("metal-Ag-k", ag_k),
    NAMED("metal-Al-eta", al_eta),     NAMED("metal-Al-k", al_k),
    NAMED("metal-Au-eta", au_eta),     NAMED("metal-Au-k", au_k),
    NAMED("metal-Cu-eta", cu_eta),     NAMED("metal-Cu-k", cu_k),
    NAMED("metal-CuZn-eta", cuzn_eta), NAMED("metal-CuZn-k", cuzn_k),
    NAMED("metal-MgO-eta", mgo_eta),   NAMED("metal-MgO-k", clear_k),
    NAMED("metal-TiO2-eta", tio2_eta), NAMED("metal-TiO2-k", clear_k),
};

/* Chromaticities of CIE illuminants (CIE 15:2004, 2 degree observer). */
static const struct named_light {
    const char *name;
    double x, y;
} lights[] = {
    {"stdillum-A", 0.44757, 0.40745},   {"stdillum-D50", 0.34567, 0.35850},
    {"stdillum-D65", 0.31272, 0.32903}, {"stdillum-F1", 0.3131, 0.3371},
    {"stdillum-F2", 0.3721, 0.3751},    {"stdillum-F3", 0.4091, 0.3941},
    {"stdillum-F4", 0.4402, 0.4031},    {"stdillum-F5", 0.3138, 0.3452},
    {"stdillum-F6", 0.3779, 0.3882},    {"stdillum-F7", 0.3129, 0.3292},
    {"stdillum-F8", 0.3458, 0.3586},    {"stdillum-F9", 0.3741, 0.3727},
    {"stdillum-F10", 0.3458, 0.3588},   {"stdillum-F11", 0.3805, 0.3769},
    {"stdillum-F12", 0.4370, 0.4042},   {"illum-acesD60", 0.32168, 0.33767},
};

/* Schott's catalogue: index at 587.6 nm and Abbe number. pbrt's F5, F10 and F11 are SF5, SF10 and SF11. */
static const struct named_glass {
    const char *name;
    double index, abbe;
} glasses[] = {
    {"glass-BK7", 1.51680, 64.17},   {"glass-BAF10", 1.67003, 47.11},
    {"glass-FK51A", 1.48656, 84.47}, {"glass-LASF9", 1.85025, 32.17},
    {"glass-F5", 1.67270, 32.21},    {"glass-SF5", 1.67270, 32.21},
    {"glass-F10", 1.72825, 28.41},   {"glass-SF10", 1.72825, 28.41},
    {"glass-F11", 1.78472, 25.76},   {"glass-SF11", 1.78472, 25.76},
};

/* ---- spectra ------------------------------------------------------------------------------ */

double spectrum_at(const struct spectrum *s, double lambda)
{
    size_t low = 0, high = s->count;
    double t;

    if (s->count == 0)
        return 0;
    if (lambda <= s->samples[0])
        return lambda == s->samples[0] || s->extended ? s->samples[1] : 0;
    if (lambda >= s->samples[2 * (s->count - 1)])
        return lambda == s->samples[2 * (s->count - 1)] || s->extended ? s->samples[2 * s->count - 1] : 0;
    while (high - low > 1) {
        size_t middle = (low + high) / 2;
        if (s->samples[2 * middle] <= lambda)
            low = middle;
        else
            high = middle;
    }
    t = (lambda - s->samples[2 * low]) / (s->samples[2 * high] - s->samples[2 * low]);
    return s->samples[2 * low + 1] * (1 - t) + s->samples[2 * high + 1] * t;
}

void xyz_to_rgb(const double xyz[3], double out[3])
{
    /* IEC 61966-2-1. */
    static const double m[3][3] = {{3.2404542, -1.5371385, -0.4985314},
                                   {-0.9692660, 1.8760108, 0.0415560},
                                   {0.0556434, -0.2040259, 1.0572252}};

    for (int i = 0; i < 3; i++)
        out[i] = m[i][0] * xyz[0] + m[i][1] * xyz[1] + m[i][2] * xyz[2];
}

void chromaticity_to_rgb(double x, double y, double out[3])
{
    const double xyz[3] = {x / y, 1, (1 - x - y) / y};
    double luminance;

    xyz_to_rgb(xyz, out);
    for (int i = 0; i < 3; i++)
        out[i] = out[i] > 0 ? out[i] : 0;
    luminance = 0.2126729 * out[0] + 0.7151522 * out[1] + 0.0721750 * out[2];
    for (int i = 0; i < 3; i++)
        out[i] /= luminance;
}

/* The integral of `value` times the matching functions, and D65 if `lit`, in steps of 1 nm. */
typedef double spectrum_function(const void *of, double lambda);
static void integrate(spectrum_function *value, const void *of, int lit, double xyz[3])
{
    xyz[0] = xyz[1] = xyz[2] = 0;
    for (int nm = 0; nm <= (CIE_COUNT - 1) * CIE_STEP_NM; nm++) {
        int at = nm / CIE_STEP_NM < CIE_COUNT - 1 ? nm / CIE_STEP_NM : CIE_COUNT - 2;
        double t = (double)(nm - at * CIE_STEP_NM) / CIE_STEP_NM;
        double v = value(of, CIE_FIRST_NM + nm);
        if (lit)
            v *= cie[at][3] * (1 - t) + cie[at + 1][3] * t;
        for (int i = 0; i < 3; i++)
            xyz[i] += v * (cie[at][i] * (1 - t) + cie[at + 1][i] * t);
    }
}

static double value_of(const void *of, double lambda) { return spectrum_at(of, lambda); }

static double value_one(const void *of, double lambda)
{
    (void)of;
    (void)lambda;
    return 1;
}

/* RGB under D65, with white exactly (1, 1, 1). */
static void reflected(spectrum_function *value, const void *of, double out[3])
{
    double xyz[3], white_xyz[3], white[3];

    integrate(value, of, 1, xyz);
    integrate(value_one, NULL, 1, white_xyz);
    xyz_to_rgb(xyz, out);
    xyz_to_rgb(white_xyz, white);
    for (int i = 0; i < 3; i++)
        out[i] /= white[i];
}

void spectrum_reflectance(const struct spectrum *s, double out[3]) { reflected(value_of, s, out); }

static int light_rgb(const double xyz[3], double out[3])
{
    double sum = xyz[0] + xyz[1] + xyz[2];

    out[0] = out[1] = out[2] = 0;
    if (!(xyz[1] > 0) || !isfinite(sum) || !(xyz[1] / sum > 1e-6))
        return 0;
    chromaticity_to_rgb(xyz[0] / sum, xyz[1] / sum, out);
    return 1;
}

int spectrum_light(const struct spectrum *s, double out[3])
{
    double xyz[3];

    integrate(value_of, s, 0, xyz);
    return light_rgb(xyz, out);
}

double spectrum_luminance(const struct spectrum *s)
{
    double xyz[3], one[3];

    integrate(value_of, s, 0, xyz);
    integrate(value_one, NULL, 0, one);
    return xyz[1] / one[1];
}

/* Planck's law without its constant factor. */
static double value_blackbody(const void *of, double lambda)
{
    const double second_radiation_constant = 1.438776877e7; /* nm K */
    double x = second_radiation_constant / (lambda * *(const double *)of);
    double l = lambda / 560;

    /* The exponent relative to 560 nm keeps cold bodies above zero. */
    double x0 = second_radiation_constant / (560 * *(const double *)of);
    double e0 = det_exp_d(-x0);
    return det_exp_d(x0 - x) * (1 - e0) / (l * l * l * l * l * (1 - det_exp_d(-x)));
}

double spectrum_blackbody(double kelvin, double out[3])
{
    const double displacement = 2.8977721e6; /* nm K: Wien's */
    double xyz[3], one[3];

    kelvin = kelvin > 100 ? kelvin < 1e6 ? kelvin : 1e6 : 100;
    integrate(value_blackbody, &kelvin, 0, xyz);
    if (!light_rgb(xyz, out))
        out[0] = 1 / 0.2126729, out[1] = out[2] = 0;
    integrate(value_one, NULL, 0, one);
    return xyz[1] / one[1] / value_blackbody(&kelvin, displacement / kelvin);
}

/* The row with this name in a table whose rows begin with names; NULL: none. */
static const void *row_of(const void *table, size_t count, size_t row_bytes, const char *name)
{
    for (const char *row = table; count-- > 0; row += row_bytes)
        if (strcmp(*(const char *const *)(const void *)row, name) == 0)
            return row;
    return NULL;
}
#define ROW_OF(table, name) row_of(table, sizeof(table) / sizeof *(table), sizeof *(table), name)

const struct spectrum *spectrum_named(const char *name)
{
    const struct named_spectrum *row = ROW_OF(named, name);

    return row ? &row->spectrum : NULL;
}

int spectrum_named_light(const char *name, double out[3])
{
    const struct named_light *row = ROW_OF(lights, name);

    if (row)
        chromaticity_to_rgb(row->x, row->y, out);
    return row != NULL;
}

int spectrum_named_glass(const char *name, double *index, double *abbe)
{
    const struct named_glass *row = ROW_OF(glasses, name);

    if (row) {
        *index = row->index;
        *abbe = row->abbe;
    }
    return row != NULL;
}

void spectrum_glass(const struct spectrum *s, double *index, double *abbe)
{
    /* Fraunhofer's d, F and C lines. */
    double d = spectrum_at(s, 587.56), spread = spectrum_at(s, 486.13) - spectrum_at(s, 656.27);

    *index = d;
    *abbe = spread > 1e-6 && d > 1 ? (d - 1) / spread : 0;
}

/* ---- metals ------------------------------------------------------------------------------- */

double conductor_normal_reflectance(double eta, double k)
{
    double down = (eta - 1) * (eta - 1) + k * k, up = (eta + 1) * (eta + 1) + k * k;

    return up > 0 ? down / up : 0;
}

struct metal {
    const struct spectrum *eta, *k;
};

static double value_metal(const void *of, double lambda)
{
    const struct metal *metal = of;

    return conductor_normal_reflectance(spectrum_at(metal->eta, lambda), spectrum_at(metal->k, lambda));
}

void spectrum_conductor(const struct spectrum *eta, const struct spectrum *k, double eta_rgb[3], double k_rgb[3])
{
    const struct metal metal = {eta, k};
    double reflectance[3];

    reflected(value_metal, &metal, reflectance);
    spectrum_reflectance(eta, eta_rgb);
    for (int i = 0; i < 3; i++) {
        /* A saturated metal can lie a little outside of Rec. 709. */
        double f = reflectance[i] < 0.9999 ? reflectance[i] > 1e-6 ? reflectance[i] : 1e-6 : 0.9999;
        double n = eta_rgb[i] > 0.05 ? eta_rgb[i] : 0.05, square;
        square = (f * (n + 1) * (n + 1) - (n - 1) * (n - 1)) / (1 - f);
        if (square < 0) { /* too low for this eta: use the clear eta that has it */
            n = (1 + sqrt(f)) / (1 - sqrt(f));
            square = 0;
        }
        eta_rgb[i] = n;
        k_rgb[i] = sqrt(square);
    }
}
