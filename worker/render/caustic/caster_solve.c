/* caster_solve: where on a triangle a place and a lamp are connected, and how the light spreads on its way.
 *
 * On a triangle of one normal the point has a closed form, but for refraction of a near lamp, which is the root of a
 * monotone function of one unknown. With normals of the vertices there may be none, one or several: the triangle is
 * divided while its parts' bounds allow a point and its normals differ, and each part is solved by Newton's method
 * from its middle; where the determinant changes its sign within a part (a fold: the caustic's rim), from its corners as
 * well. A part without a point is divided further: at grazing angles the method may have run past one. A point counts in
 * the part that holds it.
 */
#include <math.h>
#include <string.h>

#include "worker/render/caustic/casters_parts.h"

/* EMPTY_DIVISIONS: of a part that is narrow and in which no point was found. */
enum { DIVISIONS_MAX = 6, EMPTY_DIVISIONS = 1, NEWTON_MAX = 24, HALVINGS_MAX = 6, BISECTIONS_MAX = 200, FOUND_MAX = 4 };

/* A part is solved when its normals' half angle is below this (cosine: 8 degrees). */
#define NARROW_COSINE 0.99
/* Above this, is_near_fold's figure is far from a fold. */
#define FOLD 0.25
/* Of the second derivative of x / |x|, times |x|^2: 2 / sqrt(3), rounded up. */
#define BEND 1.15471
/* In units of the triangle's edges. */
#define NEWTON_CONVERGED 1e-11
#define LEAST_STEP 0x1p-5
#define SAME_POINT 1e-7
#define EDGE_WIDTH 1e-9

/* ---- small vectors --------------------------------------------------------------------------------- */

static double unit_of(const double a[3], double out[3])
{
    const double length = caster_length(a);

    for (int k = 0; k < 3; k++)
        out[k] = length > 0 ? a[k] / length : 0;
    return length;
}

static void mad(const double a[3], const double b[3], double s, double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = a[k] + b[k] * s;
}

/* Two unit vectors perpendicular to a unit one, and to each other. */
static void frame_of(const double n[3], double s[3], double t[3])
{
    const int least = fabs(n[0]) < fabs(n[1]) ? (fabs(n[0]) < fabs(n[2]) ? 0 : 2) : (fabs(n[1]) < fabs(n[2]) ? 1 : 2);
    double axis[3] = {0, 0, 0}, along[3];

    axis[least] = 1;
    mad(axis, n, -n[least], along);
    unit_of(along, s);
    exact_cross(n, s, t);
}

/* ---- bounds ---------------------------------------------------------------------------------------- */

/* At least the chord between the direction to a sphere's centre and to any of its points, 2 sin(a / 2) for sin a =
 * radius / distance; 2: it may be any. */
static double chord_of(double radius, double inverse_distance)
{
    const double sine = radius * inverse_distance;

    return sine < 1 ? sine + 0.41422 * (sine * sine * sine) : 2;
}

/* To unit length; returns 1 / length, or infinity. */
static double make_unit(double a[3])
{
    const double inverse = 1 / caster_length(a);

    for (int k = 0; k < 3; k++)
        a[k] *= inverse;
    return inverse;
}

void caster_view_of(const struct caster_bounds *bounds, const struct caster_pair *pair, struct caster_view *out)
{
    exact_sub(pair->place, bounds->centre, out->place);
    out->place_chord = chord_of(bounds->radius + pair->place_radius, make_unit(out->place));
    out->lamp_chord = pair->lamp_chord;
    if (pair->infinite) {
        memcpy(out->lamp, pair->lamp, sizeof out->lamp);
    } else {
        exact_sub(pair->lamp, bounds->centre, out->lamp);
        out->lamp_chord = chord_of(bounds->radius + pair->lamp_radius, make_unit(out->lamp));
    }
}

int caster_may(const struct caster_bounds *bounds, const struct caster_view *view, double n_i, double n_o)
{
    const double off = n_i * view->place_chord + n_o * view->lamp_chord;
    double half[3], left, along;

    if (!(bounds->cosine > 0 && off < 4))
        return 1;
    for (int k = 0; k < 3; k++)
        half[k] = n_i * view->place[k] + n_o * view->lamp[k];
    left = exact_dot(half, half) - off * off;
    if (!(left > 0))
        return 1;
    /* Is the angle to the axis below the sum of the cone's and of that by which n_i w_i + n_o w_o may turn? Their
     * cosines, times the length, without a root. */
    along = fabs(exact_dot(half, bounds->axis)) + bounds->sine * off + 1e-9;
    return along * along >= bounds->cosine * bounds->cosine * left;
}

