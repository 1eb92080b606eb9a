/* bsdf_checks: what holds for every BSDF, asked of one material. A check fails the test, and says for which material. */
#pragma once

#include "tests/support/bsdf_maker.h"

struct vec3 direction(float cosine, float azimuth);
struct vec3 random_direction(struct test_random *r, float z_min);
/* A zero, something huge, tiny or no number; a direction's cosine may be as small as a float can be. */
float hostile_float(struct test_random *r);
struct vec3 hostile_color(struct test_random *r);

int is_near(float a, float b, float relative);
int is_near_vec(struct vec3 a, struct vec3 b, float relative);
void describe_and_fail(const struct bsdf_params *p, struct vec3 wo, struct vec3 wi, const char *what);

/* At a random place eval, pdf, eval_pdf and sample agree. 1: a sample with a density was compared. */
int check_agreement(const struct bsdf_params *p, struct test_random *r);

enum { WAY_REFLECTED, WAY_THROUGH, WAY_REFRACTED, WAY_NONE };
/* f(wo, wi) = f(wi, wo); across a refracting interface f / n^2 is what is symmetric. The frame turns over when light is
 * followed from the other side. `sampled`: at a place that bsdf_sample chose, since refraction's range is narrow. Which
 * way was compared, WAY_NONE if none was. */
int check_reciprocity(const struct bsdf_params *p, struct test_random *r, int sampled, float reflection_error,
                      float refraction_error);
/* Whatever the parameters, all is finite and positive, and no weight is above weight_max. 1: there was a sample. */
int check_harmless(const struct bsdf_params *p, struct test_random *r, float weight_max);

/* Where the light goes, in green. */
struct shares {
    double reflected, transmitted;
    struct vec3 towards; /* mean direction of what is sent out */
};
struct shares shares_of(const struct bsdf_params *p, struct vec3 wo);
/* At cosines from 0.1 on, `step` apart. */
void assert_same_look(const struct bsdf_params *p, const struct bsdf_params *q, float step, double tolerance,
                      const char *what);

/* A BSDF from one side, for chi-square tests: what goes the other way counts as "none". */
struct bsdf_subject {
    struct bsdf bsdf;
    struct vec3 wo;
    float side; /* +1: reflection, -1: transmission */
};
int bsdf_subject_sample(void *subject, const float u[3], struct vec3 *wi);
double bsdf_subject_pdf(void *subject, struct vec3 wi);

/* Power sent out, largest of the colour components. */
struct running_stats bsdf_albedo(const struct bsdf_params *p, struct vec3 wo, int samples, uint64_t seed);
/* For a test that rejects beyond `least` or `most` by z standard errors, z at least 3.8. Sampling stops after a sixteenth,
 * an eighth or a quarter of the samples, if that is at least 500, where both limits are 2.5, 2 or 1 standard errors away.
 * Power: a material that all samples would reject with a chance of one half is beyond the limit by z of their standard
 * errors, so by z / 4, z / 2.83 or z / 2 of the part's, and is missed with a chance below 0.003. */
struct running_stats bsdf_albedo_within(const struct bsdf_params *p, struct vec3 wo, int samples, uint64_t seed,
                                        double least, double most);
