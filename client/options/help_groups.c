#include "client/options/help_groups.h"

#include <stddef.h>

#include "common/cli/options.h"

/* Of commands with more than OPTIONS_PLAIN_MAX options: in this order. */
static const struct option_group option_groups[] = {
    {"the usual options:", "output out name from quick minutes measure pixel sample frame operator preview size spp "
                          "target-error time-limit frames env camera without tonemap exposure workers threads web "
                          "follow watch tev coordinator json quiet verbose"},
    {"when a frame is done:", "core-limit max-rays allocation min-spp schedule-from effects by pilot-spp price currency"},
    {"the scene:", "scene variant animation light-units studio env-rotate env-strength allow-outside only-below strict max-image "
                  "max-image-memory"},
    {"camera and picture:", "first-middle-last fps shutter lens focus fit pixel-filter filter-width alpha region aov"},
    {"light and paths:", "max-depth seed sampler env-sampling light-choice roulette clamp texture-filter bvh-quality "
                        "robust isa"},
    {"tone mapping:", "tonemap-param lut auto-exposure percentile white-balance temporal denoise denoise-around"},
    {"files:", "format exr-names png-bits jpeg-quality no-dither half manifest video bits quality"},
    {"the job:", "priority after not-before require memory owner token force"},
    {"more:", ""},
    {NULL, NULL},
};

void help_groups_use(void) { options_group_help(option_groups); }
