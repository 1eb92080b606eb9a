#include "common/base/tags.h"

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int is_tag_character(unsigned char c) { return isalnum(c) || c == '-' || c == '_' || c == '.'; }

static int by_name(const void *a, const void *b) { return strcmp(a, b); }

status tags_parse(const char *text, char out[TAGS_TEXT_MAX + 1], struct error *err)
{
    char names[TAGS_MAX][TAG_MAX + 1];
    size_t count = 0, used = 0;

    out[0] = 0;
    for (const char *at = text;; at++) {
        size_t length = strcspn(at, ",");
        size_t good = 0;
        while (good < length && is_tag_character((unsigned char)at[good]))
            good++;
        if (length == 0 || good < length || length > TAG_MAX)
            return error_set(err, STATUS_ERR_USAGE,
                             "'%.64s': a tag has 1 to %d letters, digits, '-', '_' or '.', as in big,gpu", text,
                             TAG_MAX);
        if (count == TAGS_MAX)
            return error_set(err, STATUS_ERR_USAGE, "'%.64s...': at most %d tags", text, TAGS_MAX);
        snprintf(names[count++], sizeof names[0], "%.*s", (int)length, at);
        at += length;
        if (*at == 0)
            break;
    }
    qsort(names, count, sizeof names[0], by_name);
    for (size_t i = 0; i < count; i++)
        if (i == 0 || strcmp(names[i], names[i - 1]) != 0)
            used += (size_t)snprintf(out + used, TAGS_TEXT_MAX + 1 - used, "%s%s", used ? "," : "", names[i]);
    return STATUS_OK;
}

/* Is the tag among them? */
static int has(const char *tags, const char *tag, size_t length)
{
    while (*tags) {
        size_t here = strcspn(tags, ",");
        if (here == length && memcmp(tags, tag, length) == 0)
            return 1;
        tags += here + (tags[here] == ',');
    }
    return 0;
}

int tags_have(const char *tags, const char *wanted, char missing[TAG_MAX + 1])
{
    while (*wanted) {
        size_t length = strcspn(wanted, ",");
        if (!has(tags, wanted, length)) {
            snprintf(missing, TAG_MAX + 1, "%.*s", (int)length, wanted);
            return 0;
        }
        wanted += length + (wanted[length] == ',');
    }
    return 1;
}
