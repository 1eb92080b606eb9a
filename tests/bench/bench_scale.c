/* bench_scale: what a result costs the coordinator, with many workers and a long queue.
 *
 *   bench_scale fill --key FILE --coordinator HOST:PORT --jobs N [--ahead]
 *       Submit N small jobs behind every other (--ahead: before every other, pinned to an instruction set
 *       that no simulated worker offers).
 *   bench_scale run --key FILE --coordinator HOST:PORT --pid PID [--workers N] [--latency-ms L] [--rate R]
 *       Connect N workers over TLS, submit a job with more work than the measurement needs, answer
 *       every lease with noisy tiles of 64 samples a pixel (each grant is answered L ms later; with --rate R together only
 *       R results a second), and print what was acknowledged a second and the coordinator's CPU time
 *       for each. The job is cancelled at the end.
 *
 * bench_scale.py runs it over the table of docs/SCALE.md.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <uv.h>

#include "common/base/buffer.h"
#include "common/system/clock.h"
#include "common/base/digest.h"
#include "common/base/memory.h"
#include "common/cli/options.h"
#include "common/math/elementary.h"
#include "common/scene/scene.h"
#include "protocol/message.h"

enum {
    WORKERS = 20000,
    THREADS = 4,          /* of a worker */
    ROOM_ALL = 16384, ROOM_MIN = 2, ROOM_MAX = 256, /* units that workers ask for, together and each */
    CONNECTING_MAX = 64,
    SUBMITS_MAX = 64,     /* on their way */
    WARM_MS = 2000,       /* from the job's begin to that of the count, at least; */
    WARM_RESULTS = 40000, /* and until the frame has its first passes, */
    WARM_TURNS = 10,      /* at most so many times WARM_MS */
    BEAT_MS = 500,
    BEAT_TURNS = 8,       /* each worker's heartbeat comes every 4 s */
    SCENE_REQUEST = 1, SUBMIT_REQUEST, CANCEL_REQUEST,
};

struct bench;

struct peer {
    struct bench *bench;
    struct channel *channel;
    int is_worker, open;
};

/* A unit that waits for its time. */
struct waiting {
    uint64_t due_ns, lease, epoch, job;
    struct peer *peer;
    uint32_t frame, tile, group, pass;
};

struct bench {
    uv_loop_t loop;
    uv_timer_t beat, step, send;
    struct farm_key key;
    char host[256];
    uint16_t port;
    int64_t worker_count, jobs, latency_ms, rate, pid, seconds;
    int fills, ahead;
    struct render_settings settings;
    struct buffer scene;
    struct digest scene_digest;
    struct peer client, *workers;
    int64_t begun, welcomed; /* workers */
    int64_t submitted, accepted;
    uint64_t job;
    struct waiting *line; /* a ring, ordered by due_ns */
    size_t line_first, line_count, line_capacity;
    double allowance; /* results that --rate allows now */
    uint64_t paid_ns;
    unsigned turn;
    uint64_t acked, counted, from_ns, cpu_from_ns, own_from_ns;
    int measured, warmed;
};

static void die(const char *what, const char *why)
{
    fprintf(stderr, "bench_scale: %s: %s\n", what, why);
    exit(1);
}

static void send_to(struct peer *peer, const Azulejo__Wire__Envelope *message)
{
    if (channel_send(peer->channel, message) != STATUS_OK)
        die("send", message_name(message));
}

/* ---- workers -------------------------------------------------------------------------------- */

static void ask(struct peer *peer)
{
    Azulejo__Wire__LeaseRequest request = AZULEJO__WIRE__LEASE_REQUEST__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(LEASE_REQUEST, lease_request, &request);
    int64_t room = ROOM_ALL / peer->bench->worker_count;

    request.units = (uint32_t)(room < ROOM_MIN ? ROOM_MIN : room > ROOM_MAX ? ROOM_MAX : room);
    send_to(peer, &e);
}

/* Sums of so many samples as a room has them: from .01 to 1, off by half of it, and one value in 64 bright. Another
 * tile for every unit: what costs depends on the values, so black tiles say too little. */
