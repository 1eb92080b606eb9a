/* safeguard: what keeps a hard case stable, each with a switch for the tests.
 *
 *     static float mis_weight(float a, float b)
 *     {
 *         if (SAFEGUARD(MIS_OVERFLOW)) ...
 *
 * In an ordinary build SAFEGUARD(...) is the constant 1 and nothing of this file is left. In the
 * build of `make numerics` (SAFEGUARDS=1) one safeguard at a time is off: the one that the environment
 * variable AZULEJO_SAFEGUARD_OFF names, or numbers. tests/numerics/safeguards.py runs the tests
 * so, and fails where none of them notices. A switch stands inside the one function that is the
 * safeguard, not at its callers.
 */
#ifndef AZULEJO_BASE_SAFEGUARD_H
#define AZULEJO_BASE_SAFEGUARD_H

/* X(NAME, what it prevents): the sentence says what goes wrong without it. */
#define SAFEGUARD_MAP(X)        \
    SAFEGUARDS_OF_HITS(X)       \
    SAFEGUARDS_OF_SCATTERING(X) \
    SAFEGUARDS_OF_LIGHT(X)      \
    SAFEGUARDS_OF_CAMERA(X)     \
    SAFEGUARDS_OF_SUMS(X)       \
    SAFEGUARDS_OF_OUTPUT(X)

/* Rays, faces, contacts, bodies: worker/render/{accel,surface,scene,path}. */
#define SAFEGUARDS_OF_HITS(X)                                                                      \
    X(HIT_IN_DOUBLE, "a hit's place, along the ray in float, lies off its face")                  \
    X(LEFT_BY_NAME, "a face counts as one that is in contact with itself")                        \
    X(LEFT_SPHERE, "a ray that leaves a sphere meets it at once")                                 \
    X(BEHIND_LEFT_PLANE, "a ray meets a neighbour that lies below the face which it leaves")      \
    X(EDGE_SIDE, "a ray from an edge meets the wrong one of its faces")                           \
    X(DOUBLE_DECIDES, "float decides what is met near a ray's ends")                              \
    X(ERROR_OF_INSTANCE, "float decides near instances, where its error is larger")               \
    X(GRAZING_RAY, "float decides where a ray along a plane meets it")                            \
    X(HUGE_TRIANGLES, "a huge triangle's error hides what is near it")                            \
    X(EDGE_INSET, "a ray from an edge misses the neighbour that stands there")                    \
    X(AIM_AT_END, "a shadow ray from an edge misses the wall before a lamp")                      \
    X(REFINE_FIRST, "of faces closer than float's error the second is met first")                 \
    X(CONTACT_TOGETHER, "of faces in contact some are skipped, some crossed twice")               \
    X(LEAK_REPAIR, "rays slip out of closed meshes at vertices")                                  \
    X(LEAK_SHADOW, "light slips into closed meshes at vertices")                                  \
    X(LEAK_OF_ROOM, "a ray from mid-air slips out of a room")                                     \
    X(LEAK_OF_FACE, "a ray slips out of the closed mesh into which it leaves a face")             \
    X(LEAK_OF_BODY, "a ray slips out of a body of several meshes")                                \
    X(SPHERE_NEAREST_POINT, "a small sphere far away has a ragged outline")                       \
    X(MIRRORED_WINDING, "a mirrored mesh is inside out")                                          \
    X(NORMAL_ZERO, "a normal of length 0 turns towards the camera")                               \
    X(NORMAL_OF_STRETCHED, "a stretched mesh is shaded as if it were not")                        \
    X(MIRROR_ABOVE, "a coarse smooth mirror has black rims")                                      \
    X(SHADING_SIDES, "light leaks through a face whose shading normal leans")                     \
    X(BASIS_AT_POLE, "a wall that faces -z is black")                                             \
    X(LENGTH_RANGE, "a very short or long normal makes its face black")                           \
    X(BODY_OF_MESHES, "a body closed by meshes of two materials is never left")                   \
    X(BODY_PRIORITY, "of overlapping bodies the last entered wins")                               \
    X(BODY_OWED, "a body left without having been entered is entered for good")                   \
    X(ALPHA_HASH, "veils behind one another let pass or stop the same samples")                   \
    X(EMBREE_ROBUST, "rays slip between triangles (--robust off)")                                \
    X(BVH_LOW, "--bvh-quality low")                                                               \
    X(BVH_HIGH, "--bvh-quality high")

/* Lobes, random numbers, weights of paths: worker/render/{bsdf,base,path}. */
#define SAFEGUARDS_OF_SCATTERING(X)

/* Lamps, environment maps, media, textures: worker/render/{light,medium,texture}. */
#define SAFEGUARDS_OF_LIGHT(X)

/* Cameras, poses, the scene's numbers: worker/render/camera, common/{math,scene}, client/import. */
#define SAFEGUARDS_OF_CAMERA(X)

/* Samples, units, the film, statistics: worker/render/path/tile.c, common/{film,accuracy}, coordinator/film. */
#define SAFEGUARDS_OF_SUMS(X) \
    X(FINITE_UNIT, "a worker's sums that are not finite make their pixels NaN for good")

/* Tone mappers and the formats of pictures: common/{tonemap,image}. */
#define SAFEGUARDS_OF_OUTPUT(X)

#ifndef AZULEJO_SAFEGUARDS
#define SAFEGUARD(name) 1
#else
enum safeguard {
#define SAFEGUARD_ENUM(name, prevents) SAFEGUARD_##name,
    SAFEGUARD_MAP(SAFEGUARD_ENUM)
#undef SAFEGUARD_ENUM
    SAFEGUARD_COUNT
};
extern const char *const safeguard_names[SAFEGUARD_COUNT];
/* Set before main, and constant from then on. -1: all safeguards are on. */
extern int safeguard_off;
#define SAFEGUARD(name) (safeguard_off != SAFEGUARD_##name)
#endif

#endif
