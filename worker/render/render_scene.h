/* world: the scene as the path loop reads it. Private to worker/render.
 *
 * Everything is immutable once render_scene_new has returned. The mesh pointers point into the
 * blobs, which the caller of render_scene_new keeps alive.
 */
#pragma once

#include <stdint.h>

#include "common/scene/effects.h"
#include "common/scene/scene.h"
#include "worker/render/accel/accel.h"
#include "worker/render/camera/camera.h"
#include "worker/render/light/emitters.h"
#include "worker/render/light/environment/environment.h"
#include "worker/render/render.h"
#include "worker/render/shape/shape.h"
#include "worker/render/texture/texture.h"

struct render_mesh {
    const float32 *positions, *normals, *tangents, *uv[2], *colors;
    const uint32_t *indices;
    uint32_t vertex_count, triangle_count;
    const uint8_t *blob; /* the whole blob: deformation reads it */
};

/* A prepared texture slot; the image is NULL if only the factor counts. */
struct render_slot {
    const struct texture_image *image;
    struct scene_texture texture;
    uint32_t uv_set;
    int color; /* a slot of colours: sRGB unless the texture says otherwise */
    int transformed;
    int shares_place; /* lookups by footprint use the place of render_material.lead */
    real m[2][3];
};

enum render_material_flags {
    MATERIAL_TEXTURED = 1,    /* any slot that is looked up by footprint has an image */
    MATERIAL_EMISSIVE = 2,
    MATERIAL_ALPHA = 4,       /* some point may be less than opaque */
    MATERIAL_NORMAL_MAP = 8,
    MATERIAL_CULLED = 16,     /* rays pass its back faces */
    MATERIAL_LAYERED = 32,    /* uses any of anisotropy ... diffuse transmission */
    MATERIAL_NEEDS_FRAME = 64, /* anisotropy or a clearcoat normal map: tangents are read */
    MATERIAL_TWO_WAY = 128,   /* light may pass through */
    MATERIAL_BOUNDS = 256,    /* a volume: refractive, or an interface; the path tracks it.
                                 VOLUMES_BOUNDARIES: also everything else that separates media */
    MATERIAL_ENCLOSES = 512,  /* every mesh of the body is closed, alone or with others */
};

struct render_material {
    struct scene_material m; /* name points into the scene and is not used here */
    union {                  /* one for each row TEXTURE of material_fields.h, by its name and by its number */
        struct {
#define RENDER_SLOT(name, ...) struct render_slot name;
            MATERIAL_FIELDS(MATERIAL_SKIP, RENDER_SLOT)
#undef RENDER_SLOT
        };
        struct render_slot slots[MATERIAL_TEXTURES];
    };
    unsigned flags;
    const struct render_slot *lead; /* the first slot with lookups by footprint; NULL: none */
    struct vec3 absorption;         /* 1/metre */
    uint32_t filling;               /* the material that fills the body: itself; in a mix the first
                                part that bounds a volume */
};

