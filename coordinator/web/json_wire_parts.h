/* What both directions of json_wire share. */
#ifndef AZULEJO_COORDINATOR_WEB_JSON_WIRE_PARTS_H
#define AZULEJO_COORDINATOR_WEB_JSON_WIRE_PARTS_H

#include "coordinator/web/json_wire.h"
#include "protocol/fields.h"

#define JSON_WIRE_EXACT ((uint64_t)1 << 53) /* up to here a double, which JavaScript's numbers are, is exact */

int json_wire_is_map(const ProtobufCFieldDescriptor *field);

#endif
