#include "worker/render/accel_parts.h"

#include <math.h>
#include <string.h>

#include "worker/render/exact.h"

/* So many such errors before its start a ray starts for Embree, or a triangle right before it
 * could seem to lie behind. */
#define BACK_ERRORS 64.0
/* Farther than this from the edges of the one face that it leaves, a ray may start off it. */
#define INSET_ERRORS 64.0
/* A face on which the ray ends is looked for up to this share of the length before and behind. */
#define END_SHARE 0x1p-18
/* Double decides about a plane that the ray makes a smaller angle with than this. */
#define GRAZING_COSINE 0x1p-18
/* A ray that leaked is traced again this many times at most, turned by this angle (radians) and
 * twice as much each time: rounding is wrong about edges by some 2^-22 of their distance. */
enum { LEAK_ATTEMPTS = 8 };
#define LEAK_ANGLE 0x1p-20f

/* ---- Embree's proposals ------------------------------------------------------------------- */

/* Is the plane so near to an end of the ray that float may be wrong about its side? `t`: metres by
 * Embree. The hit's normal and the ray are in the instance's space, where products are alike. */
static int is_near(const struct query_context *q, const struct RTCRay *ray,
                   const struct RTCHit *hit, const struct accel_geometry *g, double t)
{
    double reach = t, product, area2, height2, error2;

    product = (double)ray->dir_x * (double)hit->Ng_x + (double)ray->dir_y * (double)hit->Ng_y +
              (double)ray->dir_z * (double)hit->Ng_z;
    area2 = (double)hit->Ng_x * (double)hit->Ng_x + (double)hit->Ng_y * (double)hit->Ng_y +
            (double)hit->Ng_z * (double)hit->Ng_z;
    /* Along a plane Embree's t is a quotient of two roundings, and may be any number. */
    if (!(t > q->near_start) || !(product * product > GRAZING_COSINE * GRAZING_COSINE * area2))
        return 1;
    if (q->reaches) {
        reach = fmin(t, q->length - t);
        if (!(reach > q->near_end))
            return 1;
    }
    height2 = reach * product * (double)g->least_stretch;
    height2 *= height2;
    error2 = q->error * q->error * area2;
    if (height2 > error2 * (double)(UINT64_C(1) << 2 * g->slenderest))
        return 0;
    return !g->slender || g->slender[hit->primID] == SIZES_SLENDER_MAX ||
           !(height2 > error2 * (double)(UINT64_C(1) << 2 * g->slender[hit->primID]));
}

void accel_filter(const struct RTCFilterFunctionNArguments *args)
{
    struct query_context *q = (struct query_context *)args->context;
    const struct RTCRay *ray = (const struct RTCRay *)args->ray; /* N is 1: single rays only */
    const struct RTCHit *hit = (const struct RTCHit *)args->hit;
    struct hit face = {hit->instID[0] != RTC_INVALID_GEOMETRY_ID ? hit->instID[0] : hit->geomID,
                       hit->primID};
    const struct accel_geometry *g = &q->accel->geometries[face.instance];
    double t = (double)ray->tfar - q->back;
    int near, facing;

    if (args->valid[0] != -1)
        return;
    args->valid[0] = 0;
    if (accel_is_excepted(q, &face))
        return;
    near = q->kind == QUERY_COINCIDENT || is_near(q, ray, hit, g, t);
    if (near && !accel_decide(q, &face, &t))
        return;
    facing = ray->dir_x * hit->Ng_x + ray->dir_y * hit->Ng_y + ray->dir_z * hit->Ng_z < 0;
    if (g->filtered && !q->accel->accept(q->accel->scene, q->query, face.instance, face.triangle,
                                         hit->u, hit->v, facing))
        return;
    if (!near || accel_keep(q, &face, t, facing))
        args->valid[0] = -1;
}

/* ---- huge triangles ----------------------------------------------------------------------- */

void accel_huge_bounds(const struct RTCBoundsFunctionArguments *args)
{
    const struct accel *accel = args->geometryUserPtr;
    const struct hit *face = &accel->sizes.huge[args->primID];
    uint32_t steps = accel->geometries[face->instance].motion_steps;
    float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};

    for (uint32_t i = 0; i < (steps ? steps : 1); i++) {
        double corner[3][3];

        accel->corners(accel->scene, face->instance, face->triangle,
                       steps ? (float)i / (float)(steps - 1) : 0, corner);
        for (int k = 0; k < 3; k++)
            for (int a = 0; a < 3; a++) {
                low[a] = fminf(low[a], nextafterf((float)corner[k][a], -INFINITY));
                high[a] = fmaxf(high[a], nextafterf((float)corner[k][a], INFINITY));
            }
    }
    *args->bounds_o = (struct RTCBounds){.lower_x = low[0], .lower_y = low[1], .lower_z = low[2],
                                         .upper_x = high[0], .upper_y = high[1],
                                         .upper_z = high[2]};
}

