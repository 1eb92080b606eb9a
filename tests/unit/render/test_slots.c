/* Every texture slot of a material reads the channels that it should, in the encoding that it
 * should: a texture of one colour must act as a factor of that channel's value does, and a factor
 * of any other channel's value must not.
 *
 * Pictures are compared pixel by pixel: the two make the same random choices, but for those that
 * the last bit decides. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "common/base/memory.h"
#include "common/image/color.h"
#include "tests/support/imported.h"

enum { WIDTH = 30, HEIGHT = 20, VALUES = WIDTH * HEIGHT * 3 };

/* One pixel, of these codes. */
enum { RED = 200, GREEN = 120, BLUE = 220, ALPHA = 160 };
static const uint8_t pixel_png[] = {
    0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a, 0x00, 0x00, 0x00, 0x0d, 0x49, 0x48, 0x44,
    0x52, 0x00, 0x00, 0x00, 0x01, 0x00, 0x00, 0x00, 0x01, 0x08, 0x06, 0x00, 0x00, 0x00, 0x1f,
    0x15, 0xc4, 0x89, 0x00, 0x00, 0x00, 0x0d, 0x49, 0x44, 0x41, 0x54, 0x78, 0xda, 0x63, 0x38,
    0x51, 0x71, 0x67, 0x01, 0x00, 0x06, 0xe5, 0x02, 0xbd, 0x2b, 0xa3, 0x8b, 0xba, 0x00, 0x00,
    0x00, 0x00, 0x49, 0x45, 0x4e, 0x44, 0xae, 0x42, 0x60, 0x82};

static const int codes[4] = {RED, GREEN, BLUE, ALPHA};
enum { R, G, B, A, CHANNELS };

static float linear(int channel) { return (float)codes[channel] / 255; }

static float decoded(int channel) { return srgb_decode(linear(channel)); }

/* ---- the scene ------------------------------------------------------------------------------ */

static const struct scene_texture_slot pixel_slot = {
    .texture = 0, .uv_set = 0, .uv_transform = {{1, 0, 0}, {0, 1, 0}}};

/* Balls (with tangents) on a ground, all of one material; the one texture is the pixel. */
static void open_scene(struct import_result *import)
{
    struct scene *s = &import->scene;

    imported_file("scenes/features/normal-map.gltf", import);
    for (size_t i = 0; i < import->blob_count; i++)
        if (digest_equal(&import->blobs[i].digest, &s->images[s->textures[0].image].blob.digest)) {
            mem_free(import->blobs[i].data);
            import->blobs[i].data = mem_memdup(pixel_png, sizeof pixel_png);
            import->blobs[i].size_bytes = sizeof pixel_png;
            assert_non_null(import->blobs[i].data);
        }
    assert_true(s->material_count >= 3);
    for (uint32_t i = 0; i < s->material_count; i++)
        if (s->materials[i].emission[0] == 0) {
            const char *name = s->materials[i].name;
            scene_material_default(&s->materials[i]);
            s->materials[i].name = name;
            s->materials[i].metallic = 0;
            s->materials[i].roughness = 0.4f;
            s->materials[i].double_sided = 1;
        }
}

typedef void change_fn(struct scene_material *m, int channel);

/* The picture with `change` made to all materials that do not shine. */
static void render_changed(change_fn *change, int channel, uint32_t spp, float picture[VALUES])
{
    struct render_settings settings = imported_settings(WIDTH, HEIGHT, spp);
    struct import_result import;

    open_scene(&import);
    for (uint32_t i = 0; i < import.scene.material_count; i++)
        if (import.scene.materials[i].emission[0] == 0)
            change(&import.scene.materials[i], channel);
    imported_render(&import, &settings, 0, picture);
    import_result_release(&import);
}

/* The share of values that differ by more than rounding. */
static double difference(const float a[VALUES], const float b[VALUES])
{
    int other = 0;

    for (int i = 0; i < VALUES; i++)
        other += fabsf(a[i] - b[i]) > 1e-3f * (1 + fabsf(a[i]));
    return (double)other / VALUES;
}