struct render_instance {
    uint32_t mesh, material;
    uint32_t body;                     /* the material whose body it bounds */
    uint32_t alpha_key;                /* for the stochastic alpha: from material and place, so that it
                                     stays the same when a mesh is split */
    const float32 *instance_positions; /* vertices in world space (at the shutter's opening), or NULL:
                                     transform the mesh's */
    struct transform to_world, to_object;
    int flipped; /* negative determinant: world winding is clockwise */
    /* What moves has values at motion_steps >= 2 moments, evenly spaced from the shutter's opening
     * to its closing; in between vertices move along straight lines. */
    uint32_t motion_steps;                   /* 0: no motion while the shutter is open */
    const struct transform *motion_to_world; /* [motion_steps]; NULL: `to_world` throughout */
    const float32 *const *motion_positions;  /* [motion_steps][vertices][3] world, or NULL: the
                                     mesh's vertices transformed; [0] is instance_positions */
    int bounded;                             /* deformed, or moved vertex by vertex: always within this box */
    real bounds_min[3], bounds_max[3];
    const float32 *deformed_normals, *deformed_tangents;           /* at the shutter's opening, or NULL: the mesh's.
                                     World space for a skinned mesh, else the mesh's */
    const float32 *const *motion_normals, *const *motion_tangents; /* [motion_steps] of the same, or NULL */
    int skinned;                                                   /* those are in world space */
    const struct shape *shape; /* in place of the mesh's triangles (shape/shape.h); NULL: none */
    int encloses;              /* what is behind its faces is closed in, and rays get there, but may
                                     slip out between them */
    const uint8_t *touches;    /* [triangles] may another face coincide with it? NULL: nowhere
                                     (render_touch.h) */
    const uint8_t *near;       /* [triangles] enum render_near; of a shape [0]; NULL: RENDER_NEAR_NONE */
    int32_t light_base;        /* first of its faces in the emitters, -1: dark */
};

/* The bodies that a ray is inside (interior.h). */
enum { INTERIOR_MAX = 16 };
struct interior {
    uint32_t count;
    int32_t medium;               /* VOLUMES_BOUNDARIES: the medium that the ray is in; -1: none */
    uint32_t entry[INTERIOR_MAX]; /* in the order of entry: the body's material, or INTERIOR_OWED */
};

struct render_box {
    real low[3], high[3];
};
enum { RENDER_BOXES_MAX = 8 };
struct render_boxes {
    uint32_t count;
    struct render_box box[RENDER_BOXES_MAX];
};
/* Where on a face may float take another for it, of which one bounds a volume? On a triangle near its edges, or
 * everywhere, because of other triangles; on any face in `near_places`, because one of the two is a shape. Bits. */
enum render_near { RENDER_NEAR_NONE = 0, RENDER_NEAR_EDGES = 1, RENDER_NEAR_ALL = 3, RENDER_NEAR_PLACES = 4 };
enum { ROULETTE_DEPTH = 3 };

struct casters;
struct kernel;

struct render_scene {
    struct render_settings settings;
    unsigned build_threads;     /* that may make it ready */
    uint64_t effects;           /* what the frame needs, minus settings.without */
    uint32_t roulette_depth;    /* Russian roulette begins at this vertex; UINT32_MAX: never */
    uint32_t frame;             /* the frame it was built for; any, unless `animated` */
    int animated;               /* another frame needs a scene of its own */
    struct accel_digits digits; /* .origin: of all coordinates here, in the scene's (scene_sight) */
    struct render_mesh *meshes;
    struct render_material *materials;
    struct render_instance *instances;
    struct texture_image **images;     /* NULL: not used */
    struct image_share **image_shares; /* the owners of the images */
    void **owned;                      /* blocks that are freed with the scene */
    size_t owned_count, owned_capacity;
    uint32_t mesh_count, material_count, instance_count, image_count;
    struct camera camera;
    struct environment *environment; /* NULL: none */
    struct render_medium **media;
    uint32_t medium_count;
    int32_t fog; /* its medium fills the bounding sphere, -1: none */
    struct emitters emitters;
    struct casters *casters; /* NULL: none (caustic/casters.h) */
    real caster_share;       /* of the vertices ask them (path/caustic_pilot.h) */
    struct accel *accel;
    /* Around everything that refracts or holds a medium, with a margin: there each face is crossed,
     * however close to another. If `near_known`, those faces have another close to them that render_instance.near
     * tells, up to `near_reach` metres from their edges; else any may. */
    struct render_boxes boundaries, near_places;
    int near_known;
    real near_reach;
    struct vec3 bounds_centre;
    real bounds_radius;              /* Ritter's bounding sphere of the geometry, metres */
    real fog_radius;                 /* the same, grown to include the camera */
    int enclosed;                    /* no ray escapes from where the camera is (enclosure.h) */
    struct interior camera_interior; /* the bodies that contain the camera */
    enum scene_volume_rule volume_rule;
    const struct kernel *kernel;
    struct render_scene_info info;
};

