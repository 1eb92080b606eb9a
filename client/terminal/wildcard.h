/* wildcard: names with * and ?, as people type them. */
#pragma once

enum { WILDCARD_BYTES_MAX = 255 }; /* of a pattern that are looked at */

/* Only * and ? are wildcards: a pattern with other characters that fnmatch() knows is itself. */
int wildcard_fits(const char *pattern, const char *name);
int wildcard_is(const char *text);
