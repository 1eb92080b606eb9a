/* import_relay: the coordinator, for a program that reads strangers' files. That program holds no key of the farm: it connects
 * to this process, with a key that is good for this one connection, and what an import needs of its messages is passed on.
 *
 *   begun --connects--> CONNECTED --either side's end, import_relay_end--> freed when all three handles are closed
 */
#pragma once

#include <stdint.h>

#include "common/base/buffer.h"
#include "web/base/link.h"

struct import_relay;

/* Listen on 127.0.0.1 for one connection. *port: where; `key`: the text of its key file, a secret. */
status import_relay_new(struct import_relay **out, struct link_peers *farm, uint16_t *port, struct buffer *key,
                        struct error *err) MUST_CHECK;
/* The program has ended. NULL is fine. */
void import_relay_end(struct import_relay *relay);