/* A slot's texel at a triangle's barycentric coordinates (weights of vertices 1 and 2). `footprint`: width of the ray's
 * beam over the square root of the triangle's area (both in world space), 0: finest. */
struct texel slot_lookup(const struct render_slot *slot, const struct render_mesh *mesh, const uint32_t vertex[3],
                         real b1, real b2, real footprint, int srgb);

/* The place of that lookup. */
void slot_place(const struct render_slot *slot, const struct render_mesh *mesh, const uint32_t vertex[3], real b1,
                real b2, real footprint, struct texture_place *place);

/* Alpha of the material at a point of a triangle, 0..1, before the alpha mode is applied. */
real material_alpha(const struct render_material *material, const struct render_mesh *mesh, const uint32_t vertex[3],
                    real b1, real b2);

/* Emitted radiance at a point of a triangle, below a clearcoat. */
struct vec3 material_emission(const struct render_material *material, const struct render_mesh *mesh,
                              const uint32_t vertex[3], real b1, real b2);

/* The same as it arrives from a direction with this absolute cosine to the geometric normal
 * (next-event estimation knows no other), in surroundings of index `outside` (0 counts as 1). */
struct vec3 material_emitted(const struct render_material *material, const struct render_mesh *mesh,
                             const uint32_t vertex[3], real b1, real b2, real cosine, real outside);

/* The three corners of a triangle in world space at `time` (0..1 of the shutter). */
void triangle_of_instance(const struct render_scene *scene, const struct render_instance *instance, uint32_t triangle,
                          real time, struct vec3 corner[3]);

/* The same in double, for the accel; `scene` is a struct render_scene. */
accel_corners triangle_exact_corners;

/* A place in the scene's coordinates, as the description and those who ask for it have them. `rest`: what
 * rounding p left over; NULL: not known. */
static inline struct vec3 beyond_boundaries(const struct render_scene *scene, struct vec3 p, const double rest[3])
{
    return vec3_make((real)((double)p.x + (rest ? rest[0] : 0) + scene->digits.origin[0]),
                     (real)((double)p.y + (rest ? rest[1] : 0) + scene->digits.origin[1]),
                     (real)((double)p.z + (rest ? rest[2] : 0) + scene->digits.origin[2]));
}

static inline int render_boxes_hold(const struct render_boxes *boxes, struct vec3 p)
{
    for (uint32_t i = 0; i < boxes->count; i++) {
        const struct render_box *box = &boxes->box[i];
        if (p.x >= box->low[0] && p.x <= box->high[0] && p.y >= box->low[1] && p.y <= box->high[1] &&
            p.z >= box->low[2] && p.z <= box->high[2])
            return 1;
    }
    return 0;
}

/* Is another face, of which one refracts or bounds a medium, so near that float may take it for this one? At a place
 * on a triangle, `inset` metres from its edges, or on a shape (triangle 0, any inset). */
static inline int render_near_face(const struct render_scene *scene, const struct render_instance *instance,
                                   uint32_t triangle, struct vec3 p, real inset)
{
    unsigned near;

    if (!scene->near_known)
        return render_boxes_hold(&scene->boundaries, p);
    near = instance->near ? instance->near[triangle] : RENDER_NEAR_NONE;
    if (near & RENDER_NEAR_PLACES && render_boxes_hold(&scene->near_places, p))
        return 1;
    return ((near & RENDER_NEAR_ALL) == RENDER_NEAR_ALL ||
            (near & RENDER_NEAR_EDGES && !(inset > scene->near_reach))) &&
           render_boxes_hold(&scene->boundaries, p);
}

static inline const uint32_t *triangle_vertices(const struct render_mesh *mesh, uint32_t triangle)
{
    return mesh->indices + 3 * (size_t)triangle;
}
