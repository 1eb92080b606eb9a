#include "common/tonemap/gradient_field.h"

#include <string.h>

#include "common/base/memory.h"
#include "common/system/parallel.h"

enum { PIXELS_PER_PIECE = 1 << 15, SIDE_MIN = 3, STRIP_MIN = 96 };

static size_t lines_per_piece(const struct gradient_level *level) { return 1 + PIXELS_PER_PIECE / level->width; }

static size_t pixels_of(const struct gradient_level *level) { return (size_t)level->width * level->height; }

/* The next level would have a side below SIDE_MIN. For a strip this is allowed: otherwise the
 * number of the solver's steps would grow with its length. */
static int is_last(uint32_t width, uint32_t height)
{
    uint32_t shorter = width < height ? width : height, longer = width < height ? height : width;

    return shorter < 2 * SIDE_MIN && longer < STRIP_MIN;
}

status gradient_field_init(struct gradient_field *f, uint32_t width, uint32_t height, unsigned threads,
                           struct error *err)
{
    size_t pixels = (size_t)width * height;
    int complete;

    memset(f, 0, sizeof *f);
    f->threads = threads;
    f->residual = mem_alloc_array(pixels, sizeof *f->residual);
    f->step = mem_alloc_array(pixels, sizeof *f->step);
    f->product = mem_alloc_array(pixels, sizeof *f->product);
    f->line_sums = mem_alloc_array(height, sizeof *f->line_sums);
    complete = f->residual && f->step && f->product && f->line_sums;
    for (int l = 0; complete && l < GRADIENT_LEVELS_MAX; l++) {
        struct gradient_level *level = &f->levels[l];

        level->width = width;
        level->height = height;
        f->level_count = l + 1;
        level->weight_x = mem_alloc_array(pixels_of(level), sizeof(float));
        level->weight_y = mem_alloc_array(pixels_of(level), sizeof(float));
        level->value = l ? mem_alloc_array(pixels_of(level), sizeof(float)) : f->step;
        level->sum = l ? mem_alloc_array(pixels_of(level), sizeof(float)) : f->product;
        complete = level->weight_x && level->weight_y && level->value && level->sum;
        if (is_last(width, height))
            break;
        width = width > 1 ? width / 2 : 1;
        height = height > 1 ? height / 2 : 1;
    }
    if (complete)
        return STATUS_OK;
    gradient_field_release(f);
    return error_no_memory(err, "a picture's gradients");
}

void gradient_field_release(struct gradient_field *f)
{
    for (int l = f->level_count - 1; l >= 0; l--) {
        if (l > 0) {
            mem_free(f->levels[l].sum);
            mem_free(f->levels[l].value);
        }
        mem_free(f->levels[l].weight_y);
        mem_free(f->levels[l].weight_x);
    }
    mem_free(f->line_sums);
    mem_free(f->product);
    mem_free(f->step);
    mem_free(f->residual);
    memset(f, 0, sizeof *f);
}

/* ---- from level to level -------------------------------------------------------------------- */

/* A coarser level's pixel is the mean over its share of the side, count / coarse pixels. On a side
 * of 2n pixels these are two; on one of 2n + 1 the pixel i begins i / n into the pixel 2i and ends
 * (i + 1) / n into the pixel 2i + 2; a side of 1 stays. */
struct share {
    size_t first;
    float part[3]; /* of the pixels from first on */
};

static struct share share_of(size_t i, uint32_t count, uint32_t coarse)
{
    float n = (float)coarse;

    if (count == coarse)
        return (struct share){i, {1.0f, 0.0f, 0.0f}};
    if (count % 2 == 0)
        return (struct share){2 * i, {1.0f, 1.0f, 0.0f}};
    return (struct share){2 * i, {1.0f - (float)i / n, 1.0f, (float)(i + 1) / n}};
}

/* The reverse: the one or two coarser pixels that a pixel belongs to, and their shares of it. */
struct owners {
    size_t first, count;
    float part[2];
};

static struct owners owners_of(size_t i, uint32_t count, uint32_t coarse)
{
    size_t half = i / 2;
    float n = (float)coarse;

    if (count == coarse)
        return (struct owners){i, 1, {1.0f, 0.0f}};
    if (i % 2 != 0 || count % 2 == 0 || half == 0)
        return (struct owners){half, 1, {1.0f, 0.0f}};
    if (half == coarse)
        return (struct owners){half - 1, 1, {1.0f, 0.0f}};
    return (struct owners){half - 1, 2, {(float)half / n, 1.0f - (float)half / n}};
}

struct reducing {
    const struct gradient_level *fine, *coarse;
    const float *from;
    float *to;
};

