/* bench_merge: how many tile results a coordinator takes a second.
 *
 * Connects to a running coordinator as a client, which submits a job over an empty scene, and as N
 * workers that answer every lease at once with black tiles, over real TLS sockets. Prints the
 * results merged, made durable and acknowledged a second, from the first lease to the job's end.
 * The job's pictures are black; use a store of its own.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <uv.h>

#include "common/base/buffer.h"
#include "common/system/clock.h"
#include "common/base/digest.h"
#include "common/base/memory.h"
#include "common/cli/options.h"
#include "common/math/elementary.h"
#include "common/scene/scene.h"
#include "protocol/message.h"

enum { PEERS_MAX = 512, ROOM = 4096 };

struct bench;

struct peer {
    struct bench *bench;
    struct channel *channel;
    int is_worker, closed;
    uint64_t held;
};

struct bench {
    uv_loop_t loop;
    uv_timer_t heartbeat;
    struct farm_key key;
    const char *host;
    uint16_t port;
    struct render_settings settings;
    int64_t worker_count, frames;
    struct buffer scene;
    struct digest scene_digest;
    struct peer client, workers[PEERS_MAX];
    uint64_t job, acked, sent, begun_ns, ended_ns;
    int failed;
};

static void bench_fail(struct bench *b, const char *what, const char *text)
{
    fprintf(stderr, "bench_merge: %s: %s\n", what, text);
    b->failed = 1;
    uv_stop(&b->loop);
}

static void send_to(struct peer *peer, const Azulejo__Wire__Envelope *message)
{
    if (channel_send(peer->channel, message) != STATUS_OK)
        bench_fail(peer->bench, "send", message_name(message));
}

/* ---- workers -------------------------------------------------------------------------------- */

static void ask(struct peer *peer)
{
    Azulejo__Wire__LeaseRequest request = AZULEJO__WIRE__LEASE_REQUEST__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(LEASE_REQUEST, lease_request, &request);

    request.units = ROOM;
    send_to(peer, &e);
}

static void render_nothing(struct peer *peer, const Azulejo__Wire__LeaseGrant *grant)
{
    static uint8_t black[TILE_FLOATS_MAX * 4];
    struct bench *b = peer->bench;

    if (b->begun_ns == 0)
        b->begun_ns = clock_monotonic_ns();
    for (size_t i = 0; i < grant->n_units; i++) {
        Azulejo__Wire__TileResult result = AZULEJO__WIRE__TILE_RESULT__INIT;
        Azulejo__Wire__RenderStats stats = AZULEJO__WIRE__RENDER_STATS__INIT;
        Azulejo__Wire__Work work = AZULEJO__WIRE__WORK__INIT;
        Azulejo__Wire__Envelope e = MESSAGE(TILE_RESULT, tile_result, &result);
        uint32_t begin, end;

        pass_range(b->settings.spp, grant->units[i]->group, grant->units[i]->pass, &begin, &end);
        result.lease = grant->lease;
        result.epoch = grant->epoch;
        result.job = grant->job;
        result.frame = grant->frame;
        result.tile = grant->units[i]->tile;
        result.group = grant->units[i]->group;
        result.pass = grant->units[i]->pass;
        result.sums.data = black;
        result.sums.len = wire_sums_count(&b->settings, result.tile, result.group, result.pass) * 4;
        work.samples = result.sums.len / 24 * (end - begin);
        stats.cpu_ns = work.samples * 50; /* as a quick renderer would: sizes the leases */
        result.work = &work;
        result.stats = &stats;
        send_to(peer, &e);
        b->sent++;
    }
    ask(peer);
}

/* ---- the client ----------------------------------------------------------------------------- */

static void put_scene(struct peer *peer)
{
    struct bench *b = peer->bench;
    Azulejo__Wire__BlobPut put = AZULEJO__WIRE__BLOB_PUT__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(BLOB_PUT, blob_put, &put);

    wire_digest_set(&put.digest, &b->scene_digest);
    put.total_bytes = b->scene.size;
    put.raw_bytes = (uint32_t)b->scene.size;
    put.data.data = b->scene.data;
    put.data.len = b->scene.size;
    e.request = 1;
    send_to(peer, &e);
}

