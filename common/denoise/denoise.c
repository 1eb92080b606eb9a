#include "common/denoise/denoise.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/denoise/block.h"
#include "common/denoise/frames.h"
#include "common/denoise/judge.h"
#include "common/denoise/mix.h"
#include "common/system/parallel.h"

enum { FULL_RADIUS = 6, FAST_RADIUS = 3 };

/* What the threads share. */
struct work {
    const struct denoise_input *input;
    const struct denoise_options *options;
    struct denoise_result *result;
    struct filtered filtered;
    uint32_t blocks_across, blocks;
    struct frames frames;       /* of other frames, if there are any */
    struct denoise_other other; /* the one that is added */
    int first, last;            /* it is the first, the last of them */
    struct block *spaces;       /* for each thread, one, or one and another frame's */
    atomic_flag *taken;
    unsigned space_count, space_blocks;
    struct block_sum {
        uint64_t fireflies;
        double removed, light;
    } * sums;             /* [blocks] */
    pthread_mutex_t lock; /* for progress */
    uint32_t done;
};

static status check_picture(const struct denoise_input *input, struct error *err)
{
    const size_t values = (size_t)input->width * input->height * 3;
    const float *pictures[] = {input->groups[0], input->groups[1], input->albedo[0], input->albedo[1],
                               input->normal[0], input->normal[1], input->direct[0], input->direct[1]};

    if (input->width == 0 || input->height == 0 || !input->groups[0] || !input->groups[1])
        return error_set(err, STATUS_ERR_INPUT, "there is no picture to be denoised");
    for (size_t k = 0; k < sizeof pictures / sizeof *pictures; k++)
        for (size_t i = 0; pictures[k] && i < values; i++)
            if (!isfinite(pictures[k][i]))
                return error_set(err, STATUS_ERR_INPUT, "cannot denoise: pixel (%u, %u) has a value that is not finite",
                                 (unsigned)(i / 3 % input->width), (unsigned)(i / 3 / input->width));
    return STATUS_OK;
}

static struct block *take_space(struct work *w)
{
    for (unsigned i = 0;; i = (i + 1) % w->space_count) /* there are as many as threads */
        if (!atomic_flag_test_and_set_explicit(&w->taken[i], memory_order_acquire))
            return &w->spaces[i * w->space_blocks];
}

static void give_space(struct work *w, struct block *space)
{
    atomic_flag_clear_explicit(&w->taken[(size_t)(space - w->spaces) / w->space_blocks], memory_order_release);
}

static void store(const struct work *w, const struct block *b, block_plane *from, const float *direct, float *out)
{
    for (uint32_t y = 0; y < b->height; y++)
        for (uint32_t x = 0; x < b->width; x++) {
            const size_t to = ((size_t)(b->y + y) * w->input->width + b->x + x) * 3;
            for (size_t c = 0; c < 3; c++)
                out[to + c] = from[c][block_index(x, y)] + (direct ? direct[to + c] : 0);
        }
}

static void tell(struct work *w)
{
    if (!w->options->progress)
        return;
    pthread_mutex_lock(&w->lock);
    w->done++;
    w->options->progress(w->options->progress_user, 0.95 * w->done / ((double)w->blocks * (1 + w->input->other_count)));
    pthread_mutex_unlock(&w->lock);
}

static void place_of(const struct work *w, size_t block, uint32_t *x, uint32_t *y)
{
    *x = (uint32_t)(block % w->blocks_across) * BLOCK_INNER;
    *y = (uint32_t)(block / w->blocks_across) * BLOCK_INNER;
}

static void add_blocks(void *user, size_t begin, size_t end)
{
    struct work *w = user;
    struct block *b = take_space(w);
    uint32_t x, y;

    for (size_t i = begin; i < end; i++) {
        place_of(w, i, &x, &y);
        block_load(b, w->input, NULL, x, y);
        if (w->first)
            frames_begin(&w->frames, w->input, b);
        block_load_other(b + 1, &w->other, x, y);
        frames_add(&w->frames, w->input, b, b + 1);
        if (w->last)
            frames_end(&w->frames, w->input, b);
        tell(w);
    }
    give_space(w, b);
}