/* Met? Then *t in metres. */
static int huge_meets(struct query_context *q, const struct hit *face, double *t)
{
    double u, v;
    int facing;

    if (accel_is_excepted(q, face) || !accel_covers(q, face, &u, &v, &facing) ||
        !accel_decide(q, face, t))
        return 0;
    if (q->accel->geometries[face->instance].filtered &&
        !q->accel->accept(q->accel->scene, q->query, face->instance, face->triangle, (float)u,
                          (float)v, facing))
        return 0;
    if (q->kind != QUERY_OCCLUDED)
        accel_keep(q, face, *t, facing);
    return 1;
}

void accel_huge_intersect(const struct RTCIntersectFunctionNArguments *args)
{
    struct query_context *q = (struct query_context *)args->context;
    struct RTCRay *ray = &((struct RTCRayHit *)args->rayhit)->ray;
    double t;

    if (args->valid[0] != -1 || !huge_meets(q, &q->accel->sizes.huge[args->primID], &t) ||
        q->kind == QUERY_COINCIDENT)
        return;
    /* What lies behind need not be looked at. */
    ray->tfar = fminf(ray->tfar, (float)((t + q->back) * (1 + END_SHARE)));
}

void accel_huge_occluded(const struct RTCOccludedFunctionNArguments *args)
{
    struct query_context *q = (struct query_context *)args->context;
    struct RTCRay *ray = (struct RTCRay *)args->ray;
    double t;

    if (args->valid[0] == -1 && huge_meets(q, &q->accel->sizes.huge[args->primID], &t))
        ray->tfar = -INFINITY;
}

/* ---- queries ------------------------------------------------------------------------------ */

static void move(double place[3], const double direction[3], double by)
{
    for (int k = 0; k < 3; k++)
        place[k] += by * direction[k];
}

/* To the middle of the face as far as it takes to be clear of its edges: there an error to the side
 * could take the ray past a neighbour that stands up. */
static void move_inwards(struct query_context *q)
{
    double corner[3][3], e[3], way[3], n[3], longest = 0, middle, wanted, inset, part;

    q->accel->corners(q->accel->scene, q->ray->left[0].instance, q->ray->left[0].triangle,
                      q->ray->time, corner);
    exact_normal(corner, n);
    for (int k = 0; k < 3; k++) {
        way[k] = (corner[0][k] + corner[1][k] + corner[2][k]) / 3 - q->origin[k];
        exact_sub(corner[(k + 1) % 3], corner[k], e);
        longest = fmax(longest, exact_dot(e, e));
    }
    middle = longest > 0 ? sqrt(exact_dot(n, n) / longest) / 3 : 0;
    inset = fmax((double)q->ray->inset, 0);
    wanted = 2 * INSET_ERRORS * q->error_left;
    part = middle > wanted ? (wanted - inset) / (middle - inset) : 1;
    move(q->start, way, part);
    q->error += part * sqrt(exact_dot(way, way));
}

/* From farther inside the face to the same end: parallel to the ray, a wall that stands before a lamp
 * by less than the ray was moved would lie behind the end. */
static void aim_at_end(struct query_context *q)
{
    double t_max = (double)q->ray->t_max, way[3], length;

    for (int k = 0; k < 3; k++)
        way[k] = q->origin[k] + t_max * q->direction[k] - q->start[k];
    length = sqrt(exact_dot(way, way));
    if (!(length > 0))
        return;
    q->aim = vec3_make((float)(way[0] / length), (float)(way[1] / length), (float)(way[2] / length));
    q->length = length;
    q->t_max += length - t_max;
}

static void look_at_start(struct query_context *q)
{
    const struct accel_geometry *g = &q->accel->geometries[q->ray->left[0].instance];

    q->error_left = g->error_origin * exact_largest(q->origin) + g->error_extent;
    q->at_edge = (double)q->ray->inset < INSET_ERRORS * q->error_left;
}

