#include "worker/render/accel/accel_parts.h"

#include <math.h>
#include <string.h>

/* Embree's ray starts this many errors before the real start. Otherwise a triangle right in front
 * of the start could seem to lie behind it. */
#define BACK_ERRORS 64.0
/* A ray this many errors away from the edges of the single face that it leaves may start off it. */
#define INSET_ERRORS 64.0
/* ... and it is moved at most so many times as far as it should be from the edges. */
#define INSET_WAYS 4.0
/* What stands at a face's edges counts as if its edges were at most so many times as long as the face's. Up to
 * INSET_ERRORS times that ratio, Embree's error over a neighbour is still less than what keeps it away. */
#define NEIGHBOUR_RATIO 16.0
/* Double decides about a plane to which the ray makes a smaller angle than this. */
#define GRAZING_COSINE 0x1p-18
/* A ray that leaked is traced again at most this many times, turned by this angle (radians),
 * doubled each time: rounding errors at edges are about 2^-22 of their distance. */
enum { LEAK_ATTEMPTS = 8 };
#define LEAK_ANGLE 0x1p-20f

/* ---- Embree's proposals ------------------------------------------------------------------- */

/* Is float reliable when it says that the triangle is met? Not if its plane is so near to an end of the ray that the
 * side is uncertain. `t`: metres by Embree. `along`: the direction times the normal. `area2`: the normal's square, in a
 * space in which lengths of the world are scaled by at least `stretch`. */
static inline int is_certain(const struct query_context *q, const struct accel_geometry *g, uint32_t triangle, double t,
                             double along, double area2, double stretch)
{
    double reach = t, height2, error2;

    if (!SAFEGUARD(DOUBLE_DECIDES))
        return t > 0;
    /* For a ray along the plane Embree's t is a quotient of two rounding errors: any number. */
    if (!(t > q->near_start) || !(t * q->off_cosine > q->clear) ||
        (!(along * along > GRAZING_COSINE * GRAZING_COSINE * area2) && SAFEGUARD(GRAZING_RAY)))
        return 0;
    if (q->reaches) {
        reach = fmin(t, q->length - t);
        if (!(reach > q->near_end))
            return 0;
    }
    height2 = reach * along * stretch;
    height2 *= height2;
    error2 = q->error * q->error * area2;
    if (height2 > error2 * g->slenderest)
        return 1;
    return g->slender && g->slender[triangle] != SIZES_SLENDER_MAX &&
           height2 > error2 * (double)(UINT64_C(1) << 2 * g->slender[triangle]);
}

static inline real product(const struct RTCRay *ray, const struct RTCHit *hit)
{
    return ray->dir_x * hit->Ng_x + ray->dir_y * hit->Ng_y + ray->dir_z * hit->Ng_z;
}

static inline int accepts(const struct query_context *q, const struct accel_geometry *g, const struct hit *face,
                          const struct RTCHit *hit, int facing)
{
    real u = hit->u, v = hit->v;
    double weight[2];
    int side;

    if (!g->filtered)
        return 1;
    /* Embree gives 0 and 0 where its products of two edges are below 1e-18: a nanometre's square. */
    if (u == 0 && v == 0 && accel_covers(q, face, &weight[0], &weight[1], &side)) {
        u = (real)weight[0];
        v = (real)weight[1];
    }
    return q->accel->accept(q->accel->scene, q->query, face->instance, face->triangle, u, v, facing);
}

static inline struct hit face_of(const struct RTCHit *hit)
{
    return (struct hit){hit->instID[0] != RTC_INVALID_GEOMETRY_ID ? hit->instID[0] : hit->geomID, hit->primID};
}

/* A ray that is traced again beside itself may meet the rim of a hole that the ray passes. Where it starts
 * near its face's edges, it may miss what stands up there by any share of that distance. */
static inline int is_believed(const struct query_context *q, const struct hit *face, int certain)
{
    return q->attempt == 0 || (q->at_edge && !certain) || accel_may_miss(q, face);
}

