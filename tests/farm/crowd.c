/* crowd: many peers in one process.
 *
 *   crowd workers HOST PORT KEYFILE COUNT
 *       COUNT workers that connect at once, say Hello and stay, with heartbeats, until the end of
 *       standard input. Prints "welcomed N failed N" once each got an answer, after a line
 *       "failure TEXT" for each kind of failure.
 *   crowd record HOST PORT KEYFILE
 *       Print "record HEX", the first TLS record of a worker: a stranger that recorded one can
 *       send it again.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <uv.h>

#include "common/math/elementary.h"
#include "protocol/message.h"
#include "protocol/tls.h"
#include "worker/render/render.h"

enum { HEARTBEAT_MS = 1000, LIMIT_MS = 300000 };

struct worker {
    struct channel *channel;
    int settled, welcomed, closed;
};

static struct crowd {
    uv_loop_t loop;
    uv_timer_t beat;
    uv_pipe_t input;
    struct worker *workers;
    uint32_t count, settled, welcomed, process;
    char last_failure[1024];
} crowd;

static void die(const char *what)
{
    fprintf(stderr, "crowd: %s\n", what);
    exit(2);
}

static void settle(struct worker *worker, int welcomed)
{
    if (worker->settled)
        return;
    worker->settled = 1;
    worker->welcomed = welcomed;
    crowd.welcomed += (uint32_t)welcomed;
    if (++crowd.settled == crowd.count)
        printf("welcomed %u failed %u\n", crowd.welcomed, crowd.count - crowd.welcomed);
}

static void fail(struct worker *worker, const char *text)
{
    const char *words = strstr(text, ": ");

    words = words ? words : text; /* without the port, which differs each time */
    if (!worker->settled && strcmp(words, crowd.last_failure) != 0) {
        snprintf(crowd.last_failure, sizeof crowd.last_failure, "%s", words);
        printf("failure %s\n", text);
    }
    settle(worker, 0);
}

static void on_open(struct channel *channel, void *user)
{
    Azulejo__Wire__Hello hello = AZULEJO__WIRE__HELLO__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(HELLO, hello, &hello);

    hello.protocol_version = PROTOCOL_VERSION;
    hello.role = AZULEJO__WIRE__ROLE__ROLE_WORKER;
    hello.software = (char *)"crowd";
    hello.host = (char *)"crowd";
    hello.process = crowd.process++;
    hello.threads = 1;
    hello.isa_mask = isa_supported_mask();
    hello.arithmetic = elementary_fingerprint();
    hello.kernel = (char *)render_ray_tracer_name();
    if (channel_send(channel, &e) != STATUS_OK)
        fail(user, "the Hello was not sent");
}

static void on_message(struct channel *channel, const Azulejo__Wire__Envelope *m, void *user)
{
    (void)channel;
    if (m->body_case == AZULEJO__WIRE__ENVELOPE__BODY_WELCOME)
        settle(user, 1);
    else if (m->body_case == AZULEJO__WIRE__ENVELOPE__BODY_FAILURE)
        fail(user, m->failure->text);
}

static void on_close(struct channel *channel, const struct error *why, void *user)
{
    struct worker *worker = user;

    (void)channel;
    worker->closed = 1;
    fail(worker, why->text);
}

static void on_beat(uv_timer_t *timer)
{
    (void)timer;
    for (uint32_t i = 0; i < crowd.count; i++)
        if (crowd.workers[i].welcomed && !crowd.workers[i].closed)
            (void)!message_send_heartbeat(crowd.workers[i].channel);
}

static void on_allocate(uv_handle_t *handle, size_t suggested, uv_buf_t *out)
{
    static char bytes[64];

    (void)handle;
    (void)suggested;
    *out = uv_buf_init(bytes, sizeof bytes);
}

/* The end of the input: everybody says goodbye. */
static void on_input(uv_stream_t *stream, ssize_t got, const uv_buf_t *buffer)
{
    (void)buffer;
    if (got >= 0)
        return;
    uv_close((uv_handle_t *)stream, NULL);
    uv_close((uv_handle_t *)&crowd.beat, NULL);
    for (uint32_t i = 0; i < crowd.count; i++)
        if (!crowd.workers[i].closed)
            channel_close(crowd.workers[i].channel);
}

static void run_workers(const char *host, uint16_t port, const struct farm_key *key)
{
    static const struct channel_callbacks callbacks = {on_open, on_message, NULL, on_close};
    struct error err = {0};

    uv_loop_init(&crowd.loop);
    uv_timer_init(&crowd.loop, &crowd.beat);
    uv_timer_start(&crowd.beat, on_beat, HEARTBEAT_MS, HEARTBEAT_MS);
    uv_pipe_init(&crowd.loop, &crowd.input, 0);
    if (uv_pipe_open(&crowd.input, STDIN_FILENO) != 0 ||
        uv_read_start((uv_stream_t *)&crowd.input, on_allocate, on_input) != 0)
        die("standard input is no pipe");
    channel_fault_handshake_ms(LIMIT_MS); /* this one process may need longer than 2,000 machines */
    for (uint32_t i = 0; i < crowd.count; i++)
        if (channel_connect(&crowd.workers[i].channel, &crowd.loop, host, port, key, FARM_ROLE_WORKER, &callbacks,
                            &crowd.workers[i], &err) != STATUS_OK)
            die(err.text);
    uv_run(&crowd.loop, UV_RUN_DEFAULT);
    uv_loop_close(&crowd.loop);
}

static void print_record(const struct farm_key *key)
{
    struct tls *tls;
    struct error err = {0};
    uint8_t bytes[CHANNEL_FIRST_MAX];
    size_t size;

    if (tls_new_client(&tls, key, FARM_ROLE_WORKER, &err) != STATUS_OK || tls_step(tls, &err) != STATUS_OK)
        die(err.text);
    size = tls_output_take(tls, bytes, sizeof bytes);
    printf("record ");
    for (size_t i = 0; i < size; i++)
        printf("%02x", bytes[i]);
    printf("\n");
    tls_free(tls);
}

int main(int argc, char **argv)
{
    struct farm_key key;
    struct error err = {0};

    if (argc < 5 || (strcmp(argv[1], "workers") == 0) != (argc == 6))
        die("usage: crowd workers HOST PORT KEYFILE COUNT, or crowd record HOST PORT KEYFILE");
    setvbuf(stdout, NULL, _IOLBF, 0);
    if (farm_key_load(&key, argv[4], &err) != STATUS_OK)
        die(err.text);
    if (argc == 5) {
        print_record(&key);
        return 0;
    }
    crowd.count = (uint32_t)atoi(argv[5]);
    crowd.workers = calloc(crowd.count, sizeof *crowd.workers);
    if (!crowd.workers || crowd.count == 0)
        die("no workers");
    run_workers(argv[2], (uint16_t)atoi(argv[3]), &key);
    free(crowd.workers);
    return 0;
}
