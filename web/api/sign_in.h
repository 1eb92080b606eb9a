/* sign_in: signing in to the page. */
#pragma once

#include "web/api/request.h"

/* POST /api/v1/session {"token": TEXT}: a cookie for a token. DELETE: no cookie any more. GET: who asks. */
void web_session_post(struct web_request *request);
void web_session_delete(struct web_request *request);
void web_session_get(struct web_request *request);
