/* What strangers send to the API: the first byte chooses a message, whose JSON the rest is; or, from 128 on, the
 * rest is a method and a path for the table of routes. What is read is written and read again: the same bytes. */
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "web/api/routes.h"
#include "protocol/azulejo.pb-c.h"
#include "protocol/json/json_wire.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static uint8_t *pack(const ProtobufCMessage *message, size_t *size)
{
    uint8_t *bytes;

    *size = protobuf_c_message_get_packed_size(message);
    bytes = mem_alloc(*size + 1);
    if (bytes && protobuf_c_message_pack(message, bytes) != *size)
        abort();
    return bytes;
}

static void read_json(uint8_t which, const char *text, size_t size)
{
    const ProtobufCMessageDescriptor *envelope = &azulejo__wire__envelope__descriptor;
    const ProtobufCFieldDescriptor *field = &envelope->fields[which % envelope->n_fields];
    const ProtobufCMessageDescriptor *d = field->type == PROTOBUF_C_TYPE_MESSAGE ? field->descriptor : envelope;
    ProtobufCMessage *message = NULL, *again = NULL;
    struct buffer written = BUFFER_INIT;
    struct error err = {0};
    size_t packed, repacked;
    uint8_t *first, *second;

    if (json_wire_get(&message, d, text, size, &err) != STATUS_OK) {
        if (message || !err.text[0])
            abort();
        return;
    }
    json_wire_put(&written, message);
    if (buffer_ok(&written) &&
        json_wire_get(&again, d, (const char *)written.data, written.size, &err) == STATUS_OK) {
        first = pack(message, &packed);
        second = pack(again, &repacked);
        if (first && second && (packed != repacked || memcmp(first, second, packed) != 0))
            abort();
        mem_free(first);
        mem_free(second);
    } else if (err.code != STATUS_ERR_NO_MEMORY && err.code != STATUS_ERR_LIMIT) {
        abort();
    }
    json_wire_free(again);
    json_wire_free(message);
    buffer_release(&written);
}

static void find_route(uint8_t method, const char *text, size_t size)
{
    static const struct web_route rows[] = {
        {WEB_GET, "/api/v1/jobs", .summary = ""},
        {WEB_POST, "/api/v1/jobs/{job}/pause", .summary = ""},
        {WEB_GET, "/api/v1/jobs/{job}/frames/{frame}/preview.png", .summary = ""},
        {WEB_PUT, "/api/v1/imports/{import}/files/{path...}", .summary = ""},
        {WEB_DELETE, "/api/v1/jobs/{job}", .summary = ""},
        {WEB_GET, "/assets/{file}", .summary = ""},
    };
    static const struct web_routing routing = {rows, sizeof rows / sizeof *rows, NULL};
    const char *parameters[WEB_PARAMETERS_MAX];
    const struct web_route *route;
    unsigned allowed;
    char *path = mem_alloc(size + 1);

    if (!path)
        return;
    memcpy(path, text, size);
    path[size] = 0;
    size = strlen(path);
    route = web_route_find(&routing, (enum web_method)(method % WEB_METHODS), path, parameters, &allowed);
    if (route && !(allowed & 1u << route->method))
        abort();
    for (int i = 0; route && i < WEB_PARAMETERS_MAX && parameters[i]; i++)
        if (parameters[i] < path || parameters[i] >= path + size || !parameters[i][0])
            abort();
    mem_free(path);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size < 1)
        return 0;
    if (data[0] < 128)
        read_json(data[0], (const char *)data + 1, size - 1);
    else
        find_route(data[0], (const char *)data + 1, size - 1);
    return 0;
}
