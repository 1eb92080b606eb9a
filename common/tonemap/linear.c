/* No curve: what is above 1 is cut off. For comparing, and for pictures that are display
 * referred already. */
#include "common/tonemap/operators.h"

static status linear_apply(const struct tonemap_frame *frame, const double *state,
                           struct error *err)
{
    (void)frame;
    (void)state;
    (void)err;
    return STATUS_OK;
}

const struct tonemap_operator tonemap_linear = {
    .name = "linear",
    .summary = "Exposure only: light is shown as it is and cut off at white.",
    .source = "IEC 61966-2-1 (the sRGB transfer function)",
    .apply = linear_apply,
};
