/* tonemap_pictures: pictures for tests of tone mapping, and what an operator makes of them. Every
 * function fails the test when something goes wrong. */
#pragma once

#include "common/image/image.h"
#include "common/tonemap/tonemap.h"

struct tonemap_settings tonemap_preset(const char *name);
void tonemap_preset_set(struct tonemap_settings *s, const char *parameter, double value);

struct image picture_grey(uint32_t width, uint32_t height, float value);
void picture_put(struct image *image, size_t x, size_t y, float value); /* a grey pixel */
float picture_at(const struct image *image, size_t x, size_t y);        /* its red */
/* Columns of these greys, so far apart by pixels that are not finite that no window of the log-mean sees two; the i-th
 * begins at i * PICTURE_STRIPE. */
enum { PICTURE_STRIPE = 18 };
struct image picture_stripes(const float *greys, size_t count);
/* The log-mean by its definition, in small steps; a pixel's limit exact. */
double picture_log_mean(const struct image *in);

/* With edges, slopes, noise and colours over five decades; one pixel is black. */
struct image picture_hard(uint32_t width, uint32_t height);

/* Display light, all of it within 0..1. */
struct image picture_light_threads(const struct image *in, const struct tonemap_settings *s, unsigned threads);
struct image picture_light(const struct image *in, const struct tonemap_settings *s);

/* One thread and three make the same bits of `in`, which is released. */
void picture_threads_agree(struct image *in, const struct tonemap_settings *s);

/* Tone maps `in` again and again, each time with one allocation more that succeeds: every failure is
 * told as such. Returns how many there were; `in` is released. */
int picture_out_of_memory(struct image *in, const struct tonemap_settings *s);
