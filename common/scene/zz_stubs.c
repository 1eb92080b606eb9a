#include "common/scene/scene.h"
#include "common/math/vec.h"
#pragma GCC diagnostic ignored "-Wmissing-prototypes"
#pragma GCC diagnostic ignored "-Wunused-parameter"
float dispersion_ior(float n_d, float dispersion, float nm){return n_d;}
float wavelength_sample(float u, struct vec3 *w){*w=(struct vec3){1,1,1};return 500;}
