#include "common/scene/sight.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/base/safeguard.h"
#include "common/math/elementary.h"

/* Cells along each side of the coarse picture; a panorama is six of them. */
enum { SIDE = 32, VIEWS_MAX = 6, CELLS = SIDE * SIDE };
/* Triangles that are looked at, divided among the instances in view. */
enum { TRIANGLES_MAX = 1 << 18 };
/* The import's origin stays if its spread is at most so many times the best one's. */
#define SPREAD_KEPT 4.0
/* Rays may start this share of the largest coordinate inside their face: 128 of the errors in docs/NUMERICS.md. */
#define DETAIL_SHARE (128 * 8 * 0x1p-24)

struct cell {
    double depth;    /* metres from the camera, INFINITY: nothing is seen */
    double place[3]; /* camera's space */
};

/* A part of the picture: the camera looks along -Z. */
struct view {
    struct transform_d to_camera;
    double half_width, half_height; /* at distance 1; parallel: metres */
    double cells_wide, cells_high;  /* SIDE / 2 over these */
    int parallel;
    struct cell cells[CELLS];
};

struct scene_sight {
    uint32_t view_count;
    struct view *views;
    size_t count;                  /* of the cells in which something is seen: */
    double (*places)[3], *weights; /* metres in the scene's coordinates; 1 / the precision needed */
    double eye[3];
};

static void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* fmin and fmax would be calls. */
static inline double smaller(double a, double b) { return a < b ? a : b; }

static inline double larger(double a, double b) { return a > b ? a : b; }

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void subtract(const double a[3], const double b[3], double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = a[k] - b[k];
}

static double largest(const double a[3]) { return larger(larger(fabs(a[0]), fabs(a[1])), fabs(a[2])); }

/* ---- the coarse picture ----------------------------------------------------------------------- */

static double cell_centre(int index, double half) { return ((index + 0.5) * 2 / SIDE - 1) * half; }

static void see(struct cell *cell, const double place[3], double depth)
{
    if (!(depth < cell->depth))
        return;
    cell->depth = depth;
    memcpy(cell->place, place, sizeof cell->place);
}

/* The ray through the cell's centre against a triangle (Moeller and Trumbore 1997). */
static void cast(struct view *view, int x, int y, const double corner[3][3])
{
    const double px = cell_centre(x, view->half_width), py = cell_centre(y, view->half_height);
    const double origin[3] = {view->parallel ? px : 0, view->parallel ? py : 0, 0};
    const double d[3] = {view->parallel ? 0 : px, view->parallel ? 0 : py, -1};
    double e1[3], e2[3], s[3], p[3], q[3], place[3], determinant, u, v, t;

    subtract(corner[1], corner[0], e1);
    subtract(corner[2], corner[0], e2);
    subtract(origin, corner[0], s);
    cross(d, e2, p);
    cross(s, e1, q);
    determinant = dot(e1, p);
    u = dot(s, p) / determinant;
    v = dot(d, q) / determinant;
    t = dot(e2, q) / determinant;
    if (!(u >= 0 && v >= 0 && u + v <= 1 && t > 0 && t < INFINITY))
        return;
    for (int k = 0; k < 3; k++)
        place[k] = origin[k] + t * d[k];
    see(&view->cells[y * SIDE + x], place, t * sqrt(dot(d, d)));
}

/* A point's position on the picture, in cells. */
static inline void project(const struct view *view, const double p[3], double at[2])
{
    const double w = view->parallel ? 1 : -1 / p[2];

    at[0] = p[0] * w * view->cells_wide + SIDE / 2;
    at[1] = p[1] * w * view->cells_high + SIDE / 2;
}

static int clamp_cell(double at) { return at > 0 ? at < SIDE ? (int)at : SIDE : 0; }

/* The range of cells whose centres a triangle may cover, [low, high). All of them if it reaches behind the
 * camera; 0: none of it is in view. */
static inline int covered(const struct view *view, const double corner[3][3], int low[2], int high[2])
{
    double least[2] = {INFINITY, INFINITY}, most[2] = {-INFINITY, -INFINITY};
    int behind = 0;

    for (int k = 0; k < 3; k++) {
        double at[2];
        if (!(corner[k][2] < 0)) {
            behind++;
            continue;
        }
        project(view, corner[k], at);
        for (int a = 0; a < 2; a++) {
            least[a] = smaller(at[a], least[a]);
            most[a] = larger(at[a], most[a]);
        }
    }
    if (behind == 3)
        return 0;
    for (int a = 0; a < 2; a++) {
        low[a] = behind ? 0 : clamp_cell(least[a] - 0.5);
        high[a] = behind ? SIDE : clamp_cell(most[a] + 0.5);
        if (!behind && (most[a] < 0 || least[a] > SIDE))
            return 0;
    }
    return 1;
}