static void noise_set(uint8_t *sums, size_t count, uint32_t samples, uint32_t seed)
{
    for (size_t i = 0; i < count; i++) {
        float light = (float)(1 + i % 97) * 0.01f, value;
        seed = seed * 1664525u + 1013904223u;
        value = (float)samples * light * (0.5f + (float)(seed >> 8) * 0x1p-24f);
        if (seed >> 26 == 0)
            value *= 20;
        memcpy(sums + i * sizeof value, &value, sizeof value);
    }
}

static void send_result(struct bench *b, const struct waiting *w)
{
    static uint8_t sums[TILE_FLOATS_MAX * 4];
    Azulejo__Wire__TileResult result = AZULEJO__WIRE__TILE_RESULT__INIT;
    Azulejo__Wire__RenderStats stats = AZULEJO__WIRE__RENDER_STATS__INIT;
    Azulejo__Wire__Work work = AZULEJO__WIRE__WORK__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(TILE_RESULT, tile_result, &result);
    uint32_t begin, end;

    if (w->job != b->job || b->measured) /* a waiting job's unit: it shall go on waiting */
        return;
    pass_range(b->settings.spp, w->group, w->pass, &begin, &end);
    result.lease = w->lease;
    result.epoch = w->epoch;
    result.job = w->job;
    result.frame = w->frame;
    result.tile = w->tile;
    result.group = w->group;
    result.pass = w->pass;
    result.sums.data = sums;
    result.sums.len = wire_sums_count(&b->settings, w->tile, w->group, w->pass) * 4;
    noise_set(sums, result.sums.len / 4, end - begin, (w->tile * GROUPS + w->group) * PASSES_MAX + w->pass);
    work.samples = result.sums.len / 12 * (end - begin);
    stats.cpu_ns = work.samples * 50; /* as a quick renderer would: sizes the leases */
    if (b->rate > 0)
        stats.cpu_ns = (uint64_t)(THREADS * 1e9 * (double)b->worker_count / (double)b->rate);
    result.work = &work;
    result.stats = &stats;
    send_to(w->peer, &e);
}

static void line_add(struct bench *b, const struct waiting *w)
{
    if (b->line_count == b->line_capacity) {
        size_t capacity = b->line_capacity ? 2 * b->line_capacity : 1024;
        struct waiting *grown = mem_alloc_array(capacity, sizeof *grown);
        if (!grown)
            die("memory", "out of it");
        for (size_t i = 0; i < b->line_count; i++)
            grown[i] = b->line[(b->line_first + i) % b->line_capacity];
        mem_free(b->line);
        b->line = grown;
        b->line_capacity = capacity;
        b->line_first = 0;
    }
    b->line[(b->line_first + b->line_count++) % b->line_capacity] = *w;
}

static void on_send(uv_timer_t *timer)
{
    struct bench *b = timer->data;
    uint64_t now_ns = clock_monotonic_ns();

    b->allowance += (double)b->rate * (double)(now_ns - b->paid_ns) / 1e9;
    b->paid_ns = now_ns;
    while (b->line_count > 0 && b->line[b->line_first].due_ns <= now_ns &&
           (b->rate == 0 || b->allowance >= 1)) {
        struct waiting w = b->line[b->line_first];
        b->line_first = (b->line_first + 1) % b->line_capacity;
        b->line_count--;
        b->allowance -= 1;
        send_result(b, &w);
    }
    if (b->rate == 0 || b->line_count == 0)
        b->allowance = 0;
}

static void take_grant(struct peer *peer, const Azulejo__Wire__LeaseGrant *grant)
{
    struct bench *b = peer->bench;
    uint64_t due_ns = clock_monotonic_ns() + (uint64_t)b->latency_ms * NS_PER_MS;

    channel_cork(peer->channel); /* as a worker does, which sends every 20 ms */
    for (size_t i = 0; i < grant->n_units; i++) {
        const Azulejo__Wire__WorkUnit *unit = grant->units[i];
        struct waiting w = {due_ns, grant->lease, grant->epoch, grant->job, peer,
                            grant->frame, unit->tile, unit->group, unit->pass};
        if (b->latency_ms > 0 || b->rate > 0)
            line_add(b, &w);
        else
            send_result(b, &w);
    }
    ask(peer);
    channel_uncork(peer->channel);
}

