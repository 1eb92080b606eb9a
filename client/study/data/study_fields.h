/* study_fields: the tables of struct study's fields. Initialising, releasing, writing and reading
 * all follow them, so a new field is one line. Private to client/study. */
#pragma once

#include "client/study/data/study_data.h"

enum study_kind {
    STUDY_NUMBER,   /* double; NaN is null */
    STUDY_FLAG,     /* int: true or false */
    STUDY_TEXT,     /* char * */
    STUDY_INTERVAL, /* [value, low, high] */
    STUDY_NUMBERS,  /* list of double */
    STUDY_PIXELS,   /* struct study_picture: a PNG in base64 */
    STUDY_PART,     /* a structure inside */
    STUDY_ITEMS,    /* list of structures */
};

struct study_shape;
struct study_field {
    const char *name; /* in JSON; NULL ends a table */
    enum study_kind kind;
    size_t offset;
    const struct study_shape *shape; /* of STUDY_PART and STUDY_ITEMS */
};
struct study_shape {
    size_t size_bytes;
    const struct study_field *fields;
};

/* The memory layout of every STUDY_LIST. */
struct study_any_list {
    void *items;
    size_t count, capacity;
};

extern const struct study_shape study_shape_study;

/* One more element, empty; of at most `most`. */
void *study_list_add(void *list, const struct study_shape *shape, size_t most);
void study_numbers_add(void *list, double value);
void study_part_init(void *part, const struct study_shape *shape);
void study_part_release(void *part, const struct study_shape *shape);
