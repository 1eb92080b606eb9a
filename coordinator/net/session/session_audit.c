#include "coordinator/net/session/session_audit.h"

#include <stdio.h>
#include <string.h>

#include "common/base/json_quote.h"
#include "coordinator/net/server.h"
#include "protocol/fields.h"
#include "protocol/json/json_wire.h"
#include "protocol/message.h"

enum { STRING_MAX = 256, LIST_MAX = 16, DEPTH_MAX = 3 };

void session_actor(const struct session *session, struct audit_actor *out)
{
    const struct key_identity *id = channel_identity(session->channel);

    memset(out, 0, sizeof *out);
    snprintf(out->who, sizeof out->who, "%s", session->who);
    snprintf(out->address, sizeof out->address, "%s", session->peer);
    if (id->name[0])
        snprintf(out->key, sizeof out->key, "%s %u %s", key_identity_role(id), id->generation, id->name);
    else
        snprintf(out->key, sizeof out->key, "%s", farm_role_name(session->role));
    out->session = session->id;
}

/* Everything else changes something: a message that is new is noted unless it is listed here. */
static int is_question(const Azulejo__Wire__Envelope *message)
{
    switch (message->body_case) {
    case AZULEJO__WIRE__ENVELOPE__BODY_BLOB_QUERY:
    case AZULEJO__WIRE__ENVELOPE__BODY_BLOB_GET:
    case AZULEJO__WIRE__ENVELOPE__BODY_BLOB_PUT:
    case AZULEJO__WIRE__ENVELOPE__BODY_FARM_QUERY:
    case AZULEJO__WIRE__ENVELOPE__BODY_METRICS_GET:
    case AZULEJO__WIRE__ENVELOPE__BODY_PAGE_BEGIN:
    case AZULEJO__WIRE__ENVELOPE__BODY_PAGE_LISTEN:
    case AZULEJO__WIRE__ENVELOPE__BODY_PAGE_NOTE:
    case AZULEJO__WIRE__ENVELOPE__BODY_PAGE_TAKEN:
    case AZULEJO__WIRE__ENVELOPE__BODY_TILES_WATCH:
    case AZULEJO__WIRE__ENVELOPE__BODY_TILES_TAKEN:
    case AZULEJO__WIRE__ENVELOPE__BODY_JOB_QUERY:
    case AZULEJO__WIRE__ENVELOPE__BODY_JOB_WATCH:
    case AZULEJO__WIRE__ENVELOPE__BODY_JOB_LOG_GET:
    case AZULEJO__WIRE__ENVELOPE__BODY_JOB_TRACE_GET:
    case AZULEJO__WIRE__ENVELOPE__BODY_HISTORY_GET:
    case AZULEJO__WIRE__ENVELOPE__BODY_FRAME_TILES_GET:
    case AZULEJO__WIRE__ENVELOPE__BODY_WORKER_QUERY:
    case AZULEJO__WIRE__ENVELOPE__BODY_OUTPUT_GET:
    case AZULEJO__WIRE__ENVELOPE__BODY_RENDER_REQUEST:
    case AZULEJO__WIRE__ENVELOPE__BODY_TOKEN_QUERY:
    case AZULEJO__WIRE__ENVELOPE__BODY_KEY_QUERY: return 1;
    case AZULEJO__WIRE__ENVELOPE__BODY_STORE_QUERY: return !message->store_query->collect;
    default: return 0;
    }
}

/* ---- a message's fields as JSON, whatever they are ------------------------------------------- */

static void put_message(struct buffer *out, const ProtobufCMessage *message, int depth);

/* The value at `at`, of a field of messages `of`; 0: it is not shown. */
static int put_value(struct buffer *out, const ProtobufCMessageDescriptor *of, const ProtobufCFieldDescriptor *field,
                     const void *at, int depth)
{
    char quoted[JSON_QUOTE_SIZE(STRING_MAX)];
    const char *text;

    switch (field->type) {
    case PROTOBUF_C_TYPE_STRING:
        text = *(const char *const *)at;
        json_quote(quoted, text ? text : "", STRING_MAX);
        buffer_puts(out, quoted);
        return 1;
    case PROTOBUF_C_TYPE_MESSAGE:
        if (depth == DEPTH_MAX || !*(const ProtobufCMessage *const *)at)
            return 0;
        put_message(out, *(const ProtobufCMessage *const *)at, depth + 1);
        return 1;
    case PROTOBUF_C_TYPE_BYTES: return 0;
    default: json_put_field(out, of, field, at); return 1;
    }
}

/* A field that was not sent has a value whose bytes are 0, or is empty text. */
static int is_absent(const ProtobufCFieldDescriptor *field, const void *at)
{
    static const char zeros[16];
    const char *text;

    if (field->type == PROTOBUF_C_TYPE_STRING) {
        text = *(const char *const *)at;
        return !text || !text[0];
    }
    return field->type == PROTOBUF_C_TYPE_BYTES || memcmp(at, zeros, field_bytes(field)) == 0;
}

