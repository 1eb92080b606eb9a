#include "coordinator/events/events.h"

#include <inttypes.h>

#include "common/base/buffer.h"
#include "common/base/json_quote.h"
#include "common/system/clock.h"
#include "coordinator/events/event_program.h"

enum { TEXT_MAX = 700 };

static const char *event_of(enum job_state state)
{
    switch (state) {
    case JOB_STATE_DONE: return "job-done";
    case JOB_STATE_FAILED: return "job-failed";
    case JOB_STATE_PARKED: return "job-parked";
    default: return NULL; /* a person cancelled it, or it goes on */
    }
}

static void put_text(struct buffer *out, const char *name, const char *text)
{
    char quoted[JSON_QUOTE_SIZE(TEXT_MAX)];

    json_quote(quoted, text, TEXT_MAX);
    buffer_printf(out, "%s\"%s\": %s", out->size ? ", " : "", name, quoted);
}

static void send(struct event_program *program, const char *event, struct buffer *fields)
{
    if (buffer_ok(fields))
        event_program_send(program, event, buffer_text(fields));
    buffer_release(fields);
}

void events_job_state(struct event_program *program, const struct job *job, const char *page)
{
    const char *event = event_of(job->state);
    struct buffer fields = BUFFER_INIT, url = BUFFER_INIT;

    if (!event)
        return;
    buffer_printf(&fields, "\"job\": %" PRIu64, job->id);
    put_text(&fields, "name", job->name);
    put_text(&fields, "owner", job->owner);
    put_text(&fields, "state", job_state_word(job->state));
    put_text(&fields, "text", job->state_text);
    buffer_printf(&fields, ", \"frames\": %u, \"frames_done\": %u, \"submitted_at\": %" PRId64 ", \"finished_at\": %" PRId64,
                  job_frame_count(job), job->frames_done_count, job->submitted_at, job->finished_at);
    if (page[0])
        buffer_printf(&url, "%s/#/job/%" PRIu64, page, job->id);
    if (url.size > 0 && buffer_ok(&url))
        put_text(&fields, "url", buffer_text(&url));
    buffer_release(&url);
    send(program, event, &fields);
}

void events_store(struct event_program *program, const struct trouble *trouble, int *reported, uint64_t now_ns)
{
    int is_long = trouble_is(trouble) && now_ns - trouble->since_ns > EVENT_STORE_S * NS_PER_SECOND;
    struct buffer fields = BUFFER_INIT;

    if (!*reported == !is_long || (*reported && trouble_is(trouble)))
        return;
    *reported = is_long;
    put_text(&fields, "text", is_long ? trouble->text : "the store can be used again: jobs continue");
    send(program, is_long ? "store-unusable" : "store-usable", &fields);
}
