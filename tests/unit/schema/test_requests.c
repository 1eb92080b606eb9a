/* The table of requests: each message of the protocol once, and roles that grow. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <string.h>

#include "common/schema/requests.h"
#include "protocol/azulejo.pb-c.h"

static const ProtobufCMessageDescriptor *const envelope = &azulejo__wire__envelope__descriptor;

static void each_message_has_a_row(void **state)
{
    size_t rows = 0, messages = 0;

    (void)state;
    for (unsigned i = 0; i < envelope->n_fields; i++) {
        if (envelope->fields[i].type != PROTOBUF_C_TYPE_MESSAGE)
            continue;
        messages++;
        if (!request_find(envelope->fields[i].name))
            fail_msg("%s has no row in common/schema/requests.h", envelope->fields[i].name);
    }
    for (size_t i = 0; i < REQUEST_COUNT; i++) {
        if (request_rules[i].is_part)
            continue;
        rows++;
        assert_non_null(protobuf_c_message_descriptor_get_field_by_name(envelope, request_rules[i].name));
        assert_ptr_equal(request_find(request_rules[i].name), &request_rules[i]); /* none stands there twice */
    }
    assert_int_equal(rows, messages);
    assert_null(request_find("store_collect")); /* a part is no message */
    assert_null(request_find(""));
}

/* What people send needs a role, what others send needs none, and a job's own means a job. */
static void rows_make_sense(void **state)
{
    (void)state;
    for (size_t i = 0; i < REQUEST_COUNT; i++) {
        const struct request_rule *r = &request_rules[i];
        if (r->from != REQUEST_FROM_ANYBODY && !r->is_part)
            assert_int_equal(r->role != WEB_ROLE_NONE, (r->from & REQUEST_FROM_PEOPLE) != 0);
        if (r->own) {
            const ProtobufCFieldDescriptor *f = protobuf_c_message_descriptor_get_field_by_name(envelope, r->name);
            assert_non_null(protobuf_c_message_descriptor_get_field_by_name(f->descriptor, "job"));
            assert_true(r->role > WEB_ROLE_SUBMIT);
        }
    }
    assert_int_equal(request_rules[REQUEST_JOB_CANCEL].role, WEB_ROLE_OPERATE);
    assert_int_equal(REQUEST_ROLE_JOB_CANCEL, WEB_ROLE_OPERATE);
    assert_true(REQUEST_OWN_JOB_CANCEL && !REQUEST_OWN_JOB_QUERY);
}

static void roles_have_words(void **state)
{
    (void)state;
    assert_string_equal(TOKEN_ROLE_WORDS, "view|submit|operate|admin");
    for (int r = WEB_ROLE_NONE + 1; r < WEB_ROLES; r++)
        assert_int_equal(web_role_parse(web_role_name((enum web_role)r)), r);
    assert_int_equal(web_role_parse("none"), WEB_ROLE_NONE);
    assert_int_equal(web_role_parse(""), WEB_ROLE_NONE);
    assert_int_equal(web_role_parse("Admin"), WEB_ROLE_NONE);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(each_message_has_a_row), cmocka_unit_test(rows_make_sense),
                                       cmocka_unit_test(roles_have_words)};

    return cmocka_run_group_tests(tests, NULL, NULL);
}
