/* The coordinator as a process, spoken to over real sockets: greetings, roles, hostile peers,
 * blobs, jobs, outputs, restarts. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>
#include <uv.h>

#include "common/base/digest.h"
#include "common/system/file.h"
#include "common/math/elementary.h"
#include "common/scene/scene.h"
#include "protocol/message.h"
#include "tests/support/scratch_folder.h"

enum { ANSWER_LIMIT_MS = 60000, INBOX_MAX = 512 };

struct farm_process {
    char folder[SCRATCH_PATH], key_path[96], store[96], ready[96];
    struct farm_key key;
    uint16_t port;
    pid_t process;
};

static struct farm_process farm;

/* ---- the process ---------------------------------------------------------------------------- */

static void binary_path(char *out, size_t size)
{
    char self[512];
    ssize_t length = readlink("/proc/self/exe", self, sizeof self - 1);
    char *end;

    assert_true(length > 0);
    self[length] = 0;
    end = strstr(self, "/tests/unit/");
    assert_non_null(end);
    snprintf(out, size, "%.*s/bin/azulejo-coordinator", (int)(end - self), self);
}

static void start_coordinator(void)
{
    struct buffer text = BUFFER_INIT;
    struct error err = {0};
    char binary[600];

    unlink(farm.ready);
    binary_path(binary, sizeof binary);
    farm.process = fork();
    assert_true(farm.process >= 0);
    if (farm.process == 0) {
        int null = open("/dev/null", O_WRONLY);
        dup2(null, STDOUT_FILENO);
        execl(binary, binary, "--listen", "127.0.0.1:0", "--key", farm.key_path, "--store", farm.store, "--ready-file",
              farm.ready, "--lease-seconds", "2", "--log-level", "error", (char *)NULL);
        _exit(127);
    }
    for (int i = 0; i < 3000 && !file_exists(farm.ready); i++) {
        assert_int_equal(waitpid(farm.process, NULL, WNOHANG), 0);
        usleep(10000);
    }
    assert_int_equal(file_read(farm.ready, 64, &text, &err), STATUS_OK);
    farm.port = (uint16_t)atoi(buffer_text(&text));
    buffer_release(&text);
}

static int stop_coordinator(int number)
{
    int how = 0;

    kill(farm.process, number);
    assert_int_equal(waitpid(farm.process, &how, 0), farm.process);
    farm.process = 0;
    return how;
}

static int set_up(void **state)
{
    struct buffer text = BUFFER_INIT;

    (void)state;
    scratch_folder(farm.folder);
    if (farm_key_generate(&farm.key, NULL) != STATUS_OK)
        return -1;
    snprintf(farm.key_path, sizeof farm.key_path, "%s/farm.key", farm.folder);
    snprintf(farm.store, sizeof farm.store, "%s/store", farm.folder);
    snprintf(farm.ready, sizeof farm.ready, "%s/ready", farm.folder);
    farm_key_print(&farm.key, &text);
    if (file_write_atomic(farm.key_path, text.data, text.size, NULL) != STATUS_OK || chmod(farm.key_path, 0600) != 0)
        return -1;
    buffer_release(&text);
    start_coordinator();
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    if (farm.process)
        stop_coordinator(SIGKILL);
    file_remove_tree(farm.folder);
    return 0;
}

/* ---- a peer --------------------------------------------------------------------------------- */

struct peer {
    uv_loop_t loop;
    uv_timer_t limit;
    struct channel *channel;
    int open, closed;
    struct error why;
    Azulejo__Wire__Envelope *inbox[INBOX_MAX]; /* not looked at yet, oldest first */
    size_t inbox_count;
};

static void on_open(struct channel *channel, void *user)
{
    (void)channel;
    ((struct peer *)user)->open = 1;
}

static void on_message(struct channel *channel, const Azulejo__Wire__Envelope *message, void *user)
{
    struct peer *peer = user;
    size_t size = azulejo__wire__envelope__get_packed_size(message);
    uint8_t *bytes = malloc(size + 1);

    (void)channel;
    assert_non_null(bytes);
    assert_true(peer->inbox_count < INBOX_MAX);
    azulejo__wire__envelope__pack(message, bytes);
    assert_int_equal(message_unpack(&peer->inbox[peer->inbox_count++], bytes, size, NULL), STATUS_OK);
    free(bytes);
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
    peer->why = *why;
}

static void on_limit(uv_timer_t *timer)
{
    (void)timer;
    fail_msg("no answer within %d ms", ANSWER_LIMIT_MS);
}

