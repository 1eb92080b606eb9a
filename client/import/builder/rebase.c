/* The scene's own origin: positions are moved to it in double, and remaining losses of float are reported. */
#include <math.h>

#include "client/import/builder/builder.h"
#include "common/base/safeguard.h"
#include "common/scene/move.h"
#include "common/scene/sight.h"

/* Rounding by more than this share of an object's size is visible. */
static const double rough_share = 1e-4;
/* Pixels of a picture of this height, and how many of them may be wrong in silence. */
enum { USUAL_HEIGHT = 1080, CAMERAS_REPORTED = 8 };
#define BLUR_PIXELS 2.0

struct box_d {
    double low[3], high[3];
};

static void box_add(struct box_d *box, const struct box_d *more)
{
    for (int c = 0; c < 3; c++) {
        box->low[c] = fmin(box->low[c], more->low[c]);
        box->high[c] = fmax(box->high[c], more->high[c]);
    }
}

/* The box of all instances, or of those that neither move nor deform; 0: there is none. */
static int bounds_of(const struct scene *scene, int only_still, struct box_d *out)
{
    int found = 0;

    *out = (struct box_d){{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct scene_instance *instance = &scene->instances[i];
        struct box_d box;
        if (only_still && (instance->node >= 0 || instance->skin >= 0))
            continue;
        if (!scene_instance_bounds(scene, i, box.low, box.high))
            continue;
        box_add(out, &box);
        found = 1;
    }
    return found;
}

/* The spacing of floats at the box's largest coordinate. */
static double spacing_of(const double low[3], const double high[3])
{
    double most = 0;
    int exponent;

    for (int c = 0; c < 3; c++)
        most = fmax(most, fmax(fabs(low[c]), fabs(high[c])));
    (void)frexp(most, &exponent);
    return most > 0 ? ldexp(1, exponent - 24) : 0;
}

static double size_of(const double low[3], const double high[3])
{
    double size = 0;

    for (int c = 0; c < 3; c++)
        size = fmax(size, high[c] - low[c]);
    return size;
}

/* Name meshes so far from their own origin that their file's floats are visibly rounded. */
static void report_losses(struct builder *b)
{
    struct scene *scene = &b->out->scene;

    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct scene_instance *instance = &scene->instances[i];
        const struct scene_mesh *mesh = &scene->meshes[instance->mesh];
        struct box_d own;
        double spacing, size;
        for (int c = 0; c < 3; c++) {
            own.low[c] = (double)mesh->bounds_min[c];
            own.high[c] = (double)mesh->bounds_max[c];
        }
        spacing = spacing_of(own.low, own.high);
        size = size_of(own.low, own.high);
        if (spacing > rough_share * size)
            builder_warn(b, "digits of a mesh",
                         "\"%.80s\": the file gives its positions in steps of %.2g at a size of %.2g, "
                         "because they are far from the mesh's own origin: move the mesh to its origin and "
                         "its node to the place, and export again",
                         instance->name, spacing, size);
    }
}

/* What the renderer's origin for the view leaves wrong by more than a pixel or two. */
static status report_view(struct builder *b, const struct scene_pose *pose, uint32_t camera)
{
    const struct scene *scene = &b->out->scene;
    double origin[3], detail_m, distance_m, aspect = (double)scene->cameras[camera].aspect;
    struct scene_sight *sight;

    TRY(scene_sight_new(&sight, scene, pose, camera, aspect > 0 ? aspect : 16.0 / 9, builder_reader(b), b->err));
    (void)scene_sight_origin(sight, origin);
    if (scene_sight_blur(sight, origin, USUAL_HEIGHT, &detail_m, &distance_m) > BLUR_PIXELS)
        builder_warn(b, "near and far",
                     "camera \"%.80s\" sees things near by and others %.2g m away, too large for floats to hold "
                     "both: there, shadows of details below %.2g m may be wrong; render what is far by a job of "
                     "its own, without what is near",
                     scene->cameras[camera].name, distance_m, detail_m);
    scene_sight_free(sight);
    return STATUS_OK;
}

status scene_report_views(struct builder *b)
{
    const struct scene *scene = &b->out->scene;
    struct scene_pose pose;
    status s = scene_pose_init(&pose, scene, 0, b->err);

    for (uint32_t i = 0; i < scene->camera_count && i < CAMERAS_REPORTED && s == STATUS_OK; i++)
        s = report_view(b, &pose, i);
    scene_pose_release(&pose);
    return s;
}

void scene_rebase(struct builder *b)
{
    struct scene *scene = &b->out->scene;
    struct box_d box;
    double middle[3];

    if (!SAFEGUARD(REBASE) || (!bounds_of(scene, 1, &box) && !bounds_of(scene, 0, &box)))
        return;
    for (int c = 0; c < 3; c++) {
        middle[c] = box.low[c] / 2 + box.high[c] / 2;
        middle[c] = isfinite(middle[c]) ? middle[c] + 0.0 : 0;
        box.low[c] -= middle[c];
        box.high[c] -= middle[c];
    }
    b->out->position_spacing_m = spacing_of(box.low, box.high);
    scene_move(scene, middle);
    report_losses(b);
}
