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
#define SAFEGUARDS_OF_HITS(X)

/* Lobes, random numbers, weights of paths: worker/render/{bsdf,base,path}. */
#define SAFEGUARDS_OF_SCATTERING(X)

/* Lamps, environment maps, media, textures: worker/render/{light,medium,texture}. */
#define SAFEGUARDS_OF_LIGHT(X) \
    X(MAP_ROW_END, "a map's row whose first texel outshines the rest ends in a cell that takes all samples") \
    X(MAP_DARK_CELLS, "texels too dark for the importance table are never sampled, and their light is lost") \
    X(MAP_RADIANCE, "a map with infinite texels makes samples that are not finite") \
    X(MAP_POLE, "a map's zenith is looked up in steps of 3e-4 radians") \
    X(MAP_SEAM, "a sun on the map's seam loses the light on its far side") \
    X(LAMP_DISTANCE, "a lamp that touches the surface it lights counts as a fault") \
    X(PORTAL_SOLID_ANGLE, "a small window's solid angle cancels, and its light is too bright or too dark") \
    X(SPHERE_LAMP_FAR, "a spherical lamp far away is too bright, too dark or black") \
    X(SPHERE_LAMP_INSIDE, "what is inside a spherical lamp is black") \
    X(LIGHT_TREE_SLACK, "the tree takes points at the edge of a beam for dark ones") \
    X(LIGHT_TREE_ODDS, "a faint lamp beside a strong one that is hidden is never chosen") \
    X(LIGHT_TABLE_FAINT, "with --light-choice power a faint lamp vanishes in the sum of the strong ones") \
    X(LIGHT_RESCALED, "a random number becomes 1 and chooses a light that has no odds") \
    X(LIGHT_IMAGE_SPOT, "a slide whose only bright spot lies between 48 by 48 points stays dark") \
    X(MEDIUM_STEP, "in a dense medium free paths shorter than the spacing of floats are lost") \
    X(MEDIUM_CLEAR, "a channel without extinction is NaN along a ray without end") \
    X(MEDIUM_THIN, "emission in a medium that hardly absorbs is a quotient of rounding errors") \
    X(MEDIUM_PHASE, "the forward peak of the phase function cancels") \
    X(GRID_BLOCK_EDGE, "a grid's majorant leaves out the cells across its block's edge") \
    X(GRID_AXIS, "rays along an axis miss a grid") \
    X(GRID_CELL, "a grid's NaN cells make samples that are not finite") \
    X(TEXTURE_COORDINATE, "texture coordinates that overflow read outside the image") \
    X(MIP_LIGHT, "distant textures are too dark: codes are averaged instead of light")

/* Cameras, poses, the scene's numbers: worker/render/camera, common/{math,scene}, client/import. */
#define SAFEGUARDS_OF_CAMERA(X) \
    X(REBASE, "a scene far from its file's origin is drawn in steps of floats") \
    X(VERTEX_ORIGIN, "triangles of a text file in map coordinates collapse") \
    X(POSE_DOUBLE, "places of nodes far from their parents are rounded to floats") \
    X(POSE_TINY_SCALE, "a camera below nodes of tiny scale loses its direction") \
    X(KEYS_EQUAL, "between two equal keys of a rotation nothing is turned") \
    X(NORMAL_COFACTORS, "a skin that is pressed flat keeps the normals of its rest pose") \
    X(SKIN_WEIGHTS, "a skin whose weights do not add up to 1 shrinks or swells")

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
