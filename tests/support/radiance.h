/* radiance: pictures of small scenes against closed forms, by t-tests over independent frames.
 *
 * A comparison averages a picture per frame, channel by channel, and tests the frames' mean
 * by Student's t. The family-wise significance is RADIANCE_SIGNIFICANCE, Sidak-corrected over
 * `channels`, the number of channel comparisons that the calling program makes at most.
 * A failed comparison fails the running cmocka test.
 */
#pragma once

#include "tests/support/scene_builder.h"
#include "tests/support/statistics.h"

enum { RADIANCE_FRAMES = 24 };
#define RADIANCE_SIGNIFICANCE 0.01

/* Means over the picture's pixels of RADIANCE_FRAMES independent frames of a scene in which
 * nothing moves. */
void radiance_measure(struct scene_builder *b, const struct render_settings *settings, struct running_stats out[3]);

void radiance_expect_rgb(struct scene_builder *b, const struct render_settings *settings, unsigned channels,
                         const double expected[3], const char *what);

/* The same radiance in all channels: three comparisons. */
void radiance_expect(struct scene_builder *b, const struct render_settings *settings, unsigned channels,
                     double expected, const char *what);

/* Two scenes that must look the same, rendered with the same settings: three comparisons. */
void radiance_expect_same(struct scene_builder *a, struct scene_builder *b, const struct render_settings *settings,
                          unsigned channels, const char *what);

/* The same with settings of their own: the one that has less noise may do with fewer samples. */
void radiance_expect_same_at(struct scene_builder *a, const struct render_settings *at_a, struct scene_builder *b,
                             const struct render_settings *at_b, unsigned channels, const char *what);

/* One comparison: a value computed from each frame's mean picture [height][width][3]. */
typedef double radiance_measure_fn(const double *picture, const struct render_settings *settings, const void *user);
void radiance_expect_value(struct scene_builder *b, const struct render_settings *settings, unsigned comparisons,
                           radiance_measure_fn *measure, const void *user, double expected, const char *what);

/* One channel's mean against the closed form, as a figure (figure.h): by Student's t, at this program's
 * family-wise significance over `comparisons`. Samples that were dropped count as black. */
void radiance_figure(struct scene_builder *b, const struct render_settings *settings, unsigned comparisons, int channel,
                     double expected, const char *what);

/* Is the mean of one channel (or of all three) certainly another one? 1 when its t-test rejects
 * at a millionth: the counterpart that shows that a comparison can fail. */
int radiance_differs(struct scene_builder *b, const struct render_settings *settings, double expected);
