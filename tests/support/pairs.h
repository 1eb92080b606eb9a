/* pairs: a small scene for every two things that a scene can have, so placed that light meets both.
 *
 * The stage: a closed room of diffuse walls, a lamp below its ceiling, a ball with normals, tangents, texture coordinates and
 * colours, a red card behind it. A thing changes the ball's surface, fills or surrounds the ball, adds a lamp, opens the room to a
 * sky, or changes the camera or how the ball moves. Two that are each a surface get a ball each: one within the other where light
 * passes the outer, else side by side. */
#pragma once

#include "client/import/import.h"

struct pair_stage;
struct pair_thing {
    const char *name;
    void (*add)(struct pair_stage *stage);
    int opens; /* the room has no ceiling */
};
extern const struct pair_thing pair_things[];
extern const size_t pair_thing_count;

/* Is the room with both closed, so that what is around it is not seen? */
int pair_is_closed(size_t one, size_t other);
/* The scene with both; one is the other: with that alone. import_result_release() frees it. */
void pair_scene(size_t one, size_t other, struct import_result *out);
