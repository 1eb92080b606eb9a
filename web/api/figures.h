/* figures: GET /metrics: the coordinator's figures and the page's own. */
#pragma once

#include "web/api/request.h"

void web_metrics(struct web_request *request);
