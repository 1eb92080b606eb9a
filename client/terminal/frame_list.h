/* frame_list: how frames are named on command lines: --frames 1,5,10-100x10 and
 * --first-middle-last. One language for every command. Pure functions of their text.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/cli/options.h"
#include "common/base/status.h"

/* Ascending numbers, each once. The caller frees it, after a failure, too. */
struct frame_list {
    uint32_t *items;
    size_t count;
};
void frame_list_free(struct frame_list *list);

/* Parse numbers, ranges FIRST-LAST and ranges with a step FIRST-LASTxSTEP, separated by commas, in
 * any order: 1 to SETTINGS_FRAMES_MAX frames. ERR_USAGE. */
status frame_list_parse(const char *text, struct frame_list *out, struct error *err) MUST_CHECK;
/* Keep the first frame, the one in the middle (the earlier of two) and the last. */
void frame_list_ends(struct frame_list *list);

/* The two options. */
struct frame_choice {
    const char *list; /* NULL: not given */
    int first_middle_last;
};
#define FRAME_CHOICE_ROWS(c, letter, verb)                                                      \
    {"frames", letter, OPTION_STRING, &(c).list, "LIST",                                           \
     verb " only these frames, as in 1,5,10-100x10 (default: all)", 0, 0, NULL},                \
    {"first-middle-last", 0, OPTION_FLAG, &(c).first_middle_last, NULL,                         \
     "only the first, the middle and the last of these frames", 0, 0, NULL}

/* Check what can be checked without the job. ERR_USAGE. */
status frame_choice_check(const struct frame_choice *choice, struct error *err) MUST_CHECK;
/* The chosen ones of a job's frames first..last; count 0: all. ERR_USAGE: the job does not have one of them. */
status frame_choice_of(const struct frame_choice *choice, uint32_t first, uint32_t last, struct frame_list *out,
                       struct error *err) MUST_CHECK;
