/* api_blobs: blobs as they arrive, into the store (store/blobs.h), without being held in memory. */
#ifndef AZULEJO_COORDINATOR_WEB_API_BLOBS_H
#define AZULEJO_COORDINATOR_WEB_API_BLOBS_H

#include "coordinator/web/request.h"

enum { API_UPLOADS_MAX = 64 }; /* arriving or on their way to the disk, of all callers */

/* PUT /blobs/{digest}: the body is the blob. Answered by {"digest": HEX, "bytes": N} when it is on the disk. */
void api_blob_put(struct web_request *request);

#endif