static void peer_connect(struct peer *peer, enum farm_role role)
{
    static const struct channel_callbacks callbacks = {on_open, on_message, on_drain, on_close};
    struct error err = {0};

    memset(peer, 0, sizeof *peer);
    uv_loop_init(&peer->loop);
    uv_timer_init(&peer->loop, &peer->limit);
    assert_int_equal(channel_connect(&peer->channel, &peer->loop, "127.0.0.1", farm.port, &farm.key, role, &callbacks,
                                     peer, &err),
                     STATUS_OK);
    uv_timer_start(&peer->limit, on_limit, ANSWER_LIMIT_MS, 0);
    while (!peer->open && !peer->closed)
        uv_run(&peer->loop, UV_RUN_ONCE);
    uv_timer_stop(&peer->limit);
    assert_true(peer->open);
}

static void peer_end(struct peer *peer)
{
    if (!peer->closed)
        channel_close(peer->channel);
    uv_close((uv_handle_t *)&peer->limit, NULL);
    while (uv_run(&peer->loop, UV_RUN_DEFAULT))
        ;
    uv_loop_close(&peer->loop);
    for (size_t i = 0; i < peer->inbox_count; i++)
        message_free(peer->inbox[i]);
}

static void peer_send(struct peer *peer, const Azulejo__Wire__Envelope *message)
{
    assert_int_equal(channel_send(peer->channel, message), STATUS_OK);
}

/* The next message of a kind that a test waits for (heartbeats and notices are passed over);
 * NULL when the connection ended first. The caller frees it. */
static Azulejo__Wire__Envelope *peer_receive(struct peer *peer)
{
    uv_timer_start(&peer->limit, on_limit, ANSWER_LIMIT_MS, 0);
    for (;;) {
        while (peer->inbox_count > 0) {
            Azulejo__Wire__Envelope *message = peer->inbox[0];
            memmove(peer->inbox, peer->inbox + 1, --peer->inbox_count * sizeof peer->inbox[0]);
            if (message->body_case != AZULEJO__WIRE__ENVELOPE__BODY_HEARTBEAT &&
                message->body_case != AZULEJO__WIRE__ENVELOPE__BODY_NOTICE) {
                uv_timer_stop(&peer->limit);
                return message;
            }
            message_free(message);
        }
        if (peer->closed) {
            uv_timer_stop(&peer->limit);
            return NULL;
        }
        uv_run(&peer->loop, UV_RUN_ONCE);
    }
}

static Azulejo__Wire__Envelope *expect(struct peer *peer, Azulejo__Wire__Envelope__BodyCase body_case)
{
    Azulejo__Wire__Envelope *message = peer_receive(peer);

    if (!message)
        fail_msg("the connection ended: %s", peer->why.text);
    if (message->body_case != body_case)
        fail_msg("%s came: %s", message_name(message),
                 message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_FAILURE ? message->failure->text : "");
    return message;
}

/* A Failure that answers `request`, with a word of its text. */
static void expect_failure(struct peer *peer, uint64_t request, status code, const char *word)
{
    Azulejo__Wire__Envelope *m = expect(peer, AZULEJO__WIRE__ENVELOPE__BODY_FAILURE);

    assert_int_equal(m->request, request);
    assert_int_equal(m->failure->code, code);
    if (!strstr(m->failure->text, word))
        fail_msg("'%s' does not speak of '%s'", m->failure->text, word);
    message_free(m);
}

static void expect_end(struct peer *peer)
{
    Azulejo__Wire__Envelope *m = peer_receive(peer);

    assert_null(m);
    assert_true(peer->closed);
}

static char worker_host[32] = "here";

static Azulejo__Wire__Hello make_hello(enum farm_role role)
{
    static char software[] = "test", kernel[] = "tracer 1";
    Azulejo__Wire__Hello hello = AZULEJO__WIRE__HELLO__INIT;

    hello.protocol_version = PROTOCOL_VERSION;
    hello.role = (Azulejo__Wire__Role)role;
    hello.software = software;
    hello.host = worker_host;
    hello.kernel = kernel;
    hello.threads = 4;
    hello.isa_mask = 7;
    hello.arithmetic = elementary_fingerprint();
    return hello;
}

static void greet(struct peer *peer, Azulejo__Wire__Hello *hello)
{
    Azulejo__Wire__Envelope e = MESSAGE(HELLO, hello, hello);

    peer_send(peer, &e);
}

