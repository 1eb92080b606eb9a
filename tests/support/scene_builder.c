#include "tests/support/scene_builder.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/buffer.h"
#include "common/base/memory.h"
#include "common/image/image.h"
#include "tests/support/groups.h"

static void die(const char *what, const struct error *err)
{
    fprintf(stderr, "scene_builder: %s: %s\n", what, err ? err->text : "");
    abort();
}

static void *need(void *memory)
{
    if (!memory)
        die("out of memory", NULL);
    return memory;
}

void builder_init(struct scene_builder *b)
{
    memset(b, 0, sizeof *b);
    scene_init(&b->scene);
    b->scene.name = "test";
    b->scene.meshes = need(arena_alloc(&b->scene.arena, BUILDER_MAX, sizeof *b->scene.meshes));
    b->scene.materials = need(arena_alloc(&b->scene.arena, BUILDER_MAX, sizeof *b->scene.materials));
    b->scene.instances = need(arena_alloc(&b->scene.arena, BUILDER_MAX, sizeof *b->scene.instances));
    b->scene.lights = need(arena_alloc(&b->scene.arena, BUILDER_MAX, sizeof *b->scene.lights));
    b->scene.cameras = need(arena_alloc(&b->scene.arena, BUILDER_MAX, sizeof *b->scene.cameras));
    b->scene.images = need(arena_alloc(&b->scene.arena, BUILDER_MAX, sizeof *b->scene.images));
    b->scene.nodes = need(arena_alloc(&b->scene.arena, BUILDER_MAX, sizeof *b->scene.nodes));
    b->scene.channels = need(arena_alloc(&b->scene.arena, BUILDER_MAX, sizeof *b->scene.channels));
    b->scene.skins = need(arena_alloc(&b->scene.arena, BUILDER_MAX, sizeof *b->scene.skins));
    b->scene.textures = need(arena_alloc(&b->scene.arena, BUILDER_MAX, sizeof *b->scene.textures));
    b->scene.media = need(arena_alloc(&b->scene.arena, BUILDER_MAX, sizeof *b->scene.media));
}

void builder_release(struct scene_builder *b)
{
    for (size_t i = 0; i < b->blob_count; i++)
        mem_free(b->blobs[i].data);
    scene_release(&b->scene);
}

static struct scene_blob add_blob(struct scene_builder *b, uint8_t *data, size_t size_bytes)
{
    struct scene_blob blob = {.size_bytes = size_bytes};

    if (b->blob_count == BUILDER_MAX || digest_of(&blob.digest, data, size_bytes) != STATUS_OK)
        die("blob", NULL);
    b->blobs[b->blob_count].digest = blob.digest;
    b->blobs[b->blob_count].data = data;
    b->blobs[b->blob_count].size_bytes = size_bytes;
    b->blob_count++;
    return blob;
}

static void bound(struct scene_mesh *mesh, const float *positions, uint32_t vertex_count)
{
    for (int a = 0; a < 3; a++) {
        mesh->bounds_min[a] = INFINITY;
        mesh->bounds_max[a] = -INFINITY;
        for (uint32_t i = 0; i < vertex_count; i++) {
            mesh->bounds_min[a] = fminf(mesh->bounds_min[a], positions[3 * i + (uint32_t)a]);
            mesh->bounds_max[a] = fmaxf(mesh->bounds_max[a], positions[3 * i + (uint32_t)a]);
        }
    }
}

uint32_t builder_mesh(struct scene_builder *b, const float *positions, const float *normals, uint32_t vertex_count,
                      const uint32_t *indices, uint32_t triangle_count, int closed)
{
    struct scene_mesh *mesh = &b->scene.meshes[b->scene.mesh_count];
    struct scene_mesh_layout layout;
    uint8_t *data;

    mesh->name = "mesh";
    mesh->vertex_count = vertex_count;
    mesh->triangle_count = triangle_count;
    mesh->arrays = normals ? MESH_NORMALS : 0;
    mesh->closed = closed;
    bound(mesh, positions, vertex_count);
    scene_mesh_layout(mesh, &layout);
    data = need(mem_calloc(1, layout.total_bytes));
    memcpy(data + layout.positions, positions, 12u * vertex_count);
    if (normals)
        memcpy(data + layout.normals, normals, 12u * vertex_count);
    memcpy(data + layout.indices, indices, 12u * triangle_count);
    mesh->blob = add_blob(b, data, layout.total_bytes);
    return b->scene.mesh_count++;
}

