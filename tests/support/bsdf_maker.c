#include "tests/support/bsdf_maker.h"

#include <stdio.h>

static int chance(struct test_random *r, unsigned percent) { return test_random_u64(r) % 100 < percent; }

static struct vec3 color(struct test_random *r)
{
    float x = test_random_float(r), y = test_random_float(r);
    return (struct vec3){x, y, test_random_float(r)};
}

struct bsdf_params bsdf_maker_plain(float metallic, float alpha)
{
    return (struct bsdf_params){.base_color = {0.8f, 0.5f, 0.3f}, .metallic = metallic,
                                .alpha = alpha, .ior = 1.5f, .specular = 1,
                                .specular_color = {1, 1, 1}};
}

static float any_alpha(struct test_random *r, float alpha_min)
{
    float a = test_random_float(r);
    a = chance(r, 10) ? 0 : a * a;
    return a > alpha_min ? a : alpha_min;
}

struct bsdf_params bsdf_maker_random(struct test_random *r, float alpha_min)
{
    static const float SHARES[] = {0, 0, 1, 1, 0.5f};
    static const float IORS[] = {1, 1.05f, 1.33f, 1.5f, 2.5f};
    struct test_random own = {r->state + 1}; /* the other parameters stay as they are without it */
    struct bsdf_params p = bsdf_maker_plain(SHARES[test_random_u64(r) % 5], any_alpha(r, alpha_min));

    p.base_color = color(r);
    p.ior = IORS[test_random_u64(r) % 5];
    p.specular = chance(r, 60) ? 1 : test_random_float(r);
    p.specular_color = color(r);
    p.specular_color.x *= 3;
    p.transmission = SHARES[test_random_u64(r) % 5];
    p.refractive = chance(r, 50);
    p.inside = chance(r, 50);
    p.single_scattering = chance(r, 20);
    if (chance(r, 25))
        p.ior_outside = IORS[test_random_u64(r) % 5];
    if (chance(r, 30))
        p.alpha_stretched = p.alpha + (1 - p.alpha) * test_random_float(r);
    if (chance(r, 20)) {
        p.conductor = 1;
        p.eta = vec3_scale(color(r), 3);
        p.k = vec3_scale(color(r), 6);
    }
    if (chance(r, 35)) {
        p.clearcoat = chance(r, 50) ? 1 : test_random_float(r);
        p.clearcoat_alpha = any_alpha(r, alpha_min);
        p.clearcoat_ior = IORS[test_random_u64(r) % 5];
        p.clearcoat_normal = (struct vec3){0, 0, 1};
        if (chance(r, 50))
            p.clearcoat_normal = vec3_normalize((struct vec3){
                0.6f * test_random_float(r) - 0.3f, 0.6f * test_random_float(r) - 0.3f, 1});
    }
    if (chance(r, 35)) {
        p.sheen_color = color(r);
        p.sheen_alpha = any_alpha(r, 0);
    }
    if (chance(r, 25)) {
        p.iridescence = chance(r, 50) ? 1 : test_random_float(r);
        p.iridescence_ior = 1 + 1.5f * test_random_float(r);
        p.iridescence_thickness_nm = 1000 * test_random_float(r);
    }
    if (chance(r, 30)) {
        p.diffuse_transmission = chance(r, 50) ? 1 : test_random_float(r);
        p.diffuse_transmission_color = color(r);
    }
    if (chance(r, 10))
        p.base_interreflection = 0.9f * test_random_float(r);
    p.thin_slab = chance(r, 20);
    if (chance(&own, 30))
        p.diffuse_roughness = chance(&own, 50) ? 1 : test_random_float(&own);
    return p;
}

struct bsdf_params bsdf_maker_white(struct test_random *r, float alpha_min)
{
    struct bsdf_params p = bsdf_maker_random(r, alpha_min);
    const struct vec3 white = {1, 1, 1};

    p.base_color = p.diffuse_transmission_color = white;
    if (chance(r, 80))
        p.specular_color = white;
    if (p.sheen_color.x > 0)
        p.sheen_color = white;
    if (p.clearcoat > 0)
        p.clearcoat = 1;
    return p;
}

/* What the kinds differ in from plastic of the given alpha. */
enum {
    METAL = 1, GLASS = 2, INSIDE = 4, WALL = 8, COAT = 16, SHEEN = 32, FILM = 64, STRETCHED = 128,
    THROUGH = 256, CONDUCTOR = 512, SLAB = 1024, MATT = 2048, DENSE = 4096, INTERREFLECTING = 8192,
    ROUGH = 16384,
};
static const struct { const char *name; unsigned parts; } KINDS[BSDF_MAKER_KINDS] = {
    {"Lambert", MATT},
    {"plastic", 0},
    {"metal", METAL},
    {"conductor", CONDUCTOR},
    {"rough glass", GLASS},
    {"rough glass from inside", GLASS | INSIDE},
    {"rough glass in something denser", GLASS | DENSE},
    {"thin wall", WALL},
    {"thin slab", WALL | SLAB},
    {"diffuse transmission", MATT | THROUGH},
    {"plastic that lets light through", THROUGH},
    {"coated diffuse", MATT | COAT | INTERREFLECTING},
    {"coated plastic", COAT},
    {"coated metal", METAL | COAT},
    {"coated conductor", CONDUCTOR | COAT | INTERREFLECTING},
    {"coated glass", GLASS | COAT},
    {"sheen over Lambert", MATT | SHEEN},
    {"sheen over plastic", SHEEN},
    {"film over plastic", FILM},
    {"film over metal", METAL | FILM},
    {"film over glass", GLASS | FILM},
    {"stretched plastic", STRETCHED},
    {"stretched metal", METAL | STRETCHED},
    {"stretched conductor", CONDUCTOR | STRETCHED},
    {"stretched glass", GLASS | STRETCHED},
    {"rough diffuse", MATT | ROUGH},
    {"plastic over rough diffuse", ROUGH},
    {"coated rough diffuse", MATT | ROUGH | COAT},
    {"everything over plastic", COAT | SHEEN | FILM | STRETCHED | THROUGH},
};

