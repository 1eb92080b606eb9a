#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <unistd.h>
#include <zstd.h>

#include "common/base/bytes.h"
#include "common/base/memory.h"
#include "coordinator/film/store_film_parts.h"

enum { RECORD_MAGIC = 0x4c525a41, /* "AZRL" */
       STATE_HEAD = 8,            /* of a compressed state: its bytes (64 bits) */
       STATE_LEVEL = 1,           /* zstd's: more costs time and gains 1 % */
       WINDOW_BYTES = 1 << 20, HOLE_BLOCK = 4096 };

/* ---- files ---------------------------------------------------------------------------------- */

static atomic_long fault_successes = -1;

void film_file_fault(long successes) { atomic_store(&fault_successes, successes); }

static int fault_hits(void)
{
    long left = atomic_load(&fault_successes);

    if (left < 0)
        return 0;
    if (left > 0) {
        atomic_store(&fault_successes, left - 1);
        return 0;
    }
    errno = ENOSPC;
    return 1;
}

status film_write_at(int fd, const char *path, const uint8_t *data, size_t size, uint64_t offset, struct error *err)
{
    while (size > 0) {
        ssize_t put = fault_hits() ? -1 : pwrite(fd, data, size, (off_t)offset);
        if (put < 0 && errno == EINTR)
            continue;
        if (put < 0)
            return error_set(err, STATUS_ERR_IO, "%s: cannot be written: %s", path, strerror(errno));
        data += put;
        offset += (uint64_t)put;
        size -= (size_t)put;
    }
    return STATUS_OK;
}

status film_read_at(int fd, const char *path, uint8_t *data, size_t size, uint64_t offset, size_t *got,
                    struct error *err)
{
    *got = 0;
    while (*got < size) {
        ssize_t n = pread(fd, data + *got, size - *got, (off_t)(offset + *got));
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0)
            return error_set(err, STATUS_ERR_IO, "%s: cannot be read: %s", path, strerror(errno));
        if (n == 0)
            break;
        *got += (size_t)n;
    }
    return STATUS_OK;
}

status film_header_make(uint8_t header[FILM_HEADER_SIZE], const char magic[8], const struct film *film, uint64_t job,
                        uint32_t frame, struct error *err)
{
    struct digest check;

    memcpy(header, magic, 8);
    bytes_put64(header + 8, film_width(film));
    bytes_put64(header + 16, film_height(film));
    bytes_put64(header + 24, film_aovs(film));
    bytes_put64(header + 32, job);
    bytes_put64(header + 40, frame);
    if (digest_of(&check, header, FILM_HEADER_FIELDS) != STATUS_OK)
        return error_set(err, STATUS_ERR_INTERNAL, "a film's header: no SHA-256");
    memcpy(header + FILM_HEADER_FIELDS, check.bytes, DIGEST_BYTES);
    return STATUS_OK;
}

status film_log_open(int *fd, const char *path, const char magic[8], const struct film *film, uint64_t job,
                     uint32_t frame, struct error *err)
{
    uint8_t wanted[FILM_HEADER_SIZE], found[FILM_HEADER_SIZE];
    size_t got = 0;
    status s = film_header_make(wanted, magic, film, job, frame, err);
    int is_same = 0;

    *fd = s == STATUS_OK ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    if (s == STATUS_OK && *fd < 0)
        s = error_set(err, errno == ENOENT ? STATUS_ERR_NOT_FOUND : STATUS_ERR_IO, "%s: cannot be opened: %s", path,
                      strerror(errno));
    THEN(s, film_read_at(*fd, path, found, sizeof found, 0, &got, err));
    is_same = s == STATUS_OK && got == sizeof found && memcmp(found, wanted, sizeof found) == 0;
    if (!is_same) /* a film in work that was kept as it is */
        THEN(s, film_header_make(wanted, film_work_magic, film, job, frame, err));
    if (s == STATUS_OK && !is_same && (got < sizeof found || memcmp(found, wanted, sizeof found) != 0))
        s = error_set(err, STATUS_ERR_NOT_FOUND, "%s: is not the frame's film", path);
    if (s != STATUS_OK && *fd >= 0) {
        close(*fd);
        *fd = s == STATUS_ERR_NOT_FOUND ? FILM_LOG_OTHER : -1;
    }
    return s;
}

/* ---- making records --------------------------------------------------------------------------- */

