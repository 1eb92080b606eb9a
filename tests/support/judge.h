/* judge: the figures of one picture of a calibration, beside what they claim to be. */
#pragma once

#include "common/accuracy/figures.h"
#include "common/tonemap/tonemap.h"
#include "tests/support/calibration.h"

struct judgement {
    struct accuracy_figures figures;
    double true_display, true_rmse, true_psnr; /* of this very picture */
    double true_all, true_part; /* of all pixels; of the worst part */
    uint32_t fireflies, found, wrong; /* that stand out of the truth; those of them that are told; told ones that are none */
    double exposure; /* ln: the log-mean by which it is shown, over the truth's */
    double cpu_s;
};

/* The picture, each group and the truth are shown by `look`, each metered by itself. */
void judge(struct judgement *out, const struct calibration *c, uint32_t seed, uint32_t level,
           const struct tonemap_settings *look);
