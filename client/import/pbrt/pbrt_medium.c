/* Participating media. They are built at their first use: only then is the world's handedness known. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/import/pbrt/read/pbrt_context.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"

enum { MEDIUM_UNREAD = -2, GRID_CELLS_MAX = 1 << 28 };

struct medium_entry {
    struct pbrt_directive d;
    const char *name;
    int32_t row;
};

/* Scattering and absorption in 1/mm: the first dozen from Jensen et al. 2001, "A Practical
 * Model for Subsurface Light Transport" (reduced scattering), the rest from Narasimhan et al.
 * 2006, "Acquiring Scattering Properties of Participating Media by Dilution". */
static const struct {
    const char *name;
    double scattering[3], absorption[3];
} presets[] = {
    {"Apple", {2.29, 2.39, 1.97}, {0.0030, 0.0034, 0.046}},
    {"Chicken1", {0.15, 0.21, 0.38}, {0.015, 0.077, 0.19}},
    {"Chicken2", {0.19, 0.25, 0.32}, {0.018, 0.088, 0.20}},
    {"Cream", {7.38, 5.47, 3.15}, {0.0002, 0.0028, 0.0163}},
    {"Ketchup", {0.18, 0.07, 0.03}, {0.061, 0.97, 1.45}},
    {"Marble", {2.19, 2.62, 3.00}, {0.0021, 0.0041, 0.0071}},
    {"Potato", {0.68, 0.70, 0.55}, {0.0024, 0.0090, 0.12}},
    {"Skimmilk", {0.70, 1.22, 1.90}, {0.0014, 0.0025, 0.0142}},
    {"Skin1", {0.74, 0.88, 1.01}, {0.032, 0.17, 0.48}},
    {"Skin2", {1.09, 1.59, 1.79}, {0.013, 0.070, 0.145}},
    {"Spectralon", {11.6, 20.4, 14.9}, {0.00, 0.00, 0.00}},
    {"Wholemilk", {2.55, 3.21, 3.77}, {0.0011, 0.0024, 0.014}},
    {"Lowfat Milk", {0.89187, 1.5136, 2.532}, {0.002875, 0.00575, 0.0115}},
    {"Reduced Milk", {2.4858, 3.1669, 4.5214}, {0.0025556, 0.0051111, 0.012778}},
    {"Regular Milk", {4.5513, 5.8294, 7.136}, {0.0015333, 0.0046, 0.019933}},
    {"Espresso", {0.72378, 0.84557, 1.0247}, {4.7984, 6.5751, 8.8493}},
    {"Mint Mocha Coffee", {0.31602, 0.38538, 0.48131}, {3.772, 5.8228, 7.82}},
    {"Lowfat Soy Milk", {0.30576, 0.34233, 0.61664}, {0.0014375, 0.0071875, 0.035937}},
    {"Regular Soy Milk", {0.59223, 0.73866, 1.4693}, {0.0019167, 0.0095833, 0.065167}},
    {"Lowfat Chocolate Milk", {0.64925, 0.83916, 1.1057}, {0.0115, 0.0368, 0.1564}},
    {"Regular Chocolate Milk", {1.4585, 2.1289, 2.9527}, {0.010063, 0.043125, 0.14375}},
    {"Coke", {8.9053e-05, 8.372e-05, 0}, {0.10014, 0.16503, 0.2468}},
    {"Pepsi", {6.1697e-05, 4.2564e-05, 0}, {0.091641, 0.14158, 0.20729}},
    {"Sprite", {6.0306e-06, 6.4139e-06, 6.5504e-06}, {0.001886, 0.0018308, 0.0020025}},
    {"Gatorade", {0.0024574, 0.003007, 0.0037325}, {0.024794, 0.019289, 0.008878}},
    {"Chardonnay", {1.7982e-05, 1.3758e-05, 1.2023e-05}, {0.010782, 0.011855, 0.023997}},
    {"White Zinfandel", {1.7501e-05, 1.9069e-05, 1.288e-05}, {0.012072, 0.016184, 0.019843}},
    {"Merlot", {2.1129e-05, 0, 0}, {0.11632, 0.25191, 0.29434}},
    {"Budweiser Beer", {2.4356e-05, 2.4079e-05, 1.0564e-05}, {0.011492, 0.024911, 0.057786}},
    {"Coors Light Beer", {5.0922e-05, 4.301e-05, 0}, {0.006164, 0.013984, 0.034983}},
    {"Clorox", {0.0024035, 0.0031373, 0.003991}, {0.0033542, 0.014892, 0.026297}},
    {"Apple Juice", {0.00013612, 0.00015836, 0.000227}, {0.012957, 0.023741, 0.052184}},
    {"Cranberry Juice", {0.00010402, 0.00011646, 7.8139e-05}, {0.039437, 0.094223, 0.12426}},
    {"Grape Juice", {5.382e-05, 0, 0}, {0.10404, 0.23958, 0.29325}},
    {"Ruby Grapefruit Juice", {0.011002, 0.010927, 0.011036}, {0.085867, 0.18314, 0.25262}},
    {"White Grapefruit Juice", {0.22826, 0.23998, 0.32748}, {0.0138, 0.018831, 0.056781}},
    {"Shampoo", {0.0007176, 0.0008303, 0.0009016}, {0.014107, 0.045693, 0.061717}},
    {"Strawberry Shampoo", {0.00015671, 0.00015947, 1.518e-05}, {0.01449, 0.05796, 0.075823}},
    {"Head & Shoulders Shampoo", {0.023805, 0.028804, 0.034306}, {0.084621, 0.15688, 0.20365}},
    {"Lemon Tea Powder", {0.040224, 0.045264, 0.051081}, {2.4288, 4.5757, 7.2127}},
    {"Orange Powder", {0.00015617, 0.00017482, 0.0001762}, {0.001449, 0.003441, 0.007863}},
    {"Pink Lemonade Powder", {0.00012103, 0.00013073, 0.00012528}, {0.001165, 0.002366, 0.003195}},
    {"Cappuccino Powder", {1.8436, 2.5851, 2.1662}, {35.844, 49.547, 61.084}},
    {"Salt Powder", {0.027333, 0.032451, 0.031979}, {0.28415, 0.3257, 0.34148}},
    {"Sugar Powder", {0.00022272, 0.00025513, 0.000271}, {0.012638, 0.031051, 0.050124}},
    {"Suisse Mocha Powder", {2.7979, 3.5452, 4.3365}, {17.502, 27.004, 35.433}},
    {"Pacific Ocean Surface Water", {0.0001764, 0.00032095, 0.00019617}, {0.031845, 0.031324, 0.030147}},
};

