/* The pbrt importer on any text, without other files: no crash, and what is accepted is a valid
 * scene. */
#include <stdlib.h>

#include "client/import/import.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct import_result result;
    struct error err = {0};

    if (import_scene_memory(data, size, "fuzz.pbrt", NULL, &options, &result, &err) == STATUS_OK) {
        json_t *report = import_report_json(&result);
        if (scene_validate(&result.scene, NULL) != STATUS_OK || !report)
            abort();
        json_decref(report);
    } else if (!err.text[0]) {
        abort(); /* every refusal says why */
    }
    import_result_release(&result);
    return 0;
}
