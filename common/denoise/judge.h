/* judge: the error of a denoised picture. Private to common/denoise; denoise.h has the identity. */
#pragma once

#include "common/denoise/mix.h"

/* Fill result->figures. ERR_NO_MEMORY, or what the transform returns. */
status judge_result(const struct filtered *f, const struct denoise_options *options, struct denoise_result *result,
                    struct error *err) MUST_CHECK;