/* ---- the slots ------------------------------------------------------------------------------ */

/* Channel -1: by the texture; else the factor is what that channel says. */
#define SCALAR_SLOT(slot, factor)                                   \
    if (channel < 0)                                                \
        m->slot##_texture = pixel_slot;                             \
    m->factor = channel < 0 ? 1 : linear(channel)
#define COLOR_SLOT(slot, factor)                                    \
    if (channel < 0)                                                \
        m->slot##_texture = pixel_slot;                             \
    for (int c = 0; c < 3; c++)                                     \
    m->factor[c] = channel < 0 ? 1 : channel == R ? decoded(c) : linear(c)

static void base_color(struct scene_material *m, int channel) { COLOR_SLOT(base_color, base_color); }

static void coverage(struct scene_material *m, int channel)
{
    m->alpha_mode = ALPHA_BLEND;
    base_color(m, channel < 0 ? -1 : R);
    m->base_color[3] = channel < 0 ? 1 : linear(channel);
}

static void roughness(struct scene_material *m, int channel)
{
    SCALAR_SLOT(metallic_roughness, roughness);
    m->metallic = channel < 0 ? 1 : linear(B);
}

static void metallic(struct scene_material *m, int channel)
{
    SCALAR_SLOT(metallic_roughness, metallic);
    m->roughness = channel < 0 ? 1 : linear(G);
}

static void specular(struct scene_material *m, int channel) { SCALAR_SLOT(specular, specular); }

static void specular_color(struct scene_material *m, int channel) { COLOR_SLOT(specular_color, specular_color); }

static void transmission(struct scene_material *m, int channel) { SCALAR_SLOT(transmission, transmission); }

/* Of what does not shine without it. */
static void emission(struct scene_material *m, int channel) { COLOR_SLOT(emission, emission); }

static void clearcoat(struct scene_material *m, int channel)
{
    m->roughness = 1;
    SCALAR_SLOT(clearcoat, clearcoat);
}

static void clearcoat_roughness(struct scene_material *m, int channel)
{
    m->clearcoat = 1;
    SCALAR_SLOT(clearcoat_roughness, clearcoat_roughness);
}

static void sheen_color(struct scene_material *m, int channel)
{
    m->sheen_roughness = 0.5f;
    COLOR_SLOT(sheen_color, sheen_color);
}

static void sheen_roughness(struct scene_material *m, int channel)
{
    m->sheen_color[0] = m->sheen_color[1] = m->sheen_color[2] = 1;
    SCALAR_SLOT(sheen_roughness, sheen_roughness);
}

static void iridescence(struct scene_material *m, int channel)
{
    m->iridescence_ior = 1.8f;
    m->iridescence_thickness_max_nm = 400;
    SCALAR_SLOT(iridescence, iridescence);
}

static void thickness(struct scene_material *m, int channel)
{
    m->iridescence = 1;
    m->iridescence_ior = 1.8f;
    m->iridescence_thickness_min_nm = 100;
    m->iridescence_thickness_max_nm = channel < 0 ? 700 : 100 + 600 * linear(channel);
    if (channel < 0)
        m->iridescence_thickness_texture = pixel_slot;
}

static void diffuse_transmission(struct scene_material *m, int channel)
{
    SCALAR_SLOT(diffuse_transmission, diffuse_transmission);
}

static void diffuse_roughness(struct scene_material *m, int channel)
{
    m->specular = 0;
    SCALAR_SLOT(diffuse_roughness, diffuse_roughness);
}

static void diffuse_transmission_color(struct scene_material *m, int channel)
{
    m->diffuse_transmission = 1;
    COLOR_SLOT(diffuse_transmission_color, diffuse_transmission_color);
}