/* Ray and normal are in the instance's space, where the products are the same. */
void accel_filter(const struct RTCFilterFunctionNArguments *args)
{
    struct query_context *q = (struct query_context *)args->context;
    const struct RTCRay *ray = (const struct RTCRay *)args->ray; /* N is 1: single rays only */
    const struct RTCHit *hit = (const struct RTCHit *)args->hit;
    const struct hit face = face_of(hit);
    const struct accel_geometry *g = &q->accel->geometries[face.instance];
    double t = (double)ray->tfar - q->back;
    double n[3] = {(double)hit->Ng_x, (double)hit->Ng_y, (double)hit->Ng_z};
    double d[3] = {(double)ray->dir_x, (double)ray->dir_y, (double)ray->dir_z};
    int certain, settled, facing;

    if (args->valid[0] != -1)
        return;
    certain = is_certain(q, g, face.triangle, t, exact_dot(d, n), exact_dot(n, n), (double)g->least_stretch);
    /* Certain is only what the ray beside it meets: it may start on the other side of a face. */
    settled = certain && (q->attempt == 0 || !SAFEGUARD(LEAK_OF_COPY));
    args->valid[0] = 0;
    if (accel_is_excepted(q, &face) || (!settled && !accel_decide(q, &face, &t)) || !is_believed(q, &face, certain))
        return;
    facing = product(ray, hit) < 0;
    if (accepts(q, g, &face, hit, facing) && (settled || accel_keep(q, &face, t, facing)))
        args->valid[0] = -1;
}

void accel_filter_accepted(const struct RTCFilterFunctionNArguments *args)
{
    const struct query_context *q = (const struct query_context *)args->context;
    const struct RTCHit *hit = (const struct RTCHit *)args->hit;
    const struct hit face = face_of(hit);

    if (args->valid[0] == -1 && !q->careful &&
        !accepts(q, &q->accel->geometries[face.instance], &face, hit,
                 product((const struct RTCRay *)args->ray, hit) < 0))
        args->valid[0] = 0;
}

/* The face's normal, of any length, from the one in the instance's space. */
static void normal_to_world(const struct query_context *q, const struct accel_geometry *g, const struct hit *face,
                            double n[3])
{
    double corner[3][3], local[3] = {n[0], n[1], n[2]};

    if (g->motion_steps) {
        q->accel->corners(q->accel->scene, face->instance, face->triangle, q->ray->time, corner);
        exact_normal(corner, n);
        return;
    }
    for (int k = 0; k < 3; k++)
        n[k] = g->to_object[0][k] * local[0] + g->to_object[1][k] * local[1] + g->to_object[2][k] * local[2];
}

/* Is Embree's hit without a filter the one it would have found with the filter? Then everything
 * that the filter would have rejected lies behind it. */
static inline int is_settled(const struct query_context *q, const struct RTCRayHit *shot, const struct hit *face)
{
    const struct accel_geometry *g = &q->accel->geometries[face->instance];
    double n[3] = {(double)shot->hit.Ng_x, (double)shot->hit.Ng_y, (double)shot->hit.Ng_z};

    if (!g->in_world)
        normal_to_world(q, g, face, n);
    return is_certain(q, g, face->triangle, (double)shot->ray.tfar - q->back, exact_dot(n, q->direction),
                      exact_dot(n, n), 1) &&
           !accel_is_excepted(q, face);
}

/* ---- queries ------------------------------------------------------------------------------ */

static inline void go(const double from[3], const double direction[3], double by, double to[3])
{
    for (int k = 0; k < 3; k++)
        to[k] = from[k] + by * direction[k];
}

/* The vector from a place to the nearest one of a line, and its squared length. */
static double way_to_line(const double place[3], const double from[3], const double to[3], double way[3])
{
    double line[3], start[3], along;

    exact_sub(to, from, line);
    exact_sub(place, from, start);
    along = exact_dot(line, line) > 0 ? fmin(fmax(exact_dot(start, line) / exact_dot(line, line), 0), 1) : 0;
    for (int i = 0; i < 3; i++)
        way[i] = along * line[i] - start[i];
    return exact_dot(way, way);
}

/* Move by the shortest way to where the ray is clear of its face's edges: there a sideways error could take it past a
 * neighbour that stands up. In a slender corner that is far away, and what is near would be passed: there some way
 * towards it has to do. */
