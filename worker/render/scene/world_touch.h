/* world_touch: which faces of volumes may coincide with another face. Private to worker/render.
 *
 * Only there do rays search for the faces that coincide with the one they met (crossing.h). Two
 * faces count as touching where they are nearly parallel, nearer than twice ACCEL_COINCIDENT_ULPS
 * and overlap by more than an edge. If in doubt (moving meshes, more triangles than
 * TOUCH_TRIANGLES_MAX, on average more pairs of overlapping boxes per triangle than
 * TOUCH_PAIRS_EACH), all faces may touch others: that costs time and changes nothing.
 */
#ifndef AZULEJO_RENDER_WORLD_TOUCH_H
#define AZULEJO_RENDER_WORLD_TOUCH_H

#include "common/base/status.h"

enum { TOUCH_TRIANGLES_MAX = 1 << 22, TOUCH_PAIRS_EACH = 64, TOUCH_PAIRS_MIN = 1 << 22 };

struct accel_digits;
struct render_scene;

/* Sets world_instance.touches. The instances must be placed. ERR_NO_MEMORY. */
status world_touch_find(struct render_scene *w, struct error *err) MUST_CHECK;

/* May a ray through the inside of both triangles meet them closer than floats can separate? */
int touch_coincide(const struct accel_digits *digits, const double a[3][3], const double b[3][3]);

/* Metres: twice the distance that floats cannot resolve at these corners. */
double touch_slack(const struct accel_digits *digits, const double corner[3][3]);

#endif
