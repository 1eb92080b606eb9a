#include "common/math/quick.h"

#include "common/math/elementary.h"

void quick_init(struct quick *q)
{
    double ln2 = det_log_d(2.0);

    for (int i = 0; i < QUICK_PIECES; i++) {
        q->inverse[i] = 1.0 / (1.0 + (i + 0.5) / QUICK_PIECES);
        q->log2[i] = -det_log_d(q->inverse[i]) / ln2;
        q->exp2[i] = det_exp_d((double)i / QUICK_PIECES * ln2);
    }
}
