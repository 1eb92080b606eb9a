/* tls: one end of a TLS 1.3 connection, in memory.
 *
 * Both ends prove that they hold the secret of one identity (an external PSK with an ephemeral Diffie-Hellman exchange, so
 * that a key that leaks later does not decrypt recorded traffic). There are no certificates, no tickets, no early data.
 * No I/O happens here: bytes from the wire go in through tls_feed, bytes for the wire come out through tls_output_*;
 * the owner of the socket does the I/O. The OpenSSL contexts for all connections of one side are made once per process,
 * by the first thread that needs them. A struct tls belongs to one thread at a time.
 *
 *   HANDSHAKE --tls_step--> OPEN --peer's close_notify--> ENDED
 *       \----------------------\--any error--> FAILED
 *
 * Take the output after every call: a failed handshake leaves an alert there that tells the peer why.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "protocol/key.h"

enum tls_state { TLS_HANDSHAKE, TLS_OPEN, TLS_ENDED, TLS_FAILED };

struct tls;

/* The key is copied. The client acts in `role`; ERR_REFUSED if the key is another role's. */
status tls_new_client(struct tls **out, const struct farm_key *key, enum farm_role role, struct error *err) MUST_CHECK;
/* The server accepts every identity that its key can derive. */
status tls_new_server(struct tls **out, const struct farm_key *key, struct error *err) MUST_CHECK;
void tls_free(struct tls *t);

/* Input bytes from the wire. ERR_NO_MEMORY. */
status tls_feed(struct tls *t, const void *data, size_t size_bytes, struct error *err) MUST_CHECK;

/* Advance the handshake. ERR_REFUSED: the keys differ, or the peer has no farm key; ERR_PROTOCOL:
 * the peer does not speak TLS 1.3. The texts do not name the peer. */
status tls_step(struct tls *t, struct error *err) MUST_CHECK;

/* Decrypt up to `capacity` bytes into `out`; *got is 0 if more input is needed or the peer ended
 * the connection (see tls_state_of). ERR_PROTOCOL: damaged records. */
status tls_read(struct tls *t, void *out, size_t capacity, size_t *got, struct error *err) MUST_CHECK;

/* Encrypt all of it into the output. Only when OPEN. */
status tls_write(struct tls *t, const void *data, size_t size_bytes, struct error *err) MUST_CHECK;

/* Put our close_notify into the output. */
void tls_end(struct tls *t);

size_t tls_output_bytes(const struct tls *t);
/* Move up to `capacity` bytes of output; returns how many were moved. */
size_t tls_output_take(struct tls *t, void *out, size_t capacity);

enum tls_state tls_state_of(const struct tls *t);
/* Whose secret both ends proved; of role NONE unless OPEN or ENDED. */
struct key_identity tls_identity(const struct tls *t);
enum farm_role tls_role(const struct tls *t);
