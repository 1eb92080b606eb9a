/* The scene's own origin: positions are moved to it in double, and remaining losses of float are
 * reported. */
#include <math.h>

#include "client/import/builder/builder.h"
#include "common/base/safeguard.h"

/* Rounding by more than this share of an object's size is visible. */
static const double rough_share = 1e-4;

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

static void move(struct transform_d *to_world, const double origin[3])
{
    for (int r = 0; r < 3; r++)
        to_world->m[r][3] -= origin[r];
}

static void move_all(struct scene *scene)
{
    const double *origin = scene->origin;

    for (uint32_t i = 0; i < scene->instance_count; i++)
        move(&scene->instances[i].to_world, origin);
    for (uint32_t i = 0; i < scene->camera_count; i++)
        move(&scene->cameras[i].to_world, origin);
    for (uint32_t i = 0; i < scene->medium_count; i++)
        if (scene->media[i].has_grid)
            move(&scene->media[i].grid_to_world, origin);
    for (uint32_t i = 0; i < scene->light_count; i++) {
        struct scene_light *light = &scene->lights[i];
        unsigned parts = scene_light_parts(light->kind);
        if (parts & LIGHT_HAS_FRAME)
            move(&light->to_world, origin);
        for (int c = 0; c < 3 && parts & LIGHT_HAS_PLACE; c++)
            light->position[c] -= origin[c];
    }
    for (uint32_t i = 0; i < scene->environment.portal_count; i++)
        for (int c = 0; c < 3; c++)
            scene->environment.portals[i].corner[c] -= origin[c];
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

/* Name objects so far from the origin, in the world or in their own mesh, that float rounds them
 * visibly. */
static void report_losses(struct builder *b)
{
    struct scene *scene = &b->out->scene;

    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct scene_instance *instance = &scene->instances[i];
        const struct scene_mesh *mesh = &scene->meshes[instance->mesh];
        struct box_d box, own;
        double spacing, size;
        for (int c = 0; c < 3; c++) {
            own.low[c] = (double)mesh->bounds_min[c];
            own.high[c] = (double)mesh->bounds_max[c];
        }
        spacing = spacing_of(own.low, own.high);
        size = size_of(own.low, own.high);
        if (spacing > rough_share * size) {
            builder_warn(
                b, "digits of a mesh",
                "\"%.80s\": the file gives its positions in steps of %.2g at a size of %.2g, "
                "because they are far from the mesh's own origin: move the mesh to its origin and "
                "its node to the place, and export again",
                instance->name, spacing, size);
            continue;
        }
        if (instance->node >= 0 || instance->skin >= 0 ||
            !scene_instance_bounds(scene, i, box.low, box.high))
            continue;
        spacing = spacing_of(box.low, box.high);
        size = size_of(box.low, box.high);
        if (spacing > rough_share * size)
            builder_warn(b, "digits of the world",
                         "\"%.80s\" is %.2g m in size and far from the scene's centre: its "
                         "positions are kept in steps of %.2g m; leave out what makes the scene so "
                         "large, or render it separately",
                         instance->name, size, spacing);
    }
}

void scene_rebase(struct builder *b)
{
    struct scene *scene = &b->out->scene;
    struct box_d box;

    if (!SAFEGUARD(REBASE) || (!bounds_of(scene, 1, &box) && !bounds_of(scene, 0, &box)))
        return;
    for (int c = 0; c < 3; c++) {
        double middle = box.low[c] / 2 + box.high[c] / 2;
        scene->origin[c] = isfinite(middle) ? middle + 0.0 : 0;
        box.low[c] -= scene->origin[c];
        box.high[c] -= scene->origin[c];
    }
    b->out->position_spacing_m = spacing_of(box.low, box.high);
    move_all(scene);
    report_losses(b);
}
