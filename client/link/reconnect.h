/* reconnect: waits for a coordinator that disconnects, for example because it is restarted. */
#pragma once

#include "client/link/connection.h"

#define RECONNECT_DEFAULT_S 600.0

/* A row for a command's option table; `seconds` is a double. */
#define RECONNECT_OPTION_ROW(seconds)                                                           \
    {"reconnect", 0, OPTION_REAL, &(seconds), "SECONDS",                                        \
     "wait this long for a coordinator that disconnects (default 600; 0: give up at once)", 0, 1e9, \
     NULL}

struct reconnect {
    struct connection_options where; /* its watch is also called between attempts */
    double patience_s;               /* from each loss; 0: none */
    uint64_t deadline_ns;            /* monotonic: wait no longer than this; 0: no such limit */
    int quiet;                       /* print nothing about it */
};

/* Does the status mean that the coordinator disconnected or is silent? */
int reconnect_is_loss(status code);

/* connection_open, and where a coordinator listens but does not answer (it is stopped, or its machine is stuck), wait for
 * it as long as options->patience_s says. */
status connection_open_waiting(struct connection **out, const struct connection_options *options,
                               struct error *err) MUST_CHECK;

/* Close *c, which was lost for the reason in *err, and open a new connection, with pauses of 0.25 s
 * doubling up to 5 s. On failure *c is NULL, and status and error are those of the loss;
 * ERR_TIMEOUT at the deadline; or the error of the watch, or of a coordinator that refuses. */
status reconnect(struct connection **c, const struct reconnect *how, struct error *err) MUST_CHECK;
