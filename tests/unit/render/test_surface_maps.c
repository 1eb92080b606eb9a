/* Which way normal maps, brushings and texture coordinates lie at a hit, by hand: on both sides, mirrored,
 * with either handedness, and while the instance turns. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "tests/support/scene_builder.h"
#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"

enum { MAP_SIDE = 8 };
/* A normal map's texel, and what it says: x along the tangent, y along the bitangent. */
static const float texel[3] = {0.7f, 0.6f, 0.9f};
static const double tilt[3] = {0.4, 0.2, 0.8};

/* What the tests vary. */
struct wall {
    float handedness; /* of the tangents: 1 or -1 */
    int mirrored;     /* x -> -x */
    int from_behind;
    double turn_rad; /* while the shutter is open */
    int about;       /* the axis of that: 1: y, in the surface; 2: z, across it */
    float time;      /* of the ray */
    void (*dress)(struct scene_builder *b, struct scene_material *m);
};

static float alpha_seen, emission_seen; /* of the place looked at last */

/* A square in the xy plane whose tangents are +x; uv0 is x and y, uv1 is 1 - y and x, each 0 to 1;
 * its vertices' alpha is a half at the left, 1 at the right. */
static uint32_t square(struct scene_builder *b, float handedness)
{
    static const float positions[12] = {-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0};
    static const float normals[12] = {0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1};
    static const float uv0[8] = {0, 0, 1, 0, 1, 1, 0, 1}, uv1[8] = {1, 0, 1, 1, 0, 1, 0, 0};
    static const float colors[16] = {1, 1, 1, 0.5f, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0.5f};
    static const uint32_t indices[6] = {0, 1, 2, 0, 2, 3};
    const float h = handedness, tangents[16] = {1, 0, 0, h, 1, 0, 0, h, 1, 0, 0, h, 1, 0, 0, h};

    return builder_mesh_mapped(b, &(struct builder_mapped){
        .positions = positions, .normals = normals, .tangents = tangents, .uv0 = uv0, .uv1 = uv1,
        .colors = colors, .vertex_count = 4, .indices = indices, .triangle_count = 2});
}

static void turn(struct scene_builder *b, double angle, int about)
{
    static const float times[2] = {0, 1};
    float values[8] = {0, 0, 0, 1, 0, 0, 0, (float)cos(angle / 2)};

    values[4 + about] = (float)sin(angle / 2);

    b->scene.instances[0].node = (int32_t)builder_node(b, -1, 0);
    builder_channel(b, (uint32_t)b->scene.instances[0].node, PATH_ROTATION, 2, times, values);
}

/* The wall where a ray along the z axis, at (x, y), meets it. */
static void look(const struct wall *w, float x, float y, float footprint, struct surface *s, struct bsdf_params *params)
{
    const float side = w->from_behind ? -1 : 1;
    const struct ray ray = {.origin = {x, y, 5 * side}, .direction = {0, 0, -side}, .t_max = INFINITY,
                            .time = w->time};
    struct render_settings settings = builder_settings(16, 16, 16);
    struct render_scene *scene;
    struct scene_builder b;
    struct hit hit;

    settings.fps = 1;
    settings.shutter = 1;
    builder_init(&b);
    w->dress(&b, builder_lambert(&b, 0.5f));
    builder_place(&b, square(&b, w->handedness), 0, vec3_make(w->mirrored ? -1 : 1, 1, 1), vec3_splat(0));
    if (w->turn_rad != 0)
        turn(&b, w->turn_rad, w->about);
    builder_camera(&b, vec3_make(0, 0, 9), vec3_splat(0), 1);
    scene = builder_build(&b, &settings);
    assert_true(accel_intersect(scene->accel, &ray, NULL, &hit));
    surface_from_hit(scene, &ray, &hit, s);
    s->footprint = footprint;
    surface_shade(scene, s, vec3_neg(ray.direction), params);
    alpha_seen = material_alpha(s->material, s->mesh, s->vertex, s->b1, s->b2);
    emission_seen = material_emitted(s->material, s->mesh, s->vertex, s->b1, s->b2, 1, 1).x;
    /* What outlives the scene is the basis and the parameters. */
    render_scene_free(scene);
    builder_release(&b);
}

static void assert_direction(struct vec3 got, double x, double y, double z, double tolerance)
{
    double length = sqrt(x * x + y * y + z * z);

    if (fabs((double)got.x - x / length) > tolerance || fabs((double)got.y - y / length) > tolerance ||
        fabs((double)got.z - z / length) > tolerance)
        fail_msg("(%g, %g, %g) instead of (%g, %g, %g)", (double)got.x, (double)got.y, (double)got.z, x / length,
                 y / length, z / length);
}

