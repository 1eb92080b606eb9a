/* odd_peer: one end of Azulejo's protocol that does as it is told, also what no program of ours does.
 *
 *   odd_peer HOST PORT KEYFILE ROLE      ROLE: worker, client; whose key the handshake proves
 *   odd_peer HOST PORT KEYFILE coordinator   listens there (PORT 0: a free one, which it prints),
 *                                            takes one connection and is its other end
 *
 * Commands come on standard input, one a line; what the coordinator says goes to standard output,
 * one line a message. The tests in test_faults.py hold the conversation. Commands:
 *
 *   hello [version=N] [role=N] [threads=N] [isa=MASK] [arithmetic=HEX] [kernel=WORD] [host=WORD]
 *         [name=WORD] [chosen=1] [instance=N]
 *   request UNITS             a LeaseRequest
 *   result [KEY=VALUE]...     a TileResult for a unit of the last grant: unit=INDEX (0), and what
 *                             to say instead of the truth: lease, epoch, job, frame, tile, group, pass,
 *                             cpu=NS, floats=COUNT, fill=VALUE (0.25; also nan, inf)
 *   status [ms=N]             a WorkerStatus; with ms a unit runs: job, frame, tile, group, pass
 *   return [unit=INDEX]       a LeaseReturn
 *   broken [code=N]           a JobBroken for the last grant, with that status's number (ERR_NO_MEMORY)
 *   query JOB, cancel JOB, workers, heartbeat
 *   submit DIGEST             a JobSubmit of the scene of that digest (64 hex digits)
 *   render KEY=VALUE...       a RenderRequest: job, frame, and tile, group, pass, or x, y, first, count, path
 *   blob DIGEST               a BlobGet
 *   put REQUEST DIGEST HEX    a BlobPut for that request: a blob of these bytes ("-": none), whole
 *   rendered REQUEST BYTES    a RenderResult for that request with so many bytes of samples
 *   raw HEX                   these bytes in the TLS stream;  tcp HEX: beside it
 *   mute                      no more heartbeats of our own
 *   deaf                      reads no more
 *   times N COMMAND           the command N times
 *   welcome [version=N]       as coordinator: a Welcome
 *   failure CODE              as coordinator: a Failure with that status's number
 *   close                     say goodbye and end (so does the end of the input)
 *
 * It goes on reading until the coordinator ends the connection ("ended": with a goodbye, "lost": without).
 */
#include <arpa/inet.h>
#include <errno.h>
#include <inttypes.h>
#include <netdb.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "common/system/clock.h"
#include "common/base/memory.h"
#include "common/film/tiles.h"
#include "common/math/elementary.h"
#include "protocol/framing.h"
#include "protocol/message.h"
#include "protocol/tls.h"
#include "worker/render/render.h"

enum { LINE_SIZE = 1 << 16, WORDS_MAX = 24, UNITS_MAX = 4096, HEARTBEAT_MS = 500 };

struct peer {
    int socket;
    struct tls *tls;
    struct framing_reader frames;
    int mute, deaf, over;
    int spoke; /* no heartbeat comes before its first message, which is a Hello */
    /* the last grant */
    uint64_t lease, epoch, job;
    uint32_t frame, width, height, spp, unit_count;
    struct { uint32_t tile, group, pass; } units[UNITS_MAX];
};

/* Only our own mistakes: what the coordinator does is printed, never judged here. */
static void die(const char *what)
{
    fprintf(stderr, "odd_peer: %s\n", what);
    exit(2);
}

/* ---- bytes ------------------------------------------------------------------------------- */

static void send_all(struct peer *p, const uint8_t *bytes, size_t size)
{
    while (size > 0 && !p->over) {
        ssize_t sent = send(p->socket, bytes, size, MSG_NOSIGNAL);
        if (sent < 0 && errno == EINTR)
            continue;
        if (sent <= 0) {
            printf("lost\n");
            p->over = 1;
            return;
        }
        bytes += sent;
        size -= (size_t)sent;
    }
}

