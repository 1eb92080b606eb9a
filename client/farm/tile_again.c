#include "client/farm/tile_again.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "protocol/message.h"

enum { ASKED_AT_ONCE = 8, NOT_BY_MAX = 64 };

const char *tile_again_maker(const struct tile_again *t, uint32_t place)
{
    const Azulejo__Wire__FrameTile *tile = t->map && t->tile < t->map->n_tiles ? t->map->tiles[t->tile] : NULL;
    uint32_t seen = 0;

    for (size_t i = 0; tile && i < tile->n_shares; i++) {
        uint32_t worker = tile->shares[i]->worker;
        size_t k = 0;
        while (k < i && tile->shares[k]->worker != worker)
            k++;
        if (k == i && worker > 0 && worker <= t->map->n_workers && seen++ == place)
            return t->map->workers[worker - 1]->name[0] ? t->map->workers[worker - 1]->name
                                                        : t->map->workers[worker - 1]->host;
    }
    return "";
}

static void note_worker(struct tile_again *t, const char *name)
{
    for (uint32_t i = 0; tile_again_maker(t, i)[0]; i++)
        t->same_worker |= strcmp(tile_again_maker(t, i), name) == 0;
    for (uint32_t i = 0; i < t->by_count; i++)
        if (strcmp(t->by[i], name) == 0)
            return;
    if (t->by_count < TILE_AGAIN_NAMES_MAX)
        snprintf(t->by[t->by_count++], sizeof t->by[0], "%.63s", name);
}

static status ask(struct connection *c, const struct tile_again *t, uint32_t group, uint32_t pass, uint64_t *number,
                  struct error *err)
{
    Azulejo__Wire__RenderRequest request = AZULEJO__WIRE__RENDER_REQUEST__INIT;
    Azulejo__Wire__WorkUnit unit = AZULEJO__WIRE__WORK_UNIT__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(RENDER_REQUEST, render_request, &request);
    char *not_by[NOT_BY_MAX];

    while (request.n_not_by < NOT_BY_MAX && tile_again_maker(t, (uint32_t)request.n_not_by)[0]) {
        not_by[request.n_not_by] = (char *)(uintptr_t)tile_again_maker(t, (uint32_t)request.n_not_by);
        request.n_not_by++;
    }
    request.not_by = not_by;
    unit.tile = t->tile;
    unit.group = group;
    unit.pass = pass;
    request.job = t->job;
    request.frame = t->frame;
    request.unit = &unit;
    request.sums = 1;
    e.request = *number = connection_request_id(c);
    return connection_send(c, &e, err);
}

static status take(struct tile_again *t, struct film *film, uint32_t group, uint32_t pass,
                   const Azulejo__Wire__RenderResult *result, struct error *err)
{
    struct unit_result unit = {.tile = t->tile, .group = group, .pass = pass};
    enum film_merge_result merged;
    status s = wire_sums_get(&unit.sums, &unit.count, &result->sums, err);

    if (s == STATUS_OK && unit.count == 0)
        return error_set(err, STATUS_ERR_PROTOCOL, "worker %s answered without the tile's samples: is it of another release?",
                         result->worker_name);
    THEN(s, wire_work_get(&unit.work, result->work, err));
    THEN(s, film_merge(film, &unit, 1, &merged, err));
    if (s == STATUS_OK) {
        t->units++;
        note_worker(t, result->worker_name);
    }
    return s;
}

static status receive(struct connection *c, struct tile_again *t, struct film *film, uint32_t group, uint32_t pass,
                      uint64_t number, struct error *err)
{
    Azulejo__Wire__Envelope *answer = NULL;
    status s = connection_receive(c, number, &answer, err);

    if (s == STATUS_OK && answer->body_case != AZULEJO__WIRE__ENVELOPE__BODY_RENDER_RESULT)
        s = error_set(err, STATUS_ERR_PROTOCOL, "the coordinator answered a RenderRequest with something else");
    THEN(s, take(t, film, group, pass, answer->render_result, err));
    message_free(answer);
    return s;
}

status tile_again_render(struct connection *c, struct tile_again *t, struct film *film, struct error *err)
{
    uint32_t count = t->passes[0] + t->passes[1], sent = 0;
    uint64_t numbers[ASKED_AT_ONCE];
    status s = STATUS_OK;

    _Static_assert(GROUPS == 2, "as below");
    for (uint32_t g = 0; g < GROUPS; g++)
        film_want(film, t->tile, g, t->passes[g]);
    for (uint32_t i = 0; i < count && s == STATUS_OK; i++) { /* unit i: pass i of group 0, then those of group 1 */
        for (; sent < count && sent < i + ASKED_AT_ONCE && s == STATUS_OK; sent++)
            s = ask(c, t, sent >= t->passes[0], sent >= t->passes[0] ? sent - t->passes[0] : sent,
                    &numbers[sent % ASKED_AT_ONCE], err);
        THEN(s, receive(c, t, film, i >= t->passes[0], i >= t->passes[0] ? i - t->passes[0] : i,
                        numbers[i % ASKED_AT_ONCE], err));
    }
    return s;
}

/* As a file with 16 bits a channel has them. */
static status round_to_half(struct image *tile, struct error *err)
{
    const struct exr_options options = {.half = 1};
    struct buffer file = BUFFER_INIT;
    struct image rounded = {0};
    status s = exr_encode(&file, tile, &options, err);

    THEN(s, exr_decode(&rounded, file.data, file.size, "a tile", err));
    if (s == STATUS_OK)
        memcpy(tile->pixels, rounded.pixels, (size_t)tile->width * tile->height * 3 * sizeof(float));
    image_release(&rounded);
    buffer_release(&file);
    return s;
}

status tile_again_compare(struct tile_again *t, const struct film *film, const struct image *picture, int half,
                          struct error *err)
{
    static float means[TILE_SIZE * TILE_SIZE][4];
    struct image tile = {0};
    status s = image_init(&tile, t->rect.width, t->rect.height, 3, err);

    memset(means, 0, sizeof means);
    (void)film_tile_picture(film, t->tile, means); /* black where there are no samples */
    for (uint32_t i = 0; s == STATUS_OK && i < t->rect.width * t->rect.height; i++)
        memcpy(tile.pixels + 3 * (size_t)i, means[i], 3 * sizeof(float));
    if (s == STATUS_OK && half)
        s = round_to_half(&tile, err);
    for (uint32_t i = 0; s == STATUS_OK && i < t->rect.width * t->rect.height; i++) {
        const float *is = tile.pixels + 3 * (size_t)i, *was =
            picture->pixels + (((size_t)t->rect.y + i / t->rect.width) * picture->width + t->rect.x + i % t->rect.width) *
                                  picture->channels;
        if (memcmp(is, was, 3 * sizeof(float)) == 0)
            continue;
        t->pixels_differ++;
        for (int k = 0; k < 3; k++)
            t->most = fmax(t->most, fabs((double)is[k] - (double)was[k]));
    }
    image_release(&tile);
    return s;
}
