/* How much light a floor with a normal map sends out, in a white furnace. What a bent lobe sends
 * under the floor is lost (docs/NUMERICS.md, "Normal maps"): the shares are measured, not derived,
 * so the bounds keep them as they are. With --print it writes the table. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <cmocka.h>

#include "tests/support/gltf_maker.h"
#include "tests/support/imported.h"

/* Half the floor's side, metres; a period of the map is 1 m. */
#define HALF 20.0f
enum { SIDE = 32, SPP = 64, VIEWS = 4 };
static const double VIEW_COSINES[VIEWS] = {1, 0.7, 0.4, 0.2};

/* Cameras that look at the middle from 3 m, each at another cosine. */
static void put_cameras(struct buffer *out)
{
    buffer_puts(out, "\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"yfov\":0.3,"
                     "\"znear\":0.1}}],\"scenes\":[{\"nodes\":[0,1,2,3,4]}],"
                     "\"nodes\":[{\"mesh\":0}");
    for (int i = 0; i < VIEWS; i++) {
        double c = VIEW_COSINES[i], s = sqrt(1 - c * c); /* columns x, up, back, place */
        buffer_printf(out, ",{\"camera\":0,\"matrix\":[1,0,0,0,0,%.9f,%.9f,0,0,%.9f,%.9f,0,"
                           "0.1,%.9f,%.9f,1]}", c, s, -s, c, -3 * s + 0.1, 3 * c);
    }
    buffer_puts(out, "],");
}

static void make_floor(struct import_result *import)
{
    static const float corners[12] = {-HALF, -HALF, 0, HALF, -HALF, 0, HALF, HALF, 0, -HALF, HALF, 0};
    static const float normals[12] = {0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1};
    static const float uv[8] = {0, 2 * HALF, 2 * HALF, 2 * HALF, 2 * HALF, 0, 0, 0};
    static const uint16_t indices[6] = {0, 1, 2, 0, 2, 3};
    struct maker m = {.bytes = BUFFER_INIT, .views = BUFFER_INIT, .accessors = BUFFER_INIT};
    struct buffer rest = BUFFER_INIT, text = BUFFER_INIT;
    struct error err = {0};

    put_floats(&m, "VEC3", corners, 12, 4);
    put_floats(&m, "VEC3", normals, 12, 4);
    put_floats(&m, "VEC2", uv, 8, 4);
    put_accessor(&m, put_view(&m, indices, sizeof indices, 0), "SCALAR", 5123, 6, "");
    put_cameras(&rest);
    buffer_puts(&rest, "\"materials\":[{\"normalTexture\":{\"index\":0}}],"
                       "\"images\":[{\"uri\":\"bumps.png\"}],\"textures\":[{\"source\":0}],"
                       "\"meshes\":[{\"primitives\":[{\"material\":0,\"indices\":3,\"attributes\":{"
                       "\"POSITION\":0,\"NORMAL\":1,\"TEXCOORD_0\":2}}]}]");
    maker_write(&m, buffer_text(&rest), &text);
    /* The importer gives a file without any light the furnace, and warns of it. */
    if (import_scene_memory(text.data, text.size, "floor.gltf", "scenes/features", &defaults, import, &err) !=
        STATUS_OK)
        fail_msg("%s", err.text);
    assert_true(import->scene.environment.constant);
    buffer_release(&rest);
    buffer_release(&text);
    maker_release(&m);
}

/* What the floor reads from one camera. roughness below 0: white Lambert, else white metal. */
static double floor_reading(struct import_result *import, double roughness, double scale, int view)
{
    static float picture[SIDE * SIDE * 3];
    struct render_settings settings = imported_settings(SIDE, SIDE, SPP);
    struct scene_material *m = &import->scene.materials[0];
    double sum = 0;

    m->metallic = roughness < 0 ? 0 : 1;
    m->specular = roughness < 0 ? 0 : 1;
    m->roughness = (float)fmax(roughness, 0);
    m->normal_scale = (float)scale;
    settings.camera = (uint32_t)view;
    settings.texture_filter = TEXTURE_FILTER_NEAREST;
    imported_render(import, &settings, 0, picture);
    for (int i = 0; i < SIDE * SIDE * 3; i++)
        sum += (double)picture[i];
    return sum / (SIDE * SIDE * 3);
}

static void print_table(void)
{
    static const double ROUGHNESSES[] = {-1, 0, 0.2, 0.5, 1}, SCALES[] = {0, 0.5, 1, 2, 4, 10};
    struct import_result import;

    make_floor(&import);
    for (int r = 0; r < 5; r++)
        for (int s = 0; s < 6; s++) {
            double sum = 0;
            printf("roughness %4.1f scale %4.1f:", ROUGHNESSES[r], SCALES[s]);
            for (int v = 0; v < VIEWS; v++) {
                double reading = floor_reading(&import, ROUGHNESSES[r], SCALES[s], v);
                printf("  %.3f", reading);
                sum += reading / VIEWS;
            }
            printf("  mean %.3f\n", sum);
            fflush(stdout);
        }
    import_result_release(&import);
}

/* What today's model sends out, white metal and Lambert, bumps.png: the mean over four cosines,
 * within the noise of 65,536 paths each and the changes of a few more. */
static void a_mapped_floor_keeps_what_is_stated(void **state)
{
    static const struct { double roughness, scale, reads; } FLOORS[] = {
        {-1, 0, 1}, {0.5, 0, 1}, {0, 1, 1}, {0, 10, 1},
        {-1, 1, 0.876}, {-1, 10, 0.635}, {0.2, 1, 0.812}, {0.2, 10, 0.611},
        {0.5, 1, 0.863}, {0.5, 10, 0.738}, {1, 1, 0.905}, {1, 10, 0.849},
    };
    struct import_result import;

    (void)state;
    make_floor(&import);
    for (size_t i = 0; i < sizeof FLOORS / sizeof *FLOORS; i++) {
        double sum = 0;
        for (int v = 0; v < VIEWS; v++)
            sum += floor_reading(&import, FLOORS[i].roughness, FLOORS[i].scale, v) / VIEWS;
        if (fabs(sum - FLOORS[i].reads) > 0.005)
            fail_msg("roughness %g scale %g: reads %.4f, should be %.4f", FLOORS[i].roughness, FLOORS[i].scale, sum,
                     FLOORS[i].reads);
    }
    import_result_release(&import);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(a_mapped_floor_keeps_what_is_stated)};

    if (argc > 1 && strcmp(argv[1], "--print") == 0) {
        print_table();
        return 0;
    }
    return cmocka_run_group_tests_name("normal_maps", tests, NULL, NULL);
}
