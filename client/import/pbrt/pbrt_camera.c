/* The camera. */
#include <math.h>
#include <string.h>

#include "client/import/pbrt/read/pbrt_motion.h"
#include "common/math/elementary.h"

/* Of the shorter side; the resulting vertical angle is checked with the scene. */
#define FOV_MIN_DEG 0.001
#define FOV_MAX_DEG 179.9
/* Half the picture's width and height on the screen, and its aspect as the file has it. */
struct screen {
    double x, y, aspect;
};

static status read_screen(struct pbrt *p, double film_aspect, struct screen *out)
{
    struct pbrt_params *params = p->camera.params;
    double frame = pbrt_float(params, "frameaspectratio", film_aspect);
    const struct pbrt_param *window = pbrt_param(params, "screenwindow", PBRT_NUMBERS);

    if (!(frame > 1e-4 && frame < 1e4))
        return pbrt_fail(p, STATUS_ERR_INPUT, &p->camera.at, "the picture's aspect is %g", frame);
    out->x = frame > 1 ? frame : 1;
    out->y = frame > 1 ? 1 : 1 / frame;
    if (window && window->number_count == 4) {
        const double *w = window->numbers; /* x min, x max, y min, y max */
        if (!(w[1] > w[0]) || !(w[3] > w[2]))
            return pbrt_fail(p, STATUS_ERR_INPUT, &window->at, "the screen window is empty");
        out->x = (w[1] - w[0]) / 2;
        out->y = (w[3] - w[2]) / 2;
        if (fabs(w[0] + w[1]) > 1e-4 * out->x || fabs(w[2] + w[3]) > 1e-4 * out->y)
            pbrt_warn(p, &window->at, "screen window", "a screen window that is not centred is not supported: centred");
    }
    out->aspect = out->x / out->y;
    return STATUS_OK;
}

static double axis_length(const struct transform_d *m, int column)
{
    return sqrt(m->m[0][column] * m->m[0][column] + m->m[1][column] * m->m[1][column] +
                m->m[2][column] * m->m[2][column]);
}

/* Our camera's axes in pbrt's camera space, as columns. */
static struct transform_d camera_axes(enum scene_camera_kind kind)
{
    struct transform_d m = transform_d_identity();

    m.m[2][2] = -1; /* pbrt's looks along +z, with x to the right as ours */
    if (kind == CAMERA_PANORAMA) {
        /* pbrt's picture starts at +x and turns towards +z: its middle is -x, right of that is -z. */
        m.m[0][0] = m.m[2][2] = 0;
        m.m[2][0] = -1; /* right */
        m.m[0][2] = 1;  /* back */
    }
    return m;
}

static status read_perspective(struct pbrt *p, double film_aspect, const struct transform_d *world,
                               struct scene_camera *out)
{
    struct pbrt_params *params = p->camera.params;
    double fov = pbrt_float(params, "fov", 90), tangent, lx, ly, lz;
    const struct pbrt_param *half = pbrt_param(params, "halffov", PBRT_NUMBERS);
    struct screen screen;

    if (half)
        fov = 2 * half->numbers[0];
    if (!(fov >= FOV_MIN_DEG && fov <= FOV_MAX_DEG))
        return pbrt_fail(p, STATUS_ERR_INPUT, &p->camera.at, "the camera's fov is %g: it must be %g to %g degrees", fov,
                         FOV_MIN_DEG, FOV_MAX_DEG);
    TRY(read_screen(p, film_aspect, &screen));
    lx = axis_length(world, 0);
    ly = axis_length(world, 1);
    lz = axis_length(world, 2);
    /* fov is that of a screen from -1 to 1: of the shorter side. */
    tangent = (double)det_tan((float)(fov * PI_D / 360)) * screen.y * ly / lz;
    out->yfov_rad = 2 * det_atan2((float)tangent, 1);
    out->aspect = (float)(screen.aspect * lx / ly);
    out->lens_radius = (float)(pbrt_float(params, "lensradius", 0) * lx);
    out->focus_distance = (float)(pbrt_float(params, "focaldistance", 1e6) * lz);
    return STATUS_OK;
}

static status read_orthographic(struct pbrt *p, double film_aspect, const struct transform_d *world,
                                struct scene_camera *out)
{
    struct screen screen;

    TRY(read_screen(p, film_aspect, &screen));
    out->xmag = (float)(screen.x * axis_length(world, 0));
    out->ymag = (float)(screen.y * axis_length(world, 1));
    out->aspect = (float)(screen.aspect * axis_length(world, 0) / axis_length(world, 1));
    out->lens_radius = (float)(pbrt_float(p->camera.params, "lensradius", 0) * axis_length(world, 0));
    out->focus_distance = (float)(pbrt_float(p->camera.params, "focaldistance", 1e6) * axis_length(world, 2));
    return STATUS_OK;
}

/* Make the matrix orthonormal: pbrt allows any matrix for a camera, our scene does not. */
static status rigid_camera(struct pbrt *p, const struct transform_d *world, struct transform_d *out)
{
    double stretch[3][3];
    struct transform_d r;

    if (!pbrt_polar(world, &r, stretch))
        return pbrt_fail(p, STATUS_ERR_INPUT, &p->camera.at, "the camera's matrix cannot be inverted");
    if (!pbrt_stretch_is_diagonal(stretch)) {
        double rest = 0, largest = 0;
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                *(i == j ? &largest : &rest) = fmax(i == j ? largest : rest, fabs(stretch[i][j]));
        if (rest > 1e-4 * largest)
            pbrt_warn(p, &p->camera.at, "sheared camera", "the camera's matrix shears: a camera without shear is used");
    }
    for (int i = 0; i < 3; i++)
        r.m[i][3] = world->m[i][3];
    *out = r;
    return STATUS_OK;
}

