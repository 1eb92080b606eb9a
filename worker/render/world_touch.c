#include "worker/render/world_touch.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "worker/render/exact.h"
#include "worker/render/world.h"
#include "worker/render/world_place.h"

/* Planes that lean by more than this sine touch along a line only. */
#define TOUCH_LEAN 1e-2
/* Overlaps by less than this share of the triangles' size are edges in common. */
#define TOUCH_EDGE 1e-9

/* A triangle near a volume. */
struct item {
    float low[3], high[3]; /* of its box, grown by `slack` */
    float slack;           /* metres: faces closer than this may touch it */
    uint32_t instance, triangle;
    int crossable, bounds; /* rays may go through it; it bounds a volume */
};

struct finder {
    struct render_scene *w;
    uint8_t **touches;     /* per instance, NULL: none yet */
    struct item *items;
    size_t count, capacity;
    double low[3], high[3]; /* around all volumes */
    struct error *err;
};

static status no_memory(const struct finder *f)
{
    return error_no_memory(f->err, "the volumes' faces");
}

static unsigned flags_of(const struct render_scene *w, uint32_t instance)
{
    const struct world_material *m = &w->materials[w->instances[instance].material];
    unsigned flags = m->flags & (MATERIAL_BOUNDS | MATERIAL_TWO_WAY);

    /* Of a mix any part may be met. */
    return m->m.kind == MATERIAL_MIX ? flags | (w->materials[m->filling].flags & MATERIAL_BOUNDS)
                                     : flags;
}

static int moves(const struct world_instance *instance)
{
    return instance->motion_steps > 0;
}

static double tolerance(const float low[3], const float high[3])
{
    double most = 0;
    int exponent;

    for (int a = 0; a < 3; a++)
        most = fmax(most, fmax(fabs((double)low[a]), fabs((double)high[a])));
    frexp(most, &exponent);
    return ldexp(2 * ACCEL_COINCIDENT_ULPS, exponent - 24);
}

static void bound(const double corner[3][3], struct item *item)
{
    for (int a = 0; a < 3; a++) {
        double low = fmin(corner[0][a], fmin(corner[1][a], corner[2][a]));
        double high = fmax(corner[0][a], fmax(corner[1][a], corner[2][a]));
        item->low[a] = nextafterf((float)low, -INFINITY);
        item->high[a] = nextafterf((float)high, INFINITY);
    }
}

static uint8_t *touches_of(struct finder *f, uint32_t instance)
{
    if (!f->touches[instance]) {
        uint8_t *flags = mem_calloc(f->w->meshes[f->w->instances[instance].mesh].triangle_count, 1);
        if (world_own(f->w, flags))
            f->touches[instance] = flags;
    }
    return f->touches[instance];
}

static status touch_everywhere(struct finder *f, uint32_t instance)
{
    uint8_t *flags = touches_of(f, instance);

    if (!flags)
        return no_memory(f);
    memset(flags, 1, f->w->meshes[f->w->instances[instance].mesh].triangle_count);
    return STATUS_OK;
}

static status all_touch(struct finder *f)
{
    status s = STATUS_OK;

    for (uint32_t i = 0; i < f->w->instance_count && s == STATUS_OK; i++)
        if (flags_of(f->w, i))
            s = touch_everywhere(f, i);
    return s;
}

/* Around all faces of volumes; 0: there are none. */
static int find_region(struct finder *f)
{
    int any = 0;

    for (int a = 0; a < 3; a++) {
        f->low[a] = INFINITY;
        f->high[a] = -INFINITY;
    }
    for (uint32_t i = 0; i < f->w->instance_count; i++) {
        uint32_t triangles = f->w->meshes[f->w->instances[i].mesh].triangle_count;
        if (!(flags_of(f->w, i) & MATERIAL_BOUNDS))
            continue;
        for (uint32_t t = 0; t < triangles; t++) {
            double corner[3][3];
            world_exact_corners(f->w, i, t, 0, corner);
            for (int k = 0; k < 9; k++) {
                f->low[k % 3] = fmin(f->low[k % 3], corner[k / 3][k % 3]);
                f->high[k % 3] = fmax(f->high[k % 3], corner[k / 3][k % 3]);
            }
        }
        any = 1;
    }
    return any;
}

/* All triangles in the region. *too_many: there are more than are looked at. */
static status find_items(struct finder *f, int *too_many)
{
    *too_many = 0;
    for (uint32_t i = 0; i < f->w->instance_count; i++) {
        const struct world_instance *instance = &f->w->instances[i];
        uint32_t triangles = f->w->meshes[instance->mesh].triangle_count;
        unsigned flags = flags_of(f->w, i);
        struct item item = {.instance = i, .crossable = flags != 0,
                            .bounds = (flags & MATERIAL_BOUNDS) != 0};

        for (uint32_t t = 0; t < triangles; t++) {
            double corner[3][3];
            int inside = 1;

            world_exact_corners(f->w, i, t, 0, corner);
            bound(corner, &item);
            item.slack = (float)tolerance(item.low, item.high);
            for (int a = 0; a < 3; a++) {
                item.low[a] = nextafterf(item.low[a] - item.slack, -INFINITY);
                item.high[a] = nextafterf(item.high[a] + item.slack, INFINITY);
                inside &= (double)item.low[a] <= f->high[a] && (double)item.high[a] >= f->low[a];
            }
            if (!inside)
                continue;
            item.triangle = t;
            if (f->count == TOUCH_TRIANGLES_MAX) {
                *too_many = 1;
                return STATUS_OK;
            }
            if (!MEM_GROW(f->items, f->capacity, f->count + 1))
                return no_memory(f);
            f->items[f->count++] = item;
        }
    }
    return STATUS_OK;
}

