/* shapes_parts: shared by the files shapes*.c; only they include it. */
#pragma once

#include "client/import/builder/shapes.h"

int shape_is_coordinate(double x);
/* ERR_INPUT unless all values are finite coordinates; `what` names them in the error. */
status shape_check_numbers(const float *values, size_t count, const char *what, struct error *err) MUST_CHECK;
/* Memory for vertices with normals and texture coordinates, and for triangles. */
status shape_reserve(struct mesh_source *mesh, uint64_t vertices, uint64_t triangles, struct error *err) MUST_CHECK;
/* Append to what shape_reserve() allocated. */
void shape_add_vertex(struct mesh_source *mesh, const double position[3], const double normal[3], double u, double v);
void shape_add_triangle(struct mesh_source *mesh, size_t a, size_t b, size_t c);

/* A grid's first or last row may be a single point: its triangles have one corner there. */
enum grid_poles { POLE_NONE = 0, POLE_FIRST = 1, POLE_LAST = 2 };

/* Triangles of a grid of (columns + 1)(rows + 1) vertices, row by row from `base`; columns run along u. */
void shape_add_grid(struct mesh_source *mesh, size_t base, size_t columns, size_t rows, int poles);
/* Release the mesh after a failure; returns `result`. */
status shape_finish(status result, struct mesh_source *out) MUST_CHECK;

double dot3(const double a[3], const double b[3]);
void cross3(const double a[3], const double b[3], double out[3]);
/* Returns 0, and sets (0, 0, 0), when the vector has no direction. */
int normalize3(double a[3]);
