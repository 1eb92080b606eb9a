/* Webhooks without a network: what may be an address, bodies, signatures, and the queue over restarts. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "common/system/clock.h"
#include "coordinator/page/webhook_post.h"
#include "tests/support/scratch.h"
#include "tests/support/sim_farm.h"

static void only_http_addresses(void **state)
{
    static const char *const good[] = {"http://a", "https://a/b?c=d#e", "http://[::1]:99/", "http://u:p@a/", "HTTP://A/"};
    static const char *const bad[] = {"", "a", "a/b", "//a", "ftp://a/", "file:///a", "http://", "http:///a", "http://a b",
                                      "http://a/\n", "http://a/\x7f", "http://a/\xc3\xa9", "ldap://a", "http://a:99999/"};
    char longest[WEBHOOK_URL_MAX + 2];
    struct error err = {0};

    (void)state;
    for (size_t i = 0; i < sizeof good / sizeof *good; i++)
        assert_int_equal(webhook_check_url(good[i], &err), STATUS_OK);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        assert_int_equal(webhook_check_url(bad[i], &err), STATUS_ERR_INPUT);
    memset(longest, 'a', sizeof longest);
    memcpy(longest, "http://a/", 9);
    longest[WEBHOOK_URL_MAX] = 0;
    assert_int_equal(webhook_check_url(longest, &err), STATUS_OK);
    longest[WEBHOOK_URL_MAX] = 'a';
    longest[WEBHOOK_URL_MAX + 1] = 0;
    assert_int_equal(webhook_check_url(longest, &err), STATUS_ERR_INPUT);
}

static void bodies_are_json_with_a_delivery_of_their_own(void **state)
{
    char one[WEBHOOK_BODY_MAX], two[WEBHOOK_BODY_MAX], fields[WEBHOOK_BODY_MAX + 64];
    struct error err = {0};
    json_t *a, *b;

    (void)state;
    assert_int_equal(webhook_body(one, "job-done", "\"job\": 7", &err), STATUS_OK);
    assert_int_equal(webhook_body(two, "job-done", "\"job\": 7", &err), STATUS_OK);
    a = json_loads(one, 0, NULL);
    b = json_loads(two, 0, NULL);
    assert_string_equal(json_string_value(json_object_get(a, "event")), "job-done");
    assert_int_equal(json_integer_value(json_object_get(a, "job")), 7);
    assert_string_not_equal(json_string_value(json_object_get(a, "delivery")),
                            json_string_value(json_object_get(b, "delivery")));
    json_decref(a);
    json_decref(b);
    memset(fields, ' ', sizeof fields);
    fields[sizeof fields - 1] = 0;
    assert_int_equal(webhook_body(one, "job-done", fields, &err), STATUS_ERR_LIMIT);
}

/* printf '1700000000.{"a":1}' | openssl dgst -sha256 -hmac $(printf '07%.0s' {1..32}) */
static void a_signature_is_what_openssl_says(void **state)
{
    struct webhook_row row = {.number = 1};
    char signature[WEBHOOK_SIGNATURE_SIZE];
    struct error err = {0};

    (void)state;
    memset(row.secret, 7, sizeof row.secret);
    assert_int_equal(webhook_sign(signature, &row, 1700000000, "{\"a\":1}", &err), STATUS_OK);
    assert_string_equal(signature, "sha256=8581f207667300b1f2f8847953aaf433b07e61b888d609df508721fdabb6212a");
}

static struct webhook_counts await(struct webhooks *webhooks, uint64_t failed)
{
    const struct timespec pause = {0, 2000000};
    struct webhook_counts counts;

    do {
        nanosleep(&pause, NULL);
        counts = webhooks_counts(webhooks);
    } while (counts.failed < failed);
    return counts;
}

/* Nobody listens at port 1 of this machine: events wait, survive, are bounded, and go with their webhook. Counts of a
 * webhook that was removed stay. */
static void events_wait_are_bounded_and_survive(void **state)
{
    struct store *store = sim_store(folder);
    struct webhook_row row = {.url = "http://127.0.0.1:1/", .made_by = "ana@ws3"};
    struct webhook_view views[WEBHOOKS_MAX];
    struct webhooks *webhooks;
    struct webhook_counts counts;
    struct error err = {0};

    (void)state;
    assert_int_equal(webhooks_open(&webhooks, store, &err), STATUS_OK);
    assert_int_equal(webhook_add(webhooks, &row, &err), STATUS_OK);
    webhooks_send(webhooks, "job-done", "\"job\": 1");
    webhooks_send(webhooks, "job-done", "\"job\": 2");
    counts = await(webhooks, 1);
    assert_int_equal(counts.waiting, 2);
    webhooks_close(webhooks);

    assert_int_equal(webhooks_open(&webhooks, store, &err), STATUS_OK);
    assert_int_equal(webhooks_list(webhooks, views), 1);
    assert_int_equal(views[0].counts.waiting, 2);
    assert_string_equal(views[0].row.url, row.url);
    assert_string_equal(views[0].row.made_by, "ana@ws3");
    assert_memory_equal(views[0].row.secret, row.secret, sizeof row.secret);
    for (int i = 0; i < WEBHOOK_WAITING_MAX + 5; i++)
        webhooks_send(webhooks, "job-done", "\"job\": 3");
    counts = webhooks_counts(webhooks);
    assert_int_equal(counts.waiting, WEBHOOK_WAITING_MAX);
    assert_int_equal(counts.given_up, 7);
    counts = await(webhooks, 1);
    assert_int_equal(webhook_remove(webhooks, row.number, &err), STATUS_OK);
    assert_int_equal(webhook_remove(webhooks, row.number, &err), STATUS_ERR_NOT_FOUND);
    assert_int_equal(webhooks_list(webhooks, views), 0);
    store_settle(store);
    while (webhooks_counts(webhooks).waiting > 0) /* its place is freed by the thread */
        ;
    assert_true(webhooks_counts(webhooks).failed >= 1 && webhooks_counts(webhooks).given_up == 7);
    webhooks_close(webhooks);

    assert_int_equal(webhooks_open(&webhooks, store, &err), STATUS_OK);
    assert_int_equal(webhooks_counts(webhooks).waiting, 0);
    assert_int_equal(webhook_add(webhooks, &row, &err), STATUS_OK);
    assert_int_equal(row.number, 2); /* numbers are not used again */
    webhooks_close(webhooks);
    store_close(store);
}

#define WEBHOOK_TEST(name) cmocka_unit_test_setup_teardown(name, folder_set_up, folder_tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        WEBHOOK_TEST(only_http_addresses),
        WEBHOOK_TEST(bodies_are_json_with_a_delivery_of_their_own),
        WEBHOOK_TEST(a_signature_is_what_openssl_says),
        WEBHOOK_TEST(events_wait_are_bounded_and_survive),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
