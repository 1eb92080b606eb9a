/* stop_options: the options that say when a frame has enough samples, shared by render, submit and extend. */
#ifndef AZULEJO_CLIENT_STOP_OPTIONS_H
#define AZULEJO_CLIENT_STOP_OPTIONS_H

#include "common/accuracy/stop.h"
#include "common/base/options.h"
#include "common/scene/settings.h"

struct stop_options {
    int64_t spp, spp_min;
    const char *target, *time_limit, *core_limit, *allocation;
};

#define STOP_OPTION_ROWS(o, spp_default)                                                        \
    {"spp", 'n', OPTION_INT, &(o).spp, "N",                                                     \
     "samples a pixel, at most (default: " spp_default ")", 1, SETTINGS_SPP_MAX, NULL},         \
    {"target-error", 0, OPTION_STRING, &(o).target, "ERROR",                                    \
     "render until the picture's error is this small: 2/255 (95 % of the pixels are within this "  \
     "many display codes), 1% (of the frame's mean) or 45dB (PSNR)", 0, 0, NULL},                  \
    {"time-limit", 0, OPTION_STRING, &(o).time_limit, "TIME",                                   \
     "end each frame this long after its first lease, as in 90s, 10m, 2h", 0, 0, NULL},           \
    {"core-limit", 0, OPTION_STRING, &(o).core_limit, "TIME",                                   \
     "end each frame when all cores together have spent this long on it, as in 90s, 10m, 2h", 0,  \
     0, NULL}

#define ALLOCATION_OPTION_ROW(o)                                                                \
    {"allocation", 0, OPTION_CHOICE, &(o).allocation, "HOW",                                    \
     "which tiles get samples: those where they help most, or all the same (default: uniform "     \
     "with "                                                                                       \
     "--spp alone, else adaptive)", 0, 0, "adaptive|uniform"}

/* The rules, without spp_min, and the cap for render_settings.spp; 0: none was given, and none is
 * needed. ERR_USAGE. */
status stop_options_check(const struct stop_options *o, struct stop_rules *rules, uint32_t *spp,
                          struct error *err) MUST_CHECK;

#endif
