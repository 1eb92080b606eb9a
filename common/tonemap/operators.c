/* What the operators share. */
#include "common/system/parallel.h"
#include "common/tonemap/operators.h"

enum { GRAIN = 8 }; /* lines in a piece of a loop */

struct row_loop {
    const struct image *image;
    void (*row)(const void *user, float *rgb, uint32_t width);
    const void *user;
};

static void do_rows(void *user, size_t begin, size_t end)
{
    const struct row_loop *loop = user;

    for (size_t y = begin; y < end; y++)
        loop->row(loop->user, loop->image->pixels + y * loop->image->width * 3, loop->image->width);
}

void tonemap_each_row(const struct tonemap_frame *frame, void (*row)(const void *user, float *rgb, uint32_t width),
                      const void *user)
{
    struct row_loop loop = {frame->image, row, user};

    parallel_for(frame->threads, frame->image->height, GRAIN, do_rows, &loop);
}

int tonemap_always_local(const double *values UNUSED) { return 1; }
