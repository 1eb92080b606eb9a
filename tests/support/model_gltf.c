/* A model as glTF: one node a mesh, under a node of its own where it moves. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "tests/support/gltf_maker.h"
#include "tests/support/model.h"

/* Seconds of the animations' second key: that frame, at 24 a second. */
static const float key_times[2] = {0, 1 / 24.0f};

struct writer {
    const struct model *m;
    const struct model_way *way;
    struct maker maker;
    struct buffer meshes, nodes, roots, skins, samplers, channels;
    int mesh_count, node_count, skin_count, sampler_count, time_accessor;
};

static const char *comma(const struct buffer *b) { return b->size ? "," : ""; }

static void put_list(struct buffer *out, const char *name, const double *v, int count)
{
    buffer_printf(out, "\"%s\":[", name);
    for (int i = 0; i < count; i++)
        buffer_printf(out, "%s%.17g", i ? "," : "", v[i]);
    buffer_puts(out, "]");
}

/* ---- vertices ------------------------------------------------------------------------------- */

/* Rows of `components` numbers, less `from`; returns the accessor. */
static int put_rows(struct writer *w, const char *type, const double *rows, int components, uint32_t count,
                    const double *from)
{
    size_t floats = (size_t)components * count;
    float *data = mem_alloc_array(floats, sizeof *data);
    int accessor;

    assert_non_null(data);
    for (size_t i = 0; i < floats; i++)
        data[i] = (float)(rows[i] - (from ? from[i % (size_t)components] : 0));
    accessor = put_floats(&w->maker, type, data, floats, count);
    mem_free(data);
    return accessor;
}

static void put_joints(struct writer *w, const struct model_mesh *mesh, int out[2])
{
    uint16_t(*joints)[4] = mem_calloc(mesh->vertex_count, sizeof *joints);
    float(*weights)[4] = mem_calloc(mesh->vertex_count, sizeof *weights);

    assert_true(joints && weights);
    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        joints[i][1] = 1;
        weights[i][0] = (float)(1 - mesh->bend[i]);
        weights[i][1] = (float)mesh->bend[i];
    }
    out[0] = put_accessor(&w->maker, put_view(&w->maker, joints, mesh->vertex_count * sizeof *joints, 0), "VEC4", 5123,
                          mesh->vertex_count, "");
    out[1] = put_floats(&w->maker, "VEC4", weights[0], 4 * (size_t)mesh->vertex_count, mesh->vertex_count);
    mem_free(joints);
    mem_free(weights);
}

static void put_mesh(struct writer *w, const struct model_mesh *mesh)
{
    struct buffer *out = &w->meshes;
    int joints[2];

    buffer_printf(out, "%s{\"name\":\"%s\",\"primitives\":[{\"material\":%u,\"indices\":%d,"
                       "\"attributes\":{\"POSITION\":%d",
                  comma(out), mesh->name, mesh->material,
                  put_accessor(&w->maker,
                               put_view(&w->maker, mesh->triangles, mesh->triangle_count * sizeof *mesh->triangles, 0),
                               "SCALAR", 5125, 3 * (size_t)mesh->triangle_count, ""),
                  put_rows(w, "VEC3", mesh->at[0], 3, mesh->vertex_count, mesh->pivot));
    if (mesh->normal)
        buffer_printf(out, ",\"NORMAL\":%d", put_rows(w, "VEC3", mesh->normal[0], 3, mesh->vertex_count, NULL));
    if (mesh->uv)
        buffer_printf(out, ",\"TEXCOORD_0\":%d", put_rows(w, "VEC2", mesh->uv[0], 2, mesh->vertex_count, NULL));
    if (mesh->bend) {
        put_joints(w, mesh, joints);
        buffer_printf(out, ",\"JOINTS_0\":%d,\"WEIGHTS_0\":%d", joints[0], joints[1]);
    }
    buffer_puts(out, "}");
    if (mesh->morph)
        buffer_printf(out, ",\"targets\":[{\"POSITION\":%d}]",
                      put_rows(w, "VEC3", mesh->morph[0], 3, mesh->vertex_count, NULL));
    buffer_puts(out, "}]}");
    w->mesh_count++;
}

/* ---- nodes and what moves them -------------------------------------------------------------- */

/* Open a node; the caller adds its members, each after a comma, and closes it. */
static int open_node(struct writer *w, const char *name)
{
    buffer_printf(&w->nodes, "%s{\"name\":\"%s\"", comma(&w->nodes), name);
    return w->node_count++;
}

static void put_root(struct writer *w, int node) { buffer_printf(&w->roots, "%s%d", comma(&w->roots), node); }

