/* owners: which worker and thread rendered each tile of a frame, as a legend, as JSON and as a picture.
 *
 * A tile whose units several workers sent belongs to the one with the most samples, and to that one's thread with
 * the most. Workers are sorted by name, so that they keep their colours from frame to frame.
 */
#pragma once

#include <stdio.h>

#include "client/link/connection.h"
#include "client/terminal/json.h"
#include "common/image/image.h"

enum { OWNERS_THREADS_MAX = 8192, OWNERS_SCALE_MAX = 64, OWNERS_NAME_MAX = 160, OWNERS_COLOR_WORDS = 32 };

struct owners_worker {
    char name[OWNERS_NAME_MAX];             /* on the farm; else host and process; else "not known" */
    const Azulejo__Wire__FrameWorker *wire; /* NULL: not known */
    uint32_t place;                         /* in the answer's workers, from 1; 0: not known */
    uint32_t tiles;                         /* that it owns */
    uint64_t units, samples;                /* of all tiles; samples of all their pixels */
    uint8_t color[3];                       /* sRGB */
    char color_words[OWNERS_COLOR_WORDS];
    uint32_t thread_count;
    uint8_t threads[OWNERS_THREADS_MAX / 8]; /* a bit for each that sent a unit; 0: not known */
};

/* Zero-initialise; release after a failure, too. */
struct owners {
    Azulejo__Wire__Envelope *answer;
    const Azulejo__Wire__FrameTiles *map; /* of the answer */
    struct owners_worker *workers;
    uint32_t worker_count;
    uint32_t tiles_empty, tiles_shared; /* without samples; of several workers */
    uint32_t tiles_cut;                 /* of large frames: smaller shares were left out */
    uint64_t samples;                   /* of all workers */
};

/* Ask for a frame that has begun. connection_ask's errors, which say what to do; ERR_PROTOCOL. */
status owners_get(struct connection *c, uint64_t job, uint32_t frame, struct owners *out, struct error *err) MUST_CHECK;
/* The same from an answer, which then belongs to `out`. */
status owners_take(struct owners *out, Azulejo__Wire__Envelope *answer, struct error *err) MUST_CHECK;
void owners_release(struct owners *owners);

/* The owner of a tile; NULL: it has no samples. */
const struct owners_worker *owners_of_tile(const struct owners *owners, uint32_t tile, uint32_t *thread);
/* The worker's colour; its threads are shades of it. */
void owners_thread_color(const struct owners_worker *worker, uint32_t thread, uint8_t out[3]);

/* The legend, to standard output. */
void owners_print(const struct owners *owners);
/* A new object with workers and tiles. NULL: no memory. */
json_t *owners_json(const struct owners *owners);

/* Each pixel of the frame is scale x scale of the picture; scale 0: so many that the longer side has 512 or more.
 * `over`: the frame's own picture, which then shines through (8 or 16 bits, 3 channels); NULL: none. ERR_LIMIT,
 * ERR_NO_MEMORY; ERR_PROTOCOL: `over` has another size. */
status owners_picture(struct image8 *out, const struct owners *owners, uint32_t scale, const struct image8 *over,
                      struct error *err) MUST_CHECK;

/* Write FILE.png or FILE.json. ERR_USAGE: it is neither. */
int owners_path_is_json(const char *path);
status owners_path_check(const char *path, struct error *err) MUST_CHECK;
status owners_write(const struct owners *owners, const char *path, uint32_t scale, const struct image8 *over,
                    struct error *err) MUST_CHECK;