/* ---- a triangle ------------------------------------------------------------------------------------ */

struct solving {
    const struct caster *caster;
    const struct caster_face *face;
    struct caster_pair *pair;
    caster_visit *visit;
    void *user;
    enum caster_event event;
    double n_i, n_o;            /* indices on the place's and on the lamp's side */
    double found[FOUND_MAX][2]; /* in the part in hand */
    int found_count;
};

static void point_at(const struct solving *s, double u, double v, double p[3])
{
    mad(s->face->corner[0], s->face->e1, u, p);
    mad(p, s->face->e2, v, p);
}

static void normal_at(const struct solving *s, double u, double v, double n[3])
{
    mad(s->face->normal[0], s->face->d1, u, n);
    mad(n, s->face->d2, v, n);
}

/* From a point to the lamp: unit; returns the distance, INFINITY if it is at infinity. */
static double to_lamp_of(const struct caster_pair *pair, const double p[3], double out[3])
{
    if (pair->infinite) {
        memcpy(out, pair->lamp, 3 * sizeof *out);
        return INFINITY;
    }
    exact_sub(pair->lamp, p, out);
    return unit_of(out, out);
}

/* ---- how the light spreads ------------------------------------------------------------------------- */

/* The change of the unit normal n / |n| for a change dn of n. */
static void unit_change(const double unit[3], double length, const double dn[3], double out[3])
{
    mad(dn, unit, -exact_dot(unit, dn), out);
    for (int k = 0; k < 3; k++)
        out[k] /= length;
}

/* How the point, and the direction behind it, change when the ray from the place turns. */
struct turned {
    double moved[3], e[3];
};

/* The ray leaves the place in direction d, and turns by the small vector `turn`. `n`: unit shading normal on the place's
 * side, `sign` times the interpolated one over its length. */
static void turn_ray(const struct solving *s, const double d[3], double distance, const double n[3], double sign,
                     double length, const double turn[3], struct turned *out)
{
    double along = exact_dot(s->face->own, turn) / exact_dot(s->face->own, d), dn[3], raw[3], du, dv, c, dc;

    /* The point moves in the face's plane. */
    for (int k = 0; k < 3; k++)
        out->moved[k] = distance * (turn[k] - along * d[k]);
    du = exact_dot(out->moved, s->face->along_u);
    dv = exact_dot(out->moved, s->face->along_v);
    for (int k = 0; k < 3; k++)
        raw[k] = sign * (s->face->d1[k] * du + s->face->d2[k] * dv);
    unit_change(n, length, raw, dn);
    c = -exact_dot(d, n);
    dc = -exact_dot(turn, n) - exact_dot(d, dn);
    if (s->event == CASTER_REFLECTS) {
        for (int k = 0; k < 3; k++)
            out->e[k] = turn[k] + 2 * (dc * n[k] + c * dn[k]);
    } else {
        const double eta = s->n_i / s->n_o, root = sqrt(1 - eta * eta * (1 - c * c)), m = eta * c - root;
        const double dm = eta * dc - eta * eta * c * dc / root;

        for (int k = 0; k < 3; k++)
            out->e[k] = eta * turn[k] + dm * n[k] + m * dn[k];
    }
}

static double spread_of(const struct solving *s, const double d[3], double distance, const double raw_normal[3],
                        const double to_lamp[3], double lamp_distance)
{
    double n[3], across[2][3], up[2][3], matrix[2][2], length = unit_of(raw_normal, n), sign = 1;

    if (exact_dot(n, d) > 0) {
        sign = -1;
        for (int k = 0; k < 3; k++)
            n[k] = -n[k];
    }
    frame_of(d, across[0], across[1]);
    frame_of(to_lamp, up[0], up[1]);
    for (int i = 0; i < 2; i++) {
        struct turned turned;

        turn_ray(s, d, distance, n, sign, length, across[i], &turned);
        for (int j = 0; j < 2; j++)
            matrix[i][j] = s->pair->infinite
                               ? exact_dot(turned.e, up[j])
                               : exact_dot(turned.moved, up[j]) + lamp_distance * exact_dot(turned.e, up[j]);
    }
    return fabs(matrix[0][0] * matrix[1][1] - matrix[0][1] * matrix[1][0]);
}

/* ---- a point that was found ------------------------------------------------------------------------ */

