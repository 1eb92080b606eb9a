/* flip: how different two pictures look when one is shown in place of the other (LDR-FLIP).
 *
 * After Andersson, Nilsson, Akenine-Moller, Oskarsson, Astrom, Fairchild, FLIP: A Difference Evaluator for Alternating
 * Images, HPG 2020: what the eye cannot resolve is filtered out, colours are compared in L*a*b* with the Hunt effect by
 * the HyAB distance, and edges and points that one picture alone has raise the difference.
 */
#pragma once

#include "common/base/status.h"
#include "common/image/image.h"

/* The authors' viewer: a monitor 0.7 m wide with 3840 pixels, seen from 0.7 m. */
#define FLIP_PIXELS_PER_DEGREE 67.0206432765823

/* The mean over the pixels, 0 (equal) to 1. Pictures of equal size as codes of sRGB, 0..255. ERR_NO_MEMORY. */
status flip_mean(double *out, const struct image *reference, const struct image *test, struct error *err) MUST_CHECK;
