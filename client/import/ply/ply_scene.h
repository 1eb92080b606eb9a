/* ply_scene: a PLY file alone is a scene, too. */
#pragma once

#include "client/import/builder/builder.h"

extern const struct import_format format_ply;
