#include "coordinator/frame/eta.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"

#define MEMORY_S 30.0        /* after so long a rate counts 1 / e */
#define KNOWN_S 0.2          /* a rate over a shorter time means nothing */

/* ---- what is left ---------------------------------------------------------------------------- */

static uint64_t tile_pixels(const struct film *film, uint32_t tile)
{
    struct tile_rect rect = tile_rect_of(film_width(film), film_height(film), tile);

    return (uint64_t)rect.width * rect.height;
}

/* Sums over all tiles, and what they were made of. */
struct eta_sums {
    struct eta_state {
        uint64_t results, wanted, samples;
    } left_of, whole_of;
    double left_ns, whole_ns;
};

void eta_init(struct eta *eta, const struct film *film)
{
    eta->of = mem_calloc(film_tile_count(film), sizeof *eta->of);
    eta->known = mem_calloc(1, sizeof *eta->known);
    eta->results = 0;
    eta->tiles = eta->of && eta->known ? film_tile_count(film) : 0;
    for (uint32_t i = 0; i < eta->tiles; i++) {
        eta->of[i].arrived = eta->of[i].rayed = tile_pixels(film, i) * film_tile_samples(film, i);
        for (uint32_t g = 0; g < GROUPS; g++)
            eta->of[i].rays += film_tile_rays(film, i, g);
    }
}

void eta_release(struct eta *eta)
{
    mem_free(eta->of);
    mem_free(eta->known);
    memset(eta, 0, sizeof *eta);
}

void eta_learn(struct eta *eta, uint32_t tile, uint64_t samples, uint64_t cpu_ns)
{
    if (tile >= eta->tiles)
        return;
    eta->results++;
    eta->of[tile].cpu_ns += (double)cpu_ns;
    eta->of[tile].samples += (double)samples;
    eta->of[tile].arrived += samples;
}

/* The frame's cost per sample, and per ray if it is known; 0: not known. */
struct means {
    double sample_ns, ray_ns;
};

static struct means means_of(const struct eta *eta, const struct film *film)
{
    double cpu_ns = 0, samples = 0;

    for (uint32_t i = 0; i < eta->tiles; i++) {
        cpu_ns += eta->of[i].cpu_ns;
        samples += eta->of[i].samples;
    }
    if (samples <= 0)
        return (struct means){0, 0};
    return (struct means){cpu_ns / samples,
                          film_rays(film) > 0 ? cpu_ns / samples * (double)film_samples(film) / (double)film_rays(film)
                                              : 0};
}

/* Of one sample; 0: no result of the tile has come. */
static double own_ns(const struct eta_tile *tile, const struct means *means)
{
    if (tile->samples > 0)
        return tile->cpu_ns / tile->samples;
    return tile->rayed > 0 ? means->ray_ns * (double)tile->rays / (double)tile->rayed : 0;
}

static double sample_ns(const struct eta *eta, const struct film *film, uint32_t tile, const struct means *means)
{
    uint32_t across = tiles_across(film_width(film)), x = tile % across, count = 0;
    double own = own_ns(&eta->of[tile], means), sum = 0;

    if (own > 0)
        return own;
    for (int dy = -1; dy <= 1; dy++)
        for (int dx = -1; dx <= 1; dx++) {
            int64_t at = (int64_t)tile + dy * (int64_t)across + dx;
            double ns;
            if (at < 0 || at >= eta->tiles || (x == 0 && dx < 0) || (x + 1 == across && dx > 0))
                continue;
            ns = own_ns(&eta->of[at], means);
            sum += ns;
            count += ns > 0;
        }
    return count > 0 ? sum / count : means->sample_ns;
}

/* Samples a pixel that the film wants of the tile. */
static uint64_t wanted_samples(const struct film *film, uint32_t tile)
{
    uint64_t samples = 0;

    for (uint32_t g = 0; g < GROUPS; g++) {
        uint32_t wanted = film_tile_wanted(film, tile, g), begin, end = 0;
        if (wanted > 0)
            pass_range(film_spp(film), g, wanted - 1, &begin, &end);
        samples += end;
    }
    return samples;
}

