/* No curve: values above 1 are cut off. For comparison, and for pictures that are already display referred. */
#include "common/tonemap/operators.h"

static status linear_apply(const struct tonemap_frame *frame UNUSED, const double *state UNUSED, struct error *err UNUSED)
{
    return STATUS_OK;
}

const struct tonemap_operator tonemap_linear = {
    .name = "linear",
    .summary = "Exposure only: light is shown as it is and cut off at white.",
    .source = "IEC 61966-2-1 (the sRGB transfer function)",
    .apply = linear_apply,
};
