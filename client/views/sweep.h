/* sweep: one picture tone mapped in many ways, side by side on a labelled sheet.
 *
 * A sweep is NAME=VALUE,VALUE,...; NAME is "operator" ("all" means every operator that works with the given files),
 * exposure, auto-exposure, percentile, white-balance, or a parameter of the operator. One sweep gives a grid that is
 * read line by line; with two, the first runs to the right and the second downwards.
 *
 * Every tile is tone mapped at the picture's full size, because operators depend on the size, and then reduced by
 * averaging display light. One tile is in memory at a time.
 */
#pragma once

#include "client/options/tonemap_options.h"
#include "common/image/image.h"

enum {
    SWEEPS_MAX = 2,
    SWEEP_VALUES_MAX = 64,
    SWEEP_NAME_SIZE = 64,
    SWEEP_TITLE_LINES_MAX = 16,
    SWEEP_TILE_WIDTH_DEFAULT = 480,
    SWEEP_TILE_WIDTH_MIN = 8,
    SWEEP_TILE_WIDTH_MAX = 16384,
};

struct sweep {
    char name[SWEEP_NAME_SIZE];
    char *assignments[SWEEP_VALUES_MAX];  /* "name=value", owned */
    const char *values[SWEEP_VALUES_MAX]; /* point into them */
    size_t count;
};

/* `has_file`: operators that need a file are among "all". ERR_USAGE, ERR_NO_MEMORY. */
status sweep_parse(struct sweep *out, const char *text, int has_file, struct error *err) MUST_CHECK;
void sweep_release(struct sweep *sweep);

/* The label of a value's tile, row or column. */
const char *sweep_label(const struct sweep *sweep, size_t value);

/* The layout of the sheet, in pixels. */
struct sheet {
    const struct sweep *sweeps;
    size_t sweep_count;
    uint32_t columns, rows, tiles;
    uint32_t tile_width, tile_height;
    uint32_t cell_width, cell_height; /* with the tile's label, without margins */
    uint32_t scale, margin;           /* of the font; between things */
    uint32_t left, top;               /* where the cells begin: right of row labels, below the title */
    uint32_t width, height;
    const char *title;
    size_t title_begin[SWEEP_TITLE_LINES_MAX], title_length[SWEEP_TITLE_LINES_MAX];
    size_t title_lines;
};

/* For a picture of this size. Tiles are never larger than the picture. The sheet points at the sweeps and the title. */
void sheet_plan(struct sheet *out, const struct sweep *sweeps, size_t sweep_count, uint32_t width, uint32_t height,
                uint32_t tile_width, const char *title);

/* The upper left corner of tile number `tile` (of two sweeps: first + second * columns). */
void sheet_tile_at(const struct sheet *sheet, uint32_t tile, uint32_t *x, uint32_t *y);

/* The mean of the pixels under each of `out`'s, which is initialised and smaller. */
void image_box_reduce(struct image *out, const struct image *in);

struct sweep_options {
    const struct tonemap_options *tone; /* common to all tiles */
    const struct sweep *sweeps;
    size_t sweep_count;
    uint32_t tile_width;
    unsigned threads;
    int linear; /* display light instead of codes */
};

/* Check the values against the options. Call it before expensive work. ERR_USAGE, ERR_INPUT. */
status sweep_check(const struct sweep_options *how, struct error *err) MUST_CHECK;

/* The sheet of a picture (3 channels), initialised here. `name` is for the title. */
status sweep_draw(struct image *out, const struct image *picture, const char *name, const struct sweep_options *how,
                  struct error *err) MUST_CHECK;
