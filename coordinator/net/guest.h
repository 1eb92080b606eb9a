/* guest: something else that lives on the server's loop and sees its farm: what the page and its API need
 * (coordinator/page). The server knows only this table; a build without the page has none.
 *
 *   start --> is_settled --> job_changed, job_event, tick, ... --> stop --> its handles close --> the loop ends
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"
#include "protocol/azulejo.pb-c.h"

enum { PAGE_URL_MAX = 512 };

struct server;
struct session;
struct job;
struct job_event;

struct server_guest {
    /* Once, when the server listens. ERR_UNREACHABLE: the server goes on without its guest, which has closed its
     * handles. Another error ends the server. */
    status (*start)(void *user, struct server *server, struct error *err);
    /* 0: not yet; the loop runs, and this is asked again. 1: and *result, as start's. */
    int (*is_settled)(void *user, status *result, struct error *err);
    /* What follows is called on the loop's thread, and must not block it. */
    void (*job_changed)(void *user, const struct job *job); /* its state or its samples */
    void (*job_removed)(void *user, uint64_t job);
    void (*workers_changed)(void *user);                          /* joined, left, steered */
    void (*job_event)(void *user, const struct job_event *event); /* a line of a job's log */
    void (*tick)(void *user, uint64_t now_ns);                    /* ten times a second */
    /* A message about the guest's own things (tokens, the page's): as a session_handler. */
    status (*message)(void *user, struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns,
                      struct error *err);
    /* A session of the page acts for a token: fill its `who` and `peer`. ERR_REFUSED. */
    status (*greet)(void *user, struct session *session, uint64_t token, struct error *err);
    void (*session_gone)(void *user, const struct session *session);
    /* Close all handles; the loop ends when they are closed. */
    void (*stop)(void *user);
    void *user;
};