static void submit(struct peer *peer)
{
    struct bench *b = peer->bench;
    Azulejo__Wire__JobSubmit job = AZULEJO__WIRE__JOB_SUBMIT__INIT;
    Azulejo__Wire__RenderSettings settings = AZULEJO__WIRE__RENDER_SETTINGS__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(JOB_SUBMIT, job_submit, &job);
    char name[] = "bench_merge";

    wire_settings_set(&settings, &b->settings);
    wire_digest_set(&job.scene, &b->scene_digest);
    job.name = name;
    job.settings = &settings;
    job.first_frame = 1;
    job.last_frame = (uint32_t)b->frames;
    e.request = 2;
    send_to(peer, &e);
}

static void watch(struct peer *peer)
{
    Azulejo__Wire__JobWatch message = AZULEJO__WIRE__JOB_WATCH__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(JOB_WATCH, job_watch, &message);

    message.job = peer->bench->job;
    message.interval_ms = 1000;
    e.request = 3;
    send_to(peer, &e);
}

static void look_at(struct bench *b, const Azulejo__Wire__JobList *list)
{
    if (list->n_jobs != 1 || list->jobs[0]->state < AZULEJO__WIRE__JOB_STATE__JOB_DONE)
        return;
    if (list->jobs[0]->state != AZULEJO__WIRE__JOB_STATE__JOB_DONE) {
        bench_fail(b, "the job ended", list->jobs[0]->state_text);
        return;
    }
    b->ended_ns = clock_monotonic_ns();
    uv_stop(&b->loop);
}

/* ---- both ----------------------------------------------------------------------------------- */

static void on_open(struct channel *channel, void *user)
{
    struct peer *peer = user;
    Azulejo__Wire__Hello hello = AZULEJO__WIRE__HELLO__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(HELLO, hello, &hello);
    char software[] = "bench_merge", host[] = "localhost", kernel[] = "none";

    (void)channel;
    hello.protocol_version = PROTOCOL_VERSION;
    hello.role = peer->is_worker ? AZULEJO__WIRE__ROLE__ROLE_WORKER : AZULEJO__WIRE__ROLE__ROLE_CLIENT;
    hello.software = software;
    hello.host = host;
    hello.kernel = kernel;
    hello.threads = 16;
    hello.isa_mask = 7;
    hello.arithmetic = elementary_fingerprint();
    send_to(peer, &e);
}