static void flush_tls(struct peer *p)
{
    uint8_t bytes[1 << 14];
    size_t size;

    while ((size = tls_output_take(p->tls, bytes, sizeof bytes)) > 0)
        send_all(p, bytes, size);
}

static void send_plain(struct peer *p, const uint8_t *bytes, size_t size)
{
    if (tls_write(p->tls, bytes, size, NULL) != STATUS_OK)
        printf("unsent\n");
    flush_tls(p);
}

static void send_message(struct peer *p, const Azulejo__Wire__Envelope *message)
{
    p->spoke = 1;
    size_t size = azulejo__wire__envelope__get_packed_size(message);
    uint8_t *bytes = malloc(FRAME_HEADER_BYTES + size);

    if (!bytes)
        die("out of memory");
    framing_header_write(bytes, (uint32_t)size);
    azulejo__wire__envelope__pack(message, bytes + FRAME_HEADER_BYTES);
    send_plain(p, bytes, FRAME_HEADER_BYTES + size);
    free(bytes);
}

static size_t parse_hex(const char *text, uint8_t *out)
{
    size_t length = strlen(text) / 2;

    for (size_t i = 0; i < length; i++) {
        unsigned value;
        if (sscanf(text + 2 * i, "%2x", &value) != 1)
            die("not hexadecimal");
        out[i] = (uint8_t)value;
    }
    return length;
}

/* ---- commands ---------------------------------------------------------------------------- */

/* The value of "key=value" among the words; NULL: it is not there. */
static const char *value_of(char *const words[], int count, const char *key)
{
    size_t length = strlen(key);

    for (int i = 1; i < count; i++)
        if (strncmp(words[i], key, length) == 0 && words[i][length] == '=')
            return words[i] + length + 1;
    return NULL;
}

static uint64_t number_of(char *const words[], int count, const char *key, uint64_t otherwise)
{
    const char *text = value_of(words, count, key);

    return text ? strtoull(text, NULL, 0) : otherwise;
}

static void say_hello(struct peer *p, char *const words[], int count)
{
    Azulejo__Wire__Hello hello = AZULEJO__WIRE__HELLO__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(HELLO, hello, &hello);
    const char *kernel = value_of(words, count, "kernel"), *host = value_of(words, count, "host");

    hello.protocol_version = (uint32_t)number_of(words, count, "version", PROTOCOL_VERSION);
    hello.name = (char *)(value_of(words, count, "name") ? value_of(words, count, "name") : "");
    hello.name_chosen = number_of(words, count, "chosen", 0) != 0;
    hello.instance = number_of(words, count, "instance", 0);
    hello.role = (Azulejo__Wire__Role)number_of(words, count, "role", (uint64_t)tls_role(p->tls));
    hello.software = (char *)"odd_peer";
    hello.host = host ? (char *)host : (char *)"odd";
    hello.process = (uint32_t)getpid();
    hello.threads = (uint32_t)number_of(words, count, "threads", 1);
    hello.isa_mask = (uint32_t)number_of(words, count, "isa", isa_supported_mask());
    hello.arithmetic = number_of(words, count, "arithmetic", elementary_fingerprint());
    hello.kernel = kernel ? (char *)kernel : (char *)render_ray_tracer_name();
    send_message(p, &e);
}

