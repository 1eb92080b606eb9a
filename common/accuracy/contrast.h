/* contrast: what two independent groups of samples say about the error of their mean, pixel by pixel.
 * Private to common/accuracy; figures.h explains why. */
#pragma once

#include "common/accuracy/accuracy.h"

enum { ACCURACY_TILE = 16 };

/* With C half the groups' difference and d the same of their codes. */
struct gathered {
    const struct accuracy_picture *picture;
    const struct accuracy_transform *transform;
    uint32_t width, height;
    size_t pixels;
    double mean, mean_variance;     /* of the frame's channels */
    double linear, linear_variance; /* sum of the pixels' C^2; of (it - the real one) */
    double codes, codes_variance;   /* the same in codes */
    double brighter[2];             /* the parts of `linear` where group 0 or 1 is brighter */
    float *squared;                 /* [pixels]: C^2, the channels' sum */
    float *error;                   /* [pixels]: largest channel's squared error in codes */
    float *spread;                  /* [pixels]: standard deviation in codes, for figures.c */
    uint8_t *fireflies;             /* [pixels]: 1 for each (fireflies.h) */
    size_t firefly_count;
    struct strip_memory { /* of the walks: */
        float *groups[2], *mean, *codes[3];
        unsigned coded; /* of a small picture, which is one strip that stays: the codes that are there, a bit each */
    } memory;
};

/* Do all tiles have samples of both groups? */
int contrast_is_known(const struct accuracy_picture *p);

/* All but `spread`. ERR_NO_MEMORY, or what the transform returns. Release it in any case. */
status gathered_make(struct gathered *out, const struct accuracy_picture *picture,
                     const struct accuracy_transform *transform, struct error *err) MUST_CHECK;
void gathered_release(struct gathered *g);

/* Lines of a picture with their neighbours, the strips in order from the top: lines first..first+count-1, of which
 * y..y+height-1 are the strip's own. */
enum { STRIP_LINES = 48 };
struct strip {
    uint32_t y, height, first, count;
};
/* The next strip; 0: there is none. Begin with one of height 0 at y 0. */
int strip_next(struct strip *s, uint32_t height);
/* Both groups' lines of a strip: out[2][STRIP_LINES + 2 lines][width][3], in `memory` or where they are. */
void gathered_lines(struct gathered *g, const struct strip *s, float *memory[2], const float *out[2]);

/* Which codes a visit reads: those of both groups and of their mean, a bit each. */
enum { CODES_OF_MEAN = 4, CODES_OF_ALL = 7 };
/* A strip's groups and the codes of both and of their mean (2), all from its first line on. */
typedef void gathered_visit(void *user, struct gathered *g, const struct strip *s, const float *const groups[2],
                            float *const codes[3]);
/* Visit all strips in order, or the whole picture as one where it is small, or codes depend on other pixels. ERR_NO_MEMORY,
 * or what the transform returns. */
status gathered_walk(struct gathered *g, unsigned codes, gathered_visit *visit, void *user, struct error *err) MUST_CHECK;

/* The mean over 3x3 pixels around (x, y) of every `stride`th value, added line by line; the values begin with line `first`. */
static inline double mean_around(const float *values, size_t stride, const struct gathered *g, uint32_t first,
                                 uint32_t x, uint32_t y)
{
    uint32_t left = x > 0 ? x - 1 : 0, right = x + 1 < g->width ? x + 1 : x;
    uint32_t top = y > 0 ? y - 1 : 0, bottom = y + 1 < g->height ? y + 1 : y;
    const float *line = values + ((size_t)(top - first) * g->width + left) * stride;
    size_t next = g->width * stride;
    double sum = 0;

    if (right - left == 2 && bottom - top == 2) { /* nearly always: without loops */
        for (int i = 0; i < 3; i++, line += next)
            sum = sum + (double)line[0] + (double)line[stride] + (double)line[2 * stride];
        return sum / 9;
    }
    for (uint32_t v = top; v <= bottom; v++, line += next)
        for (size_t u = 0; u <= right - left; u++)
            sum += (double)line[u * stride];
    return sum / ((right - left + 1) * (bottom - top + 1));
}

/* mean_around() of every `stride`th value of line y, for each of the `stride` channels: out[width][stride]. */
void means_of_line(const float *values, size_t stride, const struct gathered *g, uint32_t first, uint32_t y, double *out);
