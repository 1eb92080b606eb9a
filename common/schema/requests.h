/* requests: every message of the protocol, and who may send it to the coordinator: each once. The coordinator asks this
 * table alone, so commands, the API and the page follow one rule; the API's routes have their roles from it.
 *
 * REQUEST(NAME, name, FROM, ROLE, OWN)
 *   NAME, name  its field of Envelope
 *   FROM        ANYBODY, WORKERS, PEOPLE (clients, and the page for a token), WORKERS | PEOPLE, PAGE (the page's program)
 *   ROLE        the least role of people's keys and tokens (token_roles.h)
 *   OWN         OWN: for jobs of its own, "submit" suffices; ALL: it does not
 * ANSWER(NAME, name)
 *   what only the coordinator sends
 * PART(NAME, name, of, ROLE)
 *   a part of the message `of` that needs another role
 *
 * The verbs have their roles from verbs.h. tests/farm/test_keys.py sends each message with each kind of key. */
#pragma once

#include "common/schema/token_roles.h"
#include "common/schema/verbs.h"

#define REQUESTS(REQUEST, ANSWER, PART)                                                                                \
    REQUEST(HELLO, hello, ANYBODY, NONE, ALL)                                                                          \
    ANSWER(WELCOME, welcome)                                                                                           \
    REQUEST(FAILURE, failure, ANYBODY, NONE, ALL)                                                                      \
    REQUEST(HEARTBEAT, heartbeat, ANYBODY, NONE, ALL)                                                                  \
    REQUEST(NOTICE, notice, ANYBODY, NONE, ALL)                                                                        \
    REQUEST(BLOB_QUERY, blob_query, PEOPLE, SUBMIT, ALL)                                                               \
    ANSWER(BLOB_MISSING, blob_missing)                                                                                 \
    REQUEST(BLOB_PUT, blob_put, WORKERS | PEOPLE, SUBMIT, ALL) /* workers: what they are asked for by a BLOB_GET */    \
    ANSWER(BLOB_STORED, blob_stored)                                                                                   \
    REQUEST(BLOB_GET, blob_get, WORKERS | PEOPLE, ADMIN, ALL) /* workers: what their leases need */                    \
    ANSWER(BLOB_DATA, blob_data)                                                                                       \
    REQUEST(LEASE_REQUEST, lease_request, WORKERS, NONE, ALL)                                                          \
    ANSWER(LEASE_GRANT, lease_grant)                                                                                   \
    REQUEST(LEASE_RETURN, lease_return, WORKERS, NONE, ALL)                                                            \
    ANSWER(LEASE_REVOKE, lease_revoke)                                                                                 \
    REQUEST(TILE_RESULT, tile_result, WORKERS, NONE, ALL)                                                              \
    ANSWER(RESULT_ACK, result_ack)                                                                                     \
    REQUEST(JOB_BROKEN, job_broken, WORKERS, NONE, ALL)                                                                \
    REQUEST(RENDER_REQUEST, render_request, PEOPLE, SUBMIT, ALL)                                                       \
    REQUEST(RENDER_RESULT, render_result, WORKERS, NONE, ALL)                                                          \
    REQUEST(JOB_SUBMIT, job_submit, PEOPLE, SUBMIT, ALL)                                                               \
    PART(JOB_SUBMIT_FOR, job_submit_for, JOB_SUBMIT, OPERATE) /* a job of another owner */                             \
    PART(JOB_URGENT, job_urgent, JOB_PRIORITY, OPERATE)       /* a priority above SUBMIT_PRIORITY_MAX */               \
    ANSWER(JOB_ACCEPTED, job_accepted)                                                                                 \
    REQUEST(JOB_QUERY, job_query, PEOPLE, VIEW, ALL)                                                                   \
    ANSWER(JOB_LIST, job_list)                                                                                         \
    REQUEST(JOB_WATCH, job_watch, PEOPLE, VIEW, ALL)                                                                   \
    REQUEST(JOB_LOG_GET, job_log_get, PEOPLE, VIEW, ALL)                                                               \
    ANSWER(JOB_LOG, job_log)                                                                                           \
    REQUEST(JOB_TRACE_GET, job_trace_get, PEOPLE, VIEW, ALL)                                                           \
    ANSWER(JOB_TRACE, job_trace)                                                                                       \
    REQUEST(OUTPUT_GET, output_get, PEOPLE, VIEW, ALL)                                                                 \
    ANSWER(OUTPUT_DATA, output_data)                                                                                   \
    REQUEST(HISTORY_GET, history_get, PEOPLE, VIEW, ALL)                                                               \
    ANSWER(HISTORY, history)                                                                                           \
    REQUEST(FRAME_TILES_GET, frame_tiles_get, PEOPLE, VIEW, ALL)                                                       \
    ANSWER(FRAME_TILES, frame_tiles)                                                                                   \
    REQUEST(FARM_QUERY, farm_query, PEOPLE, VIEW, ALL)                                                                 \
    ANSWER(FARM_INFO, farm_info)                                                                                       \
    REQUEST(METRICS_GET, metrics_get, PEOPLE, VIEW, ALL)                                                               \
    ANSWER(METRICS, metrics)                                                                                           \
    REQUEST(STORE_QUERY, store_query, PEOPLE, VIEW, ALL)                                                               \
    PART(STORE_COLLECT, store_collect, STORE_QUERY, ADMIN) /* and remove what may go */                                \
    ANSWER(STORE_INFO, store_info)                                                                                     \
    REQUEST(WORKER_QUERY, worker_query, PEOPLE, VIEW, ALL)                                                             \
    ANSWER(WORKER_LIST, worker_list)                                                                                   \
    REQUEST(WORKER_STEER, worker_steer, PEOPLE, OPERATE, ALL)                                                          \
    REQUEST(WORKER_DISTRUST, worker_distrust, PEOPLE, OPERATE, ALL)                                                    \
    ANSWER(DISTRUST_REPORT, distrust_report)                                                                           \
    REQUEST(WORKER_STATUS, worker_status, WORKERS, NONE, ALL)                                                          \
    REQUEST(TOKEN_CREATE, token_create, PEOPLE, ADMIN, ALL)                                                            \
    ANSWER(TOKEN_MADE, token_made)                                                                                     \
    REQUEST(TOKEN_QUERY, token_query, PEOPLE, ADMIN, ALL)                                                              \
    ANSWER(TOKEN_LIST, token_list)                                                                                     \
    REQUEST(TOKEN_REVOKE, token_revoke, PEOPLE, ADMIN, ALL)                                                            \
    REQUEST(TOKEN_RENEW, token_renew, PEOPLE, ADMIN, ALL)                                                              \
    REQUEST(KEY_QUERY, key_query, PEOPLE, ADMIN, ALL)                                                                  \
    ANSWER(KEY_LIST, key_list)                                                                                         \
    REQUEST(KEY_CHANGE, key_change, PEOPLE, ADMIN, ALL)                                                                \
    REQUEST(PAGE_BEGIN, page_begin, PAGE, NONE, ALL)                                                                   \
    ANSWER(PAGE_TOKENS, page_tokens)                                                                                   \
    ANSWER(PAGE_STATE, page_state)                                                                                     \
    REQUEST(PAGE_LISTEN, page_listen, PAGE, NONE, ALL)                                                                 \
    ANSWER(FARM_CHANGE, farm_change)                                                                                   \
    REQUEST(PAGE_NOTE, page_note, PAGE, NONE, ALL)                                                                     \
    REQUEST(PAGE_TAKEN, page_taken, PAGE, NONE, ALL)                                                                   \
    REQUEST(TILES_WATCH, tiles_watch, PAGE, NONE, ALL)                                                                 \
    REQUEST(TILES_TAKEN, tiles_taken, PAGE, NONE, ALL)                                                                 \
    ANSWER(TILES_PICTURE, tiles_picture)                                                                               \
    ANSWER(TILES, tiles)                                                                                               \
    ANSWER(TILES_DONE, tiles_done)