static void send_result(struct peer *p, char *const words[], int count)
{
    Azulejo__Wire__TileResult result = AZULEJO__WIRE__TILE_RESULT__INIT;
    Azulejo__Wire__RenderStats stats = AZULEJO__WIRE__RENDER_STATS__INIT;
    Azulejo__Wire__Work work = AZULEJO__WIRE__WORK__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(TILE_RESULT, tile_result, &result);
    uint32_t unit = (uint32_t)number_of(words, count, "unit", 0);
    const char *fill = value_of(words, count, "fill");
    float value = fill ? strtof(fill, NULL) : 0.25f;
    struct tile_rect rect;
    uint32_t begin, end;
    size_t floats;
    float *sums;

    if (unit >= p->unit_count)
        die("no such unit was granted");
    rect = tile_rect_of(p->width, p->height, p->units[unit].tile);
    floats = number_of(words, count, "floats", PIXEL_FLOATS * rect.width * rect.height);
    sums = malloc((floats + 1) * sizeof *sums);
    if (!sums)
        die("out of memory");
    for (size_t i = 0; i < floats; i++)
        sums[i] = value;
    pass_range(p->spp, p->units[unit].group, p->units[unit].pass, &begin, &end);
    work.samples = number_of(words, count, "samples", (uint64_t)rect.width * rect.height * (end - begin));
    work.rays = number_of(words, count, "rays", 0);
    result.work = &work;
    stats.cpu_ns = number_of(words, count, "cpu", 1000000);
    result.lease = number_of(words, count, "lease", p->lease);
    result.epoch = number_of(words, count, "epoch", p->epoch);
    result.job = number_of(words, count, "job", p->job);
    result.frame = (uint32_t)number_of(words, count, "frame", p->frame);
    result.tile = (uint32_t)number_of(words, count, "tile", p->units[unit].tile);
    result.group = (uint32_t)number_of(words, count, "group", p->units[unit].group);
    result.pass = (uint32_t)number_of(words, count, "pass", p->units[unit].pass);
    wire_sums_set(&result.sums, sums, floats);
    result.stats = &stats;
    send_message(p, &e);
    free(sums);
}

static void say_welcome(struct peer *p, char *const words[], int count)
{
    Azulejo__Wire__Welcome welcome = AZULEJO__WIRE__WELCOME__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(WELCOME, welcome, &welcome);

    welcome.protocol_version = (uint32_t)number_of(words, count, "version", PROTOCOL_VERSION);
    welcome.software = (char *)"odd_peer";
    welcome.session = 1;
    welcome.heartbeat_ms = HEARTBEAT_MS;
    welcome.silence_limit_ms = 60 * 1000;
    send_message(p, &e);
}

static void say_failure(struct peer *p, const char *code)
{
    Azulejo__Wire__Failure failure = AZULEJO__WIRE__FAILURE__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(FAILURE, failure, &failure);

    failure.code = (uint32_t)strtoul(code, NULL, 0);
    failure.text = (char *)"the odd coordinator will not have it";
    send_message(p, &e);
}

static void send_status(struct peer *p, char *const words[], int count)
{
    Azulejo__Wire__WorkerStatus told = AZULEJO__WIRE__WORKER_STATUS__INIT;
    Azulejo__Wire__LongUnit unit = AZULEJO__WIRE__LONG_UNIT__INIT, *units[1] = {&unit};
    Azulejo__Wire__Envelope e = MESSAGE(WORKER_STATUS, worker_status, &told);

    unit.job = number_of(words, count, "job", 0);
    unit.frame = (uint32_t)number_of(words, count, "frame", 0);
    unit.tile = (uint32_t)number_of(words, count, "tile", 0);
    unit.group = (uint32_t)number_of(words, count, "group", 0);
    unit.pass = (uint32_t)number_of(words, count, "pass", 0);
    unit.running_ms = number_of(words, count, "ms", 0);
    told.long_units = units;
    told.n_long_units = unit.running_ms > 0;
    send_message(p, &e);
}

