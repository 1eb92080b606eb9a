#include "client/import/builder/polygon.h"

#include <math.h>

#include "client/terminal/must.h"
#include "common/base/memory.h"

void polygon_scratch_release(struct polygon_scratch *scratch)
{
    mem_free(scratch->previous);
    mem_free(scratch->next);
    mem_free(scratch->flat);
    *scratch = (struct polygon_scratch){0};
}

/* Fill scratch->flat with the face as seen along the largest axis of its Newell normal, so that it
 * runs counter-clockwise; 0 when it has no normal. Coordinates are not scaled, so that the signs of
 * cross products are as exact as doubles allow. */
static int flatten(struct polygon_scratch *scratch, const float *positions, const uint32_t *corners, size_t count)
{
    double normal[3] = {0, 0, 0};
    int axis = 0, x, y;

    for (size_t i = 0; i < count; i++) {
        const float *a = positions + 3 * (size_t)corners[i];
        const float *b = positions + 3 * (size_t)corners[i + 1 < count ? i + 1 : 0];
        const float *o = positions + 3 * (size_t)corners[0];
        double p[3], q[3];
        for (int c = 0; c < 3; c++) {
            p[c] = (double)a[c] - (double)o[c];
            q[c] = (double)b[c] - (double)o[c];
        }
        for (int c = 0; c < 3; c++)
            normal[c] += p[(c + 1) % 3] * q[(c + 2) % 3] - p[(c + 2) % 3] * q[(c + 1) % 3];
    }
    for (int c = 1; c < 3; c++)
        if (fabs(normal[c]) > fabs(normal[axis]))
            axis = c;
    if (!(fabs(normal[axis]) > 0))
        return 0;
    x = (axis + 1) % 3;
    y = (axis + 2) % 3;
    if (normal[axis] < 0) {
        int swap = x;
        x = y;
        y = swap;
    }
    for (size_t i = 0; i < count; i++) {
        const float *p = positions + 3 * (size_t)corners[i];
        scratch->flat[2 * i] = (double)p[x];
        scratch->flat[2 * i + 1] = (double)p[y];
    }
    return 1;
}

/* Positive when the corner c lies to the left of the line from a to b. */
static double side(const double *flat, size_t a, size_t b, size_t c)
{
    const double *p = flat + 2 * a, *q = flat + 2 * b, *r = flat + 2 * c;

    return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
}

/* Does it turn left at every corner, and only once around? */
static int is_strictly_convex(const double *flat, size_t count)
{
    int turns = 0, last = 0, first = 0;

    for (size_t i = 0; i < count; i++) {
        size_t j = i + 1 < count ? i + 1 : 0, k = j + 1 < count ? j + 1 : 0;
        double along = flat[2 * j] - flat[2 * i];
        int sign = (along > 0) - (along < 0);
        if (!(side(flat, i, j, k) > 0))
            return 0;
        if (sign == 0)
            continue;
        if (!first)
            first = sign;
        turns += last != 0 && sign != last;
        last = sign;
    }
    turns += last != first;
    return turns <= 2;
}

static void fan(size_t count, uint32_t *out)
{
    for (uint32_t t = 0; t + 2 < count; t++) {
        out[3 * t] = 0;
        out[3 * t + 1] = t + 1;
        out[3 * t + 2] = t + 2;
    }
}

static int same_place(const double *flat, size_t a, size_t b)
{
    return flat[2 * a] == flat[2 * b] && flat[2 * a + 1] == flat[2 * b + 1];
}

/* No other corner lies in the triangle. Corners in the same place as one of its own do not count:
 * outlines with holes touch themselves. *budget decreases with each corner tested. */
static int is_empty_ear(const struct polygon_scratch *s, uint32_t ear, uint64_t *budget)
{
    uint32_t a = s->previous[ear], c = s->next[ear];

    for (uint32_t p = s->next[c]; p != a; p = s->next[p]) {
        if (*budget == 0)
            return 0;
        --*budget;
        if (side(s->flat, a, ear, p) < 0 || side(s->flat, ear, c, p) < 0 || side(s->flat, c, a, p) < 0)
            continue;
        if (!same_place(s->flat, p, a) && !same_place(s->flat, p, ear) && !same_place(s->flat, p, c))
            return 0;
    }
    return 1;
}

/* The first corner after `start` that can be cut off, or `left` if there is none. A straight corner
 * is cut only if there is no better one: its triangle has no area. */
static uint32_t find_ear(const struct polygon_scratch *s, uint32_t start, size_t left, uint64_t *budget, int *found)
{
    uint32_t at = start, straight = start;

    *found = 0;
    for (size_t i = 0; i < left && *budget; i++, at = s->next[at]) {
        double turn = side(s->flat, s->previous[at], at, s->next[at]);
        if (turn > 0 && is_empty_ear(s, at, budget)) {
            *found = 1;
            return at;
        }
        if (turn == 0 && !*found) {
            straight = at;
            *found = 1;
        }
    }
    return straight;
}

static void clip(struct polygon_scratch *s, size_t count, uint32_t *out)
{
    /* A simple outline tests each corner a few times for each cut. */
    uint64_t budget = 4 * (uint64_t)count * count;
    uint32_t at = 0;
    size_t left = count;

    for (uint32_t i = 0; i < count; i++) {
        s->next[i] = i + 1 < count ? i + 1 : 0;
        s->previous[i] = i ? i - 1 : (uint32_t)count - 1;
    }
    while (left > 3) {
        int found;
        uint32_t ear = find_ear(s, at, left, &budget, &found);
        if (!found) {
            s->fans++;
            break;
        }
        *out++ = s->previous[ear];
        *out++ = ear;
        *out++ = s->next[ear];
        s->next[s->previous[ear]] = s->next[ear];
        s->previous[s->next[ear]] = s->previous[ear];
        /* Skipping the next corner avoids a fan, and so slivers. */
        at = s->next[s->next[ear]];
        left--;
    }
    for (uint32_t b = s->next[at]; left > 2; left--, b = s->next[b]) {
        *out++ = at;
        *out++ = b;
        *out++ = s->next[b];
    }
}

void polygon_triangulate(struct polygon_scratch *scratch, const float *positions, const uint32_t *corners, size_t count,
                         uint32_t *out)
{
    if (count == 3) {
        fan(count, out);
        return;
    }
    MUST_GROW(scratch->flat, scratch->flat_capacity, 2 * count);
    MUST_GROW(scratch->next, scratch->next_capacity, count);
    MUST_GROW(scratch->previous, scratch->previous_capacity, count);
    if (!flatten(scratch, positions, corners, count) || is_strictly_convex(scratch->flat, count)) {
        fan(count, out);
    } else if (count > POLYGON_CLIP_CORNERS_MAX) {
        scratch->fans++;
        fan(count, out);
    } else {
        clip(scratch, count, out);
    }
}
