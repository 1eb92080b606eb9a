/* reconnect: patience with a coordinator that goes away, as it does when it is restarted. */
#ifndef AZULEJO_CLIENT_RECONNECT_H
#define AZULEJO_CLIENT_RECONNECT_H

#include "client/farm/connection.h"

#define RECONNECT_DEFAULT_S 600.0

/* A row for a command's option table; `seconds` is a double. */
#define RECONNECT_OPTION_ROW(seconds)                                                           \
    {"reconnect", 0, OPTION_REAL, &(seconds), "SECONDS",                                        \
     "wait so long for a coordinator that goes away (default 600; 0: give up at once)", 0, 1e9, \
     NULL}

struct reconnect {
    struct connection_options where; /* its watch is asked between attempts, too */
    double patience_s;               /* from each loss; 0: none */
    uint64_t deadline_ns;            /* monotonic: wait no longer than this; 0: no such limit */
    int quiet;                       /* no words about it */
};

/* Does the status mean that the coordinator went away or is silent? */
int reconnect_is_loss(status code);

/* Close *c, which was lost for the reason in *err, and open another in its place, with pauses of
 * 0.25 s doubling up to 5 s. When it was in vain *c is NULL, and the status and the error are
 * those of the loss; ERR_TIMEOUT at the deadline; or what the watch, or a coordinator that refuses,
 * says. */
status reconnect(struct connection **c, const struct reconnect *how, struct error *err) MUST_CHECK;

#endif