static void return_unit(struct peer *p, char *const words[], int count)
{
    Azulejo__Wire__LeaseReturn back = AZULEJO__WIRE__LEASE_RETURN__INIT;
    Azulejo__Wire__WorkUnit unit = AZULEJO__WIRE__WORK_UNIT__INIT, *units[1] = {&unit};
    Azulejo__Wire__Envelope e = MESSAGE(LEASE_RETURN, lease_return, &back);
    uint32_t index = (uint32_t)number_of(words, count, "unit", 0);

    if (index >= p->unit_count)
        die("no such unit was granted");
    unit.tile = p->units[index].tile;
    unit.group = p->units[index].group;
    unit.pass = p->units[index].pass;
    back.lease = p->lease;
    back.n_units = 1;
    back.units = units;
    back.reason = (char *)"the test wants it so";
    send_message(p, &e);
}

static void say_broken(struct peer *p, char *const words[], int count)
{
    Azulejo__Wire__JobBroken broken = AZULEJO__WIRE__JOB_BROKEN__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(JOB_BROKEN, job_broken, &broken);

    broken.job = p->job;
    broken.lease = p->lease;
    broken.code = (uint32_t)number_of(words, count, "code", STATUS_ERR_NO_MEMORY);
    broken.text = (char *)"the odd peer cannot";
    send_message(p, &e);
}

static void submit(struct peer *p, const char *hex)
{
    Azulejo__Wire__JobSubmit job = AZULEJO__WIRE__JOB_SUBMIT__INIT;
    Azulejo__Wire__RenderSettings settings = AZULEJO__WIRE__RENDER_SETTINGS__INIT;
    Azulejo__Wire__OutputSettings output = AZULEJO__WIRE__OUTPUT_SETTINGS__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(JOB_SUBMIT, job_submit, &job);
    struct render_settings defaults;
    char *formats[] = {(char *)"exr"};
    uint8_t digest[LINE_SIZE / 2];

    render_settings_default(&defaults);
    wire_settings_set(&settings, &defaults);
    output.tonemap = (char *)"linear";
    output.n_formats = 1;
    output.formats = formats;
    job.scene.len = parse_hex(hex, digest);
    job.scene.data = digest;
    job.name = (char *)"odd";
    job.settings = &settings;
    job.output = &output;
    job.first_frame = job.last_frame = 1;
    e.request = 4;
    send_message(p, &e);
}

static void ask(struct peer *p, const char *what, const char *argument)
{
    Azulejo__Wire__JobQuery query = AZULEJO__WIRE__JOB_QUERY__INIT;
    Azulejo__Wire__JobCancel cancel = AZULEJO__WIRE__JOB_CANCEL__INIT;
    Azulejo__Wire__WorkerQuery workers = AZULEJO__WIRE__WORKER_QUERY__INIT;
    Azulejo__Wire__Heartbeat heartbeat = AZULEJO__WIRE__HEARTBEAT__INIT;
    Azulejo__Wire__LeaseRequest request = AZULEJO__WIRE__LEASE_REQUEST__INIT;
    uint64_t number = argument ? strtoull(argument, NULL, 0) : 0;
    Azulejo__Wire__Envelope e;

    query.job = cancel.job = number;
    request.units = (uint32_t)number;
    if (strcmp(what, "query") == 0)
        e = (Azulejo__Wire__Envelope)MESSAGE(JOB_QUERY, job_query, &query);
    else if (strcmp(what, "cancel") == 0)
        e = (Azulejo__Wire__Envelope)MESSAGE(JOB_CANCEL, job_cancel, &cancel);
    else if (strcmp(what, "workers") == 0)
        e = (Azulejo__Wire__Envelope)MESSAGE(WORKER_QUERY, worker_query, &workers);
    else if (strcmp(what, "heartbeat") == 0)
        e = (Azulejo__Wire__Envelope)MESSAGE(HEARTBEAT, heartbeat, &heartbeat);
    else if (strcmp(what, "request") == 0)
        e = (Azulejo__Wire__Envelope)MESSAGE(LEASE_REQUEST, lease_request, &request);
    else
        die("unknown command");
    if (strcmp(what, "heartbeat") != 0 && strcmp(what, "request") != 0)
        e.request = 3;
    send_message(p, &e);
}