uint8_t *film_record_add(struct buffer *out, enum film_record_kind kind, uint32_t tile, size_t size)
{
    size_t length = film_record_length(size);
    uint8_t *at = buffer_append_space(out, length);

    if (!at) {
        out->failed = 0; /* it has what it had */
        return NULL;
    }
    memset(at + length - 8, 0, 8);
    bytes_put32(at, RECORD_MAGIC);
    bytes_put32(at + 4, (uint32_t)kind);
    bytes_put32(at + 8, tile);
    bytes_put32(at + 12, (uint32_t)size);
    return at + FILM_RECORD_HEADER;
}

int film_record_unit(struct buffer *out, const struct film_fold *fold)
{
    uint8_t *at = film_record_add(out, FILM_RECORD_UNIT, fold->unit->tile, film_unit_size(fold));

    if (at)
        film_unit_save(fold, at);
    return at != NULL;
}

int film_record_state(struct buffer *out, const struct film *film, uint32_t tile)
{
    uint8_t *at = film_record_add(out, FILM_RECORD_TILE, tile, film_tile_state_size(film, tile));

    if (at)
        film_tile_save(film, tile, at);
    return at != NULL;
}

void film_record_cost(struct buffer *records, size_t at, const struct film *film)
{
    struct film_record r;
    size_t next = at;

    if (film_records_next(records, &next, &r))
        film_unit_set_cost(film, r.tile, records->data + at + FILM_RECORD_HEADER);
}

int film_records_next(const struct buffer *records, size_t *at, struct film_record *out)
{
    const uint8_t *head;

    if (*at == records->size)
        return 0;
    head = records->data + *at;
    *out = (struct film_record){.kind = bytes_get32(head + 4), .tile = bytes_get32(head + 8),
                                .size = bytes_get32(head + 12), .data = head + FILM_RECORD_HEADER};
    *at += film_record_length(out->size);
    return 1;
}

void film_records_seal(struct buffer *records)
{
    struct film_record r;

    for (size_t at = 0, next = 0; film_records_next(records, &next, &r); at = next) {
        uint8_t *head = records->data + at;
        bytes_put64(head + 16, hash_bytes(r.data, r.size));
        bytes_put64(head + 24, hash_bytes(head, 24));
    }
}

/* Byte k of each 8 stands together with the others' byte k: the low bytes of doubles that are sums of floats are 0. */
static void spread_bytes(uint8_t *out, const uint8_t *in, size_t size)
{
    size_t words = size / 8;

    for (size_t k = 0; k < 8; k++)
        for (size_t i = 0; i < words; i++)
            out[k * words + i] = in[8 * i + k];
    memcpy(out + 8 * words, in + 8 * words, size % 8);
}

static void gather_bytes(uint8_t *out, const uint8_t *in, size_t size)
{
    size_t words = size / 8;

    for (size_t k = 0; k < 8; k++)
        for (size_t i = 0; i < words; i++)
            out[8 * i + k] = in[k * words + i];
    memcpy(out + 8 * words, in + 8 * words, size % 8);
}

static status pack_state(struct buffer *out, const struct film_record *state, ZSTD_CCtx *zstd, struct buffer *space,
                         struct error *err)
{
    size_t bound = ZSTD_compressBound(state->size), begin = out->size, got, length;
    uint8_t *spread, *at = film_record_add(out, FILM_RECORD_TILE, state->tile, STATE_HEAD + bound);

    buffer_clear(space);
    spread = buffer_append_space(space, state->size);
    if (!at || !spread)
        return error_no_memory(err, "a tile's state");
    spread_bytes(spread, state->data, state->size);
    got = ZSTD_compressCCtx(zstd, at + STATE_HEAD, bound, spread, state->size, STATE_LEVEL);
    if (ZSTD_isError(got))
        return error_no_memory(err, "a tile's state");
    length = film_record_length(STATE_HEAD + got);
    bytes_put64(at, state->size);
    bytes_put32(out->data + begin + 12, (uint32_t)(STATE_HEAD + got));
    memset(at + STATE_HEAD + got, 0, length - FILM_RECORD_HEADER - STATE_HEAD - got);
    out->size = begin + length;
    return STATUS_OK;
}

