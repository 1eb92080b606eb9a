/* Sockets on every address of a name. The kernel's answers to bind() are scripted where a machine would give them rarely. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <errno.h>
#include <netinet/in.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "protocol/listen.h"

/* What the next calls of bind() at an address of this family answer. */
static struct script {
    int family, code, times, calls;
} script;

int bind(int fd, const struct sockaddr *address, socklen_t size)
{
    if (address->sa_family == script.family && script.calls++ < script.times) {
        errno = script.code;
        return -1;
    }
    return (int)syscall(SYS_bind, fd, address, size);
}

static struct listen_request request(const char *host, uint16_t port)
{
    return (struct listen_request){.host = host, .port = port, .backlog = 8, .option = "--listen",
                                   .if_busy = "take another", .busy = STATUS_ERR_UNREACHABLE};
}

static void close_all(struct listen_sockets *sockets)
{
    for (unsigned i = 0; i < sockets->count; i++)
        close(sockets->fds[i]);
}

static int has_ipv6(void)
{
    struct listen_request six = request("::1", 0);
    struct listen_sockets sockets;

    if (listen_open(&sockets, &six, NULL) != STATUS_OK)
        return 0;
    close_all(&sockets);
    return 1;
}

static void need_ipv6(void)
{
    if (!has_ipv6()) {
        print_message("this machine has no IPv6\n");
        skip();
    }
}

static void test_all_addresses_have_one_port(void **state)
{
    static const char *const hosts[] = {"localhost", "LocalHost", ""};

    (void)state;
    need_ipv6();
    for (size_t i = 0; i < sizeof hosts / sizeof hosts[0]; i++) {
        struct listen_request r = request(hosts[i], 0);
        struct listen_sockets sockets;
        char port[8];
        script = (struct script){0};
        assert_int_equal(listen_open(&sockets, &r, NULL), STATUS_OK);
        assert_int_equal(sockets.count, 2);
        assert_true(sockets.port > 0);
        snprintf(port, sizeof port, ":%u", sockets.port);
        assert_non_null(strstr(sockets.names[0], port));
        assert_non_null(strstr(sockets.names[1], port));
        assert_string_not_equal(sockets.names[0], sockets.names[1]);
        close_all(&sockets);
    }
}

static void test_another_port_is_tried(void **state)
{
    struct listen_request r = request("localhost", 0);
    struct listen_sockets sockets;
    struct error err = {0};

    (void)state;
    need_ipv6();
    script = (struct script){AF_INET6, EADDRINUSE, 3, 0};
    assert_int_equal(listen_open(&sockets, &r, NULL), STATUS_OK);
    assert_int_equal(script.calls, 4);
    assert_int_equal(sockets.count, 2);
    close_all(&sockets);
    script = (struct script){AF_INET6, EADDRINUSE, 1000, 0};
    assert_int_equal(listen_open(&sockets, &r, &err), STATUS_ERR_UNREACHABLE);
    assert_int_equal(script.calls, LISTEN_TRIES_MAX);
    assert_int_equal(sockets.count, 0);
}

static void test_a_busy_address_is_named(void **state)
{
    struct listen_request any = request("127.0.0.1", 0), r = request("localhost", 0);
    struct listen_sockets sockets, second;
    struct error err = {0};
    char text[100];

    (void)state;
    script = (struct script){0};
    assert_int_equal(listen_open(&sockets, &any, NULL), STATUS_OK);
    r.port = sockets.port;
    assert_int_equal(listen_open(&second, &r, &err), STATUS_ERR_UNREACHABLE);
    snprintf(text, sizeof text, "127.0.0.1:%u is in use: take another", sockets.port);
    assert_string_equal(err.text, text);
    close_all(&sockets);
    assert_int_equal(listen_open(&sockets, &any, NULL), STATUS_OK);
    r.port = sockets.port;
    close_all(&sockets);
    script = (struct script){AF_INET6, EADDRINUSE, 1, 0};
    assert_int_equal(listen_open(&second, &r, &err), STATUS_ERR_UNREACHABLE); /* a port that was asked for: no other */
    snprintf(text, sizeof text, "[::1]:%u is in use: take another", r.port);
    assert_string_equal(err.text, text);
    script = (struct script){0};
    assert_int_equal(listen_open(&sockets, &any, NULL), STATUS_OK); /* 127.0.0.1 was given back */
    close_all(&sockets);
}

/* A machine without IPv6, and a name of addresses that are all elsewhere. */
static void test_an_address_that_is_not_there(void **state)
{
    static const int codes[] = {EADDRNOTAVAIL, EAFNOSUPPORT};
    struct listen_request r = request("localhost", 0), six = request("::1", 0), elsewhere = request("192.0.2.77", 0);
    struct listen_sockets sockets;
    struct error err = {0};

    (void)state;
    for (int i = 0; i < 2; i++) {
        script = (struct script){AF_INET6, codes[i], 1000, 0};
        assert_int_equal(listen_open(&sockets, &r, NULL), STATUS_OK);
        assert_int_equal(sockets.count, 1);
        assert_int_equal(strncmp(sockets.names[0], "127.0.0.1:", 10), 0);
        close_all(&sockets);
        assert_int_equal(listen_open(&sockets, &six, &err), STATUS_ERR_IO);
        assert_non_null(strstr(err.text, "--listen ::1: cannot listen on [::1]:0: "));
    }
    script = (struct script){0};
    assert_int_equal(listen_open(&sockets, &elsewhere, &err), STATUS_ERR_IO);
    assert_non_null(strstr(err.text, "192.0.2.77"));
}

static void test_a_name_without_addresses(void **state)
{
    struct listen_request r = request("no such host", 0);
    struct listen_sockets sockets;
    struct error err = {0};

    (void)state;
    assert_int_equal(listen_open(&sockets, &r, &err), STATUS_ERR_IO);
    assert_non_null(strstr(err.text, "--listen no such host: "));
}

static void test_what_is_looked_up(void **state)
{
    (void)state;
    assert_true(listen_looks_up("farm.example.org"));
    assert_false(listen_looks_up("localhost"));
    assert_false(listen_looks_up(""));
    assert_false(listen_looks_up("::1"));
    assert_false(listen_looks_up("0.0.0.0"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_all_addresses_have_one_port), cmocka_unit_test(test_another_port_is_tried),
        cmocka_unit_test(test_a_busy_address_is_named),     cmocka_unit_test(test_an_address_that_is_not_there),
        cmocka_unit_test(test_a_name_without_addresses),    cmocka_unit_test(test_what_is_looked_up),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