/* Without contacts a start just off the face spares Embree the face itself. */
static void start_on_face(struct query_context *q)
{
    double aim[3], off[3];

    if (q->at_edge) {
        move_inwards(q);
        if (q->ray->t_max < INFINITY)
            aim_at_end(q);
    }
    memcpy(q->inside, q->start, sizeof q->inside);
    /* Until the ray is clear of the plane that it leaves, an error to the side, or the direction's
     * own, may seem to take it below. */
    q->near_start = fmax(q->back, 2 * q->error / (double)vec3_dot(q->ray->off, q->ray->direction));
    if (q->at_edge || q->ray->contacts) {
        exact_vec(q->aim, aim);
        move(q->start, aim, -q->back);
        return;
    }
    exact_vec(q->ray->off, off);
    move(q->start, off, q->error_left);
    q->t_max -= q->back;
    q->back = 0;
    q->error += q->error_left;
}

/* Where the end is clear of the face's edges nothing can be right before it but the face. */
static void end_on_face(struct query_context *q)
{
    double cosine = (double)q->ray->end_cosine, t_max = (double)q->ray->t_max;

    if (!q->at_edge && (double)q->ray->end_inset > INSET_ERRORS * q->error &&
        q->back < 0.5 * t_max * cosine) {
        q->t_max -= q->error / cosine + END_SHARE * t_max;
        return;
    }
    q->reaches = 1;
    q->near_end = fmax(q->back + END_SHARE * t_max, 2 * q->error / cosine);
    q->t_max += q->back + END_SHARE * t_max;
}

static void query_start(struct query_context *q, const struct accel *accel, const struct ray *ray,
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
    q->error = accel->error_origin * exact_largest(q->origin) + accel->error_extent;
    memcpy(q->start, q->origin, sizeof q->start);
    q->met = q->reaches = q->at_edge = q->doubt = 0;
    q->attempt = 0;
    q->about = NULL;
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
        move(q->start, q->direction, -q->back);
}

/* Embree is to look a little beside the ray: each time farther, and a quarter turn on. Its errors
 * grow with the distance from the ray's origin and with the origin's own. */
static void look_beside(struct RTCRay *out, const struct query_context *q)
{
    struct frame frame = frame_from_normal(q->ray->direction);
    struct vec3 aside = vec3_scale(q->attempt & 1 ? frame.s : frame.t,
                                   ldexpf(q->attempt & 2 ? -LEAK_ANGLE : LEAK_ANGLE,
                                          (int)q->attempt - 1));
    float reach = (float)exact_largest(q->origin);

    out->org_x += aside.x * reach;
    out->org_y += aside.y * reach;
    out->org_z += aside.z * reach;
    out->dir_x += aside.x;
    out->dir_y += aside.y;
    out->dir_z += aside.z;
}

/* For Embree the ray starts earlier, and where it ends on a face it ends later. */
static void ray_init(struct RTCRay *out, const struct query_context *q)
{
    const struct ray *ray = q->ray;

    out->org_x = (float)q->start[0];
    out->org_y = (float)q->start[1];
    out->org_z = (float)q->start[2];
    out->tnear = 0;
    out->dir_x = q->aim.x;
    out->dir_y = q->aim.y;
    out->dir_z = q->aim.z;
    out->time = ray->time;
    out->tfar = (float)q->t_max;
    out->mask = ~0u;
    out->id = 0;
    out->flags = 0;
    if (q->attempt > 0)
        look_beside(out, q);
}

/* Embree's nearest of what float decides; 0: none. */
static int trace(struct query_context *q, struct hit *hit)
{
    struct RTCRayHit shot;

    ray_init(&shot.ray, q);
    shot.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    shot.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
#if AZULEJO_EMBREE >= 4
    struct RTCIntersectArguments args;
    rtcInitIntersectArguments(&args);
    args.context = &q->embree;
    rtcIntersect1(q->accel->top, &shot, &args);
#else
    rtcIntersect1(q->accel->top, &q->embree, &shot);
#endif
    if (shot.hit.geomID == RTC_INVALID_GEOMETRY_ID)
        return 0;
    hit->instance = shot.hit.instID[0] != RTC_INVALID_GEOMETRY_ID ? shot.hit.instID[0]
                                                                  : shot.hit.geomID;
    hit->triangle = shot.hit.primID;
    return 1;
}