status film_records_pack(struct buffer *out, const struct buffer *states, struct error *err)
{
    struct buffer space = BUFFER_INIT;
    struct film_record r;
    ZSTD_CCtx *zstd;
    status s;

    if (states->size == 0)
        return STATUS_OK;
    zstd = ZSTD_createCCtx();
    s = zstd ? STATUS_OK : error_no_memory(err, "a tile's state");
    for (size_t at = 0; s == STATUS_OK && film_records_next(states, &at, &r);)
        s = pack_state(out, &r, zstd, &space, err);
    ZSTD_freeCCtx(zstd);
    buffer_release(&space);
    return s;
}

/* ---- reading ---------------------------------------------------------------------------------- */

/* Part of a file. */
struct window {
    int fd;
    const char *path;
    uint8_t *bytes;
    size_t capacity, size;
    uint64_t at;
};

/* The file's bytes from `at` on, `size` of them or NULL where it ends before. */
static status look_at(struct window *w, uint64_t at, size_t size, const uint8_t **out, struct error *err)
{
    status s = STATUS_OK;

    *out = NULL;
    if (at < w->at || at + size > w->at + w->size) {
        s = film_read_at(w->fd, w->path, w->bytes, w->capacity, at, &w->size, err);
        w->at = at;
    }
    if (s == STATUS_OK && at + size <= w->at + w->size)
        *out = w->bytes + (at - w->at);
    return s;
}

/* The payload's largest size. */
static size_t payload_bound(const struct film *film)
{
    return STATE_HEAD + ZSTD_compressBound(film_tile_state_bound(film, 0)); /* no tile is larger, nor a unit */
}

static int read_head(const uint8_t *head, const struct film *film, struct film_record *out)
{
    if (bytes_get32(head) != RECORD_MAGIC || bytes_get64(head + 24) != hash_bytes(head, 24))
        return 0;
    *out = (struct film_record){.kind = bytes_get32(head + 4), .tile = bytes_get32(head + 8),
                                .size = bytes_get32(head + 12)};
    return out->size <= payload_bound(film) &&
           (out->kind == FILM_RECORD_NOTE
                ? out->tile < GROUPS && out->size <= FILM_NOTE_MAX
                : out->kind >= FILM_RECORD_UNIT && out->kind <= FILM_RECORD_EMPTY && out->tile < film_tile_count(film));
}

/* Where there may be a record after `at`, where there is none. A record's begin is a multiple of 8. */
static uint64_t after_nothing(const struct window *w, uint64_t at)
{
    off_t data;

    if (at % HOLE_BLOCK != 0 || *(w->bytes + (at - w->at)) != 0)
        return at + 8;
    data = lseek(w->fd, (off_t)at, SEEK_DATA);
    return data > (off_t)at ? (uint64_t)data / 8 * 8 : at + 8;
}

struct damage {
    struct film_record *list;
    size_t count, capacity;
};

static status tell_damage(struct damage *d, status (*visit)(void *, const struct film_record *, struct error *),
                          void *user, struct error *err)
{
    status s = STATUS_OK;

    for (size_t i = 0; i < d->count && s == STATUS_OK; i++)
        s = visit(user, &d->list[i], err);
    d->count = 0;
    return s;
}

static status scan(struct window *w, const struct film *film,
                   status (*visit)(void *user, const struct film_record *record, struct error *err), void *user,
                   uint64_t *end, struct error *err)
{
    struct damage damage = {0}; /* behind what is good so far */
    uint64_t at = FILM_HEADER_SIZE;
    const uint8_t *head, *all;
    struct film_record r;
    status s;

    *end = at;
    for (;;) {
        s = look_at(w, at, FILM_RECORD_HEADER, &head, err);
        if (s != STATUS_OK || !head)
            break;
        if (!read_head(head, film, &r)) {
            at = after_nothing(w, at);
            continue;
        }
        s = look_at(w, at, film_record_length(r.size), &all, err);
        if (s != STATUS_OK)
            break;
        r.at = at;
        if (all && hash_bytes(all + FILM_RECORD_HEADER, r.size) == bytes_get64(all + 16)) {
            r.data = all + FILM_RECORD_HEADER;
            at += film_record_length(r.size);
            *end = at;
            s = tell_damage(&damage, visit, user, err);
            THEN(s, visit(user, &r, err));
            if (s != STATUS_OK)
                break;
        } else if (!MEM_GROW(damage.list, damage.capacity, damage.count + 1)) {
            s = error_no_memory(err, "a film");
            break;
        } else {
            damage.list[damage.count++] = r;
            at += FILM_RECORD_HEADER; /* its end may be what is damaged, or a hole */
        }
    }
    mem_free(damage.list);
    return s;
}

