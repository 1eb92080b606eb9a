/* debug_view: one sample's path, and a pixel's samples, for people and as JSON. */
#pragma once

#include <stdio.h>

#include "client/terminal/json.h"
#include "common/base/status.h"
#include "common/film/tiles.h"
#include "protocol/azulejo.pb-c.h"

/* A pixel's sample: what the film adds. */
struct debug_sample {
    uint32_t number;
    float added[3];
};

/* Largest luminance first; what is not a number before all. */
void debug_samples_sort(struct debug_sample *samples, size_t count);
/* To `out`, or as JSON for json_print, which takes it. */
void debug_samples_print(FILE *out, const struct debug_sample *samples, size_t count);
json_t *debug_samples_json(const struct debug_sample *samples, size_t count);

/* `result` has a path and was checked. `picture`: settings_rect. */
void debug_path_print(FILE *out, const struct debug_sample *sample, const Azulejo__Wire__RenderResult *result,
                      struct tile_rect picture);
json_t *debug_path_json(const struct debug_sample *sample, const Azulejo__Wire__RenderResult *result);