/* Do the directions lie on the sides that the event needs, of the face and of its shading normal? */
static int sides_fit(const struct solving *s, const double to_place[3], const double to_lamp[3], const double n[3])
{
    const double place = exact_dot(to_place, s->face->own), lamp = exact_dot(to_lamp, s->face->own);
    const double place_n = exact_dot(to_place, n), lamp_n = exact_dot(to_lamp, n);
    const int same = s->event == CASTER_REFLECTS;

    return (place > 0) == (place_n * (exact_dot(s->face->own, n) > 0 ? 1 : -1) > 0) && (place * lamp > 0) == same &&
           (place_n * lamp_n > 0) == same;
}

/* Has a point on an edge been met before? Else it is noted. */
static int is_met(const struct solving *s, const double point[3])
{
    struct caster_pair *pair = s->pair;

    for (uint32_t i = 0; i < pair->met_count; i++) {
        double off[3];

        exact_sub(point, pair->met[i], off);
        if (pair->met_event[i] == s->event && caster_length(off) < SAME_POINT * s->face->longest)
            return 1;
    }
    if (pair->met_count < CASTER_MET_MAX) {
        memcpy(pair->met[pair->met_count], point, sizeof *pair->met);
        pair->met_event[pair->met_count++] = s->event;
    }
    return 0;
}

/* `on_edge`: of the triangle, or of a part of it. */
static void report(const struct solving *s, double u, double v, int on_edge)
{
    struct caster_solution out = {.event = s->event, .material = s->caster->material};
    double n[3], to_place[3], to_lamp[3], lamp_distance;

    point_at(s, u, v, out.point);
    normal_at(s, u, v, n);
    exact_sub(out.point, s->pair->place, out.direction);
    out.distance = unit_of(out.direction, out.direction);
    lamp_distance = to_lamp_of(s->pair, out.point, to_lamp);
    for (int k = 0; k < 3; k++)
        to_place[k] = -out.direction[k];
    if (!(out.distance > 0 && lamp_distance > 0) || !sides_fit(s, to_place, to_lamp, n))
        return;
    out.spread = spread_of(s, out.direction, out.distance, n, to_lamp, lamp_distance);
    if (out.spread > 0 && isfinite(out.spread) && !(on_edge && is_met(s, out.point)))
        s->visit(s->user, &out);
}

/* 0: outside, 1: inside, 2: inside, as far as can be told, but on an edge. */
static int place_of(double u, double v)
{
    const double w = 1 - u - v, least = u < v ? (u < w ? u : w) : (v < w ? v : w);

    return least < -EDGE_WIDTH ? 0 : least > EDGE_WIDTH ? 1 : 2;
}

/* ---- triangles of one normal ----------------------------------------------------------------------- */

/* The share of the way from the place's foot to the lamp's at which the light crosses a plane that refracts: heights
 * above and below it, and the way between the feet. Snell's law is monotone in it: Newton's steps, and bisection where
 * they leave the interval. */
static double crossing_share(double h_i, double h_o, double way, double n_i, double n_o)
{
    double low = 0, high = 1, at = h_i / (h_i + h_o);

    for (int i = 0; i < BISECTIONS_MAX; i++) {
        const double a = at * way, b = (1 - at) * way, r_a = sqrt(a * a + h_i * h_i), r_b = sqrt(b * b + h_o * h_o);
        const double f = n_i * a / r_a - n_o * b / r_b;
        const double slope = way * (n_i * h_i * h_i / (r_a * r_a * r_a) + n_o * h_o * h_o / (r_b * r_b * r_b));
        double next = at - f / slope;

        if (f > 0)
            high = at;
        else
            low = at;
        if (!(next > low && next < high))
            next = low + (high - low) / 2;
        if (fabs(next - at) < 1e-15)
            return next;
        at = next;
    }
    return at;
}

