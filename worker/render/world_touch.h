/* world_touch: which faces of volumes may have another face at them. Private to worker/render.
 *
 * Rays ask only there for the faces that coincide with the one they met (crossing.h). A face is
 * taken to touch another where both are nearly parallel, nearer than twice ACCEL_COINCIDENT_ULPS
 * and overlap by more than an edge. In doubt (what moves, more triangles than TOUCH_TRIANGLES_MAX,
 * more pairs than TOUCH_PAIRS_MAX) all faces may touch others: that costs time and changes nothing.
 */
#ifndef AZULEJO_RENDER_WORLD_TOUCH_H
#define AZULEJO_RENDER_WORLD_TOUCH_H

#include "common/base/status.h"

enum { TOUCH_TRIANGLES_MAX = 1 << 22, TOUCH_PAIRS_MAX = 1 << 28 };

struct render_scene;

/* Sets world_instance.touches. The instances must be placed. ERR_NO_MEMORY. */
status world_touch_find(struct render_scene *w, struct error *err) MUST_CHECK;

#endif