/* The nearest of what float and double decide; 0: none. */
static int meets(struct query_context *q, struct hit *hit)
{
    int met = trace(q, hit);

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

/* How far apart, along their normal, faces at `place` are that floats cannot keep apart. */
static double coincident_gap(const double place[3])
{
    int exponent;

    (void)frexp(exact_largest(place), &exponent);
    return ldexp(ACCEL_COINCIDENT_ULPS, exponent - 24);
}

int accel_refine(const struct accel *accel, const struct ray *ray, const void *query, double t,
                 struct hit *hit)
{
    struct ray last = {.direction = ray->direction, .time = ray->time};
    struct hit found = *hit;
    double place[3], direction[3], corner[3][3], n[3], reach, gap;
    struct query_context q;

    exact_origin(ray, place);
    reach = BACK_ERRORS * (accel->error_origin * (exact_largest(place) + t) + accel->error_extent);
    if (!(t > reach))
        return 0; /* so near to its start double has decided */
    exact_vec(ray->direction, direction);
    move(place, direction, t - reach);
    last.origin = exact_round(place, last.rest);
    last.t_max = (float)(2 * reach);
    query_start(&q, accel, &last, query, QUERY_NEAREST);
    q.near_start = INFINITY;
    trace(&q, &found);
    if (!q.met || (q.nearest.instance == hit->instance && q.nearest.triangle == hit->triangle))
        return 0;
    /* Faces that coincide have no order: who crosses them takes them together (accel_coincident). */
    accel->corners(accel->scene, hit->instance, hit->triangle, ray->time, corner);
    exact_normal(corner, n);
    gap = (exact_crossing(corner, n, q.origin, q.direction) - q.nearest_t) *
          fabs(exact_dot(n, q.direction)) / sqrt(exact_dot(n, n));
    move(place, direction, reach);
    if (gap < coincident_gap(place) * (1 - 1e-6)) /* what is 8 ulp apart to rounding is apart */
        return 0;
    *hit = q.nearest;
    return 1;
}

static int is_blocked(struct query_context *q)
{
    struct RTCRay shot;

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

/* Where three faces meet, the ray from farther inside the face may pass by the neighbour that the
 * ray itself meets. Then that ray is what counts: it starts on the same face, some 2^-14 away. */
static void start_inside(struct ray *moved, const struct query_context *q)
{
    *moved = *q->ray;
    moved->origin = exact_round(q->inside, moved->rest);
    moved->direction = q->aim;
    moved->t_max = (float)q->length;
    moved->inset = INFINITY;
    moved->contacts = 1;
}

int accel_intersect(const struct accel *accel, const struct ray *ray, const void *query,
                    struct hit *hit)
{
    struct query_context q;
    struct ray moved;
    int met;

    query_start(&q, accel, ray, query, QUERY_NEAREST);
    met = meets(&q, hit);
    if (!met && q.doubt) {
        start_inside(&moved, &q);
        query_start(&q, accel, &moved, query, QUERY_NEAREST);
        met = meets(&q, hit);
    }
    return met;
}

int accel_occluded(const struct accel *accel, const struct ray *ray, const void *query)
{
    struct query_context q;
    struct ray moved;
    int blocked;

    query_start(&q, accel, ray, query, QUERY_OCCLUDED);
    blocked = is_blocked(&q);
    if (!blocked && q.doubt) {
        start_inside(&moved, &q);
        query_start(&q, accel, &moved, query, QUERY_OCCLUDED);
        blocked = is_blocked(&q);
    }
    return blocked;
}

int accel_intersect_enclosed(const struct accel *accel, const struct ray *ray, const void *query,
                             struct hit *hit)
{
    struct query_context q;

    query_start(&q, accel, ray, query, QUERY_NEAREST);
    while (q.attempt++ < LEAK_ATTEMPTS)
        if (meets(&q, hit))
            return 1;
    return 0;
}

int accel_occluded_enclosed(const struct accel *accel, const struct ray *ray, const void *query)
{
    struct query_context q;

    query_start(&q, accel, ray, query, QUERY_OCCLUDED);
    while (q.attempt++ < LEAK_ATTEMPTS)
        if (is_blocked(&q))
            return 1;
    return 0;
}

uint32_t accel_coincident(const struct accel *accel, const struct ray *ray, const struct hit *hit,
                          const double place[3], const void *query, struct contact *out,
                          uint32_t capacity)
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
    line.direction = vec3_make((float)along[0], (float)along[1], (float)along[2]);
    query_start(&q, accel, &line, query, QUERY_COINCIDENT);
    memcpy(q.direction, along, sizeof along);
    q.gap_max = coincident_gap(place);
    q.about = hit;
    q.contacts = out;
    q.contact_count = 0;
    q.contact_capacity = capacity;
    q.t_max = q.gap_max + 2 * q.back;
    trace(&q, &unused);
    accel_mark_repeats(&q);
    return q.contact_count;
}