static void solve_flat(struct solving *s)
{
    const struct caster_pair *pair = s->pair;
    const double *n = s->face->own;
    double from[3], to[3], h_i, h_o, foot_i[3], foot_o[3], p[3], off[3], u, v;

    exact_sub(pair->place, s->face->corner[0], from);
    h_i = exact_dot(from, n);
    mad(pair->place, n, -h_i, foot_i);
    if (pair->infinite) {
        double sine2, across[3];

        h_o = exact_dot(pair->lamp, n);
        mad(pair->lamp, n, -h_o, across); /* of length sin */
        if (s->event == CASTER_REFLECTS) {
            mad(foot_i, across, fabs(h_i / h_o), p);
        } else {
            for (int k = 0; k < 3; k++)
                across[k] *= s->n_o / s->n_i;
            sine2 = exact_dot(across, across);
            if (!(sine2 < 1))
                return;
            mad(foot_i, across, fabs(h_i) / sqrt(1 - sine2), p);
        }
    } else {
        double share, way[3];

        exact_sub(pair->lamp, s->face->corner[0], to);
        h_o = exact_dot(to, n);
        mad(pair->lamp, n, -h_o, foot_o);
        exact_sub(foot_o, foot_i, way);
        share = s->event == CASTER_REFLECTS ? fabs(h_i) / (fabs(h_i) + fabs(h_o))
                                            : crossing_share(fabs(h_i), fabs(h_o), caster_length(way), s->n_i, s->n_o);
        mad(foot_i, way, share, p);
    }
    if (!(h_i != 0 && h_o != 0) || (h_i * h_o > 0) != (s->event == CASTER_REFLECTS))
        return;
    exact_sub(p, s->face->corner[0], off);
    u = exact_dot(off, s->face->along_u);
    v = exact_dot(off, s->face->along_v);
    if (place_of(u, v))
        report(s, u, v, place_of(u, v) == 2);
}

/* ---- triangles with normals of their vertices ------------------------------------------------------ */

/* The constraint at a point of the triangle: (n_i w_i + n_o w_o) x n along two axes, and its derivatives. */
struct constraint {
    double value[2], by_u[2], by_v[2], size; /* size: |n_i w_i + n_o w_o| |n| */
    double normal_length, place_distance, lamp_distance;
};

static void direction_change(const double w[3], double distance, const double edge[3], double out[3])
{
    const double along = exact_dot(w, edge);

    for (int k = 0; k < 3; k++)
        out[k] = -(edge[k] - along * w[k]) / distance;
}

static void constrain(const struct solving *s, double u, double v, const double axis[2][3], struct constraint *out)
{
    double p[3], n[3], w_i[3], w_o[3], h[3], d_i, d_o, cross[3];

    point_at(s, u, v, p);
    normal_at(s, u, v, n);
    exact_sub(s->pair->place, p, w_i);
    d_i = unit_of(w_i, w_i);
    d_o = to_lamp_of(s->pair, p, w_o);
    for (int k = 0; k < 3; k++)
        h[k] = s->n_i * w_i[k] + s->n_o * w_o[k];
    exact_cross(h, n, cross);
    out->normal_length = caster_length(n);
    out->place_distance = d_i;
    out->lamp_distance = d_o;
    out->size = caster_length(h) * out->normal_length;
    for (int i = 0; i < 2; i++)
        out->value[i] = exact_dot(cross, axis[i]);
    for (int j = 0; j < 2; j++) {
        const double *edge = j ? s->face->e2 : s->face->e1, *dn = j ? s->face->d2 : s->face->d1;
        double dh[3], of_place[3], of_lamp[3] = {0, 0, 0}, other[3];

        direction_change(w_i, d_i, edge, of_place);
        if (!s->pair->infinite)
            direction_change(w_o, d_o, edge, of_lamp);
        for (int k = 0; k < 3; k++)
            dh[k] = s->n_i * of_place[k] + s->n_o * of_lamp[k];
        exact_cross(dh, n, cross);
        exact_cross(h, dn, other);
        for (int i = 0; i < 2; i++)
            (j ? out->by_v : out->by_u)[i] = exact_dot(cross, axis[i]) + exact_dot(other, axis[i]);
    }
}

static double determinant_of(const struct constraint *c) { return c->by_u[0] * c->by_v[1] - c->by_u[1] * c->by_v[0]; }

static double squared(const double a[2]) { return a[0] * a[0] + a[1] * a[1]; }

/* 1: converged to a point, inside of the triangle or not. */
static int newton(const struct solving *s, const double axis[2][3], double *u, double *v)
{
    struct constraint c, next;

    constrain(s, *u, *v, axis, &c);
    for (int i = 0; i < NEWTON_MAX; i++) {
        const double det = determinant_of(&c);
        const double du = -(c.value[0] * c.by_v[1] - c.value[1] * c.by_v[0]) / det;
        const double dv = -(c.by_u[0] * c.value[1] - c.by_u[1] * c.value[0]) / det;
        double step = 1;

        if (!(det != 0 && isfinite(du) && isfinite(dv)))
            return 0;
        if (fabs(du) + fabs(dv) < NEWTON_CONVERGED)
            return sqrt(squared(c.value)) < 1e-8 * c.size;
        for (int k = 0; k < HALVINGS_MAX; k++, step /= 2) {
            constrain(s, *u + step * du, *v + step * dv, axis, &next);
            if (squared(next.value) < squared(c.value))
                break;
        }
        step = step < LEAST_STEP ? LEAST_STEP : step;
        *u += step * du;
        *v += step * dv;
        if (!(fabs(*u) < 4 && fabs(*v) < 4))
            return 0;
        c = next;
    }
    return 0;
}

