/* pbrt_directive: the words of a pbrt file, and how their arguments are read.
 *
 * A directive is a word and its arguments. Each file below has a list of the words that it
 * understands; pbrt.c takes the next word of the file and runs its entry. A directive reads its own
 * arguments from p->reader and leaves it before the next word.
 *
 * pbrt_state.c     matrices and attributes, their stack, included files
 * pbrt_preamble.c  camera, film and options, and WorldBegin itself
 * pbrt_world.c     the contents of the world
 */
#pragma once

#include "client/import/pbrt/read/pbrt_context.h"

/* `at` is the word's place. The last word of a list is NULL. */
struct pbrt_word {
    const char *word;
    status (*run)(struct pbrt *p, const struct pbrt_place *at);
};
extern const struct pbrt_word pbrt_state_words[], pbrt_preamble_words[], pbrt_world_words[];

/* ---- pbrt_arguments.c --------------------------------------------------------------------- */
/* A name in quotes, kept in the arena. */
status pbrt_next_string(struct pbrt *p, const char *directive, const char **out) MUST_CHECK;
/* `count` numbers, in brackets or not. */
status pbrt_next_numbers(struct pbrt *p, const char *directive, double *out, size_t count) MUST_CHECK;
/* Read parameters into p->params, with the attributes' defaults. */
status pbrt_next_params(struct pbrt *p, struct pbrt_params *defaults) MUST_CHECK;
/* A kind and parameters; `out` has p->params, until the next directive. */
status pbrt_read_directive(struct pbrt *p, const char *word, struct pbrt_params *defaults, const struct pbrt_place *at,
                           struct pbrt_directive *out) MUST_CHECK;

/* ---- pbrt_state.c ------------------------------------------------------------------------- */
/* The kinds of entries on the stack of states, each with its own closing directive. */
enum { PBRT_STACK_ATTRIBUTE, PBRT_STACK_TRANSFORM, PBRT_STACK_OBJECT, PBRT_STACK_IMPORT };
status pbrt_push(struct pbrt *p, int kind, const struct pbrt_place *at) MUST_CHECK;
status pbrt_pop(struct pbrt *p, int kind, const struct pbrt_place *at) MUST_CHECK;
/* End the imports whose file is finished. */
status pbrt_end_imports(struct pbrt *p, const struct pbrt_place *at, int all) MUST_CHECK;
/* Define a coordinate system for CoordSysTransform. */
void pbrt_keep_system(struct pbrt *p, const char *name, const struct pbrt_matrices *m);
/* Make the active matrices the identity. */
void pbrt_identity(struct pbrt *p);

/* ---- pbrt_world.c ------------------------------------------------------------------------- */
/* A material with a copy of p->params. */
void pbrt_material_new(struct pbrt *p, const char *kind, const char *name, const struct pbrt_place *at,
                       struct pbrt_material **out);