static void reduce_line_even(const float *above, const float *below, uint32_t coarse_width, float *restrict to)
{
    for (size_t x = 0; x < coarse_width; x++)
        to[x] = 0.25f * (above[2 * x] + above[2 * x + 1] + below[2 * x] + below[2 * x + 1]);
}

static void reduce_lines(void *user, size_t begin, size_t end)
{
    const struct reducing *r = user;
    uint32_t width = r->fine->width, height = r->fine->height;
    uint32_t coarse_width = r->coarse->width, coarse_height = r->coarse->height;
    float scale = (float)pixels_of(r->coarse) / (float)pixels_of(r->fine);

    for (size_t y = begin; y < end; y++) {
        struct share rows = share_of(y, height, coarse_height);
        const float *from = r->from + rows.first * width;
        float *to = r->to + y * coarse_width;

        if (width == 2 * coarse_width && height == 2 * coarse_height) {
            reduce_line_even(from, from + width, coarse_width, to);
            continue;
        }
        for (size_t x = 0; x < coarse_width; x++) {
            struct share columns = share_of(x, width, coarse_width);
            float sum = 0.0f;

            for (size_t i = 0; i < 3 && rows.part[i] > 0.0f; i++)
                for (size_t k = 0; k < 3 && columns.part[k] > 0.0f; k++)
                    sum += rows.part[i] * columns.part[k] * from[i * width + columns.first + k];
            to[x] = scale * sum;
        }
    }
}

static void reduce(struct gradient_field *f, int level, const float *from)
{
    struct reducing r = {&f->levels[level], &f->levels[level + 1], from,
                         f->levels[level + 1].value};

    parallel_for(f->threads, r.coarse->height, lines_per_piece(r.coarse), reduce_lines, &r);
}

/* Add a line of the coarser level's sums to one of this level: the transpose of the mean, times the
 * ratio of the numbers of pixels, by which the means were divided. */
static void spread_line(const struct gradient_level *fine, const struct gradient_level *coarse, size_t y,
                        float *restrict to)
{
    struct owners rows = owners_of(y, fine->height, coarse->height);

    for (size_t i = 0; i < rows.count; i++) {
        const float *from = coarse->sum + (rows.first + i) * coarse->width;
        float part = rows.part[i];

        if (fine->width == 2 * coarse->width) {
            for (size_t x = 0; x < coarse->width; x++) {
                float value = part * from[x];
                to[2 * x] += value;
                to[2 * x + 1] += value;
            }
            continue;
        }
        for (size_t x = 0; x < fine->width; x++) {
            struct owners columns = owners_of(x, fine->width, coarse->width);

            for (size_t k = 0; k < columns.count; k++)
                to[x] += part * columns.part[k] * from[columns.first + k];
        }
    }
}

/* ---- differences ---------------------------------------------------------------------------- */

/* Differences of the line's pixels from x on; 0 if there is no neighbour. */
static void take_run(struct gradient_run *run, const struct gradient_level *level, const float *plane, size_t y,
                     size_t x, size_t count)
{
    const float *line = plane + y * level->width + x;
    size_t below = y + 1 < level->height ? level->width : 0;

    run->count = count;
    for (size_t i = 0; i < count; i++) {
        run->x[i] = x + i + 1 < level->width ? line[i + 1] - line[i] : 0.0f;
        run->y[i] = line[i + below] - line[i];
    }
}

struct visiting {
    const struct gradient_level *level;
    const float *plane;
    void (*see)(void *user, size_t stripe, const struct gradient_run *run);
    void *user;
};

static void visit_stripes(void *user, size_t begin, size_t end)
{
    const struct visiting *v = user;
    struct gradient_run run;

    for (size_t stripe = begin; stripe < end; stripe++) {
        size_t y = v->level->height * stripe / GRADIENT_STRIPES;
        size_t last = v->level->height * (stripe + 1) / GRADIENT_STRIPES;

        for (; y < last; y++)
            for (size_t x = 0; x < v->level->width; x += GRADIENT_RUN) {
                size_t left = v->level->width - x;
                take_run(&run, v->level, v->plane, y, x, left < GRADIENT_RUN ? left : GRADIENT_RUN);
                v->see(v->user, stripe, &run);
            }
    }
}

void gradient_field_visit(struct gradient_field *f, const float *plane,
                          void (*see)(void *user, size_t stripe, const struct gradient_run *run), void *user)
{
    for (int l = 0; l < f->level_count; l++) {
        struct visiting v = {&f->levels[l], l ? f->levels[l].value : plane, see, user};

        parallel_for(f->threads, GRADIENT_STRIPES, 1, visit_stripes, &v);
        if (l + 1 < f->level_count)
            reduce(f, l, v.plane);
    }
}

