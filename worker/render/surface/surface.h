/* surface: turns a hit into a point that can be shaded.
 *
 * The hit's position is computed again from the triangle, in double, so that it depends on neither Embree's kernels nor
 * the ISA. The next ray starts exactly there and names the triangle that it leaves (struct ray).
 */
#pragma once

#include "common/math/vec.h"
#include "worker/render/accel/accel.h"
#include "worker/render/bsdf/bsdf.h"
#include "worker/render/texture/texture.h"

struct render_scene;
struct render_instance;
struct render_material;
struct render_mesh;

struct surface {
    const struct render_instance *instance;
    const struct render_material *material;
    const struct render_mesh *mesh;
    const uint32_t *vertex; /* the triangle's three vertex numbers */
    uint32_t number;        /* the instance's */
    uint32_t triangle;
    real b1, b2;          /* barycentric weights of vertices 1 and 2 */
    real t;               /* metres from the ray's origin */
    real area;            /* of the triangle, m^2 */
    int contacts;         /* very close faces count (struct ray) */
    real inset;           /* lower bound of the distance to the triangle's edges, metres */
    real edge;            /* its longest edge, metres; 0: not known */
    real footprint;       /* width of the ray's beam over sqrt(area); 0: textures at their finest */
    real time;            /* 0..1: the ray's */
    struct vec3 came;     /* unit: the ray's direction */
    int front;            /* met from the side of counter-clockwise winding */
    struct vec3 p;        /* world, rounded to float */
    double rest[3];       /* metres: the rounding error; the exact point is p + rest */
    uint32_t other_count; /* faces that coincide with it (crossing.h): rays leave them as well */
    struct hit others[RAY_LEFT_MAX - 1];
    struct vec3 ng;             /* unit geometric normal on the ray's side */
    struct basis basis;         /* shading frame on the ray's side, after surface_shade */
    struct texture_place place; /* shared by the material's textures, while it is shaded */
};

/* Position and geometric normal of the hit. */
void surface_from_hit(const struct render_scene *scene, const struct ray *ray, const struct hit *hit,
                      struct surface *s);

/* Shading frame and the material's values; `wo` is unit, world, towards the ray's origin. The frame is bent so that wo
 * is above it and, if anything reflects, so that the mirror direction is above it and above the geometric surface. */
void surface_shade(const struct render_scene *scene, struct surface *s, struct vec3 wo, struct bsdf_params *params);

/* The vertices' normal on the front side, unit, before it is bent; the face's own where they have none, and of a
 * shape. */
struct vec3 surface_vertex_normal(const struct surface *s);

/* If the material is a mix: choose one of its parts with the number `u` in [0,1). */
void surface_resolve_mix(const struct render_scene *scene, struct surface *s, real u);

/* Vertex colour; the mesh has MESH_COLORS. */
struct vec3 surface_vertex_color(const struct surface *s);

/* First uv set at the hit; 0, 0 where the mesh has none. */
void surface_uv(const struct surface *s, real *u, real *v);

/* A ray that leaves the surface towards `direction`, to either side, without end. */
void surface_leave(const struct surface *s, struct vec3 direction, struct ray *ray);