/* What is smaller than a cell counts where its middle is: a small thing must not be overlooked. */
static void see_middle(struct view *view, const double corner[3][3])
{
    double middle[3], at[2];

    for (int k = 0; k < 3; k++)
        middle[k] = (corner[0][k] + corner[1][k] + corner[2][k]) / 3;
    if (!(middle[2] < 0))
        return;
    project(view, middle, at);
    if (at[0] >= 0 && at[0] < SIDE && at[1] >= 0 && at[1] < SIDE)
        see(&view->cells[(int)at[1] * SIDE + (int)at[0]], middle,
            view->parallel ? -middle[2] : sqrt(dot(middle, middle)));
}

static void draw_triangle(struct view *view, const double corner[3][3])
{
    int low[2], high[2];

    if (!covered(view, corner, low, high))
        return;
    see_middle(view, corner);
    for (int y = low[1]; y < high[1]; y++)
        for (int x = low[0]; x < high[0]; x++)
            cast(view, x, y, corner);
}

/* ---- meshes ----------------------------------------------------------------------------------- */

struct artist {
    struct scene_sight *sight;
    const struct scene *scene;
    const struct scene_pose *pose;
    struct scene_blob_reader blobs;
    uint32_t triangles_each;
    struct error *err;
};

/* Can any of the box be in view? */
static int box_in_view(const struct view *view, const struct scene_mesh *mesh, const struct transform_d *to_camera)
{
    int sides = 31; /* bits: the corners are all behind, left, right, below, above */

    for (unsigned k = 0; k < 8; k++) {
        const double p[3] = {(double)(k & 1 ? mesh->bounds_max : mesh->bounds_min)[0],
                             (double)(k & 2 ? mesh->bounds_max : mesh->bounds_min)[1],
                             (double)(k & 4 ? mesh->bounds_max : mesh->bounds_min)[2]};
        double c[3], x, y;
        transform_d_point(to_camera, p, c);
        x = view->half_width * (view->parallel ? 1 : -c[2]);
        y = view->half_height * (view->parallel ? 1 : -c[2]);
        sides &= (c[2] >= 0) | (c[0] < -x) << 1 | (c[0] > x) << 2 | (c[1] < -y) << 3 | (c[1] > y) << 4;
    }
    return sides == 0;
}

static void draw_mesh(struct view *view, const struct scene_mesh *mesh, const float *positions, const uint32_t *indices,
                      const struct transform_d *to_camera, uint32_t stride)
{
    for (uint32_t i = 0; i < mesh->triangle_count; i += stride) {
        double corner[3][3];
        for (int k = 0; k < 3; k++) {
            uint32_t vertex = indices[3 * (size_t)i + (size_t)k];
            const float *p = positions + 3 * (size_t)vertex;
            if (vertex >= mesh->vertex_count)
                return;                 /* a damaged blob: refused when the mesh is loaded */
            for (int r = 0; r < 3; r++) /* transform_d_point would be a call */
                corner[k][r] = to_camera->m[r][0] * (double)p[0] + to_camera->m[r][1] * (double)p[1] +
                               to_camera->m[r][2] * (double)p[2] + to_camera->m[r][3];
        }
        draw_triangle(view, corner);
    }
}

/* The vertices of what is morphed or skinned, for the caller to free. */
static status deformed(const struct artist *a, uint32_t index, const uint8_t *blob, float **out)
{
    const struct scene_mesh *mesh = &a->scene->meshes[a->scene->instances[index].mesh];

    *out = mem_alloc_array(mesh->vertex_count, 3 * sizeof **out);
    NEED(*out, a->err, "the picture of distances");
    return pose_deform(a->pose, a->scene, index, blob, *out, NULL, NULL, a->err);
}