/* ---- weights and the right side of the equations-------------------------------------------- */

struct wanting {
    const struct gradient_level *level, *coarse;
    const float *plane;
    float *out; /* the right side, without the finer levels' part */
    void (*map)(const void *user, struct gradient_run *run);
    const void *user;
};

/* A run of a line's wanted differences times weights, in run->x and ->y. The pixel left of x is the
 * run's first, all zeros if there is none. */
static void want_run(const struct wanting *w, struct gradient_run *run, size_t y, size_t x, size_t count)
{
    const struct gradient_level *level = w->level;
    size_t before = x > 0;

    take_run(run, level, w->plane, y, x - before, count + before);
    w->map(w->user, run);
    if (x + count == level->width)
        run->weight_x[run->count - 1] = 0.0f;
    if (y + 1 == level->height)
        memset(run->weight_y, 0, sizeof run->weight_y);
    for (size_t i = 0; i < run->count; i++) {
        run->x[i] *= run->weight_x[i];
        run->y[i] *= run->weight_y[i];
    }
    if (before)
        return;
    memmove(run->x + 1, run->x, count * sizeof *run->x);
    memmove(run->y + 1, run->y, count * sizeof *run->y);
    memmove(run->weight_x + 1, run->weight_x, count * sizeof *run->weight_x);
    memmove(run->weight_y + 1, run->weight_y, count * sizeof *run->weight_y);
    run->x[0] = 0.0f;
}

static void want_lines(void *user, size_t begin, size_t end)
{
    const struct wanting *w = user;
    size_t width = w->level->width;
    struct gradient_run run;
    float above[GRADIENT_RUN];

    for (size_t x = 0; x < width; x += GRADIENT_RUN) {
        size_t count = width - x < GRADIENT_RUN ? width - x : GRADIENT_RUN;

        memset(above, 0, sizeof above);
        if (begin > 0) {
            want_run(w, &run, begin - 1, x, count);
            memcpy(above, run.y + 1, count * sizeof *above);
        }
        for (size_t y = begin; y < end; y++) {
            float *out = w->out + y * width + x;

            want_run(w, &run, y, x, count);
            memcpy(w->level->weight_x + y * width + x, run.weight_x + 1, count * sizeof(float));
            memcpy(w->level->weight_y + y * width + x, run.weight_y + 1, count * sizeof(float));
            for (size_t i = 0; i < count; i++)
                out[i] = run.x[i] - run.x[i + 1] + above[i] - run.y[i + 1];
            memcpy(above, run.y + 1, count * sizeof *above);
        }
    }
    for (size_t y = begin; w->coarse && y < end; y++)
        spread_line(w->level, w->coarse, y, w->out + y * width);
}

void gradient_field_want(struct gradient_field *f, const float *plane,
                         void (*map)(const void *user, struct gradient_run *run), const void *user)
{
    for (int l = 0; l + 1 < f->level_count; l++)
        reduce(f, l, l ? f->levels[l].value : plane);
    for (int l = f->level_count - 1; l >= 0; l--) {
        const struct gradient_level *level = &f->levels[l];
        struct wanting w = {level, l + 1 < f->level_count ? level + 1 : NULL,
                            l ? level->value : plane, l ? level->sum : f->residual, map, user};

        parallel_for(f->threads, level->height, lines_per_piece(level), want_lines, &w);
    }
}

/* ---- the product of the matrix and a plane -------------------------------------------------- */

struct multiplying {
    const struct gradient_level *level, *coarse;
    double *line_sums; /* of value times product; NULL: not needed */
};

/* The sum of products over a line, in four parts that a processor can take at once. */
static double dot_line(const float *a, const float *b, size_t count)
{
    double part[4] = {0};
    size_t i = 0;

    for (; i + 4 <= count; i += 4)
        for (int k = 0; k < 4; k++)
            part[k] += (double)a[i + (size_t)k] * (double)b[i + (size_t)k];
    for (; i < count; i++)
        part[0] += (double)a[i] * (double)b[i];
    return part[0] + part[1] + (part[2] + part[3]);
}

static void multiply_line(const struct gradient_level *level, size_t y, float *restrict out)
{
    size_t width = level->width;
    const float *v = level->value + y * width;
    const float *above = y > 0 ? v - width : v, *below = y + 1 < level->height ? v + width : v;
    const float *wx = level->weight_x + y * width, *wy = level->weight_y + y * width;
    const float *wy_above = y > 0 ? wy - width : wy;

    for (size_t x = 0; x < width; x++)
        out[x] = wy_above[x] * (v[x] - above[x]) - wy[x] * (below[x] - v[x]);
    for (size_t x = 0; x + 1 < width; x++)
        out[x] -= wx[x] * (v[x + 1] - v[x]);
    for (size_t x = 1; x < width; x++)
        out[x] += wx[x - 1] * (v[x] - v[x - 1]);
}

