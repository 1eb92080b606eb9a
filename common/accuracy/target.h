/* target: figures and targets as errors that a cost curve (curve.h) is made of.
 *
 * Codes of 255 and per cent are such errors; a PSNR is turned into the root mean squared error in codes.
 */
#ifndef AZULEJO_ACCURACY_TARGET_H
#define AZULEJO_ACCURACY_TARGET_H

#include "common/accuracy/allocate.h"
#include "common/accuracy/curve.h"
#include "common/accuracy/figures.h"

/* What a frame's figures are after this cost. Not known: an error that does not count. */
struct accuracy_point target_point(const struct accuracy_figures *figures, double cost,
                                   enum allocation_measure measure);
/* The error that the target asks for. */
double target_error(const struct allocation_target *target);

#endif
