/* What the job options mean for a scene: defaults that its camera and its motion decide. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "client/options/job_options.h"
#include "common/scene/effects.h"

/* A camera that may follow a node, which may move. */
struct stage {
    struct scene scene;
    struct scene_camera camera;
    struct scene_node node;
    struct scene_channel channel;
    float times[2], values[6];
    struct job_options options;
    struct job_request request;
};

static void stage_set(struct stage *s)
{
    const struct job_options plain = JOB_OPTIONS_INIT;

    memset(s, 0, sizeof *s);
    scene_init(&s->scene);
    scene_camera_default(&s->camera);
    scene_node_default(&s->node);
    s->times[1] = s->values[5] = 1;
    s->channel = (struct scene_channel){.path = PATH_TRANSLATION,
                                        .interpolation = INTERPOLATE_LINEAR,
                                        .key_count = 2,
                                        .components = 3,
                                        .times = s->times,
                                        .values = s->values};
    s->scene.cameras = &s->camera;
    s->scene.camera_count = 1;
    s->scene.nodes = &s->node;
    s->scene.node_count = 1;
    s->scene.channels = &s->channel;
    s->options = plain;
}

static status complete(struct stage *s, struct error *err)
{
    status result = scene_validate(&s->scene, err);

    if (result == STATUS_OK)
        result = job_options_check(&s->options, &s->request, err);
    return result == STATUS_OK ? job_request_complete(&s->request, &s->options, &s->scene, err) : result;
}

static void plain(void **state)
{
    char text[SETTINGS_CHOICES_TEXT_SIZE];
    struct render_settings defaults;
    struct error err = {0};
    struct stage s;

    (void)state;
    stage_set(&s);
    render_settings_default(&defaults);
    assert_int_equal(complete(&s, &err), STATUS_OK);
    assert_true(render_settings_equal(&s.request.settings, &defaults));
    assert_string_equal(settings_choices_text(&defaults, text), "");
    assert_true(s.request.output.tonemap.exposure_ev == 0);
}

static void every_setting(void **state)
{
    char text[SETTINGS_CHOICES_TEXT_SIZE];
    const struct render_settings *r;
    struct error err = {0};
    struct stage s;

    (void)state;
    stage_set(&s);
    s.options.said[SETTING_fps].text = "30";
    s.options.said[SETTING_shutter].text = "0.5";
    s.options.said[SETTING_lens_radius].text = "0.25";
    s.options.said[SETTING_focus_distance].text = "3";
    s.options.said[SETTING_without].list.items[0] = "caustics,fog";
    s.options.said[SETTING_without].list.items[1] = "sheen";
    s.options.said[SETTING_without].list.count = 2;
    s.options.said[SETTING_aovs].list.items[0] = "depth";
    s.options.said[SETTING_aovs].list.items[1] = "uv,error";
    s.options.said[SETTING_aovs].list.count = 2;
    s.options.said[SETTING_env_sampling].text = "importance-only";
    s.options.said[SETTING_exr_names].text = "blender";
    s.options.said[SETTING_sampler].text = "independent";
    s.options.said[SETTING_light_choice].text = "power";
    s.options.said[SETTING_no_roulette].text = "off";
    s.options.said[SETTING_clamp].text = "2.5";
    s.options.said[SETTING_texture_filter].text = "bilinear";
    s.options.said[SETTING_bvh_quality].text = "high";
    s.options.said[SETTING_not_robust].text = "off";
    assert_int_equal(complete(&s, &err), STATUS_OK);
    r = &s.request.settings;
    assert_true(r->fps == 30 && r->shutter == 0.5f && r->lens_radius == 0.25f);
    assert_true(r->focus_distance == 3);
    assert_true(r->without == (EFFECT_CAUSTICS | EFFECT_FOG | EFFECT_SHEEN));
    assert_int_equal(r->aovs, 1u << AOV_DEPTH | 1u << AOV_UV | 1u << AOV_ERROR);
    assert_true(r->env_sampling == ENV_SAMPLING_IMPORTANCE_ONLY && r->sampler == SAMPLER_INDEPENDENT);
    assert_true(r->light_choice == LIGHT_CHOICE_POWER && r->no_roulette && r->clamp == 2.5f);
    assert_true(r->texture_filter == TEXTURE_FILTER_BILINEAR && r->not_robust);
    assert_true(r->bvh_quality == BVH_QUALITY_HIGH);
    assert_string_equal(settings_choices_text(r, text),
                        "EXR names blender, sampler independent, light choice power, roulette off, clamp 2.5, "
                        "texture filter bilinear, BVH quality high, robust off");
    s.options.said[SETTING_not_robust].text = "on"; /* Embree would build the same trees as for medium */
    assert_int_equal(complete(&s, &err), STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, "--robust off"));
}

