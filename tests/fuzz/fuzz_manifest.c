/* A frame's manifest as `azulejo effects` prints it, on any bytes: no crash. */
#include <stdio.h>
#include <stdlib.h>

#include "client/views/effects_view.h"

int LLVMFuzzerInitialize(int *argc, char ***argv);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static FILE *nowhere, *output;

int LLVMFuzzerInitialize(int *argc, char ***argv)
{
    (void)argc;
    (void)argv;
    output = stdout;
    nowhere = fopen("/dev/null", "w");
    return nowhere ? 0 : 1;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct error err = {0};
    json_t *manifest;

    if (manifest_parse(&manifest, data, size, &err) != STATUS_OK) {
        if (!err.text[0])
            abort(); /* every refusal says why */
        return 0;
    }
    stdout = nowhere;
    manifest_print(manifest);
    stdout = output;
    json_decref(manifest);
    return 0;
}
