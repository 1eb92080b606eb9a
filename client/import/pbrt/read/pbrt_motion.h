/* pbrt_motion: matrices decomposed into parts that can be interpolated. */
#pragma once

#include "client/import/pbrt/read/pbrt_context.h"

/* One key of a movement. */
struct pbrt_pose_key {
    double translation[3], rotation[4], stretch[3][3];
};

/* The rotation next to m (its polar decomposition: Higham 1986, Newton's iteration); the
 * stretch, m = rotation * stretch, is symmetric. 0: m is singular. */
int pbrt_polar(const struct transform_d *m, struct transform_d *rotation, double stretch[3][3]);
int pbrt_stretch_is_diagonal(const double s[3][3]);
void pbrt_quaternion(const struct transform_d *r, double q[4]);
/* A node at the first key's place, in double, and a child for the change between the keys, because
 * an animation's values are floats. */
status pbrt_add_key_nodes(struct pbrt *p, struct pbrt_pose_key key[2], int with_scale, uint32_t *row) MUST_CHECK;
