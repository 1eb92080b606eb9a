#include "client/import/builder/studio.h"

#include <math.h>
#include <string.h>

#include "client/import/builder/shapes.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"

enum { MAP_WIDTH = 256, MAP_HEIGHT = 128 };

static const float ground_albedo = 0.5f;
/* The ground's half side over the camera's distance: its rim lies above the picture. */
static const double ground_share = 30;
/* How far it lies below the model, so that no face of the model lies in it. */
static const double gap_share = 2e-4;

/* A soft box: its middle and half sizes in degrees, from the front (+Z) to the right and from the horizon upwards. */
struct soft_box {
    double azimuth, elevation, half_width, half_height, radiance;
};
static const struct soft_box soft_boxes[] = {
    {-35, 45, 30, 22, 14}, /* the key, at the camera's left */
    {100, 25, 26, 34, 2},  /* at its right */
};
static const double ceiling_radiance = 1.2, ceiling_from = 50, room_radiance = 0.4, edge = 9;

/* 0 for x <= 0, 1 for x >= 1, smooth between. */
static double smooth(double x)
{
    x = x < 0 ? 0 : x > 1 ? 1 : x;
    return x * x * (3 - 2 * x);
}

static double in_box(const struct soft_box *box, double azimuth, double elevation)
{
    double across = azimuth - box->azimuth;

    across -= 360 * floor((across + 180) / 360);
    return smooth((box->half_width - fabs(across)) / edge) *
           smooth((box->half_height - fabs(elevation - box->elevation)) / edge);
}

static double radiance_at(double azimuth, double elevation)
{
    double sum = room_radiance + ceiling_radiance * smooth((elevation - ceiling_from) / (90 - ceiling_from));

    for (size_t i = 0; i < sizeof soft_boxes / sizeof *soft_boxes; i++)
        sum += soft_boxes[i].radiance * in_box(&soft_boxes[i], azimuth, elevation);
    return sum;
}

/* A grey as Radiance's RGBE. */
static void put_rgbe(double value, uint8_t out[4])
{
    int exponent;
    double share = frexp(value, &exponent);

    out[0] = out[1] = out[2] = (uint8_t)(share * 256);
    out[3] = (uint8_t)(exponent + 128);
}

status studio_light(struct builder *b)
{
    static const char header[] = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 128 +X 256\n";
    size_t head = sizeof header - 1, bytes = head + (size_t)4 * MAP_WIDTH * MAP_HEIGHT;
    uint8_t *map = must(mem_alloc(bytes));

    memcpy(map, header, head);
    for (int y = 0; y < MAP_HEIGHT; y++)
        for (int x = 0; x < MAP_WIDTH; x++) {
            double u = (x + 0.5) / MAP_WIDTH, elevation = 90 - 180 * (y + 0.5) / MAP_HEIGHT;
            put_rgbe(radiance_at(90 - 360 * (u - 0.5), elevation), map + head + 4 * (size_t)(y * MAP_WIDTH + x));
        }
    scene_environment_default(&b->environment);
    TRY(builder_set_environment_map(b, "studio", map, bytes));
    b->out->scene.environment = b->environment;
    return STATUS_OK;
}

/* One row more in a table that was handed over. */
#define APPEND(scene, type, table, count, row)                                                 \
    do {                                                                                       \
        type *longer_ = must(ARENA_ARRAY(&(scene)->arena, type, (scene)->count + 1));          \
        if ((scene)->count)                                                                    \
            memcpy(longer_, (scene)->table, (scene)->count * sizeof(type));                    \
        longer_[(scene)->count++] = (row);                                                     \
        (scene)->table = longer_;                                                              \
    } while (0)

status studio_ground(struct builder *b, const double center[3], double low_y_m, double distance_m)
{
    static const float corners_m[4][3] = {{-1, 0, 1}, {1, 0, 1}, {-1, 0, -1}, {1, 0, -1}};
    static const uint32_t corners[4] = {0, 1, 2, 3};
    const struct shape_patches square = {
        .positions = corners_m[0], .vertex_count = 4, .corners = corners, .patch_count = 1, .divisions = 1};
    const struct mesh_tangents no_tangents = {0};
    struct scene *scene = &b->out->scene;
    double half_m = ground_share * distance_m;
    struct scene_material matte;
    struct scene_instance ground;
    struct mesh_source plane;
    int64_t mesh;

    TRY(shape_bilinear(&square, &plane, b->err));
    TRY(mesh_finish(b, &plane, "studio ground", &no_tangents, &mesh));
    if (mesh < 0)
        return error_set(b->err, STATUS_ERR_INTERNAL, "the studio's ground has no triangle");
    scene_material_default(&matte);
    matte.name = builder_name(b, "studio ground");
    matte.metallic = 0;
    for (int c = 0; c < 3; c++)
        matte.base_color[c] = ground_albedo;
    scene_instance_default(&ground);
    ground.name = matte.name;
    ground.mesh = scene->mesh_count;
    ground.material = scene->material_count;
    for (int c = 0; c < 3; c++) {
        ground.to_world.m[c][c] = half_m;
        ground.to_world.m[c][3] = c == 1 ? low_y_m - gap_share * distance_m : center[c];
    }
    APPEND(scene, struct scene_mesh, meshes, mesh_count, b->meshes[mesh]);
    APPEND(scene, struct scene_material, materials, material_count, matte);
    APPEND(scene, struct scene_instance, instances, instance_count, ground);
    return STATUS_OK;
}
