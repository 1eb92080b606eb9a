/* target: figures and targets as errors for a cost curve (curve.h).
 *
 * Codes of 255 and per cent are such errors; a PSNR is converted to the root mean squared error in codes.
 */
#pragma once

#include "common/accuracy/allocate.h"
#include "common/accuracy/curve.h"
#include "common/accuracy/figures.h"

/* A frame's figures after this cost. Not known: an error that does not count. */
struct accuracy_point target_point(const struct accuracy_figures *figures, double cost,
                                   enum allocation_measure measure);
/* The error that the target demands. */
double target_error(const struct allocation_target *target);
/* An error as the target's measure has it: a PSNR in dB. */
double target_value(const struct allocation_target *target, double error);
/* A picture misses its target if its error is more than so many times the target. */
#define TARGET_MISSED 1.1
