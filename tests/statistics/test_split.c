/* Volumes cut into several meshes look as they did whole: each triangle of a volume (or of what is
 * seen through by alpha) goes to one of three meshes at random, and no pixel may change, but for rays
 * that meet an edge or come so near to one that two triangles tie. Such pixels are counted.
 *
 * Scenes of our own, and all with volumes below AZULEJO_DATA where it names the data's folder. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/digest.h"
#include "common/base/memory.h"
#include "tests/support/imported.h"

enum { WIDTH = 48, HEIGHT = 36, SAMPLES = 4, PARTS = 3 };
/* So many pixels in a thousand may hold a ray that meets an edge. */
enum { EDGES_PER_MILLE = 2 };

static int is_cut(const struct scene *scene, const struct scene_instance *instance)
{
    const struct scene_material *m = &scene->materials[instance->material];

    if (instance->skin >= 0 || scene->meshes[instance->mesh].morph_count || m->emission[0] > 0 || m->emission[1] > 0 ||
        m->emission[2] > 0)
        return 0;
    return m->kind == MATERIAL_INTERFACE || m->alpha_mode == ALPHA_BLEND ||
           (m->kind == MATERIAL_SURFACE && m->refractive && m->transmission > 0);
}

static uint32_t random_below(uint64_t *state, uint32_t n)
{
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)((*state >> 33) % n);
}

/* The mesh with every triangle for which part[] says so; 0: there is none. */
static int add_part(struct import_result *import, const struct scene_mesh *mesh, const uint8_t *part, uint8_t number,
                    struct scene_mesh *out)
{
    const uint8_t *data = NULL;
    struct scene_mesh_layout from, to;
    size_t capacity = import->blob_count;
    uint8_t *bytes;
    uint32_t *indices;

    *out = *mesh;
    out->arrays &= ~(uint32_t)MESH_STAND_INS; /* its triangles, not the shape that they stand in for */
    out->triangle_count = 0;
    out->closed = 0;
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        out->triangle_count += part[t] == number;
    if (!out->triangle_count)
        return 0;
    for (size_t i = 0; i < import->blob_count; i++)
        if (digest_equal(&import->blobs[i].digest, &mesh->blob.digest))
            data = import->blobs[i].data;
    assert_non_null(data);
    scene_mesh_layout(mesh, &from);
    scene_mesh_layout(out, &to);
    bytes = mem_calloc(to.total_bytes, 1);
    assert_non_null(bytes);
    memcpy(bytes, data, from.indices);
    indices = (void *)(bytes + to.indices);
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        if (part[t] == number) {
            memcpy(indices, data + from.indices + 12 * (size_t)t, 12);
            indices += 3;
        }
    out->blob.size_bytes = to.total_bytes;
    assert_int_equal(digest_of(&out->blob.digest, bytes, to.total_bytes), STATUS_OK);
    assert_true(MEM_GROW(import->blobs, capacity, import->blob_count + 1));
    import->blobs[import->blob_count++] =
        (struct import_blob){.digest = out->blob.digest, .data = bytes, .size_bytes = to.total_bytes};
    return 1;
}

/* Cut into so many parts. Returns how many instances were cut. One part: each gets a mesh of its
 * own, so that it is placed as its parts are (render_place.c). */
