#include <assert.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/base/safeguard.h"
#include "worker/render/medium/medium_data.h"

static real coefficient_clamp(real x)
{
    return x >= MEDIUM_COEFFICIENT_MIN ? real_min(x, MEDIUM_COEFFICIENT_MAX) : 0.0f;
}

/* Interpolation inside a block also reads so many cells to either side of it. */
static uint32_t block_overlap(void) { return SAFEGUARD(GRID_BLOCK_EDGE) ? 1 : 0; }

static real block_maximum(const struct render_medium *medium, const uint32_t block[3])
{
    uint32_t first[3], end[3];
    real most = 0.0f;

    for (int axis = 0; axis < 3; axis++) {
        uint32_t begin = block[axis] * MEDIUM_BLOCK_SIDE;

        first[axis] = begin > 0 ? begin - block_overlap() : 0;
        end[axis] = begin + MEDIUM_BLOCK_SIDE + block_overlap();
        if (end[axis] > medium->size[axis])
            end[axis] = medium->size[axis];
    }
    for (uint32_t z = first[2]; z < end[2]; z++)
        for (uint32_t y = first[1]; y < end[1]; y++) {
            size_t row = ((size_t)z * medium->size[1] + y) * medium->size[0];

            for (uint32_t x = first[0]; x < end[0]; x++)
                most = real_max(medium_density_at(medium->cells, row + x), most);
        }
    return most;
}

/* Upper bound of the box's diagonal, metres. */
static double box_diagonal(const struct transform_d *grid_to_world)
{
    double sum = 0;

    for (int row = 0; row < 3; row++) {
        double extent = 0;

        for (int column = 0; column < 3; column++)
            extent += fabs(grid_to_world->m[row][column]);
        sum += extent * extent;
    }
    return sqrt(sum);
}

/* Emission is collected where tracking stops, so tracking must stop a few times even in a grid that hardly absorbs. */
static void set_glow(struct render_medium *medium, const struct scene_medium *source, real densest)
{
    double optical = box_diagonal(&source->grid_to_world) * (double)densest;
    double rate = optical > 0 ? MEDIUM_EMISSION_STEPS / optical : 0;

    rate = rate < (double)medium->extinction_max ? (double)medium->extinction_max : rate;
    rate = rate < (double)MEDIUM_COEFFICIENT_MAX ? rate : (double)MEDIUM_COEFFICIENT_MAX;
    medium->glow_rate = (real)rate;
    for (int c = 0; c < 3; c++)
        if (medium->glow_rate > 0.0f)
            medium->glow[c] = real_min(medium->emission[c] / medium->glow_rate, MEDIUM_RADIANCE_MAX);
}

static status build_grid(struct render_medium *medium, const struct scene_medium *source, const uint8_t *grid,
                         struct error *err)
{
    struct transform_d to_world = source->grid_to_world, to_unit, to_cells;
    size_t count = 1, at = 0;
    real densest = 0.0f;
    uint32_t block[3];

    assert(grid != NULL);
    memcpy(medium->size, source->grid_size, sizeof medium->size);
    medium->cells = grid;
    for (int axis = 0; axis < 3; axis++) {
        assert(medium->size[axis] > 0);
        medium->blocks[axis] = (medium->size[axis] - 1) / MEDIUM_BLOCK_SIDE + 1;
        NEED(mem_size_mul(count, medium->blocks[axis], &count), err, "a medium's grid");
    }
    medium->block_max = mem_calloc(count, sizeof *medium->block_max);
    NEED(medium->block_max, err, "a medium's grid");
    /* A box without volume holds nothing; its majorants stay 0. */
    if (!transform_d_invert(&to_world, &to_unit))
        return STATUS_OK;
    to_cells = transform_d_identity();
    for (int axis = 0; axis < 3; axis++)
        to_cells.m[axis][axis] = medium->size[axis];
    to_cells = transform_d_multiply(&to_cells, &to_unit);
    medium->to_cells = transform_from_d(&to_cells);
    if (!transform_is_finite(&medium->to_cells))
        return STATUS_OK;
    for (block[2] = 0; block[2] < medium->blocks[2]; block[2]++)
        for (block[1] = 0; block[1] < medium->blocks[1]; block[1]++)
            for (block[0] = 0; block[0] < medium->blocks[0]; block[0]++) {
                real most = block_maximum(medium, block);

                medium->block_max[at++] = most;
                densest = real_max(most, densest);
            }
    set_glow(medium, source, densest);
    return STATUS_OK;
}

status medium_new(struct render_medium **out, const struct scene_medium *source, const uint8_t *grid, struct error *err)
{
    struct render_medium *medium = mem_calloc(1, sizeof *medium);
    real least = INFINITY;
    status st = STATUS_OK;

    *out = NULL;
    NEED(medium, err, "a medium");
    for (int c = 0; c < 3; c++) {
        medium->absorption[c] = coefficient_clamp(source->absorption[c]);
        medium->scattering[c] = coefficient_clamp(source->scattering[c]);
        medium->emission[c] = coefficient_clamp(source->emission[c]);
        medium->extinction[c] = medium->absorption[c] + medium->scattering[c];
        medium->extinction_max = real_max(medium->extinction[c], medium->extinction_max);
        least = real_min(medium->extinction[c], least);
        medium->scatters |= medium->scattering[c] > 0.0f;
        medium->emits |= medium->emission[c] > 0.0f;
    }
    medium->chromatic = least < medium->extinction_max;
    medium->g = source->g < -MEDIUM_G_MAX ? -MEDIUM_G_MAX : real_min(source->g, MEDIUM_G_MAX);
    if (source->has_grid)
        st = build_grid(medium, source, grid, err);
    if (st != STATUS_OK) {
        medium_free(medium);
        return st;
    }
    *out = medium;
    return STATUS_OK;
}

void medium_free(struct render_medium *medium)
{
    if (!medium)
        return;
    mem_free(medium->block_max);
    mem_free(medium);
}

size_t medium_bytes(const struct render_medium *medium)
{
    size_t blocks = (size_t)medium->blocks[0] * medium->blocks[1] * medium->blocks[2];

    return sizeof *medium + blocks * sizeof *medium->block_max;
}

int medium_scatters(const struct render_medium *medium) { return medium->scatters; }

int medium_has_grid(const struct render_medium *medium) { return medium->cells != NULL; }
