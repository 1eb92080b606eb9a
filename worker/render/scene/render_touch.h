/* render_touch: which faces of volumes may coincide with another face. Private to worker/render.
 *
 * Only there do rays search for the faces that coincide with the one they met (crossing.h). Two faces count as touching
 * where they are nearly parallel, nearer than twice ACCEL_COINCIDENT_ULPS and overlap by more than an edge. If in doubt
 * (moving meshes, more triangles than TOUCH_TRIANGLES_MAX, on average more pairs of overlapping boxes per triangle than
 * TOUCH_PAIRS_EACH), all faces may touch others: that costs time and changes nothing.
 */
#pragma once

#include "common/base/status.h"

enum { TOUCH_TRIANGLES_MAX = 1 << 22, TOUCH_PAIRS_EACH = 64, TOUCH_PAIRS_MIN = 1 << 22 };
enum { NEAR_ERRORS = 64, NEAR_TRIANGLES_MAX = 1 << 18, NEAR_PAIRS_EACH = 24, NEAR_PAIRS_MIN = 1 << 18 };

struct accel_digits;
struct render_scene;

/* Sets render_instance.touches. The instances must be placed. ERR_NO_MEMORY. */
status touch_find(struct render_scene *w, struct error *err) MUST_CHECK;

/* Sets render_instance.near, near_reach, near_places and near_known: on which faces may float take another face,
 * of which one bounds a volume, for the one that a ray meets? Two triangles are near where one comes within
 * NEAR_ERRORS / 2 of Embree's largest errors of the other's inside, which is NEAR_ERRORS from its edges; at its
 * edges its neighbours always are. A shape is near others in boxes around the places that are within NEAR_ERRORS.
 * If in doubt (something moves, too many faces or pairs), all faces within the boundaries' boxes are near others:
 * that costs time and changes nothing. The accel must be built. ERR_NO_MEMORY. */
status near_find(struct render_scene *w, struct error *err) MUST_CHECK;

/* enum render_near of the first triangle, given the other. `reach` metres from its edges its inside begins. */
int touch_near(const double of[3][3], const double other[3][3], double reach);

/* Is there a plane that parts the triangles by more than `gap` metres? */
int touch_apart(const double a[3][3], const double b[3][3], double gap);

/* May a ray through the inside of both triangles meet them closer than floats can separate? */
int touch_coincide(const struct accel_digits *digits, const double a[3][3], const double b[3][3]);

/* Metres: twice the distance that floats cannot resolve at these corners. */
double touch_slack(const struct accel_digits *digits, const double corner[3][3]);
