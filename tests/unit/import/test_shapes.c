/* Shapes as meshes: areas and volumes near the true ones, closed where the truth is, front faces
 * outside, subdivision with the properties of its limit surface. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "client/import/builder/shapes.h"
#include "common/base/memory.h"
#include "common/math/vec.h"
#include "tests/support/starve.h"

#define PI 3.14159265358979323846

static struct vec3 vec_at(const float *array, size_t i)
{
    return vec3_make(array[3 * i], array[3 * i + 1], array[3 * i + 2]);
}

struct measure {
    double area, volume; /* volume: of the cones from the origin, signed */
    float agreement;     /* least cosine between a vertex normal and a triangle around it */
};

/* Measure a mesh whose indices and numbers must be sound and whose triangles have area. */
static struct measure measure(const struct mesh_source *mesh)
{
    struct measure m = {.agreement = 1};

    for (size_t v = 0; v < mesh->vertex_count; v++) {
        assert_float_equal(vec3_length(vec_at(mesh->normals, v)), 1, 1e-5);
        assert_true(vec3_is_finite(vec_at(mesh->positions, v)));
    }
    for (size_t t = 0; t < mesh->triangle_count; t++) {
        const uint32_t *i = mesh->indices + 3 * t;
        struct vec3 a, b, c, n;
        for (int k = 0; k < 3; k++)
            assert_true(i[k] < mesh->vertex_count);
        a = vec_at(mesh->positions, i[0]);
        b = vec_at(mesh->positions, i[1]);
        c = vec_at(mesh->positions, i[2]);
        n = vec3_cross(vec3_sub(b, a), vec3_sub(c, a));
        assert_true(vec3_length(n) > 0);
        m.area += 0.5 * (double)vec3_length(n);
        m.volume += (double)vec3_dot(a, vec3_cross(b, c)) / 6;
        for (int k = 0; k < 3; k++)
            m.agreement = float_min(m.agreement, vec3_dot(vec3_normalize(n), vec_at(mesh->normals, i[k])));
    }
    return m;
}

static void full_sphere(void **state)
{
    struct mesh_source mesh;
    struct error err = {0};
    struct measure m;

    (void)state;
    assert_int_equal(shape_sphere(2, -2, 2, 2 * PI, 128, &mesh, &err), STATUS_OK);
    m = measure(&mesh);
    assert_true(mesh_is_closed(&mesh));
    assert_true(m.area < 16 * PI && m.area > 16 * PI * 0.998);
    assert_true(m.volume < 32 * PI / 3 && m.volume > 32 * PI / 3 * 0.997);
    assert_true(m.agreement > 0.99f);
    for (size_t v = 0; v < mesh.vertex_count; v++) {
        assert_float_equal(vec3_length(vec_at(mesh.positions, v)), 2, 1e-6);
        assert_true(mesh.uv[0][2 * v] >= 0 && mesh.uv[0][2 * v] <= 1);
    }
    mesh_source_reverse(&mesh);
    m = measure(&mesh);
    assert_true(m.volume < 0 && m.agreement > 0.99f);
    mesh_source_release(&mesh);
    /* A full turn in degrees that came through float is closed, too, and the cut at its ends. */
    assert_int_equal(shape_sphere(1, -3, 3, (double)(360 * 0.0174532925f), 12, &mesh, &err), STATUS_OK);
    assert_true(mesh_is_closed(&mesh));
    mesh_source_release(&mesh);
}

static void part_of_a_sphere(void **state)
{
    struct mesh_source mesh;
    struct error err = {0};
    struct measure m;

    (void)state;
    assert_int_equal(shape_sphere(1, -0.5, 0.25, PI / 2, 256, &mesh, &err), STATUS_OK);
    m = measure(&mesh);
    assert_false(mesh_is_closed(&mesh));
    /* Archimedes: the area is that of the cylinder around it. */
    assert_float_equal(m.area, PI / 2 * 0.75, 1e-3);
    for (size_t v = 0; v < mesh.vertex_count; v++) {
        struct vec3 p = vec_at(mesh.positions, v);
        assert_true(p.x >= -1e-6f && p.y >= -1e-6f && p.z >= -0.5f - 1e-6f && p.z <= 0.25f + 1e-6f);
    }
    /* u runs with phi, v with z. */
    assert_float_equal(mesh.positions[2], -0.5, 1e-6);
    assert_float_equal(mesh.positions[1], 0, 1e-6);
    assert_float_equal(mesh.uv[0][0] + mesh.uv[0][1], 0, 0);
    assert_float_equal(mesh.positions[3 * mesh.vertex_count - 1], 0.25, 1e-6);
    assert_float_equal(mesh.uv[0][2 * mesh.vertex_count - 1], 1, 0);
    mesh_source_release(&mesh);
}