static void say_render(struct peer *p, char *const words[], int count)
{
    Azulejo__Wire__RenderRequest request = AZULEJO__WIRE__RENDER_REQUEST__INIT;
    Azulejo__Wire__PixelSamples pixel = AZULEJO__WIRE__PIXEL_SAMPLES__INIT;
    Azulejo__Wire__WorkUnit unit = AZULEJO__WIRE__WORK_UNIT__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(RENDER_REQUEST, render_request, &request);

    request.job = number_of(words, count, "job", 1);
    request.frame = (uint32_t)number_of(words, count, "frame", 1);
    unit.tile = (uint32_t)number_of(words, count, "tile", 0);
    unit.group = (uint32_t)number_of(words, count, "group", 0);
    unit.pass = (uint32_t)number_of(words, count, "pass", 0);
    pixel.x = (uint32_t)number_of(words, count, "x", 0);
    pixel.y = (uint32_t)number_of(words, count, "y", 0);
    pixel.first = (uint32_t)number_of(words, count, "first", 0);
    pixel.count = (uint32_t)number_of(words, count, "count", 1);
    pixel.path = number_of(words, count, "path", 0) != 0;
    if (value_of(words, count, "tile"))
        request.unit = &unit;
    if (value_of(words, count, "x"))
        request.pixel = &pixel;
    e.request = 5;
    send_message(p, &e);
}

static void say_rendered(struct peer *p, const char *request, const char *size)
{
    static uint8_t bytes[LINE_SIZE];
    Azulejo__Wire__RenderResult result = AZULEJO__WIRE__RENDER_RESULT__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(RENDER_RESULT, render_result, &result);

    result.added.data = bytes;
    result.added.len = strtoul(size, NULL, 0) % sizeof bytes;
    e.request = strtoull(request, NULL, 0);
    send_message(p, &e);
}

static void say_blob_get(struct peer *p, const char *hex)
{
    Azulejo__Wire__BlobGet get = AZULEJO__WIRE__BLOB_GET__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(BLOB_GET, blob_get, &get);
    struct digest digest;

    if (digest_from_hex(&digest, hex) != STATUS_OK)
        die("no digest");
    wire_digest_set(&get.digest, &digest);
    e.request = 1;
    send_message(p, &e);
}

static void say_blob_put(struct peer *p, const char *request, const char *digest, const char *hex)
{
    Azulejo__Wire__BlobPut put = AZULEJO__WIRE__BLOB_PUT__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(BLOB_PUT, blob_put, &put);
    uint8_t bytes[LINE_SIZE / 2];
    struct digest name;

    if (digest_from_hex(&name, digest) != STATUS_OK)
        die("no digest");
    wire_digest_set(&put.digest, &name);
    put.data.data = bytes;
    put.data.len = strcmp(hex, "-") == 0 ? 0 : parse_hex(hex, bytes);
    put.total_bytes = put.raw_bytes = (uint32_t)put.data.len;
    e.request = strtoull(request, NULL, 0);
    send_message(p, &e);
}

static void obey(struct peer *p, char *line);

static void obey_times(struct peer *p, char **words, int count)
{
    char line[256];

    for (long left = strtol(words[1], NULL, 10); left > 0; left--) {
        snprintf(line, sizeof line, "%s %s", words[2], count > 3 ? words[3] : "");
        obey(p, line);
    }
}