static void multiply_lines(void *user, size_t begin, size_t end)
{
    const struct multiplying *m = user;

    for (size_t y = begin; y < end; y++) {
        float *out = m->level->sum + y * m->level->width;

        multiply_line(m->level, y, out);
        if (m->coarse)
            spread_line(m->level, m->coarse, y, out);
        if (m->line_sums)
            m->line_sums[y] = dot_line(m->level->value + y * m->level->width, out, m->level->width);
    }
}

static double sum_of_lines(const struct gradient_field *f)
{
    double sum = 0.0;

    for (size_t y = 0; y < f->levels[0].height; y++)
        sum += f->line_sums[y];
    return sum;
}

/* f->product = A f->step; returns their dot product. */
static double multiply(struct gradient_field *f)
{
    for (int l = 0; l + 1 < f->level_count; l++)
        reduce(f, l, f->levels[l].value);
    for (int l = f->level_count - 1; l >= 0; l--) {
        const struct gradient_level *level = &f->levels[l];
        struct multiplying m = {level, l + 1 < f->level_count ? level + 1 : NULL,
                                l ? NULL : f->line_sums};

        parallel_for(f->threads, level->height, lines_per_piece(level), multiply_lines, &m);
    }
    return sum_of_lines(f);
}

/* ---- conjugate gradients -------------------------------------------------------------------- */

struct updating {
    struct gradient_field *f;
    float *x;
    float alpha, beta;
};

/* x += alpha step; residual -= alpha product; sums of residual^2. */
static void advance_lines(void *user, size_t begin, size_t end)
{
    const struct updating *u = user;
    size_t width = u->f->levels[0].width;

    for (size_t y = begin; y < end; y++) {
        float *restrict x = u->x + y * width, *restrict r = u->f->residual + y * width;
        const float *step = u->f->step + y * width, *product = u->f->product + y * width;

        for (size_t i = 0; i < width; i++) {
            x[i] += u->alpha * step[i];
            r[i] -= u->alpha * product[i];
        }
        u->f->line_sums[y] = dot_line(r, r, width);
    }
}

/* step = residual + beta step. */
static void turn_lines(void *user, size_t begin, size_t end)
{
    const struct updating *u = user;
    size_t width = u->f->levels[0].width;

    for (size_t i = begin * width; i < end * width; i++)
        u->f->step[i] = u->f->residual[i] + u->beta * u->f->step[i];
}

/* Sums of residual times x. */
static void compare_lines(void *user, size_t begin, size_t end)
{
    const struct updating *u = user;
    size_t width = u->f->levels[0].width;

    for (size_t y = begin; y < end; y++)
        u->f->line_sums[y] = dot_line(u->f->residual + y * width, u->x + y * width, width);
}

static void update(struct updating *u, void (*body)(void *, size_t, size_t))
{
    parallel_for(u->f->threads, u->f->levels[0].height, lines_per_piece(&u->f->levels[0]), body, u);
}

/* Scale x by the best fitting factor, and compute the residual and its square. */
static double start(struct updating *u)
{
    struct gradient_field *f = u->f;
    size_t pixels = pixels_of(&f->levels[0]);
    double energy, fit;

    memcpy(f->step, u->x, pixels * sizeof *f->step);
    energy = multiply(f);
    update(u, compare_lines);
    fit = energy > 0.0 ? sum_of_lines(f) / energy : 0.0;
    u->alpha = (float)fit;
    memset(u->x, 0, pixels * sizeof *u->x);
    update(u, advance_lines);
    return sum_of_lines(f);
}

int gradient_field_solve(struct gradient_field *f, float *x, double tolerance, int steps_max)
{
    struct updating u = {.f = f, .x = x};
    double right, square, before;
    int steps = 0;

    for (size_t y = 0; y < f->levels[0].height; y++)
        f->line_sums[y] =
            dot_line(f->residual + y * f->levels[0].width, f->residual + y * f->levels[0].width, f->levels[0].width);
    right = sum_of_lines(f);
    square = start(&u);
    u.beta = 0.0f;
    while (steps < steps_max && square > tolerance * tolerance * right) {
        double energy;

        update(&u, turn_lines);
        energy = multiply(f);
        if (!(energy > 0.0))
            break;
        u.alpha = (float)(square / energy);
        update(&u, advance_lines);
        before = square;
        square = sum_of_lines(f);
        u.beta = (float)(square / before);
        steps++;
    }
    return steps;
}
