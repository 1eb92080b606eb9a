/* grain: how far pixels stand off their neighbourhood's mean, and which share of that is noise.
 *
 * Where few samples have met the light, the groups are black in most pixels, and half their difference shows less
 * error than there is: what no sample of a pixel has met, its neighbours have. So the picture is compared with its own
 * mean over 3x3 pixels, in codes. Content stands off that mean, too, but is in both groups: the product of their
 * deviations is content alone.
 * Private to common/accuracy; figures.c and docs/ACCURACY.md say when it counts.
 */
#pragma once

#include "common/accuracy/contrast.h"

struct grain {
    float *codes; /* [pixels]: off the neighbourhood's mean, largest channel */
    double noise; /* of the squares of these deviations, 0..1 */
};

/* ERR_NO_MEMORY. Release it in any case. */
status grain_make(struct grain *out, struct gathered *g, struct error *err) MUST_CHECK;
void grain_release(struct grain *grain);
