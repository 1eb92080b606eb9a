/* judge: the figures of one picture of a calibration, beside what they claim to be. */
#pragma once

#include "common/accuracy/figures.h"
#include "tests/support/calibration.h"

struct judgement {
    struct accuracy_figures figures;
    double true_display, true_rmse, true_psnr; /* of this very picture */
    double true_all, true_part; /* of all pixels; of the worst part */
    uint32_t fireflies, found, wrong; /* that stand out of the truth; those of them that are told; told ones that are none */
    double cpu_s;
};

/* sRGB, by the exposure that makes the reference's mean 0.18. */
void judge(struct judgement *out, const struct calibration *c, uint32_t seed, uint32_t level);
