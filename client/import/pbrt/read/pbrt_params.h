/* pbrt_params: the typed parameter list of one directive, "type name" value(s) ...
 *
 * A list owns its memory and can be read into again; a copy lives in an arena. A parameter that was
 * not requested is reported by pbrt_params_report().
 */
#pragma once

#include "client/import/builder/builder.h"
#include "client/import/pbrt/read/pbrt_token.h"

enum { PBRT_PARAMS_MAX = 256 /* of one directive */ };

enum pbrt_type {
    PBRT_BOOL,
    PBRT_INTEGER,
    PBRT_FLOAT,
    PBRT_POINT2,
    PBRT_VECTOR2,
    PBRT_POINT3,
    PBRT_VECTOR3,
    PBRT_NORMAL,
    PBRT_RGB,
    PBRT_BLACKBODY,
    PBRT_SPECTRUM,
    PBRT_STRING,
    PBRT_TEXTURE,
    PBRT_TYPE_COUNT
};
#define PBRT_BIT(type) (1u << (type))
enum {
    PBRT_NUMBERS = PBRT_BIT(PBRT_FLOAT) | PBRT_BIT(PBRT_INTEGER),
    PBRT_TRIPLES = PBRT_BIT(PBRT_POINT3) | PBRT_BIT(PBRT_VECTOR3) | PBRT_BIT(PBRT_NORMAL),
    PBRT_PAIRS = PBRT_BIT(PBRT_POINT2) | PBRT_BIT(PBRT_VECTOR2),
    PBRT_COLORS = PBRT_BIT(PBRT_RGB) | PBRT_BIT(PBRT_BLACKBODY) | PBRT_BIT(PBRT_SPECTRUM),
};

struct pbrt_param {
    const char *name;
    enum pbrt_type type;
    struct pbrt_place at;
    size_t number_count, string_count;
    const double *numbers; /* booleans are 0 and 1 */
    const char *const *strings;
    size_t first_number, first_string, name_offset; /* while being read */
    int used;
    /* pbrt-v3: what the texture's name means where it stands, as a colour and as a number. */
    int is_bound;
    const struct pbrt_texture *bound_color, *bound_float;
};

struct pbrt_params {
    struct pbrt_param *items;
    size_t count, capacity;
    double *numbers;
    size_t number_count, number_capacity;
    const char **strings;
    size_t *string_offsets;
    size_t string_count, string_capacity, offset_capacity;
    struct buffer text;
    struct pbrt_params *defaults; /* used for names missing in this list (Attribute) */
    int color_space;              /* enum pbrt_color_space that "rgb" values are in */
};

void pbrt_params_release(struct pbrt_params *p);

/* Read parameters up to the next directive. Replaces the list. */
status pbrt_params_read(struct pbrt_params *p, struct pbrt_reader *r, struct builder *b) MUST_CHECK;

/* A copy in the arena, with `defaults`; NULL: out of memory. */
struct pbrt_params *pbrt_params_copy(const struct pbrt_params *p, struct arena *arena);

/* The parameter of that name and one of these types; it counts as used. NULL: none. */
const struct pbrt_param *pbrt_param(struct pbrt_params *p, const char *name, unsigned types);
/* Is there one of any type? Does not count as used. */
int pbrt_has(const struct pbrt_params *p, const char *name);
/* Mark these as known but without effect: no warning. */
void pbrt_ignore(struct pbrt_params *p, const char *const *names);

double pbrt_float(struct pbrt_params *p, const char *name, double otherwise);
long pbrt_integer(struct pbrt_params *p, const char *name, long otherwise);
int pbrt_bool(struct pbrt_params *p, const char *name, int otherwise);
const char *pbrt_string(struct pbrt_params *p, const char *name, const char *otherwise);
/* A point, vector or normal; 0: not given (`out` untouched). */
int pbrt_triple(struct pbrt_params *p, const char *name, double out[3]);

/* Warn about each parameter that was not requested. `what`: shape "sphere". */
void pbrt_params_report(struct pbrt_params *p, struct builder *b, const char *what);
/* The same, of an Attribute's, once all that follows has been read. */
void pbrt_params_untaken(const struct pbrt_params *p, struct builder *b);