/* A part of the triangle: its corners in u, v. */
struct part {
    double u[3], v[3];
};

/* place_of, in the part. */
static int place_in(const struct part *part, double u, double v)
{
    const double a = part->u[1] - part->u[0], b = part->v[1] - part->v[0], c = part->u[2] - part->u[0],
                 d = part->v[2] - part->v[0], det = a * d - b * c, x = u - part->u[0], y = v - part->v[0];

    return place_of((x * d - y * c) / det, (a * y - b * x) / det);
}

static void start_at(struct solving *s, const struct part *part, const double axis[2][3], double u, double v)
{
    int place;

    if (!newton(s, axis, &u, &v))
        return;
    place = place_in(part, u, v);
    if (!place)
        return;
    for (int i = 0; i < s->found_count; i++)
        if (fabs(s->found[i][0] - u) + fabs(s->found[i][1] - v) < SAME_POINT)
            return;
    if (s->found_count == FOUND_MAX)
        return;
    s->found[s->found_count][0] = u;
    s->found[s->found_count][1] = v;
    s->found_count++;
    if (place_of(u, v))
        report(s, u, v, place == 2 || place_of(u, v) == 2);
}

/* By the singular values a, b of the constraint's derivatives along the plane: 2 a b / (a^2 + b^2) is 0 at a fold, and 1
 * where a plane is met at a right angle. */
static int is_near_fold(const struct solving *s, const struct constraint *c)
{
    const double *e1 = s->face->e1, *e2 = s->face->e2;
    const double a = exact_dot(e1, e1), b = exact_dot(e2, e2), both = exact_dot(e1, e2);
    double sum = 0;

    for (int i = 0; i < 2; i++)
        sum += c->by_u[i] * c->by_u[i] * b - 2 * c->by_u[i] * c->by_v[i] * both + c->by_v[i] * c->by_v[i] * a;
    return !(2 * fabs(determinant_of(c)) * sqrt(a * b - both * both) > FOLD * sum);
}

static double larger(double a, double b) { return a > b ? a : b; } /* fmax would be a function call */

/* May the constraint be zero in the part? `c`: at its middle u, v. Within the part it differs from its tangent plane
 * there by half of its second derivative: that of the unit vector to something at distance d is at most BEND / d^2,
 * the first 1 / d, and the normal is linear. So it is zero nowhere if a line parts the plane's triangle from zero by
 * more. */
static int may_be_zero(const struct solving *s, const struct part *part, double u, double v, const struct constraint *c)
{
    double at[3][2], r2 = 0, dn2 = 0, r, dn, i, o, off;

    for (int k = 0; k < 3; k++) {
        const double du = part->u[k] - u, dv = part->v[k] - v;
        double moved[3] = {0, 0, 0}, turned[3] = {0, 0, 0};

        mad(moved, s->face->e1, du, moved);
        mad(moved, s->face->e2, dv, moved);
        mad(turned, s->face->d1, du, turned);
        mad(turned, s->face->d2, dv, turned);
        r2 = larger(r2, exact_dot(moved, moved));
        dn2 = larger(dn2, exact_dot(turned, turned));
        for (int j = 0; j < 2; j++)
            at[k][j] = c->value[j] + c->by_u[j] * du + c->by_v[j] * dv;
    }
    r = sqrt(r2);
    dn = sqrt(dn2);
    if (!(2 * r < c->place_distance && 2 * r < c->lamp_distance))
        return 1;
    i = s->n_i * r / (c->place_distance - r);
    o = s->n_o * r / (c->lamp_distance - r);
    off = BEND / 2 * (i * i / s->n_i + o * o / s->n_o) * (c->normal_length + dn) + (i + o) * dn + 1e-8 * c->size;
    for (int k = 0; k < 3; k++) {
        const double *from = at[k], *to = at[(k + 1) % 3], *other = at[(k + 2) % 3];
        const double x = from[1] - to[1], y = to[0] - from[0];
        const double edge = x * from[0] + y * from[1], corner = x * other[0] + y * other[1];
        const double least = fabs(edge) < fabs(corner) ? fabs(edge) : fabs(corner);

        if ((edge > 0) == (corner > 0) && least * least > off * off * (x * x + y * y))
            return 0;
    }
    return 1;
}