uint32_t builder_mesh_mapped(struct scene_builder *b, const struct builder_mapped *from)
{
    struct scene_mesh *mesh = &b->scene.meshes[b->scene.mesh_count];
    struct scene_mesh_layout layout;
    uint32_t n = from->vertex_count;
    uint8_t *data;

    mesh->name = "mapped mesh";
    mesh->vertex_count = n;
    mesh->triangle_count = from->triangle_count;
    mesh->arrays = (from->normals ? MESH_NORMALS : 0) | (from->tangents ? MESH_TANGENTS : 0) |
                   (from->uv0 ? MESH_UV0 : 0) | (from->uv1 ? MESH_UV1 : 0) | (from->colors ? MESH_COLORS : 0);
    bound(mesh, from->positions, n);
    scene_mesh_layout(mesh, &layout);
    data = need(mem_calloc(1, layout.total_bytes));
#define PUT(array, bytes) \
    if (from->array)      \
        memcpy(data + layout.array, from->array, bytes * (size_t)n)
    PUT(positions, 12);
    PUT(normals, 12);
    PUT(tangents, 16);
    PUT(uv0, 8);
    PUT(uv1, 8);
    PUT(colors, 16);
#undef PUT
    memcpy(data + layout.indices, from->indices, 12u * from->triangle_count);
    mesh->blob = add_blob(b, data, layout.total_bytes);
    return b->scene.mesh_count++;
}

uint32_t builder_quads(struct scene_builder *b, const float (*quads)[4][3], uint32_t count)
{
    static const uint32_t two[6] = {0, 1, 2, 0, 2, 3};
    uint32_t *indices = need(mem_alloc_array(6 * (size_t)count, sizeof *indices)), mesh;

    for (uint32_t i = 0; i < 6 * count; i++)
        indices[i] = 4 * (i / 6) + two[i % 6];
    mesh = builder_mesh(b, &quads[0][0][0], NULL, 4 * count, indices, 2 * count, 0);
    mem_free(indices);
    return mesh;
}

uint32_t builder_mesh_deforming(struct scene_builder *b, const float *positions, uint32_t vertex_count,
                                const uint32_t *indices, uint32_t triangle_count,
                                const struct mesh_influence *influences, const float *morphs, uint32_t morph_count)
{
    return builder_mesh_deforming_smooth(b, positions, NULL, vertex_count, indices, triangle_count, influences, morphs,
                                         NULL, morph_count);
}

uint32_t builder_mesh_deforming_smooth(struct scene_builder *b, const float *positions, const float *normals,
                                       uint32_t vertex_count, const uint32_t *indices, uint32_t triangle_count,
                                       const struct mesh_influence *influences, const float *morphs,
                                       const float *morph_normals, uint32_t morph_count)
{
    struct scene_mesh *mesh = &b->scene.meshes[b->scene.mesh_count];
    struct scene_mesh_layout layout;
    uint8_t *data;

    mesh->name = "deforming mesh";
    mesh->vertex_count = vertex_count;
    mesh->triangle_count = triangle_count;
    mesh->arrays = (influences ? MESH_SKIN : 0) | (normals ? MESH_NORMALS : 0);
    mesh->morph_count = morph_count;
    bound(mesh, positions, vertex_count);
    scene_mesh_layout(mesh, &layout);
    data = need(mem_calloc(1, layout.total_bytes));
    memcpy(data + layout.positions, positions, 12u * vertex_count);
    if (normals)
        memcpy(data + layout.normals, normals, 12u * vertex_count);
    if (influences)
        memcpy(data + layout.skin, influences, sizeof *influences * vertex_count);
    for (uint32_t i = 0; i < morph_count; i++) {
        uint8_t *target = data + layout.morphs + i * layout.morph_stride;
        memcpy(target, morphs + (size_t)3 * vertex_count * i, 12u * vertex_count);
        if (normals)
            memcpy(target + 12u * vertex_count, morph_normals + (size_t)3 * vertex_count * i, 12u * vertex_count);
    }
    memcpy(data + layout.indices, indices, 12u * triangle_count);
    mesh->blob = add_blob(b, data, layout.total_bytes);
    return b->scene.mesh_count++;
}

