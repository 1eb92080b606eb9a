/* casters: the smooth surfaces off which, or through which, the light of small lamps, and of the suns of an environment
 * map, reaches other surfaces.
 *
 * Path tracing does not find that light: no scattered ray meets a point, and few meet a small lamp or a sun. So for a place and a lamp all
 * points of the casters are found at which the surface reflects, or refracts, the one towards the other: with w_i to the
 * place, w_o to the lamp and the indices on their sides, n_i w_i + n_o w_o is along the shading normal (Walter et al.
 * 2007; the constraint of Hanika, Droske and Fascione 2015, "Manifold Next Event Estimation"). They are enumerated, not
 * sampled: a tree over a caster's triangles, whose nodes bound places and normals, leaves out what cannot hold one;
 * triangles with normals of their vertices are divided and solved by Newton's method. So the same place and lamp have the
 * same solutions on every machine, and what a path adds has no tail of trials.
 *
 * A caster is a material whose base, or whose coat, is smooth everywhere: GGX alpha below BSDF_ALPHA_MIN by its factor, no
 * normal map, no mix, no dispersion. Instances that move while the shutter is open, or have a shape (true spheres), are
 * none, nor are triangles without area or whose vertices' normals disagree by a right angle. One reflection or one
 * refraction: a path by two smooth surfaces is not found.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "common/math/real.h"

struct hit;
struct render_scene;
struct scene_material;
struct casters;

enum caster_event {
    CASTER_REFLECTS, /* place and lamp on the same side */
    CASTER_REFRACTS, /* on different ones */
    CASTER_EVENTS
};

/* Where a caster sends light of the lamp to the place. */
struct caster_solution {
    enum caster_event event;
    uint32_t material;
    double point[3];     /* metres */
    double direction[3]; /* unit, from the place to the point */
    double distance;     /* metres, likewise */
    /* How a thin cone of rays that starts at the place spreads: its cross-section at the lamp over the solid angle at
     * its start, m^2/sr; of a lamp at infinity the solid angle of its directions there over that at the start. */
    double spread;
};
typedef void caster_visit(void *user, const struct caster_solution *solution);

/* *out: NULL if the scene has no caster, or neither a lamp without size, nor a small one, nor a sun
 * (environment_has_windows). Needs all of
 * the scene but its guide. */
status casters_new(struct casters **out, const struct render_scene *scene, struct error *err) MUST_CHECK;
void casters_free(struct casters *casters);
/* They are asked for lamps without size alone. NULL, and they are gone: the scene has none. */
struct casters *casters_for_points(struct casters *casters);
size_t casters_bytes(const struct casters *casters); /* NULL: 0 */
/* May the material be a caster, and what then a triangle of it takes, at most; and what all take besides. */
enum { CASTERS_BYTES_TRIANGLE = 150, CASTER_CELLS_BYTES = 16 << 20 };
int casters_may_be(const struct scene_material *m);

/* Is the material a caster with that event? *ior: behind its front, relative to before it. */
int casters_have(const struct casters *casters, uint32_t material, enum caster_event event, double *ior);

/* Can a sun of the map be seen from some caster; from near this triangle of one? Elsewhere suns are not asked for. */
int casters_have_suns(const struct casters *casters);
int casters_are_sunlit(const struct casters *casters, uint32_t instance, uint32_t triangle);

/* A lamp at the point `at`, or in the unit direction `at`. `moves`: it is elsewhere when it is asked for again. */
enum caster_lamp_kind { CASTER_LAMP_NEAR, CASTER_LAMP_FAR, CASTER_LAMP_SUN };
struct caster_lamp {
    double at[3];
    double middle[3], radius; /* of a near lamp with area: a sphere around it; of a point: the point, and 0 */
    enum caster_lamp_kind kind;
    int moves;
};

/* The small lamps (caster_lamps.c): instances, of whose faces one is chosen with *u and *v, in [0, 1), which are then
 * numbers for a point on it. Fills in all of *lamp but `at`, and the face's odds among all. */
uint32_t casters_lamp_count(const struct casters *casters);
int casters_know_lamp(const struct casters *casters, uint32_t instance);
const struct hit *casters_choose_face(const struct casters *casters, real *u, real *v, real *odds,
                                      struct caster_lamp *lamp);

/* Every solution between `place` and the lamp; of a sun by faces that are sunlit. All in the scene's coordinates. The
 * order depends on the scene alone. */
void casters_find(const struct casters *casters, const double place[3], const struct caster_lamp *lamp,
                  caster_visit *visit, void *user);