static void cylinder_and_disk(void **state)
{
    struct mesh_source mesh;
    struct error err = {0};
    struct measure m;

    (void)state;
    assert_int_equal(shape_cylinder(0.5, 3, 1, 2 * PI, 128, &mesh, &err), STATUS_OK);
    m = measure(&mesh);
    assert_float_equal(m.area, 2 * PI, 2 * PI * 1e-3);
    assert_true(m.agreement > 0.99f && m.volume > 0);
    mesh_source_release(&mesh);
    assert_int_equal(shape_disk(1, 2, 0, 2 * PI, 128, &mesh, &err), STATUS_OK);
    m = measure(&mesh);
    assert_int_equal(mesh.triangle_count, 128);
    assert_float_equal(m.area, 4 * PI, 4 * PI * 1e-3);
    assert_float_equal(m.agreement, 1, 1e-6);
    assert_float_equal(mesh.normals[2], 1, 0);
    mesh_source_release(&mesh);
    assert_int_equal(shape_disk(-1, 2, 1, PI, 128, &mesh, &err), STATUS_OK);
    m = measure(&mesh);
    assert_float_equal(m.area, 1.5 * PI, 1.5 * PI * 1e-3);
    assert_float_equal(m.agreement, 1, 1e-6);
    mesh_source_release(&mesh);
}

/* pbrt-v3's cone, paraboloid and hyperboloid. Areas and volumes by hand; a closed part is measured with its disk. */
static void surfaces_of_turned_lines(void **state)
{
    const double rim[3] = {2, 0, 0}, top[3] = {0, 0, 1.5}, low[3] = {1, -1, -1}, high[3] = {1, 1, 1};
    struct mesh_source mesh;
    struct error err = {0};
    struct measure m;

    (void)state;
    assert_int_equal(shape_turned_line(rim, top, 2 * PI, 128, &mesh, &err), STATUS_OK);
    m = measure(&mesh);
    assert_int_equal(mesh.triangle_count, 128);
    assert_float_equal(m.area, 5 * PI, 5 * PI * 1e-3);   /* pi r sqrt(r^2 + h^2) */
    assert_float_equal(m.volume, 2 * PI, 2 * PI * 1e-3); /* its base is at z = 0 */
    assert_true(m.agreement > 0.8f);
    assert_float_equal(mesh.normals[0], 0.6, 1e-6);
    assert_float_equal(mesh.normals[2], 0.8, 1e-6);
    mesh_source_release(&mesh);
    assert_int_equal(shape_turned_line(rim, top, PI / 2, 128, &mesh, &err), STATUS_OK);
    assert_float_equal(measure(&mesh).area, 5 * PI / 4, 5 * PI / 4 * 1e-3);
    mesh_source_release(&mesh);
    /* (pi / 6) (r / h^2) ((r^2 + 4 h^2)^1.5 - r^3), r = h = 1 */
    assert_int_equal(shape_paraboloid(1, 0, 1, 2 * PI, 128, &mesh, &err), STATUS_OK);
    m = measure(&mesh);
    assert_float_equal(m.area, PI / 6 * (5 * sqrt(5) - 1), 5e-3);
    assert_true(m.agreement > 0.99f);
    for (size_t v = 0; v < mesh.vertex_count; v++) {
        struct vec3 p = vec_at(mesh.positions, v), n = vec_at(mesh.normals, v);
        assert_float_equal(p.z, p.x * p.x + p.y * p.y, 1e-6);
        assert_true(n.z < 0 && fabsf(n.x * p.y - n.y * p.x) < 1e-6f && n.x * p.x + n.y * p.y >= 0);
        assert_float_equal(mesh.uv[0][2 * v + 1], p.z, 1e-6);
    }
    mesh_source_release(&mesh);
    assert_int_equal(shape_paraboloid(1, 0.25, 1, 2 * PI, 128, &mesh, &err), STATUS_OK);
    assert_float_equal(mesh.positions[2], 0.25, 1e-6);
    mesh_source_release(&mesh);
    /* x^2 + y^2 = 1 + z^2 */
    assert_int_equal(shape_turned_line(low, high, 2 * PI, 128, &mesh, &err), STATUS_OK);
    m = measure(&mesh);
    assert_true(m.agreement > 0.99f);
    for (size_t v = 0; v < mesh.vertex_count; v++) {
        struct vec3 p = vec_at(mesh.positions, v), n = vec_at(mesh.normals, v);
        assert_float_equal(p.x * p.x + p.y * p.y, 1 + p.z * p.z, 1e-5);
        assert_float_equal(vec3_dot(n, vec3_normalize(vec3_make(p.x, p.y, -p.z))), 1, 1e-5);
    }
    assert_float_equal(m.area, 2 * PI * (sqrt(3) + asinh(sqrt(2)) / sqrt(2)), 0.02);
    mesh_source_release(&mesh);
    /* A line across the axis is two cones. */
    assert_int_equal(shape_turned_line((const double[]){-1, 0, -1}, (const double[]){1, 0, 1}, 2 * PI, 128, &mesh, &err), STATUS_OK);
    m = measure(&mesh);
    assert_float_equal(m.area, 2 * PI * sqrt(2), 0.01);
    for (size_t v = 0; v < 3 * mesh.vertex_count; v++)
        assert_true(isfinite(mesh.normals[v]));
    mesh_source_release(&mesh);
    assert_int_equal(shape_turned_line(rim, rim, 6, 64, &mesh, &err), STATUS_ERR_INPUT);
    assert_int_equal(shape_turned_line(top, (const double[]){0, 0, 0}, 6, 64, &mesh, &err), STATUS_ERR_INPUT);
    assert_int_equal(shape_turned_line(rim, (const double[]){0, 0, INFINITY}, 6, 64, &mesh, &err), STATUS_ERR_INPUT);
    assert_int_equal(shape_paraboloid(1, -1, 1, 6, 64, &mesh, &err), STATUS_ERR_INPUT);
    assert_int_equal(shape_paraboloid(1, 1, 1, 6, 64, &mesh, &err), STATUS_ERR_INPUT);
}

