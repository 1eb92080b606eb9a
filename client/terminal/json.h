/* json: the values and the documents that commands print for programs. */
#pragma once

#include <jansson.h>
#include <protobuf-c/protobuf-c.h>

#include "common/base/buffer.h"
#include "common/base/status.h"

/* A number, or null when it is not finite (JSON knows no NaN). Values of 32 bits have a function of
 * their own, so that 0.1f is 0.1. */
json_t *json_number(double value);
json_t *json_number_float(float value);

/* Text from the wire; "(not UTF-8)" if it is not. */
json_t *json_text(const char *text);

/* The message as protocol/json/json_wire.h has it, as the API answers. Takes &message->base. */
json_t *json_message(const ProtobufCMessage *message);

/* Append the value as text, indented by two columns a level. Reals are the shortest text that reads
 * back as the same value; JSON_REAL_PRECISION has one length for all. */
void json_write(struct buffer *out, const json_t *value);

/* Print JSON with a newline to standard output and drop the reference. */
status json_print(json_t *value, struct error *err) MUST_CHECK;
/* The same in one line, for what is printed as it happens. */
status json_print_line(json_t *value, struct error *err) MUST_CHECK;