status film_log_scan(int fd, const char *path, const struct film *film,
                     status (*visit)(void *user, const struct film_record *record, struct error *err), void *user,
                     uint64_t *end, struct error *err)
{
    struct window w = {.fd = fd, .path = path, .capacity = film_record_length(payload_bound(film)) + WINDOW_BYTES};
    status s;

    *end = FILM_HEADER_SIZE;
    w.bytes = mem_alloc(w.capacity);
    s = w.bytes ? scan(&w, film, visit, user, end, err) : error_no_memory(err, "a film");
    mem_free(w.bytes);
    return s;
}

/* ---- into a film ------------------------------------------------------------------------------ */

status film_loader_init(struct film_loader *l, struct film *film, struct error *err)
{
    memset(l, 0, sizeof *l);
    l->film = film;
    for (int i = 0; i < 2; i++)
        l->bytes[i] = mem_alloc(film_tile_state_bound(film, 0)); /* no tile is larger */
    l->lost = mem_calloc(film_tile_count(film), 1);
    return l->bytes[0] && l->bytes[1] && l->lost ? STATUS_OK : error_no_memory(err, "a film");
}

void film_loader_release(struct film_loader *l)
{
    mem_free(l->lost);
    mem_free(l->bytes[1]);
    mem_free(l->bytes[0]);
}

uint32_t film_loader_lost(const struct film_loader *l)
{
    uint32_t lost = 0;

    for (uint32_t t = 0; t < film_tile_count(l->film); t++)
        lost += l->lost[t];
    return lost;
}

static status take_unit(struct film_loader *l, const struct film_record *r, struct error *err)
{
    enum film_unit_load result;
    status s = film_unit_load(l->film, r->tile, r->data, r->size, &result, err);

    l->lost[r->tile] |= s == STATUS_ERR_CORRUPT || (s == STATUS_OK && result == FILM_UNIT_GAP);
    return s == STATUS_ERR_CORRUPT ? STATUS_OK : s;
}

/* Does the state have at least the passes of the film? */
static int is_more(const uint32_t passes[GROUPS], const struct film *film, uint32_t tile)
{
    for (uint32_t g = 0; g < GROUPS; g++)
        if (passes[g] < film_tile_passes(film, tile, g))
            return 0;
    return 1;
}

static status take_state(struct film_loader *l, const struct film_record *r, struct error *err)
{
    uint64_t size = r->size > STATE_HEAD ? bytes_get64(r->data) : 0;
    uint32_t passes[GROUPS];
    status s;

    l->lost[r->tile] = 1;
    if (size < FILM_STATE_PREFIX || size > film_tile_state_bound(l->film, r->tile) ||
        ZSTD_decompress(l->bytes[0], size, r->data + STATE_HEAD, r->size - STATE_HEAD) != size)
        return STATUS_OK;
    gather_bytes(l->bytes[1], l->bytes[0], size);
    if (film_tile_peek(l->film, r->tile, l->bytes[1], size, passes, NULL) != STATUS_OK)
        return STATUS_OK;
    s = is_more(passes, l->film, r->tile) ? film_tile_load(l->film, r->tile, l->bytes[1], size, err) : STATUS_OK;
    l->lost[r->tile] = 0;
    return s;
}

status film_loader_take(void *loader, const struct film_record *r, struct error *err)
{
    struct film_loader *l = loader;
    status s = STATUS_OK;

    if (r->kind == FILM_RECORD_NOTE) {
        if (l->notes && r->data) {
            buffer_clear(&l->notes[r->tile]);
            buffer_append(&l->notes[r->tile], r->data, r->size);
            s = buffer_ok(&l->notes[r->tile]) ? STATUS_OK : error_no_memory(err, "a note");
        }
        return s;
    }
    if (r->kind == FILM_RECORD_EMPTY) {
        film_tile_unload(l->film, r->tile);
        l->lost[r->tile] = 0;
    } else if (!r->data)
        l->lost[r->tile] = 1;
    else
        s = r->kind == FILM_RECORD_UNIT ? take_unit(l, r, err) : take_state(l, r, err);
    for (uint32_t g = 0; g < GROUPS && l->durable; g++)
        l->durable[r->tile][g] = film_tile_passes(l->film, r->tile, g);
    return s;
}
