/* contrasts: what four replicates say about the error of their mean, pixel by pixel. Private to
 * common/accuracy; figures.h explains why. */
#ifndef AZULEJO_ACCURACY_CONTRASTS_H
#define AZULEJO_ACCURACY_CONTRASTS_H

#include "common/accuracy/figures.h"

enum { CONTRASTS = 3, ACCURACY_TILE = 16 };

/* One picture, and memory for what its contrasts look like. */
struct view {
    const struct accuracy_picture *picture;
    const struct accuracy_transform *transform;
    uint32_t across;
    float *half;      /* [pixels][3]: the mean with a contrast added or subtracted */
    float *mean;      /* [pixels][3]: the codes of the mean */
    float *codes;     /* [pixels][3]: of `half`, minus those of the mean */
};

/* Can an error be estimated: does every tile have two replicates of a group? */
int view_is_known(const struct accuracy_picture *p);
status view_init(struct view *v, const struct accuracy_picture *picture,
                 const struct accuracy_transform *transform, struct error *err) MUST_CHECK;
void view_release(struct view *v);

struct gathered {
    size_t pixels;
    double mean;                            /* of the frame's channels */
    double linear, linear_variance;         /* sum of the pixels' squared errors; of (it - real) */
    double mean_variance;                   /* of the frame's mean */
    double codes, codes_variance;
    double groups[2];                       /* the groups' own sums of squared errors times samples */
    float *errors[CONTRASTS];               /* [pixels]: largest channel's error in codes */
    float *squared;                         /* [pixels]: linear */
    float *lone;                            /* [pixels]: 1 where one replicate made all of the error, 0
                                             * where one contrast did */
    float *spread;                          /* [pixels]: standard deviation in codes */
};

status gathered_init(struct gathered *g, size_t pixels, struct error *err) MUST_CHECK;
void gathered_release(struct gathered *g);

/* Errors in linear radiance, and in display codes. */
void gather_linear(struct gathered *g, const struct view *a);
status gather_codes(struct gathered *g, struct view *a, struct error *err) MUST_CHECK;

/* The mean over the contrasts of a pixel's squared error in codes. */
double gathered_square(const struct gathered *g, size_t pixel);
/* The variance of a sum over pixels, estimated from three contrasts' values for one pixel: that of
 * (their mean - the real one). */
double contrasts_variance(const double x[CONTRASTS]);

#endif
