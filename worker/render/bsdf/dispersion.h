#ifndef AZULEJO_RENDER_DISPERSION_H
#define AZULEJO_RENDER_DISPERSION_H
float dispersion_ior(float n_d, float dispersion, float nm);
float wavelength_sample(float u, struct vec3 *rgb_weight);
#endif
