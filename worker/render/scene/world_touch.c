#include "worker/render/scene/world_touch.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "worker/render/scene/box_tree.h"
#include "worker/render/base/exact.h"
#include "worker/render/world.h"
#include "worker/render/scene/world_place.h"

/* Planes inclined by more than this sine touch along a line only. */
#define TOUCH_LEAN 1e-2
/* Overlaps by less than this share of the triangles' size are shared edges. */
#define TOUCH_EDGE 1e-9

/* A triangle near a volume. */
struct item {
    uint32_t instance, triangle;
    real normal[3];   /* unit; 0 for a triangle without area */
    uint8_t crossable; /* rays may pass through it */
    uint8_t touches;
};

struct finder {
    struct render_scene *w;
    uint8_t **touches;       /* per instance, NULL: none yet */
    struct item *items;
    struct world_box *boxes; /* [count] of the items, grown by touch_slack */
    uint8_t *bounds;         /* [count] does the item bound a volume? */
    size_t count, item_capacity, box_capacity, bounds_capacity;
    double low[3], high[3];  /* around all volumes */
    uint64_t pairs_left;     /* pairs still to be tested before the search is given up */
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

    if (w->instances[instance].shape)
        return 0; /* it coincides with nothing */
    /* A ray may meet any part of a mix. */
    return m->m.kind == MATERIAL_MIX ? flags | (w->materials[m->filling].flags & MATERIAL_BOUNDS)
                                     : flags;
}

static int moves(const struct world_instance *instance)
{
    return instance->motion_steps > 0;
}

double touch_slack(const struct accel_digits *digits, const double corner[3][3])
{
    return 2 * fmax(accel_gap(digits, corner[0]),
                    fmax(accel_gap(digits, corner[1]), accel_gap(digits, corner[2])));
}

