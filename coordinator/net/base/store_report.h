/* store_report: the StoreInfo message. */
#pragma once

#include <stdint.h>

struct session;

/* Answer with what the collector has measured and removed, or with a Failure without memory. */
void store_report_send(struct session *session, uint64_t request);
