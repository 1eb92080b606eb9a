/* health: is the coordinator alive? */
#ifndef AZULEJO_COORDINATOR_HEALTH_H
#define AZULEJO_COORDINATOR_HEALTH_H

#include "coordinator/web/request.h"

void web_healthz(struct web_request *request);

#endif
