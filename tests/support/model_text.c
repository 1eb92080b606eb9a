/* A model as pbrt and as OBJ. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "tests/support/model.h"

static void put_list(struct buffer *out, const char *name, const double *v, size_t count)
{
    buffer_printf(out, " \"%s\" [", name);
    for (size_t i = 0; i < count; i++)
        buffer_printf(out, "%.17g ", v[i]);
    buffer_puts(out, "]");
}

/* ---- pbrt ------------------------------------------------------------------------------------ */

/* The way's matrix by columns, as pbrt has them. */
static void put_transform(const struct model_way *way, struct buffer *out)
{
    buffer_puts(out, "ConcatTransform [");
    for (int c = 0; c < 3; c++)
        for (int r = 0; r < 4; r++)
            buffer_printf(out, "%.17g ", r == 3 ? 0 : way->scale * way->turn[r][c]);
    buffer_printf(out, "%.17g %.17g %.17g 1]\n", way->shift[0], way->shift[1], way->shift[2]);
}

/* Media from `first` until before `end`. */
static void put_media(const struct model *m, const struct model_way *way, uint32_t first, uint32_t end,
                      struct buffer *out)
{
    for (uint32_t i = first; i < end; i++) {
        const struct model_medium *medium = &m->media[i];
        buffer_puts(out, "AttributeBegin\n");
        put_transform(way, out);
        buffer_printf(out, "MakeNamedMedium \"m%u\" \"string type\" \"%s\" \"float g\" %.17g", i,
                      medium->grid ? "uniformgrid" : "homogeneous", medium->g);
        put_list(out, "rgb sigma_a", medium->absorption, 3);
        put_list(out, "rgb sigma_s", medium->scattering, 3);
        if (medium->grid) {
            const int n = medium->grid;
            buffer_printf(out, " \"integer nx\" %d \"integer ny\" %d \"integer nz\" %d", n, n, n);
            put_list(out, "point3 p0", medium->low, 3);
            put_list(out, "point3 p1", medium->high, 3);
            put_list(out, "float density", medium->density, (size_t)(n * n * n));
        }
        buffer_puts(out, "\nAttributeEnd\n");
    }
}

/* Absorption of glass is a medium of its own, "a" and the material's number. */
static void put_absorption(const struct model *m, struct buffer *out)
{
    for (uint32_t i = 0; i < m->material_count; i++) {
        const struct model_material *mat = &m->materials[i];
        double sigma[3];
        if (!(mat->attenuation_distance > 0))
            continue;
        for (int c = 0; c < 3; c++)
            sigma[c] = -log(mat->attenuation_color[c]) / mat->attenuation_distance;
        buffer_printf(out, "MakeNamedMedium \"a%u\" \"string type\" \"homogeneous\" "
                           "\"rgb sigma_s\" [0 0 0]", i);
        put_list(out, "rgb sigma_a", sigma, 3);
        buffer_puts(out, "\n");
    }
}

static void put_medium(const struct model *m, uint32_t material, struct buffer *out)
{
    const struct model_material *mat = &m->materials[material];
    char outside[16] = "";

    if (m->fog >= 0)
        snprintf(outside, sizeof outside, "m%d", m->fog);
    if (mat->medium >= 0)
        buffer_printf(out, "MediumInterface \"m%d\" \"%s\"\n", mat->medium, outside);
    else if (mat->attenuation_distance > 0)
        buffer_printf(out, "MediumInterface \"a%u\" \"%s\"\n", material, outside);
}

