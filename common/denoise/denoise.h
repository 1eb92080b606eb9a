/* denoise: a picture with less noise from its two independent groups of samples, and the error of the result.
 *
 * Each group is filtered by itself: F_A is a mean of A's colours, F_B of B's, and the picture is O = (F_A + F_B) / 2.
 * The weights of F_A at a pixel may know everything except what B saw in that very pixel. Then
 *     (F_A - B)^2 + (F_B - A)^2 - (A - B)^2
 * has the mean of the two filters' squared errors whatever the noise is, so the error of O can be computed without
 * knowing the truth (mix.h). Two filters, means (joint.c) and fitted models (fit.h), and the raw picture are mixed so that this
 * error is least around each pixel.
 *
 * The same bits for any number of threads and on any machine: blocks of fixed size, no order of arrival, no functions
 * of libm. Pure functions, no I/O. */
#pragma once

#include "common/base/status.h"
#include "common/denoise/picture.h"

/* Nothing but the groups known (no albedo, no normal): weights come from colours alone. ERR_INPUT: no pixel, a value
 * that is not finite; ERR_NO_MEMORY; or what the transform returns. Takes 50 bytes a pixel and 1.8 MB a thread beyond
 * input and output. On failure the result is empty. */
status denoise(const struct denoise_input *input, const struct denoise_options *options, struct denoise_result *result,
               struct error *err) MUST_CHECK;
void denoise_result_release(struct denoise_result *result);

/* Raised when a denoised picture's bits change; in the header of EXR files. */
#define DENOISE_VERSION 2
