/* glTF: KHR_animation_pointer. A file whose value is animated is, in a frame, the file that has the frame's value. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <jansson.h>

#include "common/base/memory.h"
#include "common/scene/move.h"
#include "common/scene/pose.h"
#include "common/scene/scene_effects.h"
#include "common/scene/track.h"
#include "tests/support/gltf_maker.h"

/* Everything that a pointer may name; every texture has an effect and is no constant. */
#define TEXTURE(more) "{\"index\":0" more "}"
#define EXT(name, text) "\"KHR_materials_" name "\":{" text "}"
#define MATERIAL                                                                                                       \
    "{\"alphaMode\":\"BLEND\",\"pbrMetallicRoughness\":{\"metallicFactor\":0.5,\"baseColorFactor\":[1,1,1,0.5],"         \
    "\"baseColorTexture\":" TEXTURE() ",\"metallicRoughnessTexture\":" TEXTURE() "},\"emissiveFactor\":[1,1,1],"         \
    "\"normalTexture\":" TEXTURE() ",\"occlusionTexture\":" TEXTURE() ",\"emissiveTexture\":" TEXTURE() ",\"extensions\":{"          \
    EXT("emissive_strength", "\"emissiveStrength\":2") "," EXT("ior", "\"ior\":1.25") ","                               \
    EXT("specular", "\"specularFactor\":0.5,\"specularTexture\":" TEXTURE() ",\"specularColorTexture\":" TEXTURE()) ","  \
    EXT("transmission", "\"transmissionFactor\":0.5,\"transmissionTexture\":" TEXTURE()) ","                            \
    EXT("volume", "\"thicknessFactor\":1,\"attenuationDistance\":2,\"attenuationColor\":[0.5,0.5,0.5]") ","             \
    EXT("clearcoat", "\"clearcoatFactor\":0.5,\"clearcoatTexture\":" TEXTURE() ",\"clearcoatRoughnessFactor\":0.5,"      \
        "\"clearcoatRoughnessTexture\":" TEXTURE() ",\"clearcoatNormalTexture\":" TEXTURE()) ","                         \
    EXT("sheen", "\"sheenColorFactor\":[0.5,0.5,0.5],\"sheenColorTexture\":" TEXTURE() ",\"sheenRoughnessFactor\":0.5,"  \
        "\"sheenRoughnessTexture\":" TEXTURE()) ","                                                                    \
    EXT("iridescence", "\"iridescenceFactor\":0.5,\"iridescenceTexture\":" TEXTURE() ",\"iridescenceThicknessTexture\":" TEXTURE()) "," \
    EXT("anisotropy", "\"anisotropyStrength\":0.5,\"anisotropyTexture\":" TEXTURE()) ","                                \
    EXT("dispersion", "\"dispersion\":0.5") ","                                                                        \
    EXT("diffuse_transmission", "\"diffuseTransmissionFactor\":0.5,\"diffuseTransmissionTexture\":" TEXTURE()            \
        ",\"diffuseTransmissionColorTexture\":" TEXTURE()) ","                                                         \
    EXT("diffuse_roughness", "\"diffuseRoughnessFactor\":0.5,\"diffuseRoughnessTexture\":" TEXTURE()) "}}"
#define FILE_REST                                                                                                      \
    "{\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0,\"children\":[1,2,3,4]},{\"camera\":0},{\"camera\":1,"         \
    "\"extensions\":{\"KHR_lights_punctual\":{\"light\":0}}},{\"extensions\":{\"KHR_lights_punctual\":{\"light\":1}}},"  \
    "{\"mesh\":0,\"translation\":[1,0,0],\"extensions\":{\"KHR_lights_punctual\":{\"light\":1}}}],"                      \
    "\"cameras\":[{\"type\":\"perspective\",\"perspective\":{\"yfov\":1,\"znear\":0.25}},{\"type\":\"orthographic\","     \
    "\"orthographic\":{\"xmag\":1,\"ymag\":1,\"znear\":0.25,\"zfar\":9}}],"                                             \
    "\"extensions\":{\"KHR_lights_punctual\":{\"lights\":[{\"type\":\"point\",\"intensity\":8},"                         \
    "{\"type\":\"spot\",\"color\":[0.5,1,0.25],\"intensity\":4,\"spot\":{\"innerConeAngle\":0.25,\"outerConeAngle\":0.5}}]}}," \
    "\"materials\":[" MATERIAL "," MATERIAL "]," PNG_IMAGE ","                                                          \
    "\"meshes\":[{\"primitives\":[{\"material\":1,\"attributes\":{\"POSITION\":0,\"TEXCOORD_0\":1}}]}]}"

