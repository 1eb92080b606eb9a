#include "worker/render/accel/sizes.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/base/safeguard.h"

/* A triangle is huge if its longest edge is 2^15 times that of the scene's small triangles. The
 * float error there, about 8 * 2^-24 of the edge, is 1/64 of the small triangles' size. */
enum { HUGE_RATIO_BITS = 15 };
/* One triangle in this many may be smaller than the "small" ones. */
enum { SMALL_SHARE = 1024 };
/* The ordinary bound covers triangles up to this slenderness. */
enum { SLENDER_ORDINARY = 2 };
/* Edges are counted by the exponents of their lengths. */
enum { EXPONENT_MIN = -160, EXPONENTS = 320 };

struct tally {
    uint64_t count[EXPONENTS]; /* triangles whose longest edge has the exponent */
    uint64_t world[EXPONENTS]; /* those of them that lie in the top BVH */
    uint64_t total;
};

static int exponent_of(double length)
{
    int e;

    frexp(length, &e);
    e -= EXPONENT_MIN;
    return e < 0 ? 0 : e >= EXPONENTS ? EXPONENTS - 1 : e;
}

/* The squares of the longest edge and of twice the area. */
static double longest_edge(const float32 *positions, const uint32_t *vertex, double *area2)
{
    double e[3][3], longest = 0, n[3];

    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++)
            e[k][a] = (double)positions[3 * (size_t)vertex[(k + 1) % 3] + (size_t)a] -
                      (double)positions[3 * (size_t)vertex[k] + (size_t)a];
    for (int k = 0; k < 3; k++) {
        double square = e[k][0] * e[k][0] + e[k][1] * e[k][1] + e[k][2] * e[k][2];
        longest = square > longest ? square : longest;
    }
    n[0] = e[0][1] * e[1][2] - e[0][2] * e[1][1];
    n[1] = e[0][2] * e[1][0] - e[0][0] * e[1][2];
    n[2] = e[0][0] * e[1][1] - e[0][1] * e[1][0];
    *area2 = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
    return longest;
}

/* If the vertices move: the step in which the triangle is largest. */
static double largest_in_motion(const struct accel_instance *instance, const uint32_t *vertex, double *area2)
{
    double longest, unused;

    if (!instance->motion_steps)
        return longest_edge(instance->instance_positions, vertex, area2);
    longest = longest_edge(instance->motion_positions[0], vertex, area2);
    for (uint32_t k = 1; k < instance->motion_steps; k++)
        longest = fmax(longest, longest_edge(instance->motion_positions[k], vertex, &unused));
    return longest;
}

static void count_one(struct tally *tally, double longest, double area2, int in_world)
{
    int e = exponent_of(longest);

    if (!(area2 > 0) || !(longest < INFINITY))
        return; /* a point or a line: no ray meets it */
    tally->count[e]++;
    tally->world[e] += (uint64_t)in_world;
    tally->total++;
}

/* The matrix stretches nothing by more than its largest stretch at any step. */
static double norm(const struct accel_instance *instance)
{
    double most = 0;

    for (uint32_t i = 0; i < (instance->motion_steps ? instance->motion_steps : 1); i++) {
        const struct transform *m = instance->motion_steps ? &instance->motion_to_world[i] : &instance->to_world;
        double sum = 0;
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++)
                sum += (double)m->m[r][c] * (double)m->m[r][c];
        most = fmax(most, sqrt(sum));
    }
    return most;
}

/* Meshes with their own BVH: use the smallest scale of their instances. */
static status tally_shared(struct tally *tally, struct sizes *sizes, const struct accel_input *in, struct error *err)
{
    double *least = mem_calloc(in->mesh_count, sizeof *least);

    NEED(least, err, "the sizes of the triangles");
    for (uint32_t i = 0; i < in->instance_count; i++) {
        const struct accel_instance *instance = &in->instances[i];
        double *of_mesh = &least[instance->mesh];

        if (instance->instance_positions)
            continue;
        sizes->longest[i] = SAFEGUARD(ERROR_OF_INSTANCE) ? norm(instance) : 1;
        *of_mesh = *of_mesh > 0 ? fmin(*of_mesh, sizes->longest[i]) : sizes->longest[i];
    }
    for (uint32_t m = 0; m < in->mesh_count; m++) {
        double most = 0;

        for (uint32_t k = 0; least[m] > 0 && k < in->meshes[m].triangle_count; k++) {
            double area2,
                longest = sqrt(longest_edge(in->meshes[m].positions, in->meshes[m].indices + 3 * (size_t)k, &area2));
            count_one(tally, least[m] / sqrt(3.0) * longest, area2, 0);
            most = fmax(most, longest);
        }
        least[m] = most;
    }
    for (uint32_t i = 0; i < in->instance_count; i++)
        if (!in->instances[i].instance_positions)
            sizes->longest[i] *= least[in->instances[i].mesh];
    mem_free(least);
    return STATUS_OK;
}

