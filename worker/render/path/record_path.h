/* record_path: how a vertex is written down (record.h). Only the kernel that is compiled with KERNEL_RECORDS
 * calls it, from the sink of vertices (path_sink.h). */
#pragma once

#include "worker/render/path/path_parts.h"

#ifndef KERNEL_RECORDS
#define KERNEL_RECORDS 0
#endif

/* The path sets out for its next vertex. *v and *notes are set to what they are if nothing happens there. */
void record_vertex_begins(const struct path *path, struct path_vertex *v, struct path_notes *notes);
/* All has happened. */
void record_vertex_ends(const struct path *path, const struct path_vertex *v, const struct path_notes *notes,
                        enum path_end end);

/* Likewise for the pilot that asks what light arrives (light_pilot.h). */
void light_pilot_vertex_begins(const struct path *path);
void light_pilot_vertex_ends(const struct path_vertex *v, const struct path_notes *notes);
