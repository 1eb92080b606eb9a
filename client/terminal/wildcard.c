#include "client/terminal/wildcard.h"

#include <fnmatch.h>
#include <stdio.h>
#include <string.h>

int wildcard_fits(const char *text, const char *name)
{
    char pattern[3 * WILDCARD_BYTES_MAX + 1];
    size_t used = 0;

    for (size_t i = 0; text[i] && i < WILDCARD_BYTES_MAX; i++) {
        if (text[i] == '[')
            used += (size_t)sprintf(pattern + used, "[[]");
        else
            pattern[used++] = text[i];
    }
    pattern[used] = 0;
    return fnmatch(pattern, name, FNM_NOESCAPE) == 0;
}

int wildcard_is(const char *text) { return strpbrk(text, "*?") != NULL; }
