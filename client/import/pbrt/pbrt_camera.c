/* The camera, the film, and what else a pbrt file says about how to render it; things that
 * move. */
#include <math.h>
#include <string.h>

#include "client/import/pbrt/pbrt.h"
#include "common/math/elementary.h"
#include "common/scene/settings.h"

/* Of the shorter side; the vertical angle that comes of it is checked with the scene. */
#define FOV_MIN_DEG 0.001
#define FOV_MAX_DEG 179.9

/* ---- hints -------------------------------------------------------------------------------- */

status pbrt_option(struct pbrt *p, const struct pbrt_directive *d)
{
    /* These say how pbrt works, or are about its own tests. */
    static const char *const silent[] = {"rendercoordsys", "seed", "pixelstats", "wavefront",
                                         "msereferenceimage", "msereferenceout",
                                         "displacementedgescale", "disabletexturefiltering",
                                         "disablepixeljitter", "disablewavelengthjitter", NULL};

    pbrt_ignore(d->params, silent);
    pbrt_params_report(d->params, p->b, "Option");
    return STATUS_OK;
}

status pbrt_sampler(struct pbrt *p, const struct pbrt_directive *d)
{
    static const char *const how[] = {"randomization", "jitter", "seed", "dimensions",
                                      "scramble", NULL};
    long x, y;

    p->samples = pbrt_integer(d->params, "pixelsamples", -1);
    p->samples_at = d->at;
    x = pbrt_integer(d->params, "xsamples", 0);
    y = pbrt_integer(d->params, "ysamples", 0);
    if (x > 0 && y > 0 && x <= 1 << 12 && y <= 1 << 12)
        p->samples = x * y;
    pbrt_ignore(d->params, how);
    pbrt_params_report(d->params, p->b, "sampler");
    return STATUS_OK;
}

status pbrt_integrator(struct pbrt *p, const struct pbrt_directive *d)
{
    static const char *const how[] = {"lightsampler", "lightsamplestrategy", "rrthreshold",
                                      "visualizestrategies", "visualizeweights", "usemis", NULL};
    static const char *const paths[] = {"path", "volpath", "bdpt", "mlt", "simplepath",
                                        "simplevolpath", "lightpath", "randomwalk", "directlighting",
                                        "sppm", NULL};
    int known = 0;

    for (int i = 0; paths[i]; i++)
        known = known || strcmp(d->kind, paths[i]) == 0;
    if (!known)
        pbrt_warn(p, &d->at, "integrator",
                  "the integrator \"%.40s\" is not supported: paths are traced", d->kind);
    p->max_depth = pbrt_integer(d->params, "maxdepth", PBRT_MAX_DEPTH);
    if (strcmp(d->kind, "directlighting") == 0)
        p->max_depth = 1;
    p->depth_at = d->at;
    if (pbrt_bool(d->params, "regularize", 0))
        pbrt_warn(p, &d->at, "regularize",
                  "the integrator's \"regularize\" is not supported: caustics stay sharp and noisy");
    pbrt_ignore(d->params, how);
    if (known)
        pbrt_params_report(d->params, p->b, "integrator");
    return STATUS_OK;
}

/* ---- movement ----------------------------------------------------------------------------- */

/* The rotation next to m (its polar decomposition: Higham 1986, Newton's iteration); what is
 * left is symmetric. 0: m is singular. */
static int polar(const struct transform_d *m, struct transform_d *rotation, double stretch[3][3])
{
    struct transform_d r = *m, inverse;

    for (int i = 0; i < 3; i++)
        r.m[i][3] = 0;
    for (int step = 0; step < 100; step++) {
        double change = 0;
        if (!transform_d_invert(&r, &inverse))
            return 0;
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                double next = (r.m[i][j] + inverse.m[j][i]) / 2;
                change = fmax(change, fabs(next - r.m[i][j]));
                r.m[i][j] = next;
                if (!isfinite(next))
                    return 0;
            }
        /* The inverse above was of the matrix before: read it no more. */
        if (change < 1e-14)
            break;
    }
    if (transform_d_determinant(&r) < 0)
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                r.m[i][j] = -r.m[i][j];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            stretch[i][j] = 0;
            for (int k = 0; k < 3; k++)
                stretch[i][j] += r.m[k][i] * m->m[k][j];
        }
    *rotation = r;
    return 1;
}

