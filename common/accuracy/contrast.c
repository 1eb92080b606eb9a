#include "common/accuracy/contrast.h"

#include <string.h>

#include "common/accuracy/fireflies.h"
#include "common/base/memory.h"
#include "common/base/safeguard.h"
#include "common/system/parallel.h"

enum { ALONE_MAX = 1 << 16, SMALL_MAX = 1 << 14 }; /* pixels: more are for all threads; of a picture that is one strip */

int contrast_is_known(const struct accuracy_picture *p)
{
    size_t tiles = (size_t)((p->width + ACCURACY_TILE - 1) / ACCURACY_TILE) * ((p->height + ACCURACY_TILE - 1) / ACCURACY_TILE);

    for (size_t i = 0; p->samples && i < tiles * 2; i++)
        if (p->samples[i] == 0)
            return 0;
    return 1;
}

/* Sums over a frame are in double: 2^24 additions of float lose a tenth of a frame's light. */
static double frame_add(double sum, float more)
{
    return SAFEGUARD(FRAME_DOUBLE) ? sum + (double)more : (double)((float)sum + more);
}

void gathered_release(struct gathered *g)
{
    mem_free(g->squared);
    mem_free(g->error);
    mem_free(g->spread);
    mem_free(g->fireflies);
    mem_free(g->memory.groups[0]); /* one allocation */
    memset(g, 0, sizeof *g);
}

/* ---- what is gathered ------------------------------------------------------------------------ */

/* The variance of a pixel's part of a sum of C^2, less the same of the real error. With X and Y the groups'
 * errors, C^2 - e^2 = -X Y, whose variance is V_A V_B; C has the variance (V_A + V_B) / 4. A normal C has
 * E C^4 = 3 V^2. `balance` is V_A V_B over the square of their mean. */
static double square_variance(double square, double balance) { return 4.0 / 3 * balance * square * square; }

/* Of groups whose variances are as 1 / n. */
static double balance_of(const struct accuracy_picture *picture, size_t pixel)
{
    size_t across = (picture->width + ACCURACY_TILE - 1) / ACCURACY_TILE;
    size_t tile = pixel / picture->width / ACCURACY_TILE * across + pixel % picture->width / ACCURACY_TILE;
    double a, b;

    if (!picture->samples)
        return 1;
    a = picture->samples[tile * 2];
    b = picture->samples[tile * 2 + 1];
    return 4 * a * b / ((a + b) * (a + b));
}

/* ---- strips ---------------------------------------------------------------------------------- */

int strip_next(struct strip *s, uint32_t height)
{
    s->y += s->height;
    if (s->y >= height)
        return 0;
    s->height = height - s->y < STRIP_LINES ? height - s->y : STRIP_LINES;
    s->first = s->y > 0 ? s->y - 1 : 0;
    s->count = s->y + s->height - s->first + (s->y + s->height < height);
    return 1;
}

static void strip_lines(const struct strip *s, const struct accuracy_picture *p, float *memory[2], const float *out[2])
{
    for (int g = 0; g < 2; g++) {
        out[g] = memory[g];
        if (p->groups[g])
            out[g] = p->groups[g] + (size_t)s->first * p->width * 3;
        else
            p->lines(p->user, g, s->first, s->count, memory[g]);
    }
}

static void mean_of(const float *a, const float *b, size_t count, float *mean)
{
    for (size_t i = 0; i < count; i++)
        mean[i] = (a[i] + b[i]) / 2;
}

/* ---- gathering ------------------------------------------------------------------------------- */

/* Pixels p..end-1, whose groups are a[0] and b[0] on. */
static void gather_linear(struct gathered *g, const float *a, const float *b, size_t p, size_t end)
{
    for (; p < end; p++, a += 3, b += 3) {
        double square = 0, sum = 0;
        for (size_t i = 0; i < 3; i++) {
            double c = ((double)a[i] - (double)b[i]) / 2;
            square += c * c;
            sum += c;
            g->mean = frame_add(g->mean, (a[i] + b[i]) / 2);
            g->brighter[c < 0] += c * c;
        }
        g->mean_variance += sum * sum;
        g->squared[p] = (float)square;
        g->linear += square;
        g->linear_variance += square_variance(square, balance_of(g->picture, p));
    }
}

