/* fields: messages by the names of their fields, for what treats all alike. */
#pragma once

#include <stddef.h>

#include "protocol/azulejo.pb-c.h"

/* The message in the envelope; NULL: none. */
const ProtobufCMessage *message_body(const Azulejo__Wire__Envelope *envelope);
/* A new message for this field of the envelope ("job_pause", which exists), in *out; free with mem_free. NULL: out of
 * memory. */
ProtobufCMessage *message_new(Azulejo__Wire__Envelope *out, const char *field);
/* Where the field's value is, and of a repeated one in *count how many there are; NULL: it has no such field. */
void *message_field(const ProtobufCMessage *message, const char *name, size_t **count);
/* Is the field there, and not 0 or empty? */
int message_is_set(const ProtobufCMessage *message, const char *name);
/* The number in its field `job`; 0: it has none. */
uint64_t message_job(const ProtobufCMessage *message);
/* Bytes that a value takes in the C structure. */
size_t field_bytes(const ProtobufCFieldDescriptor *field);
