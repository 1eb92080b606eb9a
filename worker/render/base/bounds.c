#include "worker/render/base/bounds.h"

static size_t farthest(const struct vec3 *points, size_t count, struct vec3 from)
{
    size_t best = 0;
    real best_squared = -1;

    for (size_t i = 0; i < count; i++) {
        real squared = vec3_length_squared(vec3_sub(points[i], from));
        if (squared > best_squared) {
            best_squared = squared;
            best = i;
        }
    }
    return best;
}

struct sphere sphere_around(const struct vec3 *points, size_t count)
{
    struct sphere s = {{0, 0, 0}, 0};
    struct vec3 a, b;

    if (count == 0)
        return s;
    a = points[farthest(points, count, points[0])];
    b = points[farthest(points, count, a)];
    s.centre = vec3_lerp(a, b, 0.5f);
    s.radius = 0.5f * vec3_length(vec3_sub(a, b));
    for (size_t i = 0; i < count; i++) {
        struct vec3 out = vec3_sub(points[i], s.centre);
        real distance = vec3_length(out);
        if (distance > s.radius) {
            real grown = 0.5f * (s.radius + distance);
            s.centre = vec3_mad(s.centre, out, (grown - s.radius) / distance);
            s.radius = grown;
        }
    }
    /* Moving the centre rounds: check every point once more. */
    for (size_t i = 0; i < count; i++)
        s.radius = real_fmax(s.radius, vec3_length(vec3_sub(points[i], s.centre)));
    s.radius *= 1 + 0x1p-20f;
    return s;
}