static void anisotropy_strength(struct scene_material *m, int channel)
{
    m->metallic = 1;
    if (channel >= 0)
        m->anisotropy_rotation_rad = atan2f(linear(G) * 2 - 1, linear(R) * 2 - 1);
    SCALAR_SLOT(anisotropy, anisotropy);
}

/* The direction, counter-clockwise; another channel stands for green. */
static void anisotropy_direction(struct scene_material *m, int channel)
{
    m->metallic = 1;
    m->anisotropy_rotation_rad = 0.3f;
    if (channel >= 0)
        m->anisotropy_rotation_rad += atan2f(linear(channel) * 2 - 1, linear(R) * 2 - 1);
    m->anisotropy = channel < 0 ? 1 : linear(B);
    if (channel < 0)
        m->anisotropy_texture = pixel_slot;
}

/* Colours have two wrong forms only: R stands for decoded, any other for not decoded. */
static const struct {
    const char *name;
    change_fn *change;
    int channel;
    int is_color;
} slots[] = {
    {"base color", base_color, R, 1},
    {"alpha", coverage, A, 0},
    {"roughness", roughness, G, 0},
    {"metallic", metallic, B, 0},
    {"specular", specular, A, 0},
    {"specular color", specular_color, R, 1},
    {"transmission", transmission, R, 0},
    {"emission", emission, R, 1},
    {"clearcoat", clearcoat, R, 0},
    {"clearcoat roughness", clearcoat_roughness, G, 0},
    {"sheen color", sheen_color, R, 1},
    {"sheen roughness", sheen_roughness, A, 0},
    {"iridescence", iridescence, R, 0},
    {"iridescence thickness", thickness, G, 0},
    {"diffuse transmission", diffuse_transmission, A, 0},
    {"diffuse roughness", diffuse_roughness, R, 0},
    {"diffuse transmission color", diffuse_transmission_color, R, 1},
    {"anisotropy strength", anisotropy_strength, B, 0},
    {"anisotropy direction", anisotropy_direction, G, 0},
};

static void test_channels(void **state)
{
    /* Few samples: equal choices give equal pixels, and another factor another picture, by any number. */
    enum { SPP = 32 };
    static float textured[VALUES], by_factor[VALUES];

    (void)state;
    for (size_t i = 0; i < sizeof slots / sizeof *slots; i++) {
        render_changed(slots[i].change, -1, SPP, textured);
        for (int channel = 0; channel < (slots[i].is_color ? 2 : CHANNELS); channel++) {
            double other;
            render_changed(slots[i].change, channel, SPP, by_factor);
            other = difference(textured, by_factor);
            if (channel == slots[i].channel ? other > 0.01 : other < 0.05)
                fail_msg("%s: %.3f of the picture differs from a factor by channel %d", slots[i].name, other, channel);
        }
    }
}

/* ---- normal maps ---------------------------------------------------------------------------- */

/* The balls have their tangents to the east, and green is towards the pole: v runs downwards. The
 * left ball is mirrored: so are its normals. */
