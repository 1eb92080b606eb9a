#include "coordinator/net/session_table.h"

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
}
