/* isa_rays: which rays meet another triangle when Embree runs with another instruction set?
 *
 *   isa_rays SCENE          (docs/NUMERICS.md; needs a processor with avx2)
 *
 * Shoots the same camera rays, each with up to three diffuse bounces, through sse2's and
 * avx2's kernels, and sorts the pairs of triangles that differ by what lies between them. */
#include <math.h>
#include <stdio.h>

#include "client/import/import.h"
#include "common/math/elementary.h"
#include "tests/support/imported.h"
#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"

enum { SIDE = 400, SAMPLES = 64, BOUNCES = 3 };
#define NEAR_EDGE 1e-4f /* barycentric weight */

struct tally {
    unsigned long rays, edge, distance, silhouette;
};

static float edge_distance(const struct surface *s) { return fminf(s->b1, fminf(s->b2, 1 - s->b1 - s->b2)); }

/* One path, until the kernels part or it escapes. */
static void follow(struct render_scene *const scenes[2], struct ray ray, const struct sampler *sampler,
                   struct tally *tally)
{
    for (int bounce = 0; bounce <= BOUNCES; bounce++) {
        struct { const struct sampler *sampler; uint32_t ray_number; } query = {sampler, 0};
        struct sample2 u = sampler_get(sampler, DIMENSION_VERTEX + (uint32_t)bounce);
        struct surface s[2];
        struct basis frame;
        struct hit hit[2];
        int met[2];
        float sine, cosine;

        for (int k = 0; k < 2; k++) {
            met[k] = accel_intersect(scenes[k]->accel, &ray, &query, &hit[k]);
            if (met[k])
                surface_from_hit(scenes[k], &ray, &hit[k], &s[k]);
        }
        tally->rays++;
        if (!met[0] && !met[1])
            return;
        if (met[0] != met[1]) {
            tally->silhouette++;
            return;
        }
        if (hit[0].instance != hit[1].instance || hit[0].triangle != hit[1].triangle) {
            if (edge_distance(&s[0]) < NEAR_EDGE && edge_distance(&s[1]) < NEAR_EDGE)
                tally->edge++;
            else if (fabsf(s[0].t - s[1].t) < 1e-5f * s[0].t)
                tally->distance++;
            else
                tally->silhouette++;
            return;
        }
        det_sincos(2 * PI_F * u.v, &sine, &cosine);
        frame = basis_from_normal(s[0].ng);
        surface_leave(&s[0], vec3_normalize(basis_to_world(
            &frame, vec3_make(sqrtf(u.u) * cosine, sqrtf(u.u) * sine, sqrtf(1 - u.u)))), &ray);
    }
}

int main(int argc, char **argv)
{
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct render_scene *scenes[2] = {NULL, NULL};
    struct render_settings settings;
    struct import_result import;
    struct error err = {0};
    struct tally tally = {0};
    status s;

    if (argc != 2) {
        fprintf(stderr, "usage: isa_rays SCENE\n");
        return 2;
    }
    render_settings_default(&settings);
    settings.width = settings.height = SIDE;
    s = import_scene(argv[1], &options, &import, &err);
    for (int k = 0; k < 2 && s == STATUS_OK; k++) {
        settings.isa = k ? ISA_AVX2 : ISA_SSE2;
        s = render_scene_new(&scenes[k], &import.scene, &settings, 0, imported_source(&import), &err);
    }
    if (s != STATUS_OK) {
        fprintf(stderr, "isa_rays: %s\n", err.text);
        return status_exit_code(s);
    }
    for (uint32_t y = 0; y < SIDE; y++)
        for (uint32_t x = 0; x < SIDE; x++)
            for (uint32_t i = 0; i < SAMPLES; i++) {
                struct sampler sampler;
                struct ray ray;
                sampler_start(&sampler, 0, 0, x, y, 0, i);
                camera_ray(&scenes[0]->camera, x, y, &sampler, &ray);
                follow(scenes, ray, &sampler, &tally);
            }
    printf("%lu rays: %lu fall to the neighbour across an edge, %lu to another triangle at the same "
           "distance, %lu pass or miss a silhouette\n",
           tally.rays, tally.edge, tally.distance, tally.silhouette);
    render_scene_free(scenes[0]);
    render_scene_free(scenes[1]);
    import_result_release(&import);
    return 0;
}
