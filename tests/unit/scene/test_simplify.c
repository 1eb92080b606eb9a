/* Simplifying: what is taken out of a scene was never to be seen. Folded factors are compared
 * with what the renderer's own lookups give, and pictures before with pictures after. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>
#include <png.h>

#include "common/base/buffer.h"
#include "common/base/memory.h"
#include "common/image/image.h"
#include "common/scene/material.h"
#include "common/scene/simplify/simplify.h"
#include "common/scene/track.h"
#include "tests/support/scene_builder.h"
#include "tests/support/statistics.h"
#include "worker/render/texture/texture.h"

/* ---- images and textures ------------------------------------------------------------------- */

static void png_append(png_structp png, png_bytep data, size_t size_bytes)
{
    buffer_append(png_get_io_ptr(png), data, size_bytes);
}

static void png_flush_nothing(png_structp png) { (void)png; }

static struct buffer make_png(uint32_t width, uint32_t height, int channels, int bits, const uint8_t *pixels)
{
    static const int types[4] = {PNG_COLOR_TYPE_GRAY, PNG_COLOR_TYPE_GRAY_ALPHA, PNG_COLOR_TYPE_RGB,
                                 PNG_COLOR_TYPE_RGBA};
    struct buffer out = BUFFER_INIT;
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);

    png_set_write_fn(png, &out, png_append, png_flush_nothing);
    png_set_IHDR(png, info, width, height, bits, types[channels - 1], PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png, info);
    for (uint32_t y = 0; y < height; y++)
        png_write_row(png, pixels + (size_t)y * width * (size_t)channels * (size_t)(bits / 8));
    png_write_end(png, info);
    png_destroy_write_struct(&png, &info);
    return out;
}

static void own_blob(struct scene_builder *b, struct buffer file, struct scene_blob *blob)
{
    assert_true(b->blob_count < BUILDER_MAX);
    blob->size_bytes = file.size;
    assert_int_equal(digest_of(&blob->digest, file.data, file.size), STATUS_OK);
    b->blobs[b->blob_count].digest = blob->digest;
    b->blobs[b->blob_count].data = mem_memdup(file.data, file.size);
    b->blobs[b->blob_count++].size_bytes = file.size;
    buffer_release(&file);
}

static int32_t add_image(struct scene_builder *b, struct buffer file)
{
    struct scene_image *image = &b->scene.images[b->scene.image_count];

    image->name = "picture";
    own_blob(b, file, &image->blob);
    return (int32_t)b->scene.image_count++;
}

static int32_t add_texture(struct scene_builder *b, int32_t image)
{
    b->scene.textures[b->scene.texture_count] =
        (struct scene_texture){(uint32_t)image, WRAP_REPEAT, WRAP_REPEAT, 0, ENCODING_BY_SLOT};
    return (int32_t)b->scene.texture_count++;
}

/* A texture of 4 x 3 texels of one colour; `odd`: channel of which one texel differs, -1: none. */
static int32_t add_even(struct scene_builder *b, const uint8_t color[4], int channels, int odd)
{
    uint8_t pixels[4 * 3 * 4];

    for (int i = 0; i < 12; i++)
        for (int c = 0; c < channels; c++)
            pixels[i * channels + c] = (uint8_t)(color[c] - (i == 7 && c == odd));
    return add_texture(b, add_image(b, make_png(4, 3, channels, 8, pixels)));
}

static status read_blob(void *user, const struct digest *digest, const uint8_t **data, size_t *size_bytes,
                        struct error *err)
{
    struct blob_source source = builder_source(user);

    return source.get(source.user, digest, data, size_bytes, err);
}

static struct scene_simplify_report simplified(struct scene_builder *b)
{
    struct scene_simplify_report report;
    struct error err = {0};