static void frames(void **state)
{
    struct error err = {0};
    struct stage s;

    (void)state;
    stage_set(&s);
    assert_int_equal(complete(&s, &err), STATUS_OK);
    assert_int_equal(s.request.first_frame, 1);
    s.scene.channel_count = 1; /* a node moves that nothing follows */
    assert_int_equal(complete(&s, &err), STATUS_OK);
    assert_int_equal(s.request.first_frame, 1);
    s.camera.node = 0;
    assert_int_equal(complete(&s, &err), STATUS_OK);
    assert_int_equal(s.request.first_frame, 0);
    assert_int_equal(s.request.last_frame, 0);
    s.options.frames.list = "5-7";
    assert_int_equal(complete(&s, &err), STATUS_OK);
    assert_int_equal(s.request.first_frame, 5);
    assert_int_equal(s.request.last_frame, 7);
}

static void exposure(void **state)
{
    struct error err = {0};
    struct stage s;

    (void)state;
    stage_set(&s);
    s.camera.exposure_ev = -3.5f;
    s.options.output.tone.said[LOOK_exposure_ev].text = "1.25";
    assert_int_equal(complete(&s, &err), STATUS_OK);
    assert_true(s.request.output.tonemap.exposure_ev == -2.25 && s.request.output.camera_ev == -3.5);
}

static void lens(void **state)
{
    struct error err = {0};
    struct stage s;

    (void)state;
    stage_set(&s);
    s.options.said[SETTING_lens_radius].text = "0.01";
    assert_int_equal(complete(&s, &err), STATUS_ERR_USAGE);
    assert_non_null(strstr(err.text, "--focus"));
    s.camera.focus_distance = 2;
    assert_int_equal(complete(&s, &err), STATUS_OK);
    s.camera.kind = CAMERA_PANORAMA;
    assert_int_equal(complete(&s, &err), STATUS_ERR_USAGE);
    assert_non_null(strstr(err.text, "panorama"));
    s.options.said[SETTING_lens_radius].text = "0";
    assert_int_equal(complete(&s, &err), STATUS_OK);
}

/* The picture fits, in its own proportions; what fits already stays; a region is what fits. */
static void fit(void **state)
{
    static const struct {
        const char *size, *region, *fit;
        uint32_t whole[2], rect[4]; /* width 0: all */
    } cases[] = {
        {"1920x1080", NULL, "320x320", {320, 180}, {0}},
        {"1080x1920", NULL, "320x320", {180, 320}, {0}},
        {"1000x1000", NULL, "320x200", {200, 200}, {0}},
        {"640x480", NULL, "640x480", {640, 480}, {0}},
        {"64x48", NULL, "320x320", {64, 48}, {0}},
        {"65536x1", NULL, "16x16", {16, 1}, {0}},
        {"3x3", NULL, "2x2", {2, 2}, {0}},
        {"1000x500", "500,250,500,250", "100x100", {200, 100}, {100, 50, 100, 50}},
        {"1000x500", "500,250,100,50", "100x100", {1000, 500}, {500, 250, 100, 50}},
        {"1000x500", "0,0,1000,500", "100x100", {100, 50}, {0}},
        {"65536x1", "65535,0,1,1", "1x1", {65536, 1}, {65535, 0, 1, 1}},
        {"1001x3", "999,2,2,1", "1x1", {501, 2}, {500, 1, 1, 1}},
    };
    struct error err = {0};
    struct stage s;

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const struct render_settings *r = &s.request.settings;
        const uint32_t *rect = cases[i].rect, *whole = cases[i].whole;
        stage_set(&s);
        s.options.size = cases[i].size;
        s.options.region = cases[i].region;
        s.options.fit = cases[i].fit;
        assert_int_equal(complete(&s, &err), STATUS_OK);
        assert_int_equal(job_request_crop(&s.request, &err), STATUS_OK);
        assert_int_equal(rect[2] ? r->whole_width : r->width, whole[0]);
        assert_int_equal(rect[2] ? r->whole_height : r->height, whole[1]);
        assert_int_equal(r->whole_width != 0, rect[2] != 0);
        assert_true(!rect[2] || (r->region_x == rect[0] && r->region_y == rect[1] && r->width == rect[2] && r->height == rect[3]));
        assert_int_equal(render_settings_validate(r, 1, &err), STATUS_OK);
    }
    s.options.fit = "320";
    assert_int_equal(complete(&s, &err), STATUS_ERR_USAGE);
    assert_non_null(strstr(err.text, "--fit"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(plain),    cmocka_unit_test(every_setting), cmocka_unit_test(frames),
        cmocka_unit_test(exposure), cmocka_unit_test(lens),          cmocka_unit_test(fit),
    };
    return cmocka_run_group_tests_name("job_options", tests, NULL, NULL);
}
