/* api_blobs: blobs as they arrive, in pieces to the farm, without being held in memory. */
#pragma once

#include "web/api/request.h"

enum { API_UPLOADS_MAX = 64 }; /* arriving, of all callers */

/* PUT /blobs/{digest}: the body is the blob. Answered by {"digest": HEX, "bytes": N} when it is on the disk. */
void api_blob_put(struct web_request *request);