/* Shepperd 1978: from the largest of the four, so that nothing cancels. */
static void quaternion(const struct transform_d *r, double q[4])
{
    const double (*m)[4] = r->m;
    double trace = m[0][0] + m[1][1] + m[2][2];
    int largest = 3;
    double best = trace;

    for (int i = 0; i < 3; i++)
        if (m[i][i] > best)
            best = m[i][i], largest = i;
    if (largest == 3) {
        q[0] = m[2][1] - m[1][2];
        q[1] = m[0][2] - m[2][0];
        q[2] = m[1][0] - m[0][1];
        q[3] = 1 + trace;
    } else {
        const int i = largest, j = (i + 1) % 3, k = (i + 2) % 3;
        q[i] = 1 + 2 * m[i][i] - trace;
        q[j] = m[i][j] + m[j][i];
        q[k] = m[i][k] + m[k][i];
        q[3] = m[k][j] - m[j][k];
    }
    {
        double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
        for (int i = 0; i < 4; i++)
            q[i] /= length;
    }
}

/* One key of a movement. */
struct pose_key {
    double translation[3], rotation[4], stretch[3][3];
};

/* world = mirror * ctm: the mirror goes through the rotation into the stretch, which may be
 * negative: M R S = (M R M) (M S). */
static int pose_key_of(const struct pbrt *p, const struct transform_d *ctm, struct pose_key *out)
{
    struct transform_d r;

    if (!polar(ctm, &r, out->stretch))
        return 0;
    for (int i = 0; i < 3; i++)
        out->translation[i] = ctm->m[i][3];
    if (p->mirrored) {
        out->translation[2] = -out->translation[2];
        for (int i = 0; i < 2; i++) {
            r.m[i][2] = -r.m[i][2];
            r.m[2][i] = -r.m[2][i];
        }
        for (int j = 0; j < 3; j++)
            out->stretch[2][j] = -out->stretch[2][j];
    }
    quaternion(&r, out->rotation);
    return 1;
}

static int stretch_is_diagonal(const double s[3][3])
{
    double largest = fmax(fabs(s[0][0]), fmax(fabs(s[1][1]), fabs(s[2][2]))), rest = 0;

    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            if (i != j)
                rest = fmax(rest, fabs(s[i][j]));
    return rest <= 1e-6 * largest;
}

static status add_channel(struct pbrt *p, uint32_t node, enum scene_channel_path path,
                          const double *first, const double *second, uint32_t components)
{
    float times[2] = {(float)p->time_start, (float)p->time_end}, values[8];
    const struct scene_channel channel = {.node = node,
                                          .path = path,
                                          .interpolation = INTERPOLATE_LINEAR,
                                          .key_count = 2,
                                          .components = components,
                                          .times = times,
                                          .values = values};

    if (memcmp(first, second, components * sizeof *first) == 0)
        return STATUS_OK;
    for (uint32_t i = 0; i < components; i++) {
        values[i] = (float)first[i];
        values[components + i] = (float)second[i];
    }
    return builder_add_channel(p->b, &channel);
}

/* A node at the first key's place, in double, and one below it for what the keys change: an
 * animation's own numbers are floats. */
static status add_key_nodes(struct pbrt *p, const struct pose_key key[2], int with_scale,
                            uint32_t *row)
{
    struct scene_node place, node;
    const double still[3] = {0, 0, 0};
    double moved[3];
    uint32_t parent;

    scene_node_default(&place);
    scene_node_default(&node);
    for (int i = 0; i < 3; i++) {
        place.translation[i] = key[0].translation[i];
        moved[i] = key[1].translation[i] - key[0].translation[i];
        node.scale[i] = with_scale ? key[0].stretch[i][i] : 1;
    }
    memcpy(node.rotation, key[0].rotation, sizeof node.rotation);
    TRY(builder_add_node(p->b, &place, &parent));
    node.parent = (int32_t)parent;
    TRY(builder_add_node(p->b, &node, row));
    TRY(add_channel(p, *row, PATH_TRANSLATION, still, moved, 3));
    return add_channel(p, *row, PATH_ROTATION, key[0].rotation, key[1].rotation, 4);
}

