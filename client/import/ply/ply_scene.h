/* ply_scene: a PLY file alone is a scene, too. */
#ifndef AZULEJO_IMPORT_PLY_SCENE_H
#define AZULEJO_IMPORT_PLY_SCENE_H

#include "client/import/builder/builder.h"

extern const struct import_format format_ply;

#endif