/* ---- normal maps and brushings ------------------------------------------------------------------ */

static float map_scale;

static void put_slot(struct scene_texture_slot *slot, uint32_t texture)
{
    *slot = (struct scene_texture_slot){.texture = (int32_t)texture, .uv_transform = {{1, 0, 0}, {0, 1, 0}}};
}

static void map_normals(struct scene_builder *b, struct scene_material *m)
{
    put_slot(&m->normal_texture, builder_texture(b, texel, 1, 1));
    m->normal_scale = map_scale;
}

/* The image's tangent space is the mesh's: its y is on the handedness' side, whatever mirrors the instance
 * and from wherever it is seen; the scale is of x and y alone. */
static void a_normal_map_lies_as_the_tangents_say(void **state)
{
    (void)state;
    for (int k = 0; k < 16; k++) {
        struct wall w = {.handedness = k & 1 ? -1 : 1, .mirrored = k >> 1 & 1, .from_behind = k >> 2 & 1,
                         .dress = map_normals};
        struct bsdf_params params;
        struct surface s;
        double side = w.from_behind ? -1 : 1;

        map_scale = k & 8 ? 0.5f : 1;
        look(&w, 0.2f, 0.1f, 0, &s, &params);
        assert_direction(s.basis.n, side * (w.mirrored ? -1 : 1) * (double)map_scale * tilt[0],
                         side * (double)(w.handedness * map_scale) * tilt[1], side * tilt[2], 1e-5);
    }
}

/* It turns with the instance, at each moment: normal and tangent do. */
static void a_normal_map_turns_with_its_instance(void **state)
{
    (void)state;
    map_scale = 1;
    for (int i = 0; i <= 16; i++) {
        struct wall w = {.handedness = 1, .turn_rad = 0.8, .about = 1 + i % 2, .time = (float)i / 16, .dress = map_normals};
        double a = 0.8 * i / 16, c = cos(a), sine = sin(a);
        struct bsdf_params params;
        struct surface s;

        look(&w, 0.2f, 0.1f, 0, &s, &params);
        if (w.about == 1)
            assert_direction(s.basis.n, c * tilt[0] + sine * tilt[2], tilt[1], c * tilt[2] - sine * tilt[0], 2e-3);
        else
            assert_direction(s.basis.n, c * tilt[0] - sine * tilt[1], sine * tilt[0] + c * tilt[1], tilt[2], 2e-3);
    }
}

static void brush(struct scene_builder *b, struct scene_material *m)
{
    (void)b;
    m->metallic = 1;
    m->roughness = 0.5f;
    m->anisotropy = 0.6f;
    m->anisotropy_rotation_rad = 0.5f;
}

/* A brushing lies in the surface: counter-clockwise from the tangent to the bitangent, the same on both sides,
 * but for its sign. */
static void a_brushing_is_the_same_on_both_sides(void **state)
{
    (void)state;
    for (int k = 0; k < 8; k++) {
        struct wall w = {.handedness = k & 1 ? -1 : 1, .mirrored = k >> 1 & 1, .from_behind = k >> 2 & 1, .dress = brush};
        struct bsdf_params params;
        struct surface s;

        look(&w, 0.2f, 0.1f, 0, &s, &params);
        assert_direction(s.basis.s, (w.mirrored ? -1 : 1) * cos(0.5), (double)w.handedness * sin(0.5), 0, 1e-5);
        assert_true(params.alpha_stretched > params.alpha);
    }
}

static void coat(struct scene_builder *b, struct scene_material *m)
{
    static const float plain[3] = {0.5f, 0.5f, 1}, other[3] = {0.4f, 0.55f, 0.9f};

    put_slot(&m->clearcoat_normal_texture, builder_texture(b, texel, 1, 1));
    m->clearcoat = m->clearcoat_normal_scale = 1;
    put_slot(&m->normal_texture, builder_texture(b, map_scale > 0 ? other : plain, 1, 1));
    m->normal_scale = 1;
}

/* A coat has its own map, whatever that of its base. */
static void a_coat_has_its_own_map(void **state)
{
    (void)state;
    for (int k = 0; k < 2; k++) {
        struct wall w = {.handedness = 1, .dress = coat};
        struct bsdf_params params;
        struct surface s;

        map_scale = (float)k;
        look(&w, 0.2f, 0.1f, 0, &s, &params);
        assert_direction(basis_to_world(&s.basis, params.clearcoat_normal), tilt[0], tilt[1], tilt[2], 1e-5);
        if (k == 1)
            assert_direction(s.basis.n, -0.2, 0.1, 0.8, 1e-5);
    }
}

