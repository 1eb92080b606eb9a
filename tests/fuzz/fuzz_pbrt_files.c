/* The files that a pbrt scene names, a picture and a spectrum, from any bytes: no crash, and what is
 * accepted is a valid scene. */
#include <stdlib.h>
#include <string.h>

#include "client/import/import.h"
#include "tests/support/fuzz_folder.h"

#define SHAPE "Shape \"bilinearmesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 0]"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void import_text(const char *text)
{
    const struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct import_result result;
    struct error err = {0};

    if (import_scene_memory(text, strlen(text), "fuzz.pbrt", fuzz_folder(), &options, &result,
                            &err) == STATUS_OK) {
        fuzz_folder_check(&result.files, "fuzz.pbrt");
        if (scene_validate(&result.scene, NULL) != STATUS_OK)
            abort();
    } else if (!err.text[0]) {
        abort(); /* every refusal says why */
    }
    import_result_release(&result);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    fuzz_folder_put("file", data, size);
    /* "invert" asks for a new picture, computed from the file's texels. */
    import_text("WorldBegin Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"file\" "
                "\"bool invert\" true Material \"diffuse\" \"texture reflectance\" \"t\" " SHAPE);
    import_text("WorldBegin LightSource \"point\" \"spectrum I\" \"file\" " SHAPE);
    return 0;
}
