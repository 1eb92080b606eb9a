#include "worker/render/surface/surface_shape.h"

#include <math.h>

#include "worker/render/base/exact.h"
#include "worker/render/shape/shape.h"
#include "worker/render/surface/render_motion.h"

uint32_t surface_locate(const struct render_scene *scene, struct surface *s)
{
    const struct shape *shape = s->instance->shape;
    double p[3], weight[3], corner[3][3], n[3], sum = 0;
    uint32_t triangle;

    if (!shape)
        return s->triangle;
    exact_vec(transform_point(&s->instance->to_object, s->p), p);
    triangle = shape_rows[shape->kind].cover(s->mesh, p, weight);
    for (int k = 0; k < 3; k++) {
        weight[k] = fmax(weight[k], 0);
        sum += weight[k];
    }
    s->vertex = triangle_vertices(s->mesh, triangle);
    s->b1 = (real)(weight[1] / sum);
    s->b2 = (real)(weight[2] / sum);
    corners_of_triangle(scene, s->instance, s->vertex, s->time, corner);
    exact_normal(corner, n);
    s->area = (real)(0.5 * sqrt(exact_dot(n, n)));
    return triangle;
}

void surface_on_shape(const struct render_scene *scene, const struct ray *ray, const struct hit *hit, struct surface *s)
{
    const struct shape *shape = s->instance->shape;
    const uint32_t side = hit->triangle;
    double o[3], d[3], p[3], n[3], sign = side ? -1 : 1;

    exact_vec(ray->direction, d);
    exact_origin(ray, o);
    shape_rows[shape->kind].place(shape, o, d, side, p, n);
    s->triangle = 0;
    s->vertex = triangle_vertices(s->mesh, 0);
    s->b1 = s->b2 = 1.0f / 3;
    s->t = (real)((p[0] - o[0]) * d[0] + (p[1] - o[1]) * d[1] + (p[2] - o[2]) * d[2]);
    s->p = exact_round(p, s->rest);
    s->area = 1;
    s->contacts = render_near_face(scene, s->instance, 0, s->p, INFINITY);
    s->edge = 0;
    s->inset = INFINITY; /* there are no edges beyond which a neighbour stands */
    s->front = side == shape->front;
    s->ng = vec3_make((real)(sign * n[0]), (real)(sign * n[1]), (real)(sign * n[2]));
    if (shape->located)
        (void)surface_locate(scene, s);
}
