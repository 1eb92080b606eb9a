#include "worker/render/medium/null_collisions.h"

#include "worker/render/base/health_scope.h"
#include "worker/render/medium/medium_walk.h"

/* Below this transmittance, ratio tracking plays Russian roulette. */
#define MEDIUM_ROULETTE_BELOW 0.0625f

/* What the medium sends at a collision, where `through` over `mean` of a path's light passes. */
static inline void add_glow(const struct render_medium *medium, const real through[3], real mean, real density,
                            real emitted[3])
{
    for (int c = 0; c < 3; c++)
        emitted[c] = real_min(emitted[c] + through[c] / mean * density * medium->glow[c], MEDIUM_RADIANCE_MAX);
}

/* A collision with one channel's extinction, or none, over the mean of the three channels' densities. */
static struct vec3 event_weight(const struct render_medium *medium, int scattered, const real through[3])
{
    real weight[3], mean = 0.0f;

    for (int c = 0; c < 3; c++)
        mean += (scattered ? medium->extinction[c] : 1.0f) * through[c];
    mean *= 1.0f / REAL(3.0);
    for (int c = 0; c < 3; c++)
        weight[c] = mean > 0.0f ? (scattered ? medium->scattering[c] : 1.0f) * through[c] / mean : 0.0f;
    return medium_vec(weight);
}

/* The walk was lost: nothing passes. */
static __attribute__((cold, noinline)) void lose(real through[3])
{
    health_note(HEALTH_GUARDED_PATHS);
    through[0] = through[1] = through[2] = 0.0f;
}

/* Delta tracking with one channel's probabilities. `through` holds, for all three channels, the
 * products of the null collisions' probabilities. The majorant's part is common to them and
 * cancels, so with the balance heuristic no weight exceeds 3 (Miller et al. 2019, section 5). */
void null_collisions_sample(const struct render_medium *medium, const struct ray *ray, real u,
                            struct medium_random *random, struct medium_event *out)
{
    const int chosen = medium->chromatic ? medium_channel(&u) : 0;
    const real rate = medium->emits ? medium->glow_rate : medium->extinction_max;
    real through[3] = {1, 1, 1}, emitted[3] = {0, 0, 0};
    real depth = medium_depth_of(u);
    const uint32_t first = sampler_hash_first(random->sampler, random->key);
    struct medium_walk walk;
    int more = medium_walk_start(&walk, medium, ray);

    out->scattered = 0;
    while (more && medium_walk_collide(&walk, rate, &depth)) {
        const real density = medium_walk_density(&walk), filled = density / rate;
        real most = 0.0f;

        if (medium->emits)
            add_glow(medium, through, (through[0] + through[1] + through[2]) * (1.0f / REAL(3.0)), density, emitted);
        /* A real collision: the path scatters here. */
        out->scattered = medium_next(random, first) < medium->extinction[chosen] * filled;
        if (out->scattered)
            break;
        /* A null collision: it flies on. Only the channels' ratios matter: a long walk must not underflow. */
        for (int c = 0; c < 3; c++) {
            through[c] *= real_max(1.0f - medium->extinction[c] * filled, 0.0f);
            most = real_max(through[c], most);
        }
        for (int c = 0; c < 3; c++)
            through[c] /= most;
        depth = medium_depth_of(medium_next(random, first));
    }
    if (walk.lost)
        lose(through);
    out->distance = out->scattered ? walk.t : ray->t_max;
    out->weight = event_weight(medium, out->scattered, through);
    out->emitted = medium_vec(emitted);
}

/* Ratio tracking. */
struct vec3 null_collisions_transmittance(const struct render_medium *medium, const struct ray *ray, real u,
                                          struct medium_random *random, real *emitted)
{
    const real rate = emitted ? medium->glow_rate : medium->extinction_max;
    real through[3] = {1, 1, 1}, most = 1.0f;
    real depth = medium_depth_of(u);
    const uint32_t first = sampler_hash_first(random->sampler, random->key);
    struct medium_walk walk;
    int more = medium_walk_start(&walk, medium, ray);

    while (more && most > 0.0f && medium_walk_collide(&walk, rate, &depth)) {
        const real density = medium_walk_density(&walk);

        if (emitted)
            add_glow(medium, through, 1, density, emitted);
        /* Every collision is null; its probability is what passes. */
        most = 0.0f;
        for (int c = 0; c < 3; c++) {
            through[c] *= real_max(1.0f - medium->extinction[c] * density / rate, 0.0f);
            most = real_max(through[c], most);
        }
        if (most < MEDIUM_ROULETTE_BELOW) {
            real factor = medium_next(random, first) < 0.5f ? 2.0f : 0.0f;

            for (int c = 0; c < 3; c++)
                through[c] *= factor;
            most *= factor;
        }
        depth = medium_depth_of(medium_next(random, first));
    }
    if (walk.lost)
        lose(through);
    return medium_vec(through);
}
