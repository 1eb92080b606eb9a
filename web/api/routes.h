/* routes: every path of the API, in one table: routing, roles, openapi.yaml and docs are made from it. */
#pragma once

#include "web/api/request.h"

/* A request with its caller's role, parameters and body checked. Answers now, or later (request.h). */
typedef void web_handler(struct web_request *request);

struct web_route {
    enum web_method method;
    const char *path;     /* "/api/v1/jobs/{job}/pause" */
    enum web_role role;   /* the least that may */
    int own_jobs_suffice; /* a caller with SUBMIT may for jobs that it owns */
    web_handler *run;     /* NULL: the message below goes to the farm (call.h) */
    int message;          /* Envelope body case that the parameters and the JSON body fill, or 0 */
    int answer;           /* body case that answers it, or 0: the handler's own form */
    int streams_body;
    void (*open)(struct web_socket *socket); /* a WebSocket: sets its callbacks; NULL: plain HTTP */
    const char *query;                       /* names of the query's values, each a field of the message; NULL: none */
    const char *fixed;   /* "verb=drain": fields of the message that follow from the path; NULL: none */
    const char *summary; /* for openapi.yaml and docs: one sentence, imperative */
};

/* A table of routes. */
struct web_routing {
    const struct web_route *routes;
    size_t count;
    web_handler *run; /* of all of them */
};
extern const struct web_routing web_routing; /* the API's and the page's */

/* The route of a path, and its parameters (pointers into `path`, which is cut at '/'). NULL: none;
 * *allowed has a bit for each method that the path knows. */
const struct web_route *web_route_find(const struct web_routing *routing, enum web_method method, char *path,
                                       const char *parameters[WEB_PARAMETERS_MAX], unsigned *allowed);
