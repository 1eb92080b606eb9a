/* api_tables: the program's tables that pages need. docs/API.md has the forms. */
#pragma once

#include "web/api/request.h"

void api_operators(struct web_request *request); /* GET /operators: the tone mappers */
void api_effects(struct web_request *request);   /* GET /effects: the names behind bits and numbers */
void api_verbs(struct web_request *request);     /* GET /verbs: what can be done to jobs */
