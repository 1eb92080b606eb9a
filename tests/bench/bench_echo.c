/* bench_echo: what libuv and TLS alone cost, as a measure for bench_scale.
 *
 *   bench_echo --serve --key FILE
 *       Listen on the loopback address, print "port N", and send every byte back, until killed.
 *   bench_echo --key FILE --port N --pid PID [--connections N] [--bytes N] [--window N] [--seconds S]
 *       Send messages of so many bytes, WINDOW of them on their way on each connection, and print
 *       how many came back a second, and the server's CPU time for each.
 *
 * The server does what the coordinator cannot avoid: it reads sockets, decrypts, encrypts, writes.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <uv.h>

#include "common/system/clock.h"
#include "common/base/memory.h"
#include "common/cli/options.h"
#include "protocol/tls.h"

enum { READ_BYTES = 64 << 10, CONNECTING_MAX = 64, WARM_MS = 1000 };

struct echo;

struct link {
    uv_tcp_t tcp;
    uv_connect_t connect;
    struct echo *echo;
    struct tls *tls;
    int open;
    size_t part; /* bytes of a message that came back in part */
};

struct echo {
    uv_loop_t loop;
    uv_tcp_t listener;
    uv_timer_t timer;
    struct farm_key key;
    struct link *links;
    int64_t serve, port, pid, connections, bytes, window, seconds;
    int64_t begun, open;
    uint8_t *message;
    uint64_t returned, counted, from_ns, cpu_from_ns, own_from_ns;
};

struct write_request {
    uv_write_t request;
    char bytes[];
};

static void die(const char *what, const char *why)
{
    fprintf(stderr, "bench_echo: %s: %s\n", what, why);
    exit(1);
}

static void check(status s, const struct error *err)
{
    if (s != STATUS_OK)
        die("TLS", err->text);
}

static void on_written(uv_write_t *request, int result)
{
    (void)result;
    mem_free(request);
}

static void flush(struct link *link)
{
    size_t size = tls_output_bytes(link->tls);
    struct write_request *w;
    uv_buf_t bytes;

    if (size == 0)
        return;
    w = mem_alloc(sizeof *w + size);
    if (!w)
        die("memory", "out of it");
    bytes = uv_buf_init(w->bytes, (unsigned)tls_output_take(link->tls, w->bytes, size));
    if (uv_write(&w->request, (uv_stream_t *)&link->tcp, &bytes, 1, on_written) < 0)
        mem_free(w);
}

static void send_message(struct link *link)
{
    struct error err = {0};

    check(tls_write(link->tls, link->echo->message, (size_t)link->echo->bytes, &err), &err);
}

static void on_closed(uv_handle_t *handle)
{
    struct link *link = handle->data;

    tls_free(link->tls);
    if (link->echo->serve)
        mem_free(link);
}

static void on_allocate(uv_handle_t *handle, size_t suggested, uv_buf_t *out)
{
    static char bytes[READ_BYTES];

    (void)handle;
    (void)suggested;
    *out = uv_buf_init(bytes, sizeof bytes);
}

static void connect_more(struct echo *e);

/* Bytes that arrived: back to their sender, or counted and replaced. */
static void take(struct link *link, const uint8_t *data, size_t size)
{
    struct echo *e = link->echo;
    struct error err = {0};

    if (e->serve) {
        check(tls_write(link->tls, data, size, &err), &err);
        return;
    }
    for (link->part += size; link->part >= (size_t)e->bytes; link->part -= (size_t)e->bytes) {
        e->returned++;
        send_message(link);
    }
}

static void on_read(uv_stream_t *stream, ssize_t got, const uv_buf_t *buffer)
{
    struct link *link = stream->data;
    struct echo *e = link->echo;
    struct error err = {0};
    uint8_t plain[16384];
    size_t size;

    if (got == 0)
        return;
    if (got < 0) {
        if (!e->serve)
            die("a connection ended", uv_strerror((int)got));
        uv_close((uv_handle_t *)stream, on_closed);
        return;
    }
    check(tls_feed(link->tls, buffer->base, (size_t)got, &err), &err);
    if (!link->open) {
        check(tls_step(link->tls, &err), &err);
        link->open = tls_state_of(link->tls) == TLS_OPEN;
        if (link->open && !e->serve) {
            e->open++;
            for (int64_t i = 0; i < e->window; i++)
                send_message(link);
            connect_more(e);
        }
    }
    while (link->open) {
        check(tls_read(link->tls, plain, sizeof plain, &size, &err), &err);
        if (size == 0)
            break;
        take(link, plain, size);
    }
    flush(link);
}

static void begin_reading(struct link *link)
{
    link->tcp.data = link;
    uv_tcp_nodelay(&link->tcp, 1);
    uv_read_start((uv_stream_t *)&link->tcp, on_allocate, on_read);
}

/* ---- the server ----------------------------------------------------------------------------- */

static void on_connection(uv_stream_t *listener, int code)
{
    struct echo *e = listener->data;
    struct link *link = mem_calloc(1, sizeof *link);
    struct error err = {0};

    if (code < 0 || !link)
        die("a connection", code < 0 ? uv_strerror(code) : "no memory");
    link->echo = e;
    uv_tcp_init(&e->loop, &link->tcp);
    check(tls_new_server(&link->tls, &e->key, &err), &err);
    if (uv_accept(listener, (uv_stream_t *)&link->tcp) != 0)
        die("a connection", "was not accepted");
    begin_reading(link);
}

