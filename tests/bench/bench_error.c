/* bench_error: how wrong Embree is in a ray's height over a triangle's plane (docs/NUMERICS.md).
 *
 *   bench_error [RAYS]     100,000 unless told, for each kind
 *
 * Random triangles of ordinary shape (longest edge at most 4 times the height), at distances of 0 to
 * 10^4 edges from the origin: in the world, in instances with random matrices (condition up to 100),
 * and in moving instances. A ray starts where the renderer lets it start: 64 error bounds before a place near the triangle. The largest
 * error is printed in 2^-24 of the largest coordinate plus the longest edge, and as a share of the
 * bound that worker/render/accel/accel.c takes. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if AZULEJO_EMBREE >= 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include "tests/support/statistics.h"
#include "worker/render/base/exact.h"
#include "worker/render/accel/sizes.h"

enum kind { WORLD, INSTANCE, MOVING, KINDS };
static const char *const names[KINDS] = {"world", "instance", "moving"};
static struct test_random dice = {11};

static double between(double low, double high) { return low + (high - low) * test_random_double(&dice); }

static void direction(double out[3])
{
    double length;

    do {
        for (int a = 0; a < 3; a++)
            out[a] = between(-1, 1);
        length = sqrt(exact_dot(out, out));
    } while (length > 1 || length < 0.1);
    for (int a = 0; a < 3; a++)
        out[a] /= length;
}

/* Of longest edge about 1; 0: too slender. */
static int ordinary(const double corner[3][3], double *longest)
{
    double n[3], e[3];

    *longest = 0;
    exact_normal(corner, n);
    for (int k = 0; k < 3; k++) {
        exact_sub(corner[(k + 1) % 3], corner[k], e);
        *longest = fmax(*longest, exact_dot(e, e));
    }
    return *longest < 4 * sqrt(exact_dot(n, n)) && (*longest = sqrt(*longest)) > 0;
}

/* Shape and turn by random rows; the place at `far` edges. */
static struct transform matrix(double scale, double far)
{
    struct transform m;
    double row[3];

    for (int r = 0; r < 3; r++) {
        direction(row);
        for (int c = 0; c < 3; c++)
            m.m[r][c] = (float)(scale * row[c]);
        m.m[r][3] = (float)(scale * between(-far, far));
    }
    return m;
}

static RTCScene scene_of(RTCDevice device, RTCGeometry geometry)
{
    RTCScene scene = rtcNewScene(device);

    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene);
    return scene;
}

static RTCScene triangle_scene(RTCDevice device, float p[3][4])
{
    RTCGeometry g = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    unsigned *index = rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, 1);

    for (unsigned k = 0; k < 3; k++)
        index[k] = k;
    rtcSetSharedGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, p, 0, 16, 3);
    return scene_of(device, g);
}

static RTCScene instance_scene(RTCDevice device, RTCScene of, const struct transform *m, int moving)
{
    RTCGeometry g = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_INSTANCE);

    rtcSetGeometryInstancedScene(g, of);
    if (moving)
        rtcSetGeometryTimeStepCount(g, 2);
    for (unsigned k = 0; k <= (unsigned)moving; k++)
        rtcSetGeometryTransform(g, k, RTC_FORMAT_FLOAT3X4_ROW_MAJOR, m[k].m);
    return scene_of(device, g);
}

/* Embree's distance, NaN where it misses. */
static double embree_t(RTCScene scene, const double start[3], struct vec3 way, float time)
{
    struct RTCRayHit shot;

    memset(&shot, 0, sizeof shot);
    shot.ray = (struct RTCRay){.org_x = (float)start[0], .org_y = (float)start[1],
                               .org_z = (float)start[2], .dir_x = way.x, .dir_y = way.y,
                               .dir_z = way.z, .tfar = INFINITY, .time = time, .mask = ~0u};
    shot.hit.geomID = shot.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
#if AZULEJO_EMBREE >= 4
    rtcIntersect1(scene, &shot, NULL);
#else
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect1(scene, &context, &shot);
#endif
    return shot.hit.geomID == RTC_INVALID_GEOMETRY_ID ? NAN : (double)shot.ray.tfar;
}

