/* api_files: a frame's files, sent as they are taken. */
#pragma once

#include "web/api/request.h"

/* GET /jobs/{job}/frames/{frame}/FILE: the route's message is an OutputGet of the kind. Files have an ETag, the
 * SHA-256 of their bytes; previews change, and have none. */
void api_picture(struct web_request *request);
