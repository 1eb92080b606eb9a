/* casters_parts: what the files of the casters share. Private to worker/render/caustic. */
#pragma once

#include "worker/render/base/exact.h"
#include "worker/render/caustic/casters.h"
#include "worker/render/light/light_table.h"

static inline double caster_length(const double a[3]) { return sqrt(exact_dot(a, a)); }

/* What lies in a part of a caster, or of a triangle. */
struct caster_bounds {
    double centre[3], radius; /* a sphere around its points */
    double axis[3];           /* unit; the shading normals, or their opposites, are within a cone around it */
    double cosine, sine;      /* of the cone's half angle; cosine below 0: not known */
};

/* A triangle in the scene's coordinates, its corners counter-clockwise as seen from the front. */
struct caster_face {
    double corner[3][3];
    double normal[3][3];           /* shading normals at the corners, of any length */
    double e1[3], e2[3], own[3];   /* edges; unit normal of the face */
    double along_u[3], along_v[3]; /* u, v of a point of its plane, from the first corner: the products with these */
    double d1[3], d2[3];           /* changes of the shading normal along the edges */
    double longest;                /* of the two edges, metres */
    int flat;                      /* the normals are the face's */
    struct caster_bounds bounds;
};

struct caster_ref {
    uint32_t instance, triangle;
    float32 middle[3]; /* times 3: for sorting */
};

enum { CASTER_DEPTH_MAX = 64 }; /* of the tree */
struct caster_node {
    struct caster_bounds bounds;
    double front[3], front_cosine, front_sine; /* likewise of the faces' own normals, as the front has them */
    uint32_t first, count; /* of the faces; count 0: an inner node, whose children are the next one and node `first` */
    int sunlit;            /* a sun has been seen from one of its faces */
};

/* The faces of one material. */
struct caster {
    uint32_t material;
    unsigned events; /* bits of enum caster_event */
    double ior;      /* behind its front, relative to before it */
    struct caster_node *nodes;
    struct caster_ref *refs;   /* [face_count] */
    struct caster_face *faces; /* [face_count], or NULL: there are many, and each is made when it is needed */
    uint32_t node_count, face_count;
};

struct small_lamp {
    uint32_t instance;
    double middle[3], radius; /* a sphere around it */
};
struct caster_lamps {
    struct small_lamp *list;
    uint32_t count;
    uint32_t *of_instance; /* [instances] 1 + its lamp; 0: it is none */
    struct hit *faces;
    struct light_table table; /* of the faces */
};

struct casters {
    const struct render_scene *scene;
    struct caster_lamps lamps;
    struct caster_cells *cells;
    struct caster *list;
    uint32_t count;
    int suns;        /* a sun is seen from a caster */
    uint64_t *base;  /* [instances] the number of its first triangle in `sunlit`; of casters' alone. NULL: no suns */
    uint8_t *sunlit; /* bits: the triangle's node is sunlit */
};

/* A place and a lamp; or all places, and all of a lamp, within a radius, and all directions of a lamp within a chord.
 * Points on an edge belong to two triangles, and symmetric scenes have many: `met` are those, and each is reported once. */
enum { CASTER_MET_MAX = 32 };
struct caster_pair {
    const double *place, *lamp;
    double place_radius, lamp_radius, lamp_chord;
    enum caster_lamp_kind kind;
    int infinite;
    uint32_t met_count;
    double met[CASTER_MET_MAX][3];
    enum caster_event met_event[CASTER_MET_MAX];
};

/* May a face of the node send light from the lamp to the place? */
int caster_node_may(const struct caster *caster, const struct caster_node *node, const struct caster_pair *pair);

/* The nodes, in the tree's order, from which a search has to go down: none where there is no solution. `number`: of
 * the caster. Owned by the cells. */
status caster_cells_new(struct caster_cells **out, struct error *err) MUST_CHECK;
void caster_cells_free(struct caster_cells *cells);
size_t caster_cells_bytes(const struct caster_cells *cells);
const uint32_t *caster_cells_find(struct caster_cells *cells, const struct caster *caster, uint32_t number,
                                  const double place[3], const struct caster_lamp *lamp, uint32_t *count);

/* Fill in nodes, refs and faces, of all instances of the material that stand still; face_count is 0 where there are
 * none. ERR_NO_MEMORY. */
status caster_build(struct caster *caster, const struct render_scene *scene, uint32_t material,
                    struct error *err) MUST_CHECK;

/* Make the face. 0: it has no area, or its vertices' normals disagree by a right angle or more. */
int caster_face_of(const struct render_scene *scene, const struct caster_ref *ref, struct caster_face *face);

/* Fill in what follows from corners and normals. */
void caster_face_finish(struct caster_face *face);

/* Find out from which nodes the map's suns can be seen, by rays from places on their faces. Sets sunlit and suns.
 * ERR_NO_MEMORY. */
status casters_look_for_suns(struct casters *casters, struct error *err) MUST_CHECK;

/* Find casters->lamps: those that may be small, before the casters have trees; and of these the small ones, with their
 * faces. ERR_NO_MEMORY. */
status caster_lamps_begin(struct casters *casters, struct error *err) MUST_CHECK;
status caster_lamps_finish(struct casters *casters, struct error *err) MUST_CHECK;
void caster_lamps_release(struct caster_lamps *lamps);

/* Bounds of a triangle with these corners and normals. */
void caster_bounds_of(const double (*corner)[3], const double (*normal)[3], struct caster_bounds *out);

/* A pair as the points of the bounds see it: unit vectors from their centre, and how far, in chords, other points' may be
 * from these (2: they may be any). */
struct caster_view {
    double place[3], lamp[3], place_chord, lamp_chord;
};
void caster_view_of(const struct caster_bounds *bounds, const struct caster_pair *pair, struct caster_view *out);

/* May a surface within the bounds send light from the lamp to the place, where the index is n_i on the place's side
 * and n_o on the lamp's? */
int caster_may(const struct caster_bounds *bounds, const struct caster_view *view, double n_i, double n_o);

/* Every solution on a face. */
void caster_solve(const struct caster *caster, const struct caster_face *face, struct caster_pair *pair,
                  caster_visit *visit, void *user);