/* ---- the client ----------------------------------------------------------------------------- */

static void put_scene(struct bench *b)
{
    Azulejo__Wire__BlobPut put = AZULEJO__WIRE__BLOB_PUT__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(BLOB_PUT, blob_put, &put);

    wire_digest_set(&put.digest, &b->scene_digest);
    put.total_bytes = b->scene.size;
    put.raw_bytes = (uint32_t)b->scene.size;
    put.data.data = b->scene.data;
    put.data.len = b->scene.size;
    e.request = SCENE_REQUEST;
    send_to(&b->client, &e);
}

static void submit(struct bench *b)
{
    Azulejo__Wire__JobSubmit job = AZULEJO__WIRE__JOB_SUBMIT__INIT;
    Azulejo__Wire__RenderSettings settings = AZULEJO__WIRE__RENDER_SETTINGS__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(JOB_SUBMIT, job_submit, &job);
    char name[] = "bench_scale";

    wire_settings_set(&settings, &b->settings);
    wire_digest_set(&job.scene, &b->scene_digest);
    job.name = name;
    job.settings = &settings;
    job.first_frame = job.last_frame = 1;
    job.priority = b->fills ? b->ahead : 0;
    if (b->fills && !b->ahead)
        job.priority = -1;
    e.request = SUBMIT_REQUEST;
    b->submitted++;
    send_to(&b->client, &e);
}

static void cancel(struct bench *b)
{
    Azulejo__Wire__JobCancel message = AZULEJO__WIRE__JOB_CANCEL__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(JOB_CANCEL, job_cancel, &message);

    message.job = b->job;
    message.discard = 1;
    e.request = CANCEL_REQUEST;
    send_to(&b->client, &e);
}

static uint64_t cpu_ns_of(clockid_t clock)
{
    struct timespec t;

    if (clock_gettime(clock, &t) != 0)
        die("--pid", "no such process");
    return (uint64_t)t.tv_sec * NS_PER_SECOND + (uint64_t)t.tv_nsec;
}

static uint64_t server_ns(const struct bench *b)
{
    clockid_t clock;

    if (clock_getcpuclockid((pid_t)b->pid, &clock) != 0)
        die("--pid", "no such process");
    return cpu_ns_of(clock);
}

static void on_measured(uv_timer_t *timer)
{
    struct bench *b = timer->data;
    double seconds = (double)(clock_monotonic_ns() - b->from_ns) / 1e9;
    double count = (double)(b->acked - b->counted);
    double cpu_ns = (double)(server_ns(b) - b->cpu_from_ns);
    double own_ns = (double)(cpu_ns_of(CLOCK_PROCESS_CPUTIME_ID) - b->own_from_ns);

    printf("{\"workers\": %" PRId64 ", \"latency_ms\": %" PRId64 ", \"rate\": %" PRId64
           ", \"results_per_s\": %.0f, \"cpu_us_per_result\": %.1f, \"coordinator_busy\": %.2f, "
           "\"client_busy\": %.2f}\n",
           b->worker_count, b->latency_ms, b->rate, count / seconds, count > 0 ? cpu_ns / 1e3 / count : 0,
           cpu_ns / 1e9 / seconds, own_ns / 1e9 / seconds);
    fflush(stdout);
    b->measured = 1;
    cancel(b);
}

static void on_warm(uv_timer_t *timer)
{
    struct bench *b = timer->data;

    if (b->rate == 0 && b->acked < WARM_RESULTS && ++b->warmed < WARM_TURNS)
        return;
    b->from_ns = clock_monotonic_ns();
    b->counted = b->acked;
    b->cpu_from_ns = server_ns(b);
    b->own_from_ns = cpu_ns_of(CLOCK_PROCESS_CPUTIME_ID);
    uv_timer_start(timer, on_measured, (uint64_t)b->seconds * 1000, 0);
}

static void job_accepted(struct bench *b, uint64_t job)
{
    b->accepted++;
    if (b->fills) {
        if (b->accepted == b->jobs)
            exit(0);
        if (b->submitted < b->jobs)
            submit(b);
        return;
    }
    b->job = job;
    for (int64_t i = 0; i < b->worker_count; i++)
        ask(&b->workers[i]);
    uv_timer_start(&b->step, on_warm, WARM_MS, WARM_MS);
}

