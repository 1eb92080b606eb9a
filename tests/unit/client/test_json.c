/* Documents as commands print them: valid, in order, with the shortest numbers. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "client/terminal/json.h"
#include "protocol/azulejo.pb-c.h"
#include "protocol/json/json_wire.h"

static void expect_text(json_t *value, const char *text)
{
    struct buffer out = BUFFER_INIT;
    json_t *back;

    json_write(&out, value);
    assert_string_equal(buffer_text(&out), text);
    back = json_loads(buffer_text(&out), JSON_DECODE_ANY, NULL);
    assert_true(json_equal(back, value));
    json_decref(back);
    json_decref(value);
    buffer_release(&out);
}

static void test_documents(void **state)
{
    (void)state;
    expect_text(json_pack("{s:o, s:[i, b, n], s:{}, s:[]}", "z", json_number(0.1), "a", 1, 1, "e", "f"),
                "{\n  \"z\": 0.1,\n  \"a\": [\n    1,\n    true,\n    null\n  ],\n  \"e\": {},\n"
                "  \"f\": []\n}");
    expect_text(json_pack("[{s:s}]", "a \"key\"", "x\n\xc3\xa9\\"),
                "[\n  {\n    \"a \\\"key\\\"\": \"x\\n\xc3\xa9\\\\\"\n  }\n]");
}

static void test_numbers(void **state)
{
    (void)state;
    expect_text(json_number_float(0.1f), "0.1");
    expect_text(json_number(1.1), "1.1");
    expect_text(json_number(3), "3.0");
    expect_text(json_integer(3), "3");
    expect_text(json_number(NAN), "null");
    expect_text(json_number_float(INFINITY), "null");
}

/* JobInfo of a release that has one field more: `salutes`, which no source names. */
struct saluted_job {
    Azulejo__Wire__JobInfo info;
    uint32_t salutes;
};

/* A field costs one line of azulejo.proto: what writes and reads messages follows the descriptor alone. */
static void test_one_field_more(void **state)
{
    enum { FIELDS_MAX = 128 };
    static ProtobufCFieldDescriptor fields[FIELDS_MAX];
    static unsigned by_name[FIELDS_MAX];
    const ProtobufCMessageDescriptor *old = &azulejo__wire__job_info__descriptor;
    ProtobufCMessageDescriptor more = *old;
    struct saluted_job job = {.salutes = 21};
    struct buffer text = BUFFER_INIT;
    ProtobufCMessage *again;
    json_t *value;
    unsigned at = 0;

    (void)state;
    assert_true(old->n_fields < FIELDS_MAX);
    memcpy(fields, old->fields, old->n_fields * sizeof *fields);
    fields[old->n_fields] = (ProtobufCFieldDescriptor){.name = "salutes", .id = 999, .type = PROTOBUF_C_TYPE_UINT32,
                                                       .offset = offsetof(struct saluted_job, salutes)};
    while (at < old->n_fields && strcmp(old->fields[old->fields_sorted_by_name[at]].name, "salutes") < 0)
        at++;
    memcpy(by_name, old->fields_sorted_by_name, at * sizeof *by_name);
    by_name[at] = old->n_fields;
    memcpy(by_name + at + 1, old->fields_sorted_by_name + at, (old->n_fields - at) * sizeof *by_name);
    more.fields = fields;
    more.fields_sorted_by_name = by_name;
    more.n_fields++;
    more.sizeof_message = sizeof job;
    azulejo__wire__job_info__init(&job.info);
    job.info.base.descriptor = &more;
    value = json_message(&job.info.base);
    assert_int_equal(json_integer_value(json_object_get(value, "salutes")), 21);
    for (unsigned i = 0; i < more.n_fields; i++)
        if (more.fields[i].type != PROTOBUF_C_TYPE_MESSAGE)
            assert_non_null(json_object_get(value, more.fields[i].name));
    json_write(&text, value);
    assert_int_equal(json_wire_get(&again, &more, buffer_text(&text), text.size, NULL), STATUS_OK);
    assert_int_equal(((const struct saluted_job *)(const void *)again)->salutes, 21);
    json_wire_free(again);
    json_decref(value);
    buffer_release(&text);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_documents),
        cmocka_unit_test(test_numbers),
        cmocka_unit_test(test_one_field_more),
    };

    return cmocka_run_group_tests_name("client/json", tests, NULL, NULL);
}