/* One triangle, and some rays at it. */
static void measure(RTCDevice device, enum kind kind, int rays, double worst[3])
{
    double scale = kind == WORLD ? 1 : pow(10, between(-3, 3)), longest, condition = 1, bound;
    double far = pow(10, between(-2, 4)), corner[3][3], n[3];
    float p[3][4] = {{0}}, time = kind == MOVING ? test_random_float(&dice) : 0;
    struct transform m[2] = {matrix(scale, far), matrix(scale, far)};
    RTCScene own, top;

    /* A motion goes some way, and little else: a mix of unlike matrices is none that is traced. */
    for (int i = 0; i < 9; i++)
        m[1].m[i / 3][i % 3] = m[0].m[i / 3][i % 3] * (float)between(0.95, 1.05);
    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++)
            p[k][a] = (float)(between(-1, 1) + (kind == WORLD ? far * (a + 1) / 3 : 0));
    for (int k = 0; k < 3; k++)
        for (int r = 0; r < 3; r++) {
            corner[k][r] = kind == WORLD ? (double)p[k][r] : 0;
            for (int c = 0; kind != WORLD && c < 4; c++)
                corner[k][r] += ((1 - (double)time) * (double)m[0].m[r][c] + (double)time * (double)m[1].m[r][c]) *
                                (c < 3 ? (double)p[k][c] : 1);
        }
    if (kind != WORLD)
        condition = fmax(sizes_condition(&m[0]), kind == MOVING ? sizes_condition(&m[1]) : 1);
    exact_normal(corner, n);
    if (!ordinary(corner, &longest) || condition > 100)
        return;
    bound = 8 + (kind == WORLD ? 0 : kind == INSTANCE ? 16 : 32) * condition;
    own = triangle_scene(device, p);
    top = kind == WORLD ? own : instance_scene(device, own, m, kind == MOVING);
    for (int i = 0; i < rays; i++) {
        double u = between(0.05, 0.9), v = between(0.05, 0.95 - u), way[3], place[3], start[3];
        double unit, t;
        struct vec3 d;
        direction(way);
        d = vec3_make((float)way[0], (float)way[1], (float)way[2]);
        exact_vec(d, way);
        for (int a = 0; a < 3; a++)
            place[a] = (1 - u - v) * corner[0][a] + u * corner[1][a] + v * corner[2][a];
        unit = 0x1p-24 * (exact_largest(place) + longest);
        for (int a = 0; a < 3; a++)
            start[a] = place[a] - 64 * bound * unit * way[a];
        t = embree_t(top, start, d, time) - 64 * bound * unit;
        /* Its height over the plane, of which the direction's share is not float's fault. */
        t = fabs(t * exact_dot(n, way)) / sqrt(exact_dot(n, n)) / unit;
        if (!(t >= 0))
            continue; /* missed */
        worst[0] = fmax(worst[0], t);
        worst[1] = fmax(worst[1], t / bound);
        worst[2]++;
    }
    if (top != own)
        rtcReleaseScene(top);
    rtcReleaseScene(own);
}

int main(int argc, char **argv)
{
    long rays = argc > 1 ? atol(argv[1]) : 100000;
    RTCDevice device = rtcNewDevice("threads=1");

    for (enum kind kind = WORLD; kind < KINDS; kind++) {
        double worst[3] = {0, 0, 0};
        for (long i = 0; i < rays; i += 100)
            measure(device, kind, 100, worst);
        printf("%-9s %11.0f hits, largest error %6.2f of 2^-24, %.3f of the bound\n", names[kind], worst[2], worst[0],
               worst[1]);
        fflush(stdout);
    }
    rtcReleaseDevice(device);
    return 0;
}
