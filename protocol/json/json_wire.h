/* json_wire: messages of the farm's protocol as JSON and back, for any message of azulejo.proto.
 *
 *   field                 JSON
 *   number, bool, text    the same; 64-bit integers above 2^53 as text of digits (both are read)
 *   choice                a number of common/schema/choices.h's CHOICE_FIELDS: its word; a set: an array of words,
 *                         with '-' for blanks. Numbers stand for what has no word, and are read for words, too. So
 *                         are an operator's parameters that are choices
 *   float, double         a number; NaN is null, infinities are "inf" and "-inf"
 *   enum                  a word: JOB_RUNNING is "running" (less what all its values begin with)
 *   bytes                 lower-case hexadecimal text
 *   message               an object; left out when absent
 *   repeated              an array, empty too
 *   map<string, ...>      an object
 *
 * Keys are the proto's field names. What is written has every field that has a value, also 0; what is read may
 * leave any out. Text from peers that is not UTF-8 is written with U+FFFD in its place.
 */
#pragma once

#include <protobuf-c/protobuf-c.h>

#include "common/base/buffer.h"
#include "common/base/status.h"

enum {
    JSON_WIRE_DEPTH_MAX = 16,     /* messages in messages that are read */
    JSON_WIRE_ITEMS_MAX = 65536,  /* values in all arrays of a text that is read */
};

/* Append the message as an object. Check buffer_ok at the end. */
void json_wire_put(struct buffer *out, const ProtobufCMessage *message);

/* A new message from the text of an object; size 0: of no fields. Free it with json_wire_free.
 * ERR_INPUT names the field and what it may be; ERR_LIMIT; ERR_NO_MEMORY. */
status json_wire_get(ProtobufCMessage **out, const ProtobufCMessageDescriptor *descriptor, const char *text,
                     size_t size, struct error *err) MUST_CHECK;
void json_wire_free(ProtobufCMessage *message);

/* Set a field that is no array and no message from plain text, as it stands in a path or a query ("12", "active",
 * "true"), of a message that json_wire_get made. ERR_INPUT, ERR_NO_MEMORY. */
status json_wire_set(ProtobufCMessage *message, const char *field, const char *text, struct error *err) MUST_CHECK;

/* The word of an enum's value; NULL: it has none. */
const char *json_wire_word(const ProtobufCEnumDescriptor *descriptor, int value, char out[64]);

/* Single values, for JSON that is no message. */
void json_put_text(struct buffer *out, const char *text); /* NULL as "" */
void json_put_word(struct buffer *out, const char *word); /* of a choice: '-' for blanks */
void json_put_number(struct buffer *out, double value);
void json_put_u64(struct buffer *out, uint64_t value);
/* One value, at `at`, of a field of messages `of` as json_wire_put has it: choices and enums as words. */
void json_put_field(struct buffer *out, const ProtobufCMessageDescriptor *of, const ProtobufCFieldDescriptor *field,
                    const void *at);
