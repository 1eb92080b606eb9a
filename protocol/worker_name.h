/* worker_name: what a worker may be called on its farm. A word of 1 to 63 letters, digits, '.', '_' and
 * '-' of ASCII, so that it never needs quotes and has no wildcards. */
#pragma once

enum { WORKER_NAME_BYTES_MAX = 63 };

int worker_name_is_valid(const char *name);
