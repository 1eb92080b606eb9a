/* session_table: the sessions of a server, by number. */
#pragma once

#include <stdint.h>

struct server;
struct session;

struct session *session_find(struct server *server, uint32_t id); /* NULL: it has ended */
/* Gives the session its id. The server does not own it. */
void session_table_add(struct server *server, struct session *session);
void session_table_remove(struct server *server, struct session *session);

/* The session has acknowledgements or changed watches to send: it is flushed before the loop waits. */
void session_due(struct session *session);
/* The next session that is due, which it then no longer is; NULL: none. */
struct session *session_next_due(struct server *server);
/* It has watches: changed jobs are sent to it. */
void session_watching(struct session *session);