#define GREY_PIXEL \
    "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAAC0lEQVR4nGNoAAIABQUCAaxTIjoAAAAASUVORK5CYII="

enum { FRAME = 6, TIMES = 2, VALUES = 3 }; /* of 24 a second; accessors */
#define MOMENT 0.25

static const struct render_settings *settings(void)
{
    static struct render_settings made;

    render_settings_default(&made);
    return &made;
}

/* ---- files ----------------------------------------------------------------------------------- */

static json_t *base(void)
{
    json_error_t error;
    json_t *doc = json_loads(FILE_REST, 0, &error);

    if (!doc)
        fail_msg("%s at %d", error.text, error.position);
    return doc;
}

/* The object that a pointer's value is in, and its key; what is missing is made. */
static json_t *object_at(json_t *doc, const char *pointer, char key[96])
{
    json_t *at = doc;

    for (const char *step = pointer + 1;; step += strcspn(step, "/") + 1) {
        size_t length = strcspn(step, "/");
        json_t *next;

        snprintf(key, 96, "%.*s", (int)length, step);
        if (!step[length])
            return at;
        next = json_is_array(at) ? json_array_get(at, (size_t)atoi(key)) : json_object_get(at, key);
        if (!next)
            assert_int_equal(json_object_set_new(at, key, next = json_object()), 0);
        at = next;
    }
}

static void set(json_t *doc, const char *pointer, const float *numbers, int count)
{
    json_t *list = json_array(), *value = list;
    char key[96];

    for (int i = 0; i < count; i++)
        assert_int_equal(json_array_append_new(list, json_real((double)numbers[i])), 0);
    if (count == 1)
        value = json_incref(json_array_get(list, 0));
    assert_int_equal(json_object_set_new(object_at(doc, pointer, key), key, value), 0);
    if (count == 1)
        json_decref(list);
}

/* Sampler i animates pointer i. */
static void animate(json_t *doc, const char *const *pointers, int count, const char *how)
{
    json_t *samplers = json_array(), *channels = json_array();

    for (int i = 0; i < count; i++) {
        assert_int_equal(json_array_append_new(samplers, json_pack("{s:i,s:i,s:s}", "input", TIMES, "output", VALUES + i,
                                                                   "interpolation", how)), 0);
        assert_int_equal(json_array_append_new(channels, json_pack("{s:i,s:{s:s,s:{s:{s:s}}}}", "sampler", i, "target", "path",
                                                                   "pointer", "extensions", "KHR_animation_pointer", "pointer",
                                                                   pointers[i])), 0);
    }
    assert_int_equal(json_object_set_new(doc, "animations",
                                         json_pack("[{s:o,s:o}]", "samplers", samplers, "channels", channels)), 0);
}

static struct maker made(void)
{
    static const float uv[6] = {0, 0, 1, 0, 0, 1};
    struct maker m = triangle_maker();

    put_floats(&m, "VEC2", uv, 6, 3);
    return m;
}

static void put_values(struct maker *m, const float *data, int components, int keys)
{
    static const char *const types[] = {NULL, "SCALAR", "VEC2", "VEC3", "VEC4"};

    put_floats(m, types[components], data, (size_t)(components * keys), (size_t)keys);
}

static void import_doc(struct maker *m, json_t *doc, struct import_result *r)
{
    struct import_options options = defaults;
    char *text = json_dumps(doc, JSON_REAL_PRECISION(17));
    struct buffer file = BUFFER_INIT;

    assert_non_null(text);
    text[strlen(text) - 1] = '\0'; /* without its braces */
    options.light_units = "photometric";
    maker_write(m, text + 1, &file);
    import_ok_with(file.data, file.size, "test.gltf", &options, r);
    buffer_release(&file);
    maker_release(m);
    free(text);
    json_decref(doc);
}