static void connect_workers(struct bench *b);

static void scene_stored(struct bench *b)
{
    if (!b->fills)
        connect_workers(b);
    for (int64_t i = 0; b->fills && i < b->jobs && i < SUBMITS_MAX; i++)
        submit(b);
}

/* ---- both ----------------------------------------------------------------------------------- */

static void on_open(struct channel *channel, void *user)
{
    struct peer *peer = user;
    Azulejo__Wire__Hello hello = AZULEJO__WIRE__HELLO__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(HELLO, hello, &hello);
    char software[] = "bench_scale", host[] = "localhost", kernel[] = "none";

    (void)channel;
    hello.protocol_version = PROTOCOL_VERSION;
    hello.role = peer->is_worker ? AZULEJO__WIRE__ROLE__ROLE_WORKER : AZULEJO__WIRE__ROLE__ROLE_CLIENT;
    hello.software = software;
    hello.host = host;
    hello.kernel = kernel;
    hello.threads = THREADS;
    hello.isa_mask = 1u << ISA_SSE2 | 1u << ISA_AVX2;
    hello.arithmetic = elementary_fingerprint();
    send_to(peer, &e);
}

static void welcome(struct peer *peer)
{
    struct bench *b = peer->bench;

    peer->open = 1;
    if (!peer->is_worker) {
        put_scene(b);
        return;
    }
    b->welcomed++;
    connect_workers(b);
    if (b->welcomed == b->worker_count)
        submit(b); /* not earlier: its work would be done by a part of them */
}

static void on_message(struct channel *channel, const Azulejo__Wire__Envelope *m, void *user)
{
    struct peer *peer = user;
    struct bench *b = peer->bench;

    (void)channel;
    switch (m->body_case) {
    case AZULEJO__WIRE__ENVELOPE__BODY_WELCOME: welcome(peer); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_LEASE_GRANT: take_grant(peer, m->lease_grant); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_RESULT_ACK: b->acked += m->result_ack->n_units; break;
    case AZULEJO__WIRE__ENVELOPE__BODY_BLOB_STORED: scene_stored(b); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_JOB_ACCEPTED: job_accepted(b, m->job_accepted->job); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_JOB_LIST: exit(0); /* it is cancelled */
    case AZULEJO__WIRE__ENVELOPE__BODY_FAILURE: die("the coordinator says", m->failure->text); break;
    default: break;
    }
}

static void on_drain(struct channel *channel, void *user)
{
    (void)channel;
    (void)user;
}

static void on_close(struct channel *channel, const struct error *why, void *user)
{
    (void)channel;
    (void)user;
    die("a connection ended", why->text);
}

static void connect_peer(struct bench *b, struct peer *peer, int is_worker)
{
    static const struct channel_callbacks callbacks = {on_open, on_message, on_drain, on_close};
    struct error err = {0};

    peer->bench = b;
    peer->is_worker = is_worker;
    if (channel_connect(&peer->channel, &b->loop, b->host, b->port, &b->key,
                        is_worker ? FARM_ROLE_WORKER : FARM_ROLE_CLIENT, &callbacks, peer, &err) != STATUS_OK)
        die("connect", err.text);
}

static void connect_workers(struct bench *b)
{
    while (b->begun < b->worker_count && b->begun - b->welcomed < CONNECTING_MAX)
        connect_peer(b, &b->workers[b->begun++], 1);
}

static void on_beat(uv_timer_t *timer)
{
    struct bench *b = timer->data;

    b->turn++;
    for (int64_t i = -1; i < b->begun; i++) {
        struct peer *peer = i < 0 ? &b->client : &b->workers[i];
        if (peer->open && (uint64_t)(i + 1) % BEAT_TURNS == b->turn % BEAT_TURNS)
            (void)!message_send_heartbeat(peer->channel);
    }
}