static void veil(struct scene_builder *b, struct scene_material *m)
{
    (void)b;
    m->alpha_mode = ALPHA_MASK;
    m->alpha_cutoff = 0; /* rays meet all of it */
    m->base_color[3] = 0.8f;
}

static void textured_veil(struct scene_builder *b, struct scene_material *m)
{
    static const float grey[3] = {0.3f, 0.3f, 0.3f};

    veil(b, m);
    put_slot(&m->base_color_texture, builder_texture(b, grey, 1, 1));
}

/* Alpha is the material's times the vertices', interpolated; a texture without alpha changes nothing. */
static void alpha_is_the_vertices_too(void **state)
{
    (void)state;
    for (int i = 0; i < 18; i++) {
        const struct wall w = {.handedness = 1, .dress = i < 9 ? veil : textured_veil};
        float x = -0.8f + 0.2f * (float)(i % 9);
        struct bsdf_params params;
        struct surface s;

        look(&w, x, 0.1f, 0, &s, &params);
        assert_true(fabsf(alpha_seen - 0.8f * (0.75f + 0.25f * x)) < 1e-5f);
    }
}

static void coated_lamp(struct scene_builder *b, struct scene_material *m)
{
    static const float coat[3] = {0.5f, 0, 0}, glow[3] = {0.25f, 1, 1};

    m->emission[0] = 8;
    put_slot(&m->emission_texture, builder_texture(b, glow, 1, 1));
    m->clearcoat = 0.8f;
    m->clearcoat_ior = 1.5f;
    put_slot(&m->clearcoat_texture, builder_texture(b, coat, 1, 1));
}

/* What shines under a coat is dimmed by as much coat as its texture leaves. */
static void a_lamps_coat_has_its_texture(void **state)
{
    const struct wall w = {.handedness = 1, .dress = coated_lamp};
    struct bsdf_params params;
    struct surface s;

    (void)state;
    look(&w, 0.1f, 0.1f, 0, &s, &params);
    assert_true(fabsf(params.clearcoat - 0.4f) < 1e-6f);
    assert_true(fabsf(emission_seen - 8 * 0.25f * (1 - 0.04f * 0.4f)) < 1e-5f);
}

/* ---- texture coordinates -------------------------------------------------------------------------- */

static struct scene_texture_slot slot;
static int nearest;

/* Red is the column, green the row, blue a fine pattern. */
static void map_colors(struct scene_builder *b, struct scene_material *m)
{
    float rgb[MAP_SIDE * MAP_SIDE * 3];

    for (int y = 0; y < MAP_SIDE; y++)
        for (int x = 0; x < MAP_SIDE; x++) {
            float *p = rgb + 3 * (y * MAP_SIDE + x);
            p[0] = ((float)x + 0.5f) / MAP_SIDE;
            p[1] = ((float)y + 0.5f) / MAP_SIDE;
            p[2] = (float)((x + y) % 3) / 2;
        }
    slot.texture = (int32_t)builder_texture(b, rgb, MAP_SIDE, MAP_SIDE);
    b->scene.textures[slot.texture].nearest = nearest;
    m->base_color[0] = m->base_color[1] = m->base_color[2] = 1;
    m->base_color_texture = slot;
}

static struct vec3 color_at(float x, float y, float footprint)
{
    const struct wall w = {.handedness = 1, .dress = map_colors};
    struct bsdf_params params;
    struct surface s;

    look(&w, x, y, footprint, &s, &params);
    return params.base_color;
}

/* Both sets of coordinates, straight, turned, stretched and moved: the texel that holds the coordinate. */
static void texture_coordinates_are_the_slots(void **state)
{
    static const float transforms[][2][3] = {
        {{1, 0, 0}, {0, 1, 0}}, {{0.8f, -0.6f, 0.5f}, {0.6f, 0.8f, 0}}, {{0.5f, 0, 0.25f}, {0, 0.75f, 0.1f}}, {{0, 1, 0}, {-1, 0, 1}}};
    static const float at[][2] = {{-0.7f, -0.2f}, {0.33f, 0.6f}, {0.05f, -0.85f}};

    (void)state;
    nearest = 1;
    for (size_t k = 0; k < 4 * 3 * 2; k++) {
        const float(*m)[3] = transforms[k / 6];
        const float *p = at[k / 2 % 3];
        float x = (p[0] + 1) / 2, y = (p[1] + 1) / 2, u = k % 2 ? 1 - y : x, v = k % 2 ? x : y;
        double mapped[2];
        struct vec3 got;

        slot = (struct scene_texture_slot){.uv_set = (uint32_t)(k % 2)};
        for (int a = 0; a < 2; a++) {
            for (int c = 0; c < 3; c++)
                slot.uv_transform[a][c] = m[a][c];
            mapped[a] = (double)(m[a][0] * u + m[a][1] * v + m[a][2]);
            mapped[a] -= floor(mapped[a]);
        }
        got = color_at(p[0], p[1], 0);
        assert_true(fabs((double)got.x - (floor(mapped[0] * MAP_SIDE) + 0.5) / MAP_SIDE) < 1e-5);
        assert_true(fabs((double)got.y - (floor(mapped[1] * MAP_SIDE) + 0.5) / MAP_SIDE) < 1e-5);
    }
}

