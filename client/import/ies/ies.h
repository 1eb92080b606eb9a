/* ies: the light of luminaires as measured, in the files of IES LM-63 (1986 to 2019), of photometry of types C and B.
 *
 * The luminaire shines along -z, its length is x. Type C: the vertical angle is that from -z, the horizontal one turns
 * from x towards y. Type B: the vertical angle turns from -z towards x, the horizontal one leans from there to -y.
 * What is before and beyond the file's vertical angles is dark.
 */
#pragma once

#include <stddef.h>

#include "common/base/status.h"
#include "common/image/image.h"

/* *out: the distribution over the sphere as a lat-long picture of three equal channels, its largest value 1, whose pole at
 * the top is z and whose columns begin at -x and turn clockwise around z, as those of scene_light (LIGHT_GONIOMETRIC) in
 * ies_frame. *candela: what its 1 stands for, with the file's factors; 0: it does not shine. ERR_INPUT: the text is
 * damaged, with its line; ERR_UNSUPPORTED: type A; ERR_LIMIT; ERR_NO_MEMORY. The caller releases *out, after a failure too. */
status ies_read(struct image *out, double *candela, const void *data, size_t size_bytes, struct error *err) MUST_CHECK;

/* The picture's axes in the luminaire's: its y is z. As a unit quaternion x y z w. */
extern const double ies_frame[4];
