/* Views against closed forms: what a camera's movement moves on its screen. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <string.h>

#include "coordinator/pictures/view.h"
#include "tests/support/scene_sample.h"

enum { SIDE = 100, PIXELS = SIDE * SIDE, FPS = 24, SECOND = FPS };

/* A camera at the origin that looks along -z, 90 degrees wide, and moves by (x, y, z) within a second, as two instances
 * may; a third stands. */
enum { NODES = 3, INSTANCES = 3 };
struct stage {
    struct scene scene;
    struct scene_node nodes[NODES]; /* of the camera, of the first two instances */
    struct scene_camera camera;
    struct scene_instance instances[INSTANCES];
    struct scene_mesh mesh;
    struct scene_channel channel;
    struct render_settings settings;
    float times[2], places[6];
};

static void stage_set(struct stage *s, float x, float y, float z)
{
    memset(s, 0, sizeof *s);
    scene_init(&s->scene);
    for (int i = 0; i < NODES; i++)
        scene_node_default(&s->nodes[i]);
    for (int i = 0; i < INSTANCES; i++) {
        scene_instance_default(&s->instances[i]);
        s->instances[i].node = i < 2 ? i + 1 : -1;
    }
    scene_camera_default(&s->camera);
    render_settings_default(&s->settings);
    s->settings.width = s->settings.height = SIDE;
    s->settings.fps = FPS;
    s->camera.kind = CAMERA_PERSPECTIVE;
    s->camera.yfov_rad = (float)(3.14159265358979 / 2);
    s->camera.node = 0;
    s->times[1] = 1;
    memcpy(s->places + 3, (float[3]){x, y, z}, 3 * sizeof(float));
    s->channel = (struct scene_channel){0, PATH_TRANSLATION, INTERPOLATE_LINEAR, 2, 3, s->times, s->places};
    s->scene.nodes = s->nodes;
    s->scene.instances = s->instances;
    s->scene.meshes = &s->mesh;
    s->scene.mesh_count = 1;
    s->scene.instance_count = INSTANCES;
    s->scene.node_count = NODES;
    s->scene.cameras = &s->camera;
    s->scene.channels = &s->channel;
    s->scene.camera_count = s->scene.channel_count = 1;
}

static struct scene_way way_of(const struct stage *s, uint32_t from, uint32_t to)
{
    struct scene_way way;
    struct error err = {0};

