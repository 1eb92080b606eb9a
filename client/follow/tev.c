#include "client/follow/tev.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "client/follow/fetch.h"
#include "client/link/reconnect.h"
#include "client/link/signals.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "common/system/clock.h"
#include "protocol/address.h"
#include "protocol/message.h"

enum {
    CREATE_IMAGE = 4,
    UPDATE_IMAGE_V3 = 6,
    PART = 128,          /* pixels of a side that are sent together */
    ANSWER_MS = 1000,    /* for a connection, and for each piece of a picture */
    PICTURE_MS = 8000,   /* for all of it: the coordinator hears nothing meanwhile (SESSION_SILENCE_MS) */
    INTERVAL_MS = 1000,  /* between pictures */
    SHARE = 10,          /* of the time at most, by what the last one took */
    NAME_MAX_BYTES = 300,
};

struct tev {
    char host[ADDRESS_HOST_MAX], port[8];
    struct addrinfo *addresses;
    int quiet, said;
    int fd;          /* -1: not connected */
    uint64_t end_ns; /* until then a picture may be sent */
    char shown_name[NAME_MAX_BYTES];
    struct image shown; /* empty: none */
    uint64_t next_ns;
    int started;
    uint32_t frame; /* the last in work, once `started` */
};

/* ---- connection --------------------------------------------------------------------------- */

static int names_port(const char *text)
{
    const char *bracket = strrchr(text, ']'), *colon = strchr(text, ':');

    return bracket ? bracket[1] == ':' : colon && !strchr(colon + 1, ':');
}

status tev_new(struct tev **out, const char *address, int quiet, struct error *err)
{
    struct tev *tev = must(mem_calloc(1, sizeof *tev));
    const struct addrinfo hints = {.ai_family = AF_UNSPEC, .ai_socktype = SOCK_STREAM};
    uint16_t port;
    int code;
    status result = address_parse(address, "127.0.0.1", 1, tev->host, sizeof tev->host, &port, err);

    *out = NULL;
    if (result != STATUS_OK) {
        mem_free(tev);
        return result;
    }
    snprintf(tev->port, sizeof tev->port, "%u", names_port(address) ? port : TEV_PORT_DEFAULT);
    code = getaddrinfo(tev->host, tev->port, &hints, &tev->addresses);
    if (code != 0) {
        result = error_set(err, STATUS_ERR_INPUT, "--tev %s: %s: give the name or the address of the viewer's machine",
                           address, gai_strerror(code));
        mem_free(tev);
        return result;
    }
    tev->quiet = quiet;
    tev->fd = -1;
    *out = tev;
    return STATUS_OK;
}

static void disconnect(struct tev *tev)
{
    if (tev->fd >= 0)
        close(tev->fd);
    tev->fd = -1;
    image_release(&tev->shown);
}

void tev_free(struct tev *tev)
{
    if (!tev)
        return;
    disconnect(tev);
    freeaddrinfo(tev->addresses);
    mem_free(tev);
}

static int wait_for_room(int fd)
{
    struct pollfd one = {.fd = fd, .events = POLLOUT};
    int ready = poll(&one, 1, ANSWER_MS);

    return ready > 0 && one.revents & POLLOUT;
}

/* A socket that does not block, or -1. */
static int try_address(const struct addrinfo *at)
{
    int fd = socket(at->ai_family, at->ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC, at->ai_protocol);
    int code = 0, yes = 1;
    socklen_t size = sizeof code;

    if (fd < 0)
        return -1;
    if ((connect(fd, at->ai_addr, at->ai_addrlen) == 0 || errno == EINPROGRESS) && wait_for_room(fd) &&
        getsockopt(fd, SOL_SOCKET, SO_ERROR, &code, &size) == 0 && code == 0) {
        setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
        return fd;
    }
    close(fd);
    return -1;
}

/* tev never answers: what can be read is the end of the connection. */
static int is_open(const struct tev *tev)
{
    char byte;
    ssize_t got = tev->fd >= 0 ? recv(tev->fd, &byte, 1, MSG_PEEK | MSG_DONTWAIT) : 0;

    return got > 0 || (got < 0 && (errno == EAGAIN || errno == EWOULDBLOCK));
}

