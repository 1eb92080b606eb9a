/* enclosure: can a ray that starts where the camera is escape from the scene?
 *
 * Where it cannot, as in a room, a ray that does escape has slipped through a vertex
 * (docs/NUMERICS.md) and is traced again.
 */
#pragma once

struct render_scene;

/* Follows some paths from the camera. Needs the camera and the accel; sets scene->enclosed. */
void enclosure_find(struct render_scene *scene);
