/* A film that is not open, tile by tile. */
#include "common/base/memory.h"
#include "coordinator/film/store_film_parts.h"

struct film_reader {
    FILE *kept;                  /* or NULL */
    struct film_file *work;      /* or NULL */
    struct film *film;
    uint8_t *bytes;              /* of one tile */
    uint32_t next;
};

/* ERR_NOT_FOUND of one file is none: the other may be there. */
static status find(status s)
{
    return s == STATUS_ERR_NOT_FOUND ? STATUS_OK : s;
}

status film_reader_open(struct film_reader **out, const char *kept_path, const char *work_path, uint64_t job,
                        uint32_t frame, const struct render_settings *settings, struct error *err)
{
    struct film_reader *r = mem_calloc(1, sizeof *r);
    size_t size;
    status s;

    *out = NULL;
    if (!r)
        return error_no_memory(err, "a film");
    r->film = film_new_aovs(settings->width, settings->height, settings->spp, settings->aovs);
    s = r->film ? find(film_kept_open(&r->kept, kept_path, job, frame, r->film, err)) : error_no_memory(err, "a film");
    if (s == STATUS_OK)
        s = find(film_file_look(&r->work, work_path, job, frame, r->film, err));
    if (s == STATUS_OK && !r->kept && !r->work)
        s = STATUS_ERR_NOT_FOUND; /* and `err` says so */
    if (s == STATUS_OK) {
        size = r->work ? film_file_tile_bytes(r->work) : film_tile_state_bound(r->film, 0); /* no tile is larger */
        r->bytes = mem_alloc(size);
        s = r->bytes ? STATUS_OK : error_no_memory(err, "a film");
    }
    if (s != STATUS_OK) {
        film_reader_close(r);
        return s;
    }
    *out = r;
    return STATUS_OK;
}

status film_reader_next(struct film_reader *r, uint32_t *tile, struct error *err)
{
    uint32_t passes[GROUPS];
    status s = STATUS_OK;

    if (r->next > 0)
        film_tile_unload(r->film, r->next - 1);
    if (r->next == film_tile_count(r->film))
        return STATUS_ERR_NOT_FOUND;
    *tile = r->next++;
    if (r->kept && !film_kept_read_tile(r->kept, r->film, *tile, r->bytes, passes, &s, err) && s == STATUS_OK) {
        fclose(r->kept); /* nothing can be found behind a state that is cut off */
        r->kept = NULL;
    }
    if (s == STATUS_OK && r->work)
        s = film_file_load_tile(r->work, r->film, *tile, r->bytes, err);
    return s;
}

const struct film *film_reader_film(const struct film_reader *r)
{
    return r->film;
}

void film_reader_close(struct film_reader *r)
{
    if (!r)
        return;
    if (r->kept)
        fclose(r->kept);
    film_file_close(r->work);
    film_free(r->film);
    mem_free(r->bytes);
    mem_free(r);
}
