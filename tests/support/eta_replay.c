#include "tests/support/eta_replay.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "common/base/memory.h"
#include "common/film/film.h"
#include "coordinator/frame/eta.h"

struct worker {
    struct eta_unit unit;
    double free_s;
    uint64_t cpu_ns;
    int busy;
};

struct guess {
    double at_s, left_s;
};

struct replay {
    const struct eta_frame *frame;
    struct film *film;
    struct eta eta;
    struct throughput throughput;
    struct worker workers[ETA_THREADS_MAX];
    uint32_t threads, next, units;
    double now_s, speed;
    struct guess *guesses;
    size_t guess_count;
    float sums[TILE_FLOATS_MAX];
};

static void need(int ok, const char *what)
{
    if (!ok) {
        fprintf(stderr, "eta_replay: %s\n", what);
        abort();
    }
}

/* The next unit in the order in which a frame grants them; 0: none is left. */
static int take_unit(struct replay *r, struct worker *w)
{
    uint32_t tiles = film_tile_count(r->film), begin, end;
    struct tile_rect rect;

    do {
        if (r->next >= r->units)
            return 0;
        w->unit.tile = r->next % tiles;
        w->unit.group = r->next / tiles % GROUPS;
        w->unit.pass = r->next / tiles / GROUPS;
        r->next++;
    } while (w->unit.pass >= film_pass_count(r->film, w->unit.group));
    rect = tile_rect_of(r->frame->width, r->frame->height, w->unit.tile);
    pass_range(film_spp(r->film), w->unit.group, w->unit.pass, &begin, &end);
    w->unit.samples = (uint64_t)rect.width * rect.height * (end - begin);
    w->cpu_ns = r->frame->cpu_ns(r->frame->user, &w->unit);
    w->free_s = r->now_s + (double)w->cpu_ns / 1e9 / r->speed;
    w->busy = 1;
    return 1;
}

/* The earliest worker hands in its result; 0: none is busy. */
static int deliver(struct replay *r)
{
    struct worker *first = NULL;
    enum film_merge_result merged;
    struct unit_result unit;

    for (uint32_t i = 0; i < r->threads; i++)
        if (r->workers[i].busy && (!first || r->workers[i].free_s < first->free_s))
            first = &r->workers[i];
    if (!first)
        return 0;
    r->now_s = first->free_s;
    first->busy = 0;
    unit = (struct unit_result){
        .tile = first->unit.tile, .group = first->unit.group, .pass = first->unit.pass, .sums = r->sums,
        .count = tile_floats(r->frame->width, r->frame->height, first->unit.tile, 0),
        .work = {.samples = first->unit.samples, .rays = first->unit.samples}};
    need(film_merge(r->film, &unit, 1, &merged, NULL) == STATUS_OK, "a result does not fit");
    eta_learn(&r->eta, unit.tile, first->unit.samples, first->cpu_ns);
    throughput_add(&r->throughput, first->cpu_ns, (uint64_t)(r->now_s * 1e9));
    return 1;
}

/* Guesses hold until the next one. */
static double share_right(const struct replay *r, double end_s)
{
    double right = 0, all = 0;

    for (size_t i = 0; i + 1 < r->guess_count; i++) {
        const struct guess *g = &r->guesses[i];
        double dt = g[1].at_s - g->at_s, truth = end_s - g->at_s;
        if (g->at_s < 0.1 * end_s)
            continue;
        all += dt;
        if (fabs(g->left_s - truth) <= 0.2 * truth)
            right += dt;
    }
    return right / all;
}

static void run(struct replay *r)
{
    double start_s = r->now_s = 1000;

    need(eta_left_ns(&r->eta, r->film) < 0, "something is known before the first result");
    do {
        double speed = throughput_of(&r->throughput), left_ns = eta_left_ns(&r->eta, r->film);
        for (uint32_t i = 0; i < r->threads; i++)
            if (!r->workers[i].busy)
                (void)take_unit(r, &r->workers[i]);
        r->guesses[r->guess_count++] = (struct guess){r->now_s - start_s, speed > 0 ? left_ns / 1e9 / speed : -1};
    } while (deliver(r));
    need(film_complete(r->film), "the frame is not complete");
    need(eta_left_ns(&r->eta, r->film) == 0, "something is left at the end");
}

double eta_replay(const struct eta_frame *frame, uint32_t threads, double speed)
{
    struct replay *r = mem_calloc(1, sizeof *r);
    double share;

    need(r && threads >= 1 && threads <= ETA_THREADS_MAX, "threads");
    r->frame = frame;
    r->threads = threads;
    r->speed = speed;
    r->film = film_new(frame->width, frame->height, frame->spp);
    need(r->film != NULL, "out of memory");
    film_want_all(r->film);
    for (uint32_t g = 0; g < GROUPS; g++)
        film_freeze(r->film, g, NULL);
    eta_init(&r->eta, r->film);
    r->units = film_tile_count(r->film) * GROUPS * film_pass_count(r->film, 0);
    r->guesses = mem_alloc_array((size_t)r->units + 2, sizeof *r->guesses);
    need(r->guesses != NULL, "out of memory");
    run(r);
    share = share_right(r, r->now_s - 1000);
    eta_release(&r->eta);
    film_free(r->film);
    mem_free(r->guesses);
    mem_free(r);
    return share;
}
