/* unit: the result of one work unit, as a film takes it.
 *
 * All of it is a pure function of the unit's name, the scene and the settings: two results of one
 * unit must be equal byte for byte, including the counts. Measurements (times) are not part of it.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/film/depth_light.h"
#include "common/film/health.h"
#include "common/film/tiles.h"

/* Counts of the work done. All that treats them alike follows from a row and its field of message Work
 * (docs/EXTENDING.md).
 * X(name, limit, attribute)
 *   name       the member, its field, and its key in JSON and manifests
 *   limit      no unit has more: SAMPLES, or STEPS (SAMPLE_COUNTS_MAX a sample)
 *   attribute  of an EXR's header; NULL: none */
#define WORK_COUNTERS(X)                                                                               \
    X(samples, SAMPLES, NULL)                                                                          \
    X(rays, STEPS, "azulejo:rays")                                                                     \
    X(vertices, STEPS, "azulejo:vertices")                                                             \
    /* Samples whose camera ray met a medium, or a surface that did not merely shine brighter than all \
     * that it reflects: neither the background nor a lamp seen directly. */                           \
    X(subject_samples, SAMPLES, NULL)                                                                  \
    /* Slipped through something closed: traced again. */                                              \
    X(leaked_rays, STEPS, "azulejo:leakedRays")                                                        \
    /* settings.clamp: scaled down. */                                                                 \
    X(clamped_samples, SAMPLES, NULL)                                                                  \
    /* Of the camera and of paths, which end so: met nothing. */                                       \
    X(escaped_rays, SAMPLES, "azulejo:escapedRays")

enum work_counter {
#define WORK_COUNTER(name, limit, attribute) WORK_##name,
    WORK_COUNTERS(WORK_COUNTER)
    WORK_COUNTER_COUNT,
    /* Films and unit_hash() have had these since film format 7. What a film has of later rows it says, and the
     * hash leaves them out: it stays comparable with those that are kept. */
    WORK_COUNTERS_FIRST = WORK_clamped_samples + 1,
};

/* Work done, and its faults. */
struct unit_work {
    union { /* by number, and by name */
        uint64_t count[WORK_COUNTER_COUNT];
        struct {
#define WORK_MEMBER(name, limit, attribute) uint64_t name;
            WORK_COUNTERS(WORK_MEMBER)
        };
    };
    HEALTH_COUNTERS;
    /* settings.clamp: sums over the samples of the luminance that they lost and of what was kept. 0 where
     * nothing is clamped. */
    double clamped_luminance, kept_luminance;
    struct depth_light depth;
};

void unit_work_add(struct unit_work *sum, const struct unit_work *more);
/* The health's examples stay (health_subtract). */
void unit_work_subtract(struct unit_work *sum, const struct unit_work *less);
/* The share of the light that clamping removed, 0..1. */
double unit_work_clamped_share(const struct unit_work *work);

/* A sample's contribution: its luminance, and the pixel of its tile (row-major). */
struct tail_entry {
    float value;
    uint16_t pixel, spare; /* spare is 0 */
};

/* The largest contributions, descending, ties by pixel; only positive ones. */
struct tail {
    uint32_t count; /* 0..TAIL_MAX */
    struct tail_entry entries[TAIL_MAX];
};

/* Contributions of one value must come in ascending pixels. */
void tail_insert(struct tail *tail, float value, uint32_t pixel);
static inline void tail_add(struct tail *tail, float value, uint32_t pixel)
{
    if (value > 0 && (tail->count < TAIL_MAX || value > tail->entries[TAIL_MAX - 1].value))
        tail_insert(tail, value, pixel);
}
/* Keep the largest of both: exact and associative. */
void tail_merge(struct tail *tail, const struct tail *more);
/* Are they in order, finite, positive, and of a tile with this many pixels? */
int tail_is_valid(const struct tail *tail, uint32_t pixels);

struct unit_name {
    uint32_t tile, group, pass;
};

/* From the thread that renders it to the film. */
struct unit_result {
    union { /* as one, and its parts */
        struct unit_name name;
        struct {
            uint32_t tile, group, pass;
        };
    };
    const float *sums; /* as tile_floats() with unit_aovs() */
    size_t count;
    struct tail tail;
    struct unit_work work;
};

/* Not cryptographic: it detects faults, not forgery. */
uint64_t unit_hash(const struct unit_result *unit);
uint64_t hash_bytes(const uint8_t *data, size_t size_bytes);