static void tally_world(struct tally *tally, const struct accel_input *in, const struct accel_instance *instance)
{
    const struct accel_mesh *mesh = &in->meshes[instance->mesh];

    for (uint32_t i = 0; i < mesh->triangle_count; i++) {
        double area2, longest = largest_in_motion(instance, mesh->indices + 3 * (size_t)i, &area2);
        count_one(tally, sqrt(longest), area2, 1);
    }
}

/* The smallest exponent at which triangles count as huge. */
static int huge_exponent(const struct tally *tally)
{
    uint64_t below = 0, above = 0;
    int small = 0, huge = EXPONENTS;

    if (!SAFEGUARD(HUGE_TRIANGLES))
        return huge;
    while (small < EXPONENTS && (below += tally->count[small]) <= tally->total / SMALL_SHARE)
        small++;
    while (huge > small + HUGE_RATIO_BITS && huge > 0 && (above += tally->world[huge - 1]) <= SIZES_HUGE_MAX)
        huge--;
    return huge;
}

/* Split the triangles of the top BVH: list the huge ones, find the longest of the others. */
static status list_huge(struct sizes *sizes, const struct accel_input *in, int least, uint64_t count, struct error *err)
{
    sizes->huge = mem_alloc_array(count, sizeof *sizes->huge);
    NEED(sizes->huge, err, "the list of huge triangles");
    for (uint32_t i = 0; i < in->instance_count; i++) {
        const struct accel_instance *instance = &in->instances[i];
        const struct accel_mesh *mesh = &in->meshes[instance->mesh];
        double most = 0;

        if (!instance->instance_positions)
            continue;
        for (uint32_t k = 0; k < mesh->triangle_count; k++) {
            double area2, longest = largest_in_motion(instance, mesh->indices + 3 * (size_t)k, &area2);
            if (!(area2 > 0))
                continue;
            if (exponent_of(sqrt(longest)) < least)
                most = fmax(most, longest);
            else if (sizes->huge_count < count)
                sizes->huge[sizes->huge_count++] = (struct hit){i, k};
        }
        sizes->longest[i] = sqrt(most);
    }
    return STATUS_OK;
}

double sizes_condition(const struct transform *m)
{
    struct transform_d forward = transform_to_d(m), inverse;
    double worst = 1;

    if (!transform_d_invert(&forward, &inverse))
        return 1;
    for (int r = 0; r < 3; r++) {
        double sum = 0;
        for (int c = 0; c < 3; c++)
            for (int k = 0; k < 3; k++)
                sum += fabs(forward.m[r][k]) * fabs(inverse.m[k][c]);
        worst = fmax(worst, sum);
    }
    return worst;
}

double sizes_least_stretch(const struct transform *m)
{
    struct transform_d forward = transform_to_d(m), inverse;
    double sum = 0;

    if (!transform_d_invert(&forward, &inverse))
        return 0;
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            sum += inverse.m[r][c] * inverse.m[r][c];
    return sum > 0 ? 1 / sqrt(sum) : 0;
}

status sizes_init(struct sizes *sizes, const struct accel_input *in, struct error *err)
{
    struct tally *tally = mem_calloc(1, sizeof *tally);
    uint64_t count = 0;
    status s;
    int least;

    memset(sizes, 0, sizeof *sizes);
    sizes->longest = mem_calloc(in->instance_count, sizeof *sizes->longest);
    if (!tally || !sizes->longest) {
        s = error_no_memory(err, "the sizes of the triangles");
        goto done;
    }
    s = tally_shared(tally, sizes, in, err);
    if (s != STATUS_OK)
        goto done;
    for (uint32_t i = 0; i < in->instance_count; i++)
        if (in->instances[i].instance_positions)
            tally_world(tally, in, &in->instances[i]);
    least = huge_exponent(tally);
    for (int e = least; e < EXPONENTS; e++)
        count += tally->world[e];
    s = list_huge(sizes, in, least, count, err);
done:
    mem_free(tally);
    return s;
}

void sizes_release(struct sizes *sizes)
{
    mem_free(sizes->huge);
    mem_free(sizes->longest);
    memset(sizes, 0, sizeof *sizes);
}

status sizes_slender(const float32 *positions, const struct accel_mesh *mesh, uint8_t **out, double *worst_squared,
                     struct error *err)
{
    uint8_t *slender = mem_alloc_array(mesh->triangle_count, 1), worst = 0;

    *out = NULL;
    *worst_squared = 1;
    NEED(slender, err, "the shapes of the triangles");
    for (uint32_t i = 0; i < mesh->triangle_count; i++) {
        double area2, longest = longest_edge(positions, mesh->indices + 3 * (size_t)i, &area2);
        double ratio = longest / sqrt(area2);
        int e = SIZES_SLENDER_MAX;

        if (ratio < 0x1p29)
            frexp(ratio, &e);
        slender[i] = (uint8_t)(e > 0 ? e : 0);
        worst = slender[i] > worst ? slender[i] : worst;
    }
    if (worst <= SLENDER_ORDINARY) {
        mem_free(slender);
        return STATUS_OK;
    }
    *worst_squared = ldexp(1, 2 * worst);
    *out = slender;
    return STATUS_OK;
}
