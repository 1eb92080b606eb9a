/* film: the accumulator of one frame, in double precision.
 *
 * A tile's two groups (tiles.h) are accumulated separately. In each group, passes are *folded* in
 * pass order up to the group's *wanted* number on that tile. A result that arrives early, or beyond
 * what is wanted, waits in memory. Wanted numbers only grow.
 *
 * A group that has *ended* keeps its picture. Passes wanted beyond that are only *watched*, for the
 * statistics of its levels, which decide about the other group. Watched passes are not part of a
 * tile's state on disk; they are rendered again.
 *
 *   nothing --pass 0 of every tile--> level 0 --film_freeze: how a display shows it--> passes after it
 *
 * Invariants:
 *  - a result that arrives again must equal the first byte for byte;
 *  - the film's contents are a function of which passes are folded, never of the order in which
 * they    arrived; a tile's state is independent of every other's;
 *  - nothing beyond level 0 of a group is folded before film_freeze of that group, so that the
 * picture    from which the display's parameters are measured is available again after a restart;
 *  - the sums of a short pass (one that the cap cuts) are kept separate from those of whole passes:
 * a    film with another cap drops them when it loads the tile.
 *
 * The mean of a pixel is the mean of its groups' means. The weights are fixed, since weights by
 * counts would be a bias. If one group has no sample, it is the other's mean.
 * The film owns its memory. Not thread-safe.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "common/film/levels.h"
#include "common/film/tiles.h"
#include "common/film/unit.h"

struct film;

enum film_merge_result {
    FILM_MERGED,    /* added, perhaps with early results that waited for it */
    FILM_WAITING,   /* kept until the passes before it arrive, or until it is wanted */
    FILM_DUPLICATE, /* was present already, with the same bytes */
    FILM_CONFLICT,  /* was present already, with other bytes: a fault to report */
};

/* NULL when out of memory. Pass 0 of every group is wanted. */
struct film *film_new(uint32_t width, uint32_t height, uint32_t spp);
/* The same, for results that hold these AOVs, too. */
struct film *film_new_aovs(uint32_t width, uint32_t height, uint32_t spp, uint32_t aovs);
void film_free(struct film *film);

/* Merge the result of one unit, sent by `deliverer` (a number, kept in the tile's log). ERR_INPUT:
 * tile, group, pass or count out of range, a value that is not finite, an invalid tail; the film is
 * unchanged. A duplicate of a folded pass is compared by unit_hash(). */
status film_merge(struct film *film, const struct unit_result *unit, uint32_t deliverer, enum film_merge_result *result,
                  struct error *err) MUST_CHECK;

/* Want the first `passes` passes of the group on the tile (at most all); results that waited for
 * this are folded. No effect if as many are wanted already. */
void film_want(struct film *film, uint32_t tile, uint32_t group, uint32_t passes);
/* Want only what is folded: the one way to want less, for a film in which nothing waits. */
void film_want_nothing(struct film *film);
void film_want_all(struct film *film); /* every pass that the cap allows */
/* What is wanted now is the group's final picture; passes wanted later are only watched. */
void film_end_group(struct film *film, uint32_t group);
/* How a display shows the group's pixels; `codes` is copied, NULL: not known. Folds the results that
 * waited for this. Only the first call has an effect. */
void film_freeze(struct film *film, uint32_t group, const struct film_codes *codes);
int film_is_frozen(const struct film *film, uint32_t group);
/* Leave out the statistics of levels below this one, from now on: nothing will be decided by them. 0 at first. */
void film_measure_from(struct film *film, uint32_t level);
/* Level 0 of the group is complete on all tiles, more passes are possible, and it is not frozen. */
int film_wants_freeze(const struct film *film, uint32_t group);

uint32_t film_width(const struct film *film);
uint32_t film_height(const struct film *film);
uint32_t film_spp(const struct film *film);
uint32_t film_aovs(const struct film *film);
uint32_t film_tile_count(const struct film *film);
uint32_t film_pass_count(const struct film *film, uint32_t group); /* that the cap allows */

/* How many passes of the group are folded (a prefix of the schedule), and wanted. */
uint32_t film_tile_passes(const struct film *film, uint32_t tile, uint32_t group);
uint32_t film_tile_wanted(const struct film *film, uint32_t tile, uint32_t group);
/* How many are folded or watched. */
uint32_t film_tile_seen(const struct film *film, uint32_t tile, uint32_t group);
/* How many passes of the tile wait. */
uint32_t film_tile_waiting(const struct film *film, uint32_t tile);
/* Units that are wanted, over all tiles and groups. */
uint64_t film_wanted(const struct film *film);
/* Has this unit arrived (folded or waiting)? */
int film_has(const struct film *film, uint32_t tile, uint32_t group, uint32_t pass);
/* Who delivered this unit; 0: it is not there. */
uint32_t film_deliverer(const struct film *film, uint32_t tile, uint32_t group, uint32_t pass);
/* Its unit_hash(); 0: it is not there. */
uint64_t film_unit_hash(const struct film *film, uint32_t tile, uint32_t group, uint32_t pass);
/* Note how the unit, which is folded or waits, was rendered: on which of the deliverer's threads (from 1; 0:
 * not known), in how much processor time. Kept with the tile's state; it is measured, so no picture depends
 * on it. No effect if the unit is not there. */
