/* safeguard: what keeps a hard case stable, each with a switch for the tests.
 *
 *     static real power_heuristic(real a, real b)
 *     {
 *         if (SAFEGUARD(MIS_OVERFLOW)) ...
 *
 * In an ordinary build SAFEGUARD(...) is the constant 1 and nothing of this file is left. In the build of `make
 * numerics` (SAFEGUARDS=1) one safeguard at a time is off: the one that the environment variable AZULEJO_SAFEGUARD_OFF
 * names, or numbers. tests/numerics/safeguards.py runs the tests so, and fails where none of them notices. A switch
 * stands inside the one function that is the safeguard, not at its callers.
 */
#pragma once

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
    X(PASSED_BEFORE, "light is caught between two faces closer than Embree's error")              \
    X(EDGE_SIDE, "a ray from an edge meets the wrong one of its faces")                           \
    X(DOUBLE_DECIDES, "float decides what is met near a ray's ends")                              \
    X(ERROR_OF_INSTANCE, "float decides near instances, where its error is larger")               \
    X(GRAZING_RAY, "float decides where a ray along a plane meets it")                            \
    X(HUGE_TRIANGLES, "a huge triangle's error hides what is near it")                            \
    X(EDGE_INSET, "a ray from an edge misses the neighbour that stands there")                    \
    X(OWN_EDGE, "one long triangle of a mesh spoils the shadows of its short ones")              \
    X(AIM_AT_END, "a shadow ray from an edge misses the wall before a lamp")                      \
    X(REFINE_FIRST, "of faces closer than float's error the second is met first")                 \
    X(NEAR_FACES, "of faces closer than float's error no one asks which comes first")             \
    X(NEAR_SHAPES, "of a sphere and a face closer than float's error no one asks which comes first") \
    X(CONTACT_TOGETHER, "of faces in contact some are skipped, some crossed twice")               \
    X(LEAK_REPAIR, "rays slip out of closed meshes at vertices")                                  \
    X(LEAK_SHADOW, "light slips into closed meshes at vertices")                                  \
    X(LEAK_OF_ROOM, "a ray from mid-air slips out of a room")                                     \
    X(LEAK_OF_FACE, "a ray slips out of the closed mesh into which it leaves a face")             \
    X(LEAK_OF_BODY, "a ray slips out of a body of several meshes")                                \
    X(LEAK_OUTLINE, "a small hole of a room passes too little light")                             \
    X(LEAK_OF_COPY, "a ray that is traced again meets the face that it leaves, written twice")    \
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
#define SAFEGUARDS_OF_SCATTERING(X) \
    X(SMOOTH_MIRROR, "a mirror of roughness 0 is black: its density is 0 / 0") \
    X(NARROW_AXIS, "a metal that is smooth across its brushing reflects more than comes in") \
    X(GGX_DENSITY, "the highlight of a narrow lobe has a wrong shape: 1 - cos^2 cancels") \
    X(COAT_DENSITY, "the highlight of a smooth coat has a wrong shape: 1 - cos^2 cancels") \
    X(COSINE_RIM, "a direction on the horizon has no density") \
    X(CORRELATED_SHADOW, "rough glass that hardly refracts is black at grazing angles") \
    X(STRAIGHT_REFRACTION, "rough glass of the index around it loses light: its half vector is 0") \
    X(TOTAL_REFLECTION, "light that glass reflects totally is lost") \
    X(INDEX_RANGE, "a very large index reflects nothing at grazing angles") \
    X(F90_FADE, "plastic of the index around it keeps a bright rim") \
    X(COLOR_RANGE, "a colour above 1 reflects more than comes in") \
    X(SHEEN_LIMIT, "cloth of a small roughness reflects more than comes in") \
    X(SHEEN_HORIZON, "cloth seen along its surface shines without bound") \
    X(FILM_ENERGY, "a film and what lies below it reflect more than comes in") \
    X(WHITE_UNDER_FILM, "white metal under a film is black") \
    X(THICK_FILM, "a thick film has arbitrary colours: its exponential leaves the floats") \
    X(INTERFACE_DOUBT, "rough glass sends out more than comes in") \
    X(GRAZE_SHARE, "nearly smooth metal seen along its surface has samples of hundreds of times its radiance") \
    X(USABLE_SAMPLE, "a sampled direction without a density makes its sample no number") \
    X(MIS_OVERFLOW, "a lamp of less than 1e-19 m2 gives no light: squares of densities overflow") \
    X(LIGHT_DENSITY, "a light of density 0 makes the whole sample infinite") \
    X(ROULETTE_ETA, "clear glass is noisy: paths end inside of it") \
    X(ROULETTE_FLOOR, "what a dark surface reflects is a few bright pixels") \
    X(UNIT_BELOW_1, "a random number is 1, and points lie in a neighbour's cell") \
    X(INDEPENDENT_PAIRS, "all decisions of a path use the same random numbers") \
    X(FINITE_SAMPLE, "one sample that is no number makes its pixel as bright as a float can be") \
    X(FINITE_VARIABLE, "one normal that is no number makes its pixel as long as a float can be") \
    X(SUM_RANGE, "a pass of samples near the largest float is infinite")