static void obey(struct peer *p, char *line)
{
    static uint8_t bytes[LINE_SIZE / 2];
    char *words[WORDS_MAX], *save = NULL;
    int count = 0;

    for (char *w = strtok_r(line, " \n", &save); w && count < WORDS_MAX; w = strtok_r(NULL, " \n", &save))
        words[count++] = w;
    if (count == 0)
        return;
    if (strcmp(words[0], "hello") == 0) {
        say_hello(p, words, count);
    } else if (strcmp(words[0], "result") == 0) {
        send_result(p, words, count);
    } else if (strcmp(words[0], "status") == 0) {
        send_status(p, words, count);
    } else if (strcmp(words[0], "return") == 0) {
        return_unit(p, words, count);
    } else if (strcmp(words[0], "broken") == 0) {
        say_broken(p, words, count);
    } else if (strcmp(words[0], "submit") == 0 && count == 2) {
        submit(p, words[1]);
    } else if (strcmp(words[0], "blob") == 0 && count == 2) {
        say_blob_get(p, words[1]);
    } else if (strcmp(words[0], "put") == 0 && count == 4) {
        say_blob_put(p, words[1], words[2], words[3]);
    } else if (strcmp(words[0], "render") == 0) {
        say_render(p, words, count);
    } else if (strcmp(words[0], "rendered") == 0 && count == 3) {
        say_rendered(p, words[1], words[2]);
    } else if (strcmp(words[0], "raw") == 0 && count == 2) {
        send_plain(p, bytes, parse_hex(words[1], bytes));
    } else if (strcmp(words[0], "tcp") == 0 && count == 2) {
        send_all(p, bytes, parse_hex(words[1], bytes));
    } else if (strcmp(words[0], "welcome") == 0) {
        say_welcome(p, words, count);
    } else if (strcmp(words[0], "failure") == 0 && count == 2) {
        say_failure(p, words[1]);
    } else if (strcmp(words[0], "mute") == 0) {
        p->mute = 1;
    } else if (strcmp(words[0], "deaf") == 0) {
        p->deaf = 1;
    } else if (strcmp(words[0], "times") == 0 && count >= 3) {
        obey_times(p, words, count);
    } else if (strcmp(words[0], "close") == 0) {
        tls_end(p->tls);
        flush_tls(p);
        p->over = 1;
    } else {
        ask(p, words[0], count > 1 ? words[1] : NULL);
    }
}

/* ---- what comes back --------------------------------------------------------------------- */

static void take_grant(struct peer *p, const Azulejo__Wire__LeaseGrant *grant)
{
    p->lease = grant->lease;
    p->epoch = grant->epoch;
    p->job = grant->job;
    p->frame = grant->frame;
    p->spp = grant->settings ? grant->settings->spp : 0;
    p->width = grant->settings ? grant->settings->width : 0;
    p->height = grant->settings ? grant->settings->height : 0;
    p->unit_count = grant->n_units < UNITS_MAX ? (uint32_t)grant->n_units : UNITS_MAX;
    printf("grant lease=%" PRIu64 " epoch=%" PRIu64 " job=%" PRIu64 " frame=%u units=", p->lease, p->epoch, p->job,
           p->frame);
    for (uint32_t i = 0; i < p->unit_count; i++) {
        p->units[i].tile = grant->units[i]->tile;
        p->units[i].group = grant->units[i]->group;
        p->units[i].pass = grant->units[i]->pass;
        printf("%s%u:%u:%u", i ? "," : "", p->units[i].tile, p->units[i].group, p->units[i].pass);
    }
    printf("\n");
}

