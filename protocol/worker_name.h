/* worker_name: what a worker is called on its farm.
 *
 *   NAME        with a key that others share, too: whatever it says that it is called
 *   KEY@NAME    with a key of the name KEY, which TLS proves; NAME alone is what it says
 *   KEY         the same, where NAME is KEY as well
 *
 * NAME and a worker's KEY are words of 1 to 63 letters, digits, '.', '_' and '-' of ASCII, so that they never need quotes and
 * have no wildcards. What is before the '@' answers for what the worker does (coordinator/farm/roster.h). */
#pragma once

#include <stddef.h>

enum { WORKER_NAME_BYTES_MAX = 63, WORKER_LABEL_BYTES_MAX = 2 * WORKER_NAME_BYTES_MAX + 1 };

/* Of NAME, or a worker's KEY. */
int worker_name_is_valid(const char *name);
/* Of all forms above. */
int worker_label_is_valid(const char *label);
/* Put the label of a worker that says that it is called `name` into `out`; key "": one that others share. */
void worker_label_make(char out[WORKER_LABEL_BYTES_MAX + 1], const char *key, const char *name);
/* Bytes of its first part: of KEY, or of all of NAME. */
size_t worker_label_key(const char *label);
/* Do both begin with the same part? */
int worker_labels_share_key(const char *a, const char *b);
/* Is it that label, or one of that key? */
int worker_label_is_of(const char *label, const char *name);
