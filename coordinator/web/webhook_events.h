/* webhook_events: what webhooks are told, and what clients and the API ask about them. */
#ifndef AZULEJO_COORDINATOR_WEBHOOK_EVENTS_H
#define AZULEJO_COORDINATOR_WEBHOOK_EVENTS_H

#include <stdint.h>

#include "coordinator/net/session_messages.h"
#include "coordinator/web/webhook.h"

enum { STORE_EVENT_S = 5 };      /* the store is told of when it could not be used for so long */

struct web;
struct job;

/* The job has another state: job-done, job-failed, job-parked. */
void webhook_job_state(struct web *web, const struct job *job);
/* store-unusable, store-usable. At each tick of the server. */
void webhook_tick(struct web *web, uint64_t now_ns);

/* Answer the message, which is one about webhooks, now or through a task of the pool. */
status webhook_message(struct webhooks *webhooks, struct session *session, const Azulejo__Wire__Envelope *message,
                       struct error *err) MUST_CHECK;

#endif
