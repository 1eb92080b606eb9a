/* What both directions of json_wire share. */
#pragma once

#include "common/schema/setting.h"
#include "protocol/fields.h"
#include "protocol/json/json_wire.h"

#define JSON_WIRE_EXACT ((uint64_t)1 << 53) /* up to here a double, which JavaScript's numbers are, is exact */

int json_wire_is_map(const ProtobufCFieldDescriptor *field);

/* A CHOICE or a SET: of settings.h, or a row of CHOICE_FIELDS. NULL: the field is a plain one. */
const struct setting *json_wire_choice(const ProtobufCMessageDescriptor *message, const ProtobufCFieldDescriptor *field);
