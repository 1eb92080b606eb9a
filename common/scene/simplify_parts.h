/* simplify_parts: the inside of simplify, shared by its files; nobody else includes this.
 *
 * simplify.c         the order in which things are done; the environment
 * simplify_survey.c  decodes images and vertex colours, and says what is the same everywhere
 * simplify_slots.c   which slots a material has, and which of them cannot act
 * simplify_fold.c    constants into factors, flat normal maps and idle alpha into nothing
 * simplify_reach.c   removes what nothing reaches
 */
#ifndef AZULEJO_SCENE_SIMPLIFY_PARTS_H
#define AZULEJO_SCENE_SIMPLIFY_PARTS_H

#include <stddef.h>

#include "common/scene/simplify.h"

enum { RED, GREEN, BLUE, ALPHA, CHANNELS };

/* What is known of an image. Grey is replicated and a missing alpha is 1, as in the renderer. */
struct survey {
    int done;
    int floats;
    float code_max;              /* 255, 65535; 0 for floats */
    float low[CHANNELS], high[CHANNELS]; /* codes, or values of floats */
};

struct simplifier {
    struct scene *scene;
    struct scene_blob_reader reader;
    struct scene_simplify_report *report;
    struct survey *images;       /* [image_count] */
    uint8_t *material_reached;   /* [material_count] */
    uint8_t *alpha_colors;       /* [material_count] on a mesh with vertex alpha below 1 */
    uint8_t *mesh_alpha;         /* [mesh_count] 0: not looked at, 1: all 1, 2: below */
    struct error *err;
};

/* ---- slots ---------------------------------------------------------------------------------- */

#define AT(field) offsetof(struct scene_material, field)

/* A slot that multiplies factors: which channel which factor. */
struct simplify_rule {
    size_t slot;
    int srgb;
    float most;                  /* that the factor may be */
    int parts;
    struct {
        size_t factor;
        int channel;
    } part[CHANNELS];
};

enum {
    SIMPLIFY_RULES = 14, /* the first is the base colour's */
    SIMPLIFY_SLOTS = SIMPLIFY_RULES + 4, /* and those that multiply nothing */
};
extern const struct simplify_rule simplify_rules[SIMPLIFY_RULES];

/* By offset, and by number: the rules' first. */
struct scene_texture_slot *simplify_slot_at(struct scene_material *m, size_t offset);
struct scene_texture_slot *simplify_slot(struct scene_material *m, int i);

/* Empty the slots whose texture changes nothing, as the factors now stand. */
void simplify_drop_unseen(struct simplifier *w, struct scene_material *m);

/* ---- surveys -------------------------------------------------------------------------------- */

/* Decode the image of a slot's texture, the first time that it is asked about. */
status simplify_survey(struct simplifier *w, const struct scene_texture_slot *slot,
                       const struct survey **out) MUST_CHECK;
int survey_is_constant(const struct survey *s, int channel);
/* What a lookup in a constant channel gives, to the bit (worker/render/texture.c). */
float survey_constant(const struct survey *s, int channel, int srgb);
/* +z to the precision of 8 bits, whose codes have no 0: 127 and 128 are either side of it. */
int survey_is_flat(const struct survey *s);
/* Which materials lie on a mesh whose vertices are less than opaque; a mix's parts with it. */
status simplify_survey_colors(struct simplifier *w) MUST_CHECK;

/* ---- what is done --------------------------------------------------------------------------- */

status simplify_fold(struct simplifier *w, struct scene_material *m) MUST_CHECK;
status simplify_fold_rule(struct simplifier *w, struct scene_material *m,
                          const struct simplify_rule *rule) MUST_CHECK;
status simplify_make_opaque(struct simplifier *w, uint32_t index) MUST_CHECK;

/* A mix of which one part is never there, or always, needs the other no more. */
void simplify_mixes(struct simplifier *w);
/* Fill material_reached. */
void simplify_reach(struct simplifier *w);
status simplify_remove_unreached(struct simplifier *w) MUST_CHECK;

#endif
