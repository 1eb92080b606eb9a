/* assets: the page's files, which scripts/embed.py puts into the program. */
#pragma once

#include <stddef.h>

#include "web/api/request.h"

struct web_asset_file {
    const char *name, *type, *etag; /* the etag is without quotes */
    const unsigned char *data;
    size_t size;
    const unsigned char *packed; /* the same by gzip */
    size_t packed_size;
};
extern const struct web_asset_file web_asset_files[];
extern const size_t web_asset_file_count;

/* The file of that name; NULL: none. */
const struct web_asset_file *web_asset_find(const char *name);
/* Does Accept-Encoding (NULL: none) take gzip? */
int web_accepts_gzip(const char *accept_encoding);
/* Does If-None-Match name this etag (in quotes)? */
int web_etag_matches(const char *if_none_match, const char *etag);

void web_asset_index(struct web_request *request);
void web_asset_openapi(struct web_request *request);
void web_asset(struct web_request *request);
void web_asset_in_folder(struct web_request *request);
