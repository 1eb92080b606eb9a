/* pbrt: text scenes of pbrt-v4, and of pbrt-v3 where only names differ.
 *
 * docs/PBRT.md lists what is read and its result. The file is read once from top to bottom: a directive changes the
 * graphics state or adds rows to the builder immediately. An unsupported feature is a warning that names file and line,
 * unless the picture would be entirely different (an unknown camera).
 *
 * pbrt's cameras look along +z with x to the right: its worlds are left-handed unless a transform mirrors them. Ours
 * are right-handed. When the camera's matrix says that the file's world is left-handed, everything is mirrored in z
 * when read (struct pbrt.mirrored).
 */
#pragma once

#include "client/import/builder/builder.h"

extern const struct import_format format_pbrt;
