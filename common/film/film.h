/* film: the accumulator of one frame, in double precision.
 *
 * Invariants:
 *  - a tile's passes are added in pass order; a result that arrives early waits in the
 *    film, one that arrives again must equal the first byte for byte;
 *  - so the film's contents are a function of which passes are in, never of the order in
 *    which they came;
 *  - one tile's state is independent of every other's.
 * The film owns its memory. Not thread-safe.
 */
#ifndef AZULEJO_FILM_FILM_H
#define AZULEJO_FILM_FILM_H

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "common/film/tiles.h"

struct film;

enum film_merge_result {
    FILM_MERGED,    /* added, perhaps with early ones that waited for it */
    FILM_WAITING,   /* kept until the passes before it arrive */
    FILM_DUPLICATE, /* was there already, and is the same */
    FILM_CONFLICT,  /* was there already, and differs: a fault to report */
};

/* NULL when out of memory. `spp` fixes the pass schedule. */
struct film *film_new(uint32_t width, uint32_t height, uint32_t spp);
/* The same, for results that hold these AOVs, too. */
struct film *film_new_aovs(uint32_t width, uint32_t height, uint32_t spp, uint32_t aovs);
void film_free(struct film *film);

/* Merge one tile result. `sums` is as in tiles.h, `count` its number of floats, which must fit the tile. ERR_INPUT: tile, pass or
 * count out of range or a value that is not finite; the film is unchanged. A duplicate of a pass
 * already folded in is compared by a 64-bit hash of its bytes, kept per tile and pass. */
status film_merge(struct film *film, uint32_t tile, uint32_t pass, const float *sums, size_t count,
                  enum film_merge_result *result, struct error *err) MUST_CHECK;

uint32_t film_width(const struct film *film);
uint32_t film_height(const struct film *film);
uint32_t film_spp(const struct film *film);
uint32_t film_aovs(const struct film *film);
uint32_t film_tile_count(const struct film *film);
uint32_t film_pass_count(const struct film *film);

/* How many passes of the tile are folded in (a prefix of the schedule). */
uint32_t film_tile_passes(const struct film *film, uint32_t tile);
/* How many early passes of the tile wait for one before them. */
uint32_t film_tile_waiting(const struct film *film, uint32_t tile);
/* Has this (tile, pass) arrived (folded in or waiting)? */
int film_has(const struct film *film, uint32_t tile, uint32_t pass);
/* Samples a pixel folded into the tile. */
uint32_t film_tile_samples(const struct film *film, uint32_t tile);
/* Samples folded in over all pixels of the frame, and the number when complete. */
uint64_t film_samples(const struct film *film);
uint64_t film_samples_total(const struct film *film);
int film_complete(const struct film *film);
/* Every tile has at least one pass: a preview covers the frame. */
int film_covered(const struct film *film);

/* How many samples the frame's pixels have. */
struct film_coverage {
    uint64_t samples;            /* of all pixels together */
    uint32_t least, most;        /* of one pixel */
    uint32_t tiles, tiles_empty; /* all; those without any sample, which develop to black */
};
struct film_coverage film_coverage(const struct film *film);

/* The mean radiance of every pixel into rgb[height][width][3]; 0 where nothing is yet. */
void film_develop(const struct film *film, float *rgb);

/* How many floats of a pixel film_develop_aov() gives: those that workers send, 1 for
 * AOV_SAMPLES, 3 for AOV_ERROR. */
uint32_t film_aov_channels(enum aov aov);
/* The AOV's values for lines y..y+height-1 into out[channels][height][film width]; 0 where nothing
 * is yet. Means over the samples; point-sampled ones as they are; AOV_SAMPLES (samples of the
 * pixel) and AOV_ERROR (standard error of the mean, from the two replicates; 0 with less than
 * two samples) are there whether the film was made for them or not, the others must be in its
 * mask. `y` is a multiple of TILE_SIZE. */
void film_develop_aov(const struct film *film, enum aov aov, uint32_t y, uint32_t height,
                      float *out);

/* The frame's estimated error, in pbrt's form of the relative mean squared error:
 * mean over pixels and channels of se^2 / (mean^2 + 0.01), where se^2 = (A-B)^2 / 4 from the
 * means A, B of the two replicates. NaN until every tile holds samples of both. */
double film_relative_mse(const struct film *film);

/* One tile's state as bytes, for the disk: fixed size for a given tile, little-endian.
 * Waiting passes are not part of it. film_tile_load refuses damaged state (ERR_CORRUPT) and
 * drops the tile's waiting passes; film_tile_peek only checks a state and tells its passes. */
size_t film_tile_state_size(const struct film *film, uint32_t tile);
void film_tile_save(const struct film *film, uint32_t tile, uint8_t *out);
status film_tile_peek(const struct film *film, uint32_t tile, const uint8_t *data,
                      size_t size_bytes, uint32_t *passes, struct error *err) MUST_CHECK;
status film_tile_load(struct film *film, uint32_t tile, const uint8_t *data, size_t size_bytes,
                      struct error *err) MUST_CHECK;

#endif