void film_note_cost(struct film *film, uint32_t tile, uint32_t group, uint32_t pass, uint32_t thread, uint64_t cpu_ns);
/* What is noted of a folded unit; 0: nothing. */
void film_cost(const struct film *film, uint32_t tile, uint32_t group, uint32_t pass, uint32_t *thread,
               uint64_t *cpu_ns);
/* Where a tile's picture comes from: of the newest pass, who delivered it; of all folded ones, the sum. */
struct film_origin {
    uint32_t units;             /* folded passes of both groups; 0: the rest is 0, too */
    uint32_t deliverer, thread; /* thread from 1; 0: not known */
    uint64_t cpu_ns;            /* to 4 digits; without those of which it is not known */
};
struct film_origin film_tile_origin(const struct film *film, uint32_t tile);
/* Samples per pixel folded into the tile: of both groups, and of one. */
uint32_t film_tile_samples(const struct film *film, uint32_t tile);
uint32_t film_group_samples(const struct film *film, uint32_t tile, uint32_t group);
/* Samples folded in over all pixels of the frame, and what the cap allows. */
uint64_t film_samples(const struct film *film);
uint64_t film_samples_total(const struct film *film);
/* Everything wanted is folded, apart from what is only watched. */
int film_complete(const struct film *film);
/* Every tile has at least one pass: a preview covers the frame. */
int film_covered(const struct film *film);

/* Work and faults of all that is folded, independent of the order of arrival. Its `depth` is weighted so that each
 * pixel counts alike. */
struct unit_work film_work(const struct film *film);
uint64_t film_rays(const struct film *film);
uint64_t film_tile_rays(const struct film *film, uint32_t tile, uint32_t group);
/* The share of the tile's samples that see the subject (subject_samples of unit.h), 0..1; 0 without samples. */
double film_tile_subject(const struct film *film, uint32_t tile);
/* The largest contributions to the group on the tile. */
void film_tail(const struct film *film, uint32_t tile, uint32_t group, struct tail *out);
/* The group's statistics at a level; 0: it has not reached it, or they were left out. */
int film_level(const struct film *film, uint32_t tile, uint32_t group, uint32_t level, struct film_level *out);
/* Every tile has the group's statistics at the level. */
int film_level_is_complete(const struct film *film, uint32_t group, uint32_t level);
/* A tile reached the level without statistics, so the level will never be complete. */
int film_level_is_skipped(const struct film *film, uint32_t group, uint32_t level);
int film_has_skipped(const struct film *film); /* any level */
/* Statistics that `film` left out and `other`, a film of the same frame, has. */
void film_take_levels(struct film *film, const struct film *other);
/* How a display shows the group, for another film (film_freeze); NULL: it is not known, or the group is not frozen. */
const struct film_codes *film_codes_of(const struct film *film, uint32_t group);
/* The mean over the tile's pixels, every eighth of them, of the squared error of the picture in codes, from the
 * difference of the groups: for people, not for decisions, which must not see both. NaN: it is not known. */
double film_tile_contrast(const struct film *film, uint32_t tile);

/* How many samples the frame's pixels have. */
struct film_coverage {
    uint64_t samples;            /* of all pixels together */
    uint32_t least, most;        /* of one pixel */
    uint32_t group_most;         /* of one pixel and group */
    uint32_t tiles, tiles_empty; /* all; those without any sample, which develop to black */
};
struct film_coverage film_coverage(const struct film *film);
/* How far the tiles' shares of their wanted samples differ: the standard deviation over tiles and groups of half their ln,
 * which is about what the picture's ln error is off that of a picture whose tiles are equally far. 0: a complete round, or a
 * complete pass without rounds. */
double film_unevenness(const struct film *film);
/* The share of the tiles that have samples, 0..1. */
double film_covered_share(const struct film *film);

/* ---- developing (film_develop.c) ---- */

/* The mean radiance of every pixel into rgb[height][width][3]; 0 if a pixel has no sample yet. */
void film_develop(const struct film *film, float *rgb);
/* One tile of the same picture. */
void film_develop_tile(const struct film *film, uint32_t tile, float *rgb);
/* The same of one group. */
void film_develop_group(const struct film *film, uint32_t group, float *rgb);
/* The same of lines y..y+height-1: out[height][width][3]. */
void film_group_rows(const struct film *film, uint32_t group, uint32_t y, uint32_t height, float *out);
/* A tile's means of one group, into its place in the picture out[height][width][3], to the bits of film_develop_group:
 * FILM_PICTURE, or an AOV of three channels that is a mean. Without samples, or the AOV, nothing is written. */
enum { FILM_PICTURE = -1 };
void film_group_tile(const struct film *film, uint32_t tile, uint32_t group, int aov, float *out);
/* The same, from `out` on, whose lines are `line` floats apart. */
void film_group_tile_at(const struct film *film, uint32_t tile, uint32_t group, int aov, float *out, size_t line);
/* How many floats of a pixel film_develop_aov() gives: those that workers send, 1 for AOV_SAMPLES, 3 for AOV_ERROR and AOV_VARIANCE;
 * 0 for AOV_MATTES. */
