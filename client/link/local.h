/* local: a farm on this machine only, for the duration of one command.
 *
 * A real coordinator and real workers, each a process of its own, on a loopback port that the
 * kernel chooses, with a temporary key; all their files are in one temporary folder, the
 * coordinator's store, which is removed when the farm stops. If we are killed, the kernel kills the
 * workers and signals the coordinator, which removes the folder. There is no second way to render.
 */
#pragma once

#include "client/link/connection.h"

enum { LOCAL_WORKERS_MAX = 64 };

struct local_farm;

struct local_options {
    unsigned workers;          /* 1..LOCAL_WORKERS_MAX processes */
    unsigned threads;          /* of each; 0: the processors that we may use, divided among the workers */
    int web;                   /* with a page, whose address is printed */
    int verbose;               /* the programs' logs go to standard error */
    const char *double_worker; /* a worker that computes in double, for all of them; NULL: the usual one */
};

/* Signals must be caught already (signals_catch). On failure everything is cleaned up. */
status local_farm_start(struct local_farm **out, const struct local_options *options, struct error *err) MUST_CHECK;

/* Its address and key; valid until it is stopped. */
const struct connection_options *local_farm_address(const struct local_farm *farm);

/* A connection's watch function (user: the farm): ERR_JOB_FAILED when a signal requested a stop, or
 * when the coordinator or the last worker has ended. */
status local_farm_check(void *farm, struct error *err) MUST_CHECK;

/* The signals so far are handled: from now on only a further one is an error of local_farm_check. */
void local_farm_tolerate(struct local_farm *farm);

/* After a failure: if a program's end caused it, replace the error by that and print the end of its
 * log. Waits a moment for a program that is just ending. Returns the code. */
status local_farm_explain(struct local_farm *farm, status code, struct error *err);

/* End the programs and remove the folder; NULL is fine. */
void local_farm_stop(struct local_farm *farm);