static int reach(struct tev *tev)
{
    if (is_open(tev))
        return 1;
    disconnect(tev);
    for (const struct addrinfo *at = tev->addresses; at && tev->fd < 0 && clock_monotonic_ns() < tev->end_ns; at = at->ai_next)
        tev->fd = try_address(at);
    if (tev->fd < 0 && !tev->said && !tev->quiet)
        fprintf(stderr, "no viewer at %s port %s yet: tev is tried again at each picture\n", tev->host, tev->port);
    tev->said = 1;
    return tev->fd >= 0;
}

static int send_all(struct tev *tev, const struct buffer *packet)
{
    for (size_t at = 0; at < packet->size;) {
        ssize_t sent = send(tev->fd, packet->data + at, packet->size - at, MSG_NOSIGNAL);
        if (clock_monotonic_ns() > tev->end_ns || signals_stop())
            return 0;
        if (sent > 0)
            at += (size_t)sent;
        else if (!(sent < 0 && (errno == EINTR || ((errno == EAGAIN || errno == EWOULDBLOCK) && wait_for_room(tev->fd)))))
            return 0;
    }
    return 1;
}

/* ---- packets ------------------------------------------------------------------------------ */

static void put_number(struct buffer *out, uint64_t value, size_t bytes)
{
    uint8_t raw[8];

    for (size_t i = 0; i < bytes; i++)
        raw[i] = (uint8_t)(value >> 8 * i);
    buffer_append(out, raw, bytes);
}

static void put_text(struct buffer *out, const char *text) { buffer_append(out, text, strlen(text) + 1); }

/* Length (to be filled in), kind, no focus, name. */
static void begin_packet(struct buffer *out, int kind, const char *name)
{
    put_number(out, 0, 4);
    put_number(out, (uint64_t)kind, 1);
    put_number(out, 0, 1);
    put_text(out, name);
}

static void put_channels(struct buffer *out, uint32_t channels)
{
    static const char *const names[] = {"R", "G", "B", "A"};

    put_number(out, channels, 4);
    for (uint32_t c = 0; c < channels; c++)
        put_text(out, names[c]);
}

static int end_packet(struct tev *tev, struct buffer *packet)
{
    int good;

    must_hold(packet);
    for (int i = 0; i < 4; i++)
        packet->data[i] = (uint8_t)(packet->size >> 8 * i);
    good = send_all(tev, packet);
    buffer_release(packet);
    return good;
}

static int send_create(struct tev *tev, const char *name, const struct image *image)
{
    struct buffer packet = BUFFER_INIT;

    begin_packet(&packet, CREATE_IMAGE, name);
    put_number(&packet, image->width, 4);
    put_number(&packet, image->height, 4);
    put_channels(&packet, image->channels);
    return end_packet(tev, &packet);
}

struct part {
    uint32_t x, y, width, height;
};

static const float *row_of(const struct image *image, const struct part *part, uint32_t row)
{
    return image->pixels + ((size_t)(part->y + row) * image->width + part->x) * image->channels;
}

static int send_part(struct tev *tev, const char *name, const struct image *image, const struct part *part)
{
    struct buffer packet = BUFFER_INIT;

    begin_packet(&packet, UPDATE_IMAGE_V3, name);
    put_channels(&packet, image->channels);
    put_number(&packet, part->x, 4);
    put_number(&packet, part->y, 4);
    put_number(&packet, part->width, 4);
    put_number(&packet, part->height, 4);
    for (uint32_t c = 0; c < image->channels; c++)
        put_number(&packet, c, 8); /* where a channel begins, in floats, ... */
    for (uint32_t c = 0; c < image->channels; c++)
        put_number(&packet, image->channels, 8); /* ... and how far its values are apart */
    for (uint32_t row = 0; row < part->height; row++)
        for (size_t i = 0; i < (size_t)part->width * image->channels; i++) {
            uint32_t bits;
            memcpy(&bits, row_of(image, part, row) + i, sizeof bits);
            put_number(&packet, bits, 4);
        }
    return end_packet(tev, &packet);
}

static int part_is_shown(const struct tev *tev, const struct image *image, const struct part *part)
{
    for (uint32_t row = 0; row < part->height; row++)
        if (memcmp(row_of(image, part, row), row_of(&tev->shown, part, row),
                   (size_t)part->width * image->channels * sizeof(float)) != 0)
            return 0;
    return 1;
}