static status draw_instance(const struct artist *a, uint32_t index)
{
    const struct scene_mesh *mesh = &a->scene->meshes[a->scene->instances[index].mesh];
    const struct transform_d to_world = pose_instance(a->pose, a->scene, index);
    const int deforms = scene_instance_deforms(a->scene, index);
    const uint8_t *blob = NULL;
    float *bent = NULL;
    status s = STATUS_OK;

    for (uint32_t v = 0; v < a->sight->view_count && s == STATUS_OK; v++) {
        struct view *view = &a->sight->views[v];
        const struct transform_d to_camera = transform_d_multiply(&view->to_camera, &to_world);
        struct scene_mesh_layout layout;
        size_t size_bytes;
        if (!deforms && !box_in_view(view, mesh, &to_camera))
            continue;
        scene_mesh_layout(mesh, &layout);
        if (!blob)
            s = a->blobs.get(a->blobs.user, &mesh->blob.digest, &blob, &size_bytes, a->err);
        if (s == STATUS_OK && deforms && !bent)
            s = deformed(a, index, blob, &bent);
        if (s == STATUS_OK)
            draw_mesh(view, mesh, bent ? bent : (const float *)(const void *)(blob + layout.positions),
                      (const uint32_t *)(const void *)(blob + layout.indices), &to_camera,
                      mesh->triangle_count / a->triangles_each + 1);
    }
    mem_free(bent);
    return s;
}

/* ---- the views -------------------------------------------------------------------------------- */

static void begin_view(struct view *view, const struct transform_d *camera, const double axes[3][3])
{
    for (int r = 0; r < 3; r++) {
        double at = 0;
        for (int c = 0; c < 3; c++) {
            double turned = 0;
            for (int k = 0; k < 3; k++)
                turned += camera->m[c][k] * axes[r][k];
            view->to_camera.m[r][c] = turned;
            at -= turned * camera->m[c][3];
        }
        view->to_camera.m[r][3] = at;
    }
    for (int i = 0; i < CELLS; i++)
        view->cells[i].depth = INFINITY;
}

/* The axes of the views, in the camera's space: ahead, back, right, left, up, down. */
static const double axes_of[VIEWS_MAX][3][3] = {
    {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}},  {{-1, 0, 0}, {0, 1, 0}, {0, 0, -1}},
    {{0, 0, 1}, {0, 1, 0}, {-1, 0, 0}}, {{0, 0, -1}, {0, 1, 0}, {1, 0, 0}},
    {{1, 0, 0}, {0, 0, 1}, {0, -1, 0}}, {{1, 0, 0}, {0, 0, -1}, {0, 1, 0}}};

static status begin_views(struct scene_sight *sight, const struct scene_camera *camera, double aspect,
                          struct error *err)
{
    sight->view_count = camera->kind == CAMERA_PANORAMA ? VIEWS_MAX : 1;
    sight->views = mem_calloc(sight->view_count, sizeof *sight->views);
    sight->places = mem_calloc(sight->view_count * (size_t)CELLS, sizeof *sight->places);
    sight->weights = mem_calloc(sight->view_count * (size_t)CELLS, sizeof *sight->weights);
    NEED(sight->views && sight->places && sight->weights, err, "the picture of distances");
    for (uint32_t v = 0; v < sight->view_count; v++) {
        struct view *view = &sight->views[v];
        begin_view(view, &camera->to_world, axes_of[v]);
        view->parallel = camera->kind == CAMERA_ORTHOGRAPHIC;
        view->half_height = camera->kind == CAMERA_PERSPECTIVE    ? (double)real_tan(camera->yfov_rad * REAL(0.5))
                            : camera->kind == CAMERA_ORTHOGRAPHIC ? (double)camera->ymag
                                                                  : 1;
        view->half_width = camera->kind == CAMERA_PANORAMA ? 1 : view->half_height * aspect;
        view->cells_wide = SIDE / 2 / view->half_width;
        view->cells_high = SIDE / 2 / view->half_height;
    }
    for (int r = 0; r < 3; r++)
        sight->eye[r] = camera->to_world.m[r][3];
    return STATUS_OK;
}

/* Keep what is seen, in the scene's coordinates. */
static void gather(struct scene_sight *sight)
{
    for (uint32_t v = 0; v < sight->view_count; v++) {
        const struct view *view = &sight->views[v];
        for (int i = 0; i < CELLS; i++) {
            const struct cell *cell = &view->cells[i];
            double needed = view->parallel ? view->half_height : cell->depth;
            if (!(cell->depth < INFINITY) || !(needed > 0))
                continue;
            for (int c = 0; c < 3; c++) {
                double along = 0;
                for (int k = 0; k < 3; k++)
                    along += view->to_camera.m[k][c] * cell->place[k];
                sight->places[sight->count][c] = sight->eye[c] + along;
            }
            sight->weights[sight->count++] = 1 / needed;
        }
    }
}

