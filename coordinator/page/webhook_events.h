/* webhook_events: what is sent to webhooks, and what clients and the API ask about them. */
#pragma once

#include <stdint.h>

#include "coordinator/net/session/session_messages.h"
#include "coordinator/page/webhook.h"

enum { STORE_EVENT_S = 5 };      /* an unusable store is reported after so long */

struct page;
struct job;

/* The job has another state: job-done, job-failed, job-parked. */
void webhook_job_state(struct page *page, const struct job *job);
/* store-unusable, store-usable. At each tick of the server. */
void webhook_tick(struct page *page, uint64_t now_ns);

/* Answer the message, which is one about webhooks, now or through a task of the pool. */
status webhook_message(struct webhooks *webhooks, struct session *session, const Azulejo__Wire__Envelope *message,
                       struct error *err) MUST_CHECK;