static void nonsense_is_refused(void **state)
{
    static const float positions[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, NAN, 1, 0};
    static const uint32_t corners[4] = {0, 1, 2, 3}, beyond[4] = {0, 1, 2, 4};
    struct shape_patches patches = {.positions = positions,
                                    .vertex_count = 4,
                                    .corners = corners,
                                    .patch_count = 1,
                                    .divisions = 1};
    struct shape_control control = {
        .positions = positions, .vertex_count = 3, .indices = beyond, .triangle_count = 1};
    struct shape_curve curve = {
        .basis = CURVE_BEZIER, .degree = 3, .points = positions, .point_count = 3};
    struct mesh_source mesh;
    struct error err = {0};

    (void)state;
    assert_int_equal(shape_sphere(0, -1, 1, 6, 64, &mesh, &err), STATUS_ERR_INPUT);
    assert_int_equal(shape_sphere(NAN, -1, 1, 6, 64, &mesh, &err), STATUS_ERR_INPUT);
    assert_int_equal(shape_sphere(1, 2, 3, 6, 64, &mesh, &err), STATUS_ERR_INPUT);
    assert_int_equal(shape_sphere(1, NAN, 1, 6, 64, &mesh, &err), STATUS_ERR_INPUT);
    assert_int_equal(shape_sphere(1, -1, 1, 0, 64, &mesh, &err), STATUS_ERR_INPUT);
    assert_int_equal(shape_sphere(1, -1, 1, 6, 1u << 30, &mesh, &err), STATUS_ERR_LIMIT);
    assert_int_equal(shape_cylinder(1, 1, 1, 6, 64, &mesh, &err), STATUS_ERR_INPUT);
    assert_int_equal(shape_disk(0, 1, 1, 6, 64, &mesh, &err), STATUS_ERR_INPUT);
    assert_int_equal(shape_disk(INFINITY, 1, 0, 6, 64, &mesh, &err), STATUS_ERR_INPUT);
    assert_int_equal(shape_bilinear(&patches, &mesh, &err), STATUS_ERR_INPUT);
    patches.vertex_count = 3;
    assert_int_equal(shape_bilinear(&patches, &mesh, &err), STATUS_ERR_INPUT);
    patches.divisions = 0;
    assert_int_equal(shape_bilinear(&patches, &mesh, &err), STATUS_ERR_LIMIT);
    assert_int_equal(shape_loop(&control, 1, &mesh, &err), STATUS_OK);
    mesh_source_release(&mesh);
    control.indices = beyond + 1; /* 1 2 4 */
    assert_int_equal(shape_loop(&control, 1, &mesh, &err), STATUS_ERR_INPUT);
    assert_int_equal(shape_loop(&control, SHAPE_LOOP_LEVELS_MAX + 1, &mesh, &err), STATUS_ERR_LIMIT);
    assert_int_equal(shape_curves(&curve, 1, 4, 8, &mesh, &err), STATUS_ERR_INPUT);
    curve.degree = 2;
    curve.kind = CURVE_RIBBON;
    assert_int_equal(shape_curves(&curve, 1, 4, 8, &mesh, &err), STATUS_ERR_INPUT);
    curve.kind = CURVE_CYLINDER;
    curve.width_start = -1;
    assert_int_equal(shape_curves(&curve, 1, 4, 8, &mesh, &err), STATUS_ERR_INPUT);
    assert_null(mesh.positions);
}

