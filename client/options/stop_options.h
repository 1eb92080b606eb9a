/* stop_options: the options that say when a frame has enough samples, shared by render, submit and extend. */
#pragma once

#include "client/options/setting_option.h"
#include "common/accuracy/stop.h"
#include "common/scene/settings.h"

struct stop_options {
    int64_t spp;
    union setting_said said[STOP_COUNT];
};

#define STOP_SPP_ROW(o, spp_default)                                                                                   \
    {"spp", 'n', OPTION_INT, &(o).spp, "N", "samples a pixel, at most (default: " spp_default ")", 1, SETTINGS_SPP_MAX, NULL}
#define STOP_OPTION(o, name, ...) setting_option(&stop_rules_rows[STOP_##name], &(o).said[STOP_##name]),
#define STOP_SETTING_OPTION(o, KIND, type, name, ...) STOP_OPTION(o, name)
/* All of a new job's. Ends with a comma. */
#define STOP_OPTION_ROWS(o) STOP_RULES(STOP_OPTION, STOP_SETTING_OPTION, o)

/* The rules, and the cap for render_settings.spp; 0: none was given, and none is needed. ERR_USAGE. */
status stop_options_check(const struct stop_options *o, struct stop_rules *rules, uint32_t *spp,
                          struct error *err) MUST_CHECK;