    assert_int_equal(scene_validate(&b->scene, &err), STATUS_OK);
    if (scene_simplify(&b->scene, (struct scene_blob_reader){read_blob, b}, &report, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    if (scene_validate(&b->scene, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    return report;
}

/* A quad with a material, seen by a camera. */
static struct scene_material *start(struct scene_builder *b)
{
    struct scene_material *m;

    builder_init(b);
    m = builder_lambert(b, 0.5f);
    scene_material_default(m);
    builder_place(b, builder_quad(b), 0, (struct vec3){1, 1, 1}, (struct vec3){0, 0, 0});
    builder_camera(b, (struct vec3){0, 2, 0.1f}, (struct vec3){0, 0, 0}, 1);
    return m;
}

/* ---- folding ------------------------------------------------------------------------------- */

/* Every slot that multiplies: the factors, their channels, and where the slot is. */
struct slot_case {
    size_t slot;
    int srgb, parts;
    struct {
        size_t factor;
        int channel;
    } part[4];
};
#define AT(field) offsetof(struct scene_material, field)
#define COLOR(field) {{AT(field[0]), 0}, {AT(field[1]), 1}, {AT(field[2]), 2}}
static const struct slot_case cases[] = {
    {AT(base_color_texture), 1, 4,
     {{AT(base_color[0]), 0}, {AT(base_color[1]), 1}, {AT(base_color[2]), 2},
      {AT(base_color[3]), 3}}},
    {AT(metallic_roughness_texture), 0, 2, {{AT(roughness), 1}, {AT(metallic), 2}}},
    {AT(emission_texture), 1, 3, COLOR(emission)},
    {AT(specular_texture), 0, 1, {{AT(specular), 3}}},
    {AT(specular_color_texture), 1, 3, COLOR(specular_color)},
    {AT(transmission_texture), 0, 1, {{AT(transmission), 0}}},
    {AT(clearcoat_texture), 0, 1, {{AT(clearcoat), 0}}},
    {AT(clearcoat_roughness_texture), 0, 1, {{AT(clearcoat_roughness), 1}}},
    {AT(sheen_color_texture), 1, 3, COLOR(sheen_color)},
    {AT(sheen_roughness_texture), 0, 1, {{AT(sheen_roughness), 3}}},
    {AT(iridescence_texture), 0, 1, {{AT(iridescence), 0}}},
    {AT(diffuse_transmission_texture), 0, 1, {{AT(diffuse_transmission), 3}}},
    {AT(diffuse_transmission_color_texture), 1, 3, COLOR(diffuse_transmission_color)},
};
enum { CASES = sizeof cases / sizeof *cases };

static struct scene_texture_slot *slot_of(struct scene_material *m, size_t at)
{
    return (struct scene_texture_slot *)(void *)((char *)m + at);
}

static float *factor_of(struct scene_material *m, size_t at) { return (float *)(void *)((char *)m + at); }

/* Everything acts, at awkward factors. */
static void wake_all(struct scene_material *m)
{
    struct test_random random = {3};

    m->alpha_mode = ALPHA_BLEND;
    for (int k = 0; k < CASES; k++)
        for (int i = 0; i < cases[k].parts; i++)
            *factor_of(m, cases[k].part[i].factor) = 0.3f + 0.6f * test_random_float(&random);
}

static struct buffer even_exr(const float color[4])
{
    struct image image;
    struct buffer out = BUFFER_INIT;

    assert_int_equal(image_init(&image, 3, 2, 4, NULL), STATUS_OK);
    for (int i = 0; i < 6; i++)
        memcpy(image.pixels + 4 * i, color, 4 * sizeof(float));
    assert_int_equal(exr_encode(&out, &image, NULL, NULL), STATUS_OK);
    image_release(&image);
    return out;
}

/* The least roughness is the factor times the least texel of its channel; where the texture has a black border, or
 * none is left, nothing is known. */
static void test_least_roughness(void **state)
{
    static const uint8_t color[4] = {255, 52, 200, 255}; /* one texel has 51 of 255 in green */
    static const enum scene_wrap wraps[] = {WRAP_REPEAT, WRAP_MIRROR, WRAP_CLAMP, WRAP_BLACK};

    (void)state;
    for (size_t i = 0; i < sizeof wraps / sizeof *wraps; i++) {
        struct scene_builder b;
        struct scene_material *m = start(&b);
        const int32_t texture = add_even(&b, color, 4, CHANNEL_GREEN);

        b.scene.textures[texture].wrap_v = wraps[i];
        m->roughness = 0.5f;
        m->clearcoat = 1;
        m->clearcoat_roughness = 0.25f;
        m->metallic_roughness_texture.texture = m->clearcoat_roughness_texture.texture = texture;
        (void)simplified(&b);
        assert_float_equal(m->least_roughness, wraps[i] == WRAP_BLACK ? 0 : 0.1f, 1e-7f);
        assert_float_equal(m->clearcoat_least_roughness, wraps[i] == WRAP_BLACK ? 0 : 0.05f, 1e-7f);
        builder_release(&b);

        m = start(&b);
        m->metallic_roughness_texture.texture = add_even(&b, color, 4, -1);
        (void)simplified(&b);
        assert_int_equal(m->metallic_roughness_texture.texture, -1); /* folded */
        assert_float_equal(m->least_roughness, 0, 0);
        builder_release(&b);
    }
}

/* Kinds of constant images: 8 and 16 bits of 1 to 4 channels, floats with and without alpha. */
enum { KINDS = 10 };
static struct buffer even_file(int kind)
{
    uint8_t pixels[4 * 3 * 8];
    int channels = 1 + kind % 4, bytes = kind < 4 ? 1 : 2;

    if (kind >= 8) {
        const float color[4] = {0.11f, 0.43f, 0.27f, kind == 8 ? 1.0f : 0.75f};
        return even_exr(color);
    }
    for (int i = 0; i < 12 * channels * bytes; i++)
        pixels[i] = (uint8_t)(77 + 31 * (i % (channels * bytes)));
    return make_png(4, 3, channels, 8 * bytes, pixels);
}

/* All slots by all kinds of images, under all encodings: factor times lookup, to the bit. */
static void test_constants_fold_exactly(void **state)
{
    (void)state;
    for (int k = 0; k < CASES; k++)
        for (int kind = 0; kind < KINDS; kind++)
            for (int encoding = 0; encoding < ENCODING_COUNT; encoding++) {
                struct scene_builder b;
                struct scene_material *m = start(&b), before;
                struct scene_simplify_report report;
                struct scene_texture texture;
                struct texture_image *image;
                struct buffer file = even_file(kind), copy = even_file(kind);
                struct error err = {0};

                wake_all(m);
                slot_of(m, cases[k].slot)->texture = add_texture(&b, add_image(&b, file));
                b.scene.textures[0].encoding = (enum scene_encoding)encoding;
                b.scene.textures[0].wrap_u = kind % 2 ? WRAP_MIRROR : WRAP_CLAMP;
                texture = b.scene.textures[0];
                before = *m;
                report = simplified(&b);
                assert_int_equal(report.folded, 1);
                assert_int_equal(report.images, 1);
                assert_int_equal(report.textures, 1);
                assert_int_equal(b.scene.image_count, 0);
                assert_int_equal(slot_of(m, cases[k].slot)->texture, -1);
                assert_int_equal(texture_image_new(&image, copy.data, copy.size, "x", &err), STATUS_OK);
                assert_int_equal(texture_image_filter(image, 3, "x", &err), STATUS_OK);
                for (int place = 0; place < 5; place++) {
                    struct texel t = texture_lookup(image, &texture, 0.37f * (float)place, 0.21f * (float)place,
                                                    0.1f * (float)place, cases[k].srgb);
                    const float channels[4] = {t.r, t.g, t.b, t.a};

                    for (int i = 0; i < cases[k].parts; i++)
                        assert_true(*factor_of(m, cases[k].part[i].factor) ==
                                    *factor_of(&before, cases[k].part[i].factor) * channels[cases[k].part[i].channel]);
                }
                texture_image_free(image);
                buffer_release(&copy);
                builder_release(&b);
            }
}

/* One texel off in a channel that the slot reads keeps the texture; in another it does not. */
static void test_only_used_channels_count(void **state)
{
    static const uint8_t color[4] = {200, 150, 100, 250};

    (void)state;
    for (int k = 0; k < CASES; k++)
        for (int odd = 0; odd < 4; odd++) {
            struct scene_builder b;
            struct scene_material *m = start(&b);
            int used = 0;

            wake_all(m);
            slot_of(m, cases[k].slot)->texture = add_even(&b, color, 4, odd);
            for (int i = 0; i < cases[k].parts; i++)
                used |= cases[k].part[i].channel == odd;
            assert_int_equal(simplified(&b).folded, !used);
            assert_int_equal(b.scene.image_count, used);
            builder_release(&b);
        }
}

/* What would not be the same everywhere, or not a legal factor, stays. */
static void test_what_must_stay(void **state)
{
    static const uint8_t color[4] = {200, 150, 100, 255};
    static const float bright[4] = {3, 3, 3, 1};
    struct scene_builder b;
    struct scene_material *m = start(&b);

    (void)state;
    m->base_color_texture.texture = add_even(&b, color, 3, -1);
    b.scene.textures[0].wrap_v = WRAP_BLACK;
    assert_int_equal(simplified(&b).folded, 0);
    assert_int_equal(b.scene.texture_count, 1);
    builder_release(&b);

    m = start(&b);
    m->base_color_texture.texture = add_texture(&b, add_image(&b, even_exr(bright)));
    m->emission_texture.texture = m->base_color_texture.texture;
    m->emission[0] = 2;
    assert_int_equal(simplified(&b).folded, 1);
    assert_int_equal(m->base_color_texture.texture, 0);
    assert_true(m->emission[0] == 6 && m->base_color[0] == 1);
    builder_release(&b);
}

static void test_anisotropy_and_thickness(void **state)
{
    static const uint8_t none[4] = {9, 200, 0}, along[4] = {255, 128, 100}, half[4] = {1, 128, 2};
    static const float exact[4] = {1, 0.5f, 0.25f, 1};
    struct scene_builder b;
    struct scene_material *m = start(&b);

    (void)state;
    m->anisotropy = 0.8f;
    m->anisotropy_texture.texture = add_even(&b, none, 3, 1);
    simplified(&b);
    assert_true(m->anisotropy == 0 && m->anisotropy_texture.texture == -1);
    builder_release(&b);

    m = start(&b);
    m->anisotropy = 0.8f;
    m->anisotropy_texture.texture = add_even(&b, along, 3, -1); /* 128 is not quite the tangent */
    simplified(&b);
    assert_true(m->anisotropy == 0.8f && m->anisotropy_texture.texture == 0);
    builder_release(&b);

    m = start(&b);
    m->anisotropy = 0.8f;
    m->anisotropy_texture.texture = add_texture(&b, add_image(&b, even_exr(exact)));
    simplified(&b);
    assert_true(m->anisotropy == 0.8f * 0.25f && m->anisotropy_texture.texture == -1);
    builder_release(&b);

    m = start(&b);
    m->iridescence = 1;
    m->iridescence_thickness_min_nm = 400;
    m->iridescence_thickness_max_nm = 100;
    m->iridescence_thickness_texture.texture = add_even(&b, half, 3, -1);
    simplified(&b);
    assert_true(m->iridescence_thickness_max_nm == 400 + (100.0f - 400.0f) * (128 / 255.0f));
    assert_true(m->iridescence_thickness_min_nm == m->iridescence_thickness_max_nm);
    assert_int_equal(m->iridescence_thickness_texture.texture, -1);
    builder_release(&b);
}

static void test_flat_normals(void **state)
{
    static const struct {
        uint8_t color[4];
        int odd, flat;
    } normals[] = {{{128, 128, 255}, -1, 1}, {{128, 128, 255}, 0, 1}, {{128, 128, 255}, 2, 1},
                   {{127, 128, 255}, -1, 1}, {{127, 128, 255}, 0, 0}, {{129, 128, 255}, -1, 0},
                   {{128, 128, 253}, -1, 0}, {{128, 255, 128}, -1, 0}};

    (void)state;
    for (size_t i = 0; i < sizeof normals / sizeof *normals; i++)
        for (int encoding = ENCODING_BY_SLOT; encoding < ENCODING_COUNT; encoding++) {
            struct scene_builder b;
            struct scene_material *m = start(&b);
            uint32_t flat = normals[i].flat && encoding != ENCODING_SRGB;

            m->normal_texture.texture = add_even(&b, normals[i].color, 3, normals[i].odd);
            b.scene.textures[0].encoding = (enum scene_encoding)encoding;
            m->clearcoat = 1;
            m->clearcoat_normal_texture.texture = m->normal_texture.texture;
            assert_int_equal(simplified(&b).flat_normals, 2 * flat);
            assert_int_equal(b.scene.image_count, !flat);
            builder_release(&b);
        }
}

/* ---- what has no weight --------------------------------------------------------------------- */

/* Two texels of different colours in every slot of a default material: only those that act on
 * it stay; and none of the others' images was even decoded (they are damaged). */
static void test_weightless_slots_are_dropped(void **state)
{
    static const size_t slots[] = {
        AT(base_color_texture), AT(metallic_roughness_texture), AT(normal_texture),
        AT(emission_texture), AT(specular_texture), AT(specular_color_texture),
        AT(transmission_texture), AT(anisotropy_texture), AT(clearcoat_texture),
        AT(clearcoat_roughness_texture), AT(clearcoat_normal_texture), AT(sheen_color_texture),
        AT(sheen_roughness_texture), AT(iridescence_texture), AT(iridescence_thickness_texture),
        AT(diffuse_transmission_texture), AT(diffuse_transmission_color_texture), AT(mix_texture)};
    enum { COUNT = sizeof slots / sizeof *slots };
    /* In the order above. */
    static const struct {
        const char *stays;
        enum scene_material_kind kind;
        int unlit, black;
        float metallic;
    } wanted[] = {
        {"111011............", MATERIAL_SURFACE, 0, 0, 0.5f},
        {"111...............", MATERIAL_CONDUCTOR, 0, 0, 1},
        {"..................", MATERIAL_INTERFACE, 0, 0, 1},
        /* The renderer loads no other texture of an unlit material. */
        {"1.................", MATERIAL_SURFACE, 1, 0, 1},
        {".11.11............", MATERIAL_SURFACE, 0, 1, 0.5f},
    };
    static const uint8_t pixels[8] = {10, 20, 30, 40, 200, 90, 70, 250};

    (void)state;
    for (size_t w = 0; w < sizeof wanted / sizeof *wanted; w++) {
        struct scene_builder b;
        struct scene_material *m = start(&b);
        uint32_t kept = 0;
        int32_t good;

        m->kind = wanted[w].kind;
        m->unlit = wanted[w].unlit;
        m->metallic = wanted[w].metallic;
        for (int c = 0; c < 3; c++) {
            m->conductor_eta[c] = 1;
            if (wanted[w].black)
                m->base_color[c] = 0;
        }
        good = add_texture(&b, add_image(&b, make_png(2, 1, 4, 8, pixels)));
        for (int i = 0; i < COUNT; i++) {
            if (wanted[w].stays[i] == '1') {
                slot_of(m, slots[i])->texture = good;
                kept++;
            } else {
                struct buffer bad = BUFFER_INIT;
                buffer_append(&bad, "\x89PNG\r\n\x1a\nnonsense", 16);
                slot_of(m, slots[i])->texture = add_texture(&b, add_image(&b, bad));
            }
        }
        assert_int_equal(simplified(&b).unseen, COUNT - kept);
        for (int i = 0; i < COUNT; i++)
            if (slot_of(m, slots[i])->texture != (wanted[w].stays[i] == '1' ? 0 : -1))
                fail_msg("material %zu, slot %d: %d", w, i, (int)slot_of(m, slots[i])->texture);
        assert_int_equal(b.scene.image_count, kept > 0);
        builder_release(&b);
    }
}

/* A clearcoat texture that is black everywhere takes its other two along. */
static void test_weight_folded_to_nothing(void **state)
{
    static const uint8_t black[4] = {0, 9, 9};
    static const uint8_t pixels[6] = {10, 20, 30, 200, 90, 70};
    struct scene_builder b;
    struct scene_material *m = start(&b);

    (void)state;
    m->clearcoat = 1;
    m->clearcoat_roughness = 1;
    m->clearcoat_texture.texture = add_even(&b, black, 3, -1);
    m->clearcoat_roughness_texture.texture = m->clearcoat_normal_texture.texture =
        add_texture(&b, add_image(&b, make_png(2, 1, 3, 8, pixels)));
    simplified(&b);
    assert_true(m->clearcoat == 0);
    assert_int_equal(b.scene.image_count, 0);
    builder_release(&b);
}

/* ---- alpha ----------------------------------------------------------------------------------- */

static void set_vertex_alpha(struct scene_builder *b, float alpha)
{
    struct scene_mesh *mesh = &b->scene.meshes[0];
    struct scene_mesh_layout old, new;
    uint8_t *data;
    struct buffer file = BUFFER_INIT;

    scene_mesh_layout(mesh, &old);
    mesh->arrays |= MESH_COLORS;
    scene_mesh_layout(mesh, &new);
    data = mem_calloc(new.total_bytes, 1);
    memcpy(data, b->blobs[0].data, new.colors);
    for (uint32_t i = 0; i < 4 * mesh->vertex_count; i++) {
        float value = i == 4 * mesh->vertex_count - 1 ? alpha : 1.0f;
        memcpy(data + new.colors + 4 * (size_t)i, &value, 4);
    }
    memcpy(data + new.indices, b->blobs[0].data + old.indices, new.total_bytes - new.indices);
    buffer_append(&file, data, new.total_bytes);
    mem_free(data);
    own_blob(b, file, &mesh->blob);
}

static void test_alpha_that_does_nothing(void **state)
{
    static const struct {
        enum scene_alpha_mode mode;
        float cutoff, factor, vertex; /* vertex 0: no colours */
        int texel, odd;               /* alpha of the texture, -1: none */
        int opaque;
    } wanted[] = {
        {ALPHA_BLEND, 0.5f, 1, 0, -1, -1, 1},  {ALPHA_BLEND, 0.5f, 0.99f, 0, -1, -1, 0},
        {ALPHA_BLEND, 0.5f, 1, 0, 255, -1, 1}, {ALPHA_BLEND, 0.5f, 1, 0, 254, -1, 0},
        {ALPHA_BLEND, 0.5f, 1, 0, 255, 3, 0},  {ALPHA_BLEND, 0.5f, 1, 0, 255, 1, 1},
        {ALPHA_BLEND, 0.5f, 1, 1, 255, 1, 1},  {ALPHA_BLEND, 0.5f, 1, 0.5f, 255, 1, 0},
        {ALPHA_BLEND, 0.5f, 1, 0.5f, -1, -1, 0}, {ALPHA_MASK, 0.5f, 1, 0, 255, 1, 1},
        {ALPHA_MASK, 0.5f, 0.6f, 0, -1, -1, 1}, {ALPHA_MASK, 0.5f, 0.4f, 0, -1, -1, 0},
        {ALPHA_MASK, 0.5f, 0.6f, 0.5f, -1, -1, 0}, {ALPHA_MASK, 1.5f, 1, 0, -1, -1, 0},
        {ALPHA_MASK, 0.5f, 1, 0, 128, 3, 0},   {ALPHA_MASK, 0, 0.2f, 0.5f, 128, 3, 1},
        {ALPHA_MASK, 0.5f, 1, 0, 200, -1, 1},
    };

    (void)state;
    for (size_t i = 0; i < sizeof wanted / sizeof *wanted; i++)
        for (int mixed = 0; mixed < 2; mixed++) {
            uint8_t color[4] = {200, 150, 100, (uint8_t)wanted[i].texel};
            struct scene_builder b;
            struct scene_material *m = start(&b);

            m->alpha_mode = wanted[i].mode;
            m->alpha_cutoff = wanted[i].cutoff;
            m->base_color[3] = wanted[i].factor;
            if (wanted[i].texel >= 0)
                m->base_color_texture.texture = add_even(&b, color, 4, wanted[i].odd);
            if (wanted[i].vertex > 0)
                set_vertex_alpha(&b, wanted[i].vertex);
            if (mixed) {
                struct scene_material *mix;
                struct scene_material other = *m;

                other.base_color_texture.texture = -1;
                *builder_lambert(&b, 1) = other;
                mix = builder_lambert(&b, 1);
                mix->kind = MATERIAL_MIX;
                mix->mix_amount = 0.5f;
                mix->mix_material[0] = 0;
                mix->mix_material[1] = 1;
                b.scene.instances[0].material = 2;
            }
            simplified(&b);
            assert_int_equal(m->alpha_mode, wanted[i].opaque ? ALPHA_OPAQUE : wanted[i].mode);
            builder_release(&b);
        }
}

/* ---- what nothing reaches ------------------------------------------------------------------- */

static void test_unreached_rows_go(void **state)
{
    static const uint8_t pixels[6] = {10, 20, 30, 200, 90, 70};
    uint8_t other[6];
    struct scene_builder b;
    struct scene_material *m = start(&b), *mix;
    struct scene_simplify_report report;
    struct digest kept[3];
    float time = 0, number = 0.5f;
    struct scene_track tracks[4];

    (void)state;
    for (uint32_t i = 0; i < 4; i++)
        tracks[i] = (struct scene_track){
            .target = i < 3 ? TRACK_MATERIAL : TRACK_LIGHT, .row = i < 3 ? i : 1,
            .field = i < 3 ? scene_track_value(MATERIAL_VALUE_roughness) : TRACK_LIGHT_RANGE,
            .keys = {.path = PATH_WEIGHTS, .key_count = 1, .components = 1, .times = &time, .values = &number}};
    for (int i = 0; i < 5; i++) {
        memcpy(other, pixels, sizeof other);
        other[0] = (uint8_t)(100 + i);
        add_image(&b, make_png(2, 1, 3, 8, other));
    }
    for (int i = 0; i < 5; i++)
        add_texture(&b, i); /* 4 is nobody's texture */
    m[0].name = "unused";
    m[0].base_color_texture.texture = 0;
    for (int i = 1; i < 4; i++) {
        struct scene_material *next = builder_lambert(&b, 0.1f * (float)i);
        next->base_color_texture.texture = i;
        next->name = i == 1 ? "one" : i == 2 ? "two" : "never";
    }
    mix = builder_lambert(&b, 1); /* 4: mixes 1 and 2 */
    mix->kind = MATERIAL_MIX;
    mix->mix_amount = 0.25f;
    mix->mix_material[0] = 1;
    mix->mix_material[1] = 2;
    mix = builder_lambert(&b, 1); /* 5: never shows 3 */
    mix->kind = MATERIAL_MIX;
    mix->mix_amount = 0;
    mix->mix_material[0] = 4;
    mix->mix_material[1] = 3;
    b.scene.instances[0].material = 5;
    builder_light(&b, LIGHT_POINT)->image = -1;
    builder_light(&b, LIGHT_GONIOMETRIC)->image = 3;
    kept[0] = b.scene.images[1].blob.digest;
    kept[1] = b.scene.images[2].blob.digest;
    kept[2] = b.scene.images[3].blob.digest;
    b.scene.tracks = tracks;
    b.scene.track_count = 4;

    report = simplified(&b);
    assert_int_equal(b.scene.track_count, 3);
    for (uint32_t i = 0; i < 2; i++)
        assert_true(tracks[i].target == TRACK_MATERIAL && tracks[i].row == i);
    assert_true(tracks[2].target == TRACK_LIGHT && tracks[2].row == 1);
    assert_int_equal(report.materials, 2);
    assert_int_equal(report.textures, 3);
    assert_int_equal(report.images, 2);
    assert_int_equal(report.mixes, 1);
    assert_true(report.image_bytes > 0);
    assert_int_equal(b.scene.material_count, 4);
    assert_string_equal(m[0].name, "one");
    assert_string_equal(m[1].name, "two");
    assert_int_equal(m[0].base_color_texture.texture, 0);
    assert_int_equal(m[1].base_color_texture.texture, 1);
    assert_int_equal(m[2].mix_material[0], 0);
    assert_int_equal(m[2].mix_material[1], 1);
    assert_int_equal(m[3].mix_material[0], 2);
    assert_int_equal(m[3].mix_material[1], 2);
    assert_int_equal(b.scene.instances[0].material, 3);
    assert_int_equal(b.scene.texture_count, 2);
    assert_int_equal(b.scene.textures[1].image, 1);
    assert_int_equal(b.scene.image_count, 3);
    assert_int_equal(b.scene.lights[0].image, -1);
    assert_int_equal(b.scene.lights[1].image, 2);
    for (int i = 0; i < 3; i++)
        assert_true(digest_equal(&b.scene.images[i].blob.digest, &kept[i]));
    /* A second time there is nothing left to do. */
    report = simplified(&b);
    assert_int_equal(report.folded + report.flat_normals + report.unseen + report.made_opaque + report.mixes +
                         report.materials + report.textures + report.images,
                     0);
    builder_release(&b);
}

static void test_uniform_environment(void **state)
{
    float rgb[4 * 2 * 3];

    (void)state;
    for (int odd = 0; odd < 2; odd++) {
        struct scene_builder b;
        struct scene_environment *e;

        start(&b);
        e = &b.scene.environment;
        for (int i = 0; i < 4 * 2 * 3; i++)
            rgb[i] = 0.25f * (float)(1 + i % 3);
        rgb[17] += (float)odd;
        builder_environment_map(&b, rgb, 4, 2);
        e->radiance[1] = 3;
        assert_int_equal(simplified(&b).uniform_environment, !odd);
        assert_int_equal(e->constant, !odd);
        assert_true(e->radiance[1] == (odd ? 3 : 1.5f));
        builder_release(&b);
        /* A map that was looked at is not decoded again. */
        start(&b);
        builder_environment_map(&b, rgb, 4, 2);
        b.scene.environment.varies = 1;
        assert_int_equal(simplified(&b).uniform_environment, 0);
        assert_int_equal(b.scene.environment.constant, 0);
        builder_release(&b);
    }
}

/* ---- the whole: pictures ---------------------------------------------------------------------- */

/* Random materials with constant images in random slots: the picture keeps its bits. */
static void test_pictures_keep_their_bits(void **state)
{
    enum { SCENES = 24, SIDE = 8 };

    (void)state;
    for (uint64_t seed = 0; seed < SCENES; seed++) {
        struct test_random random = {seed};
        struct scene_builder b;
        struct scene_material *m = start(&b);
        struct render_settings settings = builder_settings(SIDE, SIDE, 8);
        double before[SIDE * SIDE * 3], after[SIDE * SIDE * 3];
        struct render_stats stats = {0};
        struct render_scene *scene;

        for (int k = 0; k < CASES; k++) {
            uint8_t color[4];

            for (int c = 0; c < 4; c++)
                color[c] = test_random_u64(&random) % 4 ? (uint8_t)test_random_u64(&random) : 255;
            for (int i = 0; i < cases[k].parts; i++)
                *factor_of(m, cases[k].part[i].factor) = test_random_u64(&random) % 3 ? test_random_float(&random) : 0;
            if (test_random_u64(&random) % 2)
                slot_of(m, cases[k].slot)->texture = add_even(&b, color, 1 + (int)(test_random_u64(&random) % 4), -1);
        }
        m->double_sided = 1;
        m->alpha_mode = (enum scene_alpha_mode)(test_random_u64(&random) % ALPHA_COUNT);
        builder_environment_constant(&b, (struct vec3){1, 0.8f, 0.6f});
        builder_light(&b, LIGHT_POINT)->position[1] = 3;

        scene = builder_build(&b, &settings);
        builder_render(scene, &settings, 0, before, NULL, &stats);
        render_scene_free(scene);
        simplified(&b);
        assert_int_equal(b.scene.texture_count, 0);
        scene = builder_build(&b, &settings);
        builder_render(scene, &settings, 0, after, NULL, &stats);
        render_scene_free(scene);
        assert_memory_equal(before, after, sizeof before);
        builder_release(&b);
    }
}

/* ---- faults ------------------------------------------------------------------------------------ */

static status refuse_blob(void *user, const struct digest *digest, const uint8_t **data, size_t *size_bytes,
                          struct error *err)
{
    (void)user;
    (void)digest;
    (void)data;
    (void)size_bytes;
    return error_set(err, STATUS_ERR_NOT_FOUND, "no such blob");
}

static void test_damaged_images_are_named(void **state)
{
    struct scene_builder b;
    struct scene_material *m = start(&b);
    struct scene_simplify_report report;
    struct buffer file = even_file(2);
    struct error err = {0};

    (void)state;
    file.size /= 2;
    m->base_color_texture.texture = add_texture(&b, add_image(&b, file));
    b.scene.images[0].name = "bricks.png";
    assert_int_equal(scene_simplify(&b.scene, (struct scene_blob_reader){read_blob, &b}, &report, &err),
                     STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, "bricks.png"));
    assert_int_equal(scene_validate(&b.scene, &err), STATUS_OK);
    assert_int_equal(scene_simplify(&b.scene, (struct scene_blob_reader){refuse_blob, NULL}, &report, &err),
                     STATUS_ERR_NOT_FOUND);
    builder_release(&b);
}

/* Images are decoded side by side; the fault that is told is that of the first slot. */
static void test_first_damaged_image_is_named(void **state)
{
    (void)state;
    for (int run = 0; run < 50; run++) {
        struct scene_builder b;
        struct scene_material *m = start(&b);
        struct scene_simplify_report report;
        struct error err = {0};

        for (int i = 0; i < 2; i++) {
            struct buffer file = even_file(i ? 2 : 3);
            file.size /= 2;
            (i ? &m->base_color_texture : &m->emission_texture)->texture = add_texture(&b, add_image(&b, file));
        }
        m->emission[0] = 1;
        b.scene.images[0].name = "of emission";
        b.scene.images[1].name = "of base color";
        assert_int_equal(scene_simplify(&b.scene, (struct scene_blob_reader){read_blob, &b}, &report, &err),
                         STATUS_ERR_INPUT);
        assert_non_null(strstr(err.text, "of base color"));
        builder_release(&b);
    }
}

static void test_out_of_memory(void **state)
{
    static const uint8_t color[4] = {200, 150, 100, 255};
    int succeeded = 0;

    (void)state;
    for (long n = 0; n < 100 && !succeeded; n++) {
        struct scene_builder b;
        struct scene_material *m = start(&b);
        struct scene_simplify_report report;
        struct error err = {0};
        status st;

        m->base_color_texture.texture = add_even(&b, color, 3, -1);
        m->emission[0] = 1;
        m->emission_texture.texture = add_even(&b, color, 3, 0);
        mem_fault_arm(n, 1);
        st = scene_simplify(&b.scene, (struct scene_blob_reader){read_blob, &b}, &report, &err);
        succeeded = mem_fault_count() == 0;
        mem_fault_arm(-1, 0);
        assert_true(succeeded == (st == STATUS_OK));
        assert_int_equal(scene_validate(&b.scene, &err), STATUS_OK);
        builder_release(&b);
    }
    assert_true(succeeded);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_constants_fold_exactly),
        cmocka_unit_test(test_least_roughness),
        cmocka_unit_test(test_only_used_channels_count),
        cmocka_unit_test(test_what_must_stay),
        cmocka_unit_test(test_anisotropy_and_thickness),
        cmocka_unit_test(test_flat_normals),
        cmocka_unit_test(test_weightless_slots_are_dropped),
        cmocka_unit_test(test_weight_folded_to_nothing),
        cmocka_unit_test(test_alpha_that_does_nothing),
        cmocka_unit_test(test_unreached_rows_go),
        cmocka_unit_test(test_uniform_environment),
        cmocka_unit_test(test_pictures_keep_their_bits),
        cmocka_unit_test(test_damaged_images_are_named),
        cmocka_unit_test(test_first_damaged_image_is_named),
        cmocka_unit_test(test_out_of_memory),
    };

    return cmocka_run_group_tests_name("simplify", tests, NULL, NULL);
}