/* ---- patches -------------------------------------------------------------------------------- */

static void parallelograms_are_two_triangles(void **state)
{
    static const float positions[] = {0, 0, 0, 2, 0, 0, 1, 3, 0, 3, 3, 0};
    static const uint32_t corners[] = {0, 1, 2, 3};
    struct shape_patches patches = {.positions = positions,
                                    .vertex_count = 4,
                                    .corners = corners,
                                    .patch_count = 1,
                                    .divisions = 16};
    struct mesh_source mesh;
    struct error err = {0};
    struct measure m;

    (void)state;
    assert_int_equal(shape_bilinear(&patches, &mesh, &err), STATUS_OK);
    m = measure(&mesh);
    assert_int_equal(mesh.triangle_count, 2);
    assert_float_equal(m.area, 6, 1e-6);
    assert_float_equal(m.agreement, 1, 1e-6);
    assert_float_equal(mesh.normals[2], 1, 1e-6);
    mesh_source_release(&mesh);
}

static void saddle_lies_on_its_surface(void **state)
{
    /* z = x y over the unit square: area of the graph by quadrature. */
    static const float positions[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 1};
    static const uint32_t corners[] = {0, 1, 2, 3};
    struct shape_patches patches = {.positions = positions,
                                    .vertex_count = 4,
                                    .corners = corners,
                                    .patch_count = 1,
                                    .divisions = 32};
    struct mesh_source mesh;
    struct error err = {0};
    struct measure m;
    double area = 0;

    (void)state;
    for (int i = 0; i < 400; i++)
        for (int j = 0; j < 400; j++) {
            double x = (i + 0.5) / 400, y = (j + 0.5) / 400;
            area += sqrt(1 + x * x + y * y) / 160000;
        }
    assert_int_equal(shape_bilinear(&patches, &mesh, &err), STATUS_OK);
    m = measure(&mesh);
    assert_int_equal(mesh.triangle_count, 2 * 32 * 32);
    assert_float_equal(m.area, area, 2e-4);
    for (size_t v = 0; v < mesh.vertex_count; v++) {
        struct vec3 p = vec_at(mesh.positions, v), n = vec_at(mesh.normals, v);
        struct vec3 wanted = vec3_normalize(vec3_make(-p.y, -p.x, 1));
        assert_float_equal(p.z, p.x * p.y, 1e-6);
        assert_float_equal(vec3_dot(n, wanted), 1, 1e-5);
        assert_float_equal(mesh.uv[0][2 * v], p.x, 1e-6);
        assert_float_equal(mesh.uv[0][2 * v + 1], p.y, 1e-6);
    }
    mesh_source_release(&mesh);
}