void pbrt_medium(struct pbrt *p, const char *name, const struct pbrt_directive *d)
{
    struct medium_entry *entry = must(ARENA_NEW(&p->arena, struct medium_entry));

    entry->d = *d;
    entry->name = name;
    entry->row = MEDIUM_UNREAD;
    entry->d.kind = pbrt_keep(p, d->kind);
    entry->d.params = pbrt_params_copy(d->params, &p->arena);
    pbrt_name_set(p, &p->media, name, entry);
}

static int preset_find(const char *name)
{
    for (size_t i = 0; i < sizeof presets / sizeof *presets; i++)
        if (strcmp(presets[i].name, name) == 0)
            return (int)i;
    return -1;
}

static float coefficient(struct pbrt *p, const struct medium_entry *e, double x)
{
    const double most = (double)SCENE_COEFFICIENT_MAX;

    if (x > most)
        pbrt_warn(p, &e->d.at, "dense medium",
                  "medium \"%.60s\": a coefficient of %g per metre is taken as %g, the largest there is", e->name, x,
                  most);
    return (float)fmin(fmax(x, 0), most);
}

static status read_sigmas(struct pbrt *p, struct pbrt_params *params, double a[3], double s[3])
{
    int given;

    TRY(pbrt_color(p, params, "sigma_a", USE_UNBOUNDED, a, &given));
    return pbrt_color(p, params, "sigma_s", USE_UNBOUNDED, s, &given);
}

static status read_coefficients(struct pbrt *p, const struct medium_entry *e, struct scene_medium *out)
{
    /* pbrt-v3's own default is Jensen's whole milk, pbrt-v4's is 1. */
    static const double milk_a[3] = {0.0011, 0.0024, 0.014}, milk_s[3] = {2.55, 3.21, 3.77};
    struct pbrt_params *params = e->d.params;
    const char *preset = pbrt_string(params, "preset", "");
    double a[3] = {1, 1, 1}, s[3] = {1, 1, 1}, le[3] = {0, 0, 0};
    double scale = pbrt_float(params, "scale", 1), le_scale = pbrt_float(params, "Lescale", 1);
    double g = pbrt_float(params, "g", 0);
    const struct pbrt_param *glow;
    int given;

    if (p->version3) {
        memcpy(a, milk_a, sizeof a);
        memcpy(s, milk_s, sizeof s);
    }
    if (!p->version3) /* there a preset counts before them */
        TRY(read_sigmas(p, params, a, s));
    if (*preset && preset_find(preset) >= 0) {
        memcpy(a, presets[preset_find(preset)].absorption, sizeof a);
        memcpy(s, presets[preset_find(preset)].scattering, sizeof s);
    } else if (*preset) {
        pbrt_warn(p, &e->d.at, "medium preset", "the medium preset \"%.60s\" is not known", preset);
    }
    if (p->version3)
        TRY(read_sigmas(p, params, a, s));
    TRY(pbrt_color(p, params, "Le", USE_LIGHT, le, &given));
    glow = pbrt_param(params, "Lescale", PBRT_NUMBERS);
    if (glow && glow->number_count > 1) {
        pbrt_warn(p, &glow->at, "emission grid",
                  "medium \"%.60s\": a grid for \"Lescale\" is not supported: its mean is used", e->name);
        le_scale = 0;
        for (size_t i = 0; i < glow->number_count; i++)
            le_scale += glow->numbers[i] / (double)glow->number_count;
    }
    for (int i = 0; i < 3; i++) {
        out->absorption[i] = coefficient(p, e, a[i] * scale);
        out->scattering[i] = coefficient(p, e, s[i] * scale);
        out->emission[i] = (float)fmin(fmax(a[i] * scale * le[i] * le_scale, 0), 1e30);
    }
    out->g = (float)fmin(fmax(g, -0.999), 0.999);
    return STATUS_OK;
}

