#include "coordinator/pictures/stored_tiles.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/image/image.h"
#include "coordinator/pictures/develop.h"

struct stored_tiles {
    uint64_t job;
    uint32_t frame;
    int layer, opened;
    struct render_settings settings;
    double samples;           /* of a pixel, mean */
    struct film_reader *film; /* or NULL, */
    struct image image;       /* and then this */
    uint32_t next;            /* tile of the image */
};

/* Of a frame that is done, over its pixels. */
static double mean_samples(const struct job *job, uint32_t frame)
{
    for (size_t i = 0; i < job->cut_count; i++)
        if (job->cuts[i].frame == frame)
            return (double)job->cuts[i].coverage.samples / ((double)job->settings.width * job->settings.height);
    return job->settings.spp;
}

status stored_tiles_new(struct stored_tiles **out, const struct job *job, uint32_t frame, int layer, struct error *err)
{
    struct stored_tiles *t = mem_calloc(1, sizeof *t);

    *out = t;
    NEED(t, err, "a picture");
    t->job = job->id;
    t->frame = frame;
    t->layer = layer;
    t->settings = job->settings;
    t->samples = mean_samples(job, frame);
    return STATUS_OK;
}

void stored_tiles_free(struct stored_tiles *t)
{
    if (!t)
        return;
    film_reader_close(t->film);
    image_release(&t->image);
    mem_free(t);
}

int stored_tiles_are_exact(const struct stored_tiles *t) { return t->film != NULL; }

static status open_picture(struct stored_tiles *t, const struct store *store, struct error *err)
{
    status s;

    if (t->layer != LINEAR_PICTURE)
        return error_set(err, STATUS_ERR_NOT_FOUND,
                         "job %" PRIu64 ", frame %u: its film was not kept; its EXR file has the layer '%s' if "
                         "the job asked for it",
                         t->job, t->frame, linear_layer_name(t->layer));
    s = develop_read_picture(store, t->job, t->frame, &t->image, err);
    if (s == STATUS_OK && (t->image.width != t->settings.width || t->image.height != t->settings.height))
        s = error_set(err, STATUS_ERR_CORRUPT, "job %" PRIu64 ", frame %u: its picture has %u x %u pixels", t->job,
                      t->frame, t->image.width, t->image.height);
    return s;
}

static status open_any(struct stored_tiles *t, const struct store *store, struct error *err)
{
    status s = store_film_reader(store, t->job, t->frame, &t->settings, &t->film, err);

    if (s == STATUS_ERR_NOT_FOUND)
        s = open_picture(t, store, err);
    t->opened = s == STATUS_OK;
    return s;
}

static status film_next(struct stored_tiles *t, uint8_t record[LINEAR_RECORD_MAX], size_t *size, int *end,
                        struct error *err)
{
    uint32_t tile;
    status s = film_reader_next(t->film, &tile, err);

    *end = s == STATUS_ERR_NOT_FOUND;
    *size = s == STATUS_OK ? linear_tile(film_reader_film(t->film), tile, t->layer, record) : 0;
    return *end ? STATUS_OK : s;
}

static void image_next(struct stored_tiles *t, uint8_t record[LINEAR_RECORD_MAX], size_t *size, int *end)
{
    struct tile_rect rect;
    float pixels[TILE_PIXELS_MAX][4];

    *end = t->next == tile_count(t->image.width, t->image.height);
    *size = 0;
    if (*end)
        return;
    rect = tile_rect_of(t->image.width, t->image.height, t->next);
    for (uint32_t p = 0; p < rect.width * rect.height; p++) {
        size_t at = (size_t)(rect.y + p / rect.width) * t->image.width + rect.x + p % rect.width;
        memcpy(pixels[p], t->image.pixels + at * t->image.channels, 3 * sizeof(float));
        pixels[p][3] = NAN;
    }
    *size = linear_record(t->next++, rect.width, rect.height, t->samples, (const float(*)[4])pixels, record);
}

status stored_tiles_read(struct stored_tiles *t, const struct store *store, size_t bytes, struct buffer *out, int *end,
                         struct error *err)
{
    uint8_t record[LINEAR_RECORD_MAX];
    size_t size, before = out->size;
    status s = t->opened ? STATUS_OK : open_any(t, store, err);

    *end = 0;
    while (s == STATUS_OK && !*end && out->size - before < bytes) {
        if (t->film)
            s = film_next(t, record, &size, end, err);
        else
            image_next(t, record, &size, end);
        if (s == STATUS_OK)
            buffer_append(out, record, size);
    }
    if (s == STATUS_OK && !buffer_ok(out))
        s = error_no_memory(err, "a picture's tiles");
    return s;
}