static int send_parts(struct tev *tev, const char *name, const struct image *image)
{
    for (uint32_t y = 0; y < image->height; y += PART)
        for (uint32_t x = 0; x < image->width; x += PART) {
            const struct part part = {x, y, image->width - x < PART ? image->width - x : PART,
                                      image->height - y < PART ? image->height - y : PART};
            if (!(tev->shown.pixels && part_is_shown(tev, image, &part)) && !send_part(tev, name, image, &part))
                return 0;
        }
    return 1;
}

static int send_picture(struct tev *tev, const char *name, const struct image *image)
{
    if (!reach(tev))
        return 1; /* tried again with the next one */
    if (tev->shown.pixels && (strcmp(tev->shown_name, name) != 0 || tev->shown.width != image->width ||
                              tev->shown.height != image->height || tev->shown.channels != image->channels))
        image_release(&tev->shown);
    if (!tev->shown.pixels && !send_create(tev, name, image))
        return 0;
    return send_parts(tev, name, image);
}

void tev_show(struct tev *tev, const char *name, const struct image *image)
{
    struct error why = {0};
    size_t bytes = (size_t)image->width * image->height * image->channels * sizeof(float);

    tev->end_ns = clock_monotonic_ns() + PICTURE_MS * NS_PER_MS;
    if (!send_picture(tev, name, image)) {
        disconnect(tev);
        if (!send_picture(tev, name, image))
            disconnect(tev);
    }
    if (tev->fd < 0)
        return;
    if (!tev->shown.pixels && image_init(&tev->shown, image->width, image->height, image->channels, &why) != STATUS_OK)
        return; /* the next one is sent as a whole */
    snprintf(tev->shown_name, sizeof tev->shown_name, "%s", name);
    memcpy(tev->shown.pixels, image->pixels, bytes);
}

/* ---- a job's pictures --------------------------------------------------------------------- */

static status show_frame(struct tev *tev, struct connection *c, const Azulejo__Wire__JobInfo *info, uint32_t frame,
                         Azulejo__Wire__OutputKind kind, struct error *err)
{
    struct buffer exr = BUFFER_INIT;
    struct image image = {0};
    struct error why = {0};
    char job[128], name[NAME_MAX_BYTES];
    status result = fetch_output(c, info->job, frame, kind, &exr, &why);

    message_text(job, sizeof job, info->name);
    if (info->last_frame > info->first_frame)
        snprintf(name, sizeof name, "%s %04u", job, frame);
    else
        snprintf(name, sizeof name, "%s", job);
    if (result == STATUS_OK && exr_decode_alpha(&image, exr.data, exr.size, name, &why) == STATUS_OK)
        tev_show(tev, name, &image);
    image_release(&image);
    buffer_release(&exr);
    if (!reconnect_is_loss(result))
        return STATUS_OK; /* a frame without samples or an EXR, a coordinator that is busy: the job goes on without */
    return error_set(err, result, "%s", why.text);
}

status tev_update(void *user, struct connection *c, const Azulejo__Wire__JobInfo *info, struct error *err)
{
    struct tev *tev = user;
    int running = info->state == AZULEJO__WIRE__JOB_STATE__JOB_RUNNING;
    int done = info->state == AZULEJO__WIRE__JOB_STATE__JOB_DONE;
    uint64_t now = clock_monotonic_ns(), took;

    if (done || (running && tev->started && tev->frame != info->preview_frame))
        TRY(show_frame(tev, c, info, done ? info->last_frame : tev->frame, AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EXR, err));
    if (!running || !(info->preview_covered > 0))
        return STATUS_OK;
    tev->started = 1;
    tev->frame = info->preview_frame;
    if (now < tev->next_ns)
        return STATUS_OK;
    TRY(show_frame(tev, c, info, tev->frame, AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_EXR, err));
    took = clock_monotonic_ns() - now;
    tev->next_ns = now + (took * SHARE > INTERVAL_MS * NS_PER_MS ? took * SHARE : INTERVAL_MS * NS_PER_MS);
    return STATUS_OK;
}