static status read_grid(struct pbrt *p, const struct medium_entry *e, struct scene_medium *out, float **grid)
{
    struct pbrt_params *params = e->d.params;
    const struct pbrt_param *density = pbrt_param(params, "density", PBRT_NUMBERS);
    static const char *const axes[3] = {"nx", "ny", "nz"};
    double p0[3] = {0, 0, 0}, p1[3] = {1, 1, 1};
    struct transform_d box = transform_d_identity(), world;
    size_t cells = 1;

    *grid = NULL;
    for (int i = 0; i < 3; i++) {
        long n = pbrt_integer(params, axes[i], 1);
        if (n < 1 || n > SCENE_GRID_SIDE_MAX)
            return pbrt_fail(p, STATUS_ERR_INPUT, &e->d.at, "medium \"%.60s\": \"%s\" is %ld: it must be 1 to %d",
                             e->name, axes[i], n, SCENE_GRID_SIDE_MAX);
        out->grid_size[i] = (uint32_t)n;
        cells *= (size_t)n;
    }
    if (!density || density->number_count != cells || cells > GRID_CELLS_MAX)
        return pbrt_fail(p, STATUS_ERR_INPUT, &e->d.at,
                         "medium \"%.60s\": \"float density\" has %zu values: nx ny nz = %zu are "
                         "expected (at most %d)",
                         e->name, density ? density->number_count : 0, cells, GRID_CELLS_MAX);
    (void)pbrt_triple(params, "p0", p0);
    (void)pbrt_triple(params, "p1", p1);
    for (int i = 0; i < 3; i++) {
        if (!(p1[i] > p0[i]))
            return pbrt_fail(p, STATUS_ERR_INPUT, &e->d.at, "medium \"%.60s\": the box from p0 to p1 is empty",
                             e->name);
        box.m[i][i] = p1[i] - p0[i];
        box.m[i][3] = p0[i];
    }
    if (pbrt_is_moving(&e->d.ctm))
        pbrt_warn(p, &e->d.at, "animated medium", "a medium that moves is not supported: at rest");
    world = transform_d_multiply(&e->d.ctm.at[0], &box);
    world = pbrt_to_world(p, &world);
    out->grid_to_world = world;
    out->has_grid = 1;
    *grid = must(mem_alloc_array(cells, sizeof **grid));
    for (size_t i = 0; i < cells; i++)
        (*grid)[i] = (float)fmin(fmax(density->numbers[i], 0), 1e9);
    return STATUS_OK;
}

static status build(struct pbrt *p, struct medium_entry *e)
{
    const int grid = strcmp(e->d.kind, "uniformgrid") == 0 || strcmp(e->d.kind, "heterogeneous") == 0;
    struct scene_medium medium = {0};
    float *cells = NULL;
    char what[128];
    uint32_t row;

    e->row = BUILDER_NO_ROW;
    if (!grid && strcmp(e->d.kind, "homogeneous") != 0) {
        snprintf(what, sizeof what, "medium %.60s", e->d.kind);
        pbrt_warn(p, &e->d.at, what, "medium \"%.60s\": the kind \"%.60s\" is not supported: left out", e->name,
                  e->d.kind);
        return STATUS_OK;
    }
    medium.name = builder_name(p->b, e->name);
    for (int i = 0; i < 3; i++)
        medium.grid_to_world.m[i][i] = 1;
    TRY(read_coefficients(p, e, &medium));
    if (grid)
        TRY(read_grid(p, e, &medium, &cells));
    (void)pbrt_string(e->d.params, "type", NULL);
    snprintf(what, sizeof what, "medium \"%.60s\"", e->d.kind);
    pbrt_params_report(e->d.params, p->b, what);
    TRY(builder_add_medium(p->b, &medium, cells, &row));
    e->row = (int32_t)row;
    return STATUS_OK;
}

status pbrt_medium_row(struct pbrt *p, const char *name, const struct pbrt_place *at, int32_t *row)
{
    struct medium_entry *e;

    *row = BUILDER_NO_ROW;
    if (!*name)
        return STATUS_OK;
    e = pbrt_name_find(&p->media, name);
    if (!e) {
        pbrt_warn(p, at, "medium", "the medium \"%.60s\" is not known: none", name);
        return STATUS_OK;
    }
    if (e->row == MEDIUM_UNREAD)
        TRY(build(p, e));
    *row = e->row;
    return STATUS_OK;
}
