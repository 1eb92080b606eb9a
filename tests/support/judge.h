/* judge: the figures of one picture of a calibration, beside what they claim to be. */
#ifndef AZULEJO_TESTS_JUDGE_H
#define AZULEJO_TESTS_JUDGE_H

#include "common/accuracy/figures.h"
#include "tests/support/calibration.h"

struct judgement {
    struct accuracy_figures figures;
    double true_display, true_rmse, true_psnr; /* of this very picture */
    double cpu_s;
};

/* sRGB, by the exposure that makes the reference's mean 0.18. */
void judge(struct judgement *out, const struct calibration *c, uint32_t seed, uint32_t level);

#endif