static uint32_t cut(struct import_result *import, uint32_t parts)
{
    struct scene *scene = &import->scene;
    const uint32_t count = scene->instance_count, mesh_count = scene->mesh_count;
    struct scene_instance *instances = ARENA_ARRAY(&scene->arena, struct scene_instance, PARTS * (size_t)count);
    struct scene_mesh *meshes = ARENA_ARRAY(&scene->arena, struct scene_mesh, mesh_count + PARTS * (size_t)count);
    uint32_t done = 0;
    uint64_t state = 1;

    assert_true(instances && meshes);
    memcpy(meshes, scene->meshes, mesh_count * sizeof *meshes);
    scene->instance_count = 0;
    for (uint32_t i = 0; i < count; i++) {
        const struct scene_instance *instance = &scene->instances[i];
        const struct scene_mesh *mesh = &scene->meshes[instance->mesh];
        uint8_t *part;
        if (!is_cut(scene, instance)) {
            instances[scene->instance_count++] = *instance;
            continue;
        }
        part = mem_calloc(mesh->triangle_count, 1);
        assert_non_null(part);
        for (uint32_t t = 0; t < mesh->triangle_count; t++)
            part[t] = (uint8_t)random_below(&state, parts);
        for (uint8_t p = 0; p < parts; p++)
            if (add_part(import, mesh, part, p, &meshes[scene->mesh_count])) {
                instances[scene->instance_count] = *instance;
                instances[scene->instance_count++].mesh = scene->mesh_count++;
            }
        mem_free(part);
        done++;
    }
    scene->instances = instances;
    scene->meshes = meshes;
    return done;
}

/* Returns how many instances were cut. */
static uint32_t render_cut(const char *path, uint32_t parts, float *picture)
{
    struct render_settings settings = imported_settings(WIDTH, HEIGHT, SAMPLES);
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct import_result import;
    struct error err = {0};
    uint32_t instances;

    settings.max_depth = 16;
    if (import_scene(path, &options, &import, &err) != STATUS_OK) {
        print_error("%s\n", err.text);
        fail();
    }
    instances = cut(&import, parts);
    imported_render(&import, &settings, 0, picture);
    import_result_release(&import);
    return instances;
}

static void compare(const char *path)
{
    static float whole[HEIGHT * WIDTH * 3], parts[HEIGHT * WIDTH * 3];
    uint32_t changed = 0, instances = render_cut(path, 1, whole);

    render_cut(path, PARTS, parts);
    for (size_t i = 0; i < WIDTH * HEIGHT; i++)
        changed += memcmp(whole + 3 * i, parts + 3 * i, 3 * sizeof *whole) != 0;
    print_message("# %s: %u instances cut, %u of %d pixels changed\n", path, instances, changed, WIDTH * HEIGHT);
    assert_true(instances > 0);
    if (1000 * changed > EDGES_PER_MILLE * WIDTH * HEIGHT)
        fail();
}

static void test_own(void **state)
{
    static const char *const paths[] = {
        "scenes/features/absorption.gltf", "scenes/features/alpha.gltf",
        "scenes/features/glass.gltf",      "scenes/features/media.pbrt",
        "scenes/features/nested.gltf",     "scenes/liquids/water-contact.gltf",
        "scenes/liquids/wine.gltf",        "scenes/liquids/ice.gltf",
    };

    (void)state;
    for (size_t i = 0; i < sizeof paths / sizeof *paths; i++)
        compare(paths[i]);
}

static void test_data(void **state)
{
    static const char *const paths[] = {
        "gltf/AlphaBlendModeTest/AlphaBlendModeTest.glb",
        "gltf/AttenuationTest/AttenuationTest.gltf",
        "gltf/FlightHelmet/FlightHelmet.gltf",
        "gltf/GlassVaseFlowers/GlassVaseFlowers.glb",
        "gltf/IridescenceSuzanne/IridescenceSuzanne.glb",
        "gltf/IridescentDishWithOlives/IridescentDishWithOlives.gltf",
        "gltf/TransmissionRoughnessTest/TransmissionRoughnessTest.glb",
        "pbrt/bitterli-coffee/scene-v4.pbrt",
        "pbrt/bitterli-staircase2/scene-v4.pbrt",
        "pbrt/bitterli-volumetric-caustic/scene-v4.pbrt",
    };
    const char *folder = getenv("AZULEJO_DATA");
    char path[4096];

    (void)state;
    if (!folder || !*folder) {
        skip();
        return;
    }
    for (size_t i = 0; i < sizeof paths / sizeof *paths; i++) {
        snprintf(path, sizeof path, "%s/%s", folder, paths[i]);
        compare(path);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_own),
        cmocka_unit_test(test_data),
    };
    return cmocka_run_group_tests_name("split", tests, NULL, NULL);
}
