/* health: what went wrong with single samples, counted by kind.
 *
 * A counter is a row of HEALTH_MAP. Its number is on the wire, in films and in the store: new rows go to
 * the end, and with one PROTOCOL_VERSION, STATE_MAGIC and the film format rise. All else follows from
 * the row: struct, wire, film, JSON, header, sentences.
 *
 * Each counter knows its *first example*: the least by (frame, pass, tile, pixel, sample), so that it
 * is the same whatever the order in which results arrive. A sample's number counts both groups:
 * sample i of group g is number i * GROUPS + g.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/film/tiles.h"

/* X(NAME, name, attribute, limit, one, many, remedy)
 *   name       in JSON, and the member
 *   attribute  of an EXR's header; the example's has "First" behind it
 *   limit      no unit has more: SAMPLES, VALUES (floats of its result), STEPS (SAMPLE_COUNTS_MAX a sample)
 *   one, many  follow the number */
#define HEALTH_MAP(X)                                                                               \
    X(DROPPED_SAMPLES, dropped_samples, "azulejo:droppedSamples", SAMPLES,                          \
      "sample was not finite and counts as black", "samples were not finite and count as black",    \
      "look for extreme lights, scales and textures in the scene")                                  \
    X(NEGATIVE_SAMPLES, negative_samples, "azulejo:negativeSamples", SAMPLES,                       \
      "sample was negative and is kept", "samples were negative and are kept",                      \
      "look for negative colours in the scene; without any, report it as a fault")                  \
    X(CLAMPED_VALUES, clamped_values, "azulejo:clampedValues", VALUES,                              \
      "sum was more than a float holds and is cut", "sums were more than a float holds and are cut", \
      "make the lights darker")                                                                     \
    X(DROPPED_AOVS, dropped_aovs, "azulejo:droppedAovs", SAMPLES,                                   \
      "sample had output variables that were not finite and count as 0",                            \
      "samples had output variables that were not finite and count as 0",                           \
      "look for normals, texture coordinates and places that are no numbers")                       \
    X(BAD_DIRECTIONS, bad_directions, "azulejo:badDirections", STEPS,                               \
      "direction was not finite or not of length 1, and was given up",                              \
      "directions were not finite or not of length 1, and were given up",                           \
      "look for extreme scales and normals in the scene")                                           \
    X(BAD_DENSITIES, bad_densities, "azulejo:badDensities", STEPS,                                  \
      "density was not finite or not positive, and what it weighs is left out",                     \
      "densities were not finite or not positive, and what they weigh is left out",                 \
      "look for extreme sizes of lights and for extreme roughness")                                 \
    X(BAD_THROUGHPUTS, bad_throughputs, "azulejo:badThroughputs", STEPS,                            \
      "throughput was not finite, or a weight not finite or negative",                              \
      "throughputs were not finite, or weights not finite or negative",                             \
      "look for extreme colours and media in the scene")                                            \
    X(BAD_BASES, bad_bases, "azulejo:badBases", STEPS,                                              \
      "shading basis had an axis that was not of length 1, and its path ended",                     \
      "shading bases had axes that were not of length 1, and their paths ended",                    \
      "look for normals and tangents that are no numbers")                                          \
    X(LOST_BODIES, lost_bodies, "azulejo:lostBodies", STEPS,                                        \
      "ray left a closed body that it had not entered, or was in more than 16",                     \
      "rays left closed bodies that they had not entered, or were in more than 16",                 \
      "look for bodies that are thinner than floats keep apart, or overlap many times")             \
    X(CROWDED_PLACES, crowded_places, "azulejo:crowdedPlaces", STEPS,                               \
      "place had more faces in contact than can be crossed together",                               \
      "places had more faces in contact than can be crossed together",                              \
      "move the bodies that touch there apart")                                                     \
    X(GUARDED_PATHS, guarded_paths, "azulejo:guardedPaths", STEPS,                                  \
      "path was ended by a limit that only faulty scenes reach",                                    \
      "paths were ended by limits that only faulty scenes reach",                                   \
      "look for volumes that are entered again and again and never left")

enum health_kind {
#define HEALTH_ENUM(NAME, name, attribute, limit, one, many, remedy) HEALTH_##NAME,
    HEALTH_MAP(HEALTH_ENUM)
#undef HEALTH_ENUM
    HEALTH_KINDS
};

enum health_limit { HEALTH_LIMIT_SAMPLES, HEALTH_LIMIT_VALUES, HEALTH_LIMIT_STEPS };

struct health_row {
    const char *name, *attribute, *attribute_first, *one, *many, *remedy;
    enum health_limit limit;
};
extern const struct health_row health_rows[HEALTH_KINDS];

struct health {
    uint64_t count[HEALTH_KINDS];
    uint64_t first[HEALTH_KINDS]; /* health_key() of the first example; 0: none is known */
    uint32_t frame[HEALTH_KINDS]; /* of that example, in sums over frames; else 0 */
};

/* The counters of a struct by number (`health`) and by name, at the same place. */
#define HEALTH_MEMBER(NAME, name, attribute, limit, one, many, remedy) uint64_t name;
#define HEALTH_COUNTERS               \
    union {                           \
        struct health health;         \
        struct {                      \
            HEALTH_MAP(HEALTH_MEMBER) \
        };                            \
    }

struct health_place {
    uint32_t pass, tile, pixel; /* `pixel`: of the tile, row-major */
    uint32_t sample;            /* of the pixel, counting both groups */
};

/* Places as numbers in their order, never 0: pass, tile, pixel, sample from the highest bits on. */
enum { HEALTH_SAMPLE_BITS = 21, HEALTH_PIXEL_BITS = 8, HEALTH_TILE_BITS = 21, HEALTH_PASS_BITS = 8 };
uint64_t health_key(struct health_place place);
/* The place of a key. Returns 0, and *out is undefined, if the key is 0 or its pass is not below
 * PASSES_MAX; tile, pixel and sample are not checked against a picture. */
int health_place_of(uint64_t key, struct health_place *out);

/* Sums of counts, the lesser of both examples: exact in any order. */
void health_add(struct health *sum, const struct health *more);
/* Counts only: *sum must contain *less. The examples stay; a film finds the least one again among its tiles. */
void health_subtract(struct health *sum, const struct health *less);
/* Keep the lesser of this example and that of `kind`; a key of 0 is ignored. */
void health_example(struct health *health, enum health_kind kind, uint32_t frame, uint64_t key);
/* Mark all examples as this frame's. */
void health_of_frame(struct health *health, uint32_t frame);
/* Is anything counted? */
int health_is_ill(const struct health *health);

/* Is so much of it in a picture of `samples` samples that people can see it? Less is in JSON, header and manifest only. */
#define HEALTH_SHARE_TOLD 1e-5
int health_is_told(const struct health *health, enum health_kind kind, uint64_t samples);

enum { HEALTH_TEXT_SIZE = 256 };
/* "3 samples were not finite and count as black; first: pass 0, tile 12, pixel 33,40, sample 5" of a
 * picture (settings_rect). `with_frame`: the frame is named, too. Returns `out`. */
const char *health_text(char out[HEALTH_TEXT_SIZE], const struct health *health, enum health_kind kind,
                        struct tile_rect picture, int with_frame);
/* The example alone, "pass 0, tile 12, pixel 33,40, sample 5", with the pixel's place in the whole picture; ""
 * where none is known or the tile is outside the picture. Returns `out`. */
const char *health_first_text(char out[HEALTH_TEXT_SIZE], uint64_t key, struct tile_rect picture);