static void move_inwards(struct query_context *q)
{
    double corner[3][3], inner[3][3], n[3], best[3] = {0}, nearest2 = INFINITY, share;
    const double wanted = 2 * INSET_ERRORS * q->error_left;

    q->accel->corners(q->accel->scene, q->ray->left[0].instance, q->ray->left[0].triangle, q->ray->time, corner);
    exact_normal(corner, n);
    (void)exact_inset(corner, wanted, inner);
    for (int k = 0; k < 3; k++) {
        double edge[3], place[3], side[3], way[3], distance2;

        exact_sub(corner[(k + 1) % 3], corner[k], edge);
        exact_sub(q->origin, corner[k], place);
        exact_cross(n, edge, side);
        if (exact_dot(side, place) >= wanted * sqrt(exact_dot(side, side)))
            continue;
        distance2 = way_to_line(q->origin, inner[k], inner[(k + 1) % 3], way);
        if (distance2 < nearest2) {
            nearest2 = distance2;
            memcpy(best, way, sizeof best);
        }
    }
    if (!(nearest2 < INFINITY))
        nearest2 = 0;
    share = nearest2 > INSET_WAYS * INSET_WAYS * wanted * wanted ? INSET_WAYS * wanted / sqrt(nearest2) : 1;
    go(q->origin, best, share, q->inside);
    q->aside = share * sqrt(nearest2);
    q->error += q->aside;
}

/* From farther inside the face to the same end. With a parallel ray instead, a wall closer to a
 * light than the ray was moved would lie behind the end. */
static void aim_at_end(struct query_context *q)
{
    double t_max = (double)q->ray->t_max, way[3], length;

    if (!SAFEGUARD(AIM_AT_END))
        return;
    for (int k = 0; k < 3; k++)
        way[k] = q->origin[k] + t_max * q->direction[k] - q->inside[k];
    length = sqrt(exact_dot(way, way));
    if (!(length > 0))
        return;
    q->aim = vec3_make((real)(way[0] / length), (real)(way[1] / length), (real)(way[2] / length));
    q->length = length;
    q->t_max += length - t_max;
}

static inline void look_at_start(struct query_context *q)
{
    const struct accel_geometry *g = &q->accel->geometries[q->ray->left[0].instance];
    double extent = g->error_extent, own;

    own = g->error_origin * NEIGHBOUR_RATIO * (double)q->ray->edge;
    if (own < extent && own > 0 && SAFEGUARD(OWN_EDGE))
        extent = own;
    q->error_left = g->error_origin * q->largest + extent;
    q->at_edge = (double)q->ray->inset < INSET_ERRORS * q->error_left;
    /* The same in the height over the face, of the ray that met it; near its own start double decided. */
    q->blur = q->accel->error_origin * (q->largest + (double)q->ray->came_t) + q->accel->error_extent;
    if (!((double)q->ray->came_t > BACK_ERRORS * q->blur))
        q->blur = 0;
}

/* Near the face's edges and near other faces, Embree is going to propose the face itself. */
static __attribute__((noinline)) void start_before_face(struct query_context *q)
{
    double aim[3];

    q->careful = 1;
    memcpy(q->inside, q->origin, sizeof q->inside);
    if (q->at_edge && SAFEGUARD(EDGE_INSET)) {
        move_inwards(q);
        if (q->ray->t_max < INFINITY)
            aim_at_end(q);
    }
    q->clear = 2 * q->error + q->blur;
    exact_vec(q->aim, aim);
    go(q->inside, aim, -q->back, q->start);
}

/* Without contacts a start just off the face keeps Embree from proposing the face itself. */
static inline void start_on_face(struct query_context *q)
{
    const struct ray *ray = q->ray;
    double off[3];

    /* Until the ray is clear of the plane that it leaves, a sideways error, or the direction's
     * rounding, may seem to take it below. */
    q->off_cosine = (double)vec3_dot(ray->off, ray->direction);
    if (q->at_edge || ray->contacts) {
        start_before_face(q);
        return;
    }
    q->clear = 2 * q->error + q->blur;
    exact_vec(ray->off, off);
    go(q->origin, off, q->error_left, q->start);
    q->t_max -= q->back;
    q->back = 0;
    q->error += q->error_left;
}

