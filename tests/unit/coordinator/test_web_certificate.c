/* The page's own certificate: made once, for a name, and replaced when it is no longer good. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include <cmocka.h>

#include "common/system/file.h"
#include "web/base/certificate.h"
#include "tests/support/scratch.h"

static char cert[64], key[64];

static int make_folder(void **state)
{
    if (folder_set_up(state) != 0)
        return -1;
    snprintf(cert, sizeof cert, "%s/cert.pem", folder);
    snprintf(key, sizeof key, "%s/key.pem", folder);
    return 0;
}

static int ensure(const char *name, char fingerprint[FINGERPRINT_SIZE])
{
    struct error err = {0};
    int made = -1;

    if (certificate_ensure(cert, key, name, &made, &err) != STATUS_OK ||
        certificate_fingerprint(cert, fingerprint, &err) != STATUS_OK)
        fail_msg("%s: %s", name, err.text);
    return made;
}

static void test_made_once(void **state)
{
    char first[FINGERPRINT_SIZE], again[FINGERPRINT_SIZE];
    struct stat of;

    (void)state;
    assert_int_equal(ensure("render.example", first), 1);
    assert_int_equal(strlen(first), 95);
    assert_int_equal(strspn(first, "0123456789ABCDEF:"), 95);
    assert_int_equal(stat(key, &of), 0);
    assert_int_equal(of.st_mode & 0777, 0600);
    assert_int_equal(ensure("render.example", again), 0);
    assert_string_equal(first, again);
    assert_int_equal(ensure("localhost", again), 0); /* it names that, too */
    assert_int_equal(ensure("127.0.0.1", again), 0);
}

static void test_made_again(void **state)
{
    char first[FINGERPRINT_SIZE], again[FINGERPRINT_SIZE];
    struct buffer old = BUFFER_INIT;

    (void)state;
    ensure("render.example", first);
    assert_int_equal(ensure("10.0.0.5", again), 1); /* another name */
    assert_string_not_equal(first, again);
    assert_int_equal(ensure("fe80::7", again), 1);
    ensure("fe80::7", first);
    assert_int_equal(remove(key), 0);
    assert_int_equal(ensure("fe80::7", again), 1); /* no key */
    assert_string_not_equal(first, again);
    assert_int_equal(file_read(key, 1 << 16, &old, NULL), STATUS_OK);
    assert_int_equal(remove(cert), 0);
    ensure("fe80::7", first);
    assert_int_equal(file_write_private(key, old.data, old.size, NULL), STATUS_OK);
    assert_int_equal(ensure("fe80::7", again), 1); /* the key of another one */
    assert_int_equal(file_write_private(cert, "x", 1, NULL), STATUS_OK);
    assert_int_equal(ensure("fe80::7", again), 1); /* damaged */
    buffer_release(&old);
}

static void test_no_certificate(void **state)
{
    char fingerprint[FINGERPRINT_SIZE];
    struct error err = {0};
    int made;

    (void)state;
    assert_int_equal(file_write_private(cert, "x", 1, NULL), STATUS_OK);
    assert_int_equal(certificate_fingerprint(cert, fingerprint, &err), STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, cert));
    assert_string_equal(fingerprint, "");
    assert_int_equal(certificate_ensure("/nowhere/cert.pem", "/nowhere/key.pem", "x", &made, &err), STATUS_ERR_IO);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_made_once),
        cmocka_unit_test(test_made_again),
        cmocka_unit_test(test_no_certificate),
    };
    return cmocka_run_group_tests_name("web_certificate", tests, make_folder, folder_tear_down);
}
