#include "tests/support/steering.h"

#include <stdio.h>

#include "common/base/memory.h"
#include "protocol/fields.h"

status do_verb_with(struct farm *farm, struct job *job, enum job_verb_name verb, uint32_t number, const char *who,
                    uint64_t now_ns, struct error *err)
{
    const struct job_verb *row = &job_verbs[verb];
    const char *name = row->field ? row->field : verb == VERB_EXTEND ? "spp" : NULL;
    Azulejo__Wire__Envelope message;
    struct steering what = {farm, job, &message, who, now_ns};
    char field[32];
    ProtobufCMessage *body;
    size_t *count;
    void *at;
    status s;

    snprintf(field, sizeof field, "job_%s", row->path);
    body = message_new(&message, field);
    at = name ? message_field(body, name, &count) : NULL;
    if (row->takes == VERB_TAKES_FRAMES) {
        *(uint32_t **)at = &number;
        *count = 1;
    } else if (row->takes == VERB_TAKES_TEXT) {
        *(const char **)at = "words";
    } else if (at) {
        *(uint32_t *)at = number;
    }
    s = steer(&what, err);
    mem_free(body);
    return s;
}

status do_verb(struct farm *farm, struct job *job, enum job_verb_name verb, const char *who, uint64_t now_ns,
               struct error *err)
{
    return do_verb_with(farm, job, verb, verb == VERB_DISCARD, who, now_ns, err);
}
