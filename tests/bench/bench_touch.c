/* bench_touch: how long the search for faces that coincide takes (worker/render/scene/render_touch.h):
 * worst cases, each at one size and at four times as much. CPU time, the fastest of three. */
#include <stdio.h>
#include <stdlib.h>

#include "common/system/clock.h"
#include "common/base/memory.h"
#include "tests/support/scene_builder.h"
#include "worker/render/render_scene.h"
#include "worker/render/scene/render_touch.h"

static double seconds(struct render_scene *scene)
{
    double best = 1e30;

    for (int i = 0; i < 3; i++) {
        uint64_t start = clock_thread_cpu_ns();
        struct error err;
        double took;
        if (touch_find(scene, &err) != STATUS_OK) {
            fprintf(stderr, "bench_touch: %s\n", err.text);
            exit(1);
        }
        took = (double)(clock_thread_cpu_ns() - start) * 1e-9;
        best = took < best ? took : best;
    }
    return best;
}

static void report(struct render_scene *scene, const char *name, double *before)
{
    uint64_t triangles = 0, marked = 0;
    double took = seconds(scene);

    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct render_instance *instance = &scene->instances[i];
        uint32_t count = scene->meshes[instance->mesh].triangle_count;
        triangles += count;
        for (uint32_t t = 0; instance->touches && t < count; t++)
            marked += instance->touches[t];
    }
    printf("%-44s %9llu triangles, %9llu in contact, %6.3f s", name, (unsigned long long)triangles,
           (unsigned long long)marked, took);
    if (*before > 0)
        printf(", %.2f times as long", took / *before);
    printf("\n");
    *before = took;
    render_scene_free(scene);
}

/* ---- worst cases -------------------------------------------------------------------------- */

static uint32_t glass(struct scene_builder *b)
{
    struct scene_material *m = builder_lambert(b, 1);

    m->double_sided = 0;
    m->specular = m->transmission = 1;
    m->roughness = 0;
    m->refractive = 1;
    m->ior = 1.5f;
    return builder_last_material(b);
}

/* A square of `side` by `side` cells in one plane. */
static uint32_t sheet(struct scene_builder *b, uint32_t side)
{
    size_t corners = (size_t)(side + 1) * (side + 1);
    float *p = mem_alloc_array(3 * corners, sizeof *p);
    uint32_t *indices = mem_alloc_array(6 * (size_t)side * side, sizeof *indices), mesh, n = 0;

    if (!p || !indices)
        abort();
    for (size_t i = 0; i < corners; i++) {
        p[3 * i] = (float)(i % (side + 1));
        p[3 * i + 1] = 0;
        p[3 * i + 2] = (float)(i / (side + 1));
    }
    for (uint32_t z = 0; z < side; z++)
        for (uint32_t x = 0; x < side; x++) {
            uint32_t a = z * (side + 1) + x, c = a + side + 1;
            const uint32_t two[6] = {a, c, a + 1, a + 1, c, c + 1};
            for (int k = 0; k < 6; k++)
                indices[n++] = two[k];
        }
    mesh = builder_mesh(b, p, NULL, (uint32_t)corners, indices, n / 3, 0);
    mem_free(p);
    mem_free(indices);
    return mesh;
}

/* `count` small boxes, whole and apart, on the plane of 0, in one mesh. */
static uint32_t boxes(struct scene_builder *b, uint32_t count)
{
    static const uint32_t faces[36] = {0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4,
                                       2, 6, 7, 2, 7, 3, 0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5};
    float *p = mem_alloc_array(24 * (size_t)count, sizeof *p);
    uint32_t *indices = mem_alloc_array(36 * (size_t)count, sizeof *indices), mesh, side = 1;

    if (!p || !indices)
        abort();
    while (side * side < count)
        side++;
    for (uint32_t i = 0; i < count; i++) {
        for (uint32_t k = 0; k < 8; k++) {
            p[24 * i + 3 * k] = 2.0f * (float)(i % side) + (float)(k & 1);
            p[24 * i + 3 * k + 1] = (float)(k >> 1 & 1);
            p[24 * i + 3 * k + 2] = 2.0f * (float)(i / side) + (float)(k >> 2);
        }
        for (uint32_t k = 0; k < 36; k++)
            indices[36 * i + k] = 8 * i + faces[k];
    }
    mesh = builder_mesh(b, p, NULL, 8 * count, indices, 12 * count, 1);
    mem_free(p);
    mem_free(indices);
    return mesh;
}

static void one_sheet(struct scene_builder *b, uint32_t scale)
{
    builder_place(b, sheet(b, 350 * scale), glass(b), vec3_splat(1), vec3_splat(0));
}

static void two_sheets(struct scene_builder *b, uint32_t scale)
{
    uint32_t mesh = sheet(b, 250 * scale);

    builder_place(b, mesh, glass(b), vec3_splat(1), vec3_splat(0));
    builder_place(b, mesh, glass(b), vec3_splat(1), vec3_make(0.5f, 0, 0.25f));
}

static void boxes_on_ground(struct scene_builder *b, uint32_t scale)
{
    builder_place(b, boxes(b, 25000 * scale * scale), glass(b), vec3_splat(1), vec3_splat(0));
    builder_lambert(b, 1);
    builder_place(b, builder_quad(b), builder_last_material(b), vec3_splat(1e5f), vec3_splat(0));
}

/* Leaning sheets, each of whose boxes overlaps all others'. */
static void stack(struct scene_builder *b, uint32_t scale)
{
    uint32_t count = 50000 * scale * scale, material = glass(b), mesh;
    float *p = mem_alloc_array(9 * (size_t)count, sizeof *p);
    uint32_t *indices = mem_alloc_array(3 * (size_t)count, sizeof *indices);

    if (!p || !indices)
        abort();
    for (uint32_t i = 0; i < count; i++) {
        const float corner[9] = {0, 0, 0, 1, 1, 0, 0, 0, 1};
        for (uint32_t k = 0; k < 9; k++)
            p[9 * i + k] = corner[k] + (k % 3 == 1 ? (float)i * 1e-6f : 0);
        for (uint32_t k = 0; k < 3; k++)
            indices[3 * i + k] = 3 * i + k;
    }
    mesh = builder_mesh(b, p, NULL, 3 * count, indices, count, 0);
    builder_place(b, mesh, material, vec3_splat(1), vec3_splat(0));
    mem_free(p);
    mem_free(indices);
}

int main(void)
{
    static const struct {
        const char *name;
        void (*build)(struct scene_builder *b, uint32_t scale);
    } cases[] = {
        {"one sheet in a plane", one_sheet},
        {"two sheets in a plane", two_sheets},
        {"boxes on a ground of two triangles", boxes_on_ground},
        {"leaning sheets, all boxes overlap", stack},
    };
    struct render_settings settings = builder_settings(8, 8, 4);

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        double before = 0;
        for (uint32_t scale = 1; scale <= 2; scale++) {
            struct scene_builder b;
            builder_init(&b);
            cases[i].build(&b, scale);
            builder_camera(&b, vec3_make(0, 5, 0), vec3_splat(0), 0.5f);
            report(builder_build(&b, &settings), cases[i].name, &before);
            builder_release(&b);
        }
    }
    return 0;
}
