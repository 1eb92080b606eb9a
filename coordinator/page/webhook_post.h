/* webhook_post: one request of a webhook (webhook.h), by a process of its own: `azulejo-web post`, so that no answer of
 * a foreign server is read by the coordinator, nor by the page. [any thread]
 *
 * Its standard input: the own ports, "PORT PORT", the address, the timestamp and the signature, a line each, then the
 * body. Its exit status is that of a status, and its standard output says why it is not 0.
 */
#pragma once

#include <stdatomic.h>
#include <stdint.h>

#include "common/base/status.h"
#include "coordinator/page/webhook.h"

struct webhook_post {
    uint16_t own_ports[2]; /* of this machine, where the coordinator listens; 0: none */
    atomic_int *ending;    /* set: the request is broken off */
};

/* Is this an address that a webhook may have? ERR_INPUT. */
status webhook_check_url(const char *url, struct error *err) MUST_CHECK;
/* The JSON of an event. ERR_LIMIT: it is too long; ERR_INTERNAL. */
status webhook_body(char out[WEBHOOK_BODY_MAX], const char *event, const char *fields, struct error *err) MUST_CHECK;
/* "sha256=HEX" of the body at that time. */
enum { WEBHOOK_SIGNATURE_SIZE = 7 + DIGEST_HEX_SIZE };
status webhook_sign(char out[WEBHOOK_SIGNATURE_SIZE], const struct webhook_row *row, int64_t at, const char *body,
                    struct error *err) MUST_CHECK;
/* Send the body, and wait for the answer: at most WEBHOOK_TIMEOUT_S and a second. ERR_UNREACHABLE: it was not taken;
 * ERR_REFUSED: the address is the coordinator's own; ERR_NO_MEMORY. */
status webhook_post(const struct webhook_post *post, const struct webhook_row *row, const char *body,
                    struct error *err) MUST_CHECK;