uint32_t builder_node(struct scene_builder *b, int32_t parent, uint32_t weight_count)
{
    struct scene_node *node = &b->scene.nodes[b->scene.node_count];

    memset(node, 0, sizeof *node);
    node->parent = parent;
    node->rotation[3] = 1;
    node->scale[0] = node->scale[1] = node->scale[2] = 1;
    node->weight_count = weight_count;
    node->weights = need(arena_alloc(&b->scene.arena, weight_count + 1, sizeof *node->weights));
    return b->scene.node_count++;
}

void builder_channel(struct scene_builder *b, uint32_t node, enum scene_channel_path path, uint32_t key_count,
                     const float *times, const float *values)
{
    struct scene_channel *c = &b->scene.channels[b->scene.channel_count++];

    c->node = node;
    c->path = path;
    c->interpolation = INTERPOLATE_LINEAR;
    c->key_count = key_count;
    c->components = path == PATH_WEIGHTS    ? b->scene.nodes[node].weight_count
                    : path == PATH_ROTATION ? 4
                                            : 3;
    c->times = need(arena_alloc(&b->scene.arena, key_count, sizeof *c->times));
    memcpy(c->times, times, key_count * sizeof *times);
    c->values = need(arena_alloc(&b->scene.arena, (size_t)key_count * c->components, sizeof *values));
    memcpy(c->values, values, (size_t)key_count * c->components * sizeof *values);
}