static void on_message(struct channel *channel, const Azulejo__Wire__Envelope *m, void *user)
{
    struct peer *peer = user;
    struct bench *b = peer->bench;

    (void)channel;
    switch (m->body_case) {
    case AZULEJO__WIRE__ENVELOPE__BODY_WELCOME:
        if (peer->is_worker)
            ask(peer);
        else
            put_scene(peer);
        break;
    case AZULEJO__WIRE__ENVELOPE__BODY_LEASE_GRANT: render_nothing(peer, m->lease_grant); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_RESULT_ACK: b->acked += m->result_ack->n_units; break;
    case AZULEJO__WIRE__ENVELOPE__BODY_BLOB_STORED: submit(peer); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_JOB_ACCEPTED:
        b->job = m->job_accepted->job;
        watch(peer);
        break;
    case AZULEJO__WIRE__ENVELOPE__BODY_JOB_LIST: look_at(b, m->job_list); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_FAILURE: bench_fail(b, "the coordinator says", m->failure->text); break;
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
    struct peer *peer = user;

    (void)channel;
    peer->closed = 1;
    if (peer->bench->ended_ns == 0)
        bench_fail(peer->bench, "a connection ended", why->text);
}

static void on_heartbeat(uv_timer_t *timer)
{
    struct bench *b = timer->data;

    for (int64_t i = -1; i < b->worker_count; i++) {
        struct peer *peer = i < 0 ? &b->client : &b->workers[i];
        if (!peer->closed && channel_last_sent_ns(peer->channel) > 0 &&
            message_send_heartbeat(peer->channel) != STATUS_OK)
            continue; /* not open yet */
    }
}

static status connect_peer(struct bench *b, struct peer *peer, int is_worker, struct error *err)
{
    static const struct channel_callbacks callbacks = {on_open, on_message, on_drain, on_close};

    peer->bench = b;
    peer->is_worker = is_worker;
    return channel_connect(&peer->channel, &b->loop, b->host, b->port, &b->key,
                           is_worker ? FARM_ROLE_WORKER : FARM_ROLE_CLIENT, &callbacks, peer, err);
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

static status run(struct bench *b, struct error *err)
{
    status s = make_scene(b, err);

    if (s == STATUS_OK)
        s = connect_peer(b, &b->client, 0, err);
    for (int64_t i = 0; i < b->worker_count && s == STATUS_OK; i++)
        s = connect_peer(b, &b->workers[i], 1, err);
    if (s != STATUS_OK)
        return s;
    uv_timer_init(&b->loop, &b->heartbeat);
    b->heartbeat.data = b;
    uv_timer_start(&b->heartbeat, on_heartbeat, 1000, 1000);
    uv_run(&b->loop, UV_RUN_DEFAULT);
    if (b->failed)
        return error_set(err, STATUS_ERR_JOB_FAILED, "no figures");
    return STATUS_OK;
}

int main(int argc, char **argv)
{
    static struct bench b;
    const char *address = "127.0.0.1:7420", *key_path = NULL;
    int64_t width = 1920, height = 1080, spp = 64;
    int help = 0;
    const struct option table[] = {
        {"coordinator", 0, OPTION_STRING, &address, "HOST:PORT", "where it listens", 0, 0, NULL},
        {"key", 0, OPTION_STRING, &key_path, "FILE", "the farm's key", 0, 0, NULL},
        {"workers", 0, OPTION_INT, &b.worker_count, "N", "connections that render (8)", 1,
         PEERS_MAX, NULL},
        {"frames", 0, OPTION_INT, &b.frames, "N", "frames of the job (1)", 1, 1000, NULL},
        {"width", 0, OPTION_INT, &width, "N", "pixels (1920)", 1, 65536, NULL},
        {"height", 0, OPTION_INT, &height, "N", "pixels (1080)", 1, 65536, NULL},
        {"spp", 0, OPTION_INT, &spp, "N", "samples a pixel (64)", 1, 1 << 20, NULL},
        {0},
    };
    struct positionals rest;
    struct error err = {0};
    char host[256];
    const char *colon;
    double seconds;
    status s;

    b.worker_count = 8;
    b.frames = 1;
    s = options_parse(table, argc, argv, &rest, &help, &err);
    if (s == STATUS_OK && help) {
        options_print_help("bench_merge --key FILE [options]",
                           "Measure how many tile results a running coordinator takes a second.", table);
        return 0;
    }
    colon = strrchr(address, ':');
    if (s == STATUS_OK && (!key_path || !colon || colon - address >= (long)sizeof host))
        s = error_set(&err, STATUS_ERR_USAGE, "--key FILE and --coordinator HOST:PORT are needed");
    if (s == STATUS_OK)
        s = farm_key_load(&b.key, key_path, &err);
    if (s == STATUS_OK) {
        snprintf(host, sizeof host, "%.*s", (int)(colon - address), address);
        b.host = host;
        b.port = (uint16_t)strtoul(colon + 1, NULL, 10);
        render_settings_default(&b.settings);
        b.settings.width = (uint32_t)width;
        b.settings.height = (uint32_t)height;
        b.settings.spp = (uint32_t)spp;
        uv_loop_init(&b.loop);
        s = run(&b, &err);
    }
    if (s != STATUS_OK) {
        fprintf(stderr, "bench_merge: %s\n", err.text);
        return status_exit_code(s);
    }
    seconds = (double)(b.ended_ns - b.begun_ns) / 1e9;
    printf("workers %" PRId64 "  frames %" PRId64 " of %" PRId64 "x%" PRId64 ", %" PRId64 " spp\n",
           b.worker_count, b.frames, width, height, spp);
    printf("results %" PRIu64 "  acknowledged %" PRIu64 "  %.2f s  %.0f tiles/s  %.1f MB/s\n",
           b.sent, b.acked, seconds, (double)b.sent / seconds,
           (double)b.sent * TILE_FLOATS_MAX * 4 / 1e6 / seconds);
    return 0;
}
