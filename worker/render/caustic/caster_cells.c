/* caster_cells: from which nodes of a caster's tree a search has to go down, for all places of a cell of space.
 *
 * Near places ask alike, and most of a search goes into the large nodes, which leave nothing out: a wave is as long as
 * they are. So the search is made once with the whole cell as its place, and stopped at nodes that are small beside the
 * cell. What it leaves out has no solution for any place of the cell, so a cell, or the lack of one, changes no result,
 * only the time. Cells are made when they are first asked for, by whichever thread; there is room for a limited number.
 */
#include <stdatomic.h>
#include <string.h>

#include "common/base/memory.h"
#include "worker/render/base/sampler.h"
#include "worker/render/caustic/casters_parts.h"

enum { SLOTS = 1 << 16, PROBES = 8, STARTS_MAX = 1024 };
/* Cells have about the width of the tree's leaves, but there are between so many to a caster's radius; and at least so
 * much of the distance to it. SUN_CELL: the width of a cell of a sun's directions. */
#define ACROSS_MIN 8.0
#define ACROSS_MAX 64.0
#define OF_DISTANCE (1.0 / 16)
#define SUN_CELL (1.0 / 64)
/* A node is small if its radius is less than this share of the cell's. */
#define SMALL 0.5

struct key {
    double lamp[3], lamp_radius; /* of a sun: its cell */
    int64_t place[3];
    uint32_t caster, kind;
    int32_t width; /* its binary exponent */
    int32_t zero;
};

struct cell {
    struct key key;
    uint32_t count, starts[];
};

struct caster_cells {
    _Atomic(struct cell *) slots[SLOTS];
    _Atomic size_t bytes;
};

status caster_cells_new(struct caster_cells **out, struct error *err)
{
    *out = mem_calloc(1, sizeof **out);
    NEED(*out, err, "what casts caustics");
    atomic_store(&(*out)->bytes, sizeof **out);
    return STATUS_OK;
}

void caster_cells_free(struct caster_cells *cells)
{
    for (size_t i = 0; cells && i < SLOTS; i++)
        mem_free(atomic_load_explicit(&cells->slots[i], memory_order_relaxed));
    mem_free(cells);
}

size_t caster_cells_bytes(const struct caster_cells *cells) { return atomic_load(&cells->bytes); }

/* ---- may a node have a solution? ------------------------------------------------------------------- */

/* On which side of all faces of the node lies what its points see in a direction, to within a chord? 1: in front, -1:
 * behind, 0: not known. */
static int side_of(const struct caster_node *node, const double direction[3], double chord)
{
    const double along = exact_dot(node->front, direction);
    /* The chord is not less than the angle's sine; its cosine is taken as not larger than the angle's. */
    const double least = node->front_sine + node->front_cosine * chord + 1e-9;

    if (node->front_cosine < 0 || chord >= 2)
        return 0;
    return along > least ? 1 : along < -least ? -1 : 0;
}

int caster_node_may(const struct caster *caster, const struct caster_node *node, const struct caster_pair *pair)
{
    struct caster_view view;
    int place, lamp;

    if (pair->kind == CASTER_LAMP_SUN && !node->sunlit)
        return 0;
    caster_view_of(&node->bounds, pair, &view);
    place = side_of(node, view.place, view.place_chord);
    lamp = side_of(node, view.lamp, view.lamp_chord);
    return (place * lamp >= 0 && caster->events & 1u << CASTER_REFLECTS && caster_may(&node->bounds, &view, 1, 1)) ||
           (place * lamp <= 0 && caster->events & 1u << CASTER_REFRACTS &&
            ((place >= 0 && lamp <= 0 && caster_may(&node->bounds, &view, 1, caster->ior)) ||
             (place <= 0 && lamp >= 0 && caster_may(&node->bounds, &view, caster->ior, 1))));
}

/* ---- cells ----------------------------------------------------------------------------------------- */

static void key_of(const struct caster *caster, uint32_t number, const double place[3], const struct caster_lamp *lamp,
                   struct key *out)
{
    const struct caster_bounds *all = &caster->nodes[0].bounds;
    double from[3], away, width;
    int exponent;