static void put_material(const struct model *m, uint32_t material, struct buffer *out)
{
    const struct model_material *mat = &m->materials[material];

    assert_true(!mat->glossy && !mat->normal_image && mat->alpha_cutoff == 0 && !mat->one_sided);
    put_medium(m, material, out);
    if (mat->color_image)
        buffer_printf(out, "Texture \"t%u\" \"spectrum\" \"imagemap\" \"string filename\" \"%s\"\n", material,
                      mat->color_image);
    if (mat->ior > 0) {
        buffer_printf(out, "Material \"dielectric\" \"float eta\" %.17g", mat->ior);
    } else if (mat->medium >= 0) {
        buffer_puts(out, "Material \"interface\"");
    } else if (mat->metallic) {
        buffer_printf(out, "Material \"conductor\" \"bool remaproughness\" false \"float roughness\" %.17g",
                      mat->roughness * mat->roughness);
        put_list(out, "rgb reflectance", mat->color, 3);
    } else if (mat->color_image) {
        buffer_printf(out, "Material \"diffuse\" \"texture reflectance\" \"t%u\"", material);
    } else {
        buffer_puts(out, "Material \"diffuse\"");
        put_list(out, "rgb reflectance", mat->color, 3);
    }
    buffer_puts(out, "\n");
    if (mat->emission[0] > 0) {
        buffer_puts(out, "AreaLightSource \"diffuse\" \"bool twosided\" true");
        put_list(out, "rgb L", mat->emission, 3);
        buffer_puts(out, "\n");
    }
}

static void put_shape(const struct model_mesh *mesh, struct buffer *out)
{
    assert_false(mesh->motion.moves);
    if (mesh->radius > 0) {
        buffer_printf(out, "Translate %.17g %.17g %.17g Shape \"sphere\" \"float radius\" %.17g\n", mesh->pivot[0],
                      mesh->pivot[1], mesh->pivot[2], mesh->radius);
        return;
    }
    buffer_puts(out, "Shape \"trianglemesh\" \"integer indices\" [");
    for (uint32_t t = 0; t < 3 * mesh->triangle_count; t++)
        buffer_printf(out, "%u ", mesh->triangles[t / 3][t % 3]);
    buffer_puts(out, "]");
    put_list(out, "point3 P", mesh->at[0], 3 * (size_t)mesh->vertex_count);
    if (mesh->normal)
        put_list(out, "normal N", mesh->normal[0], 3 * (size_t)mesh->vertex_count);
    if (mesh->uv) { /* v runs upwards */
        buffer_puts(out, " \"point2 uv\" [");
        for (uint32_t i = 0; i < mesh->vertex_count; i++)
            buffer_printf(out, "%.17g %.17g ", mesh->uv[i][0], 1 - mesh->uv[i][1]);
        buffer_puts(out, "]");
    }
    buffer_puts(out, "\n");
}

static void put_light(const struct model_light *l, struct buffer *out)
{
    const double degrees = 180 / M_PI;
    double to[3];

    buffer_printf(out, "LightSource \"%s\"", l->outer_rad > 0 ? "spot" : "point");
    put_list(out, "rgb I", l->intensity, 3);
    put_list(out, "point3 from", l->at, 3);
    if (l->outer_rad > 0) {
        for (int c = 0; c < 3; c++)
            to[c] = l->at[c] + l->direction[c];
        put_list(out, "point3 to", to, 3);
        buffer_printf(out, " \"float coneangle\" %.17g \"float conedeltaangle\" %.17g", degrees * l->outer_rad,
                      degrees * (l->outer_rad - l->inner_rad));
    }
    buffer_puts(out, "\n");
}

/* The sky turns with the world, but knows no place. */
static void put_sky(const struct model *m, const struct model_way *way, struct buffer *out)
{
    struct model_way turned = *way;

    if (!(m->sky[0] > 0))
        return;
    turned.scale = 1;
    memset(turned.shift, 0, sizeof turned.shift);
    buffer_puts(out, "AttributeBegin\n");
    put_transform(&turned, out);
    buffer_puts(out, "Rotate -90 1 0 0 LightSource \"infinite\"");
    if (m->sky_map)
        buffer_printf(out, " \"string filename\" \"%s\" \"float scale\" %.17g", m->sky_map, m->sky[0]);
    else
        put_list(out, "rgb L", m->sky, 3);
    buffer_puts(out, "\nAttributeEnd\n");
}