static void bound(const struct accel_digits *digits, const double corner[3][3], struct world_box *box)
{
    double slack = touch_slack(digits, corner);

    for (int a = 0; a < 3; a++) {
        double low = fmin(corner[0][a], fmin(corner[1][a], corner[2][a])) - slack;
        double high = fmax(corner[0][a], fmax(corner[1][a], corner[2][a])) + slack;
        box->low[a] = nextafterf((float32)low, -INFINITY);
        box->high[a] = nextafterf((float32)high, INFINITY);
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

static int in_region(const struct finder *f, const struct world_box *box)
{
    for (int a = 0; a < 3; a++)
        if ((double)box->low[a] > f->high[a] || (double)box->high[a] < f->low[a])
            return 0;
    return 1;
}

static void find_normal(const double corner[3][3], real out[3])
{
    double n[3], length;

    exact_normal(corner, n);
    length = sqrt(exact_dot(n, n));
    for (int a = 0; a < 3; a++)
        out[a] = length > 0 ? (real)(n[a] / length) : 0;
}

/* All triangles in the region. *too_many: there are more than the limit. */
static status find_items(struct finder *f, int *too_many)
{
    for (uint32_t i = 0; i < f->w->instance_count; i++) {
        uint32_t triangles = f->w->meshes[f->w->instances[i].mesh].triangle_count;
        unsigned flags = flags_of(f->w, i);
        struct item item = {.instance = i, .crossable = flags != 0};

        for (uint32_t t = 0; t < triangles; t++) {
            double corner[3][3];
            struct world_box box;

            world_exact_corners(f->w, i, t, 0, corner);
            bound(&f->w->digits, corner, &box);
            if (!in_region(f, &box))
                continue;
            item.triangle = t;
            find_normal(corner, item.normal);
            if (f->count == TOUCH_TRIANGLES_MAX) {
                *too_many = 1;
                return STATUS_OK;
            }
            if (!MEM_GROW(f->items, f->item_capacity, f->count + 1) ||
                !MEM_GROW(f->boxes, f->box_capacity, f->count + 1) ||
                !MEM_GROW(f->bounds, f->bounds_capacity, f->count + 1))
                return no_memory(f);
            f->bounds[f->count] = (flags & MATERIAL_BOUNDS) != 0;
            f->boxes[f->count] = box;
            f->items[f->count++] = item;
        }
    }
    return STATUS_OK;
}

/* Do their projections along `normal` overlap, seen along the edges of `a`? */
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

/* Do some corners of `b` lie above the plane of `a` minus the slack, and some below it plus the
 * slack? */
static int meets_plane(const double a[3][3], const double normal[3], const double b[3][3],
                       double slack)
{
    double low = INFINITY, high = -INFINITY;

    slack *= sqrt(exact_dot(normal, normal));
    for (int k = 0; k < 3; k++) {
        double to[3], height;
        exact_sub(b[k], a[0], to);
        height = exact_dot(normal, to);
        low = fmin(low, height);
        high = fmax(high, height);
    }
    return low < slack && high > -slack;
}

int touch_coincide(const struct accel_digits *digits, const double a[3][3], const double b[3][3])
{
    double n[3], m[3], lean[3], n2, m2, slack;

    exact_normal(a, n);
    exact_normal(b, m);
    exact_cross(n, m, lean);
    n2 = exact_dot(n, n);
    m2 = exact_dot(m, m);
    if (!(n2 > 0 && m2 > 0) || exact_dot(lean, lean) > TOUCH_LEAN * TOUCH_LEAN * n2 * m2)
        return 0;
    slack = fmax(touch_slack(digits, a), touch_slack(digits, b));
    return meets_plane(a, n, b, slack) && meets_plane(b, m, a, slack) && overlap_along(a, b, n) &&
           overlap_along(b, a, n);
}

/* Skip a face already known to touch one, and a face that no ray crosses. */
static int is_settled(const struct item *item)
{
    return !item->crossable || item->touches;
}

/* Far from parallel, as most neighbours on a curved surface are: no need to read their corners. */
static int leans(const struct item *a, const struct item *b)
{
    const real *n = a->normal, *m = b->normal;
    real cosine = n[0] * m[0] + n[1] * m[1] + n[2] * m[2];

    return cosine * cosine < 1 - (real)(2 * TOUCH_LEAN * TOUCH_LEAN);
}

static int compare(void *user, uint32_t a, uint32_t b)
{
    struct finder *f = user;
    struct item *x = &f->items[a], *y = &f->items[b];

    if (--f->pairs_left == 0)
        return 1;
    if (!leans(x, y) && !(is_settled(x) && is_settled(y))) {
        double p[3][3], q[3][3];

        world_exact_corners(f->w, x->instance, x->triangle, 0, p);
        world_exact_corners(f->w, y->instance, y->triangle, 0, q);
        if (touch_coincide(&f->w->digits, p, q))
            x->touches = y->touches = 1;
    }
    return 0;
}

/* *too_many: the search was given up. */
static status find_pairs(struct finder *f, int *too_many)
{
    status s;

    f->pairs_left = TOUCH_PAIRS_MIN + f->count * TOUCH_PAIRS_EACH;
    s = box_tree_pairs(f->boxes, f->bounds, (uint32_t)f->count, compare, f, f->err);
    *too_many = f->pairs_left == 0;
    return s;
}

static status mark(struct finder *f)
{
    for (size_t i = 0; i < f->count; i++) {
        const struct item *item = &f->items[i];
        uint8_t *flags;

        if (!item->crossable || !item->touches)
            continue;
        flags = touches_of(f, item->instance);
        if (!flags)
            return no_memory(f);
        flags[item->triangle] = 1;
    }
    return STATUS_OK;
}

static status find(struct finder *f)
{
    int too_many = 0;
    status s;

    if (!find_region(f))
        return STATUS_OK;
    s = find_items(f, &too_many);
    if (s == STATUS_OK && !too_many)
        s = find_pairs(f, &too_many);
    if (s == STATUS_OK)
        s = too_many ? all_touch(f) : mark(f);
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
    mem_free(f.boxes);
    mem_free(f.bounds);
    mem_free(f.touches);
    return s;
}