    memset(out, 0, sizeof *out);
    exact_sub(place, all->centre, from);
    away = caster_length(from) - all->radius;
    width = all->radius / fmin(fmax(sqrt((double)caster->node_count), ACROSS_MIN), ACROSS_MAX);
    (void)frexp(fmax(width, away * OF_DISTANCE), &exponent);
    out->caster = number;
    out->kind = (uint32_t)lamp->kind;
    out->width = exponent - 1;
    out->lamp_radius = lamp->radius;
    for (int k = 0; k < 3; k++) {
        out->place[k] = (int64_t)floor(ldexp(place[k], -out->width));
        out->lamp[k] = lamp->kind == CASTER_LAMP_SUN ? floor(lamp->at[k] / SUN_CELL) : lamp->middle[k];
    }
}

static uint64_t hash_of(const struct key *key)
{
    uint64_t words[sizeof *key / sizeof(uint64_t)], hash = 0;

    memcpy(words, key, sizeof words);
    for (size_t i = 0; i < sizeof words / sizeof *words; i++)
        hash = (hash ^ words[i]) * 0x9e3779b97f4a7c15u ^ hash >> 32;
    return hash_u64(hash);
}

/* Nodes in the tree's order. Returns how many; none, and the root, where they are too many. */
static uint32_t starts_in(const struct caster *caster, const struct key *key, uint32_t starts[STARTS_MAX])
{
    struct caster_pair pair = {.kind = key->kind, .infinite = key->kind != CASTER_LAMP_NEAR};
    double place[3], lamp[3], width = ldexp(1, key->width);
    uint32_t waiting[CASTER_DEPTH_MAX], left = 0, at = 0, count = 0;

    for (int k = 0; k < 3; k++) {
        place[k] = ((double)key->place[k] + 0.5) * width;
        lamp[k] = key->kind == CASTER_LAMP_SUN ? (key->lamp[k] + 0.5) * SUN_CELL : key->lamp[k];
    }
    pair.place = place;
    pair.lamp = lamp;
    pair.place_radius = 0.8661 * width; /* sqrt(3) / 2 */
    pair.lamp_radius = key->lamp_radius;
    if (key->kind == CASTER_LAMP_SUN) {
        /* Half of the cell's diagonal to its middle, and as much from there to the unit vector. */
        const double length = caster_length(lamp);

        pair.lamp_chord = 1.7321 * SUN_CELL;
        for (int k = 0; k < 3; k++)
            lamp[k] /= length;
    }
    for (;;) {
        const struct caster_node *node = &caster->nodes[at];

        if (caster_node_may(caster, node, &pair)) {
            if (node->count == 0 && node->bounds.radius > SMALL * pair.place_radius) {
                waiting[left++] = node->first;
                at++;
                continue;
            }
            if (count == STARTS_MAX) {
                starts[0] = 0;
                return 1;
            }
            starts[count++] = at;
        }
        if (left == 0)
            return count;
        at = waiting[--left];
    }
}

/* NULL: there is no room, which is known before the search. */
static struct cell *cell_new(struct caster_cells *cells, const struct caster *caster, const struct key *key)
{
    uint32_t starts[STARTS_MAX], count;
    struct cell *cell;
    size_t bytes;

    if (atomic_load(&cells->bytes) > CASTER_CELLS_BYTES - sizeof *cell - sizeof starts)
        return NULL;
    count = starts_in(caster, key, starts);
    bytes = sizeof *cell + count * sizeof *starts;
    cell = mem_alloc(bytes);
    if (!cell)
        return NULL;
    atomic_fetch_add(&cells->bytes, bytes);
    cell->key = *key;
    cell->count = count;
    memcpy(cell->starts, starts, count * sizeof *starts);
    return cell;
}

const uint32_t *caster_cells_find(struct caster_cells *cells, const struct caster *caster, uint32_t number,
                                  const double place[3], const struct caster_lamp *lamp, uint32_t *count)
{
    static const uint32_t root = 0;
    struct key key;
    uint64_t hash;

    *count = 1;
    key_of(caster, number, place, lamp, &key);
    hash = hash_of(&key);
    for (uint32_t i = 0; i < PROBES; i++) {
        _Atomic(struct cell *) *slot = &cells->slots[(hash + i) % SLOTS];
        struct cell *cell = atomic_load_explicit(slot, memory_order_acquire), *empty = NULL;

        if (!cell) {
            cell = cell_new(cells, caster, &key);
            if (!cell)
                return &root;
            if (!atomic_compare_exchange_strong(slot, &empty, cell)) {
                atomic_fetch_sub(&cells->bytes, sizeof *cell + cell->count * sizeof *cell->starts);
                mem_free(cell);
                cell = empty; /* another thread's */
            }
        }
        if (memcmp(&cell->key, &key, sizeof key) == 0) {
            *count = cell->count;
            return cell->starts;
        }
    }
    return &root;
}