static double sum_left(const struct eta *eta, const struct film *film)
{
    struct means means = means_of(eta, film);
    double left_ns = 0;

    if (means.sample_ns <= 0)
        return -1;
    for (uint32_t i = 0; i < eta->tiles; i++) {
        uint64_t wanted = wanted_samples(film, i) * tile_pixels(film, i);
        if (wanted > eta->of[i].arrived)
            left_ns += (double)(wanted - eta->of[i].arrived) * sample_ns(eta, film, i, &means);
    }
    return left_ns;
}

static double sum_whole(const struct eta *eta, const struct film *film)
{
    struct means means = means_of(eta, film);
    double ns = 0;

    if (means.sample_ns <= 0)
        return -1;
    for (uint32_t i = 0; i < eta->tiles; i++)
        ns += (double)tile_pixels(film, i) * film_spp(film) * sample_ns(eta, film, i, &means);
    return ns;
}

/* Is the sum of another state of the frame? Then it is of this one from now on. */
static int is_new(struct eta_state *of, const struct eta *eta, const struct film *film)
{
    const struct eta_state now = {eta->results, film_wanted(film), film_samples(film)};

    if (memcmp(of, &now, sizeof now) == 0)
        return 0;
    *of = now;
    return 1;
}

double eta_left_ns(const struct eta *eta, const struct film *film)
{
    if (eta->results == 0)
        return -1;
    if (is_new(&eta->known->left_of, eta, film))
        eta->known->left_ns = sum_left(eta, film);
    return eta->known->left_ns;
}

double eta_whole_ns(const struct eta *eta, const struct film *film)
{
    if (eta->results == 0)
        return -1;
    if (is_new(&eta->known->whole_of, eta, film))
        eta->known->whole_ns = sum_whole(eta, film);
    return eta->known->whole_ns;
}

/* ---- how fast -------------------------------------------------------------------------------- */

static double threads_of(const struct throughput *t) { return t->threads > 0 ? t->threads : 1; }

/* Since the last result, or since the number of threads changed. */
static double since_s(const struct throughput *t, uint64_t now_ns)
{
    return fmax((double)now_ns - (double)t->last_ns, 0) / 1e9 - t->passed_s;
}

void throughput_set_threads(struct throughput *t, uint32_t threads, uint64_t now_ns)
{
    double more_s = since_s(t, now_ns);

    if (threads == t->threads)
        return;
    if (t->last_ns && more_s > 0) {
        t->passed_threads_s += more_s * threads_of(t);
        t->passed_s += more_s;
    }
    t->threads = threads;
}

void throughput_add(struct throughput *t, uint64_t cpu_ns, uint64_t now_ns)
{
    double more_s, kept;

    if (t->last_ns == 0) { /* the first results were begun before the clock ran */
        t->last_ns = now_ns ? now_ns : 1;
        return;
    }
    more_s = fmax(since_s(t, now_ns), 0);
    kept = det_exp_d(-(t->passed_s + more_s) / MEMORY_S);
    t->cpu_s = t->cpu_s * kept + (double)cpu_ns / 1e9;
    t->wall_s = t->wall_s * kept + t->passed_s + more_s;
    t->threads_s = t->threads_s * kept + t->passed_threads_s + more_s * threads_of(t);
    throughput_idle(t, now_ns > t->last_ns ? now_ns : t->last_ns);
}

void throughput_idle(struct throughput *t, uint64_t now_ns)
{
    if (t->last_ns)
        t->last_ns = now_ns;
    t->passed_s = t->passed_threads_s = 0;
}

double throughput_of(const struct throughput *t)
{
    return t->wall_s >= KNOWN_S ? t->cpu_s / t->threads_s * threads_of(t) : 0;
}