int32_t builder_skin(struct scene_builder *b, const uint32_t *joints, uint32_t joint_count)
{
    struct scene_skin *skin = &b->scene.skins[b->scene.skin_count];

    skin->joint_count = joint_count;
    skin->joints = need(arena_alloc(&b->scene.arena, joint_count, sizeof *joints));
    skin->inverse_bind = need(arena_alloc(&b->scene.arena, joint_count, sizeof *skin->inverse_bind));
    memcpy(skin->joints, joints, joint_count * sizeof *joints);
    for (uint32_t i = 0; i < joint_count; i++)
        skin->inverse_bind[i] = (struct transform_stored){{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
    return (int32_t)b->scene.skin_count++;
}

uint32_t builder_quad(struct scene_builder *b)
{
    static const float positions[12] = {-1, 0, -1, -1, 0, 1, 1, 0, 1, 1, 0, -1};
    static const uint32_t indices[6] = {0, 1, 2, 0, 2, 3};

    return builder_mesh(b, positions, NULL, 4, indices, 2, 0);
}

uint32_t builder_slab(struct scene_builder *b)
{
    static const float positions[24] = {-1, -1, -1, 1, -1, -1, 1, -1, 1, -1, -1, 1,
                                        -1, 1,  -1, 1, 1,  -1, 1, 1,  1, -1, 1,  1};
    static const uint32_t indices[12] = {0, 1, 2, 0, 2, 3, 4, 6, 5, 4, 7, 6};

    return builder_mesh(b, positions, NULL, 8, indices, 4, 0);
}

uint32_t builder_sphere(struct scene_builder *b, uint32_t segments, int smooth)
{
    uint32_t rows = segments, columns = 2 * segments, vertex = 0, triangle = 0;
    float *positions = need(mem_calloc((size_t)(rows + 1) * columns, 12));
    uint32_t *indices = need(mem_calloc((size_t)rows * columns * 2, 12)), mesh;

    for (uint32_t r = 0; r <= rows; r++)
        for (uint32_t c = 0; c < columns; c++, vertex++) {
            double theta = M_PI * r / rows, phi = 2 * M_PI * c / columns;
            double s = r == 0 || r == rows ? 0 : sin(theta);
            positions[3 * vertex] = (float)(s * cos(phi));
            positions[3 * vertex + 1] = (float)(r == 0 ? 1 : r == rows ? -1 : cos(theta));
            positions[3 * vertex + 2] = (float)(s * sin(phi));
        }
    for (uint32_t r = 0; r < rows; r++)
        for (uint32_t c = 0; c < columns; c++) {
            uint32_t next = (c + 1) % columns;
            uint32_t a = r * columns + c, d = r * columns + next;
            uint32_t e = (r + 1) * columns + c, f = (r + 1) * columns + next;
            if (r > 0) {
                memcpy(indices + 3 * triangle++, (uint32_t[]){a, d, f}, 12);
            }
            if (r < rows - 1) {
                memcpy(indices + 3 * triangle++, (uint32_t[]){a, f, e}, 12);
            }
        }
    mesh = builder_mesh(b, positions, smooth ? positions : NULL, vertex, indices, triangle, 1);
    mem_free(positions);
    mem_free(indices);
    return mesh;
}

struct scene_material *builder_lambert(struct scene_builder *b, float albedo)
{
    struct scene_material *m = &b->scene.materials[b->scene.material_count++];

    scene_material_default(m);
    m->name = "material";
    m->double_sided = 1;
    m->metallic = 0;
    m->roughness = 1;
    m->specular = 0;
    m->base_color[0] = m->base_color[1] = m->base_color[2] = albedo;
    return m;
}

uint32_t builder_last_material(const struct scene_builder *b) { return b->scene.material_count - 1; }

struct scene_instance *builder_place(struct scene_builder *b, uint32_t mesh, uint32_t material, struct vec3 scale,
                                     struct vec3 translate)
{
    struct scene_instance *i = &b->scene.instances[b->scene.instance_count++];

    scene_instance_default(i);
    i->name = "instance";
    i->mesh = mesh;
    i->material = material;
    i->to_world = (struct transform_d){{{scale.x, 0, 0, translate.x},
                                      {0, scale.y, 0, translate.y},
                                      {0, 0, scale.z, translate.z}}};
    return i;
}

struct scene_light *builder_light(struct scene_builder *b, enum scene_light_kind kind)
{
    struct scene_light *l = &b->scene.lights[b->scene.light_count++];

    scene_light_default(l);
    l->direction[2] = 0;
    l->name = "light";
    l->kind = kind;
    l->direction[1] = -1;
    l->outer_cone_rad = (float)(M_PI / 4);
    return l;
}

void builder_camera(struct scene_builder *b, struct vec3 eye, struct vec3 target, float yfov_rad)
{
    struct scene_camera *c = &b->scene.cameras[b->scene.camera_count++];
    struct vec3 z = vec3_normalize(vec3_sub(eye, target)), up = {0, 1, 0}, x, y;

    scene_camera_default(c);
    if (fabsf(z.y) > 0.999f)
        up = vec3_make(0, 0, -1);
    x = vec3_normalize(vec3_cross(up, z));
    y = vec3_cross(z, x);
    c->name = "camera";
    c->kind = CAMERA_PERSPECTIVE;
    c->yfov_rad = yfov_rad;
    c->xmag = c->ymag = 1;
    c->to_world = (struct transform_d){{{x.x, y.x, z.x, eye.x}, {x.y, y.y, z.y, eye.y}, {x.z, y.z, z.z, eye.z}}};
}

void builder_environment_constant(struct scene_builder *b, struct vec3 radiance)
{
    b->scene.environment.present = 1;
    b->scene.environment.constant = 1;
    b->scene.environment.radiance[0] = radiance.x;
    b->scene.environment.radiance[1] = radiance.y;
    b->scene.environment.radiance[2] = radiance.z;
}

void builder_room(struct scene_builder *b, void (*dress)(struct scene_builder *b, struct scene_material *ball))
{
    struct scene_material *m;
    uint32_t quad, ball, material;

    builder_init(b);
    quad = builder_quad(b);
    ball = builder_sphere(b, 12, 1);
    builder_lambert(b, 0.6f);
    builder_place(b, quad, builder_last_material(b), vec3_splat(4), vec3_make(0, -1, 0));
    m = builder_lambert(b, 0);
    m->emission[0] = m->emission[1] = m->emission[2] = 5;
    builder_place(b, quad, builder_last_material(b), vec3_make(1, -1, 1), vec3_make(1, 3, 0));
    m = builder_lambert(b, 0.7f);
    material = builder_last_material(b);
    builder_place(b, ball, material, vec3_splat(1), vec3_make(0, 0, 0));
    builder_camera(b, vec3_make(0, 1, 5), vec3_splat(0), 0.7f);
    builder_environment_constant(b, vec3_make(0.2f, 0.3f, 0.4f));
    if (dress)
        dress(b, m);
}

void builder_windowed_room(struct scene_builder *b)
{
    enum { QUADS = 9 };
    const float x0 = -2, x1 = 2, y0 = -1, y1 = 2, z0 = -2.5f, z1 = 4; /* the room */
    const float a0 = 0, a1 = 1, c0 = -1, c1 = 0;                      /* the window's y and z */
    const float quads[QUADS][4][3] = {
        {{x0, y0, z0}, {x0, y0, z1}, {x1, y0, z1}, {x1, y0, z0}}, {{x0, y1, z0}, {x1, y1, z0}, {x1, y1, z1}, {x0, y1, z1}},
        {{x0, y0, z0}, {x1, y0, z0}, {x1, y1, z0}, {x0, y1, z0}}, {{x0, y0, z1}, {x0, y1, z1}, {x1, y1, z1}, {x1, y0, z1}},
        {{x1, y0, z0}, {x1, y0, z1}, {x1, y1, z1}, {x1, y1, z0}}, {{x0, y0, z0}, {x0, a0, z0}, {x0, a0, z1}, {x0, y0, z1}},
        {{x0, a1, z0}, {x0, y1, z0}, {x0, y1, z1}, {x0, a1, z1}}, {{x0, a0, z0}, {x0, a1, z0}, {x0, a1, c0}, {x0, a0, c0}},
        {{x0, a0, c1}, {x0, a1, c1}, {x0, a1, z1}, {x0, a0, z1}},
    };
    uint32_t walls, ball;

    builder_init(b);
    walls = builder_quads(b, quads, QUADS);
    ball = builder_sphere(b, 12, 1);
    builder_lambert(b, 0.6f);
    builder_place(b, walls, builder_last_material(b), vec3_splat(1), vec3_make(0, 0, 0));
    builder_lambert(b, 0.7f);
    builder_place(b, ball, builder_last_material(b), vec3_splat(0.6f), vec3_make(0.4f, -0.4f, -0.5f));
    builder_camera(b, vec3_make(0, 0.5f, 3.8f), vec3_make(0, 0.2f, 0), 0.9f);
}

static void add_lamp(struct scene_builder *b, uint32_t mesh, float radiance, struct vec3 scale, struct vec3 place)
{
    struct scene_material *m = builder_lambert(b, 0);

    m->emission[0] = m->emission[1] = m->emission[2] = radiance;
    builder_place(b, mesh, builder_last_material(b), scale, place);
}

void builder_lamp_rooms(struct scene_builder *b)
{
    enum { ROOMS = 3, OUTER = 6, WALL = 3 };
    const float x0 = -2, x1 = -2 + 4 * ROOMS, y0 = -1, y1 = 2, z0 = -2.5f, z1 = 4;
    float quads[OUTER + WALL * (ROOMS - 1)][4][3] = {
        {{x0, y0, z0}, {x0, y0, z1}, {x1, y0, z1}, {x1, y0, z0}}, {{x0, y1, z0}, {x1, y1, z0}, {x1, y1, z1}, {x0, y1, z1}},
        {{x0, y0, z0}, {x1, y0, z0}, {x1, y1, z0}, {x0, y1, z0}}, {{x0, y0, z1}, {x0, y1, z1}, {x1, y1, z1}, {x1, y0, z1}},
        {{x1, y0, z0}, {x1, y0, z1}, {x1, y1, z1}, {x1, y1, z0}}, {{x0, y0, z0}, {x0, y1, z0}, {x0, y1, z1}, {x0, y0, z1}},
    };
    uint32_t walls, quad, ball;

    builder_init(b);
    for (int i = 1; i < ROOMS; i++) {
        const float x = x0 + 4 * (float)i, door0 = 1.6f, door1 = 2.6f, top = 1;
        const float wall[WALL][4][3] = {{{x, y0, z0}, {x, y0, door0}, {x, y1, door0}, {x, y1, z0}},
                                        {{x, y0, door1}, {x, y0, z1}, {x, y1, z1}, {x, y1, door1}},
                                        {{x, top, door0}, {x, top, door1}, {x, y1, door1}, {x, y1, door0}}};
        memcpy(quads[OUTER + WALL * (i - 1)], wall, sizeof wall);
    }
    walls = builder_quads(b, (const float(*)[4][3])quads, OUTER + WALL * (ROOMS - 1));
    quad = builder_quad(b);
    ball = builder_sphere(b, 12, 1);
    builder_lambert(b, 0.6f);
    builder_place(b, walls, builder_last_material(b), vec3_splat(1), vec3_make(0, 0, 0));
    builder_lambert(b, 0.7f);
    builder_place(b, ball, builder_last_material(b), vec3_splat(0.6f), vec3_make(0.4f, -0.4f, -0.5f));
    for (int i = 0; i < ROOMS; i++) {
        const float x = 4 * (float)i, bright = i == 0 ? 1 : 8;
        struct scene_light *light = builder_light(b, LIGHT_POINT);

        for (int k = 0; k < 4; k++)
            add_lamp(b, quad, 30 * bright, vec3_make(0.1f, -1, 0.1f),
                     vec3_make(x + (k % 2 ? 1 : -1.2f), 1.95f, k / 2 ? 2.8f : -0.9f));
        add_lamp(b, ball, 6 * bright, vec3_splat(0.15f), vec3_make(x + 1.4f, -0.7f, -2));
        light->position[0] = x - 1;
        light->position[1] = 1.2f;
        light->position[2] = -2;
        for (int c = 0; c < 3; c++)
            light->intensity[c] = bright;
    }
    builder_camera(b, vec3_make(0, 0.5f, 3.8f), vec3_make(0, 0.2f, 0), 0.9f);
}

static struct scene_blob add_exr(struct scene_builder *b, const float *rgb, uint32_t width, uint32_t height)
{
    struct image image = {width, height, 3, NULL};
    struct exr_options options = {0};
    struct buffer out = BUFFER_INIT;
    struct error err = {0};

    image.pixels = need(mem_memdup(rgb, sizeof(float) * 3 * width * height));
    if (exr_encode(&out, &image, &options, &err) != STATUS_OK)
        die("image", &err);
    image_release(&image);
    return add_blob(b, out.data, out.size);
}

void builder_environment_map(struct scene_builder *b, const float *rgb, uint32_t width, uint32_t height)
{
    b->scene.environment.present = 1;
    b->scene.environment.constant = 0;
    b->scene.environment.image.name = "map";
    b->scene.environment.image.blob = add_exr(b, rgb, width, height);
}

struct scene_medium *builder_medium(struct scene_builder *b)
{
    struct scene_medium *medium = &b->scene.media[b->scene.medium_count++];

    scene_medium_default(medium);
    medium->name = "medium";
    return medium;
}

void builder_grid(struct scene_builder *b, struct scene_medium *medium, const float *density, const uint32_t size[3],
                  struct vec3 low, struct vec3 high)
{
    size_t bytes = sizeof *density * size[0] * size[1] * size[2];

    medium->has_grid = 1;
    memcpy(medium->grid_size, size, sizeof medium->grid_size);
    medium->grid = add_blob(b, need(mem_memdup(density, bytes)), bytes);
    medium->grid_to_world = (struct transform_d){{{high.x - low.x, 0, 0, low.x},
                                                {0, high.y - low.y, 0, low.y},
                                                {0, 0, high.z - low.z, low.z}}};
}

uint32_t builder_texture(struct scene_builder *b, const float *rgb, uint32_t width, uint32_t height)
{
    struct scene_image *image = &b->scene.images[b->scene.image_count];
    struct scene_texture *texture = &b->scene.textures[b->scene.texture_count];

    image->name = "image";
    image->blob = add_exr(b, rgb, width, height);
    texture->image = b->scene.image_count++;
    return b->scene.texture_count++;
}

static status find_blob(void *user, const struct digest *digest, const uint8_t **data, size_t *size_bytes,
                        struct error *err)
{
    struct scene_builder *b = user;

    for (size_t i = 0; i < b->blob_count; i++)
        if (digest_equal(&b->blobs[i].digest, digest)) {
            *data = b->blobs[i].data;
            *size_bytes = b->blobs[i].size_bytes;
            return STATUS_OK;
        }
    return error_set(err, STATUS_ERR_NOT_FOUND, "no such blob");
}

struct blob_source builder_source(struct scene_builder *b) { return (struct blob_source){find_blob, b}; }

struct render_scene *builder_build(struct scene_builder *b, const struct render_settings *settings)
{
    struct render_scene *out;
    struct error err = {0};

    if (scene_validate(&b->scene, &err) != STATUS_OK)
        die("validate", &err);
    if (render_scene_new(&out, &b->scene, settings, 0, builder_source(b), &err) != STATUS_OK)
        die("build", &err);
    return out;
}

struct render_settings builder_settings(uint32_t width, uint32_t height, uint32_t spp)
{
    struct render_settings s;

    render_settings_default(&s);
    s.width = width;
    s.height = height;
    s.spp = spp;
    if (!(isa_supported_mask() >> s.isa & 1))
        s.isa = ISA_SSE2;
    return s;
}

void builder_render(const struct render_scene *scene, const struct render_settings *settings, uint32_t frame,
                    double *mean, double *variance, struct render_stats *stats)
{
    groups_render(scene, settings, frame, mean, variance, stats);
}
