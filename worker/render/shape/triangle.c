/* triangle: a mesh's triangle as a face on which a ray starts or ends. */
#include <math.h>
#include <string.h>

#include "worker/render/base/exact.h"
#include "worker/render/shape/shape.h"

double triangle_end(const void *face, const double origin[3], const double direction[3], double t)
{
    const double(*corner)[3] = face;
    double n[3], end;

    exact_normal(corner, n);
    end = exact_crossing(corner, n, origin, direction);
    return end > 0 && end < INFINITY ? end : t;
}

void triangle_plane(const void *face, const double origin[3], const double direction[3], double t, double point[3],
                    double normal[3])
{
    const double(*corner)[3] = face;

    (void)origin;
    (void)direction;
    (void)t;
    exact_normal(corner, normal);
    memcpy(point, corner[0], sizeof corner[0]);
}

void triangle_corners(const void *face, double corner[3][3]) { memcpy(corner, face, 3 * sizeof corner[0]); }