/* What does not change and is no scale along the axes stands in a node below. */
static status add_stretch(struct pbrt *p, uint32_t parent, const double s[3][3], uint32_t *row)
{
    struct scene_node node = {.parent = (int32_t)parent, .has_matrix = 1};

    node.rotation[3] = 1;
    for (int i = 0; i < 3; i++) {
        node.scale[i] = 1;
        for (int j = 0; j < 3; j++)
            node.matrix.m[i][j] = s[i][j];
    }
    return builder_add_node(p->b, &node, row);
}

static status add_moving_node(struct pbrt *p, struct pose_key key[2], const struct pbrt_place *at,
                              uint32_t *row)
{
    int diagonal = stretch_is_diagonal(key[0].stretch) && stretch_is_diagonal(key[1].stretch);
    double near_enough = 0, dot = 0, scale[2][3];

    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            near_enough = fmax(near_enough, fabs(key[0].stretch[i][j] - key[1].stretch[i][j]));
    if (near_enough < 1e-7) /* the same but for rounding */
        memcpy(key[1].stretch, key[0].stretch, sizeof key[0].stretch);
    else if (!diagonal)
        pbrt_warn(p, at, "animated shear",
                  "a shear that changes with time is not supported: only the scale changes");
    for (int i = 0; i < 4; i++)
        dot += key[0].rotation[i] * key[1].rotation[i];
    for (int i = 0; i < 4 && dot < 0; i++) /* the shorter way round */
        key[1].rotation[i] = -key[1].rotation[i];
    if (!diagonal && near_enough >= 1e-7)
        diagonal = 1;
    TRY(add_key_nodes(p, key, diagonal, row));
    if (!diagonal)
        return add_stretch(p, *row, key[0].stretch, row);
    for (int k = 0; k < 2; k++)
        for (int i = 0; i < 3; i++)
            scale[k][i] = key[k].stretch[i][i];
    return add_channel(p, *row, PATH_SCALE, scale[0], scale[1], 3);
}

status pbrt_node(struct pbrt *p, const struct pbrt_matrices *ctm, const struct pbrt_place *at,
                 int32_t *out)
{
    struct pose_key key[2];
    uint32_t row;

    *out = BUILDER_NO_ROW;
    if (!pbrt_is_moving(ctm))
        return STATUS_OK;
    if (p->last_node >= 0 && memcmp(&p->last_ctm, ctm, sizeof *ctm) == 0) {
        *out = (int32_t)p->last_node;
        return STATUS_OK;
    }
    for (int i = 0; i < 2; i++)
        if (!pose_key_of(p, &ctm->at[i], &key[i])) {
            pbrt_warn(p, at, "animated matrix",
                      "an animated matrix cannot be inverted: rendered without its motion");
            return STATUS_OK;
        }
    TRY(add_moving_node(p, key, at, &row));
    p->is_animated = 1;
    p->last_node = row;
    p->last_ctm = *ctm;
    *out = (int32_t)row;
    return STATUS_OK;
}

/* ---- the camera --------------------------------------------------------------------------- */

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
            pbrt_warn(p, &window->at, "screen window",
                      "a screen window that is not centred is not supported: centred");
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
        /* pbrt's picture starts at +x and turns towards +z: its middle is -x, right of that
         * is -z. */
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
        return pbrt_fail(p, STATUS_ERR_INPUT, &p->camera.at,
                         "the camera's fov is %g: it must be %g to %g degrees", fov, FOV_MIN_DEG,
                         FOV_MAX_DEG);
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