/* If the end is clear of the face's edges, only the face itself can be right in front of it. */
static inline void end_on_face(struct query_context *q)
{
    double cosine = (double)q->ray->end_cosine, t_max = (double)q->ray->t_max;

    if (!q->at_edge && (double)q->ray->end_inset > INSET_ERRORS * q->error && q->back < 0.5 * t_max * cosine) {
        q->t_max -= q->error / cosine + ACCEL_END_SHARE * t_max;
        return;
    }
    q->reaches = 1;
    q->near_end = fmax(q->back + ACCEL_END_SHARE * t_max, 2 * q->error / cosine);
    q->t_max += q->back + ACCEL_END_SHARE * t_max;
}

static inline void query_start(struct query_context *q, const struct accel *accel, const struct ray *ray,
                               const void *query, enum query_kind kind)
{
#if AZULEJO_EMBREE >= 4
    rtcInitRayQueryContext(&q->embree);
#else
    rtcInitIntersectContext(&q->embree);
#endif
    q->accel = accel;
    q->query = query;
    q->ray = ray;
    q->kind = kind;
    exact_origin(ray, q->origin);
    exact_vec(ray->direction, q->direction);
    q->largest = exact_largest(q->origin);
    q->error = accel->error_origin * q->largest + accel->error_extent;
    q->careful = q->met = q->reaches = q->at_edge = q->doubt = 0;
    q->attempt = 0;
    q->about = NULL;
    q->off_cosine = 1;
    q->clear = q->aside = q->blur = 0;
    if (ray->reaches)
        q->error += accel->error_origin * (double)ray->t_max;
    q->back = BACK_ERRORS * q->error;
    q->t_max = (double)ray->t_max + q->back;
    q->near_start = q->near_end = q->back;
    q->aim = ray->direction;
    q->length = (double)ray->t_max;
    if (ray->left_count)
        look_at_start(q);
    if (ray->reaches)
        end_on_face(q);
    if (ray->left_count)
        start_on_face(q);
    else
        go(q->origin, q->direction, -q->back, q->start);
}

/* Aim Embree's ray slightly beside the ray: farther each time, and a quarter turn on. Its errors
 * grow with the distance from the ray's origin and with the origin's magnitude. */
static void look_beside(struct RTCRay *out, const struct query_context *q)
{
    struct basis frame = basis_from_normal(q->ray->direction);
    struct vec3 aside = vec3_scale(q->attempt & 1 ? frame.s : frame.t,
                                   real_ldexp(q->attempt & 2 ? -LEAK_ANGLE : LEAK_ANGLE, (int)q->attempt - 1));
    real reach = (real)q->largest;

    out->org_x += (float32)(aside.x * reach);
    out->org_y += (float32)(aside.y * reach);
    out->org_z += (float32)(aside.z * reach);
    out->dir_x += (float32)aside.x;
    out->dir_y += (float32)aside.y;
    out->dir_z += (float32)aside.z;
}

typedef float32 four_floats __attribute__((vector_size(16)));

/* Embree's ray starts earlier than the real one and, if that ends on a face, it ends later. Embree reads origin and
 * direction four floats at once; if they were written one by one, the load would stall until they are in the cache. */
static inline void ray_init(struct RTCRay *out, const struct query_context *q)
{
    const four_floats origin = {(float32)q->start[0], (float32)q->start[1],
                                (float32)q->start[2], 0};
    const four_floats direction = {(float32)q->aim.x, (float32)q->aim.y, (float32)q->aim.z,
                                   (float32)q->ray->time};

    memcpy(&out->org_x, &origin, sizeof origin);       /* and tnear */
    memcpy(&out->dir_x, &direction, sizeof direction); /* and time */
    out->tfar = (float32)q->t_max;
    out->mask = ~0u;
    out->id = 0;
    out->flags = 0;
    if (q->attempt > 0)
        look_beside(out, q);
}