/* Lamps, environment maps, media, textures: worker/render/{light,medium,texture}. */
#define SAFEGUARDS_OF_LIGHT(X) \
    X(MAP_DARK_CELLS, "texels too dark for the importance table are never sampled, and their light is lost") \
    X(MAP_RADIANCE, "a map with infinite texels makes samples that are not finite") \
    X(MAP_POLE, "a map's zenith is looked up in steps of 3e-4 radians") \
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
    X(VIEW_ORIGIN, "one far thing spoils the shadows of all that is near") \
    X(VERTEX_ORIGIN, "triangles of a text file in map coordinates collapse") \
    X(POSE_DOUBLE, "places of nodes far from their parents are rounded to floats") \
    X(POSE_TINY_SCALE, "a camera below nodes of tiny scale loses its direction") \
    X(KEYS_EQUAL, "between two equal keys of a rotation nothing is turned") \
    X(NORMAL_COFACTORS, "a skin that is pressed flat keeps the normals of its rest pose") \
    X(SKIN_WEIGHTS, "a skin whose weights do not add up to 1 shrinks or swells")

/* Samples, units, the film, statistics: worker/render/path/tile.c, common/{film,accuracy}, coordinator. */
#define SAFEGUARDS_OF_SUMS(X) \
    X(FINITE_UNIT, "a worker's sums that are not finite make their pixels NaN for good") \
    X(FILM_DOUBLE, "sums over many passes lose their last digits") \
    X(PASS_ORDER, "a result that comes early is counted as the one before it, which is then lost") \
    X(DUPLICATE_UNIT, "a result that is sent twice counts twice") \
    X(FINITE_AMOUNT, "an infinite count of clamped light makes the frame's share of it NaN") \
    X(FRAME_DOUBLE, "the mean of a large frame, and all relative errors, are off") \
    X(RMSE_OF_BLACK, "a black picture has a relative error of 0 / 0") \
    X(PSNR_OF_EQUAL, "a picture without noise has no interval of its PSNR") \
    X(DISPLAY_OF_EQUAL, "a picture without noise has no interval of its display error") \
    X(ERF_TAIL, "cancellation: pixels with little noise spoil the display error") \
    X(CURVE_POINT, "one frame without an error makes the time left unknown")

/* Tone mappers, the formats of pictures, elementary functions: common/{tonemap,image,math}. */
#define SAFEGUARDS_OF_OUTPUT(X) \
    X(LIGHT_FINITE, "infinite light is black where a tone mapper divides infinity by infinity") \
    X(DISPLAY_RANGE, "display codes leave 0 to 1 where a look-up table does") \
    X(LOG_SUM_RANGE, "the product of luminances underflows, and the picture is white") \
    X(BLACK_PIXEL, "black pixels make the log-mean far too small, and the picture too bright") \
    X(INFINITE_PIXEL, "one infinite pixel darkens all others") \
    X(REINHARD_BLACK, "a black picture becomes white: its white point is 0") \
    X(REINHARD_SUN, "a region too bright for float becomes black in the local operator") \
    X(DRAGO_FAINT, "pixels too faint to change 1 + x become white") \
    X(MANTIUK06_RANGE, "a picture of one colour is divided by its contrast, the noise of the arithmetic") \
    X(MANTIUK08_SINGULAR, "a picture without contrast is white: its curve is undetermined") \
    X(HILL_DOUBLE, "the sun becomes black: infinity over infinity") \
    X(HALF_RANGE, "light above 65504 is infinite in a half-float EXR") \
    X(HALF_SUBNORMAL, "light below 6e-5 is black in a half-float EXR") \
    X(HALF_NEAREST, "half-float pictures are too dark on average") \
    X(PICTURE_REPAIR, "a NaN, infinite or negative texel of a map is light") \
    X(CLEAR_TEXEL, "a texel with alpha 0 is 0 / 0") \
    X(PFM_FINITE, "a NaN or infinite texel of a PFM map is light") \
    X(HDR_FACTOR, "a Radiance map with EXPOSURE=0 is infinite") \
    X(CODES_ROUNDED, "PNG and JPEG are half a code too dark") \
    X(SINE_REDUCTION, "the sine of a large angle loses its digits") \
    X(ATAN2_ORIGIN, "a ray straight up has no azimuth, and 0 / 0 is looked up in a table") \
    X(COSINE_RANGE, "the angle between equal directions is NaN where their cosine rounds up") \
    X(EXP_SUBNORMAL, "what passes an optical depth of 709 to 745 is minus infinity") \
    X(EXP_RANGE, "what passes an optical depth beyond 745 is any number")

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