static status read_orthographic(struct pbrt *p, double film_aspect,
                                const struct transform_d *world, struct scene_camera *out)
{
    struct screen screen;

    TRY(read_screen(p, film_aspect, &screen));
    out->xmag = (float)(screen.x * axis_length(world, 0));
    out->ymag = (float)(screen.y * axis_length(world, 1));
    out->aspect = (float)(screen.aspect * axis_length(world, 0) / axis_length(world, 1));
    out->lens_radius = (float)(pbrt_float(p->camera.params, "lensradius", 0) *
                               axis_length(world, 0));
    out->focus_distance = (float)(pbrt_float(p->camera.params, "focaldistance", 1e6) *
                                  axis_length(world, 2));
    return STATUS_OK;
}

/* Orthonormal: pbrt allows any matrix, ours does not. */
static status rigid_camera(struct pbrt *p, const struct transform_d *world,
                           struct transform_d *out)
{
    double stretch[3][3];
    struct transform_d r;

    if (!polar(world, &r, stretch))
        return pbrt_fail(p, STATUS_ERR_INPUT, &p->camera.at,
                         "the camera's matrix cannot be inverted");
    if (!stretch_is_diagonal(stretch)) {
        double rest = 0, largest = 0;
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                *(i == j ? &largest : &rest) = fmax(i == j ? largest : rest, fabs(stretch[i][j]));
        if (rest > 1e-4 * largest)
            pbrt_warn(p, &p->camera.at, "sheared camera",
                      "the camera's matrix shears: a camera without shear is used");
    }
    for (int i = 0; i < 3; i++)
        r.m[i][3] = world->m[i][3];
    *out = r;
    return STATUS_OK;
}

static void film_hints(struct pbrt *p, struct scene_camera *camera, double *aspect)
{
    struct pbrt_params *params = p->film.params;
    static const char *const elsewhere[] = {"filename", "savefp16", "diagonal",
                                            "coordinatesystem", NULL};
    long width = 1280, height = 720;
    double iso, exposure, ratio, most;
    const char *sensor;

    *aspect = 1280.0 / 720.0;
    if (!params)
        return;
    width = pbrt_integer(params, "xresolution", width);
    height = pbrt_integer(params, "yresolution", height);
    if (width >= 1 && height >= 1 && width <= SETTINGS_SIZE_MAX && height <= SETTINGS_SIZE_MAX) {
        *aspect = (double)width / (double)height;
        p->b->out->hints.width = (uint32_t)width;
        p->b->out->hints.height = (uint32_t)height;
    } else {
        pbrt_warn(p, &p->film.at, "resolution",
                  "a film of %ld x %ld pixels is not supported, 1 to %d are: it is not taken over",
                  width, height, SETTINGS_SIZE_MAX);
    }
    sensor = pbrt_string(params, "sensor", "cie1931");
    if (strcmp(sensor, "cie1931") != 0)
        pbrt_warn(p, &p->film.at, "sensor",
                  "the film's sensor \"%.40s\" is not supported: an ideal one is used", sensor);
    iso = pbrt_float(params, "iso", 100);
    exposure = pbrt_float(params, "exposuretime", 1);
    ratio = iso * exposure / 100; /* pbrt's imaging ratio: 1 unless asked for */
    if (ratio > 1e-12 && ratio < 1e12 && ratio != 1)
        camera->exposure_ev = det_log((float)ratio) * 1.44269504f;
    if (pbrt_float(params, "whitebalance", 0) != 0)
        pbrt_warn(p, &p->film.at, "whitebalance",
                  "the film's \"whitebalance\" is not supported: see --white-balance for the tone "
                  "mapped picture");
    most = pbrt_float(params, "maxcomponentvalue", INFINITY);
    if (most < (double)SCENE_RADIANCE_MAX)
        pbrt_warn(p, &p->film.at, "maxcomponentvalue",
                  "the film's \"maxcomponentvalue\" of %g is not supported: no sample is clamped",
                  most);
    if (strcmp(p->film.kind, "rgb") != 0 && strcmp(p->film.kind, "image") != 0)
        pbrt_warn(p, &p->film.at, "film", "the film \"%.40s\" is taken as \"rgb\"", p->film.kind);
    pbrt_ignore(params, elsewhere);
    if (pbrt_param(params, "cropwindow", ~0u) || pbrt_param(params, "pixelbounds", ~0u))
        pbrt_warn(p, &p->film.at, "crop window",
                  "the film's crop window is not supported: the whole picture is rendered");
    pbrt_params_report(params, p->b, "film");
}

