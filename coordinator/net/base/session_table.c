#include "coordinator/net/base/session_table.h"

#include "coordinator/net/server.h"

struct session *session_find(struct server *server, uint32_t id)
{
    struct session *s = server->by_id[id % SESSION_BUCKETS];

    while (s && s->id != id)
        s = s->same_bucket;
    return s;
}

void session_table_add(struct server *server, struct session *session)
{
    struct session **bucket;

    session->server = server;
    session->id = ++server->last_session;
    session->next = server->sessions;
    if (server->sessions)
        server->sessions->previous = session;
    server->sessions = session;
    bucket = &server->by_id[session->id % SESSION_BUCKETS];
    session->same_bucket = *bucket;
    *bucket = session;
    server->session_count++;
    server->page_session_count += session->of_page;
}

void session_table_remove(struct server *server, struct session *session)
{
    struct session **at = &server->by_id[session->id % SESSION_BUCKETS];

    while (*at != session)
        at = &(*at)->same_bucket;
    *at = session->same_bucket;
    *(session->previous ? &session->previous->next : &server->sessions) = session->next;
    if (session->next)
        session->next->previous = session->previous;
    server->session_count--;
    server->page_session_count -= session->of_page;
    for (at = &server->due; session->is_due && *at; at = &(*at)->next_due) {
        if (*at == session) {
            *at = session->next_due;
            break;
        }
    }
    for (at = &server->watching; session->is_watching && *at; at = &(*at)->next_watching) {
        if (*at == session) {
            *at = session->next_watching;
            break;
        }
    }
}

void session_due(struct session *session)
{
    if (session->is_due)
        return;
    session->is_due = 1;
    session->next_due = session->server->due;
    session->server->due = session;
}

struct session *session_next_due(struct server *server)
{
    struct session *session = server->due;

    if (session) {
        server->due = session->next_due;
        session->is_due = 0;
    }
    return session;
}

void session_watching(struct session *session)
{
    if (session->is_watching)
        return;
    session->is_watching = 1;
    session->next_watching = session->server->watching;
    session->server->watching = session;
}
