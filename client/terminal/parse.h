/* parse: the small languages of the command line. Pure functions of their text. */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"

/* "WxH" in pixels, each side 1..SETTINGS_SIZE_MAX, the whole at most SETTINGS_PIXELS_MAX; of `option`, as "--size".
 * ERR_USAGE. */
status parse_size(const char *option, const char *text, uint32_t *width, uint32_t *height, struct error *err) MUST_CHECK;

/* "X,Y,W,H" in pixels: the rectangle's upper left corner, counted from the picture's, and its size. ERR_USAGE. */
struct tile_rect;
status parse_region(const char *text, struct tile_rect *out, struct error *err) MUST_CHECK;

/* Decimal digits only (strtoul would also accept signs and blanks): their end; NULL if there are none
 * or the number is above `max`. */
const char *parse_digits(const char *text, uint64_t max, uint64_t *out);

/* "NAME=VALUE": the name's bytes into `name` (name_size includes the NUL), and the start of the
 * value, which is not empty. ERR_USAGE. */
status parse_parameter(const char *text, char *name, size_t name_size, const char **value,
                       struct error *err) MUST_CHECK;

/* "exr,png,jpg" in any order: bits of enum output_format. ERR_USAGE. */
status parse_formats(const char *text, unsigned *formats, struct error *err) MUST_CHECK;

/* "NAME[,NAME]...": effects to leave out (bits of common/scene/effects.h, those that may be switched off), added to
 * *set. An effect may be named by a part of its name that is unique. ERR_USAGE lists the names. */
status parse_effects(const char *text, uint64_t *set, struct error *err) MUST_CHECK;

/* A job's number as printed by submit. ERR_USAGE. */
status parse_job(const char *text, uint64_t *job, struct error *err) MUST_CHECK;

/* The default size of a picture: 720 rows at the camera's aspect (width / height), both even;
 * 1280x720 if the aspect is 0 (the camera has none) or invalid. */
void picture_size_default(float aspect, uint32_t *width, uint32_t *height);
