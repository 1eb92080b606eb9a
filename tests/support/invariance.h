/* invariance: a scene that is written in two ways gives one picture.
 *
 * The picture is 48x48 pixels. What a case demands is one of
 *   INVARIANT_BITS      the same bits, with the same seed; few samples, which show as much as many;
 *   INVARIANT_ROUNDING  with the same seed nearly all pixels within a thousandth (samples take the
 *                       same random numbers, so only a path that rounding sends elsewhere may
 *                       differ), and what INVARIANT_NOISE demands;
 *   INVARIANT_NOISE     nothing but noise between the pictures of one seed: each channel of each
 *                       block of 8x8 pixels and of the whole picture, by Student's t of the difference. Its
 *                       variance is that between the two groups of each pixel, its degrees of freedom
 *                       Satterthwaite's. Much of the noise is that of both, so few samples do;
 *   INVARIANT_TURNED    the same where directions have other random numbers, so that nothing is gained
 *                       by one seed: between those of two seeds, by Welch's t, the reference of more samples.
 * The family-wise significance is INVARIANCE_SIGNIFICANCE over INVARIANCE_TESTS comparisons (Sidak),
 * more than all the programs test_invariance_* make together. Seeds are fixed.
 */
#pragma once

#include "tests/support/model_scenes.h"

enum invariance_level { INVARIANT_BITS, INVARIANT_ROUNDING, INVARIANT_NOISE, INVARIANT_TURNED };

#define INVARIANCE_SIGNIFICANCE 1e-4
enum { INVARIANCE_TESTS = 30000 };

/* Pictures of one model, the reference written in one way. */
struct invariance;

/* Arguments of the program: "--table" prints a table of what was compared in Markdown instead of judging
 * it, a number is the samples a pixel (default: 8 to 128). To be called before any other. */
void invariance_arguments(int argc, char **argv);

struct invariance *invariance_new(const char *scene, model_scene *model, const struct model_way *reference);
void invariance_free(struct invariance *inv);

/* The picture of `way` against the reference's; `what` names the way. Fails the running test. */
void invariance_check(struct invariance *inv, const char *what, const struct model_way *way,
                      enum invariance_level level);

/* Random rotation number `index`; with `mirrored`, x is turned over first. */
void invariance_turn(unsigned index, int mirrored, double out[3][3]);
