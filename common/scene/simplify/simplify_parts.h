/* simplify_parts: the internals of simplify, shared by its files; only they include this.
 *
 * simplify.c         the order of the steps; the environment
 * simplify_survey.c  decodes images and vertex colours, and finds what is the same everywhere
 * simplify_fold.c    constants into factors; removes idle textures, flat normal maps, idle alpha
 * simplify_reach.c   removes what nothing reaches
 */
#pragma once

#include "common/scene/material.h"
#include "common/scene/simplify/simplify.h"

/* What is known of an image. Grey is replicated and a missing alpha is 1, as in the renderer. */
struct survey {
    int done;
    struct error fault; /* what prevented it, or code STATUS_OK */
    int floats;
    float code_max;                      /* 255, 65535; 0 for floats */
    float low[CHANNELS], high[CHANNELS]; /* codes, or values of floats */
};

struct simplifier {
    struct scene *scene;
    struct scene_blob_reader reader;
    struct scene_simplify_report *report;
    struct survey *images;     /* [image_count] */
    uint8_t *image_wanted;     /* [image_count] by simplify_survey_ahead */
    uint8_t *material_reached; /* [material_count] */
    uint8_t *animated;         /* [material_count] its values change: it stays as it is */
    uint8_t *alpha_colors;     /* [material_count] on a mesh with vertex alpha below 1 */
    uint8_t *mesh_alpha;       /* [mesh_count] 0: not checked yet, 1: all 1, 2: below */
    struct error *err;
};

/* ---- slots ---------------------------------------------------------------------------------- */

/* Empty the slots whose texture has no effect with the present factors. */
void simplify_drop_unseen(struct simplifier *w, struct scene_material *m);

/* ---- surveys -------------------------------------------------------------------------------- */

/* Decode on all processors what simplify_survey will ask for. It reports the faults, so the first one
 * is the same for any number of processors. The reader's get is called by several threads. */
void simplify_survey_ahead(struct simplifier *w);
/* Decode the image of a slot's texture the first time it is needed. */
status simplify_survey(struct simplifier *w, const struct scene_texture_slot *slot,
                       const struct survey **out) MUST_CHECK;
int survey_is_constant(const struct survey *s, int channel);
/* The least result of a lookup: in a constant channel the exact one (worker/render/texture/texture.c). */
float survey_least(const struct survey *s, int channel, int srgb);
/* +z to the precision of 8 bits. Their codes have no 0: 127 and 128 are on either side of it. */
int survey_is_flat(const struct survey *s);
/* Find the faults of an animated material's images: each of its textures may have an effect at some time. */
status simplify_survey_animated(struct simplifier *w, const struct scene_material *m) MUST_CHECK;
/* Which materials are on a mesh with vertices that are less than opaque, including a mix's parts. */
status simplify_survey_colors(struct simplifier *w) MUST_CHECK;

/* ---- what is done --------------------------------------------------------------------------- */

/* All slots. */
status simplify_fold(struct simplifier *w, struct scene_material *m) MUST_CHECK;
/* Fold the texture of one slot, if it is the same everywhere, into what it acts on. */
status simplify_fold_slot(struct simplifier *w, struct scene_material *m, enum material_texture slot) MUST_CHECK;
status simplify_make_opaque(struct simplifier *w, uint32_t index) MUST_CHECK;
/* How rough the surface is at least: without it any texture of roughness counts as a mirror somewhere. */
status simplify_least_roughness(struct simplifier *w, struct scene_material *m) MUST_CHECK;

/* A mix of which one part never, or always, appears no longer needs the other. */
void simplify_mixes(struct simplifier *w);
/* Fill material_reached. */
void simplify_reach(struct simplifier *w);
status simplify_remove_unreached(struct simplifier *w) MUST_CHECK;