/* Two keys of a node's property. */
static void put_channel(struct writer *w, int node, const char *path, const char *type, const float *values,
                        size_t floats, size_t count)
{
    if (w->time_accessor < 0)
        w->time_accessor = put_accessor(&w->maker, put_view(&w->maker, key_times, sizeof key_times, 0), "SCALAR", 5126,
                                        2, ",\"min\":[0],\"max\":[0.0416666679]");
    buffer_printf(&w->samplers, "%s{\"input\":%d,\"output\":%d}", comma(&w->samplers), w->time_accessor,
                  put_floats(&w->maker, type, values, floats, count));
    buffer_printf(&w->channels, "%s{\"sampler\":%d,\"target\":{\"node\":%d,\"path\":\"%s\"}}", comma(&w->channels),
                  w->sampler_count++, node, path);
}

static void put_turn(struct writer *w, int node, const struct model_motion *motion)
{
    float keys[8] = {0, 0, 0, 1};

    for (int c = 0; c < 3; c++)
        keys[4 + c] = (float)(motion->axis[c] * sin(motion->turn_rad / 2));
    keys[7] = (float)cos(motion->turn_rad / 2);
    put_channel(w, node, "rotation", "VEC4", keys, 8, 2);
}

static void put_travel(struct writer *w, int node, const double travel[3])
{
    const float keys[6] = {0, 0, 0, (float)travel[0], (float)travel[1], (float)travel[2]};

    put_channel(w, node, "translation", "VEC3", keys, 6, 2);
}

/* Two joints, bound at the pivot and at the tip; the mesh's own node counts for nothing. */
static void put_skin(struct writer *w, const struct model_mesh *mesh, int place)
{
    float bind[32] = {0};
    int base = place + 2;

    for (int j = 0; j < 2; j++)
        for (int i = 0; i < 4; i++)
            bind[16 * j + 5 * i] = 1;
    for (int c = 0; c < 3; c++)
        bind[28 + c] = -(float)mesh->tip[c];
    buffer_printf(&w->skins, "%s{\"joints\":[%d,%d],\"inverseBindMatrices\":%d}", comma(&w->skins), base, base + 1,
                  put_floats(&w->maker, "MAT4", bind, 32, 2));
    assert_int_equal(open_node(w, "base"), base);
    buffer_printf(&w->nodes, ",\"children\":[%d]}", base + 1);
    assert_int_equal(open_node(w, "tip"), base + 1);
    buffer_puts(&w->nodes, ",");
    put_list(&w->nodes, "translation", mesh->tip, 3);
    buffer_puts(&w->nodes, "}");
    put_turn(w, base + 1, &mesh->motion);
    w->skin_count++;
}

static void put_mesh_node(struct writer *w, const struct model_mesh *mesh)
{
    const struct model_motion *motion = &mesh->motion;
    int place = open_node(w, mesh->name), moved;

    put_root(w, place);
    buffer_puts(&w->nodes, ",");
    put_list(&w->nodes, "translation", mesh->pivot, 3);
    if (!motion->moves) {
        buffer_printf(&w->nodes, ",\"mesh\":%d}", w->mesh_count);
        put_mesh(w, mesh);
        return;
    }
    buffer_printf(&w->nodes, mesh->bend ? ",\"children\":[%d,%d]}" : ",\"children\":[%d]}", place + 1, place + 2);
    moved = open_node(w, "moved");
    buffer_printf(&w->nodes, ",\"mesh\":%d", w->mesh_count);
    if (mesh->bend)
        buffer_printf(&w->nodes, ",\"skin\":%d", w->skin_count);
    buffer_puts(&w->nodes, "}");
    put_mesh(w, mesh);
    if (mesh->bend) {
        put_skin(w, mesh, place);
    } else if (mesh->morph) {
        put_channel(w, moved, "weights", "SCALAR", (const float[2]){0, 1}, 2, 2);
    } else {
        put_travel(w, moved, motion->travel);
        put_turn(w, moved, motion);
    }
}

/* ---- the camera and the lights --------------------------------------------------------------- */

static void cross(const double a[3], const double b[3], double out[3])
{
    for (int c = 0; c < 3; c++)
        out[c] = a[(c + 1) % 3] * b[(c + 2) % 3] - a[(c + 2) % 3] * b[(c + 1) % 3];
}

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void normalize(double v[3])
{
    double length = sqrt(dot(v, v));

    for (int c = 0; c < 3; c++)
        v[c] /= length;
}

void model_looking(const double at[3], const double forward[3], const double up[3], double out[16])
{
    double *x = out, *y = out + 4, *z = out + 8;

    memset(out, 0, 16 * sizeof *out);
    for (int c = 0; c < 3; c++) {
        z[c] = -forward[c];
        out[12 + c] = at[c];
    }
    out[15] = 1;
    normalize(z);
    cross(up, z, x);
    normalize(x);
    cross(z, x, y);
}