/* Means of the picture and other frames, into w->frames. */
static status add_frames(struct work *w, struct error *err)
{
    const struct denoise_input *in = w->input;

    for (uint32_t k = 0; k < in->other_count; k++) {
        TRY(in->other(in->other_user, k, &w->other, err));
        TRY(check_picture(w->other.picture, err));
        if (w->other.picture->width != in->width || w->other.picture->height != in->height)
            return error_set(err, STATUS_ERR_INPUT, "cannot denoise: the frames differ in size");
        w->first = k == 0;
        w->last = k + 1 == in->other_count;
        parallel_for(w->space_count, w->blocks, 1, add_blocks, w);
    }
    return STATUS_OK;
}

static void filter_blocks(void *user, size_t begin, size_t end)
{
    struct work *w = user;
    struct block *b = take_space(w);
    const int fast = w->options->method == DENOISE_FAST;
    uint32_t x, y;

    for (size_t i = begin; i < end; i++) {
        place_of(w, i, &x, &y);
        block_load(b, w->input, w->input->other_count ? w->frames.sums : NULL, x, y);
        w->sums[i] = (struct block_sum){b->fireflies, b->removed, b->light};
        if (fast)
            block_filter_joint(b, FAST_RADIUS, w->input->normal[0] ? JOINT_FEATURES : JOINT_COLOURS);
        else
            block_filter_fitted(b, FULL_RADIUS);
        for (int g = 0; g < 2; g++) {
            store(w, b, b->result[g], w->input->direct[g], w->filtered.pictures[g]);
            if (!fast)
                store(w, b, b->fitted[g], w->input->direct[g], w->filtered.fitted[g]);
        }
        tell(w);
    }
    give_space(w, b);
}

static void compare_rows(void *user, size_t begin, size_t end)
{
    struct work *w = user;

    for (size_t row = begin; row < end; row++)
        mix_compare(&w->filtered, (uint32_t)row);
}

static void choose_rows(void *user, size_t begin, size_t end)
{
    struct work *w = user;

    for (size_t row = begin; row < end; row++)
        mix_choose(&w->filtered, (uint32_t)row);
}

static void show_lines(void *user, size_t begin, size_t end)
{
    struct work *w = user;
    float groups[2][3];

    for (size_t y = begin; y < end; y++)
        for (uint32_t x = 0; x < w->input->width; x++) {
            float *out = w->result->image + (y * w->input->width + x) * 3;
            mix_pixel(&w->filtered, x, (uint32_t)y, groups);
            for (int c = 0; c < 3; c++)
                out[c] = (groups[0][c] + groups[1][c]) / 2;
            /* What is shown of group 0 takes the place of what the filter made of it, which is not needed any more. */
            memcpy(w->filtered.pictures[0] + (y * w->input->width + x) * 3, groups[0], sizeof groups[0]);
        }
}

static void count(struct work *w)
{
    struct denoise_counts *counts = &w->result->counts;
    double removed = 0, light = 0;

    for (uint32_t i = 0; i < w->blocks; i++) {
        counts->fireflies += w->sums[i].fireflies;
        removed += w->sums[i].removed;
        light += w->sums[i].light;
    }
    counts->removed = light > 0 ? removed / light : 0;
    counts->tiles = mix_tiles(w->input);
    for (uint32_t tile = 0; tile < counts->tiles; tile++)
        counts->raw += (uint32_t)mix_tile_is_raw(&w->filtered, tile);
}

static float mean_of(const struct denoise_input *in)
{
    const size_t values = (size_t)in->width * in->height * 3;
    double sum = 0;

    for (size_t i = 0; i < values; i++)
        sum += (double)in->groups[0][i] + (double)in->groups[1][i];
    return sum > 0 ? (float)(sum / 2 / (double)values) : 0;
}

