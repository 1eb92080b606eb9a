/* Any bytes as a .cube file: an error, or a table that pixels can be looked up in. */
#include <float.h>
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include "common/tonemap/tonemap.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static float pixels[] = {0.0f, 1e-45f, 0.18f, 1.0f, 0.7f, 0.3f, FLT_MAX, NAN, -1.0f};
    struct image in = {3, 1, 3, pixels}, out;
    struct tonemap_settings settings;
    struct tonemap_context context = {.threads = 1, .file_data = data, .file_size = size};
    struct error err = {0};

    if (tonemap_settings_init(&settings, "lut", &err) != STATUS_OK)
        abort();
    settings.has_file = 1;
    for (int input = 0; input < 3; input++) {
        settings.values[0] = input;
        if (tonemap_apply(&out, &in, &settings, &context, &err) != STATUS_OK)
            return 0;
        for (int i = 0; i < 9; i++)
            if (!(out.pixels[i] >= 0.0f && out.pixels[i] <= 1.0f))
                abort();
        image_release(&out);
    }
    return 0;
}
