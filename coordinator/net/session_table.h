/* session_table: the sessions of a server, by number. */
#ifndef AZULEJO_COORDINATOR_SESSION_TABLE_H
#define AZULEJO_COORDINATOR_SESSION_TABLE_H

#include <stdint.h>

struct server;
struct session;

struct session *session_find(struct server *server, uint32_t id); /* NULL: it has ended */
/* Gives the session its id. The server does not own it. */
void session_table_add(struct server *server, struct session *session);
void session_table_remove(struct server *server, struct session *session);

#endif
