/* Packed scenes from anywhere: no crash, and what is accepted packs to bytes that unpack to
 * the same bytes. */
#include <stdlib.h>
#include <string.h>

#include "common/base/buffer.h"
#include "common/base/memory.h"
#include "common/scene/effects.h"
#include "common/scene/scene.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void pack(const struct scene *scene, struct buffer *out)
{
    if (scene_pack(scene, out, NULL) != STATUS_OK)
        abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct buffer first = BUFFER_INIT, second = BUFFER_INIT;
    struct scene scene, again;
    struct error err = {0};
    float low[3], high[3];

    if (scene_unpack(&scene, data, size, &err) != STATUS_OK) {
        if (!err.text[0])
            abort();
        return 0;
    }
    for (uint32_t camera = 0; camera < scene.camera_count && camera < 4; camera++)
        scene_effects_default(&scene, camera);
    scene_bounds(&scene, low, high);
    pack(&scene, &first);
    if (scene_unpack(&again, first.data, first.size, &err) != STATUS_OK)
        abort();
    pack(&again, &second);
    if (first.size != second.size || memcmp(first.data, second.data, first.size) != 0)
        abort();
    buffer_release(&first);
    buffer_release(&second);
    scene_release(&again);
    scene_release(&scene);
    return 0;
}
