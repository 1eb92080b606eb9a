/* The PLY reader on any bytes: no crash, and what it accepts keeps its promises. */
#include <math.h>
#include <stdlib.h>

#include "client/import/ply/ply.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct mesh_source mesh;
    struct error err = {0};

    if (ply_read(data, size, NULL, &mesh, NULL, &err) == STATUS_OK) {
        for (size_t i = 0; i < 3 * mesh.triangle_count; i++)
            if (mesh.indices[i] >= mesh.vertex_count)
                abort();
        for (size_t i = 0; i < 3 * mesh.vertex_count; i++)
            if (!(fabsf(mesh.positions[i]) <= SCENE_COORDINATE_MAX) || (mesh.normals && !isfinite(mesh.normals[i])))
                abort();
    } else if (!err.text[0] || mesh.positions) {
        abort(); /* every refusal says why, and leaves nothing */
    }
    mesh_source_release(&mesh);
    return 0;
}
