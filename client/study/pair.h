/* pair: the errors of pictures, from independent ones, without a reference.
 *
 * Pictures are compared as they are shown: through the job's exposure and tone mapping, whose measured
 * parameters are taken once from one picture (`shown`), in steps of an 8-bit screen (codes, of 255).
 *
 *   noise: for independent A and B of one setting, |A - B| / sqrt(2) has the size of one picture's error.
 *   word:  each picture is judged by its own two groups of samples, as everywhere (common/accuracy/word.h); what two
 *          pictures say holds where both are reliable.
 *   bias:  for A, B of one setting and A', B' of another, E[(A - A')(B - B')] is the square of the
 *          difference of their expectations, if (A, A') is independent of (B, B'). A and A' may share
 *          their random numbers, which then cancel.
 *
 * Intervals are 95 % ones: a jackknife over 20 random groups of pixels (pixels have numbers of their
 * own), Student's t with 19 degrees of freedom. Nothing here does I/O.
 */
#pragma once

#include "client/study/data/study_data.h"
#include "common/accuracy/figures.h"
#include "common/image/image.h"
#include "common/tonemap/tonemap.h"

enum { PAIR_GROUPS = 20 };

/* How all pictures of a study are shown. */
struct shown {
    const struct tonemap_settings *settings; /* not owned, like the operator's file */
    const struct buffer *file;
    struct tonemap_state state;
};

/* Take the operator's measurements on this picture. */
status shown_meter(struct shown *out, const struct image *picture, const struct tonemap_settings *settings,
                   const struct buffer *file, struct error *err) MUST_CHECK;
/* Codes 0..255, not rounded; `out` is initialised here. */
status shown_codes(const struct shown *shown, struct image *out, const struct image *in, struct error *err) MUST_CHECK;

/* The error of one of two pictures of equal cost. */
struct pair_error {
    struct study_interval codes; /* 95 % of the pixels are within this, largest of R, G, B */
    double rms_codes;            /* over pixels and channels */
    struct study_interval rmse;  /* of linear radiance, over the frame's mean */
};
/* `pixels`, if not NULL, gets each pixel's error in codes [height][width]. ERR_INPUT: sizes differ. */
status pair_error_of(struct pair_error *out, const struct shown *shown, const struct image *a, const struct image *b,
                     float *pixels, struct error *err) MUST_CHECK;

/* held[i]: the part of the squared linear error in the pixels[i] (a share) of the pixels with most of it. */
status pair_tail_of(double *held, const double *pixels, size_t count, const struct image *a, const struct image *b,
                    struct error *err) MUST_CHECK;

/* Of the figures of two pictures those that are trusted less: any that are not reliable, else those with
 * the larger share of the error in few pixels. */
const struct accuracy_figures *pair_judge(const struct accuracy_figures *a, const struct accuracy_figures *b);

/* The bias of a setting. */
struct pair_bias {
    /* The 95th percentile of a pixel's change, largest of R, G, B: that of the mean of A - A' and
     * B - B', less that of half their difference, which is noise alone (as squares). 0 at the
     * interval's low end where the RMS, which noise of no shape moves, may be 0. */
    struct study_interval codes;
    struct study_interval rms_codes; /* sqrt(mean (A-A')(B-B')), the channel where it is largest */
    double mean_change;              /* of the frame's mean, relative; NaN: black */
    int same;                        /* no pixel differs by a bit */
};
/* a, b: as usual; a2, b2: the other setting. `usual` is the best picture of the usual setting, at which
 * the transform's slopes are taken. */
status pair_bias_of(struct pair_bias *out, const struct shown *shown, const struct image *usual, const struct image *a,
                    const struct image *a2, const struct image *b, const struct image *b2,
                    struct error *err) MUST_CHECK;
/* The figure with the higher upper end: what a twentieth of the pixels or fewer show is in the RMS alone. */
struct study_interval pair_bias_worse(const struct pair_bias *bias);

/* (a + b) / 2; `out` is initialised here. */
status pair_mean(struct image *out, const struct image *a, const struct image *b, struct error *err) MUST_CHECK;

/* Student's t for a two-sided 95 % interval. */
double student_t95(unsigned degrees);
