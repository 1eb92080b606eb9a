/* api_farm: what the API says of the farm as a whole, and the tables that pages need. docs/API.md has the forms. */
#ifndef AZULEJO_COORDINATOR_WEB_API_FARM_H
#define AZULEJO_COORDINATOR_WEB_API_FARM_H

#include "coordinator/web/request.h"

struct server;

/* Append what GET /api/v1/farm and GET /api/v1/workers answer. ERR_NO_MEMORY. */
status api_farm_json(struct server *server, struct buffer *out, struct error *err) MUST_CHECK;
status api_workers_json(struct server *server, struct buffer *out, struct error *err) MUST_CHECK;

/* Handlers. */
void api_farm(struct web_request *request);      /* GET /farm */
void api_operators(struct web_request *request); /* GET /operators: the tone mappers */
void api_effects(struct web_request *request);   /* GET /effects: the names behind bits and numbers */
void api_verbs(struct web_request *request);     /* GET /verbs: what can be done to jobs */

#endif