/* ---- frames ---------------------------------------------------------------------------------- */

/* The packed scene, without what simplification finds out of what is not animated, and the picture's proposed shape. */
static void pack(struct scene *scene, struct buffer *out)
{
    struct error err;

    for (uint32_t i = 0; i < scene->material_count; i++)
        scene->materials[i].least_roughness = scene->materials[i].clearcoat_least_roughness = 0;
    for (uint32_t i = 0; i < scene->camera_count; i++)
        scene->cameras[i].aspect = 0;
    for (uint32_t i = 0; i < scene->material_count; i++)
        for (int t = 0; t < MATERIAL_TEXTURES; t++)
            for (int k = 0; k < 6; k++)
                (&scene->materials[i].textures[t].uv_transform[0][0])[k] += 0.0f; /* no -0 */
    if (scene_pack(scene, out, &err) != STATUS_OK)
        fail_msg("%s", err.text);
}

static struct scene at_frame(const struct scene *scene, uint32_t frame)
{
    struct error err;
    struct scene at;

    int hides = 0;

    assert_int_equal(scene_at_frame(&at, scene, settings(), frame, &err), STATUS_OK);
    for (uint32_t i = 0; i < scene->track_count; i++)
        hides |= scene->tracks[i].target == TRACK_INSTANCE;
    if (!hides && scene_validate(&at, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    return at;
}

static int same(struct import_result *animated, struct import_result *still)
{
    struct buffer a = BUFFER_INIT, b = BUFFER_INIT, again = BUFFER_INIT;
    struct scene at = at_frame(&animated->scene, FRAME), unpacked;
    struct error err;
    int equal;

    /* Over the wire, too. */
    assert_int_equal(scene_pack(&animated->scene, &again, &err), STATUS_OK);
    assert_int_equal(scene_unpack(&unpacked, again.data, again.size, &err), STATUS_OK);
    pack(&at, &a);
    pack(&still->scene, &b);
    equal = a.size == b.size && memcmp(a.data, b.data, a.size) == 0;
    scene_copy_release(&at);
    at = at_frame(&unpacked, FRAME);
    buffer_release(&a);
    buffer_init(&a);
    pack(&at, &a);
    equal &= a.size == b.size && memcmp(a.data, b.data, a.size) == 0;
    scene_copy_release(&at);
    scene_release(&unpacked);
    buffer_release(&again);
    buffer_release(&b);
    buffer_release(&a);
    return equal;
}

/* Of each: the pointer, the numbers of both keys. Their moment, a quarter of the way, is exact. */
struct animated {
    const char *pointer;
    int count;
    float from[4], to[4];
    int needed; /* in the file: what is animated is 0 there otherwise */
};
#define NUMBER(pointer, a, b) {pointer, 1, {a}, {b}, 0}
#define COLOR(pointer) {pointer, 3, {0, 0.25f, 1}, {1, 0.75f, 0.5f}, 0}
#define OF(name) "/materials/1/extensions/KHR_materials_" name
#define SHIFTED(texture) {texture "/extensions/KHR_texture_transform/offset", 2, {0, -1}, {4, 2}, 1}
#define MOVED(texture)                                                                     \
    SHIFTED(texture),                                                                      \
    {texture "/extensions/KHR_texture_transform/rotation", 1, {0}, {2}, 1},                 \
    {texture "/extensions/KHR_texture_transform/scale", 2, {1, 2}, {3, -2}, 1}

static const struct animated each[] = {
    {"/materials/1/pbrMetallicRoughness/baseColorFactor", 4, {0, 0.25f, 1, 0.5f}, {1, 0.75f, 0.5f, 0.25f}, 0},
    NUMBER("/materials/1/pbrMetallicRoughness/metallicFactor", 0, 1),
    NUMBER("/materials/1/pbrMetallicRoughness/roughnessFactor", 0, 1),
    NUMBER("/materials/1/alphaCutoff", 0, 1),
    NUMBER("/materials/1/normalTexture/scale", 0, 2),
    NUMBER("/materials/1/normalTexture/scale", -4, 0),
    COLOR("/materials/1/emissiveFactor"),
    NUMBER(OF("emissive_strength/emissiveStrength"), 0, 8),
    NUMBER(OF("ior/ior"), 1, 2),
    NUMBER(OF("specular/specularFactor"), 1, 0),
    COLOR(OF("specular/specularColorFactor")),
    NUMBER(OF("transmission/transmissionFactor"), 0, 1),
    COLOR(OF("volume/attenuationColor")),
    NUMBER(OF("volume/attenuationDistance"), 1, 5),
    NUMBER(OF("clearcoat/clearcoatFactor"), 0, 1),
    NUMBER(OF("clearcoat/clearcoatRoughnessFactor"), 0, 1),
    NUMBER(OF("clearcoat/clearcoatNormalTexture/scale"), 0, 1),
    COLOR(OF("sheen/sheenColorFactor")),
    NUMBER(OF("sheen/sheenRoughnessFactor"), 0, 1),
    NUMBER(OF("iridescence/iridescenceFactor"), 0, 1),
    NUMBER(OF("iridescence/iridescenceIor"), 1, 2),
    NUMBER(OF("iridescence/iridescenceThicknessMinimum"), 0, 64),
    NUMBER(OF("iridescence/iridescenceThicknessMaximum"), 0, 800),
    NUMBER(OF("anisotropy/anisotropyStrength"), 0, 1),
    NUMBER(OF("anisotropy/anisotropyRotation"), -1, 3),
    NUMBER(OF("dispersion/dispersion"), 0, 1),
    NUMBER(OF("diffuse_transmission/diffuseTransmissionFactor"), 0, 1),
    COLOR(OF("diffuse_transmission/diffuseTransmissionColorFactor")),
    NUMBER(OF("diffuse_roughness/diffuseRoughnessFactor"), 0, 1),
    MOVED("/materials/1/pbrMetallicRoughness/baseColorTexture"),
    MOVED("/materials/1/pbrMetallicRoughness/metallicRoughnessTexture"),
    SHIFTED("/materials/1/normalTexture"),
    MOVED("/materials/1/emissiveTexture"),
    MOVED(OF("specular/specularTexture")),
    MOVED(OF("specular/specularColorTexture")),
    MOVED(OF("transmission/transmissionTexture")),
    MOVED(OF("clearcoat/clearcoatTexture")),
    MOVED(OF("clearcoat/clearcoatRoughnessTexture")),
    SHIFTED(OF("clearcoat/clearcoatNormalTexture")),
    MOVED(OF("sheen/sheenColorTexture")),
    MOVED(OF("sheen/sheenRoughnessTexture")),
    MOVED(OF("iridescence/iridescenceTexture")),
    MOVED(OF("iridescence/iridescenceThicknessTexture")),
    SHIFTED(OF("anisotropy/anisotropyTexture")),
    MOVED(OF("diffuse_transmission/diffuseTransmissionTexture")),
    MOVED(OF("diffuse_transmission/diffuseTransmissionColorTexture")),
    MOVED(OF("diffuse_roughness/diffuseRoughnessTexture")),
#define LAMP(key) "/extensions/KHR_lights_punctual/lights/" key
    COLOR(LAMP("0/color")),
    COLOR(LAMP("1/color")),
    NUMBER(LAMP("0/intensity"), 0, 8),
    NUMBER(LAMP("1/intensity"), 4, 0),
    NUMBER(LAMP("0/range"), 1, 5),
    NUMBER(LAMP("1/spot/innerConeAngle"), 0.125f, 0.25f),
    NUMBER(LAMP("1/spot/outerConeAngle"), 1, 0.5f),
    {"/cameras/0/perspective/yfov", 1, {0.5f}, {1.5f}, 1},
    {"/cameras/1/orthographic/ymag", 1, {1}, {3}, 1},
};
enum { EACH = sizeof each / sizeof *each };

static void between(const struct animated *a, float out[4])
{
    for (int i = 0; i < a->count; i++)
        out[i] = a->from[i] + (float)MOMENT * (a->to[i] - a->from[i]);
}

static void put_animated(struct maker *m, const struct animated *a)
{
    float keys[8];

    for (int i = 0; i < a->count; i++) {
        keys[i] = a->from[i];
        keys[a->count + i] = a->to[i];
    }
    put_values(m, keys, a->count, 2);
}

static void import_animated(const struct animated *const *list, int count, json_t *doc, struct import_result *r)
{
    static const float times[2] = {0, 1}, none[4] = {0};
    const char *pointers[4] = {NULL};
    struct maker m = made();

    put_values(&m, times, 1, 2);
    for (int i = 0; i < count; i++) {
        pointers[i] = list[i]->pointer;
        put_animated(&m, list[i]);
        if (!list[i]->needed) /* what the file has does not matter */
            set(doc, pointers[i], none, list[i]->count);
    }
    animate(doc, pointers, count, "LINEAR");
    import_doc(&m, doc, r);
}

static void import_still(const struct animated *const *list, int count, json_t *doc, struct import_result *r)
{
    static const float times[2] = {0, 1};
    struct maker m = made();
    float value[4];

    put_values(&m, times, 1, 2);
    for (int i = 0; i < count; i++) {
        put_animated(&m, list[i]);
        between(list[i], value);
        set(doc, list[i]->pointer, value, list[i]->count);
    }
    import_doc(&m, doc, r);
}

/* In frame 6 the file is the one with these values, and its next frame is not. */
static void assert_frame(const struct animated *const *list, int count, json_t *doc)
{
    struct import_result animated, still;
    struct scene first, next;
    struct buffer a = BUFFER_INIT, b = BUFFER_INIT;

    import_animated(list, count, json_deep_copy(doc), &animated);
    import_still(list, count, doc, &still);
    assert_true(scene_is_animated(&animated.scene, settings()) || strstr(list[0]->pointer, "/cameras/1"));
    assert_true(scene_duration_s(&animated.scene) == 1);
    if (!same(&animated, &still))
        fail_msg("%s%s%s", list[0]->pointer, count > 1 ? " and " : "", count > 1 ? list[1]->pointer : "");
    first = at_frame(&animated.scene, FRAME);
    next = at_frame(&animated.scene, FRAME + 1);
    pack(&first, &a);
    pack(&next, &b);
    if (a.size == b.size && memcmp(a.data, b.data, a.size) == 0)
        fail_msg("%s stands still", list[0]->pointer);
    buffer_release(&b);
    buffer_release(&a);
    scene_copy_release(&next);
    scene_copy_release(&first);
    import_result_release(&still);
    import_result_release(&animated);
}

static void each_value_alone(void **state)
{
    (void)state;
    for (int i = 0; i < EACH; i++)
        assert_frame((const struct animated *[]){&each[i]}, 1, base());
}

/* Products, and the parts of a texture's transform: each with each of the same thing, also beside what the file has. */
static void pairs_of_values(void **state)
{
    static const struct animated product[][2] = {
        {COLOR("/materials/1/emissiveFactor"), NUMBER(OF("emissive_strength/emissiveStrength"), 0, 8)},
        {COLOR(LAMP("1/color")), NUMBER(LAMP("1/intensity"), 0, 8)},
        {NUMBER(LAMP("1/spot/innerConeAngle"), 0, 0.5f), NUMBER(LAMP("1/spot/outerConeAngle"), 1, 0.5f)},
        {NUMBER("/materials/1/pbrMetallicRoughness/metallicFactor", 0, 1), COLOR("/materials/0/emissiveFactor")},
    };
    static const struct animated parts[] = {MOVED("/materials/1/emissiveTexture")};

    (void)state;
    for (size_t i = 0; i < sizeof product / sizeof *product; i++)
        for (int order = 0; order < 2; order++)
            assert_frame((const struct animated *[]){&product[i][order], &product[i][!order]}, 2, base());
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            json_t *doc = base();
            const float turned = 0.5f, stretched[2] = {2, 0.5f}, moved[2] = {1, 0.25f};

            set(doc, parts[0].pointer, moved, 2);
            set(doc, parts[1].pointer, &turned, 1);
            set(doc, parts[2].pointer, stretched, 2);
            assert_frame((const struct animated *[]){&parts[i], &parts[k]}, i == k ? 1 : 2, doc);
        }
}

/* A texture without effect, or of one colour, stays: its factor has another value at another time. */
static void textures_stay(void **state)
{
    static const float ones[1] = {1}, times[2] = {0, 1}, keys[2] = {0, 1};
    static const struct {
        const char *pointer, *image;
        enum material_texture slot;
    } cases[] = {
        /* At its largest, a metal, through which nothing is seen. */
        {"/materials/1/pbrMetallicRoughness/metallicFactor", NULL, MATERIAL_TEXTURE_transmission},
        {"/materials/1/extensions/KHR_materials_sheen/sheenRoughnessFactor", GREY_PIXEL, MATERIAL_TEXTURE_sheen_roughness},
        {"/materials/1/extensions/KHR_materials_clearcoat/clearcoatFactor", GREY_PIXEL, MATERIAL_TEXTURE_base_color},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct maker m = made();
        struct import_result r;
        json_t *doc = base();
        struct scene at;

        put_values(&m, times, 1, 2);
        put_values(&m, keys, 1, 2);
        set(doc, "/materials/1/pbrMetallicRoughness/metallicFactor", (const float[]){0.5f}, 1);
        set(doc, cases[i].pointer, ones, 1);
        if (cases[i].image)
            assert_int_equal(json_object_set_new(json_array_get(json_object_get(doc, "images"), 0), "uri", json_string(cases[i].image)), 0);
        animate(doc, (const char *const[]){cases[i].pointer}, 1, "LINEAR");
        import_doc(&m, doc, &r);
        at = at_frame(&r.scene, FRAME);
        assert_true(at.materials[0].textures[cases[i].slot].texture >= 0);
        scene_copy_release(&at);
        import_result_release(&r);
    }
}

/* ---- what is hidden ---------------------------------------------------------------------------- */

static int is_hidden(const struct scene_instance *instance)
{
    return instance->to_world.m[0][0] == 0 && instance->to_world.m[1][1] == 0 && instance->node < 0;
}

/* Node 4 is shown in frames 6 to 11, node 0 above it up to frame 8. */
static void hidden_nodes(void **state)
{
    static const float times[3] = {0, 0.25f, 0.5f}, later[3] = {0, 0.375f, 0.5f};
    static const uint8_t shown[2][3] = {{0, 1, 0}, {1, 0, 0}};
    static const char *const pointers[] = {"/nodes/4/extensions/KHR_node_visibility/visible",
                                           "/nodes/0/extensions/KHR_node_visibility/visible"};
    (void)state;
    for (int count = 1; count <= 2; count++) {
        struct maker m = made();
        struct import_result r;
        json_t *doc = base();

        put_values(&m, times, 1, 3);
        for (int i = 0; i < 2; i++)
            put_accessor(&m, put_view(&m, shown[i], sizeof shown[i], 0), "SCALAR", 5121, 3, "");
        put_values(&m, later, 1, 3);
        set(doc, pointers[0], (const float[]){0}, 1);
        animate(doc, pointers, count, "LINEAR");
        if (count == 2)
            set(doc, "/animations/0/samplers/1/input", (const float[]){VALUES + 2}, 1);
        import_doc(&m, doc, &r);
        assert_int_equal(r.scene.instance_count, 2);
        assert_int_equal(r.scene.light_count, 3);
        for (uint32_t frame = 0; frame < 15; frame++) {
            struct scene at = at_frame(&r.scene, frame);
            const int above = count == 1 || frame < 9, wanted = above && frame >= 6 && frame < 12;

            assert_int_equal(is_hidden(&at.instances[0]), !above);
            assert_int_equal(is_hidden(&at.instances[1]), !wanted);
            /* The place stays, so that nothing grows to reach the origin. */
            assert_true(at.instances[1].to_world.m[0][3] == r.scene.instances[1].to_world.m[0][3]);
            for (uint32_t i = 0; i < 3; i++) {
                const int below = r.scene.lights[i].position[0] + r.scene.origin[0] == 1, on = below ? wanted : above;

                assert_true((at.lights[i].intensity[0] > 0) == on);
                assert_true(!on || memcmp(&at.lights[i], &r.scene.lights[i], sizeof at.lights[i]) == 0);
            }
            scene_copy_release(&at);
        }
        import_result_release(&r);
    }
}

/* ---- keys -------------------------------------------------------------------------------------- */

/* A step at a frame's time is seen in that frame, also where the time is no float. */
static void steps_are_on_time(void **state)
{
    enum { FRAMES = 96 };
    static const char *const pointers[] = {"/materials/1/pbrMetallicRoughness/roughnessFactor"};
    struct maker m = made();
    struct import_result r;
    json_t *doc = base();
    float times[FRAMES], values[FRAMES];

    (void)state;
    for (int i = 0; i < FRAMES; i++) {
        times[i] = (float)(i / 24.0);
        values[i] = (float)i / 128;
    }
    put_values(&m, times, 1, FRAMES);
    put_values(&m, values, 1, FRAMES);
    animate(doc, pointers, 1, "STEP");
    import_doc(&m, doc, &r);
    for (uint32_t i = 0; i < FRAMES; i++) {
        struct scene at = at_frame(&r.scene, i);

        assert_true(at.materials[0].roughness == values[i]);
        scene_copy_release(&at);
    }
    import_result_release(&r);
}

/* A spline leaves the range of its keys, but not that of the value. */
static void splines_stay_in_range(void **state)
{
    static const float times[2] = {0, 1}, keys[6] = {0, 0.75f, 4, -4, 0.75f, 0}, tangents[6] = {0, 0.5f, 0, 2, 0.5f, 0};
    static const char *const pointers[] = {"/materials/1/pbrMetallicRoughness/roughnessFactor",
                                           "/materials/1/pbrMetallicRoughness/metallicFactor"};
    struct maker m = made();
    struct import_result r;
    json_t *doc = base();
    struct scene at;

    (void)state;
    put_values(&m, times, 1, 2);
    put_values(&m, keys, 1, 6);
    put_values(&m, tangents, 1, 6);
    animate(doc, pointers, 2, "CUBICSPLINE");
    import_doc(&m, doc, &r);
    at = at_frame(&r.scene, 12);
    assert_true(at.materials[0].roughness == 1);                          /* .75 + 2 * 4 / 8 */
    assert_float_equal(at.materials[0].metallic, 0.5f - 2.0f / 8, 1e-7f); /* equal keys: the tangent alone moves it */
    scene_copy_release(&at);
    import_result_release(&r);
}

/* Whatever a spline does, each frame is a valid scene. */
static void wild_splines(void **state)
{
    static const float times[2] = {0, 1};

    (void)state;
    for (int j = 0; j < 2 * EACH; j++) {
        const int i = j / 2, n = each[i].count;
        struct maker m = made();
        struct import_result r;
        json_t *doc = base();
        float keys[24];

        for (int k = 0; k < 6 * n; k++)
            keys[k] = k / n % 3 != 1 ? ((k + j) % 2 ? 3e7f : -3e7f) : k < 3 * n ? each[i].from[k % n] : each[i].to[k % n];
        put_values(&m, times, 1, 2);
        put_values(&m, keys, n, 6);
        animate(doc, (const char *const[]){each[i].pointer}, 1, "CUBICSPLINE");
        import_doc(&m, doc, &r);
        assert_int_equal(r.scene.track_count > 0, 1);
        for (uint32_t frame = 0; frame <= 24; frame++) {
            struct scene at = at_frame(&r.scene, frame);

            scene_copy_release(&at);
        }
        import_result_release(&r);
    }
}

static void test_bad_pointers(void **state)
{
    static const float times[2] = {0, 1}, numbers[2] = {2, 0.5f}, three[6] = {0};
    static const char *const pointers[] = {
        "/materials/1/pbrMetallicRoughness/metallicFactor", "/materials/1/extensions/KHR_materials_volume/thicknessFactor",
        "/materials/7/alphaCutoff", "/materials/1/normalTexture/extensions/KHR_texture_transform/rotation", "/materials/-1/alphaCutoff", "/materials/0/occlusionTexture/strength"};
    static const char *const twice[] = {"/materials/1/alphaCutoff", "/materials/1/alphaCutoff"};
    struct maker m = made();
    struct import_result r;
    struct buffer file = BUFFER_INIT;
    json_t *doc = base();
    struct error err;
    char *text;

    (void)state;
    put_values(&m, times, 1, 2);
    for (int i = 0; i < 6; i++)
        put_values(&m, numbers, 1, 2);
    animate(doc, pointers, 6, "LINEAR");
    import_doc(&m, doc, &r);
    assert_warned(&r, "animates \"/materials/#/pbrMetallicRoughness/metallicFactor\" to 2: brought into its range");
    assert_warned(&r, "animates \"/materials/1/extensions/KHR_materials_volume/thicknessFactor\", which stands still here");
    assert_warned(&r, "animates \"/materials/#/alphaCutoff\" of row 7, which the file does not have: left out");
    assert_false(warned(&r, "occlusion"));
    assert_int_equal(r.scene.track_count, 1);
    import_result_release(&r);

    m = made();
    doc = base();
    put_values(&m, times, 1, 2);
    put_values(&m, numbers, 1, 2);
    put_values(&m, numbers, 1, 2);
    animate(doc, twice, 2, "LINEAR");
    import_doc(&m, doc, &r);
    assert_warned(&r, "animates \"/materials/#/alphaCutoff\" of row 1, which an earlier channel does already");
    import_result_release(&r);

    m = made();
    doc = base();
    put_values(&m, times, 1, 2);
    put_values(&m, three, 3, 2);
    animate(doc, twice, 1, "LINEAR");
    text = json_dumps(doc, 0);
    text[strlen(text) - 1] = '\0';
    maker_write(&m, text + 1, &file);
    assert_int_not_equal(import_scene_memory(file.data, file.size, "x.gltf", NULL, &defaults, &r, &err), STATUS_OK);
    assert_says(&err, "samplers[0]|2 elements of 1 components|alphaCutoff");
    buffer_release(&file);
    maker_release(&m);
    free(text);
    json_decref(doc);
}

/* What the material does not read, as beside the archived model or where the texture of what glows is missing, is not
 * animated. */
static void what_is_not_read(void **state)
{
    static const float times[2] = {0, 1}, colors[8] = {0, 0, 0, 0, 1, 1, 1, 1}, emissions[6] = {0, 0, 0, 1, 1, 1};
    static const char *const color[] = {"/materials/1/pbrMetallicRoughness/baseColorFactor"};
    static const char *const emission[] = {"/materials/1/emissiveFactor"};

    (void)state;
    for (int i = 0; i < 2; i++) {
        struct maker m = made();
        struct import_result r;
        json_t *doc = base();
        char key[96];

        put_values(&m, times, 1, 2);
        put_values(&m, i ? emissions : colors, i ? 3 : 4, 2);
        if (i == 0)
            assert_int_equal(json_object_set_new(object_at(doc, OF("pbrSpecularGlossiness"), key), key, json_object()), 0);
        else
            assert_int_equal(json_object_set_new(json_array_get(json_object_get(doc, "images"), 0), "uri", json_string("none.png")), 0);
        animate(doc, i ? emission : color, 1, "LINEAR");
        import_doc(&m, doc, &r);
        assert_int_equal(r.scene.track_count, 0);
        import_result_release(&r);
    }
}

/* A value of which every key is the same is the file's. */
static void test_still_values(void **state)
{
    static const float times[2] = {0, 1}, same_twice[2] = {0.25f, 0.25f};
    static const char *const pointers[] = {"/materials/1/pbrMetallicRoughness/roughnessFactor"};
    struct maker m = made();
    struct import_result r;
    json_t *doc = base();

    (void)state;
    put_values(&m, times, 1, 2);
    put_values(&m, same_twice, 1, 2);
    animate(doc, pointers, 1, "LINEAR");
    import_doc(&m, doc, &r);
    assert_int_equal(r.scene.track_count, 0);
    assert_true(r.scene.materials[0].roughness == 0.25f);
    assert_false(scene_is_animated(&r.scene, settings()));
    import_result_release(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_value_alone),     cmocka_unit_test(pairs_of_values),       cmocka_unit_test(textures_stay), cmocka_unit_test(hidden_nodes),
        cmocka_unit_test(steps_are_on_time),    cmocka_unit_test(splines_stay_in_range), cmocka_unit_test(wild_splines), cmocka_unit_test(test_bad_pointers),
        cmocka_unit_test(what_is_not_read), cmocka_unit_test(test_still_values),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