/* Six twisted patches around a bent box: edges that run against each other must fit. */
static void neighbouring_patches_fit(void **state)
{
    float positions[24];
    static const uint32_t corners[] = {0, 2, 1, 3, 4, 5, 6, 7, 0, 1, 4, 5,
                                       2, 6, 3, 7, 0, 4, 2, 6, 1, 3, 5, 7};
    struct shape_patches patches = {.positions = positions,
                                    .vertex_count = 8,
                                    .corners = corners,
                                    .patch_count = 6,
                                    .divisions = 7};
    struct mesh_source mesh;
    struct error err = {0};
    struct measure m;

    (void)state;
    for (int i = 0; i < 8; i++) {
        positions[3 * i] = (float)(i & 1) + 0.1f * (float)i;
        positions[3 * i + 1] = (float)(i >> 1 & 1) + 0.03f * (float)(i * i % 5);
        positions[3 * i + 2] = (float)(i >> 2) + 0.07f * (float)(i * 3 % 7);
    }
    assert_int_equal(shape_bilinear(&patches, &mesh, &err), STATUS_OK);
    m = measure(&mesh);
    assert_true(m.volume > 0);
    assert_true(mesh_is_closed(&mesh));
    mesh_source_release(&mesh);
}

static void patch_with_a_collapsed_edge(void **state)
{
    static const float positions[] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    static const uint32_t corners[] = {0, 1, 2, 2};
    struct shape_patches patches = {.positions = positions,
                                    .vertex_count = 3,
                                    .corners = corners,
                                    .patch_count = 1,
                                    .divisions = 4};
    struct mesh_source mesh;
    struct error err = {0};

    (void)state;
    assert_int_equal(shape_bilinear(&patches, &mesh, &err), STATUS_OK);
    for (size_t v = 0; v < mesh.vertex_count; v++)
        assert_float_equal(mesh.normals[3 * v + 2], 1, 1e-6);
    mesh_source_release(&mesh);
}

/* ---- subdivision ---------------------------------------------------------------------------- */

static const float tetra[] = {1, 1, 1, 1, -1, -1, -1, 1, -1, -1, -1, 1};
static const uint32_t tetra_faces[] = {0, 1, 2, 0, 3, 1, 0, 2, 3, 1, 3, 2};

static void tetrahedron_keeps_its_limit(void **state)
{
    struct shape_control control = {
        .positions = tetra, .vertex_count = 4, .indices = tetra_faces, .triangle_count = 4};
    struct mesh_source coarse, mesh;
    struct error err = {0};
    struct measure m;

    (void)state;
    assert_int_equal(shape_loop(&control, 0, &coarse, &err), STATUS_OK);
    /* A vertex of valence 3 goes to (1 - 3/5) v + 1/5 (sum of the others, which is -v). */
    for (size_t i = 0; i < 12; i++)
        assert_float_equal(coarse.positions[i], 0.2 * (double)tetra[i], 1e-6);
    for (size_t v = 0; v < 4; v++)
        assert_float_equal(vec3_dot(vec_at(coarse.normals, v), vec3_normalize(vec_at(tetra, v))), 1, 1e-6);
    for (uint32_t level = 1; level <= 5; level++) {
        assert_int_equal(shape_loop(&control, level, &mesh, &err), STATUS_OK);
        assert_int_equal(mesh.triangle_count, 4u << 2 * level);
        /* Euler: V - E + F = 2 with E = 3/2 F. */
        assert_int_equal(mesh.vertex_count, 2 + mesh.triangle_count / 2);
        assert_true(mesh_is_closed(&mesh));
        /* More levels refine the surface without moving it. */
        for (size_t i = 0; i < 12; i++)
            assert_float_equal(mesh.positions[i], coarse.positions[i], 1e-6);
        for (size_t i = 0; i < 12; i++)
            assert_float_equal(mesh.normals[i], coarse.normals[i], 1e-5);
        m = measure(&mesh);
        assert_true(m.volume > 0 && (level < 3 || m.agreement > 0.9f));
        mesh_source_release(&mesh);
    }
    mesh_source_release(&coarse);
}

