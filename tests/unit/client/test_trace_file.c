/* A trace as a file: lanes that do not overlap, and a coordinator that says the impossible. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <jansson.h>
#include <string.h>

#include "client/farm/trace_file.h"
#include "protocol/message.h"

enum { EVENTS = 8 };

struct sample {
    Azulejo__Wire__TraceEvent events[EVENTS];
    const Azulejo__Wire__TraceEvent *pointers[EVENTS];
    Azulejo__Wire__TraceWorker worker;
    const Azulejo__Wire__TraceWorker *worker_pointer;
    Azulejo__Wire__JobEvent line, *line_pointer;
    Azulejo__Wire__JobLog log;
    Azulejo__Wire__Envelope envelope;
    struct job_trace trace;
};

static void sample_init(struct sample *s)
{
    memset(s, 0, sizeof *s);
    azulejo__wire__trace_worker__init(&s->worker);
    s->worker.number = 5;
    s->worker.host = (char *)"a \"host\"\n";
    s->worker_pointer = &s->worker;
    azulejo__wire__job_event__init(&s->line);
    s->line.at = 1000;
    s->line.text = s->line.who = (char *)"done\x01\xff";
    s->line_pointer = &s->line;
    azulejo__wire__job_log__init(&s->log);
    s->log.events = &s->line_pointer;
    s->log.n_events = 1;
    azulejo__wire__envelope__init(&s->envelope);
    s->envelope.job_log = &s->log;
    s->trace = (struct job_trace){.events = s->pointers, .workers = &s->worker_pointer, .worker_count = 1,
                                  .log = &s->envelope, .job = 3, .name = "walk", .utc_ns = 900000000000};
}

static Azulejo__Wire__TraceEvent *add(struct sample *s, Azulejo__Wire__TraceKind kind, uint64_t begin_ns, uint64_t ns)
{
    Azulejo__Wire__TraceEvent *e = &s->events[s->trace.event_count];

    azulejo__wire__trace_event__init(e);
    e->kind = kind;
    e->begin_ns = begin_ns;
    e->ns = ns;
    e->worker = 5;
    s->pointers[s->trace.event_count++] = e;
    return e;
}

/* The file, read back. Slices of a lane do not overlap, every lane has a name, and no time is negative. */
static json_t *write_and_check(struct sample *s, size_t slices)
{
    struct buffer text = BUFFER_INIT;
    json_t *file, *events, *event;
    size_t i, k, found = 0;

    job_trace_write(&s->trace, &text);
    file = json_loads(buffer_text(&text), 0, NULL);
    assert_non_null(file);
    buffer_release(&text);
    events = json_object_get(file, "traceEvents");
    json_array_foreach(events, i, event) {
        json_int_t pid = json_integer_value(json_object_get(event, "pid")), tid = json_integer_value(json_object_get(event, "tid"));
        double begin = json_number_value(json_object_get(event, "ts")), end = begin + json_number_value(json_object_get(event, "dur"));
        json_t *other;
        int named = 0;

        assert_true(begin >= 0 && end >= begin);
        if (strcmp(json_string_value(json_object_get(event, "ph")), "X") != 0)
            continue;
        found++;
        json_array_foreach(events, k, other) {
            int same = json_integer_value(json_object_get(other, "pid")) == pid &&
                       json_integer_value(json_object_get(other, "tid")) == tid;
            double at = json_number_value(json_object_get(other, "ts"));

            named |= same && strcmp(json_string_value(json_object_get(other, "name")), "thread_name") == 0;
            if (k > i && same && strcmp(json_string_value(json_object_get(other, "ph")), "X") == 0)
                assert_true(at + 0.001 >= end || at + json_number_value(json_object_get(other, "dur")) <= begin + 0.001);
        }
        assert_true(named);
    }
    assert_int_equal(found, slices);
    return file;
}

static double duration_of(json_t *file, const char *name)
{
    json_t *event;
    size_t i;
    double sum = 0;

    json_array_foreach(json_object_get(file, "traceEvents"), i,
                       event) if (strcmp(json_string_value(json_object_get(event, "name")), name) == 0) sum +=
        json_number_value(json_object_get(event, "dur"));
    return sum;
}

static void what_runs_at_once_has_lanes(void **state)
{
    const uint64_t at = 100000000000;
    struct sample s;
    json_t *file;

    (void)state;
    sample_init(&s);
    add(&s, AZULEJO__WIRE__TRACE_KIND__TRACE_DEVELOP, at, 500000);
    add(&s, AZULEJO__WIRE__TRACE_KIND__TRACE_DEVELOP, at + 100000, 500000);
    add(&s, AZULEJO__WIRE__TRACE_KIND__TRACE_FIGURES, at + 200000, 100000);
    add(&s, AZULEJO__WIRE__TRACE_KIND__TRACE_DEVELOP, at + 600000, 100000);
    add(&s, AZULEJO__WIRE__TRACE_KIND__TRACE_UNIT, at, 700000); /* of unknown threads */
    add(&s, AZULEJO__WIRE__TRACE_KIND__TRACE_UNIT, at, 700000);
    file = write_and_check(&s, 6);
    /* Nothing was cut: 1,100 us of pictures, 1,400 us of units. */
    assert_float_equal(duration_of(file, "pictures"), 1100, 1e-6);
    assert_float_equal(duration_of(file, "frame 0 tile 0"), 1400, 1e-6);
    json_decref(file);
}

static void a_thread_does_one_thing_at_a_time(void **state)
{
    struct sample s;
    json_t *file;

    (void)state;
    sample_init(&s);
    add(&s, AZULEJO__WIRE__TRACE_KIND__TRACE_UNIT, 1000000, 500000)->thread = 1;
    add(&s, AZULEJO__WIRE__TRACE_KIND__TRACE_UNIT, 1400000, 500000)->thread = 1; /* two clocks differ */
    add(&s, AZULEJO__WIRE__TRACE_KIND__TRACE_UNIT, 1000000, 500000)->thread = 2;
    file = write_and_check(&s, 3);
    assert_float_equal(duration_of(file, "frame 0 tile 0"), 500 + 400 + 500, 1e-6);
    json_decref(file);
}

static void what_cannot_be_is_harmless(void **state)
{
    struct sample s;

    (void)state;
    sample_init(&s);
    add(&s, (Azulejo__Wire__TraceKind)77, UINT64_MAX, UINT64_MAX)->frame = UINT32_MAX;
    add(&s, AZULEJO__WIRE__TRACE_KIND__TRACE_UNIT, 0, UINT64_MAX)->thread = UINT32_MAX;
    add(&s, AZULEJO__WIRE__TRACE_KIND__TRACE_UNIT, UINT64_MAX, 1)->worker = 99; /* nobody */
    add(&s, AZULEJO__WIRE__TRACE_KIND__TRACE_COMMIT, 5, 1)->then = 1;
    s.line.at = INT64_MAX;
    s.trace.utc_ns = INT64_MIN;
    s.trace.begun_at = INT64_MIN;
    json_decref(write_and_check(&s, 5));
    s.trace.event_count = 0;
    s.trace.worker_count = 0;
    json_decref(write_and_check(&s, 0));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_runs_at_once_has_lanes),
        cmocka_unit_test(a_thread_does_one_thing_at_a_time),
        cmocka_unit_test(what_cannot_be_is_harmless),
    };

    return cmocka_run_group_tests_name("trace_file", tests, NULL, NULL);
}
