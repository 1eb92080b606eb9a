/* word: are a picture's figures reliable, or may they be understated, and why?
 *
 * There are two words. That of the display error asks how many pixels have been lit at all: what few pixels hold is by
 * construction outside of 95 %. That of the RMSE asks for light that few pixels, one group or no sample has met.
 *
 * The rules were chosen on one half of the seeds of `make accuracy` and hold on the other half (docs/ACCURACY.md). */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/accuracy/accuracy.h"
#include "common/scene/scene.h"

enum { ACCURACY_WORDS_SIZE = 256 };

/* The squared error, summed over a frame's channels, that one path would add which no sample has
 * met yet, over `squared_error`, the estimate of all. Such a path reaches the brightest light by a
 * mirror or through glass, where light sampling cannot reach: 0 unless caustics are active. With S
 * samples, a path of probability 1 / S is missed by every third picture. */
double word_unseen(const struct accuracy_evidence *evidence, double squared_error);

/* The radiance (largest channel) of the brightest light that a ray can meet by chance: emitting surfaces and the
 * environment; infinite if the scene does not say how bright its map is (older releases' do not). */
double accuracy_brightest(const struct scene *scene, double env_strength);

/* The reasons of each word. */
#define ACCURACY_DISPLAY_REASONS ((unsigned)ACCURACY_SPARSE)
#define ACCURACY_RMSE_REASONS ((unsigned)(ACCURACY_UNSEEN | ACCURACY_TOP | ACCURACY_DISAGREE))

/* Set reliable (the display error's word) and reasons from the rest. `evidence` may be NULL. */
void word_choose(struct accuracy_figures *figures, const struct accuracy_evidence *evidence);

/* "reliable", or "may be understated". */
const char *accuracy_word(const struct accuracy_figures *figures);
/* The RMSE's word. */
int accuracy_rmse_is_reliable(const struct accuracy_figures *figures);
const char *accuracy_rmse_word(const struct accuracy_figures *figures);

/* Why they may be understated, and the likely cause in the scene, in one sentence: "87 % of the squared error is in 0.1
 * % of the pixels; likely cause: caustics". "" if they are reliable. Returns `out`. */
const char *accuracy_reason_text(const struct accuracy_figures *figures, uint64_t effects,
                                 char out[ACCURACY_WORDS_SIZE]);
/* The same of the RMSE. */
const char *accuracy_rmse_reason_text(const struct accuracy_figures *figures, uint64_t effects,
                                      char out[ACCURACY_WORDS_SIZE]);

/* The likely cause of hidden noise, from the active effects. */
const char *accuracy_cause(uint64_t effects);