/* A camera under a constant sky. */
static status make_scene(struct bench *b, struct error *err)
{
    static struct scene_camera camera = {.name = "camera", .yfov_rad = 1, .node = -1};
    struct scene scene;
    status s;

    scene_init(&scene);
    scene.name = "empty";
    camera.to_world = transform_d_identity();
    scene.cameras = &camera;
    scene.camera_count = 1;
    scene.environment.present = 1;
    scene.environment.constant = 1;
    s = scene_pack(&scene, &b->scene, err);
    scene.cameras = NULL;
    scene.camera_count = 0;
    scene_release(&scene);
    if (s == STATUS_OK)
        s = digest_of(&b->scene_digest, b->scene.data, b->scene.size);
    return s;
}

static void settings_choose(struct bench *b)
{
    render_settings_default(&b->settings);
    b->settings.width = b->fills ? 64 : 2560;
    b->settings.height = b->fills ? 64 : 1440;
    b->settings.spp = b->fills ? 4 : 64;
    if (b->ahead)
        b->settings.isa = ISA_AVX512;
}

static void run(struct bench *b)
{
    struct error err = {0};

    settings_choose(b);
    b->workers = mem_calloc((size_t)b->worker_count, sizeof *b->workers);
    if (!b->workers || make_scene(b, &err) != STATUS_OK)
        die("the scene", err.text);
    uv_loop_init(&b->loop);
    uv_timer_init(&b->loop, &b->beat);
    uv_timer_init(&b->loop, &b->step);
    uv_timer_init(&b->loop, &b->send);
    b->beat.data = b->step.data = b->send.data = b;
    connect_peer(b, &b->client, 0);
    uv_timer_start(&b->beat, on_beat, BEAT_MS, BEAT_MS);
    b->paid_ns = clock_monotonic_ns();
    if (b->latency_ms > 0 || b->rate > 0)
        uv_timer_start(&b->send, on_send, 1, 1);
    uv_run(&b->loop, UV_RUN_DEFAULT);
}

int main(int argc, char **argv)
{
    static struct bench b = {.worker_count = 8, .jobs = 1, .seconds = 4};
    const char *address = "127.0.0.1:7420", *key_path = NULL, *colon;
    int help = 0;
    const struct option table[] = {
        {"coordinator", 0, OPTION_STRING, &address, "HOST:PORT", "where it listens", 0, 0, NULL},
        {"key", 0, OPTION_STRING, &key_path, "FILE", "the farm's key", 0, 0, NULL},
        {"pid", 0, OPTION_INT, &b.pid, "PID", "the coordinator's process", 1, 1 << 30, NULL},
        {"workers", 0, OPTION_INT, &b.worker_count, "N", "connections that render (8)", 1, WORKERS, NULL},
        {"jobs", 0, OPTION_INT, &b.jobs, "N", "fill: so many jobs (1)", 1, 10000, NULL},
        {"ahead", 0, OPTION_FLAG, &b.ahead, NULL, "fill: before all others, for other machines", 0, 0, NULL},
        {"latency-ms", 0, OPTION_INT, &b.latency_ms, "L", "from a grant to its results (0)", 0, 10000, NULL},
        {"rate", 0, OPTION_INT, &b.rate, "R", "results a second (0: as many as possible)", 0, 1000000, NULL},
        {"seconds", 0, OPTION_INT, &b.seconds, "S", "how long to count (4)", 1, 600, NULL},
        {0},
    };
    struct positionals rest;
    struct error err = {0};

    if (options_parse(table, argc, argv, &rest, &help, &err) != STATUS_OK)
        die("usage", err.text);
    if (help) {
        options_print_help("bench_scale fill | run --key FILE [options]", "What a result costs a running coordinator.",
                           table);
        return 0;
    }
    b.fills = rest.count == 1 && strcmp(rest.items[0], "fill") == 0;
    colon = strrchr(address, ':');
    if (rest.count != 1 || (!b.fills && strcmp(rest.items[0], "run") != 0) || !key_path || !colon ||
        colon - address >= (long)sizeof b.host || (!b.fills && !b.pid))
        die("usage", "fill or run, --key FILE, --coordinator HOST:PORT; run also --pid PID");
    if (farm_key_load(&b.key, key_path, &err) != STATUS_OK)
        die("--key", err.text);
    snprintf(b.host, sizeof b.host, "%.*s", (int)(colon - address), address);
    b.port = (uint16_t)strtoul(colon + 1, NULL, 10);
    run(&b);
    return 0;
}
