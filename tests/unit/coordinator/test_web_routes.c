/* Paths and their routes; bytes that wait; ETags are in test_web_assets. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "common/base/memory.h"
#include "web/http/http_queue.h"
#include "web/api/routes.h"

static const struct web_route table[] = {
    {.method = WEB_GET, .path = "/", .role = WEB_ROLE_NONE},
    {.method = WEB_GET, .path = "/jobs", .role = WEB_ROLE_VIEW},
    {.method = WEB_POST, .path = "/jobs", .role = WEB_ROLE_SUBMIT},
    {.method = WEB_GET, .path = "/jobs/{job}", .role = WEB_ROLE_VIEW},
    {.method = WEB_DELETE, .path = "/jobs/{job}", .role = WEB_ROLE_OPERATE},
    {.method = WEB_GET, .path = "/jobs/{job}/frames/{frame}/history", .role = WEB_ROLE_VIEW},
    {.method = WEB_PUT, .path = "/imports/{import}/files/{path...}", .role = WEB_ROLE_SUBMIT},
};
static const struct web_routing routing = {table, sizeof table / sizeof *table, NULL};

/* The place of the route in the table, or -1. */
static int find(enum web_method method, const char *path, const char *first, const char *second, unsigned *allowed)
{
    const char *parameters[WEB_PARAMETERS_MAX];
    char text[128];
    const struct web_route *route;

    snprintf(text, sizeof text, "%s", path);
    route = web_route_find(&routing, method, text, parameters, allowed);
    if (!route)
        return -1;
    assert_int_equal(parameters[0] != NULL, first != NULL);
    assert_int_equal(parameters[1] != NULL, second != NULL);
    if (first)
        assert_string_equal(parameters[0], first);
    if (second)
        assert_string_equal(parameters[1], second);
    return (int)(route - table);
}

static void test_routes(void **state)
{
    unsigned allowed;

    (void)state;
    assert_int_equal(find(WEB_GET, "/", NULL, NULL, &allowed), 0);
    assert_int_equal(find(WEB_GET, "/jobs", NULL, NULL, &allowed), 1);
    assert_int_equal(allowed, 1 << WEB_GET | 1 << WEB_POST);
    assert_int_equal(find(WEB_POST, "/jobs", NULL, NULL, &allowed), 2);
    assert_int_equal(find(WEB_GET, "/jobs/12", "12", NULL, &allowed), 3);
    assert_int_equal(find(WEB_DELETE, "/jobs/x y", "x y", NULL, &allowed), 4);
    assert_int_equal(find(WEB_GET, "/jobs/12/frames/3/history", "12", "3", &allowed), 5);
    assert_int_equal(find(WEB_PUT, "/imports/1/files/a/b.bin", "1", "a/b.bin", &allowed), 6);
    assert_int_equal(find(WEB_PUT, "/jobs/12", "12", NULL, &allowed), -1);
    assert_int_equal(allowed, 1 << WEB_GET | 1 << WEB_DELETE);
    assert_int_equal(find(WEB_METHODS, "/jobs", NULL, NULL, &allowed), -1);
    assert_int_equal(allowed, 1 << WEB_GET | 1 << WEB_POST);
}

static void test_no_routes(void **state)
{
    static const char *const paths[] = {"", "//", "/job", "/jobs/", "/jobs//", "/jobs/12/", "/jobs/12/frames//history",
                                        "/jobs/12/frames/3/history/", "/imports/1/files/", "/JOBS", "jobs", "/jobs/1/2"};

    (void)state;
    for (size_t i = 0; i < sizeof paths / sizeof *paths; i++) {
        unsigned allowed;
        if (find(WEB_GET, paths[i], NULL, NULL, &allowed) != -1 || allowed != 0)
            fail_msg("'%s' has a route", paths[i]);
    }
}

/* Whatever is written comes out in order, in bites of any size, and messages keep their ends. */
static void test_queue(void **state)
{
    struct http_queue queue = {0};
    enum http_piece_kind kind;
    char out[64] = "", big[HTTP_PIECE_MIN + 10];
    int is_start, is_end;
    size_t size;
    uint8_t *data;

    (void)state;
    http_queue_add(&queue, HTTP_PIECE_STREAM, "Hello, ", 7);
    http_queue_add(&queue, HTTP_PIECE_STREAM, "world", 5);
    http_queue_add(&queue, HTTP_PIECE_STREAM, "", 0);
    assert_int_equal(queue.bytes, 12);
    assert_ptr_equal(queue.first, queue.last); /* small writes share a piece */
    while ((data = http_queue_next(&queue, 5, &size, &kind, &is_start, &is_end))) {
        strncat(out, (char *)data, size);
        http_queue_taken(&queue, size);
    }
    assert_string_equal(out, "Hello, world");
    assert_int_equal(queue.bytes, 0);

    http_queue_add(&queue, HTTP_PIECE_TEXT, "abc", 3);
    http_queue_add(&queue, HTTP_PIECE_BINARY, "", 0);
    http_queue_add(&queue, HTTP_PIECE_TEXT, "d", 1);
    http_queue_next(&queue, 2, &size, &kind, &is_start, &is_end);
    assert_true(size == 2 && kind == HTTP_PIECE_TEXT && is_start && !is_end);
    http_queue_taken(&queue, size);
    http_queue_next(&queue, 2, &size, &kind, &is_start, &is_end);
    assert_true(size == 1 && !is_start && is_end);
    http_queue_taken(&queue, size);
    assert_non_null(http_queue_next(&queue, 2, &size, &kind, &is_start, &is_end));
    assert_true(size == 0 && kind == HTTP_PIECE_BINARY && is_start && is_end);
    http_queue_taken(&queue, 0);
    memset(big, 'x', sizeof big);
    http_queue_add(&queue, HTTP_PIECE_STREAM, big, sizeof big);
    assert_int_equal(queue.bytes, 1 + sizeof big);
    http_queue_release(&queue);
    assert_null(queue.first);
    assert_int_equal(queue.bytes, 0);
}

/* Without memory it says so, and from then on takes nothing: bytes that follow a gap would be nonsense. */
static void test_queue_without_memory(void **state)
{
    struct http_queue queue = {0};

    (void)state;
    mem_fault_arm(0, 1);
    http_queue_add(&queue, HTTP_PIECE_STREAM, "abc", 3);
    mem_fault_arm(-1, 0);
    assert_true(queue.failed);
    http_queue_add(&queue, HTTP_PIECE_STREAM, "def", 3);
    assert_int_equal(queue.bytes, 0);
    http_queue_release(&queue);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_routes),
        cmocka_unit_test(test_no_routes),
        cmocka_unit_test(test_queue),
        cmocka_unit_test(test_queue_without_memory),
    };
    return cmocka_run_group_tests_name("web_routes", tests, NULL, NULL);
}
