/* A worker that lies: worker/main.c, linked so that its calls of render_tile come here (Makefile).
 *
 * LIAR_SHARE: of its units, percent (100); LIAR_VALUE: what their sums are (7), or with LIAR_FLIP one bit of one number is
 * another. The same unit gets the same lie again. LIAR_AFTER: so many units are rendered honestly before that (0), and
 * after so many, LIAR_UNTIL, all (none). LIAR_CPU_S: seconds of processor time that a lie is said to have taken besides its own (0). */
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "worker/render/render.h"

size_t __real_render_tile(const struct render_scene *scene, uint32_t frame, uint32_t tile, uint32_t group,
                          uint32_t pass, float32 *sums, struct tail *tail, struct render_stats *stats);
size_t __wrap_render_tile(const struct render_scene *scene, uint32_t frame, uint32_t tile, uint32_t group,
                          uint32_t pass, float32 *sums, struct tail *tail, struct render_stats *stats);

static double setting(const char *name, double usual)
{
    const char *text = getenv(name);

    return text ? strtod(text, NULL) : usual;
}

uint64_t __real_clock_thread_cpu_ns(void);
uint64_t __wrap_clock_thread_cpu_ns(void);
static _Thread_local uint64_t claimed_ns;

uint64_t __wrap_clock_thread_cpu_ns(void) { return __real_clock_thread_cpu_ns() + claimed_ns; }

size_t __wrap_render_tile(const struct render_scene *scene, uint32_t frame, uint32_t tile, uint32_t group,
                          uint32_t pass, float32 *sums, struct tail *tail, struct render_stats *stats)
{
    size_t count = __real_render_tile(scene, frame, tile, group, pass, sums, tail, stats);
    static atomic_uint rendered;
    unsigned before = atomic_fetch_add(&rendered, 1);
    uint32_t x = ((frame * 2654435761u ^ tile) * 2654435761u ^ group << 8 ^ pass) * 2654435761u;

    if (before < (unsigned)setting("LIAR_AFTER", 0) || before >= (unsigned)setting("LIAR_UNTIL", 4e9) ||
        x / 4294967296.0 * 100 >= setting("LIAR_SHARE", 100))
        return count;
    claimed_ns += (uint64_t)(setting("LIAR_CPU_S", 0) * 1e9);
    if (getenv("LIAR_FLIP")) { /* the lowest of a number that is not 0 */
        size_t at = x % count;
        for (size_t i = 0; i < count && sums[at] == 0; i++)
            at = (at + 1) % count;
        uint32_t bits;
        memcpy(&bits, &sums[at], sizeof bits);
        bits ^= 1;
        memcpy(&sums[at], &bits, sizeof bits);
        return count;
    }
    for (size_t i = 0; i < count; i++)
        sums[i] = (float32)setting("LIAR_VALUE", 7);
    if (tail)
        memset(tail, 0, sizeof *tail);
    return count;
}
