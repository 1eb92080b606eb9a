/* against: the pictures of two seeds against a reference picture. */
#pragma once

#include "client/study/pair.h"

/* The mean of both, the better and the worse one. relmse is pbrt's, mean((a - b)^2 / (b^2 + 0.01)) with b the reference;
 * flip is of the pictures as shown (flip.h). ERR_INPUT: sizes differ. */
status against_reference(struct study_interval *relmse, struct study_interval *flip, const struct shown *shown,
                         const struct image *reference, const struct image *a, const struct image *b,
                         struct error *err) MUST_CHECK;