static void print_message(struct peer *p, const Azulejo__Wire__Envelope *m)
{
    char text[MESSAGE_TEXT_MAX];

    switch (m->body_case) {
    case AZULEJO__WIRE__ENVELOPE__BODY_HEARTBEAT: break;
    case AZULEJO__WIRE__ENVELOPE__BODY_WELCOME:
        printf("welcome version=%u session=%u\n", m->welcome->protocol_version, m->welcome->session);
        break;
    case AZULEJO__WIRE__ENVELOPE__BODY_FAILURE:
        printf("failure request=%" PRIu64 " code=%s: %s\n", m->request, status_text((status)m->failure->code),
               message_text(text, sizeof text, m->failure->text));
        break;
    case AZULEJO__WIRE__ENVELOPE__BODY_NOTICE:
        printf("notice %s\n", message_text(text, sizeof text, m->notice->text));
        break;
    case AZULEJO__WIRE__ENVELOPE__BODY_LEASE_GRANT: take_grant(p, m->lease_grant); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_LEASE_REVOKE:
        printf("revoke lease=%" PRIu64 " %s\n", m->lease_revoke->lease,
               message_text(text, sizeof text, m->lease_revoke->reason));
        break;
    case AZULEJO__WIRE__ENVELOPE__BODY_RESULT_ACK:
        printf("ack job=%" PRIu64 " frame=%u units=", m->result_ack->job, m->result_ack->frame);
        for (size_t i = 0; i < m->result_ack->n_units; i++)
            printf("%s%u:%u:%u", i ? "," : "", m->result_ack->units[i]->tile, m->result_ack->units[i]->group,
                   m->result_ack->units[i]->pass);
        printf("\n");
        break;
    case AZULEJO__WIRE__ENVELOPE__BODY_BLOB_GET:
        printf("wanted %" PRIu64 " ", m->request);
        for (size_t i = 0; i < m->blob_get->digest.len; i++)
            printf("%02x", m->blob_get->digest.data[i]);
        printf("\n");
        break;
    case AZULEJO__WIRE__ENVELOPE__BODY_RENDER_REQUEST: printf("asked %" PRIu64 "\n", m->request); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_RENDER_RESULT:
        printf("rendered digest=");
        for (size_t i = 0; i < m->render_result->digest.len; i++)
            printf("%02x", m->render_result->digest.data[i]);
        printf(" samples=%" PRIu64 " bytes=%zu worker=%s\n",
               m->render_result->work ? m->render_result->work->samples : 0, m->render_result->added.len,
               message_text(text, sizeof text, m->render_result->worker));
        break;
    case AZULEJO__WIRE__ENVELOPE__BODY_JOB_LIST: printf("jobs %zu\n", m->job_list->n_jobs); break;
    default: printf("%s\n", message_name(m)); break;
    }
}

static void hear(struct peer *p)
{
    static uint8_t bytes[1 << 16];
    struct error err = {0};
    ssize_t got = recv(p->socket, bytes, sizeof bytes, 0);
    size_t plain;

    if (got <= 0 || tls_feed(p->tls, bytes, (size_t)got, &err) != STATUS_OK) {
        printf("lost\n");
        p->over = 1;
        return;
    }
    if (tls_state_of(p->tls) == TLS_HANDSHAKE) {
        if (tls_step(p->tls, &err) != STATUS_OK) {
            printf("refused %s\n", err.text);
            p->over = 1;
            return;
        }
        flush_tls(p);
        if (tls_state_of(p->tls) != TLS_OPEN)
            return;
        printf("open\n");
    }
    while (!p->over) {
        const uint8_t *payload;
        size_t size;
        if (tls_read(p->tls, bytes, sizeof bytes, &plain, &err) != STATUS_OK) {
            printf("lost %s\n", err.text);
            p->over = 1;
        } else if (plain == 0) {
            break;
        } else if (framing_reader_push(&p->frames, bytes, plain, &err) != STATUS_OK) {
            die(err.text);
        }
        while (!p->over && framing_reader_next(&p->frames, &payload, &size, &err) == STATUS_OK && payload) {
            Azulejo__Wire__Envelope *message;
            if (message_unpack(&message, payload, size, &err) != STATUS_OK)
                die(err.text);
            print_message(p, message);
            message_free(message);
        }
    }
    if (tls_state_of(p->tls) == TLS_ENDED && !p->over) {
        printf("ended\n");
        p->over = 1;
    }
}

/* ---- life -------------------------------------------------------------------------------- */

static int connect_to(const char *host, const char *port)
{
    struct addrinfo hints = {.ai_socktype = SOCK_STREAM}, *found = NULL;
    int fd;

    if (getaddrinfo(host, port, &hints, &found) != 0)
        die("no such host");
    fd = socket(found->ai_family, SOCK_STREAM, 0);
    if (fd < 0 || connect(fd, found->ai_addr, found->ai_addrlen) != 0)
        die("nobody listens there");
    freeaddrinfo(found);
    return fd;
}