/* The limit normal of a vertex must be that of ever finer triangles around it. */
static void normals_are_those_of_the_limit(void **state)
{
    float positions[3 * 13];
    uint32_t faces[3 * 22];
    struct shape_control control = {.positions = positions, .indices = faces};
    struct mesh_source mesh;
    struct error err = {0};

    (void)state;
    /* A bipyramid over n corners has vertices of valence n and 4; without its lower half it has
     * a boundary. A second lower ring of corners makes the boundary's valences 2 to 5. */
    for (int half = 0; half < 2; half++)
        for (uint32_t n = 3; n <= 11; n++) {
            uint32_t count = 0;
            struct measure m;
            positions[0] = 0.1f, positions[1] = -0.05f, positions[2] = 1;
            positions[3 * n + 3] = 0, positions[3 * n + 4] = 0, positions[3 * n + 5] = -0.5f;
            for (uint32_t i = 0; i < n; i++) {
                double angle = 2 * PI * i / n;
                positions[3 * i + 3] = (float)cos(angle);
                positions[3 * i + 4] = (float)(1.5 * sin(angle));
                positions[3 * i + 5] = 0.2f * (float)(i % 3);
                faces[count++] = 0, faces[count++] = 1 + i, faces[count++] = 1 + (i + 1) % n;
                if (half)
                    continue;
                faces[count++] = n + 1, faces[count++] = 1 + (i + 1) % n, faces[count++] = 1 + i;
            }
            control.vertex_count = n + 2 - (uint32_t)half;
            control.triangle_count = count / 3;
            assert_int_equal(shape_loop(&control, 6, &mesh, &err), STATUS_OK);
            m = measure(&mesh);
            assert_int_equal(mesh_is_closed(&mesh), !half);
            /* Where the boundary bends sharply the curvature stays high: nine levels of normals
             * within 0.35 radians of all triangles around would not come by chance. */
            assert_true(m.agreement > 0.93f);
            mesh_source_release(&mesh);
        }
}

static void boundary_is_a_cubic_b_spline(void **state)
{
    /* A flat sheet of 4 x 4 vertices: stays flat, and its straight edges stay straight. */
    float positions[48], uv[32];
    uint32_t faces[54];
    struct shape_control control = {.positions = positions,
                                    .uv = uv,
                                    .vertex_count = 16,
                                    .indices = faces,
                                    .triangle_count = 18};
    struct mesh_source coarse, mesh;
    struct error err = {0};
    size_t count = 0;

    (void)state;
    for (uint32_t j = 0; j < 4; j++)
        for (uint32_t i = 0; i < 4; i++) {
            uint32_t at = 4 * j + i;
            positions[3 * at] = (float)i, positions[3 * at + 1] = (float)j;
            positions[3 * at + 2] = 0;
            uv[2 * at] = (float)i / 3, uv[2 * at + 1] = (float)j / 3;
            if (i == 3 || j == 3)
                continue;
            faces[count++] = at, faces[count++] = at + 1, faces[count++] = at + 5;
            faces[count++] = at, faces[count++] = at + 5, faces[count++] = at + 4;
        }
    assert_int_equal(shape_loop(&control, 0, &coarse, &err), STATUS_OK);
    assert_int_equal(shape_loop(&control, 4, &mesh, &err), STATUS_OK);
    for (size_t v = 0; v < mesh.vertex_count; v++) {
        assert_float_equal(mesh.positions[3 * v + 2], 0, 0);
        assert_float_equal(mesh.normals[3 * v + 2], 1, 1e-6);
        assert_true(mesh.uv[0][2 * v] >= 0 && mesh.uv[0][2 * v] <= 1);
    }
    for (size_t i = 0; i < 48; i++)
        assert_float_equal(mesh.positions[i], coarse.positions[i], 1e-6);
    /* The corner is (4 p + a + b) / 6; a middle of the edge stays where it is. */
    assert_float_equal(coarse.positions[0], 1.0 / 6, 1e-6);
    assert_float_equal(coarse.positions[1], 1.0 / 6, 1e-6);
    assert_float_equal(coarse.positions[3], 1, 1e-6);
    assert_float_equal(coarse.positions[4], 0, 1e-6);
    mesh_source_release(&coarse);
    mesh_source_release(&mesh);
}

