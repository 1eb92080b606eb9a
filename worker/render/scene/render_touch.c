#include "worker/render/scene/render_touch.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/base/safeguard.h"
#include "worker/render/scene/box_tree.h"
#include "worker/render/base/exact.h"
#include "worker/render/render_scene.h"
#include "worker/render/scene/render_place.h"

/* Planes inclined by more than this sine touch along a line only. */
#define TOUCH_LEAN 1e-2
/* Overlaps by less than this share of the triangles' size are shared edges. */
#define TOUCH_EDGE 1e-9

/* A triangle near a volume. */
struct item {
    uint32_t instance, triangle;
    real normal[3];    /* unit; 0 for a triangle without area */
    uint8_t crossable; /* rays may pass through it */
    uint8_t touches;
    uint8_t near; /* enum render_near */
};

struct finder {
    struct render_scene *w;
    uint8_t **touches; /* per instance, NULL: none yet */
    struct item *items;
    struct render_box *boxes; /* [count] of the items, grown by touch_slack, or by half of */
    double reach;             /* metres; 0: the search is for faces that touch */
    uint8_t *bounds;          /* [count] does the item bound a volume? */
    size_t count, item_capacity, box_capacity, bounds_capacity;
    double low[3], high[3]; /* around all volumes */
    uint64_t pairs_left;    /* pairs still to be tested before the search is given up */
    struct error *err;
};

static status no_memory(const struct finder *f) { return error_no_memory(f->err, "the volumes' faces"); }

static unsigned flags_of_any(const struct render_scene *w, uint32_t instance)
{
    const struct render_material *m = &w->materials[w->instances[instance].material];
    unsigned flags = m->flags & (MATERIAL_BOUNDS | MATERIAL_TWO_WAY);

    /* A ray may meet any part of a mix. */
    return m->m.kind == MATERIAL_MIX ? flags | (w->materials[m->filling].flags & MATERIAL_BOUNDS) : flags;
}

/* A shape coincides with nothing. */
static unsigned flags_of(const struct render_scene *w, uint32_t instance)
{
    return w->instances[instance].shape ? 0 : flags_of_any(w, instance);
}

static int moves(const struct render_instance *instance) { return instance->motion_steps > 0; }

double touch_slack(const struct accel_digits *digits, const double corner[3][3])
{
    return 2 * fmax(accel_gap(digits, corner[0]), fmax(accel_gap(digits, corner[1]), accel_gap(digits, corner[2])));
}

static struct render_box box_around(const double low[3], const double high[3])
{
    struct render_box box;

    for (int a = 0; a < 3; a++) {
        box.low[a] = nextafterf((float32)low[a], -INFINITY);
        box.high[a] = nextafterf((float32)high[a], INFINITY);
    }
    return box;
}

static void triangle_bounds(const double corner[3][3], double slack, double low[3], double high[3])
{
    for (int a = 0; a < 3; a++) {
        low[a] = fmin(corner[0][a], fmin(corner[1][a], corner[2][a])) - slack;
        high[a] = fmax(corner[0][a], fmax(corner[1][a], corner[2][a])) + slack;
    }
}

/* Of a triangle, or of an instance's shape. `slack`: metres on all sides. */
static void face_bounds(const struct render_scene *w, uint32_t instance, uint32_t triangle, double slack, double low[3],
                        double high[3])
{
    const struct shape *shape = w->instances[instance].shape;
    double corner[3][3];

    if (shape) {
        shape_rows[shape->kind].bounds(shape, slack, low, high);
        return;
    }
    triangle_exact_corners(w, instance, triangle, 0, corner);
    triangle_bounds(corner, slack, low, high);
}

