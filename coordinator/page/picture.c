#include "coordinator/page/picture.h"

#include <string.h>

#include "common/base/memory.h"
#include "common/film/tiles.h"
#include "coordinator/frame/spread.h"

int picture_begin(struct picture *p, uint32_t width, uint32_t height)
{
    uint32_t tiles = tile_count(width, height);

    picture_end(p);
    p->order = mem_alloc_array(tiles, sizeof *p->order);
    p->sent = mem_calloc(tiles, sizeof *p->sent);
    if (!p->order || !p->sent) {
        picture_end(p);
        return 0;
    }
    spread_order(width, height, p->order);
    p->tiles = p->unseen = tiles;
    return 1;
}

void picture_end(struct picture *p)
{
    mem_free(p->order);
    mem_free(p->sent);
    memset(p, 0, sizeof *p);
}

void picture_turn_on(struct picture *p) { p->fresh_left = p->unseen > 0 ? p->tiles : 0; }

void picture_turn(struct picture *p, int is_exact)
{
    picture_turn_on(p);
    p->next_left = p->tiles;
    p->is_exact = is_exact;
}

/* Has a tile that the client saw become another? */
static int is_other(const struct picture *p, uint32_t tile, uint32_t samples)
{
    uint32_t seen = p->sent[tile];

    return seen != 0 && (p->is_exact ? samples != seen : samples < seen || samples - seen >= (seen + 1) / 2);
}

static uint32_t step(const struct picture *p, uint32_t *place)
{
    uint32_t tile = p->order[*place];

    *place = *place + 1 < p->tiles ? *place + 1 : 0;
    return tile;
}

int picture_wants(struct picture *p, uint32_t tile, uint32_t samples)
{
    if (tile >= p->tiles || p->sent[tile] == samples)
        return 0;
    p->unseen -= p->sent[tile] == 0;
    p->sent[tile] = samples;
    return 1;
}

int64_t picture_next(struct picture *p, const uint32_t *shown, int *is_first)
{
    while (p->fresh_left > 0 && p->unseen > 0) {
        uint32_t tile = step(p, &p->fresh);
        p->fresh_left--;
        *is_first = 1;
        if (p->sent[tile] == 0 && picture_wants(p, tile, shown[tile]))
            return tile;
    }
    while (p->next_left > 0) {
        uint32_t tile = step(p, &p->next);
        p->next_left--;
        *is_first = 0;
        if (is_other(p, tile, shown[tile]) && picture_wants(p, tile, shown[tile]))
            return tile;
    }
    return PICTURE_NO_TILE;
}
