/* feed: sends the page's program what changes on the farm: when something changed, at intervals of a named length, and
 * only what differs from what was sent before. Nothing is made while the program does not listen.
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"

struct feed;
struct job_event;
struct server;

status feed_new(struct feed **out, struct server *server, struct error *err) MUST_CHECK;
void feed_free(struct feed *feed); /* NULL is fine */
/* This session listens from now on; 0: none does. It is sent everything once. */
void feed_listen(struct feed *feed, uint32_t session);

/* The calls of guest.h. */
void feed_job_changed(struct feed *feed, uint64_t job);
void feed_job_removed(struct feed *feed, uint64_t job);
void feed_workers_changed(struct feed *feed);
void feed_job_event(struct feed *feed, const struct job_event *event);
void feed_tick(struct feed *feed, uint64_t now_ns);
