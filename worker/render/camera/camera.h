/* camera: from a position on the film to a ray in world space.
 *
 * The pixel filter is importance-sampled (one of settings.h, by default a Blackman-Harris window of 3 pixels), so every
 * sample belongs to exactly one pixel with weight 1 and tiles share nothing. The position on the lens
 * (uniform over the aperture) and the time within the shutter interval are sampled likewise.
 *
 * A moving camera has transforms at `motion_steps` moments, evenly spaced from the shutter's
 * opening to its closing. Between them the matrices are interpolated and made orthonormal again.
 * camera.c is what runs for every sample, camera_init.c the rest.
 */
#pragma once

#include "common/scene/scene.h"
#include "common/scene/settings.h"
#include "worker/render/accel/accel.h"
#include "worker/render/base/sampler.h"

enum { FILTER_TABLE_SIZE = 256, CAMERA_STEPS_MAX = 17 };

/* How the camera moves while the shutter is open. All 0: it does not move, and the rays' time is 0. */
struct camera_motion {
    int shutter_open;                 /* the exposure is longer than 0: rays get a time */
    uint32_t steps;                   /* 0: no motion; else 2..CAMERA_STEPS_MAX */
    const struct transform *to_world; /* [steps], orthonormal */
};

struct camera {
    enum scene_camera_kind kind;
    struct transform to_world;    /* at the shutter's opening */
    real half_width, half_height; /* of the image plane: at distance 1, or in metres */
    real width, height;           /* pixels */
    int pinhole;                  /* perspective, no lens, instantaneous shutter */
    int shutter_open;
    uint32_t motion_steps; /* 0: no motion */
    struct transform motion[CAMERA_STEPS_MAX];
    real lens_radius;              /* metres, 0: pinhole */
    real focus_distance;           /* metres along the axis */
    uint32_t blades;               /* corners of the aperture, on the circle of lens_radius; 0: round */
    real blade_rotation_rad;       /* of the first corner, counter-clockwise from +X */
    real blade_cosine, blade_sine; /* of the angle from one corner to the next */
    /* Left half of the filter: entry i is where its accumulated weight reaches (i / size)^4; pixels
     * from the pixel's centre, -1.5..0 by default. */
    real filter_offset[FILTER_TABLE_SIZE + 1];
};

/* The camera sets the vertical extent; the horizontal one follows from the picture's aspect ratio (as in glTF viewers).
 * A panorama fills the picture whatever its aspect ratio, and has no lens. The settings' lens and focus override the
 * camera's own, and what the settings switch off is left out. `motion` may be NULL: nothing moves. */
void camera_init(struct camera *camera, const struct scene_camera *description, const struct render_settings *settings,
                 const struct camera_motion *motion);

/* The ray through pixel (x, y); row 0 is the top. */
void camera_ray(const struct camera *camera, uint32_t x, uint32_t y, const struct sampler *sampler, struct ray *ray);

/* The beam that a texture lookup averages over: at distance t of a camera ray it is width + t * spread wide, half a
 * pixel. (Many samples share a pixel, so half a pixel blurs nothing that the pixel filter would keep.) */
struct camera_cone {
    real width;  /* metres at the ray's origin */
    real spread; /* metres per metre */
};
struct camera_cone camera_cone(const struct camera *camera);

/* From camera space to world space at `time`, 0..1 of the shutter; camera_ray uses it. */
struct transform camera_to_world_at(const struct camera *camera, real time);

/* Where a world point is seen at `time` through the middle of the lens: pixels, x right and y down
 * from the picture's upper left corner. 0: behind the camera, or exactly at it. */
int camera_project(const struct camera *camera, struct vec3 p, real time, real pixel[2]);

/* How many pixels something moves on the picture, from `opening`, its position at the shutter's
 * opening, to `closing`, its position at the closing; across a panorama's seam the short way.
 * 0, and no motion, when camera_project fails for either. */
int camera_motion_vector(const struct camera *camera, struct vec3 opening, struct vec3 closing, real motion[2]);

/* The segment of `steps` >= 2 evenly spaced moments that contains `time`, and the fraction within
 * it: value(time) = value[segment] + *fraction * (value[segment + 1] - value[segment]). The same
 * arithmetic as Embree's, so that both mean the same moment. */
static inline uint32_t motion_segment(real time, uint32_t steps, real *fraction)
{
    real scaled = time * (real)(steps - 1);
    uint32_t segment = scaled > 0 ? (uint32_t)scaled : 0;

    if (segment > steps - 2)
        segment = steps - 2;
    *fraction = scaled - (real)segment;
    return segment;
}
