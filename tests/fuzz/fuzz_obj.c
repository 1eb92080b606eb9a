/* The OBJ importer on any bytes, with the text itself for its material library: no crash, and what
 * is accepted is a valid scene. */
#include <stdlib.h>

#include "client/import/import.h"
#include "tests/support/fuzz_folder.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct import_result result;
    struct error err = {0};

    /* A file says "mtllib m.mtl" to have itself read as one. */
    fuzz_folder_put("m.mtl", data, size);
    if (import_scene_memory(data, size, "fuzz.obj", fuzz_folder(), &options, &result, &err) == STATUS_OK) {
        fuzz_folder_check(&result.files, "fuzz.obj");
        if (scene_validate(&result.scene, NULL) != STATUS_OK)
            abort();
    } else if (!err.text[0]) {
        abort(); /* every refusal says why */
    }
    import_result_release(&result);
    return 0;
}
