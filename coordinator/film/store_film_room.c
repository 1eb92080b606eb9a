/* Which records of a film in work are not needed any more.
 *
 *   too large --the band with the most bytes--> cleaning: its tiles' states come, FILM_STALE_MAX with a commit
 *     --all of them on disk--> what the band has from before is given back, as holes --> too large, or not
 *
 * Records that follow each other and are of one band are one run: frames are rendered in the order of their tiles, so a
 * file has few, and its holes leave few extents. */
#include <fcntl.h>
#include <linux/falloc.h>
#include <string.h>

#include "common/base/memory.h"
#include "coordinator/film/store_film_parts.h"

enum {
    BAND_NEEDED = FILM_BANDS + 1, /* always: notes, and what empties a tile that the film of a done frame may have */
    HOLE_BLOCK = 4096,
    HOLE_MIN = 64 << 10, /* smaller ones wait for their neighbours */
};

static uint32_t band_begin(const struct film_room *room, uint32_t band)
{
    return (uint32_t)((uint64_t)room->tiles * band / FILM_BANDS);
}

static uint32_t band_of(const struct film_room *room, const struct film_record *r)
{
    uint32_t band = (uint32_t)((uint64_t)r->tile * FILM_BANDS / room->tiles);

    if (r->kind == FILM_RECORD_NOTE || r->kind == FILM_RECORD_EMPTY)
        return BAND_NEEDED;
    return band + (band + 1 < FILM_BANDS && r->tile >= band_begin(room, band + 1)) - (r->tile < band_begin(room, band));
}

void film_room_add(struct film_room *room, const struct film_record *r)
{
    uint64_t end = r->at + film_record_length(r->size);
    struct film_run *last = room->count > 0 ? &room->runs[room->count - 1] : NULL;
    uint32_t band = band_of(room, r);

    room->used += end - r->at;
    if (last && last->band == band && last->end == r->at && !(room->cleaning && last->end == room->begun))
        last->end = end;
    else if (MEM_GROW(room->runs, room->capacity, room->count + 1))
        room->runs[room->count++] = (struct film_run){r->at, end, band};
}

/* Make a hole of whole blocks. */
static int make_hole(struct film_room *room, int fd, uint64_t begin, uint64_t end)
{
    begin = (begin + HOLE_BLOCK - 1) / HOLE_BLOCK * HOLE_BLOCK;
    end = end / HOLE_BLOCK * HOLE_BLOCK;
    if (end < begin + HOLE_MIN || room->has_no_holes)
        return 0;
    room->has_no_holes =
        fallocate(fd, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, (off_t)begin, (off_t)(end - begin)) != 0;
    return !room->has_no_holes;
}

static void give_back(struct film_room *room, int fd)
{
    size_t kept = 0;

    for (size_t i = 0, after; i < room->count; i = after) {
        uint64_t bytes = 0;
        for (after = i; after < room->count && room->runs[after].band == FILM_BANDS &&
                        (after == i || room->runs[after].begin == room->runs[after - 1].end); after++)
            bytes += room->runs[after].end - room->runs[after].begin;
        if (after == i) {
            room->runs[kept++] = room->runs[after++];
        } else if (make_hole(room, fd, room->runs[i].begin, room->runs[after - 1].end)) {
            room->used -= bytes;
        } else {
            room->runs[kept++] = (struct film_run){room->runs[i].begin, room->runs[after - 1].end, FILM_BANDS};
        }
    }
    room->count = kept;
}

static void end_cleaning(struct film_room *room, int fd)
{
    for (size_t i = 0; i < room->count && room->runs[i].begin < room->begun; i++)
        if (room->runs[i].band == room->band)
            room->runs[i].band = FILM_BANDS;
    room->cleaning = 0;
    give_back(room, fd);
}

static void begin_cleaning(struct film_room *room, uint64_t end)
{
    uint64_t bytes[FILM_BANDS] = {0};

    for (size_t i = 0; i < room->count; i++)
        if (room->runs[i].band < FILM_BANDS)
            bytes[room->runs[i].band] += room->runs[i].end - room->runs[i].begin;
    room->band = 0;
    for (uint32_t b = 1; b < FILM_BANDS; b++)
        if (bytes[b] > bytes[room->band])
            room->band = b;
    room->cleaning = 1;
    room->next = band_begin(room, room->band);
    room->begun = end;
}

void film_room_step(struct film_room *room, int fd, uint64_t end, struct film_stale *stale)
{
    uint32_t left;

    if (room->cleaning && stale->first == room->next)
        room->next += stale->count;
    if (room->cleaning && room->next == band_begin(room, room->band + 1))
        end_cleaning(room, fd);
    if (!room->cleaning && room->used > room->limit && !room->has_no_holes)
        begin_cleaning(room, end);
    left = room->cleaning ? band_begin(room, room->band + 1) - room->next : 0;
    *stale = (struct film_stale){room->next, left < FILM_STALE_MAX ? left : FILM_STALE_MAX};
}