/* Two tetrahedra that share one vertex, then one edge, and a triangle with a corner twice. */
static void odd_control_meshes_are_parted(void **state)
{
    static const float positions[] = {0, 0,  0, 1, 0, 0,  0, 1, 0, 0, 0,
                                      1, -1, 0, 0, 0, -1, 0, 0, 0, -1};
    static const uint32_t shared_vertex[] = {0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3, 0, 0,
                                             1, 0, 4, 5, 0, 6, 4, 0, 5, 6, 4, 6, 5};
    /* Three triangles on the edge 0-1. */
    static const uint32_t shared_edge[] = {0, 1, 2, 0, 1, 3, 1, 0, 5};
    struct shape_control control = {
        .positions = positions, .vertex_count = 7, .indices = shared_vertex, .triangle_count = 9};
    struct mesh_source mesh;
    struct error err = {0};

    (void)state;
    assert_int_equal(shape_loop(&control, 2, &mesh, &err), STATUS_OK);
    assert_int_equal(mesh.triangle_count, 8 * 16);
    assert_int_equal(mesh.vertex_count, 2 * (2 + 4 * 16 / 2));
    assert_true(mesh_is_closed(&mesh));
    mesh_source_release(&mesh);
    control.indices = shared_edge;
    control.triangle_count = 3;
    assert_int_equal(shape_loop(&control, 2, &mesh, &err), STATUS_OK);
    assert_int_equal(mesh.triangle_count, 48);
    measure(&mesh);
    mesh_source_release(&mesh);
    control.triangle_count = 0;
    assert_int_equal(shape_loop(&control, 2, &mesh, &err), STATUS_OK);
    assert_int_equal(mesh.triangle_count, 0);
    mesh_source_release(&mesh);
}

/* ---- curves --------------------------------------------------------------------------------- */

static void straight_tube(void **state)
{
    static const float points[] = {0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0};
    struct shape_curve curve = {.basis = CURVE_BEZIER,
                                .kind = CURVE_CYLINDER,
                                .degree = 3,
                                .points = points,
                                .point_count = 4,
                                .width_start = 0.2f,
                                .width_end = 0.2f};
    struct mesh_source mesh;
    struct error err = {0};
    struct measure m;

    (void)state;
    assert_int_equal(shape_curves(&curve, 1, 5, 12, &mesh, &err), STATUS_OK);
    m = measure(&mesh);
    assert_int_equal(mesh.triangle_count, 2 * 5 * 12);
    /* Equal mean width means equal outline: the area is exactly that of the cylinder. */
    assert_float_equal(m.area, PI * 0.2 * 3, 1e-5);
    assert_true(m.agreement > 0.96f);
    for (size_t v = 0; v < mesh.vertex_count; v++) {
        struct vec3 p = vec_at(mesh.positions, v), n = vec_at(mesh.normals, v);
        assert_true(p.y * n.y + p.z * n.z > 0.09f);
        assert_float_equal(n.x, 0, 1e-6);
    }
    mesh_source_release(&mesh);
}

static void chains_join_smoothly(void **state)
{
    float points[3 * 7];
    struct shape_curve curve = {.kind = CURVE_CYLINDER,
                                .points = points,
                                .point_count = 7,
                                .width_start = 0.1f,
                                .width_end = 0};
    struct mesh_source mesh;
    struct error err = {0};

    (void)state;
    for (int i = 0; i < 7; i++) {
        points[3 * i] = (float)i, points[3 * i + 1] = (float)(i * i % 4);
        points[3 * i + 2] = (float)(i % 2);
    }
    for (int basis = 0; basis < 2; basis++)
        for (uint32_t degree = 2; degree <= 3; degree++) {
            size_t segments;
            float last = 0;
            curve.basis = basis ? CURVE_BSPLINE : CURVE_BEZIER;
            curve.degree = degree;
            segments = shape_curve_segments(&curve);
            assert_int_equal(segments, basis ? 7 - degree : 6 / degree);
            assert_int_equal(shape_curves(&curve, 1, 10, 3, &mesh, &err), STATUS_OK);
            for (size_t k = 0; k <= 10 * segments; k++) {
                struct vec3 centre = {0};
                for (size_t i = 0; i < 3; i++)
                    centre = vec3_add(centre, vec_at(mesh.positions, 4 * k + i));
                centre = vec3_scale(centre, 1.0f / 3);
                if (k > 0)
                    assert_true(centre.x > last && centre.x < last + 0.4f);
                last = centre.x;
            }
            assert_float_equal(last, basis ? (degree == 2 ? 5.5 : 5) : 6, 1e-5);
            mesh_source_release(&mesh);
        }
}

