/* bsdf_maker: materials with everything that struct bsdf_params knows, by chance. */
#pragma once

#include "tests/support/statistics.h"
#include "worker/render/bsdf/bsdf.h"

/* alpha_min: no distribution is narrower, none is a delta lobe if above 0. */
struct bsdf_params bsdf_maker_random(struct test_random *r, float alpha_min);

/* The same with all colours white and all weights 1 or a half. */
struct bsdf_params bsdf_maker_white(struct test_random *r, float alpha_min);

/* Every kind of material that importers make, by name, with the given alpha for each of its
 * distributions. (A mix is one of two of them at every hit, and a dispersive glass one with
 * another index for every path.) */
enum { BSDF_MAKER_KINDS = 29 };
struct bsdf_params bsdf_maker_kind(int kind, float alpha);
const char *bsdf_maker_kind_name(int kind);

/* A plain dielectric of ior 1.5, base colour (0.8, 0.5, 0.3). */
struct bsdf_params bsdf_maker_plain(float metallic, float alpha);

/* The parameters as the other side's frame sees them (z turned over). */
struct bsdf_params bsdf_maker_other_side(const struct bsdf_params *p);

/* All of it in one line; in a static buffer. */
const char *bsdf_maker_describe(const struct bsdf_params *p);
