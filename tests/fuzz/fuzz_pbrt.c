/* The pbrt importer on any text, with a few files that it may name: no crash, and what is accepted
 * is a valid scene. */
#include <stdlib.h>
#include <string.h>

#include "client/import/import.h"
#include "common/base/buffer.h"
#include "common/image/image.h"
#include "tests/support/fuzz_folder.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
int LLVMFuzzerInitialize(int *argc, char ***argv);

static void put_text(const char *name, const char *text) { fuzz_folder_put(name, text, strlen(text)); }

/* A square picture, as an environment's maps are. */
static void put_pictures(void)
{
    const struct exr_options options = {0};
    struct buffer bytes = BUFFER_INIT;
    struct image image;

    if (image_init(&image, 4, 4, 3, NULL) != STATUS_OK)
        abort();
    for (int i = 0; i < 4 * 4 * 3; i++)
        image.pixels[i] = (float)i / 48;
    if (png_encode(&bytes, &image, NULL) != STATUS_OK)
        abort();
    fuzz_folder_put("a.png", bytes.data, bytes.size);
    buffer_clear(&bytes);
    image.pixels[5] = 100;
    if (exr_encode(&bytes, &image, &options, NULL) != STATUS_OK)
        abort();
    fuzz_folder_put("a.exr", bytes.data, bytes.size);
    buffer_release(&bytes);
    image_release(&image);
}

int LLVMFuzzerInitialize(int *argc, char ***argv)
{
    (void)argc;
    (void)argv;
    put_pictures();
    put_text("a.ply", "ply\nformat ascii 1.0\nelement vertex 3\n"
                      "property float x\nproperty float y\n"
                      "property float z\nelement face 1\nproperty list uchar int vertex_indices\n"
                      "end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
    put_text("a.spd", "400 0.5\n500 1\n700 2\n");
    put_text("part.pbrt", "Translate 1 0 0 Material \"diffuse\" "
                          "Shape \"plymesh\" \"string filename\" \"a.ply\"\n");
    put_text("tail.pbrt", "AttributeBegin AttributeEnd Import");
    return 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct import_result result;
    struct error err = {0};

    if (import_scene_memory(data, size, "fuzz.pbrt", fuzz_folder(), &options, &result, &err) == STATUS_OK) {
        json_t *report = import_report_json(&result);
        fuzz_folder_check(&result.files, "fuzz.pbrt");
        if (scene_validate(&result.scene, NULL) != STATUS_OK || !report)
            abort();
        json_decref(report);
    } else if (!err.text[0]) {
        abort(); /* every refusal says why */
    }
    import_result_release(&result);
    return 0;
}