/* Errors in display codes: what the mean looks like with C added and subtracted, which are the groups. */
static void gather_codes(struct gathered *g, const float *a, const float *b, const float *mean, size_t p, size_t end)
{
    for (; p < end; p++, a += 3, b += 3, mean += 3) {
        float most[2] = {0, 0};
        double square = 0;
        for (size_t i = 0; i < 3; i++) {
            float up = (a[i] - mean[i]) * (a[i] - mean[i]), down = (b[i] - mean[i]) * (b[i] - mean[i]);
            most[0] = up > most[0] ? up : most[0];
            most[1] = down > most[1] ? down : most[1];
            square += ((double)up + (double)down) / 2;
        }
        g->error[p] = (most[0] + most[1]) / 2;
        g->codes += square;
        g->codes_variance += square_variance(square, balance_of(g->picture, p));
    }
}

/* It is one strip, whose codes are made once. */
static int is_small(const struct gathered *g) { return g->pixels <= SMALL_MAX; }

static int memory_make(struct gathered *g, int whole)
{
    const size_t lines = whole || g->height < STRIP_LINES + 2 ? g->height : STRIP_LINES + 2, values = lines * g->width * 3;
    struct strip_memory *m = &g->memory;

    if (!m->groups[0])
        m->groups[0] = mem_alloc_array(values, 6 * sizeof *m->groups[0]);
    if (!m->groups[0])
        return 0;
    m->groups[1] = m->groups[0] + values;
    m->mean = m->groups[0] + 2 * values;
    for (size_t i = 0; i < 3; i++)
        m->codes[i] = m->groups[0] + (3 + i) * values;
    return 1;
}

/* Both groups of the whole picture; those that are given by lines are read once. 0: no memory. */
static int whole_groups(struct gathered *g, const float *groups[2])
{
    const struct strip all = {.height = g->height, .count = g->height};
    struct strip_memory *m = &g->memory;
    const int reads = !m->groups[0];

    if (!memory_make(g, 1))
        return 0;
    groups[0] = m->groups[0];
    groups[1] = m->groups[1];
    if (reads || g->picture->groups[0])
        strip_lines(&all, g->picture, m->groups, groups);
    return 1;
}

void gathered_lines(struct gathered *g, const struct strip *s, float *memory[2], const float *out[2])
{
    if (!is_small(g) || !whole_groups(g, out)) {
        strip_lines(s, g->picture, memory, out);
        return;
    }
    for (int i = 0; i < 2; i++)
        out[i] += (size_t)s->first * g->width * 3;
}

/* One line of each picture at a time. */
struct coding {
    const struct accuracy_transform *transform;
    uint32_t width;
    unsigned wanted; /* of the three, a bit each */
    const float *rgb[3];
    float *const *codes;
};

static void code_lines(void *user, size_t begin, size_t end)
{
    const struct coding *c = user;
    const size_t values = (size_t)c->width * 3;

    for (size_t y = begin; y < end; y++)
        for (int i = 0; i < 3; i++)
            if (c->wanted >> i & 1)
                c->transform->codes(c->transform->user, i, c->rgb[i] + y * values, c->width, c->codes[i] + y * values);
}

static status measure_small(struct gathered *g, struct error *err)
{
    const struct accuracy_transform *t = g->transform;
    const float *pictures[3];
    status s = STATUS_OK;

    if (!whole_groups(g, pictures))
        return error_no_memory(err, "the figures of a picture's error");
    mean_of(pictures[0], pictures[1], g->pixels * 3, g->memory.mean);
    pictures[2] = g->memory.mean;
    for (int i = 0; s == STATUS_OK && i < 3; i++)
        s = t->measure(t->user, i, pictures[i], g->width, g->height, err);
    return s;
}

