/* A film that is not open, tile by tile: where a tile's records are is found once. */
#include <unistd.h>

#include "common/base/memory.h"
#include "coordinator/film/store_film_parts.h"

enum { KEPT, WORK, FILES };

/* A record, in a list of its tile. */
struct place {
    uint64_t at;
    uint32_t kind, size;
    uint32_t next; /* 0: none, or the next one's number + 1 */
    uint32_t file;
};

struct film_reader {
    int fd[FILES]; /* negative: it is not there */
    char *path[FILES];
    struct film *film;
    struct film_loader loader;
    struct place *places;
    size_t count, capacity;
    uint32_t *first, *last; /* [tiles] as place.next */
    struct buffer bytes;    /* of a record */
    uint32_t next, finding; /* the tile; the file that is searched */
};

/* ERR_NOT_FOUND of one file is none: the other may be there. */
static status find(status s) { return s == STATUS_ERR_NOT_FOUND ? STATUS_OK : s; }

static status note_place(void *user, const struct film_record *record, struct error *err)
{
    struct film_reader *r = user;
    uint32_t *from;

    if (record->kind == FILM_RECORD_NOTE || !record->data)
        return STATUS_OK;
    if (r->count >= UINT32_MAX || !MEM_GROW(r->places, r->capacity, r->count + 1))
        return error_no_memory(err, "a film");
    r->places[r->count++] = (struct place){.at = record->at, .kind = record->kind, .size = (uint32_t)record->size,
                                           .file = r->finding};
    from = r->last[record->tile] ? &r->places[r->last[record->tile] - 1].next : &r->first[record->tile];
    *from = r->last[record->tile] = (uint32_t)r->count;
    return STATUS_OK;
}

static status find_places(struct film_reader *r, uint32_t file, struct error *err)
{
    uint64_t end;

    r->finding = file;
    return r->fd[file] < 0 ? STATUS_OK : film_log_scan(r->fd[file], r->path[file], r->film, note_place, r, &end, err);
}

static status open_files(struct film_reader *r, const char *kept_path, const char *work_path, uint64_t job,
                         uint32_t frame, struct error *err)
{
    status s;

    r->path[KEPT] = mem_strdup(kept_path);
    r->path[WORK] = mem_strdup(work_path);
    r->first = mem_calloc(film_tile_count(r->film), sizeof *r->first);
    r->last = mem_calloc(film_tile_count(r->film), sizeof *r->last);
    if (!r->path[KEPT] || !r->path[WORK] || !r->first || !r->last)
        return error_no_memory(err, "a film");
    s = film_loader_init(&r->loader, r->film, err);
    THEN(s, find(film_log_open(&r->fd[KEPT], kept_path, film_kept_magic, r->film, job, frame, err)));
    THEN(s, find(film_log_open(&r->fd[WORK], work_path, film_work_magic, r->film, job, frame, err)));
    if (s == STATUS_OK && r->fd[KEPT] < 0 && r->fd[WORK] < 0)
        return STATUS_ERR_NOT_FOUND; /* and `err` says so */
    THEN(s, find_places(r, KEPT, err));
    THEN(s, find_places(r, WORK, err));
    return s;
}

status film_reader_open(struct film_reader **out, const char *kept_path, const char *work_path, uint64_t job,
                        uint32_t frame, const struct render_settings *settings, struct error *err)
{
    struct film_reader *r = mem_calloc(1, sizeof *r);
    status s;

    *out = NULL;
    if (!r)
        return error_no_memory(err, "a film");
    r->fd[KEPT] = r->fd[WORK] = -1;
    r->film = film_new_aovs(settings->width, settings->height, settings->spp, settings->aovs);
    s = r->film ? open_files(r, kept_path, work_path, job, frame, err) : error_no_memory(err, "a film");
    if (s != STATUS_OK) {
        film_reader_close(r);
        return s;
    }
    *out = r;
    return STATUS_OK;
}

static status take_place(struct film_reader *r, const struct place *place, uint32_t tile, struct error *err)
{
    struct film_record record = {.kind = place->kind, .tile = tile, .size = place->size, .at = place->at};
    uint8_t *bytes;
    size_t got;
    status s;

    buffer_clear(&r->bytes);
    bytes = buffer_append_space(&r->bytes, place->size);
    if (!bytes)
        return error_no_memory(err, "a film");
    s = film_read_at(r->fd[place->file], r->path[place->file], bytes, place->size, place->at + FILM_RECORD_HEADER, &got,
                     err);
    record.data = got == place->size ? bytes : NULL;
    return s == STATUS_OK ? film_loader_take(&r->loader, &record, err) : s;
}

status film_reader_next(struct film_reader *r, uint32_t *tile, struct error *err)
{
    status s = STATUS_OK;

    if (r->next > 0)
        film_tile_unload(r->film, r->next - 1);
    if (r->next == film_tile_count(r->film))
        return STATUS_ERR_NOT_FOUND;
    *tile = r->next++;
    for (uint32_t n = r->first[*tile]; n > 0 && s == STATUS_OK; n = r->places[n - 1].next)
        s = take_place(r, &r->places[n - 1], *tile, err);
    return s;
}

const struct film *film_reader_film(const struct film_reader *r) { return r->film; }

void film_reader_close(struct film_reader *r)
{
    if (!r)
        return;
    for (int i = 0; i < FILES; i++) {
        if (r->fd[i] >= 0)
            close(r->fd[i]);
        mem_free(r->path[i]);
    }
    film_loader_release(&r->loader);
    film_free(r->film);
    buffer_release(&r->bytes);
    mem_free(r->places);
    mem_free(r->first);
    mem_free(r->last);
    mem_free(r);
}