/* The first of several values, and how many there are. */
static void put_list(struct buffer *out, const ProtobufCMessageDescriptor *of, const ProtobufCFieldDescriptor *field,
                     const void *values, size_t count)
{
    size_t begin = out->size;

    buffer_puts(out, "[");
    for (size_t i = 0; i < count && i < LIST_MAX; i++) {
        buffer_puts(out, i ? ", " : "");
        if (!put_value(out, of, field, (const char *)values + i * field_bytes(field), DEPTH_MAX)) {
            out->size = begin;
            buffer_printf(out, "%zu", count);
            return;
        }
    }
    if (count > LIST_MAX)
        buffer_printf(out, ", \"... %zu in all\"", count);
    buffer_puts(out, "]");
}

/* Fields that the line has outside of the details. */
static int is_in_line(const char *field) { return strcmp(field, "job") == 0 || strcmp(field, "verb") == 0; }

static void put_message(struct buffer *out, const ProtobufCMessage *message, int depth)
{
    const ProtobufCMessageDescriptor *d = message->descriptor;
    int any = 0;

    buffer_puts(out, "{");
    for (unsigned i = 0; i < d->n_fields; i++) {
        const ProtobufCFieldDescriptor *field = &d->fields[i];
        const char *at = (const char *)message + field->offset;
        size_t begin = out->size, count = 0;
        int repeated = field->label == PROTOBUF_C_LABEL_REPEATED;

        if (repeated)
            count = *(const size_t *)((const char *)message + field->quantifier_offset);
        if ((depth == 0 && is_in_line(field->name)) || (repeated ? count == 0 : is_absent(field, at)))
            continue;
        buffer_printf(out, "%s\"%s\": ", any ? ", " : "", field->name);
        if (repeated) {
            put_list(out, d, field, *(const void *const *)at, count);
        } else if (!put_value(out, d, field, at, depth)) {
            out->size = begin;
            continue;
        }
        any = 1;
    }
    buffer_puts(out, "}");
}

/* ---- lines ----------------------------------------------------------------------------------- */

static const char *worker_verb(Azulejo__Wire__WorkerVerb verb)
{
    switch (verb) {
    case AZULEJO__WIRE__WORKER_VERB__WORKER_DRAIN: return "workers drain";
    case AZULEJO__WIRE__WORKER_VERB__WORKER_RESUME: return "workers resume";
    case AZULEJO__WIRE__WORKER_VERB__WORKER_BLOCK: return "workers block";
    case AZULEJO__WIRE__WORKER_VERB__WORKER_UNBLOCK: return "workers unblock";
    default: return "workers";
    }
}

const char *session_verb(const Azulejo__Wire__Envelope *message)
{
    static const struct {
        int body;
        const char *words;
    } spoken[] = {
        {AZULEJO__WIRE__ENVELOPE__BODY_TOKEN_CREATE, "token create"},
        {AZULEJO__WIRE__ENVELOPE__BODY_TOKEN_REVOKE, "token revoke"},
        {AZULEJO__WIRE__ENVELOPE__BODY_TOKEN_RENEW, "token renew"},
        {AZULEJO__WIRE__ENVELOPE__BODY_WORKER_DISTRUST, "distrust"},
    };
    const char *name = message_name(message);

    if (message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_WORKER_STEER)
        return worker_verb(message->worker_steer->verb);
    if (message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_KEY_CHANGE)
        return message->key_change->rotate ? "key rotate" : "key revoke";
    if (message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_STORE_QUERY)
        return "gc";
    if (message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_JOB_REMOVE && message->job_remove->unless_read)
        return "prune";
    for (size_t i = 0; i < sizeof spoken / sizeof *spoken; i++)
        if (spoken[i].body == (int)message->body_case)
            return spoken[i].words;
    return strncmp(name, "job_", 4) == 0 ? name + 4 : name;
}

void session_audit(struct session *session, const Azulejo__Wire__Envelope *message, status s, const struct error *err)
{
    const ProtobufCMessage *body = message_body(message);
    int submission = message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_JOB_SUBMIT;
    struct buffer details = BUFFER_INIT;
    struct audit_actor actor;

    if (!body || is_question(message))
        return;
    session_actor(session, &actor);
    if (submission) {
        if (s != STATUS_OK)
            session_audit_submission(session->server, &actor, message->job_submit->name, 0, 0, s, err);
        return;
    }
    put_message(&details, body, 0);
    audit_note(&session->server->audit, &actor, session_verb(message), message_job(body),
               buffer_ok(&details) && details.size > 2 ? buffer_text(&details) : NULL, s == STATUS_OK ? NULL : err);
    buffer_release(&details);
}

void session_audit_submission(struct server *server, const struct audit_actor *actor, const char *name, uint64_t number,
                              int again, status s, const struct error *err)
{
    char quoted[JSON_QUOTE_SIZE(STRING_MAX)], details[sizeof quoted + 32];

    json_quote(quoted, name, STRING_MAX);
    snprintf(details, sizeof details, "{\"name\": %s%s}", quoted, again ? ", \"again\": true" : "");
    audit_note(&server->audit, actor, "submit", number, details, s == STATUS_OK ? NULL : err);
}
