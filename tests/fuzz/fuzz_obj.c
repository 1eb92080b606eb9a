/* The OBJ importer on any bytes, with the text itself for its material library: no crash, and what
 * is accepted is a valid scene. */
#include <stdlib.h>
#include <unistd.h>

#include "client/import/import.h"
#include "common/base/file.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
int LLVMFuzzerInitialize(int *argc, char ***argv);

static char folder[] = "/tmp/azulejo-fuzz-obj-XXXXXX";

static void clean_up(void)
{
    char path[sizeof folder + 8];

    snprintf(path, sizeof path, "%s/m.mtl", folder);
    unlink(path);
    rmdir(folder);
}

int LLVMFuzzerInitialize(int *argc, char ***argv)
{
    (void)argc;
    (void)argv;
    if (!mkdtemp(folder))
        abort();
    atexit(clean_up);
    return 0;
}

/* A file says "mtllib m.mtl" to have itself read as one. */
static void write_library(const uint8_t *data, size_t size)
{
    char path[sizeof folder + 8];
    FILE *file;

    snprintf(path, sizeof path, "%s/m.mtl", folder);
    file = fopen(path, "wb");
    if (!file || (size && fwrite(data, 1, size, file) != size) || fclose(file) != 0)
        abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct import_result result;
    struct error err = {0};

    write_library(data, size);
    if (import_scene_memory(data, size, "fuzz.obj", folder, &options, &result, &err) == STATUS_OK) {
        if (scene_validate(&result.scene, NULL) != STATUS_OK)
            abort();
    } else if (!err.text[0]) {
        abort(); /* every refusal says why */
    }
    import_result_release(&result);
    return 0;
}
