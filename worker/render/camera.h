/* camera: from a place on the film to a ray into the world.
 *
 * The pixel filter is importance-sampled (a Blackman-Harris window of 3 pixels), so every
 * sample belongs to exactly one pixel with weight 1 and tiles share nothing.
 */
#ifndef AZULEJO_RENDER_CAMERA_H
#define AZULEJO_RENDER_CAMERA_H

#include "common/scene/scene.h"
#include "worker/render/accel.h"
#include "worker/render/sampler.h"

enum { FILTER_TABLE_SIZE = 256 };

struct camera {
    enum scene_camera_kind kind;
    struct transform to_world;
    float half_width, half_height; /* of the image plane: at distance 1, or in metres */
    float width, height;           /* pixels */
    /* Left half of the filter: where its accumulated weight reaches (i / size)^4; pixels from
     * the pixel's centre, -1.5..0. */
    float filter_offset[FILTER_TABLE_SIZE + 1];
};

/* The vertical extent is the camera's own; the horizontal one follows from the picture's
 * aspect ratio (as in glTF viewers). */
void camera_init(struct camera *camera, const struct scene_camera *description, uint32_t width,
                 uint32_t height);

/* The ray through pixel (x, y); row 0 is the top. */
void camera_ray(const struct camera *camera, uint32_t x, uint32_t y, const struct sampler *sampler,
                struct ray *ray);

#endif
