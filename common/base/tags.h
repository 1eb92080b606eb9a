/* tags: words that workers are marked with and jobs ask for, as in "big,gpu". */
#pragma once

#include <stddef.h>

#include "common/base/status.h"

enum {
    TAG_MAX = 31,                /* bytes of one */
    TAGS_MAX = 8,
    TAGS_TEXT_MAX = TAGS_MAX * (TAG_MAX + 1),
};

/* Parse "NAME[,NAME]...": letters, digits, '-', '_' and '.'. `out` gets them in order, each once. ERR_USAGE
 * names what is wrong. */
status tags_parse(const char *text, char out[TAGS_TEXT_MAX + 1], struct error *err) MUST_CHECK;

/* Is every tag of `wanted` in `tags`? If not, `missing` gets the first that is not. Both are as made by
 * tags_parse; "" has none. */
int tags_have(const char *tags, const char *wanted, char missing[TAG_MAX + 1]);