const char *bsdf_maker_kind_name(int kind) { return KINDS[kind].name; }

struct bsdf_params bsdf_maker_kind(int kind, float alpha)
{
    unsigned parts = KINDS[kind].parts;
    struct bsdf_params p = bsdf_maker_plain(parts & METAL ? 1 : 0, alpha);

    p.specular = parts & MATT ? 0 : 1;
    p.transmission = parts & (GLASS | WALL) ? 1 : 0;
    p.refractive = (parts & GLASS) != 0;
    p.inside = (parts & INSIDE) != 0;
    p.thin_slab = (parts & SLAB) != 0;
    p.ior_outside = parts & DENSE ? 2 : 0;
    p.base_interreflection = parts & INTERREFLECTING ? 0.5f : 0;
    p.diffuse_roughness = parts & ROUGH ? 0.8f : 0;
    if (parts & STRETCHED)
        p.alpha_stretched = alpha + (1 - alpha) * 0.6f;
    if (parts & CONDUCTOR) {
        p.conductor = 1;
        p.eta = (struct vec3){0.2f, 0.9f, 1.3f};
        p.k = (struct vec3){4, 2.4f, 1.9f};
    }
    if (parts & COAT) {
        p.clearcoat = 1;
        p.clearcoat_alpha = alpha;
        p.clearcoat_ior = 1.5f;
        p.clearcoat_normal = (struct vec3){0, 0, 1};
    }
    if (parts & SHEEN) {
        p.sheen_color = (struct vec3){1, 0.6f, 0.3f};
        p.sheen_alpha = alpha;
    }
    if (parts & FILM) {
        p.iridescence = 1;
        p.iridescence_ior = 1.8f;
        p.iridescence_thickness_nm = 400;
    }
    if (parts & THROUGH) {
        p.diffuse_transmission = 0.4f;
        p.diffuse_transmission_color = (struct vec3){0.3f, 0.9f, 0.5f};
    }
    return p;
}

struct bsdf_params bsdf_maker_other_side(const struct bsdf_params *p)
{
    struct bsdf_params back = *p;

    back.clearcoat_normal.x = -p->clearcoat_normal.x;
    back.clearcoat_normal.y = -p->clearcoat_normal.y;
    if (p->refractive)
        back.inside = !p->inside;
    return back;
}

const char *bsdf_maker_describe(const struct bsdf_params *p)
{
    static char text[2000];
    int used;

    used = snprintf(
        text, sizeof text,
        "base (%g %g %g) metallic %g alpha %g ior %g in %g specular %g (%g %g %g) transmission "
        "%g%s%s, stretched %g, conductor %d (%g %g %g) (%g %g %g), coat %g alpha %g ior %g n "
        "(%g %g %g), sheen (%g %g %g) alpha %g, film %g ior %g %g nm, through %g (%g %g %g), "
        "K %g, slab %d, single %d",
        (double)p->base_color.x, (double)p->base_color.y, (double)p->base_color.z,
        (double)p->metallic, (double)p->alpha, (double)p->ior, (double)p->ior_outside,
        (double)p->specular, (double)p->specular_color.x, (double)p->specular_color.y,
        (double)p->specular_color.z, (double)p->transmission,
        p->refractive ? " refractive" : "", p->inside ? " inside" : "",
        (double)p->alpha_stretched, p->conductor, (double)p->eta.x, (double)p->eta.y,
        (double)p->eta.z, (double)p->k.x, (double)p->k.y, (double)p->k.z,
        (double)p->clearcoat, (double)p->clearcoat_alpha, (double)p->clearcoat_ior,
        (double)p->clearcoat_normal.x, (double)p->clearcoat_normal.y,
        (double)p->clearcoat_normal.z, (double)p->sheen_color.x, (double)p->sheen_color.y,
        (double)p->sheen_color.z, (double)p->sheen_alpha, (double)p->iridescence,
        (double)p->iridescence_ior, (double)p->iridescence_thickness_nm,
        (double)p->diffuse_transmission, (double)p->diffuse_transmission_color.x,
        (double)p->diffuse_transmission_color.y, (double)p->diffuse_transmission_color.z,
        (double)p->base_interreflection, p->thin_slab, p->single_scattering);
#define FACTOR_TEXT(effect, member)                                      \
    used += snprintf(text + used, sizeof text - (size_t)used, ", " member);
#define NAME_AND_VALUE(name) #name " %g", (double)p->name
    BSDF_FACTOR_MAP(FACTOR_TEXT, NAME_AND_VALUE)
#undef NAME_AND_VALUE
#undef FACTOR_TEXT
    return text;
}