/* Do their shadows on the plane across `normal` overlap, seen along the edges of `a`? */
static int overlap_along(const double a[3][3], const double b[3][3], const double normal[3])
{
    for (int k = 0; k < 3; k++) {
        double edge[3], across[3], to[3], own, low = INFINITY, high = -INFINITY, slack;

        exact_sub(a[(k + 1) % 3], a[k], edge);
        exact_cross(normal, edge, across);
        exact_sub(a[(k + 2) % 3], a[k], to);
        own = exact_dot(across, to); /* all of `a` is between 0 and this */
        for (int i = 0; i < 3; i++) {
            exact_sub(b[i], a[k], to);
            low = fmin(low, exact_dot(across, to));
            high = fmax(high, exact_dot(across, to));
        }
        slack = TOUCH_EDGE * fmax(fabs(own), high - low);
        if (!(high > fmin(own, 0) + slack && low < fmax(own, 0) - slack))
            return 0;
    }
    return 1;
}

/* May a ray through the inside of both meet them closer than floats tell apart? */
static int coincide(const struct finder *f, const struct item *x, const struct item *y, double slack)
{
    double a[3][3], b[3][3], n[3], m[3], lean[3], n2, m2, low = INFINITY, high = -INFINITY;

    world_exact_corners(f->w, x->instance, x->triangle, 0, a);
    world_exact_corners(f->w, y->instance, y->triangle, 0, b);
    exact_normal(a, n);
    exact_normal(b, m);
    exact_cross(n, m, lean);
    n2 = exact_dot(n, n);
    m2 = exact_dot(m, m);
    if (!(n2 > 0 && m2 > 0) || exact_dot(lean, lean) > TOUCH_LEAN * TOUCH_LEAN * n2 * m2)
        return 0;
    for (int k = 0; k < 3; k++) {
        double to[3], height;
        exact_sub(b[k], a[0], to);
        height = exact_dot(n, to) / sqrt(n2);
        low = fmin(low, height);
        high = fmax(high, height);
    }
    return low < slack && high > -slack && overlap_along(a, b, n) && overlap_along(b, a, n);
}

static status mark(struct finder *f, const struct item *item)
{
    uint8_t *flags;

    if (!item->crossable)
        return STATUS_OK;
    flags = touches_of(f, item->instance);
    if (!flags)
        return no_memory(f);
    flags[item->triangle] = 1;
    return STATUS_OK;
}

static int compare_items(const void *a, const void *b, void *axis)
{
    const struct item *x = a, *y = b;
    float p = x->low[*(const int *)axis], q = y->low[*(const int *)axis];

    if (p != q)
        return p < q ? -1 : 1;
    if (x->instance != y->instance)
        return x->instance < y->instance ? -1 : 1;
    return x->triangle < y->triangle ? -1 : 1;
}

/* Sweep along the region's longest side. *too_many: the sweep was given up. */
static status find_pairs(struct finder *f, int *too_many)
{
    status s = STATUS_OK;
    uint32_t pairs = 0;
    int axis = 0, next, last;

    for (int a = 1; a < 3; a++)
        if (f->high[a] - f->low[a] > f->high[axis] - f->low[axis])
            axis = a;
    next = (axis + 1) % 3;
    last = (axis + 2) % 3;
    qsort_r(f->items, f->count, sizeof *f->items, compare_items, &axis);
    for (size_t i = 0; i < f->count && s == STATUS_OK; i++) {
        const struct item *x = &f->items[i];

        for (size_t k = i + 1; k < f->count && s == STATUS_OK; k++) {
            const struct item *y = &f->items[k];

            if (y->low[axis] > x->high[axis])
                break;
            if (++pairs == TOUCH_PAIRS_MAX) {
                *too_many = 1;
                return STATUS_OK;
            }
            if (!(x->bounds | y->bounds) || y->low[next] > x->high[next] ||
                x->low[next] > y->high[next] || y->low[last] > x->high[last] ||
                x->low[last] > y->high[last] ||
                !coincide(f, x, y, (double)fmaxf(x->slack, y->slack)))
                continue;
            s = mark(f, x);
            if (s == STATUS_OK)
                s = mark(f, y);
        }
    }
    return s;
}

static status find(struct finder *f)
{
    int too_many;
    status s;

    if (!find_region(f))
        return STATUS_OK;
    s = find_items(f, &too_many);
    if (s == STATUS_OK && !too_many)
        s = find_pairs(f, &too_many);
    if (s == STATUS_OK && too_many)
        s = all_touch(f);
    /* What moves while the shutter is open may come to touch anything. */
    for (uint32_t i = 0; i < f->w->instance_count && s == STATUS_OK; i++)
        if (flags_of(f->w, i) && moves(&f->w->instances[i]))
            s = touch_everywhere(f, i);
    return s;
}

status world_touch_find(struct render_scene *w, struct error *err)
{
    struct finder f = {.w = w, .err = err};
    status s;

    f.touches = mem_calloc(w->instance_count, sizeof *f.touches);
    if (!f.touches)
        return no_memory(&f);
    s = find(&f);
    for (uint32_t i = 0; i < w->instance_count; i++)
        w->instances[i].touches = f.touches[i];
    mem_free(f.items);
    mem_free(f.touches);
    return s;
}