static void put_camera(struct writer *w)
{
    const struct model *m = w->m;
    double forward[3], columns[16], travel[3];
    int place = open_node(w, "camera"), moved;

    for (int c = 0; c < 3; c++)
        forward[c] = m->target[c] - m->eye[c];
    model_looking(m->eye, forward, m->up, columns);
    put_root(w, place);
    buffer_puts(&w->nodes, ",");
    put_list(&w->nodes, "matrix", columns, 16);
    buffer_printf(&w->nodes, ",\"children\":[%d]}", place + 1);
    moved = open_node(w, "eye");
    buffer_puts(&w->nodes, ",\"camera\":0}");
    for (int c = 0; c < 3; c++)
        travel[c] = dot(m->camera_travel, columns + 4 * c);
    if (dot(travel, travel) > 0)
        put_travel(w, moved, travel);
}

/* Up is any direction but the light's. */
static void put_light_node(struct writer *w, uint32_t light)
{
    const struct model_light *l = &w->m->lights[light];
    const double up[3] = {fabs(l->direction[1]) > 0.9, fabs(l->direction[1]) <= 0.9, 0};
    static const double down[3] = {0, -1, 0}, other_up[3] = {1, 0, 0};
    double columns[16];

    model_looking(l->at, l->outer_rad > 0 ? l->direction : down, l->outer_rad > 0 ? up : other_up, columns);
    put_root(w, open_node(w, "lamp"));
    buffer_puts(&w->nodes, ",");
    put_list(&w->nodes, "matrix", columns, 16);
    buffer_printf(&w->nodes, ",\"extensions\":{\"KHR_lights_punctual\":{\"light\":%u}}}", light);
}

static void put_lights(const struct model *m, struct buffer *out)
{
    buffer_puts(out, "\"extensions\":{\"KHR_lights_punctual\":{\"lights\":[");
    for (uint32_t i = 0; i < m->light_count; i++) {
        const struct model_light *l = &m->lights[i];
        double most = fmax(l->intensity[0], fmax(l->intensity[1], l->intensity[2]));
        const double color[3] = {l->intensity[0] / most, l->intensity[1] / most,
                                 l->intensity[2] / most};
        buffer_printf(out, "%s{\"type\":\"%s\",\"intensity\":%.17g,", i ? "," : "",
                      l->outer_rad > 0 ? "spot" : "point", most);
        put_list(out, "color", color, 3);
        if (l->outer_rad > 0)
            buffer_printf(out, ",\"spot\":{\"innerConeAngle\":%.17g,\"outerConeAngle\":%.17g}", l->inner_rad,
                          l->outer_rad);
        buffer_puts(out, "}");
    }
    buffer_puts(out, "]}},");
}

/* ---- materials ------------------------------------------------------------------------------- */

static const char *const images[] = {"checker.png", "bumps.png", "holes.png"};
enum { IMAGES = sizeof images / sizeof *images };

static int image_of(const char *name)
{
    for (int i = 0; i < IMAGES; i++)
        if (strcmp(images[i], name) == 0)
            return i;
    fail_msg("model: no image \"%s\"", name);
    return 0;
}

static void put_extensions(const struct model_material *mat, struct buffer *out)
{
    double strength = fmax(mat->emission[0], fmax(mat->emission[1], mat->emission[2]));

    buffer_printf(out, ",\"extensions\":{\"KHR_materials_specular\":{\"specularFactor\":%d}",
                  mat->glossy || mat->metallic || mat->ior > 0);
    if (mat->ior > 0)
        buffer_printf(out, ",\"KHR_materials_ior\":{\"ior\":%.17g},"
                           "\"KHR_materials_transmission\":{\"transmissionFactor\":1},"
                           "\"KHR_materials_volume\":{\"thicknessFactor\":1",
                      mat->ior);
    if (mat->ior > 0 && mat->attenuation_distance > 0) {
        buffer_printf(out, ",\"attenuationDistance\":%.17g,", mat->attenuation_distance);
        put_list(out, "attenuationColor", mat->attenuation_color, 3);
    }
    buffer_puts(out, mat->ior > 0 ? "}" : "");
    if (strength > 0)
        buffer_printf(out, ",\"KHR_materials_emissive_strength\":{\"emissiveStrength\":%.17g}", strength);
    buffer_puts(out, "}");
}

