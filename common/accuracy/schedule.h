/* schedule: how many passes each tile and group of a picture has, as text for its header.
 *
 *   "1 97x61 1048576 <base64 of zlib of a byte for each tile, row-major, and group>"
 *
 * 1 is the version, 1048576 the cap (render_settings.spp), from which the short passes follow. A picture that the rules
 * alone would not reproduce has a schedule, and --schedule-from renders it again.
 */
#pragma once

#include <stdint.h>

#include "common/base/buffer.h"
#include "common/base/status.h"

/* The EXR attribute that holds it. */
#define SCHEDULE_ATTRIBUTE "azulejo:schedule"

/* Append the text of passes[tile_count * GROUPS]. ERR_NO_MEMORY. */
status schedule_encode(struct buffer *text, uint32_t width, uint32_t height, uint32_t spp, const uint8_t *passes,
                       struct error *err) MUST_CHECK;
/* Append the passes to `passes`. ERR_INPUT: damaged, of another version, or of passes beyond the cap. */
status schedule_decode(const char *text, uint32_t *width, uint32_t *height, uint32_t *spp, struct buffer *passes,
                       struct error *err) MUST_CHECK;