/* Without an Integrator pbrt goes PBRT_MAX_DEPTH deep, as with one that names no depth. */
static void depth_and_samples(struct pbrt *p)
{
    struct import_hints *hints = &p->b->out->hints;
    long depth = p->max_depth >= 0 ? p->max_depth : PBRT_MAX_DEPTH;

    if (p->samples > SETTINGS_SPP_MAX)
        pbrt_warn(p, &p->samples_at, "pixelsamples",
                  "%ld samples a pixel are more than %d: so many are taken", p->samples,
                  SETTINGS_SPP_MAX);
    if (p->samples > 0)
        hints->spp = (uint32_t)(p->samples < SETTINGS_SPP_MAX ? p->samples : SETTINGS_SPP_MAX);
    if (depth > SETTINGS_DEPTH_MAX)
        pbrt_warn(p, &p->depth_at, "maxdepth", "a depth of %ld is more than %d: so deep is gone",
                  depth, SETTINGS_DEPTH_MAX);
    hints->has_max_depth = 1;
    hints->max_depth = (uint32_t)(depth < SETTINGS_DEPTH_MAX ? depth : SETTINGS_DEPTH_MAX);
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

static status read_kind(struct pbrt *p, double aspect, const struct transform_d *world,
                        struct scene_camera *out)
{
    const char *mapping;

    switch (out->kind) {
    case CAMERA_PERSPECTIVE:
        return read_perspective(p, aspect, world, out);
    case CAMERA_ORTHOGRAPHIC:
        return read_orthographic(p, aspect, world, out);
    default:
        mapping = pbrt_string(p->camera.params, "mapping",
                              strcmp(p->camera.kind, "spherical") == 0 ? "equalarea"
                                                                       : "equirectangular");
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
static status moving_camera(struct pbrt *p, const struct pbrt_matrices *rigid,
                            struct scene_camera *camera)
{
    struct pose_key key[2];
    uint32_t row;
    double dot = 0;

    for (int i = 0; i < 2; i++) {
        for (int c = 0; c < 3; c++)
            key[i].translation[c] = rigid->at[i].m[c][3];
        quaternion(&rigid->at[i], key[i].rotation);
    }
    for (int i = 0; i < 4; i++)
        dot += key[0].rotation[i] * key[1].rotation[i];
    for (int i = 0; i < 4 && dot < 0; i++)
        key[1].rotation[i] = -key[1].rotation[i];
    TRY(add_key_nodes(p, key, 0, &row));
    camera->node = (int32_t)row;
    p->is_animated = 1;
    return STATUS_OK;
}

/* Where the camera stands, and whether the file's world is left-handed. */
static status place_camera(struct pbrt *p, struct scene_camera *camera,
                           struct transform_d *world_from_camera)
{
    const struct transform_d axes = camera_axes(camera->kind);
    struct pbrt_matrices rigid;

    for (int i = 0; i < 2; i++) {
        struct transform_d world;
        if (!transform_d_invert(&p->camera.ctm.at[i], &world))
            return pbrt_fail(p, STATUS_ERR_INPUT, &p->camera.at,
                             "the camera's matrix cannot be inverted");
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
    film_hints(p, &camera, &aspect);
    depth_and_samples(p);
    if (!p->camera.kind) /* the builder frames one; pbrt's would stand at the origin */
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
    if (fabs(p->shutter_open) < 1e6 && fabs(p->shutter_close) < 1e6 &&
        p->shutter_open < p->shutter_close) {
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
