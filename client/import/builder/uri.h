/* uri: the two kinds of URI that a glTF file may hold: data in the URI itself, and a file
 * named relative to the glTF file. */
#pragma once

#include <stddef.h>

#include "common/base/buffer.h"
#include "common/base/status.h"

struct input_files;

int uri_is_data(const char *uri);

/* Append the bytes of a data URI (base64 or percent-encoded). ERR_INPUT. */
status uri_decode_data(const char *uri, size_t limit_bytes, struct buffer *out, struct error *err) MUST_CHECK;

/* The path of a URI without a scheme in `folder`, mem_alloc'd. Schemes and NUL bytes are refused;
 * input_files_read checks where the path leads. The file need not exist; if the decoded name does
 * not exist but the name as written or with '/' for '\' does, that one is used. */
status uri_to_path(const char *uri, const char *folder, const struct input_files *files, char **path,
                   struct error *err) MUST_CHECK;