static void ribbon_faces_its_normals(void **state)
{
    static const float points[] = {0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0};
    static const float normals[] = {0, 0, 1, 0, 1, 0};
    struct shape_curve curve = {.basis = CURVE_BEZIER,
                                .kind = CURVE_RIBBON,
                                .degree = 3,
                                .points = points,
                                .point_count = 4,
                                .normals = normals,
                                .width_start = 1,
                                .width_end = 1};
    struct mesh_source mesh;
    struct error err = {0};
    struct measure m;

    (void)state;
    assert_int_equal(shape_curves(&curve, 1, 64, 3, &mesh, &err), STATUS_OK);
    m = measure(&mesh);
    /* A quarter turn over a length of 3 tilts the edges by atan(pi / 12). */
    assert_true(m.agreement > 0.96f);
    for (size_t k = 0; k <= 64; k++) {
        struct vec3 n = vec_at(mesh.normals, 2 * k);
        assert_float_equal(n.z, cos(PI / 2 * (double)k / 64), 1e-5);
        assert_float_equal(n.y, sin(PI / 2 * (double)k / 64), 1e-5);
        assert_float_equal(vec3_length(vec3_sub(vec_at(mesh.positions, 2 * k), vec_at(mesh.positions, 2 * k + 1))), 1,
                           1e-5);
    }
    mesh_source_release(&mesh);
}

/* Points on top of each other, a cusp, a curve of no length: finite numbers, unit normals. */
static void hostile_curves_stay_finite(void **state)
{
    static const float shapes[4][12] = {{0, 0, 0, 0, 0, 0, 1, 0, 0, 1, 0, 0},
                                        {0, 0, 0, 1, 1, 0, 0, 1, 0, 1, 0, 0},
                                        {5, 5, 5, 5, 5, 5, 5, 5, 5, 5, 5, 5},
                                        {0, 0, 0, 1e15f, 0, 0, -1e15f, 0, 0, 0, 1e-30f, 0}};
    struct shape_curve curve = {.basis = CURVE_BEZIER,
                                .kind = CURVE_FLAT,
                                .degree = 3,
                                .point_count = 4,
                                .width_start = 0.1f,
                                .width_end = 1};
    struct mesh_source mesh;
    struct error err = {0};

    (void)state;
    for (int i = 0; i < 4; i++) {
        curve.points = shapes[i];
        assert_int_equal(shape_curves(&curve, 1, 8, 5, &mesh, &err), STATUS_OK);
        for (size_t v = 0; v < mesh.vertex_count; v++) {
            assert_true(vec3_is_finite(vec_at(mesh.positions, v)));
            assert_float_equal(vec3_length(vec_at(mesh.normals, v)), 1, 1e-5);
        }
        mesh_source_release(&mesh);
    }
}

static status subdivide_twice(void *user)
{
    struct shape_control control = {
        .positions = tetra, .vertex_count = 4, .indices = tetra_faces, .triangle_count = 4};
    struct mesh_source mesh;
    struct error err = {0};
    status result = shape_loop(&control, 2, &mesh, &err);

    (void)user;
    mesh_source_release(&mesh);
    return result;
}

static void out_of_memory_ends_it(void **state)
{
    (void)state;
    assert_true(starve_each(subdivide_twice, NULL, 0) > 10);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(full_sphere),
        cmocka_unit_test(part_of_a_sphere),
        cmocka_unit_test(cylinder_and_disk),
        cmocka_unit_test(surfaces_of_turned_lines),
        cmocka_unit_test(nonsense_is_refused),
        cmocka_unit_test(parallelograms_are_two_triangles),
        cmocka_unit_test(saddle_lies_on_its_surface),
        cmocka_unit_test(neighbouring_patches_fit),
        cmocka_unit_test(patch_with_a_collapsed_edge),
        cmocka_unit_test(tetrahedron_keeps_its_limit),
        cmocka_unit_test(normals_are_those_of_the_limit),
        cmocka_unit_test(boundary_is_a_cubic_b_spline),
        cmocka_unit_test(odd_control_meshes_are_parted),
        cmocka_unit_test(straight_tube),
        cmocka_unit_test(chains_join_smoothly),
        cmocka_unit_test(ribbon_faces_its_normals),
        cmocka_unit_test(hostile_curves_stay_finite),
        cmocka_unit_test(out_of_memory_ends_it),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