uint32_t film_aov_channels(enum aov aov);
/* The AOV's values for lines y..y+height-1 into out[channels][height][film width]; 0 if a pixel has
 * no sample yet. Means over the samples, or point samples. AOV_SAMPLES (samples of the pixel),
 * AOV_ERROR (standard error of the mean, from the difference of the groups; 0 if one has no sample) and its square
 * are available for every film; the others must be in its mask. `y` is a multiple of TILE_SIZE. */
void film_develop_aov(const struct film *film, enum aov aov, uint32_t y, uint32_t height, float *out);
/* One tile of the whole picture. */
void film_develop_tile_aov(const struct film *film, uint32_t tile, enum aov aov, float *out);

/* One of AOV_MATTES: which things the pixel of the tile shows (matte.h), and the share of its samples of each, weighted as
 * the picture's: 0..1, together at most 1. By rising number; returns how many. */
struct film_thing {
    uint32_t number;
    double share;
};
enum { FILM_THINGS_MAX = 2 * GROUPS * MATTE_SLOTS };
uint32_t film_things(const struct film *film, uint32_t tile, enum aov aov, uint32_t pixel,
                     struct film_thing out[FILM_THINGS_MAX]);
/* The samples of the frame that met something which is in no pixel's list. */
uint64_t film_things_lost(const struct film *film, enum aov aov);

/* One tile, [pixel, row-major]: the mean radiance, to the bits of film_develop, and the standard error of its
 * luminance (Rec. 709) from the difference of the groups; NaN: there is one only. 0: the tile has no samples. */
int film_tile_picture(const struct film *film, uint32_t tile, float (*out)[4]);
/* The same of an AOV, as film_develop_aov: channels that it has not are 0, and out[][3] is NaN. */
int film_tile_aov(const struct film *film, uint32_t tile, enum aov aov, float (*out)[4]);

/* Every pixel has a sample of each group. */
int film_has_groups(const struct film *film);

/* ---- a folded unit on disk (film_unit.c) ---- */

/* A unit that was folded. Nothing in it outlives the call. */
struct film_fold {
    const struct unit_result *unit;
    uint32_t deliverer, cost;       /* as the log has it (film_note_cost); 0: not noted yet */
    uint64_t hash;                  /* unit_hash() */
    const struct film_level *level; /* of the group, which this unit completes; NULL: none */
};
/* Tell `user` of each unit that is folded from now on, before the function that folds it returns; of what is loaded,
 * nothing. One listener. */
void film_on_fold(struct film *film, void (*fold)(void *user, const struct film_fold *fold), void *user);

/* The unit as bytes, little-endian, for film_unit_load. film_unit_set_cost takes its cost from the film, which
 * learns it after the fold. */
size_t film_unit_size(const struct film_fold *fold);
void film_unit_save(const struct film_fold *fold, uint8_t *out);
void film_unit_set_cost(const struct film *film, uint32_t tile, uint8_t *unit);

enum film_unit_load {
    FILM_UNIT_LOADED, /* folded; it is wanted from then on, frozen or not */
    FILM_UNIT_KNOWN,  /* the tile has it already */
    FILM_UNIT_GAP,    /* a pass before it is missing */
    FILM_UNIT_OTHER,  /* of another cap on samples */
};
/* ERR_CORRUPT: it is none of the film's; ERR_NO_MEMORY. The film is unchanged then, as by all but LOADED. */
status film_unit_load(struct film *film, uint32_t tile, const uint8_t *data, size_t size_bytes,
                      enum film_unit_load *result, struct error *err) MUST_CHECK;

/* ---- a tile's state on disk (film_state.c) ---- */

/* One tile's state as bytes, little-endian. Its length depends on what is folded; its bound depends
 * neither on that nor on the cap. Waiting passes are not part of it. film_tile_load refuses damaged
 * state (ERR_CORRUPT), drops the tile's waiting passes, and the short pass of another cap; what is
 * folded is wanted from then on. film_tile_length gives the length of the state that begins with
 * these bytes; 0: no state does. film_tile_peek only checks a state and gives its passes. */
enum { FILM_STATE_PREFIX = 8 };
size_t film_tile_state_size(const struct film *film, uint32_t tile);
size_t film_tile_state_bound(const struct film *film, uint32_t tile);
size_t film_tile_length(const uint8_t prefix[FILM_STATE_PREFIX]);
void film_tile_save(const struct film *film, uint32_t tile, uint8_t *out);
status film_tile_peek(const struct film *film, uint32_t tile, const uint8_t *data, size_t size_bytes,
                      uint32_t passes[GROUPS], struct error *err) MUST_CHECK;
status film_tile_load(struct film *film, uint32_t tile, const uint8_t *data, size_t size_bytes,
                      struct error *err) MUST_CHECK;
/* The tile has nothing any more, and takes no memory: of a film that is read tile by tile. */
void film_tile_unload(struct film *film, uint32_t tile);
