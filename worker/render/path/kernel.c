#include "worker/render/path/kernel.h"

#include "common/scene/kernel_sets.h"
#include "worker/render/render_scene.h"

#define KERNEL_EXTERN(name, set) extern const struct kernel kernel_##name;
KERNEL_MAP(KERNEL_EXTERN)
#define KERNEL_ROW(name, set) &kernel_##name,
static const struct kernel *const kernels[] = {KERNEL_MAP(KERNEL_ROW)};
enum { KERNELS = sizeof kernels / sizeof *kernels };

int kernel_measures_trace;
static int force_general;

void render_measure_trace(int on) { kernel_measures_trace = on; }

void render_force_general(int on) { force_general = on; }

const struct kernel *kernel_for(uint64_t effects)
{
    for (int i = 0; i < KERNELS && !force_general; i++)
        if (!(effects & ~kernels[i]->effects))
            return kernels[i];
    return kernels[KERNELS - 1];
}

const struct kernel *kernel_at(size_t index) { return index < KERNELS ? kernels[index] : NULL; }

const char *render_kernel_variant(const struct render_scene *scene) { return scene->kernel->name; }

uint64_t render_effects(const struct render_scene *scene) { return scene->effects; }

size_t render_tile(const struct render_scene *scene, uint32_t frame, uint32_t tile, uint32_t group, uint32_t pass,
                   float32 *sums, struct tail *tail, struct render_stats *stats)
{
    return scene->kernel->tile_render(scene, frame, tile, group, pass, sums, tail, stats);
}