status scene_sight_new(struct scene_sight **out, const struct scene *scene, const struct scene_pose *pose,
                       uint32_t camera_index, double aspect, struct scene_blob_reader blobs, struct error *err)
{
    struct scene_sight *sight = mem_calloc(1, sizeof *sight);
    struct scene_camera camera;
    struct artist artist = {sight, scene, pose, blobs, 1, err};
    status s;

    *out = NULL;
    NEED(sight, err, "the picture of distances");
    pose_camera(pose, scene, camera_index, &camera);
    s = begin_views(sight, &camera, aspect, err);
    artist.triangles_each = 1 + TRIANGLES_MAX / (scene->instance_count + 1);
    for (uint32_t i = 0; i < scene->instance_count && s == STATUS_OK; i++)
        s = draw_instance(&artist, i);
    if (s != STATUS_OK) {
        scene_sight_free(sight);
        return s;
    }
    gather(sight);
    *out = sight;
    return STATUS_OK;
}

void scene_sight_free(struct scene_sight *sight)
{
    if (!sight)
        return;
    mem_free(sight->views);
    mem_free(sight->places);
    mem_free(sight->weights);
    mem_free(sight);
}

/* ---- the origin ------------------------------------------------------------------------------- */

struct weighted {
    double value, weight;
};

static int by_value(const void *a, const void *b)
{
    double x = ((const struct weighted *)a)->value, y = ((const struct weighted *)b)->value;

    return (x > y) - (x < y);
}

/* The weighted median of a coordinate: it minimises the weighted sum of the distances along the axis. */
static double median_of(const struct scene_sight *sight, int axis)
{
    struct weighted sorted[VIEWS_MAX * CELLS];
    double total = 0, sum = 0;
    size_t i = 0;

    for (size_t k = 0; k < sight->count; k++) {
        sorted[k] = (struct weighted){sight->places[k][axis], sight->weights[k]};
        total += sight->weights[k];
    }
    qsort(sorted, sight->count, sizeof *sorted, by_value);
    while (i + 1 < sight->count && (sum += sorted[i].weight) < total / 2)
        i++;
    return sorted[i].value;
}

/* The mean, over what is seen, of its largest coordinate over its distance from the camera (of a parallel view:
 * over half the picture's height). */
static double spread_of(const struct scene_sight *sight, const double origin[3])
{
    double sum = 0;

    for (size_t i = 0; i < sight->count; i++) {
        double from[3];
        subtract(sight->places[i], origin, from);
        sum += largest(from) * sight->weights[i];
    }
    return sum / (double)sight->count;
}

/* The harmonic mean of the distances from the camera. */
static double distance_of(const struct scene_sight *sight)
{
    double total = 0;

    for (size_t i = 0; i < sight->count; i++)
        total += sight->weights[i];
    return (double)sight->count / total;
}

/* Take few digits: most coordinates are then as exact as they were, and views that differ little have the same
 * origin. */
static void round_off(double extent, double origin[3])
{
    int exponent;

    if (!(extent > 0) || !(extent < INFINITY))
        return;
    (void)frexp(extent, &exponent);
    for (int c = 0; c < 3; c++)
        origin[c] = ldexp(floor(ldexp(origin[c], 2 - exponent) + 0.5), exponent - 2);
}

double scene_sight_origin(const struct scene_sight *sight, double origin[3])
{
    static const double imported[3] = {0, 0, 0};
    double distance;

    memset(origin, 0, 3 * sizeof *origin);
    if (sight->count == 0 || !SAFEGUARD(VIEW_ORIGIN))
        return 0;
    for (int c = 0; c < 3; c++)
        origin[c] = median_of(sight, c);
    distance = distance_of(sight);
    round_off(distance * spread_of(sight, origin), origin);
    if (spread_of(sight, imported) > SPREAD_KEPT * spread_of(sight, origin))
        return distance;
    memset(origin, 0, 3 * sizeof *origin);
    return 0;
}

double scene_sight_blur(const struct scene_sight *sight, const double origin[3], uint32_t height, double *detail_m,
                        double *distance_m)
{
    double worst = 0;

    *detail_m = *distance_m = 0;
    for (size_t i = 0; i < sight->count; i++) {
        double from[3], away[3], detail, pixels;
        subtract(sight->places[i], origin, from);
        subtract(sight->places[i], sight->eye, away);
        detail = DETAIL_SHARE * largest(from);
        pixels = detail * sight->weights[i] * height / (2 * sight->views[0].half_height);
        if (sight->views[0].parallel)
            pixels *= sight->views[0].half_height;
        if (!(pixels > worst))
            continue;
        worst = pixels;
        *detail_m = detail;
        *distance_m = sqrt(dot(away, away));
    }
    return worst;
}