static void serve(struct echo *e)
{
    struct sockaddr_storage bound;
    struct sockaddr_in address;
    int length = sizeof bound;

    uv_ip4_addr("127.0.0.1", 0, &address);
    uv_tcp_init(&e->loop, &e->listener);
    e->listener.data = e;
    if (uv_tcp_bind(&e->listener, (const struct sockaddr *)&address, 0) != 0 ||
        uv_listen((uv_stream_t *)&e->listener, 4096, on_connection) != 0 ||
        uv_tcp_getsockname(&e->listener, (struct sockaddr *)&bound, &length) != 0)
        die("listening", "failed");
    printf("port %d\n", ntohs(((const struct sockaddr_in *)&bound)->sin_port));
    fflush(stdout);
    uv_run(&e->loop, UV_RUN_DEFAULT);
}

/* ---- the client ----------------------------------------------------------------------------- */

static uint64_t cpu_ns_of(clockid_t clock)
{
    struct timespec t;

    if (clock_gettime(clock, &t) != 0)
        die("--pid", "no such process");
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

static uint64_t server_ns(const struct echo *e)
{
    clockid_t clock;

    if (clock_getcpuclockid((pid_t)e->pid, &clock) != 0)
        die("--pid", "no such process");
    return cpu_ns_of(clock);
}

static void on_end(uv_timer_t *timer)
{
    const struct echo *e = timer->data;
    double seconds = (double)(clock_monotonic_ns() - e->from_ns) / 1e9;
    double count = (double)(e->returned - e->counted);

    printf("{\"connections\": %" PRId64 ", \"bytes\": %" PRId64 ", \"messages_per_s\": %.0f, "
           "\"cpu_us_per_message\": %.2f, \"server_busy\": %.2f, \"client_busy\": %.2f}\n",
           e->connections, e->bytes, count / seconds, (double)(server_ns(e) - e->cpu_from_ns) / 1e3 / count,
           (double)(server_ns(e) - e->cpu_from_ns) / 1e9 / seconds,
           (double)(cpu_ns_of(CLOCK_PROCESS_CPUTIME_ID) - e->own_from_ns) / 1e9 / seconds);
    fflush(stdout);
    exit(0);
}

static void on_warm(uv_timer_t *timer)
{
    struct echo *e = timer->data;

    if (e->open < e->connections)
        return;
    e->from_ns = clock_monotonic_ns();
    e->counted = e->returned;
    e->cpu_from_ns = server_ns(e);
    e->own_from_ns = cpu_ns_of(CLOCK_PROCESS_CPUTIME_ID);
    uv_timer_start(timer, on_end, (uint64_t)e->seconds * 1000, 0);
}

static void on_connected(uv_connect_t *request, int code)
{
    struct link *link = request->data;
    struct error err = {0};

    if (code < 0)
        die("a connection", uv_strerror(code));
    begin_reading(link);
    check(tls_step(link->tls, &err), &err);
    flush(link);
}

static void connect_more(struct echo *e)
{
    struct sockaddr_in address;
    struct error err = {0};

    uv_ip4_addr("127.0.0.1", (int)e->port, &address);
    while (e->begun < e->connections && e->begun - e->open < CONNECTING_MAX) {
        struct link *link = &e->links[e->begun++];
        link->echo = e;
        link->connect.data = link;
        uv_tcp_init(&e->loop, &link->tcp);
        check(tls_new_client(&link->tls, &e->key, FARM_ROLE_WORKER, &err), &err);
        if (uv_tcp_connect(&link->connect, &link->tcp, (const struct sockaddr *)&address, on_connected) != 0)
            die("a connection", "cannot begin");
    }
}

static void run_client(struct echo *e)
{
    e->links = mem_calloc((size_t)e->connections, sizeof *e->links);
    e->message = mem_calloc((size_t)e->bytes, 1);
    if (!e->links || !e->message)
        die("memory", "out of it");
    uv_timer_init(&e->loop, &e->timer);
    e->timer.data = e;
    uv_timer_start(&e->timer, on_warm, WARM_MS, WARM_MS);
    connect_more(e);
    uv_run(&e->loop, UV_RUN_DEFAULT);
}

int main(int argc, char **argv)
{
    static struct echo e = {.connections = 8, .bytes = 6300, .window = 64, .seconds = 4};
    const char *key_path = NULL;
    int help = 0, serves = 0;
    const struct option table[] = {
        {"serve", 0, OPTION_FLAG, &serves, NULL, "be the server", 0, 0, NULL},
        {"key", 0, OPTION_STRING, &key_path, "FILE", "the farm's key", 0, 0, NULL},
        {"port", 0, OPTION_INT, &e.port, "N", "of the server", 1, 65535, NULL},
        {"pid", 0, OPTION_INT, &e.pid, "PID", "the server's process", 1, 1 << 30, NULL},
        {"connections", 0, OPTION_INT, &e.connections, "N", "(8)", 1, 20000, NULL},
        {"bytes", 0, OPTION_INT, &e.bytes, "N", "of a message (6300)", 1, 1 << 20, NULL},
        {"window", 0, OPTION_INT, &e.window, "N", "messages on their way on a connection (64)", 1,
         4096, NULL},
        {"seconds", 0, OPTION_INT, &e.seconds, "S", "how long to count (4)", 1, 600, NULL},
        {0},
    };
    struct positionals rest;
    struct error err = {0};

    if (options_parse(table, argc, argv, &rest, &help, &err) != STATUS_OK)
        die("usage", err.text);
    if (help) {
        options_print_help("bench_echo --key FILE [options]", "What libuv and TLS alone cost.", table);
        return 0;
    }
    if (!key_path || (!serves && (!e.port || !e.pid)))
        die("usage", "--key FILE, and --serve or --port N --pid PID");
    check(farm_key_load(&e.key, key_path, &err), &err);
    e.serve = serves;
    uv_loop_init(&e.loop);
    if (serves)
        serve(&e);
    else
        run_client(&e);
    return 0;
}
