/* connection: a client's conversation with a coordinator, request by request.
 *
 * A connection owns a private libuv loop, one channel and the messages that have arrived but were not received yet.
 * Every call that waits runs the loop until its condition holds; meanwhile heartbeats are sent automatically. A caller
 * that computes for more than a second or two between calls must call connection_pump().
 *
 * Single-threaded. A connection that failed stays failed: every later call returns the same error.
 */
#pragma once

#include <stdint.h>

#include "common/cli/options.h"
#include "common/base/status.h"
#include "protocol/azulejo.pb-c.h"
#include "protocol/key.h"

#define CONNECTION_TIMEOUT_DEFAULT_S 30.0

/* Called for each caught signal while the connection waits; an error that it returns ends the wait
 * with that error and leaves the connection usable. */
typedef status (*connection_watch_fn)(void *user, struct error *err);

/* The options of every command that talks to a coordinator. */
struct connection_options {
    const char *coordinator;   /* HOST[:PORT]; NULL: AZULEJO_COORDINATOR or 127.0.0.1:7420 */
    const char *key_path;      /* NULL: AZULEJO_KEY or ~/.config/azulejo/farm.key */
    double timeout_s;          /* longest silence while an answer is awaited */
    connection_watch_fn watch; /* from the first moment on; NULL: none */
    void *watch_user;
    const double *patience_s; /* connection_open_waiting: how long a coordinator may be silent; NULL: timeout_s */
    const int *quiet;         /* silence is not said where this is set; NULL: nor where there is no patience */
};

enum { CONNECTION_HOST_MAX = 300 };

#define CONNECTION_OPTIONS_INIT {.timeout_s = CONNECTION_TIMEOUT_DEFAULT_S}

/* Rows for a command's option table; `o` is a struct connection_options. */
#define CONNECTION_OPTION_ROWS(o)                                                               \
    {"coordinator", 'c', OPTION_STRING, &(o).coordinator, "HOST[:PORT]",                        \
     "where the coordinator listens (default $AZULEJO_COORDINATOR, else 127.0.0.1:7420)",       \
     0, 0, NULL},                                                                               \
    {"key", 'k', OPTION_STRING, &(o).key_path, "FILE",                                          \
     "key file (default $AZULEJO_KEY, else ~/.config/azulejo/farm.key)", 0, 0, NULL},           \
    {"timeout", 0, OPTION_REAL, &(o).timeout_s, "SECONDS",                                      \
     "give up when the coordinator is silent for this long (default 30)", 0.01, 86400, NULL}

/* The address and the key: from the options, else the environment, else the defaults. The caller wipes the key. */
status connection_options_resolve(const struct connection_options *options, char host[CONNECTION_HOST_MAX],
                                  uint16_t *port, struct farm_key *key, struct error *err) MUST_CHECK;

struct connection;

/* Load the key, connect, say Hello, await the Welcome. ERR_UNREACHABLE and ERR_REFUSED name host, port and remedy. */
status connection_open(struct connection **out, const struct connection_options *options, struct error *err) MUST_CHECK;

/* Flush the queue, close and free; NULL is fine. */
void connection_close(struct connection *c);

/* Set another watch. */
void connection_set_watch(struct connection *c, connection_watch_fn watch, void *user);

/* Send; `message->request` must have been chosen with connection_request_id(). Waits while
 * more than CHANNEL_QUEUE_HIGH bytes are queued. */
uint64_t connection_request_id(struct connection *c);
status connection_send(struct connection *c, Azulejo__Wire__Envelope *message, struct error *err) MUST_CHECK;

/* Wait for the next message that answers `request` (0: any). The message belongs to the caller: free with message_free.
 * A Failure message becomes its status and text. ERR_TIMEOUT after timeout_s of waiting. */
status connection_receive(struct connection *c, uint64_t request, Azulejo__Wire__Envelope **out,
                          struct error *err) MUST_CHECK;

/* Has a message that answers `request` arrived? Runs the loop once without waiting. */
int connection_pump(struct connection *c, uint64_t request);

/* Send and receive one answer, which must have the body `expected`. */
status connection_ask(struct connection *c, Azulejo__Wire__Envelope *question,
                      Azulejo__Wire__Envelope__BodyCase expected, Azulejo__Wire__Envelope **out,
                      struct error *err) MUST_CHECK;

/* Who owns the jobs that are submitted here, as the coordinator says: the name of the key, or user@host. */
enum { CONNECTION_WHO_MAX = 128 };
const char *connection_who(const struct connection *c);

/* "HOST:PORT" as given. */
const char *connection_address(const struct connection *c);
