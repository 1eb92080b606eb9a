#include "client/farm/verb.h"

#include <stdio.h>

#include "client/follow/job_info.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "protocol/fields.h"

static void set(const ProtobufCMessage *body, const struct job_verb *verb, const struct verb_argument *argument)
{
    size_t *count;
    void *at = verb->field ? message_field(body, verb->field, &count) : NULL;

    switch (verb->takes) {
    case VERB_TAKES_FLAG: *(protobuf_c_boolean *)at = 1; break;
    case VERB_TAKES_NUMBER: *(int32_t *)at = (int32_t)argument->number; break;
    case VERB_TAKES_TEXT: *(const char **)at = argument->text; break;
    case VERB_TAKES_FRAMES:
        *(uint32_t **)at = argument->frames.items;
        *count = argument->frames.count;
        break;
    default: break;
    }
}

status verb_ask(struct connection *c, uint64_t job, enum job_verb_name verb, const struct verb_argument *argument,
                Azulejo__Wire__Envelope **out, struct error *err)
{
    Azulejo__Wire__Envelope question;
    ProtobufCMessage *body;
    char field[32];
    status result;

    snprintf(field, sizeof field, "job_%s", job_verbs[verb].path);
    body = must(message_new(&question, field));
    *(uint64_t *)message_field(body, "job", NULL) = job;
    set(body, &job_verbs[verb], argument);
    result = job_ask(c, &question, job, out, err);
    mem_free(body);
    return result;
}