/* A slot that repeats its image four times averages over four times as many texels: as a beam that is four
 * times as wide does without. */
static void a_beam_widens_with_the_transform(void **state)
{
    (void)state;
    nearest = 0;
    for (int k = 0; k < 3; k++) {
        float wide = 0.25f * (float)(1 << k) / MAP_SIDE;
        struct vec3 repeated, plain;

        slot = (struct scene_texture_slot){.uv_transform = {{4, 0, 0}, {0, 4, 0}}};
        repeated = color_at(-0.95f, -0.95f, wide);
        slot = (struct scene_texture_slot){.uv_transform = {{1, 0, 0}, {0, 1, 0}}};
        plain = color_at(-0.8f, -0.8f, 4 * wide);
        assert_true(vec3_length(vec3_sub(repeated, plain)) < 1e-4f);
        plain = color_at(-0.8f, -0.8f, wide);
        assert_true(k == 0 || vec3_length(vec3_sub(repeated, plain)) > 1e-2f);
    }
}

/* What the second of two textures has that the first has not: a number of ways, and what is read by all of them. */
enum { SLOT_WAYS = 11 };
static int slot_way, with_first;

/* Two images of one size: the first is the base colour's. */
static void map_two(struct scene_builder *b, struct scene_material *m)
{
    struct scene_texture_slot first, second;

    map_colors(b, m);
    first = m->base_color_texture;
    map_colors(b, m);
    second = m->base_color_texture;
    m->base_color_texture = first;
    if (slot_way == 1)
        b->scene.textures[second.texture].wrap_u = WRAP_MIRROR;
    if (slot_way == 2)
        b->scene.textures[second.texture].wrap_v = WRAP_MIRROR;
    if (slot_way == 3)
        b->scene.textures[second.texture].nearest = 1;
    if (slot_way == 4)
        second.uv_set = 1;
    if (slot_way > 4)
        (&second.uv_transform[0][0])[slot_way - 5] += 0.375f;
    if (!with_first)
        m->base_color_texture.texture = -1;
    m->metallic = m->roughness = 1;
    m->metallic_roughness_texture = second;
}

/* Two textures may share where they are read only if their slots say the same: each is as it is alone. */
static void textures_beside_others_lie_as_their_slots_say(void **state)
{
    static const float at[][2] = {{0.97f, 0.6f}, {-0.3f, -0.98f}};
    const struct wall w = {.handedness = 1, .dress = map_two};
    double plain[2] = {0, 0};

    (void)state;
    nearest = 0;
    slot = (struct scene_texture_slot){.uv_transform = {{2, 0, 0.25f}, {0, 2, 0.25f}}}; /* past the image's edges */
    for (slot_way = 0; slot_way < SLOT_WAYS; slot_way++) {
        int differs = slot_way == 0;
        for (size_t k = 0; k < 2; k++) {
            struct bsdf_params params;
            double alone;
            struct surface s;

            with_first = 0;
            look(&w, at[k][0], at[k][1], 0.05f, &s, &params);
            alone = (double)params.metallic + 4 * (double)params.alpha;
            with_first = 1;
            look(&w, at[k][0], at[k][1], 0.05f, &s, &params);
            assert_true((double)params.metallic + 4 * (double)params.alpha == alone);
            plain[k] = slot_way == 0 ? alone : plain[k];
            differs |= fabs(alone - plain[k]) > 1e-4;
        }
        assert_true(differs);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_normal_map_lies_as_the_tangents_say),
        cmocka_unit_test(a_normal_map_turns_with_its_instance),
        cmocka_unit_test(a_brushing_is_the_same_on_both_sides),
        cmocka_unit_test(a_coat_has_its_own_map),
        cmocka_unit_test(alpha_is_the_vertices_too),
        cmocka_unit_test(a_lamps_coat_has_its_texture),
        cmocka_unit_test(texture_coordinates_are_the_slots),
        cmocka_unit_test(a_beam_widens_with_the_transform),
        cmocka_unit_test(textures_beside_others_lie_as_their_slots_say),
    };
    return cmocka_run_group_tests_name("surface maps", tests, NULL, NULL);
}