/* Have the transform measure each of the three pictures, one after the other. */
static status measure_pictures(const struct gathered *g, const struct accuracy_transform *t, struct error *err)
{
    const struct accuracy_picture *p = g->picture;
    const size_t values = g->pixels * 3;
    float *whole = mem_alloc_array(values, sizeof *whole), *line = mem_alloc_array(g->width, 3 * sizeof *line);
    status s = whole && line ? STATUS_OK : error_no_memory(err, "the figures of a picture's error");

    for (int i = 0; s == STATUS_OK && i < 3; i++) {
        const float *rgb = whole;
        if (i < 2 && p->groups[i])
            rgb = p->groups[i];
        else if (i < 2)
            p->lines(p->user, i, 0, g->height, whole);
        else if (p->groups[0])
            mean_of(p->groups[0], p->groups[1], values, whole);
        for (uint32_t y = 0; i == 2 && !p->groups[0] && y < g->height; y++) { /* `whole` has group 1 */
            float *to = whole + (size_t)y * g->width * 3;
            p->lines(p->user, 0, y, 1, line);
            mean_of(line, to, (size_t)g->width * 3, to);
        }
        s = t->measure(t->user, i, rgb, g->width, g->height, err);
    }
    mem_free(line);
    mem_free(whole);
    return s;
}

/* The strip's codes of the pictures `wanted`. */
static void code_strip(struct gathered *g, const struct strip *s, const float *const groups[2], unsigned wanted)
{
    const struct accuracy_transform *t = g->transform;
    const struct strip_memory *m = &g->memory;
    struct coding coding = {.transform = t, .width = g->width, .wanted = wanted,
                            .rgb = {groups[0], groups[1], m->mean}, .codes = m->codes};

    mean_of(groups[0], groups[1], (size_t)s->count * g->width * 3, m->mean);
    parallel_for(t->threads ? t->threads : g->pixels <= ALONE_MAX ? 1 : 0, s->count, 4, code_lines, &coding);
}

static status code_whole(struct gathered *g, const float *const groups[2], unsigned wanted, struct error *err)
{
    const struct accuracy_transform *t = g->transform;
    struct strip_memory *m = &g->memory;
    const float *pictures[] = {m->mean, groups[0], groups[1]};
    status s = STATUS_OK;

    mean_of(groups[0], groups[1], g->pixels * 3, m->mean);
    for (int i = 0; i < 3; i++)
        if (wanted >> (i + 2) % 3 & 1)
            THEN(s, t->apply(t->user, pictures[i], g->width, g->height, m->codes[(i + 2) % 3], err));
    return s;
}

/* The picture as one strip. */
static status walk_whole(struct gathered *g, unsigned codes, gathered_visit *visit, void *user, struct error *err)
{
    const struct strip all = {.height = g->height, .count = g->height};
    struct strip_memory *m = &g->memory;
    const float *groups[2] = {NULL, NULL};
    status s = whole_groups(g, groups) ? STATUS_OK : error_no_memory(err, "the figures of a picture's error");
    unsigned wanted = codes & ~m->coded;

    if (s == STATUS_OK && wanted && g->transform->measure)
        code_strip(g, &all, groups, wanted);
    else if (s == STATUS_OK && wanted)
        s = code_whole(g, groups, wanted, err);
    if (s == STATUS_OK)
        visit(user, g, &all, groups, m->codes);
    m->coded |= wanted;
    if (s == STATUS_OK && is_small(g))
        return s;
    mem_free(m->groups[0]);
    *m = (struct strip_memory){0};
    return s;
}