/* Embree's nearest hit; 0: none. `careful`: only among what float decides. */
static int trace(struct query_context *q, struct RTCRayHit *shot, struct hit *hit)
{
    ray_init(&shot->ray, q);
    shot->hit.geomID = RTC_INVALID_GEOMETRY_ID;
    shot->hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    if (q->accel->few_shapes.count)
        accel_shapes_intersect(q, &shot->ray);
#if AZULEJO_EMBREE >= 4
    struct RTCIntersectArguments args;
    rtcInitIntersectArguments(&args);
    args.context = &q->embree;
    if (q->careful) {
        args.filter = accel_filter;
        args.flags = (enum RTCRayQueryFlags)(args.flags | RTC_RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER);
    }
    rtcIntersect1(q->accel->top, shot, &args);
#else
    if (q->careful)
        q->embree.filter = accel_filter;
    rtcIntersect1(q->accel->top, &q->embree, shot);
#endif
    if (shot->hit.geomID == RTC_INVALID_GEOMETRY_ID)
        return 0;
    *hit = face_of(&shot->hit);
    return 1;
}

/* The filter checks every proposal. */
static int trace_carefully(struct query_context *q, struct hit *hit)
{
    struct RTCRayHit shot;

    q->careful = 1;
    q->met = 0;
    return trace(q, &shot, hit);
}

/* The nearest of what float and double decide; 0: none. Float is uncertain for few rays, so the
 * others run without the filter. */
static inline __attribute__((always_inline)) int meets(struct query_context *q, struct hit *hit)
{
    struct RTCRayHit shot;
    int met = trace(q, &shot, hit);

    if (met && !q->careful && !is_settled(q, &shot, hit))
        met = trace_carefully(q, hit);
    if (q->met) {
        double corner[3][3], n[3];

        if (met) {
            q->accel->corners(q->accel->scene, hit->instance, hit->triangle, q->ray->time, corner);
            exact_normal(corner, n);
            met = exact_crossing(corner, n, q->origin, q->direction) < q->nearest_t;
        }
        if (!met)
            *hit = q->nearest;
        met = 1;
    }
    return met;
}

double accel_gap(const struct accel_digits *digits, const double place[3])
{
    double most = exact_largest(place), given[3];
    int exponent;

    for (int k = 0; k < 3; k++)
        given[k] = place[k] + digits->origin[k];
    most = fmax(most, fmin(exact_largest(given), digits->reach));
    (void)frexp(most, &exponent);
    return ldexp(ACCEL_COINCIDENT_ULPS, exponent - 24);
}

int accel_refine(const struct accel *accel, const struct ray *ray, const void *query, double t, int in_contact,
                 struct hit *hit)
{
    struct ray last = {.direction = ray->direction, .time = ray->time};
    struct hit found = *hit;
    double place[3], direction[3], corner[3][3], n[3], reach, gap;
    struct query_context q;

    exact_origin(ray, place);
    reach = BACK_ERRORS * (accel->error_origin * (exact_largest(place) + t) + accel->error_extent);
    if (!(t > reach) || !SAFEGUARD(REFINE_FIRST))
        return 0; /* this close to its start, double has decided */
    exact_vec(ray->direction, direction);
    go(place, direction, t - reach, place);
    last.origin = exact_round(place, last.rest);
    last.t_max = (real)(2 * reach);
    query_start(&q, accel, &last, query, QUERY_NEAREST);
    q.near_start = INFINITY;
    trace_carefully(&q, &found);
    if (!q.met || (q.nearest.instance == hit->instance && q.nearest.triangle == hit->triangle))
        return 0;
    if (!in_contact) {
        *hit = q.nearest;
        return 1;
    }
    /* Coincident faces have no order: the caller crosses them together (accel_coincident). */
    accel->corners(accel->scene, hit->instance, hit->triangle, ray->time, corner);
    exact_normal(corner, n);
    gap = (exact_crossing(corner, n, q.origin, q.direction) - q.nearest_t) * fabs(exact_dot(n, q.direction)) /
          sqrt(exact_dot(n, n));
    go(place, direction, reach, place);
    if (gap < accel_gap(&accel->digits, place) * (1 - 1e-6)) /* 8 ulp up to rounding count as apart */
        return 0;
    *hit = q.nearest;
    return 1;
}