static status work_init(struct work *w, struct error *err)
{
    const struct denoise_input *in = w->input;
    const size_t values = (size_t)in->width * in->height * 3;
    struct filtered *f = &w->filtered;
    size_t cells;

    f->input = in;
    f->mean = mean_of(in);
    f->across = (in->width + MIX_CELL - 1) / MIX_CELL;
    f->down = (in->height + MIX_CELL - 1) / MIX_CELL;
    cells = (size_t)f->across * f->down;
    w->blocks_across = (in->width + BLOCK_INNER - 1) / BLOCK_INNER;
    w->blocks = w->blocks_across * ((in->height + BLOCK_INNER - 1) / BLOCK_INNER);
    w->space_count = w->options->threads ? w->options->threads : parallel_processors();
    if (w->space_count > w->blocks)
        w->space_count = w->blocks;
    if (w->space_count > PARALLEL_THREADS_MAX)
        w->space_count = PARALLEL_THREADS_MAX;
    w->space_blocks = in->other_count ? 2 : 1;
    w->spaces = mem_alloc_array((size_t)w->space_count * w->space_blocks, sizeof *w->spaces);
    w->taken = mem_calloc(w->space_count, sizeof *w->taken);
    w->sums = mem_calloc(w->blocks, sizeof *w->sums);
    f->shares = mem_calloc(cells, sizeof *f->shares);
    f->products = mem_calloc(cells, sizeof *f->products);
    w->result->image = mem_alloc_array(values, sizeof(float));
    NEED(w->spaces && w->taken && w->sums && f->shares && f->products && w->result->image, err, "the denoised picture");
    for (int g = 0; g < 2; g++) {
        f->pictures[g] = mem_alloc_array(values, sizeof(float));
        NEED(f->pictures[g], err, "the denoised picture");
        if (in->other_count) {
            w->frames.sums[g] = mem_alloc_array(values, sizeof(float));
            w->frames.total[g] = mem_alloc_array(values / 3, sizeof(float));
            NEED(w->frames.sums[g] && w->frames.total[g], err, "means over frames");
        }
        if (w->options->method != DENOISE_FULL)
            continue;
        f->fitted[g] = mem_alloc_array(values, sizeof(float));
        NEED(f->fitted[g], err, "the denoised picture");
    }
    return STATUS_OK;
}

static void release_frames(struct work *w)
{
    for (int g = 0; g < 2; g++) {
        mem_free(w->frames.sums[g]);
        mem_free(w->frames.total[g]);
        w->frames.sums[g] = w->frames.total[g] = NULL;
    }
}

static void work_release(struct work *w)
{
    for (int g = 0; g < 2; g++) {
        mem_free(w->filtered.fitted[g]);
        mem_free(w->filtered.pictures[g]);
    }
    release_frames(w);
    mem_free(w->filtered.products);
    mem_free(w->filtered.shares);
    mem_free(w->sums);
    mem_free(w->taken);
    mem_free(w->spaces);
}

static void run(struct work *w)
{
    const unsigned threads = w->space_count;

    parallel_for(threads, w->blocks, 1, filter_blocks, w);
    release_frames(w);
    parallel_for(threads, w->filtered.down, 1, compare_rows, w);
    parallel_for(threads, w->filtered.down, 1, choose_rows, w);
    parallel_for(threads, w->input->height, DENOISE_TILE, show_lines, w);
    count(w);
    /* The figures need neither; their memory comes on top of what is left. */
    mem_free(w->filtered.pictures[1]);
    w->filtered.pictures[1] = NULL;
    for (int g = 0; g < 2; g++) {
        mem_free(w->filtered.fitted[g]);
        w->filtered.fitted[g] = NULL;
    }
    mem_free(w->spaces);
    w->spaces = NULL;
}

status denoise(const struct denoise_input *input, const struct denoise_options *options, struct denoise_result *result,
               struct error *err)
{
    struct work w = {.input = input, .options = options, .result = result, .lock = PTHREAD_MUTEX_INITIALIZER};
    status s;

    memset(result, 0, sizeof *result);
    TRY(check_picture(input, err));
    s = work_init(&w, err);
    THEN(s, add_frames(&w, err));
    if (s == STATUS_OK) {
        run(&w);
        s = judge_result(&w.filtered, options, result, err);
    }
    work_release(&w);
    if (s != STATUS_OK)
        denoise_result_release(result);
    else if (options->progress)
        options->progress(options->progress_user, 1);
    return s;
}

void denoise_result_release(struct denoise_result *result)
{
    mem_free(result->image);
    memset(result, 0, sizeof *result);
}
