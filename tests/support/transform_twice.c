/* Two that make one: lamps of half the light, a mix of twice the same. */
#include <stdlib.h>

#include "common/base/memory.h"
#include "tests/support/transform.h"

uint32_t transform_halve_lamps(struct import_result *import)
{
    const uint32_t lamps = import->scene.light_count;

    for (uint32_t i = 0; i < lamps; i++) {
        for (int c = 0; c < 3; c++)
            import->scene.lights[i].intensity[c] /= 2;
        transform_add_light(import, import->scene.lights[i]);
    }
    return lamps;
}

static int is_smooth(float roughness) { return roughness < 0.05f; }

/* What bounds a volume is one body, what shines one lamp, a hash of the material decides about blends, and a mix casts no caustics
 * (docs/CAUSTICS.md). */
static int may_mix(const struct scene_material *m)
{
    return (m->kind == MATERIAL_SURFACE || m->kind == MATERIAL_CONDUCTOR) && m->alpha_mode == ALPHA_OPAQUE &&
           !m->unlit && !m->refractive && m->medium < 0 && scene_color_is(m->emission, 0) && !is_smooth(m->roughness) &&
           !(m->clearcoat > 0 && is_smooth(m->clearcoat_roughness));
}

uint32_t transform_mix_with_itself(struct import_result *import)
{
    const uint32_t count = import->scene.material_count;
    uint32_t *mixes = mem_calloc(count, sizeof *mixes), done = 0;

    if (!mixes)
        abort();
    for (uint32_t i = 0; i < count; i++) {
        struct scene_material mix;
        if (!may_mix(&import->scene.materials[i]))
            continue;
        scene_material_default(&mix);
        mix.name = "twice the same";
        mix.kind = MATERIAL_MIX;
        mix.double_sided = import->scene.materials[i].double_sided;
        mix.mix_amount = 0.375f;
        mix.mix_material[0] = i;
        mix.mix_material[1] = transform_add_material(import, import->scene.materials[i]);
        mixes[i] = transform_add_material(import, mix);
    }
    for (uint32_t i = 0; i < import->scene.instance_count; i++) {
        struct scene_instance *instance = &import->scene.instances[i];
        if (instance->material < count && mixes[instance->material]) {
            instance->material = mixes[instance->material];
            done++;
        }
    }
    mem_free(mixes);
    return done;
}
