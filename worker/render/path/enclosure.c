#include "worker/render/path/enclosure.h"

#include "common/base/safeguard.h"
#include "common/math/elementary.h"
#include "worker/render/path/path.h"
#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"

/* Number of paths that are followed, of their segments, and of paths that may escape. */
enum { ENCLOSURE_PATHS = 1024, ENCLOSURE_DEPTH = 4, ENCLOSURE_ESCAPES = 3 };

/* A direction from the surface: on the ray's side, or on either side if light may pass. */
static struct vec3 direction_from(const struct surface *s, struct sample2 u, real side)
{
    struct basis frame = basis_from_normal(s->ng);
    real sine, cosine, height = 1 - u.u, width = real_sqrt(u.u * (2 - u.u));

    if ((s->material->flags & (MATERIAL_TWO_WAY | MATERIAL_BOUNDS)) && side < 0.5f)
        height = -height;
    real_sincos(2 * REAL_PI * u.v, &sine, &cosine);
    return vec3_normalize(basis_to_world(&frame, vec3_make(width * cosine, width * sine, height)));
}

static int escapes(const struct render_scene *scene, uint32_t x, uint32_t y, uint32_t sample)
{
    struct sampler sampler;
    struct path_query query = {&sampler, 0};
    struct surface s;
    struct hit hit;
    struct ray ray;

    sampler_start(&sampler, 0, scene->frame, x, y, 0, sample);
    camera_ray(&scene->camera, x, y, &sampler, &ray);
    for (uint32_t depth = 0; depth < ENCLOSURE_DEPTH; depth++) {
        uint32_t dimension = DIMENSION_VERTEX + depth * DIMENSIONS_PER_VERTEX;

        query.ray_number++;
        if (!accel_intersect(scene->accel, &ray, &query, &hit) &&
            !accel_intersect_enclosed(scene->accel, &ray, &query, &hit))
            return 1;
        surface_from_hit(scene, &ray, &hit, &s);
        surface_leave(&s, direction_from(&s, sampler_get(&sampler, dimension + VERTEX_BSDF),
                                         sampler_get(&sampler, dimension + VERTEX_LOBE).u),
                      &ray);
    }
    return 0;
}

/* A few may escape, because the room has a small hole or because rounding takes a ray past a face's
 * rim. Taking such a scene for closed is cheap and loses no light but at the hole's rim: the few rays
 * that escape are traced again, and what these meet is believed only where Embree may have missed it
 * (accel_may_miss). The point is to spare open scenes that work. */
void enclosure_find(struct render_scene *scene)
{
    const double golden = 0.6180339887498949;
    int escaped = 0;

    for (uint32_t i = 0; i < ENCLOSURE_PATHS && escaped <= ENCLOSURE_ESCAPES; i++) {
        double across = i * golden;
        double x = (across - (double)(uint32_t)across) * (double)scene->camera.width;
        double y = (i + 0.5) / ENCLOSURE_PATHS * (double)scene->camera.height;

        escaped += escapes(scene, (uint32_t)x, (uint32_t)y, i);
    }
    scene->enclosed = escaped <= ENCLOSURE_ESCAPES && SAFEGUARD(LEAK_OF_ROOM);
}