    if (scene_way_find(&s->scene, &s->settings, from, to, &way, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    return way;
}

static void follow(const struct stage *s, const float *positions, const float *objects, int32_t *source)
{
    struct scene_way way = way_of(s, 0, SECOND);

    assert_true(scene_way_is_known(&way));
    scene_way_follow(&way, &s->settings, positions, objects, source);
    scene_way_release(&way);
}

/* A wall across the view at this depth (of the first frame): where each pixel's middle shows it. */
static void wall(float depth, int orthographic, float positions[3 * PIXELS])
{
    for (int p = 0; p < PIXELS; p++) {
        const float u = ((float)(p % SIDE) + 0.5f) / (SIDE / 2) - 1, v = ((float)(p / SIDE) + 0.5f) / (SIDE / 2) - 1;
        positions[p] = orthographic ? u : u * depth;
        positions[PIXELS + p] = orthographic ? -v : -v * depth;
        positions[2 * PIXELS + p] = -depth;
    }
}

/* Every pixel is found so far to the right and down; what leaves the picture is not. */
static void assert_moves(const struct stage *s, const float *positions, int right, int down)
{
    static int32_t source[PIXELS];
    const int width = (int)s->settings.width, height = (int)s->settings.height;

    follow(s, positions, NULL, source);
    for (int p = 0; p < width * height; p++) {
        const int x = p % width + right, y = p / width + down;
        const int expected = x >= 0 && y >= 0 && x < width && y < height ? y * width + x : -1;
        if (source[p] != expected)
            fail_msg("pixel (%d, %d): %d instead of %d", p % width, p / width, source[p], expected);
    }
}

static void what_stands_moves_against_the_camera(void **state)
{
    static float positions[3 * PIXELS];
    struct stage s;

    (void)state;
    wall(5, 0, positions);
    stage_set(&s, 1, 0, 0); /* 1 m at 5 m, of 10 m that are seen */
    assert_moves(&s, positions, -10, 0);
    stage_set(&s, 0, 0.5f, 0);
    assert_moves(&s, positions, 0, 5);
    stage_set(&s, 0.04f, 0, 0); /* less than half a pixel */
    assert_moves(&s, positions, 0, 0);
    s.camera.kind = CAMERA_ORTHOGRAPHIC;
    s.camera.xmag = s.camera.ymag = 1;
    s.places[3] = 0.4f;
    wall(5, 1, positions);
    assert_moves(&s, positions, -20, 0);
}

/* A region's pixels are those of the whole picture. */
static void a_region_moves_as_its_whole_picture(void **state)
{
    static float whole[3 * PIXELS], part[3 * 40 * 30];
    struct stage s;

    (void)state;
    wall(5, 0, whole);
    stage_set(&s, 1, 0.5f, 0);
    s.settings.whole_width = s.settings.whole_height = SIDE;
    s.settings.region_x = 50;
    s.settings.region_y = 20;
    s.settings.width = 40;
    s.settings.height = 30;
    for (int p = 0; p < 40 * 30; p++)
        for (int c = 0; c < 3; c++)
            part[c * 40 * 30 + p] = whole[c * PIXELS + (20 + p / 40) * SIDE + 50 + p % 40];
    assert_moves(&s, part, -10, 5);
}

static void what_is_passed_is_nowhere(void **state)
{
    static float positions[3 * PIXELS];
    static int32_t source[PIXELS];
    struct stage s;

    (void)state;
    wall(5, 0, positions);
    stage_set(&s, 0, 0, -4); /* forward: what was 4 pixels off the middle is 20 pixels off */
    follow(&s, positions, NULL, source);
    assert_int_equal(source[50 * SIDE + 54], 52 * SIDE + 72); /* 54.5 -> 50 + 5 * 4.5; the line 50.5 -> 52.5 */
    assert_int_equal(source[0], -1);
    stage_set(&s, 0, 0, -6); /* through the wall */
    follow(&s, positions, NULL, source);
    for (int p = 0; p < PIXELS; p++)
        assert_int_equal(source[p], -1);
}

/* Of a wall whose left half moves, the right half does not; an instance that is hidden stays, as one that is not there. */
static void what_moves_by_itself_is_followed(void **state)
{
    static float positions[3 * PIXELS], objects[PIXELS];
    static int32_t source[PIXELS];
    struct scene_way way;
    struct stage s;

    (void)state;
    wall(5, 0, positions);
    for (int hidden = 0; hidden < 2; hidden++) {
        stage_set(&s, 1, 0.5f, 0);
        s.channel.node = 1;
        s.nodes[1].rotation[1] = 1; /* half a turn: that it stands askew changes nothing */
        s.nodes[1].rotation[3] = 0;
        if (hidden)
            memset(s.nodes[1].scale, 0, sizeof s.nodes[1].scale);
        way = way_of(&s, 0, SECOND);
        assert_true(scene_way_camera_stands(&way) && scene_way_is_known(&way) && scene_way_is_still(&way) == hidden);
        scene_way_release(&way);
        for (int object = 0; object <= INSTANCES + 1; object++) {
            for (int p = 0; p < PIXELS; p++)
                objects[p] = p % SIDE < SIDE / 2 ? (float)object : (float)INSTANCES;
            follow(&s, positions, objects, source);
            for (int p = 0; p < PIXELS; p++) {
                const int moves = object == 1 && !hidden && p % SIDE < SIDE / 2;
                const int x = p % SIDE + (moves ? 10 : 0), y = p / SIDE - (moves ? 5 : 0);
                const int expected = y >= 0 ? y * SIDE + x : -1;
                if (source[p] != expected)
                    fail_msg("object %d, pixel (%d, %d): %d instead of %d", object, p % SIDE, p / SIDE, source[p], expected);
            }
        }
    }
}

static void ways_are_still_where_nothing_moves(void **state)
{
    struct scene_way way;
    struct stage s;

    (void)state;
    stage_set(&s, 1, 0, 0);
    way = way_of(&s, 0, 0);
    assert_true(scene_way_is_still(&way));
    scene_way_release(&way);
    way = way_of(&s, 0, SECOND);
    assert_true(!scene_way_is_still(&way) && !scene_way_camera_stands(&way) && scene_way_is_known(&way));
    scene_way_release(&way);
    way = way_of(&s, 2 * SECOND, 3 * SECOND); /* the animation is over */
    assert_true(scene_way_is_still(&way));
    scene_way_release(&way);
    s.camera.kind = CAMERA_PANORAMA;
    way = way_of(&s, 0, 0);
    assert_true(way.here.has_camera && !way.here.has_screen && scene_way_is_still(&way) && scene_way_is_known(&way));
    scene_way_release(&way);
    way = way_of(&s, 0, SECOND);
    assert_true(!scene_way_is_still(&way) && !scene_way_is_known(&way));
    scene_way_release(&way);
    s.channel.node = 1; /* an object instead */
    way = way_of(&s, 0, SECOND);
    assert_true(!scene_way_is_still(&way) && scene_way_is_known(&way));
    scene_way_release(&way);
    s.channel.node = 0;
    s.scene.camera_count = 0;
    way = way_of(&s, 0, 0);
    assert_true(!way.here.has_camera && !scene_way_is_still(&way) && !scene_way_is_known(&way));
    scene_way_release(&way);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_stands_moves_against_the_camera),
        cmocka_unit_test(a_region_moves_as_its_whole_picture),
        cmocka_unit_test(what_is_passed_is_nowhere),
        cmocka_unit_test(what_moves_by_itself_is_followed),
        cmocka_unit_test(ways_are_still_where_nothing_moves),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
