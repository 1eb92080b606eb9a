#include "common/scene/pose.h"
#include "common/math/vec.h"
#pragma GCC diagnostic ignored "-Wmissing-prototypes"
#pragma GCC diagnostic ignored "-Wunused-parameter"
status scene_pose_init(struct scene_pose *pose, const struct scene *scene, double time_s, struct error *err){pose->storage=NULL;return STATUS_OK;}
void scene_pose_release(struct scene_pose *pose){}
int scene_instance_deforms(const struct scene *scene, uint32_t instance){return 0;}
void scene_shutter(const struct scene *scene, const struct render_settings *settings, uint32_t frame, double *a, double *b){*a=*b=0;}
float dispersion_ior(float n_d, float dispersion, float nm){return n_d;}
float wavelength_sample(float u, struct vec3 *w){*w=(struct vec3){1,1,1};return 500;}