static uint8_t *touches_of(struct finder *f, uint32_t instance)
{
    if (!f->touches[instance]) {
        uint8_t *flags = mem_calloc(f->w->meshes[f->w->instances[instance].mesh].triangle_count, 1);
        if (render_scene_own(f->w, flags))
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

/* Shapes count where the search is for near faces. */
static unsigned flags_in(const struct finder *f, uint32_t instance)
{
    return f->reach > 0 ? flags_of_any(f->w, instance) : flags_of(f->w, instance);
}

static uint32_t faces_of(const struct finder *f, uint32_t instance)
{
    const struct render_instance *i = &f->w->instances[instance];

    return !i->shape ? f->w->meshes[i->mesh].triangle_count : f->reach > 0;
}

/* Around all faces of volumes; 0: there are none. */
static int find_region(struct finder *f)
{
    int any = 0;
    double low[3], high[3];

    for (int a = 0; a < 3; a++) {
        f->low[a] = INFINITY;
        f->high[a] = -INFINITY;
    }
    for (uint32_t i = 0; i < f->w->instance_count; i++) {
        if (!(flags_in(f, i) & MATERIAL_BOUNDS))
            continue;
        for (uint32_t t = 0; t < faces_of(f, i); t++) {
            face_bounds(f->w, i, t, 0, low, high);
            for (int a = 0; a < 3; a++) {
                f->low[a] = fmin(f->low[a], low[a]);
                f->high[a] = fmax(f->high[a], high[a]);
            }
        }
        any = 1;
    }
    return any;
}

static int in_region(const struct finder *f, const struct render_box *box)
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

/* Names the face and finds its bounds, and what the search needs of it. */
static void bound(const struct finder *f, struct item *item, uint32_t triangle, double low[3], double high[3])
{
    double corner[3][3];

    item->triangle = triangle;
    if (f->reach > 0) {
        face_bounds(f->w, item->instance, triangle, f->reach / 2, low, high);
        return;
    }
    triangle_exact_corners(f->w, item->instance, triangle, 0, corner);
    triangle_bounds(corner, touch_slack(&f->w->digits, corner), low, high);
    find_normal(corner, item->normal);
}

/* All faces in the region. *too_many: there are more than the limit. */
static status find_items(struct finder *f, int *too_many)
{
    for (uint32_t i = 0; i < f->w->instance_count; i++) {
        unsigned flags = flags_in(f, i);
        struct item item = {.instance = i, .crossable = flags != 0};

        for (uint32_t t = 0; t < faces_of(f, i); t++) {
            double low[3], high[3];
            struct render_box box;

            bound(f, &item, t, low, high);
            box = box_around(low, high);
            if (!in_region(f, &box))
                continue;
            if (f->count == (f->reach > 0 ? NEAR_TRIANGLES_MAX : TOUCH_TRIANGLES_MAX)) {
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

static void finder_release(struct finder *f)
{
    mem_free(f->items);
    mem_free(f->boxes);
    mem_free(f->bounds);
    mem_free(f->touches);
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

/* Do some corners of `b` lie above the plane of `a` minus the slack, and some below it plus the slack? */
static int meets_plane(const double a[3][3], const double normal[3], const double b[3][3], double slack)
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
static int is_settled(const struct item *item) { return !item->crossable || item->touches; }

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

        triangle_exact_corners(f->w, x->instance, x->triangle, 0, p);
        triangle_exact_corners(f->w, y->instance, y->triangle, 0, q);
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

status touch_find(struct render_scene *w, struct error *err)
{
    struct finder f = {.w = w, .err = err};
    status s;

    f.touches = mem_calloc(w->instance_count, sizeof *f.touches);
    if (!f.touches)
        return no_memory(&f);
    s = find(&f);
    for (uint32_t i = 0; i < w->instance_count; i++)
        w->instances[i].touches = f.touches[i];
    finder_release(&f);
    return s;
}

/* ---- faces closer than float's error --------------------------------------------------------- */

/* Are the triangles more than `gap` metres apart along the axis, of any length? Measured from a corner of `a`, so
 * that digits are not lost far from the origin. */
static inline int apart_along(const double a[3][3], const double b[3][3], const double axis[3], double gap)
{
    double to[3], at, low = 0, high = 0, other_low = INFINITY, other_high = -INFINITY, between;

    for (int k = 1; k < 3; k++) {
        exact_sub(a[k], a[0], to);
        at = exact_dot(axis, to);
        low = at < low ? at : low; /* inline: fmin would be a function call */
        high = at > high ? at : high;
    }
    for (int k = 0; k < 3; k++) {
        exact_sub(b[k], a[0], to);
        at = exact_dot(axis, to);
        other_low = at < other_low ? at : other_low;
        other_high = at > other_high ? at : other_high;
    }
    between = low - other_high > other_low - high ? low - other_high : other_low - high;
    return between > 0 && between * between > gap * gap * exact_dot(axis, axis);
}

/* Along a line in the plane of `a`, at right angles to one of its edges? So are neighbours in one mesh. */
static int apart_beside(const double a[3][3], const double normal[3], const double b[3][3], double gap)
{
    double edge[3], axis[3];

    for (int k = 0; k < 3; k++) {
        exact_sub(a[(k + 1) % 3], a[k], edge);
        exact_cross(normal, edge, axis);
        if (apart_along(a, b, axis, gap))
            return 1;
    }
    return 0;
}

int touch_apart(const double a[3][3], const double b[3][3], double gap)
{
    double n[3], m[3], edge[3], other[3], axis[3];

    exact_normal(a, n);
    exact_normal(b, m);
    if (apart_beside(a, n, b, gap) || apart_along(a, b, m, gap) || apart_along(a, b, n, gap) ||
        apart_beside(b, m, a, gap))
        return 1;
    for (int i = 0; i < 3; i++) {
        exact_sub(a[(i + 1) % 3], a[i], edge);
        for (int k = 0; k < 3; k++) {
            exact_sub(b[(k + 1) % 3], b[k], other);
            exact_cross(edge, other, axis);
            if (apart_along(a, b, axis, gap))
                return 1;
        }
    }
    return 0;
}

int touch_near(const double of[3][3], const double other[3][3], double reach)
{
    double inner[3][3];

    return exact_inset(of, reach, inner) && !touch_apart(inner, other, reach / 2) && SAFEGUARD(NEAR_FACES)
               ? RENDER_NEAR_ALL
               : RENDER_NEAR_EDGES;
}

static void come_near(struct item *item, const double of[3][3], const double other[3][3], double reach)
{
    if ((item->near & RENDER_NEAR_ALL) != RENDER_NEAR_ALL)
        item->near |= (uint8_t)touch_near(of, other, reach);
}

static double girth(const struct render_box *box)
{
    double sum = 0;

    for (int a = 0; a < 3; a++)
        sum += (double)box->high[a] - (double)box->low[a];
    return sum;
}

/* In a box of its own, or, where that touches another or there are too many, in the one that it enlarges least. */
static void add_place(struct render_boxes *places, const struct render_box *place)
{
    struct render_box best = *place;
    uint32_t at = places->count;
    double least = INFINITY;

    for (uint32_t i = 0; i < places->count; i++) {
        const struct render_box *box = &places->box[i];
        struct render_box both;
        double added;

        for (int a = 0; a < 3; a++) {
            both.low[a] = real_min(box->low[a], place->low[a]);
            both.high[a] = real_max(box->high[a], place->high[a]);
        }
        added = girth(&both) - girth(box);
        if (added < least && (places->count == RENDER_BOXES_MAX || added < girth(place))) {
            least = added;
            best = both;
            at = i;
        }
    }
    places->box[at] = best;
    places->count += at == places->count;
}

/* One of the two is a shape. Where they are near, all that is there counts as near. */
static void compare_shapes(struct finder *f, struct item *x, struct item *y)
{
    const struct shape *a = f->w->instances[x->instance].shape, *b = f->w->instances[y->instance].shape;
    double low[3] = {-INFINITY, -INFINITY, -INFINITY}, high[3] = {INFINITY, INFINITY, INFINITY};
    struct render_box place;

    if (!a || !b) {
        const struct shape *shape = a ? a : b;
        const struct item *other = a ? y : x;
        double corner[3][3];

        triangle_exact_corners(f->w, other->instance, other->triangle, 0, corner);
        if (!shape_rows[shape->kind].near_triangle(shape, corner, f->reach, low, high))
            return;
    } else if (a->kind == b->kind && !shape_rows[a->kind].near_same(a, b, f->reach, low, high)) {
        return;
    }
    for (int k = 0; k < 2; k++) {
        const struct item *item = k ? x : y;
        double least[3], most[3];

        face_bounds(f->w, item->instance, item->triangle, f->reach, least, most);
        for (int i = 0; i < 3; i++) {
            low[i] = fmax(low[i], least[i]);
            high[i] = fmin(high[i], most[i]);
        }
    }
    place = box_around(low, high);
    if (place.low[0] > place.high[0] || place.low[1] > place.high[1] || place.low[2] > place.high[2] ||
        !SAFEGUARD(NEAR_SHAPES))
        return;
    add_place(&f->w->near_places, &place);
    x->near |= RENDER_NEAR_PLACES;
    y->near |= RENDER_NEAR_PLACES;
}

static int compare_near(void *user, uint32_t a, uint32_t b)
{
    struct finder *f = user;
    struct item *x = &f->items[a], *y = &f->items[b];
    double p[3][3], q[3][3];

    if (--f->pairs_left == 0)
        return 1;
    if (f->w->instances[x->instance].shape || f->w->instances[y->instance].shape) {
        compare_shapes(f, x, y);
        return 0;
    }
    if ((x->near & y->near & RENDER_NEAR_ALL) == RENDER_NEAR_ALL)
        return 0;
    triangle_exact_corners(f->w, x->instance, x->triangle, 0, p);
    triangle_exact_corners(f->w, y->instance, y->triangle, 0, q);
    come_near(x, p, q, f->reach);
    come_near(y, q, p, f->reach);
    return 0;
}

static status mark_near(struct finder *f)
{
    for (size_t i = 0; i < f->count; i++) {
        uint8_t *near;

        if (f->items[i].near == RENDER_NEAR_NONE)
            continue;
        near = touches_of(f, f->items[i].instance);
        if (!near)
            return no_memory(f);
        near[f->items[i].triangle] = f->items[i].near;
    }
    for (uint32_t i = 0; i < f->w->instance_count; i++)
        f->w->instances[i].near = f->touches[i];
    return STATUS_OK;
}

/* *known: every face has been compared. */
static status find_near(struct finder *f, int *known)
{
    int too_many = 0;
    status s = STATUS_OK;

    if (find_region(f)) {
        for (int a = 0; a < 3; a++) {
            f->low[a] -= f->reach;
            f->high[a] += f->reach;
        }
        s = find_items(f, &too_many);
        f->pairs_left = NEAR_PAIRS_MIN + f->count * NEAR_PAIRS_EACH;
        if (s == STATUS_OK && !too_many)
            s = box_tree_pairs(f->boxes, f->bounds, (uint32_t)f->count, compare_near, f, f->err);
        if (s == STATUS_OK && !too_many && f->pairs_left > 0)
            s = mark_near(f);
    }
    *known = !too_many && f->pairs_left > 0;
    return s;
}

/* No ray that meets anything starts farther out than where fog ends, and none ends farther out. */
static double near_reach(const struct render_scene *w)
{
    const double centre[3] = {(double)w->bounds_centre.x, (double)w->bounds_centre.y,
                              (double)w->bounds_centre.z};

    return NEAR_ERRORS * accel_error(w->accel, exact_largest(centre) + 3 * (double)w->fog_radius);
}

status near_find(struct render_scene *w, struct error *err)
{
    struct finder f = {.w = w, .err = err, .pairs_left = 1, .reach = near_reach(w)};
    status s = STATUS_OK;

    w->near_reach = (real)(f.reach * (1 + 0x1p-20));
    if (w->boundaries.count > 0 && !place_moves(w) && isfinite(f.reach)) {
        f.touches = mem_calloc(w->instance_count, sizeof *f.touches);
        s = f.touches ? find_near(&f, &w->near_known) : no_memory(&f);
        finder_release(&f);
    }
    return s;
}