static int is_blocked(struct query_context *q)
{
    struct RTCRay shot;

    if (q->accel->few_shapes.count && accel_shapes_occlude(q))
        return 1;
    ray_init(&shot, q);
#if AZULEJO_EMBREE >= 4
    struct RTCOccludedArguments args;
    rtcInitOccludedArguments(&args);
    args.context = &q->embree;
    rtcOccluded1(q->accel->top, &shot, &args);
#else
    rtcOccluded1(q->accel->top, &q->embree, &shot);
#endif
    return shot.tfar < 0;
}

/* Where three faces meet, the ray from farther inside the face may miss the neighbour that the real
 * ray meets. Then the real ray counts: it starts on the same face, about 2^-14 away. */
static __attribute__((noinline)) int meets_from_inside(struct query_context *q, struct hit *hit)
{
    struct ray moved = *q->ray;

    moved.origin = exact_round(q->inside, moved.rest);
    moved.direction = q->aim;
    moved.t_max = (real)q->length;
    moved.inset = INFINITY;
    moved.contacts = 1;
    query_start(q, q->accel, &moved, q->query, q->kind);
    return q->kind == QUERY_OCCLUDED ? is_blocked(q) : meets(q, hit);
}

int accel_intersect(const struct accel *accel, const struct ray *ray, const void *query, struct hit *hit)
{
    struct query_context q;

    query_start(&q, accel, ray, query, QUERY_NEAREST);
    return meets(&q, hit) || (q.doubt && meets_from_inside(&q, hit));
}

int accel_occluded(const struct accel *accel, const struct ray *ray, const void *query)
{
    struct query_context q;

    query_start(&q, accel, ray, query, QUERY_OCCLUDED);
    return is_blocked(&q) || (q.doubt && meets_from_inside(&q, NULL));
}

/* Start on the ray itself, not one error off the face: then a hole is narrowed by that much less. */
static void start_again(struct query_context *q, struct ray *copy, const struct accel *accel, const struct ray *ray,
                        const void *query, enum query_kind kind)
{
    *copy = *ray;
    copy->contacts = 1;
    query_start(q, accel, copy, query, kind);
    q->careful = 1;
}

int accel_intersect_enclosed(const struct accel *accel, const struct ray *ray, const void *query, struct hit *hit)
{
    struct query_context q;
    struct ray copy;

    start_again(&q, &copy, accel, ray, query, QUERY_NEAREST);
    while (SAFEGUARD(LEAK_REPAIR) && q.attempt++ < LEAK_ATTEMPTS)
        if (meets(&q, hit))
            return 1;
    return 0;
}

int accel_occluded_enclosed(const struct accel *accel, const struct ray *ray, const void *query)
{
    struct query_context q;
    struct ray copy;

    start_again(&q, &copy, accel, ray, query, QUERY_OCCLUDED);
    while (SAFEGUARD(LEAK_SHADOW) && q.attempt++ < LEAK_ATTEMPTS)
        if (is_blocked(&q))
            return 1;
    return 0;
}

uint32_t accel_coincident(const struct accel *accel, const struct ray *ray, const struct hit *hit,
                          const double place[3], const void *query, struct contact *out, uint32_t capacity)
{
    struct ray line = {.t_max = INFINITY, .time = ray->time};
    double corner[3][3], n[3], along[3], length;
    struct query_context q;
    struct hit unused;

    accel->corners(accel->scene, hit->instance, hit->triangle, ray->time, corner);
    exact_normal(corner, n);
    exact_vec(ray->direction, along);
    length = sqrt(exact_dot(n, n));
    if (exact_dot(n, along) < 0)
        length = -length;
    if (!(length != 0))
        return 0;
    for (int k = 0; k < 3; k++)
        along[k] = n[k] / length;
    line.origin = exact_round(place, line.rest);
    line.direction = vec3_make((real)along[0], (real)along[1], (real)along[2]);
    query_start(&q, accel, &line, query, QUERY_COINCIDENT);
    memcpy(q.direction, along, sizeof along);
    q.gap_max = accel_gap(&accel->digits, place);
    q.about = hit;
    q.contacts = out;
    q.contact_count = 0;
    q.contact_capacity = capacity;
    q.t_max = q.gap_max + 2 * q.back;
    q.near_start = INFINITY;
    trace_carefully(&q, &unused);
    accel_mark_repeats(&q);
    return q.contact_count;
}