static int camera_kind(const struct pbrt *p, enum scene_camera_kind *kind)
{
    static const char *const words[CAMERA_KIND_COUNT] = {"perspective", "orthographic",
                                                         "spherical"};

    for (int i = 0; i < CAMERA_KIND_COUNT; i++)
        if (strcmp(p->camera.kind, words[i]) == 0) {
            *kind = (enum scene_camera_kind)i;
            return 1;
        }
    *kind = CAMERA_PANORAMA;
    return strcmp(p->camera.kind, "environment") == 0; /* pbrt-v3 */
}

static status read_kind(struct pbrt *p, double aspect, const struct transform_d *world, struct scene_camera *out)
{
    const char *mapping;

    switch (out->kind) {
    case CAMERA_PERSPECTIVE: return read_perspective(p, aspect, world, out);
    case CAMERA_ORTHOGRAPHIC: return read_orthographic(p, aspect, world, out);
    default:
        mapping = pbrt_string(p->camera.params, "mapping",
                              strcmp(p->camera.kind, "spherical") == 0 ? "equalarea" : "equirectangular");
        if (strcmp(mapping, "equirectangular") != 0)
            pbrt_warn(p, &p->camera.at, "spherical camera",
                      "a spherical camera is rendered in latitude and longitude "
                      "(\"equirectangular\"), not in the mapping \"%.40s\"",
                      mapping);
        out->aspect = (float)aspect;
        return STATUS_OK;
    }
}

/* Two keys of translation and rotation for the camera itself. */
static status moving_camera(struct pbrt *p, const struct pbrt_matrices *rigid, struct scene_camera *camera)
{
    struct pbrt_pose_key key[2];
    uint32_t row;

    for (int i = 0; i < 2; i++) {
        for (int c = 0; c < 3; c++)
            key[i].translation[c] = rigid->at[i].m[c][3];
        pbrt_quaternion(&rigid->at[i], key[i].rotation);
    }
    TRY(pbrt_add_key_nodes(p, key, 0, &row));
    camera->node = (int32_t)row;
    p->is_animated = 1;
    return STATUS_OK;
}

/* The camera's place, and whether the file's world is left-handed. */
static status place_camera(struct pbrt *p, struct scene_camera *camera, struct transform_d *world_from_camera)
{
    const struct transform_d axes = camera_axes(camera->kind);
    struct pbrt_matrices rigid;

    for (int i = 0; i < 2; i++) {
        struct transform_d world;
        if (!transform_d_invert(&p->camera.ctm.at[i], &world))
            return pbrt_fail(p, STATUS_ERR_INPUT, &p->camera.at, "the camera's matrix cannot be inverted");
        if (i == 0) {
            *world_from_camera = world;
            p->mirrored = transform_d_determinant(&world) * transform_d_determinant(&axes) < 0;
        }
        world = transform_d_multiply(&world, &axes);
        world = pbrt_to_world(p, &world);
        TRY(rigid_camera(p, &world, &rigid.at[i]));
    }
    camera->to_world = rigid.at[0];
    return pbrt_is_moving(&rigid) ? moving_camera(p, &rigid, camera) : STATUS_OK;
}

status pbrt_camera(struct pbrt *p)
{
    struct scene_camera camera;
    struct transform_d world = transform_d_identity();
    double aspect;

    scene_camera_default(&camera);
    pbrt_film_hints(p, &camera, &aspect);
    pbrt_integrator_hints(p);
    if (!p->camera.kind) /* the builder adds one; pbrt's would be at the origin */
        return STATUS_OK;
    if (!camera_kind(p, &camera.kind))
        return pbrt_fail(p, STATUS_ERR_UNSUPPORTED, &p->camera.at,
                         "the camera \"%.40s\" is not supported: replace it by \"perspective\" "
                         "(with \"lensradius\" and \"focaldistance\" for a lens)",
                         p->camera.kind);
    camera.name = builder_name(p->b, p->camera.kind);
    TRY(place_camera(p, &camera, &world));
    TRY(read_kind(p, aspect, &world, &camera));
    p->shutter_open = pbrt_float(p->camera.params, "shutteropen", 0);
    p->shutter_close = pbrt_float(p->camera.params, "shutterclose", 1);
    if (fabs(p->shutter_open) < 1e6 && fabs(p->shutter_close) < 1e6 && p->shutter_open < p->shutter_close) {
        camera.shutter_open_s = (float)p->shutter_open;
        camera.shutter_close_s = (float)p->shutter_close;
    }
    if (!(camera.lens_radius >= 0) || !(camera.focus_distance > 0)) {
        camera.lens_radius = 0;
        camera.focus_distance = 1;
    }
    pbrt_params_report(p->camera.params, p->b, "camera");
    TRY(builder_add_camera(p->b, &camera));
    return pbrt_medium_row(p, p->camera_medium, &p->camera.at, &p->b->fog);
}