void model_write_pbrt(const struct model *varied, const struct model_way *way, struct buffer *out)
{
    const struct model *m = varied;
    struct model_way nowhere = MODEL_AS_IT_IS;
    const struct model_way *camera = way->flags & WAY_IN_MATRIX ? way : &nowhere;
    double eye[3], target[3], up[3];

    model_place(camera, m->eye, eye);
    model_place(camera, m->target, target);
    for (int r = 0; r < 3; r++)
        up[r] = camera->turn[r][0] * m->up[0] + camera->turn[r][1] * m->up[1] + camera->turn[r][2] * m->up[2];
    assert_true(m->camera_travel[0] == 0);
    buffer_printf(out, "Scale -1 1 1 LookAt %.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g\n", eye[0], eye[1],
                  eye[2], target[0], target[1], target[2], up[0], up[1], up[2]);
    assert_true(m->fog <= 0);
    if (m->fog == 0) { /* the camera's medium must be known by then */
        assert_false(m->media[0].grid);
        put_media(m, way, 0, 1, out);
        buffer_puts(out, "MediumInterface \"\" \"m0\"\n");
    }
    buffer_printf(out, "Camera \"perspective\" \"float fov\" %.17g", 180 / M_PI * m->yfov_rad);
    if (m->lens_radius > 0)
        buffer_printf(out, " \"float lensradius\" %.17g \"float focaldistance\" %.17g", m->lens_radius,
                      m->focus_distance);
    buffer_puts(out, " Integrator \"volpath\" \"integer maxdepth\" 12 Film \"rgb\" WorldBegin\n");
    put_media(m, way, m->fog == 0, m->medium_count, out);
    put_absorption(m, out);
    put_sky(m, way, out);
    if (way->flags & WAY_IN_MATRIX)
        put_transform(way, out);
    for (uint32_t i = 0; i < m->light_count; i++)
        put_light(&m->lights[i], out);
    for (uint32_t i = 0; i < m->mesh_count; i++) {
        buffer_puts(out, "AttributeBegin\n");
        put_material(m, m->meshes[i].material, out);
        put_shape(&m->meshes[i], out);
        buffer_puts(out, "AttributeEnd\n");
    }
    assert_true(buffer_ok(out));
}

/* ---- OBJ ------------------------------------------------------------------------------------- */

static void put_obj_mesh(const struct model *m, const struct model_mesh *mesh, uint32_t *vertices, uint32_t *uvs,
                         struct buffer *out)
{
    assert_true(!mesh->motion.moves && !mesh->normal);
    buffer_printf(out, "o %s\nusemtl %s\n", mesh->name, m->materials[mesh->material].name);
    for (uint32_t i = 0; i < mesh->vertex_count; i++)
        buffer_printf(out, "v %.17g %.17g %.17g\n", mesh->at[i][0], mesh->at[i][1], mesh->at[i][2]);
    for (uint32_t i = 0; mesh->uv && i < mesh->vertex_count; i++)
        buffer_printf(out, "vt %.17g %.17g\n", mesh->uv[i][0], 1 - mesh->uv[i][1]);
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        buffer_puts(out, "f");
        for (int k = 0; k < 3; k++) {
            uint32_t corner = mesh->triangles[t][k] + 1;
            buffer_printf(out, mesh->uv ? " %u/%u" : " %u", *vertices + corner, *uvs + corner);
        }
        buffer_puts(out, "\n");
    }
    *vertices += mesh->vertex_count;
    *uvs += mesh->uv ? mesh->vertex_count : 0;
}

void model_write_obj(const struct model *varied, struct buffer *out, struct buffer *mtl)
{
    const struct model *m = varied;
    uint32_t vertices = 0, uvs = 0;

    assert_true(m->light_count == 0 && m->medium_count == 0);
    buffer_puts(out, "mtllib scene.mtl\n");
    for (uint32_t i = 0; i < m->material_count; i++) {
        const struct model_material *mat = &m->materials[i];
        assert_true(!mat->metallic && !mat->glossy && mat->ior == 0 && !mat->normal_image);
        buffer_printf(mtl, "newmtl %s\nillum 1\nKd %.17g %.17g %.17g\nKe %.17g %.17g %.17g\n", mat->name, mat->color[0],
                      mat->color[1], mat->color[2], mat->emission[0], mat->emission[1], mat->emission[2]);
        if (mat->color_image)
            buffer_printf(mtl, "map_Kd %s\n", mat->color_image);
    }
    for (uint32_t i = 0; i < m->mesh_count; i++)
        put_obj_mesh(m, &m->meshes[i], &vertices, &uvs, out);
    assert_true(buffer_ok(out) && buffer_ok(mtl));
}