static status walk_strips(struct gathered *g, unsigned codes, gathered_visit *visit, void *user, struct error *err)
{
    struct strip strip = {0};

    if (!memory_make(g, 0))
        return error_no_memory(err, "the figures of a picture's error");
    while (strip_next(&strip, g->height)) {
        const float *groups[2];
        strip_lines(&strip, g->picture, g->memory.groups, groups);
        code_strip(g, &strip, groups, codes);
        visit(user, g, &strip, groups, g->memory.codes);
    }
    return STATUS_OK;
}

status gathered_walk(struct gathered *g, unsigned codes, gathered_visit *visit, void *user, struct error *err)
{
    return g->transform->measure && !is_small(g) ? walk_strips(g, codes, visit, user, err)
                                                 : walk_whole(g, codes, visit, user, err);
}

/* `user`: marks for a strip's lines. */
static void gather(void *user, struct gathered *g, const struct strip *s, const float *const groups[2],
                   float *const codes[3])
{
    const size_t skip = (size_t)(s->y - s->first) * g->width, p = (size_t)s->y * g->width,
                 own = (size_t)s->height * g->width;
    uint8_t *marks = user;

    gather_linear(g, groups[0] + skip * 3, groups[1] + skip * 3, p, p + own);
    gather_codes(g, codes[0] + skip * 3, codes[1] + skip * 3, codes[2] + skip * 3, p, p + own);
    if (s->count == g->height) {
        g->firefly_count = fireflies_find(codes[0], codes[1], codes[2], g->width, g->height, g->fireflies);
        return;
    }
    (void)fireflies_find(codes[0], codes[1], codes[2], g->width, s->count, marks);
    memcpy(g->fireflies + p, marks + skip, own);
    for (size_t i = 0; i < own; i++)
        g->firefly_count += marks[skip + i];
}

status gathered_make(struct gathered *out, const struct accuracy_picture *picture,
                     const struct accuracy_transform *transform, struct error *err)
{
    size_t pixels = (size_t)picture->width * picture->height;
    uint8_t *marks = mem_alloc_array(STRIP_LINES + 2, picture->width);
    status s = STATUS_OK;

    *out = (struct gathered){.picture = picture, .transform = transform, .width = picture->width,
                             .height = picture->height, .pixels = pixels};
    if (transform->measure)
        s = is_small(out) ? measure_small(out, err) : measure_pictures(out, transform, err);
    out->squared = mem_alloc_array(pixels, sizeof(float));
    out->error = mem_alloc_array(pixels, sizeof(float));
    out->spread = mem_alloc_array(pixels, sizeof(float));
    out->fireflies = mem_alloc_array(pixels, 1);
    if (s == STATUS_OK && (!marks || !out->squared || !out->error || !out->spread || !out->fireflies))
        s = error_no_memory(err, "the figures of a picture's error");
    THEN(s, gathered_walk(out, CODES_OF_ALL, gather, marks, err));
    mem_free(marks);
    out->mean /= (double)pixels * 3;
    out->mean_variance /= (double)pixels * 3 * (double)pixels * 3;
    return s;
}

void means_of_line(const float *values, size_t stride, const struct gathered *g, uint32_t first, uint32_t y, double *out)
{
    const size_t line = (size_t)g->width * stride;
    const float *own = values + (y - first) * line;
    const int inside = y > 0 && y + 1 < g->height && g->width > 2;

    for (uint32_t x = 0; x < g->width; x += inside ? g->width - 1 : 1)
        for (size_t c = 0; c < stride; c++)
            out[x * stride + c] = mean_around(values + c, stride, g, first, x, y);
    for (size_t i = stride; inside && i + stride < line; i++) { /* in the order of mean_around() */
        const float *above = own - line + i, *here = own + i, *below = own + line + i;
        double sum = (double)above[-(ptrdiff_t)stride] + (double)above[0] + (double)above[stride];
        sum = sum + (double)here[-(ptrdiff_t)stride] + (double)here[0] + (double)here[stride];
        sum = sum + (double)below[-(ptrdiff_t)stride] + (double)below[0] + (double)below[stride];
        out[i] = sum / 9;
    }
}