static void put_material(const struct model_material *mat, struct buffer *out)
{
    double strength = fmax(mat->emission[0], fmax(mat->emission[1], mat->emission[2]));
    const double color[4] = {mat->color[0], mat->color[1], mat->color[2], 1};

    assert_true(mat->medium < 0);
    buffer_printf(out, "{\"name\":\"%s\",\"doubleSided\":%s,\"pbrMetallicRoughness\":{"
                       "\"metallicFactor\":%d,\"roughnessFactor\":%.17g,",
                  mat->name, mat->one_sided ? "false" : "true", mat->metallic, mat->roughness);
    put_list(out, "baseColorFactor", color, 4);
    if (mat->color_image)
        buffer_printf(out, ",\"baseColorTexture\":{\"index\":%d}", image_of(mat->color_image));
    buffer_puts(out, "}");
    if (mat->normal_image)
        buffer_printf(out, ",\"normalTexture\":{\"index\":%d}", image_of(mat->normal_image));
    if (mat->alpha_cutoff > 0)
        buffer_printf(out, ",\"alphaMode\":\"MASK\",\"alphaCutoff\":%.17g", mat->alpha_cutoff);
    if (mat->alpha_cutoff < 0)
        buffer_puts(out, ",\"alphaMode\":\"BLEND\"");
    if (strength > 0) {
        const double factor[3] = {mat->emission[0] / strength, mat->emission[1] / strength,
                                  mat->emission[2] / strength};
        buffer_puts(out, ",");
        put_list(out, "emissiveFactor", factor, 3);
    }
    put_extensions(mat, out);
    buffer_puts(out, "}");
}

/* ---- all of it -------------------------------------------------------------------------------- */

static void put_matrix(struct writer *w)
{
    const struct model_way *way = w->way;
    double columns[16] = {0};

    for (int r = 0; r < 3; r++) {
        for (int c = 0; c < 3; c++)
            columns[4 * c + r] = way->scale * way->turn[r][c];
        columns[12 + r] = way->shift[r];
    }
    columns[15] = 1;
    open_node(w, "world");
    buffer_puts(&w->nodes, ",");
    put_list(&w->nodes, "matrix", columns, 16);
    buffer_printf(&w->nodes, ",\"children\":[%s]}", buffer_text(&w->roots));
}

static void put_tables(struct writer *w, struct buffer *rest)
{
    const struct model *m = w->m;

    buffer_puts(rest, "\"extensionsUsed\":[\"KHR_lights_punctual\",\"KHR_materials_specular\","
                      "\"KHR_materials_ior\",\"KHR_materials_transmission\",\"KHR_materials_volume\","
                      "\"KHR_materials_emissive_strength\"],");
    if (m->light_count > 0)
        put_lights(m, rest);
    buffer_printf(rest, "\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"yfov\":%.17g,"
                        "\"znear\":0.01}}],\"images\":[",
                  m->yfov_rad);
    for (int i = 0; i < IMAGES; i++)
        buffer_printf(rest, "%s{\"uri\":\"%s\"}", i ? "," : "", images[i]);
    buffer_puts(rest, "],\"textures\":[");
    for (int i = 0; i < IMAGES; i++)
        buffer_printf(rest, "%s{\"source\":%d}", i ? "," : "", i);
    buffer_puts(rest, "],\"materials\":[");
    for (uint32_t i = 0; i < m->material_count; i++) {
        buffer_puts(rest, i ? "," : "");
        put_material(&m->materials[i], rest);
    }
    buffer_printf(rest, "],\"meshes\":[%s],\"nodes\":[%s]", buffer_text(&w->meshes), buffer_text(&w->nodes));
    if (w->skins.size)
        buffer_printf(rest, ",\"skins\":[%s]", buffer_text(&w->skins));
    if (w->channels.size)
        buffer_printf(rest, ",\"animations\":[{\"samplers\":[%s],\"channels\":[%s]}]", buffer_text(&w->samplers),
                      buffer_text(&w->channels));
    if (w->way->flags & WAY_IN_MATRIX)
        buffer_printf(rest, ",\"scenes\":[{\"nodes\":[%d]}]", w->node_count - 1);
    else
        buffer_printf(rest, ",\"scenes\":[{\"nodes\":[%s]}]", buffer_text(&w->roots));
}

void model_write_gltf(const struct model *varied, const struct model_way *way, struct buffer *out)
{
    struct writer w = {.m = varied, .way = way, .time_accessor = -1};
    struct buffer *const parts[] = {&w.meshes, &w.nodes, &w.roots, &w.skins, &w.samplers, &w.channels};
    struct buffer rest = BUFFER_INIT;

    assert_true(varied->medium_count == 0 && varied->lens_radius == 0);
    put_camera(&w);
    for (uint32_t i = 0; i < varied->mesh_count; i++)
        put_mesh_node(&w, &varied->meshes[i]);
    for (uint32_t i = 0; i < varied->light_count; i++)
        put_light_node(&w, i);
    if (way->flags & WAY_IN_MATRIX)
        put_matrix(&w);
    put_tables(&w, &rest);
    maker_write(&w.maker, buffer_text(&rest), out);
    maker_release(&w.maker);
    buffer_release(&rest);
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++)
        buffer_release(parts[i]);
}
