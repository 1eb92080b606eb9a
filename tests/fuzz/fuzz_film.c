/* Records of a film on any bytes, with checks that are right, so that what they hold is read: the film takes what it can and
 * stays one that can be saved and read again. The input is records: a byte for the kind (128: a state as in memory, not yet
 * compressed), one for the tile, two for the payload's size, the payload. */
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "common/base/bytes.h"
#include "coordinator/film/store_film_parts.h"

enum { WIDTH = 20, HEIGHT = 18, SPP = 16, HEAD = 4, PLAIN_STATE = 128 };

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void records_of(const uint8_t *data, size_t size, const struct film *film, struct buffer *units, struct buffer *states)
{
    while (size >= HEAD) {
        const int is_plain = data[0] >= PLAIN_STATE;
        const enum film_record_kind kind = is_plain ? FILM_RECORD_TILE : FILM_RECORD_UNIT + data[0] % FILM_RECORD_EMPTY;
        const uint32_t tile = data[1] % (kind == FILM_RECORD_NOTE ? GROUPS : film_tile_count(film));
        size_t length = (size_t)data[2] | (size_t)data[3] << 8;
        uint8_t *at;
        data += HEAD;
        size -= HEAD;
        length = length < size ? length : size;
        length = kind == FILM_RECORD_NOTE && length > FILM_NOTE_MAX ? FILM_NOTE_MAX : length;
        at = film_record_add(is_plain ? states : units, kind, tile, length);
        if (!at)
            abort();
        memcpy(at, data, length);
        data += length;
        size -= length;
    }
}

static void load(const char *path, struct film *film)
{
    struct film_loader loader;
    struct error err = {0};
    uint64_t end;
    int fd = open(path, O_RDONLY | O_CLOEXEC);

    if (fd < 0 || film_loader_init(&loader, film, &err) != STATUS_OK ||
        film_log_scan(fd, path, film, film_loader_take, &loader, &end, &err) != STATUS_OK)
        abort();
    close(fd);
    film_loader_release(&loader);
}

/* What a film holds can be kept, and is the same again. */
static void keep(const struct film *film)
{
    struct film *again = film_new(WIDTH, HEIGHT, SPP);
    struct buffer state = BUFFER_INIT;
    struct error err = {0};

    for (uint32_t t = 0; again && t < film_tile_count(film); t++) {
        uint8_t *at;
        buffer_clear(&state);
        at = buffer_append_space(&state, film_tile_state_size(film, t));
        if (!at)
            abort();
        film_tile_save(film, t, at);
        if (film_tile_load(again, t, state.data, state.size, &err) != STATUS_OK ||
            film_tile_samples(again, t) != film_tile_samples(film, t))
            abort();
    }
    buffer_release(&state);
    film_free(again);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct film *film = film_new(WIDTH, HEIGHT, SPP);
    struct buffer units = BUFFER_INIT, states = BUFFER_INIT;
    struct error err = {0};
    char path[64];
    int fd = memfd_create("film", MFD_CLOEXEC);

    if (!film || fd < 0)
        abort();
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    records_of(data, size, film, &units, &states);
    if (film_records_pack(&units, &states, &err) != STATUS_OK)
        abort();
    film_records_seal(&units);
    if (film_write_at(fd, path, units.data, units.size, FILM_HEADER_SIZE, &err) != STATUS_OK)
        abort();
    load(path, film);
    keep(film);
    close(fd);
    film_free(film);
    buffer_release(&states);
    buffer_release(&units);
    return 0;
}