/* 0: nothing was found, and there may be something. */
static int solve_part(struct solving *s, const struct part *part)
{
    const double u = (part->u[0] + part->u[1] + part->u[2]) / 3, v = (part->v[0] + part->v[1] + part->v[2]) / 3;
    struct constraint c;
    double n[3], axis[2][3], middle;
    int folds = 0, near_fold;

    normal_at(s, u, v, n);
    unit_of(n, n);
    frame_of(n, axis[0], axis[1]);
    s->found_count = 0;
    constrain(s, u, v, axis, &c);
    if (!may_be_zero(s, part, u, v, &c))
        return 1;
    middle = determinant_of(&c);
    near_fold = is_near_fold(s, &c);
    start_at(s, part, axis, u, v);
    for (int i = 0; i < 3 && near_fold; i++) {
        constrain(s, part->u[i], part->v[i], axis, &c);
        folds |= !(determinant_of(&c) * middle > 0);
    }
    for (int i = 0; i < 3 && folds; i++)
        start_at(s, part, axis, part->u[i], part->v[i]);
    return s->found_count > 0;
}

static void bounds_of_part(const struct solving *s, const struct part *part, struct caster_bounds *out)
{
    double corner[3][3], normal[3][3];

    for (int i = 0; i < 3; i++) {
        point_at(s, part->u[i], part->v[i], corner[i]);
        normal_at(s, part->u[i], part->v[i], normal[i]);
    }
    caster_bounds_of(corner, normal, out);
}

/* As wide as this, in chords, a part is divided. */
#define WIDE 0.25

static void divide(struct solving *s, const struct part *part, int level)
{
    struct caster_bounds made;
    const struct caster_bounds *bounds = &s->face->bounds;
    struct caster_view view;

    if (level > 0) {
        bounds_of_part(s, part, &made);
        bounds = &made;
    }
    caster_view_of(bounds, s->pair, &view);
    if (!caster_may(bounds, &view, s->n_i, s->n_o))
        return;
    if (level >= DIVISIONS_MAX || (bounds->cosine > NARROW_COSINE && view.place_chord < WIDE && view.lamp_chord < WIDE)) {
        if (solve_part(s, part) || level >= DIVISIONS_MAX)
            return;
        level = level < DIVISIONS_MAX - EMPTY_DIVISIONS ? DIVISIONS_MAX - EMPTY_DIVISIONS : level;
    }
    for (int i = 0; i < 4; i++) { /* three at the corners, one in the middle */
        struct part smaller;

        for (int k = 0; k < 3; k++) {
            const int j = i < 3 ? i : (k + 1) % 3;

            smaller.u[k] = (part->u[k] + part->u[j]) / 2;
            smaller.v[k] = (part->v[k] + part->v[j]) / 2;
        }
        divide(s, &smaller, level + 1);
    }
}

static void solve_event(struct solving *s, enum caster_event event, double n_i, double n_o)
{
    const struct part whole = {{0, 1, 0}, {0, 0, 1}};

    s->event = event;
    s->n_i = n_i;
    s->n_o = n_o;
    if (s->face->flat)
        solve_flat(s);
    else
        divide(s, &whole, 0);
}

void caster_solve(const struct caster *caster, const struct caster_face *face, struct caster_pair *pair,
                  caster_visit *visit, void *user)
{
    struct solving s = {.caster = caster, .face = face, .pair = pair, .visit = visit, .user = user};
    double from[3], place, lamp;

    exact_sub(pair->place, face->corner[0], from);
    place = exact_dot(from, face->own);
    if (!pair->infinite)
        exact_sub(pair->lamp, face->corner[0], from);
    lamp = exact_dot(pair->infinite ? pair->lamp : from, face->own);
    if (place * lamp > 0 && caster->events & 1u << CASTER_REFLECTS)
        solve_event(&s, CASTER_REFLECTS, 1, 1);
    if (place * lamp < 0 && caster->events & 1u << CASTER_REFRACTS)
        solve_event(&s, CASTER_REFRACTS, place > 0 ? 1 : caster->ior, place > 0 ? caster->ior : 1);
}
