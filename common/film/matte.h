/* matte: how many of a pixel's samples met which thing, an object or a material (docs/AOV.md: Cryptomatte).
 *
 * A thing is its number, from 1 on, as in AOV_OBJECT_ID and AOV_MATERIAL_ID; samples that met nothing are not counted.
 * A pixel's counts are MATTE_FLOATS numbers: the lost samples, then up to MATTE_SLOTS pairs of number and count, by
 * falling count, ties by number; pairs that are not used are 0. All are whole and at most 2^24 in a unit, so floats hold
 * them exactly. What has no slot is lost: always the smallest counts. Units are added in the order of passes, so the
 * result does not depend on the order in which they arrive, even where samples are lost.
 */
#pragma once

#include <stdint.h>

#include "common/scene/settings.h"

enum { MATTE_TALLY_MAX = 64 }; /* things that a unit's pixel counts; the samples of more are lost */

struct matte_count {
    uint32_t number, samples;
};

/* Counts while samples are taken. Begins with count = lost = 0. */
struct matte_tally {
    uint32_t count, lost;
    struct matte_count things[MATTE_TALLY_MAX];
};

/* A sample that met the thing. */
void matte_tally_add(struct matte_tally *tally, uint32_t number);
void matte_tally_get(const struct matte_tally *tally, double out[MATTE_FLOATS]);

/* Add a unit's counts. */
void matte_add(double sum[MATTE_FLOATS], const float more[MATTE_FLOATS]);
/* Are they those of a pixel with this many samples? */
int matte_is_valid(const float values[MATTE_FLOATS], uint32_t samples);