/* The messages of the verbs. ROW as REQUEST. */
#define VERB_REQUESTS(ROW) JOB_VERBS(ROW, NO_REQUEST)
#define NO_REQUEST(...)

enum { SUBMIT_PRIORITY_MAX = 100 }; /* what a job gets from its owner, and from a role below that of JOB_URGENT */

enum { REQUEST_FROM_WORKERS = 1, REQUEST_FROM_PEOPLE = 2, REQUEST_FROM_PAGE = 4, REQUEST_FROM_ANYBODY = 7 };

enum request_name {
#define REQUEST(NAME, ...) REQUEST_##NAME,
#define VERB(NAME, ...) REQUEST_JOB_##NAME,
    REQUESTS(REQUEST, REQUEST, REQUEST) VERB_REQUESTS(VERB)
#undef REQUEST
#undef VERB
    REQUEST_COUNT
};

/* Constants for other tables: REQUEST_ROLE_FARM_QUERY, REQUEST_OWN_JOB_PAUSE. */
enum {
#define REQUEST(NAME, name, FROM, ROLE, OWN) REQUEST_ROLE_##NAME = WEB_ROLE_##ROLE, REQUEST_OWN_##NAME = REQUEST_IS_##OWN,
#define ANSWER(...)
#define PART(NAME, name, of, ROLE) REQUEST_ROLE_##NAME = WEB_ROLE_##ROLE, REQUEST_OWN_##NAME = REQUEST_IS_ALL,
#define VERB(NAME, name, ROLE, ...) REQUEST_ROLE_JOB_##NAME = WEB_ROLE_##ROLE, REQUEST_OWN_JOB_##NAME = REQUEST_IS_OWN,
#define REQUEST_IS_ALL 0
#define REQUEST_IS_OWN 1
    REQUESTS(REQUEST, ANSWER, PART) VERB_REQUESTS(VERB)
#undef REQUEST
#undef ANSWER
#undef PART
#undef VERB
};

struct request_rule {
    const char *name; /* "job_query" */
    unsigned from;    /* REQUEST_FROM_; 0: an answer, or a part */
    enum web_role role;
    int own;
    int is_part;
};
extern const struct request_rule request_rules[REQUEST_COUNT];

/* By the message's name; NULL: it is no message of the table. */
const struct request_rule *request_find(const char *name);