static void join(struct peer *peer, enum farm_role role)
{
    Azulejo__Wire__Hello hello = make_hello(role);

    peer_connect(peer, role);
    greet(peer, &hello);
    message_free(expect(peer, AZULEJO__WIRE__ENVELOPE__BODY_WELCOME));
}

/* ---- a scene and a job ---------------------------------------------------------------------- */

static void make_scene(struct buffer *out, struct digest *digest, int with_missing_image)
{
    struct scene_camera camera = {.name = "camera", .yfov_rad = 1, .node = -1};
    struct scene scene;
    struct error err = {0};

    scene_init(&scene);
    scene.name = "empty";
    camera.to_world = transform_d_identity();
    scene.cameras = &camera;
    scene.camera_count = 1;
    scene.environment.present = 1;
    if (with_missing_image) {
        scene.environment.image.name = "sky";
        memset(&scene.environment.image.blob.digest, 0x5a, DIGEST_BYTES);
        scene.environment.image.blob.size_bytes = 99;
    } else {
        scene.environment.constant = 1;
    }
    if (scene_pack(&scene, out, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    assert_int_equal(digest_of(digest, out->data, out->size), STATUS_OK);
    scene.cameras = NULL;
    scene.camera_count = 0;
    scene_release(&scene);
}

static void put_piece(struct peer *peer, uint64_t request, const struct digest *digest, const uint8_t *data,
                      uint64_t total, uint64_t offset, uint32_t size)
{
    Azulejo__Wire__BlobPut put = AZULEJO__WIRE__BLOB_PUT__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(BLOB_PUT, blob_put, &put);

    wire_digest_set(&put.digest, digest);
    put.total_bytes = total;
    put.offset = offset;
    put.raw_bytes = size;
    put.data.data = (uint8_t *)data + offset;
    put.data.len = size;
    e.request = request;
    peer_send(peer, &e);
}

static void put_blob(struct peer *peer, const struct buffer *bytes, const struct digest *digest)
{
    put_piece(peer, 5, digest, bytes->data, bytes->size, 0, (uint32_t)bytes->size);
    message_free(expect(peer, AZULEJO__WIRE__ENVELOPE__BODY_BLOB_STORED));
}

struct submission {
    Azulejo__Wire__JobSubmit job;
    Azulejo__Wire__RenderSettings settings;
    Azulejo__Wire__OutputSettings output;
};

static void submission_init(struct submission *s, const struct digest *scene)
{
    struct render_settings settings;
    Azulejo__Wire__JobSubmit job = AZULEJO__WIRE__JOB_SUBMIT__INIT;
    Azulejo__Wire__RenderSettings wire = AZULEJO__WIRE__RENDER_SETTINGS__INIT;
    Azulejo__Wire__OutputSettings output = AZULEJO__WIRE__OUTPUT_SETTINGS__INIT;

    render_settings_default(&settings);
    settings.width = 40;
    settings.height = 24;
    settings.spp = 10;
    s->settings = wire;
    wire_settings_set(&s->settings, &settings);
    s->output = output;
    s->job = job;
    s->job.settings = &s->settings;
    s->job.output = &s->output;
    s->job.first_frame = s->job.last_frame = 1;
    wire_digest_set(&s->job.scene, scene);
}

static void submit(struct peer *peer, struct submission *s)
{
    Azulejo__Wire__Envelope e = MESSAGE(JOB_SUBMIT, job_submit, &s->job);

    e.request = 7;
    peer_send(peer, &e);
}

static uint64_t submit_good(struct peer *peer)
{
    struct buffer scene = BUFFER_INIT;
    struct digest digest;
    struct submission s;
    Azulejo__Wire__Envelope *m;
    uint64_t id;

    make_scene(&scene, &digest, 0);
    put_blob(peer, &scene, &digest);
    submission_init(&s, &digest);
    submit(peer, &s);
    m = expect(peer, AZULEJO__WIRE__ENVELOPE__BODY_JOB_ACCEPTED);
    assert_int_equal(m->request, 7);
    id = m->job_accepted->job;
    assert_true(id > 0);
    message_free(m);
    buffer_release(&scene);
    return id;
}

static Azulejo__Wire__Envelope *query(struct peer *peer, uint64_t job)
{
    Azulejo__Wire__JobQuery ask = AZULEJO__WIRE__JOB_QUERY__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(JOB_QUERY, job_query, &ask);

    ask.job = job;
    e.request = 9;
    peer_send(peer, &e);
    return expect(peer, AZULEJO__WIRE__ENVELOPE__BODY_JOB_LIST);
}

static void get_output(struct peer *peer, uint64_t job, uint32_t frame, Azulejo__Wire__OutputKind kind)
{
    Azulejo__Wire__OutputGet get = AZULEJO__WIRE__OUTPUT_GET__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(OUTPUT_GET, output_get, &get);

    get.job = job;
    get.frame = frame;
    get.kind = kind;
    e.request = 11;
    peer_send(peer, &e);
}

static void ask_for_work(struct peer *peer, uint32_t units)
{
    Azulejo__Wire__LeaseRequest ask = AZULEJO__WIRE__LEASE_REQUEST__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(LEASE_REQUEST, lease_request, &ask);

    ask.units = units;
    peer_send(peer, &e);
}

/* Answer a unit of a grant with grey; `change` may spoil the result. */
static void send_result(struct peer *peer, const Azulejo__Wire__LeaseGrant *grant, size_t i,
                        void (*change)(Azulejo__Wire__TileResult *))
{
    static float sums[TILE_FLOATS_MAX];
    Azulejo__Wire__TileResult result = AZULEJO__WIRE__TILE_RESULT__INIT;
    Azulejo__Wire__RenderStats stats = AZULEJO__WIRE__RENDER_STATS__INIT;
    Azulejo__Wire__Work work = AZULEJO__WIRE__WORK__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(TILE_RESULT, tile_result, &result);
    struct render_settings settings;
    struct error err = {0};
    struct tile_rect rect;
    uint32_t begin, end;

    assert_int_equal(wire_settings_get(&settings, grant->settings, UINT32_MAX, &err), STATUS_OK);
    for (size_t k = 0; k < TILE_FLOATS_MAX; k++)
        sums[k] = 1;
    result.lease = grant->lease;
    result.epoch = grant->epoch;
    result.job = grant->job;
    result.frame = grant->frame;
    result.tile = grant->units[i]->tile;
    result.group = grant->units[i]->group;
    result.pass = grant->units[i]->pass;
    result.sums.data = (uint8_t *)sums;
    result.sums.len = wire_sums_count(&settings, result.tile, result.group, result.pass) * 4;
    rect = tile_rect_of(settings.width, settings.height, result.tile);
    pass_range(settings.spp, result.group, result.pass, &begin, &end);
    work.samples = (uint64_t)rect.width * rect.height * (end - begin);
    result.work = &work;
    stats.cpu_ns = 1000000;
    result.stats = &stats;
    if (change)
        change(&result);
    peer_send(peer, &e);
}

/* ---- greetings and roles -------------------------------------------------------------------- */

static void old_versions_are_refused_in_words(void **state)
{
    struct peer peer;
    Azulejo__Wire__Hello hello = make_hello(FARM_ROLE_CLIENT);

    (void)state;
    hello.protocol_version = PROTOCOL_VERSION + 1;
    peer_connect(&peer, FARM_ROLE_CLIENT);
    greet(&peer, &hello);
    expect_failure(&peer, 0, STATUS_ERR_UNSUPPORTED, "version");
    expect_end(&peer);
    peer_end(&peer);
}

static void a_role_is_the_keys(void **state)
{
    struct peer peer;
    Azulejo__Wire__Hello hello = make_hello(FARM_ROLE_ADMIN);

    (void)state;
    peer_connect(&peer, FARM_ROLE_WORKER);
    greet(&peer, &hello);
    expect_failure(&peer, 0, STATUS_ERR_REFUSED, "worker");
    expect_end(&peer);
    peer_end(&peer);
}

static void unfit_workers_are_refused(void **state)
{
    struct peer peer;
    Azulejo__Wire__Hello hello = make_hello(FARM_ROLE_WORKER);
    char none[] = "";

    (void)state;
    hello.arithmetic ^= 1;
    peer_connect(&peer, FARM_ROLE_WORKER);
    greet(&peer, &hello);
    expect_failure(&peer, 0, STATUS_ERR_REFUSED, "arithmetic");
    expect_end(&peer);
    peer_end(&peer);
    hello.arithmetic = elementary_fingerprint_of("double");
    peer_connect(&peer, FARM_ROLE_WORKER);
    greet(&peer, &hello);
    expect_failure(&peer, 0, STATUS_ERR_REFUSED, "computes in double");
    expect_end(&peer);
    peer_end(&peer);
    for (int i = 0; i < 3; i++) {
        hello = make_hello(FARM_ROLE_WORKER);
        if (i == 0)
            hello.threads = 0;
        else if (i == 1)
            hello.threads = UINT32_MAX;
        else
            hello.kernel = none;
        peer_connect(&peer, FARM_ROLE_WORKER);
        greet(&peer, &hello);
        expect_failure(&peer, 0, STATUS_ERR_PROTOCOL, "worker");
        expect_end(&peer);
        peer_end(&peer);
    }
}

static void roles_keep_to_their_messages(void **state)
{
    struct peer peer;
    Azulejo__Wire__JobCancel cancel = AZULEJO__WIRE__JOB_CANCEL__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(JOB_CANCEL, job_cancel, &cancel);
    Azulejo__Wire__Welcome welcome = AZULEJO__WIRE__WELCOME__INIT;
    Azulejo__Wire__Envelope w = MESSAGE(WELCOME, welcome, &welcome);
    Azulejo__Wire__Envelope nothing = AZULEJO__WIRE__ENVELOPE__INIT;

    (void)state;
    join(&peer, FARM_ROLE_WORKER);
    e.request = 3;
    peer_send(&peer, &e);
    expect_failure(&peer, 3, STATUS_ERR_REFUSED, "worker may not");
    expect_end(&peer);
    peer_end(&peer);
    join(&peer, FARM_ROLE_CLIENT);
    ask_for_work(&peer, 4);
    expect_failure(&peer, 0, STATUS_ERR_REFUSED, "client may not");
    expect_end(&peer);
    peer_end(&peer);
    join(&peer, FARM_ROLE_CLIENT);
    peer_send(&peer, &w);
    expect_failure(&peer, 0, STATUS_ERR_REFUSED, "welcome");
    expect_end(&peer);
    peer_end(&peer);
    join(&peer, FARM_ROLE_CLIENT); /* a message of a later version, or none */
    nothing.request = 8;
    peer_send(&peer, &nothing);
    expect_failure(&peer, 8, STATUS_ERR_REFUSED, "none");
    expect_end(&peer);
    peer_end(&peer);
    peer_connect(&peer, FARM_ROLE_CLIENT); /* no Hello first */
    peer_send(&peer, &e);
    expect_failure(&peer, 0, STATUS_ERR_PROTOCOL, "Hello");
    expect_end(&peer);
    peer_end(&peer);
}

/* ---- blobs ---------------------------------------------------------------------------------- */

static void blobs_come_in_pieces_and_go_out(void **state)
{
    enum { SIZE = 700000 };
    struct peer client, worker;
    uint8_t *data = malloc(SIZE), *back = calloc(1, SIZE);
    struct digest digest, other;
    Azulejo__Wire__BlobGet get = AZULEJO__WIRE__BLOB_GET__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(BLOB_GET, blob_get, &get);
    uint64_t got = 0;

    (void)state;
    assert_non_null(data);
    assert_non_null(back);
    for (uint32_t i = 0; i < SIZE; i++)
        data[i] = (uint8_t)(i * i >> 7);
    assert_int_equal(digest_of(&digest, data, SIZE), STATUS_OK);
    assert_int_equal(digest_of(&other, data, SIZE - 1), STATUS_OK);
    join(&client, FARM_ROLE_CLIENT);
    join(&worker, FARM_ROLE_WORKER);
    /* Other bytes than the digest says. */
    for (uint64_t at = 0; at < SIZE; at += BLOB_PIECE_BYTES)
        put_piece(&client, 1, &other, data, SIZE, at, blob_piece_size(SIZE, at));
    expect_failure(&client, 1, STATUS_ERR_INPUT, "SHA-256");
    /* Out of order. */
    put_piece(&client, 2, &digest, data, SIZE, 0, 1000);
    put_piece(&client, 2, &digest, data, SIZE, 2000, 1000);
    expect_failure(&client, 2, STATUS_ERR_PROTOCOL, "order");
    for (uint64_t at = 0; at < SIZE; at += BLOB_PIECE_BYTES)
        put_piece(&client, 3, &digest, data, SIZE, at, blob_piece_size(SIZE, at));
    message_free(expect(&client, AZULEJO__WIRE__ENVELOPE__BODY_BLOB_STORED));
    put_piece(&client, 4, &digest, data, SIZE, 0, BLOB_PIECE_BYTES); /* there already */
    message_free(expect(&client, AZULEJO__WIRE__ENVELOPE__BODY_BLOB_STORED));

    wire_digest_set(&get.digest, &other);
    e.request = 5;
    peer_send(&client, &e);
    expect_failure(&client, 5, STATUS_ERR_NOT_FOUND, "blob");
    wire_digest_set(&get.digest, &digest);
    e.request = 6;
    peer_send(&worker, &e); /* it has no lease */
    expect_failure(&worker, 6, STATUS_ERR_REFUSED, "no lease of this worker needs the blob");
    peer_send(&client, &e);
    while (got < SIZE) {
        Azulejo__Wire__Envelope *m = expect(&client, AZULEJO__WIRE__ENVELOPE__BODY_BLOB_DATA);
        struct blob_piece piece;
        assert_int_equal(m->request, 6);
        assert_int_equal(blob_piece_of_data(&piece, m->blob_data, NULL), STATUS_OK);
        assert_int_equal(piece.offset, got);
        assert_int_equal(piece.total_bytes, SIZE);
        assert_int_equal(blob_piece_unpack(&piece, back + got, NULL), STATUS_OK);
        got += piece.raw_bytes;
        message_free(m);
    }
    assert_memory_equal(back, data, SIZE);
    put_piece(&worker, 7, &other, data, 10, 0, 10);
    expect_failure(&worker, 7, STATUS_ERR_REFUSED, "that it is asked for");
    peer_end(&client);
    peer_end(&worker);
    free(data);
    free(back);
}

/* ---- jobs ----------------------------------------------------------------------------------- */

static void bad_jobs_are_refused_in_words(void **state)
{
    struct peer peer;
    struct buffer scene = BUFFER_INIT, hollow = BUFFER_INIT;
    struct digest digest, hollow_digest, junk_digest;
    struct submission s;
    char junk[] = "this is no scene", unknown[] = "no-such-operator", tiff[] = "tiff";
    char *formats[] = {tiff};
    struct buffer junk_bytes = {(uint8_t *)junk, sizeof junk, sizeof junk, 0};

    (void)state;
    make_scene(&scene, &digest, 0);
    make_scene(&hollow, &hollow_digest, 1);
    assert_int_equal(digest_of(&junk_digest, junk, sizeof junk), STATUS_OK);
    join(&peer, FARM_ROLE_CLIENT);
    submission_init(&s, &digest);
    submit(&peer, &s);
    expect_failure(&peer, 7, STATUS_ERR_NOT_FOUND, "scene");
    put_blob(&peer, &scene, &digest);
    put_blob(&peer, &hollow, &hollow_digest);
    put_blob(&peer, &junk_bytes, &junk_digest);
    submission_init(&s, &hollow_digest);
    submit(&peer, &s);
    expect_failure(&peer, 7, STATUS_ERR_NOT_FOUND, "5a5a5a5a5a5a");
    submission_init(&s, &junk_digest);
    submit(&peer, &s);
    expect_failure(&peer, 7, STATUS_ERR_INPUT, "damaged");
#define REFUSED(change, code, word)             \
    do {                                        \
        submission_init(&s, &digest);           \
        change;                                 \
        submit(&peer, &s);                      \
        expect_failure(&peer, 7, (code), word); \
    } while (0)
    REFUSED(s.settings.width = 0, STATUS_ERR_INPUT, "size");
    REFUSED(s.settings.width = UINT32_MAX, STATUS_ERR_INPUT, "size");
    REFUSED(s.settings.spp = 0, STATUS_ERR_INPUT, "samples");
    REFUSED(s.settings.camera = 1, STATUS_ERR_INPUT, "camera");
    REFUSED(s.settings.isa = 77, STATUS_ERR_INPUT, "isa 77");
    REFUSED(s.job.settings = NULL, STATUS_ERR_PROTOCOL, "settings");
    REFUSED(s.job.scene.len = 31, STATUS_ERR_PROTOCOL, "scene");
    REFUSED(s.job.first_frame = 2, STATUS_ERR_INPUT, "frames");
    REFUSED(s.job.last_frame = UINT32_MAX, STATUS_ERR_INPUT, "frames");
    REFUSED(s.output.tonemap = unknown, STATUS_ERR_INPUT, "no-such-operator");
    REFUSED((s.output.formats = formats, s.output.n_formats = 1), STATUS_ERR_INPUT, "tiff");
#undef REFUSED
    buffer_release(&scene);
    buffer_release(&hollow);
    peer_end(&peer);
}

static void a_job_from_submit_to_picture(void **state)
{
    struct peer client, watcher, worker;
    Azulejo__Wire__JobWatch watch = AZULEJO__WIRE__JOB_WATCH__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(JOB_WATCH, job_watch, &watch);
    Azulejo__Wire__Envelope *m;
    size_t results = 0, acks = 0;
    uint64_t job;
    int done = 0;

    (void)state;
    join(&client, FARM_ROLE_CLIENT);
    job = submit_good(&client);
    m = query(&client, job);
    assert_int_equal(m->job_list->n_jobs, 1);
    assert_int_equal(m->job_list->jobs[0]->state, AZULEJO__WIRE__JOB_STATE__JOB_QUEUED);
    assert_non_null(strstr(m->job_list->jobs[0]->state_text, "no worker"));
    assert_int_equal(m->job_list->jobs[0]->samples_total, 40 * 24 * 10);
    assert_true(m->job_list->jobs[0]->seconds_left < 0);
    message_free(m);
    get_output(&client, job, 1, AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EXR);
    expect_failure(&client, 11, STATUS_ERR_NOT_FOUND, "not finished");
    get_output(&client, job, 1, AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_PNG);
    expect_failure(&client, 11, STATUS_ERR_NOT_FOUND, "no samples");
    get_output(&client, job, 2, AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EXR);
    expect_failure(&client, 11, STATUS_ERR_NOT_FOUND, "frames 1 to 1");
    get_output(&client, job + 1, 1, AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EXR);
    expect_failure(&client, 11, STATUS_ERR_NOT_FOUND, "no job");

    join(&watcher, FARM_ROLE_CLIENT);
    watch.job = job;
    watch.interval_ms = 60000; /* so that what comes is sent because something changed */
    e.request = 21;
    peer_send(&watcher, &e);
    message_free(expect(&watcher, AZULEJO__WIRE__ENVELOPE__BODY_JOB_LIST));

    join(&worker, FARM_ROLE_WORKER);
    ask_for_work(&worker, 100);
    while (acks < 36) { /* 6 tiles, 3 passes of 2 groups */
        m = peer_receive(&worker);
        assert_non_null(m);
        if (m->body_case == AZULEJO__WIRE__ENVELOPE__BODY_LEASE_GRANT) {
            assert_int_equal(m->lease_grant->job, job);
            for (size_t i = 0; i < m->lease_grant->n_units; i++, results++)
                send_result(&worker, m->lease_grant, i, NULL);
            ask_for_work(&worker, 100);
        } else {
            assert_int_equal(m->body_case, AZULEJO__WIRE__ENVELOPE__BODY_RESULT_ACK);
            acks += m->result_ack->n_units;
        }
        message_free(m);
        if (acks == 6) {
            get_output(&client, job, 1, AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_PNG);
            m = expect(&client, AZULEJO__WIRE__ENVELOPE__BODY_OUTPUT_DATA);
            assert_int_equal(m->output_data->offset, 0);
            assert_int_equal(m->output_data->data.len, m->output_data->total_bytes);
            assert_memory_equal(m->output_data->data.data, "\x89PNG", 4);
            message_free(m);
        }
    }
    assert_int_equal(results, 36);
    while (!done) {
        m = expect(&watcher, AZULEJO__WIRE__ENVELOPE__BODY_JOB_LIST);
        assert_int_equal(m->request, 21);
        done = m->job_list->jobs[0]->state == AZULEJO__WIRE__JOB_STATE__JOB_DONE;
        if (done) {
            assert_int_equal(m->job_list->jobs[0]->samples_done, 40 * 24 * 10);
            assert_int_equal(m->job_list->jobs[0]->frames_done, 1);
            assert_true(m->job_list->jobs[0]->seconds_left == 0);
            assert_true(m->job_list->jobs[0]->finished_at > 0);
        }
        message_free(m);
    }
    get_output(&client, job, 1, AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EXR);
    m = expect(&client, AZULEJO__WIRE__ENVELOPE__BODY_OUTPUT_DATA);
    assert_memory_equal(m->output_data->data.data, "\x76\x2f\x31\x01", 4);
    assert_string_equal(m->output_data->file_name, "frame-0001.exr");
    message_free(m);
    peer_end(&client);
    peer_end(&watcher);
    peer_end(&worker);
}

/* ---- hostile workers ------------------------------------------------------------------------ */

static void far_tile(Azulejo__Wire__TileResult *r) { r->tile = UINT32_MAX; }
static void far_pass(Azulejo__Wire__TileResult *r) { r->pass = 3; }
static void short_sums(Azulejo__Wire__TileResult *r) { r->sums.len = 4; }
static void no_sums(Azulejo__Wire__TileResult *r)
{
    r->sums.len = 0;
    r->sums.data = NULL;
}
static void future_epoch(Azulejo__Wire__TileResult *r) { r->epoch = UINT64_MAX; }

static void hostile_workers_end_alone(void **state)
{
    static void (*const changes[])(Azulejo__Wire__TileResult *) = {far_tile, far_pass, short_sums,
                                                                   no_sums, future_epoch};
    struct peer client, worker;
    Azulejo__Wire__LeaseReturn give = AZULEJO__WIRE__LEASE_RETURN__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(LEASE_RETURN, lease_return, &give);
    Azulejo__Wire__JobBroken broken = AZULEJO__WIRE__JOB_BROKEN__INIT;
    Azulejo__Wire__Envelope b = MESSAGE(JOB_BROKEN, job_broken, &broken);
    Azulejo__Wire__Envelope *m;
    uint64_t job;

    (void)state;
    join(&client, FARM_ROLE_CLIENT);
    job = submit_good(&client);
    for (size_t i = 0; i < sizeof changes / sizeof *changes; i++) {
        snprintf(worker_host, sizeof worker_host, "machine-%zu", i); /* those before are blocked */
        join(&worker, FARM_ROLE_WORKER);
        give.lease = UINT64_MAX; /* unknown leases and jobs are passed over */
        peer_send(&worker, &e);
        broken.job = UINT64_MAX;
        peer_send(&worker, &b);
        ask_for_work(&worker, UINT32_MAX);
        m = expect(&worker, AZULEJO__WIRE__ENVELOPE__BODY_LEASE_GRANT);
        send_result(&worker, m->lease_grant, 0, changes[i]);
        message_free(m);
        do {
            m = peer_receive(&worker);
            assert_non_null(m);
            if (m->body_case == AZULEJO__WIRE__ENVELOPE__BODY_FAILURE) {
                assert_int_equal(m->failure->code, STATUS_ERR_PROTOCOL);
                message_free(m);
                break;
            }
            message_free(m);
        } while (1);
        expect_end(&worker);
        peer_end(&worker);
    }
    /* What they held went back, and the coordinator is well. */
    m = query(&client, job);
    assert_int_equal(m->job_list->jobs[0]->samples_done, 0);
    assert_int_equal(m->job_list->jobs[0]->conflicts, 0);
    message_free(m);
    peer_end(&client);
}

/* ---- restarts ------------------------------------------------------------------------------- */

static void jobs_survive_kill_and_term(void **state)
{
    struct peer peer;
    Azulejo__Wire__JobCancel cancel = AZULEJO__WIRE__JOB_CANCEL__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(JOB_CANCEL, job_cancel, &cancel);
    Azulejo__Wire__Envelope *m;
    uint64_t first, second;
    int how;

    (void)state;
    join(&peer, FARM_ROLE_CLIENT);
    first = submit_good(&peer);
    second = submit_good(&peer);
    assert_true(second > first);
    stop_coordinator(SIGKILL); /* the moment after the answer */
    expect_end(&peer);
    peer_end(&peer);
    start_coordinator();
    join(&peer, FARM_ROLE_CLIENT);
    m = query(&peer, 0);
    assert_int_equal(m->job_list->n_jobs, 2);
    message_free(m);
    cancel.job = first;
    e.request = 13;
    peer_send(&peer, &e);
    m = expect(&peer, AZULEJO__WIRE__ENVELOPE__BODY_JOB_LIST);
    assert_int_equal(m->job_list->jobs[0]->state, AZULEJO__WIRE__JOB_STATE__JOB_CANCELLED);
    message_free(m);
    stop_coordinator(SIGKILL);
    peer_end(&peer);
    start_coordinator();
    join(&peer, FARM_ROLE_CLIENT);
    m = query(&peer, first);
    assert_int_equal(m->job_list->jobs[0]->state, AZULEJO__WIRE__JOB_STATE__JOB_CANCELLED);
    message_free(m);
    how = stop_coordinator(SIGTERM);
    assert_true(WIFEXITED(how) && WEXITSTATUS(how) == 0);
    expect_end(&peer);
    assert_int_equal(peer.why.code, STATUS_OK); /* it said goodbye */
    peer_end(&peer);
}

#define SERVER_TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        SERVER_TEST(old_versions_are_refused_in_words),
        SERVER_TEST(a_role_is_the_keys),
        SERVER_TEST(unfit_workers_are_refused),
        SERVER_TEST(roles_keep_to_their_messages),
        SERVER_TEST(blobs_come_in_pieces_and_go_out),
        SERVER_TEST(bad_jobs_are_refused_in_words),
        SERVER_TEST(a_job_from_submit_to_picture),
        SERVER_TEST(hostile_workers_end_alone),
        SERVER_TEST(jobs_survive_kill_and_term),
    };
    return cmocka_run_group_tests_name("server", tests, NULL, NULL);
}