/* As coordinator: the first connection to host:port. */
static int accept_at(const char *host, const char *port)
{
    struct addrinfo hints = {.ai_socktype = SOCK_STREAM, .ai_flags = AI_PASSIVE}, *found = NULL;
    struct sockaddr_in name = {0};
    socklen_t size = sizeof name;
    int one = 1, fd, listener;

    hints.ai_family = AF_INET;
    if (getaddrinfo(host, port, &hints, &found) != 0)
        die("no such host");
    listener = socket(AF_INET, SOCK_STREAM, 0);
    if (listener < 0 || setsockopt(listener, SOL_SOCKET, SO_REUSEADDR, &one, sizeof one) != 0 ||
        bind(listener, found->ai_addr, found->ai_addrlen) != 0 || listen(listener, 1) != 0 ||
        getsockname(listener, (struct sockaddr *)&name, &size) != 0)
        die("cannot listen there");
    freeaddrinfo(found);
    printf("listening on %s:%u\n", host, ntohs(name.sin_port));
    fd = accept(listener, NULL, NULL);
    close(listener);
    if (fd < 0)
        die("no connection came");
    return fd;
}

static void converse(struct peer *p)
{
    static char input[LINE_SIZE];
    size_t used = 0;
    struct error err = {0};

    if (tls_step(p->tls, &err) != STATUS_OK)
        die(err.text);
    flush_tls(p);
    while (!p->over) {
        int open = tls_state_of(p->tls) == TLS_OPEN;
        /* Commands wait until the handshake is through. */
        struct pollfd sources[2] = {{.fd = p->deaf ? -1 : p->socket, .events = POLLIN},
                                    {.fd = open ? STDIN_FILENO : -1, .events = POLLIN}};
        if (poll(sources, 2, HEARTBEAT_MS) == 0 && open && p->spoke && !p->mute)
            ask(p, "heartbeat", NULL);
        if (sources[0].revents)
            hear(p);
        if (sources[1].revents && !p->over) {
            ssize_t got = read(STDIN_FILENO, input + used, sizeof input - 1 - used);
            char *end;
            if (got <= 0)
                break;
            used += (size_t)got;
            input[used] = 0;
            while (!p->over && (end = strchr(input, '\n'))) {
                size_t length = (size_t)(end - input) + 1;
                *end = 0;
                obey(p, input);
                used -= length;
                memmove(input, input + length, used + 1);
            }
            if (used == sizeof input - 1)
                die("a line is too long");
        }
    }
}

int main(int argc, char **argv)
{
    static struct peer p;
    struct farm_key key;
    struct error err = {0};
    enum farm_role role;
    int is_coordinator;

    if (argc != 5)
        die("usage: odd_peer HOST PORT KEYFILE ROLE");
    setvbuf(stdout, NULL, _IOLBF, 0);
    signal(SIGPIPE, SIG_IGN);
    is_coordinator = strcmp(argv[4], "coordinator") == 0;
    role = strcmp(argv[4], "worker") == 0 ? FARM_ROLE_WORKER : FARM_ROLE_CLIENT;
    if (farm_key_load(&key, argv[3], &err) != STATUS_OK)
        die(err.text);
    framing_reader_init(&p.frames, CHANNEL_FRAME_MAX);
    if ((is_coordinator ? tls_new_server(&p.tls, &key, &err) : tls_new_client(&p.tls, &key, role, &err)) != STATUS_OK)
        die(err.text);
    p.socket = is_coordinator ? accept_at(argv[1], argv[2]) : connect_to(argv[1], argv[2]);
    converse(&p);
    close(p.socket);
    tls_free(p.tls);
    framing_reader_release(&p.frames);
    return 0;
}