static void test_normal(void **state)
{
    struct render_settings settings = imported_settings(16, 16, 1);
    float sums[TILE_FLOATS_MAX], right = 0.2f * (2 * linear(R) - 1), up = 0.2f * (2 * linear(G) - 1),
                                 out = 2 * linear(B) - 1, length = sqrtf(right * right + up * up + out * out);
    struct render_stats stats = {0};
    struct import_result import;
    struct render_scene *scene;
    int on_ball[2] = {0}, mirrored = 0;
    float origin[3];

    (void)state;
    open_scene(&import);
    for (uint32_t i = 0; i < import.scene.material_count; i++)
        if (import.scene.materials[i].emission[0] == 0) {
            import.scene.materials[i].normal_texture = pixel_slot;
            import.scene.materials[i].normal_scale = 0.2f; /* of right and up alone */
        }
    for (uint32_t i = 0; i < import.scene.instance_count; i++)
        if (import.scene.instances[i].to_world.m[0][3] + import.scene.origin[0] < -2) {
            import.scene.instances[i].to_world.m[0][0] *= -1;
            mirrored++;
        }
    assert_true(mirrored > 0);
    settings.aovs = 1 << AOV_NORMAL | 1 << AOV_POSITION;
    scene = imported_build(&import, &settings, 0);
    render_tile(scene, 0, 0, 0, 0, sums, NULL, &stats);
    render_scene_free(scene);
    for (int c = 0; c < 3; c++)
        origin[c] = (float)import.scene.origin[c];
    import_result_release(&import);
    for (int i = 0; i < 256; i++) {
        const float *n = sums + PIXEL_FLOATS * 256 + 3 * i, *p = n + 256 * 3;
        float x = p[0] + origin[0], y = p[1] + origin[1] - 1, z = p[2] + origin[2], r, east[2], north[3];
        int left = x < -1.15f; /* it or the middle one */
        x = left ? -(x + 2.3f) : x;
        r = sqrtf(x * x + z * z);
        if (fabsf(x * x + y * y + z * z - 1) > 0.02f || r < 0.3f || z < 0.6f)
            continue; /* nearer to the rim normals are bent back into view */
        east[0] = z / r;
        east[1] = -x / r;
        north[0] = -y * x / r;
        north[1] = r;
        north[2] = -y * z / r;
        assert_float_equal(left ? -n[0] : n[0], (right * east[0] + up * north[0] + out * x) / length, 0.01f);
        assert_float_equal(n[1], (up * north[1] + out * y) / length, 0.01f);
        assert_float_equal(n[2], (right * east[1] + up * north[2] + out * z) / length, 0.01f);
        on_ball[left]++;
    }
    assert_true(on_ball[0] > 5 && on_ball[1] > 5);
}

/* Only the coat is seen. Maps 0: none; 1: the base's; 2: the coat's; 3: both. */
static void coat_over_black(struct scene_material *m, int maps)
{
    m->base_color[0] = m->base_color[1] = m->base_color[2] = m->specular = 0;
    m->clearcoat = 1;
    m->clearcoat_roughness = 0.3f;
    m->normal_scale = 0.1f;
    m->clearcoat_normal_scale = 0.3f;
    if (maps & 1)
        m->normal_texture = pixel_slot;
    if (maps & 2)
        m->clearcoat_normal_texture = pixel_slot;
}

/* Relative, of the mean radiance of 10 x 10 pixels: other frames mean other random choices. */
static double coarse_difference(const float a[VALUES], const float b[VALUES])
{
    double apart = 0, sum = 0;

    for (int y = 0; y < HEIGHT; y += 10)
        for (int x = 0; x < WIDTH * 3; x += 30) {
            double of_a = 0, of_b = 0;
            for (int i = 0; i < 300; i++) {
                of_a += (double)a[(y + i / 30) * WIDTH * 3 + x + i % 30];
                of_b += (double)b[(y + i / 30) * WIDTH * 3 + x + i % 30];
            }
            apart += fabs(of_a - of_b);
            sum += of_a + of_b;
        }
    return 2 * apart / sum;
}

static void test_coat_has_its_own_normal(void **state)
{
    static float plain[VALUES], base[VALUES], coat[VALUES], both[VALUES];

    (void)state;
    render_changed(coat_over_black, 0, 256, plain);
    render_changed(coat_over_black, 1, 256, base);
    render_changed(coat_over_black, 2, 256, coat);
    render_changed(coat_over_black, 3, 256, both);
    assert_true(coarse_difference(plain, base) < 0.005); /* noise */
    assert_true(coarse_difference(coat, both) < 0.005);
    assert_true(coarse_difference(plain, coat) > 0.03);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_channels),
        cmocka_unit_test(test_normal),
        cmocka_unit_test(test_coat_has_its_own_normal),
    };
    return cmocka_run_group_tests_name("texture slots", tests, NULL, NULL);
}
