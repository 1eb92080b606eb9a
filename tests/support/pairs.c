#include "tests/support/pairs.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "tests/support/scene_builder.h"

struct pair_stage {
    struct scene_builder b;
    struct scene_material *surface; /* of the ball that the next thing changes */
    uint32_t ball;                  /* its mesh */
    uint32_t instance;
    int passes; /* light passes the ball, */
    int bases;  /* which has so many surfaces by now */
    int clouds; /* around it */
};

static void set(float *rgb, float r, float g, float b)
{
    rgb[0] = r;
    rgb[1] = g;
    rgb[2] = b;
}

/* ---- the stage ---------------------------------------------------------------------------------- */

enum { RINGS = 8, SPOKES = 16, CORNERS = (RINGS + 1) * (SPOKES + 1), FACES = 2 * SPOKES * (RINGS - 1) };

/* A ball around the origin whose seam and poles have vertices of their own, at equal places. */
static uint32_t ball_mesh(struct scene_builder *b)
{
    static float p[CORNERS][3], tangents[CORNERS][4], uv[CORNERS][2], colors[CORNERS][4];
    static uint32_t faces[FACES][3];
    uint32_t count = 0, mesh;

    for (uint32_t r = 0; r <= RINGS; r++)
        for (uint32_t s = 0; s <= SPOKES; s++) {
            const uint32_t at = r * (SPOKES + 1) + s;
            const double theta = M_PI * r / RINGS, phi = 2 * M_PI * (s % SPOKES) / SPOKES;
            const double across = r == 0 || r == RINGS ? 0 : sin(theta);
            set(p[at], (float)(across * cos(phi)), (float)cos(theta), (float)(across * sin(phi)));
            set(tangents[at], (float)-sin(phi), 0, (float)cos(phi));
            tangents[at][3] = 1;
            uv[at][0] = (float)s / SPOKES * 2;
            uv[at][1] = (float)r / RINGS;
            set(colors[at], 0.5f + 0.5f * (float)(s % 2), 1, 0.6f + 0.4f * (float)(r % 2));
            colors[at][3] = 1;
        }
    for (uint32_t r = 0; r < RINGS; r++)
        for (uint32_t s = 0; s < SPOKES; s++) {
            const uint32_t a = r * (SPOKES + 1) + s, c = a + SPOKES + 1;
            if (r > 0)
                memcpy(faces[count++], (uint32_t[]){a, a + 1, c + 1}, 12);
            if (r < RINGS - 1)
                memcpy(faces[count++], (uint32_t[]){a, c + 1, c}, 12);
        }
    mesh = builder_mesh_mapped(b, &(struct builder_mapped){.positions = p[0], .normals = p[0], .tangents = tangents[0], .uv0 = uv[0],
                                                           .colors = colors[0], .vertex_count = CORNERS, .indices = faces[0],
                                                           .triangle_count = FACES});
    b->scene.meshes[mesh].closed = 1;
    return mesh;
}

static void wall(struct scene_builder *b, const float corners[4][3], float r, float g, float blue)
{
    float quad[1][4][3];

    memcpy(quad, corners, sizeof quad);
    set(builder_lambert(b, 0)->base_color, r, g, blue);
    builder_place(b, builder_quads(b, quad, 1), builder_last_material(b), vec3_splat(1), vec3_splat(0));
}

static void put_ball(struct pair_stage *stage, float radius, struct vec3 at)
{
    stage->surface = builder_lambert(&stage->b, 0.6f);
    stage->instance = stage->b.scene.instance_count;
    builder_place(&stage->b, stage->ball, builder_last_material(&stage->b), vec3_splat(radius), at);
}

static void set_stage(struct pair_stage *stage, int open)
{
    static const float walls[5][4][3] = {
        {{-3, -1, -3}, {-3, -1, 6}, {3, -1, 6}, {3, -1, -3}}, {{-3, -1, -3}, {3, -1, -3}, {3, 3, -3}, {-3, 3, -3}},
        {{-3, -1, 6}, {-3, 3, 6}, {3, 3, 6}, {3, -1, 6}},     {{-3, -1, -3}, {-3, 3, -3}, {-3, 3, 6}, {-3, -1, 6}},
        {{3, -1, -3}, {3, -1, 6}, {3, 3, 6}, {3, 3, -3}}};
    static const float ceiling[4][3] = {{-3, 3, -3}, {3, 3, -3}, {3, 3, 6}, {-3, 3, 6}};
    static const float lamp[4][3] = {{0.5f, 2.5f, 0}, {1.5f, 2.5f, 0}, {1.5f, 2.5f, 1.5f}, {0.5f, 2.5f, 1.5f}};
    static const float card[4][3] = {{-1.5f, -1, -2}, {0.5f, -1, -1.5f}, {0.5f, 1.5f, -1.5f}, {-1.5f, 1.5f, -2}};

    *stage = (struct pair_stage){0};
    builder_init(&stage->b);
    for (int i = 0; i < 5; i++)
        wall(&stage->b, walls[i], 0.7f, i == 3 ? 0.3f : 0.6f, i == 4 ? 0.3f : 0.6f);
    if (!open)
        wall(&stage->b, ceiling, 0.7f, 0.7f, 0.7f);
    wall(&stage->b, card, 0.7f, 0.1f, 0.1f);
    wall(&stage->b, lamp, 0, 0, 0);
    set(stage->b.scene.materials[builder_last_material(&stage->b)].emission, 8, 7, 6);
    builder_camera(&stage->b, vec3_make(0.3f, 0.7f, 4.5f), vec3_splat(0), 0.6f);
    stage->ball = ball_mesh(&stage->b);
    put_ball(stage, 1, vec3_splat(0));
}

/* ---- what a ball is made of ---------------------------------------------------------------------- */

/* The ball that the next surface is of. */
static struct scene_material *base(struct pair_stage *stage, int passes)
{
    if (stage->bases++ > 0) {
        if (stage->passes)
            put_ball(stage, 0.55f, vec3_make(0.1f, -0.05f, 0.05f));
        else
            put_ball(stage, 0.6f, vec3_make(1.3f, -0.35f, 0.95f));
    }
    stage->passes |= passes;
    return stage->surface;
}

static void metal(struct pair_stage *stage)
{
    struct scene_material *m = base(stage, 0);

    m->kind = MATERIAL_CONDUCTOR;
    set(m->conductor_eta, 0.2f, 0.4f, 1.3f);
    set(m->conductor_k, 3.9f, 2.4f, 1.8f);
    m->roughness = 0.5f;
}

static void mirror(struct pair_stage *stage)
{
    struct scene_material *m = base(stage, 0);

    m->metallic = 1;
    m->roughness = 0;
}

static void gloss(struct pair_stage *stage)
{
    struct scene_material *m = base(stage, 0);

    m->specular = 1;
    m->roughness = 0.4f;
    set(m->base_color, 0.2f, 0.5f, 0.3f);
}

static struct scene_material *glass_of(struct pair_stage *stage, float roughness)
{
    struct scene_material *m = base(stage, 1);

    m->specular = m->transmission = 1;
    m->refractive = 1;
    m->roughness = roughness;
    set(m->base_color, 1, 1, 1);
    return m;
}

static void glass(struct pair_stage *stage) { (void)glass_of(stage, 0); }

static void frosted(struct pair_stage *stage) { (void)glass_of(stage, 0.5f); }

static void thin_wall(struct pair_stage *stage)
{
    struct scene_material *m = base(stage, 1);

    m->specular = 1;
    m->transmission = 0.7f;
    m->roughness = 0.4f;
}

static void translucent(struct pair_stage *stage)
{
    struct scene_material *m = base(stage, 1);

    m->diffuse_transmission = 0.6f;
    set(m->diffuse_transmission_color, 0.9f, 0.6f, 0.4f);
}

static void clay(struct pair_stage *stage) { base(stage, 0)->diffuse_roughness = 0.8f; }

static void mixed(struct pair_stage *stage)
{
    struct scene_material mix;

    (void)base(stage, 0);
    set(builder_lambert(&stage->b, 0.2f)->base_color, 0.1f, 0.2f, 0.7f);
    stage->surface = builder_lambert(&stage->b, 0.9f); /* what comes next changes this part */
    stage->surface->metallic = 1;
    stage->surface->roughness = 0.5f;
    scene_material_default(&mix);
    mix.name = "mix";
    mix.double_sided = 1;
    mix.kind = MATERIAL_MIX;
    mix.mix_amount = 0.4f;
    mix.mix_material[0] = builder_last_material(&stage->b) - 1;
    mix.mix_material[1] = builder_last_material(&stage->b);
    stage->b.scene.materials[stage->b.scene.material_count++] = mix;
    stage->b.scene.instances[stage->instance].material = builder_last_material(&stage->b);
}

/* ---- what changes a surface ----------------------------------------------------------------------- */

static void glowing(struct pair_stage *stage) { set(stage->surface->emission, 0.2f, 0.5f, 0.9f); }

static void coated(struct pair_stage *stage)
{
    stage->surface->clearcoat = 0.8f;
    stage->surface->clearcoat_roughness = 0.3f;
}

static void sheen(struct pair_stage *stage)
{
    set(stage->surface->sheen_color, 0.8f, 0.5f, 0.3f);
    stage->surface->sheen_roughness = 0.5f;
}

static void film(struct pair_stage *stage)
{
    stage->surface->specular = 1;
    stage->surface->iridescence = 0.9f;
    stage->surface->iridescence_thickness_max_nm = 512;
}

static void brushed(struct pair_stage *stage)
{
    stage->surface->roughness = 0.5f;
    stage->surface->anisotropy = 0.7f;
    stage->surface->anisotropy_rotation_rad = 0.4f;
}

static uint32_t picture(struct pair_stage *stage, float low, float high, int is_map)
{
    float rgb[4][4][3];

    for (int y = 0; y < 4; y++)
        for (int x = 0; x < 4; x++) {
            const float v = (x + y) % 2 ? high : low;
            set(rgb[y][x], v, is_map ? 0.5f : (float)(x + 1) / 4, is_map ? 1 : v);
        }
    return builder_texture(&stage->b, rgb[0][0], 4, 4);
}

static void bumpy(struct pair_stage *stage) { stage->surface->normal_texture.texture = (int32_t)picture(stage, 0.35f, 0.65f, 1); }

static void painted(struct pair_stage *stage) { stage->surface->base_color_texture.texture = (int32_t)picture(stage, 0.2f, 0.9f, 0); }

static void rough_in_places(struct pair_stage *stage)
{
    stage->surface->metallic_roughness_texture.texture = (int32_t)picture(stage, 0.3f, 0.9f, 0);
}

static void blended(struct pair_stage *stage)
{
    stage->surface->alpha_mode = ALPHA_BLEND;
    stage->surface->base_color[3] = 0.6f;
    stage->passes = 1;
}

static void one_sided(struct pair_stage *stage) { stage->surface->double_sided = 0; }

/* The ball that light passes, of glass if nothing has said of what. */
static struct scene_material *filled(struct pair_stage *stage)
{
    if (!stage->surface->refractive)
        glass(stage);
    return stage->surface;
}

static void absorbing(struct pair_stage *stage)
{
    (void)filled(stage);
    stage->surface->attenuation_distance = 0.5f;
    set(stage->surface->attenuation_color, 0.8f, 0.4f, 0.6f);
}

static void dispersing(struct pair_stage *stage) { filled(stage)->dispersion = 1; }

/* ---- what fills and surrounds it ------------------------------------------------------------------- */

static struct scene_medium *matter(struct pair_stage *stage, float density)
{
    struct scene_medium *m = builder_medium(&stage->b);

    set(m->absorption, 0.1f * density, 0.2f * density, 0.3f * density);
    set(m->scattering, 0.6f * density, 0.5f * density, 0.4f * density);
    m->g = 0.3f;
    return m;
}

/* A ball of it, without a surface, around the others. No two are in the same place: which of them fills it would be anybody's
 * guess. */
static struct scene_material *cloud(struct pair_stage *stage)
{
    struct scene_material *m = builder_lambert(&stage->b, 1);

    m->kind = MATERIAL_INTERFACE;
    stage->clouds++;
    builder_place(&stage->b, stage->ball, builder_last_material(&stage->b), vec3_splat(1.7f - 0.03f * (float)stage->clouds), vec3_make(0.2f, 0.8f + 0.03f * (float)stage->clouds, 0.1f));
    return m;
}

static int32_t last_medium(const struct pair_stage *stage) { return (int32_t)stage->b.scene.medium_count - 1; }

static void haze(struct pair_stage *stage)
{
    (void)matter(stage, 0.5f);
    cloud(stage)->medium = last_medium(stage);
}

static void smoke(struct pair_stage *stage)
{
    float density[4 * 4 * 4];

    for (int i = 0; i < 64; i++)
        density[i] = (float)(i * 37 % 11) / 8;
    builder_grid(&stage->b, matter(stage, 1), density, (uint32_t[]){4, 4, 4}, vec3_make(-1.5f, -0.9f, -1.6f), vec3_make(1.9f, 2.5f, 1.8f));
    cloud(stage)->medium = last_medium(stage);
}

static void fire(struct pair_stage *stage)
{
    set(matter(stage, 0.3f)->emission, 0.6f, 0.3f, 0.1f);
    cloud(stage)->medium = last_medium(stage);
}

static void fog(struct pair_stage *stage)
{
    (void)matter(stage, 0.05f);
    stage->b.scene.fog = last_medium(stage);
}

static void milk(struct pair_stage *stage)
{
    (void)matter(stage, 2);
    filled(stage)->medium = last_medium(stage);
}

static void ice(struct pair_stage *stage)
{
    struct scene_material *m = builder_lambert(&stage->b, 1);

    m->specular = m->transmission = 1;
    m->refractive = 1;
    m->roughness = 0;
    m->ior = 1.25f;
    m->priority = 1;
    builder_place(&stage->b, stage->ball, builder_last_material(&stage->b), vec3_splat(0.5f), vec3_make(-0.6f, 0.5f, 0.5f));
}

static void nothing(struct pair_stage *stage) { (void)cloud(stage); }

/* ---- lamps, the sky ---------------------------------------------------------------------------------- */

static struct scene_light *lamp(struct pair_stage *stage, enum scene_light_kind kind)
{
    struct scene_light *l = builder_light(&stage->b, kind);

    l->position[0] = -1.5;
    l->position[1] = 2;
    l->position[2] = 1.5;
    set(l->direction, 0.6f, -0.64f, -0.48f);
    set(l->intensity, 4, 6, 9);
    return l;
}

static void point(struct pair_stage *stage) { lamp(stage, LIGHT_POINT)->range = 4; }

static void spot(struct pair_stage *stage) { lamp(stage, LIGHT_SPOT)->inner_cone_rad = 0.2f; }

static void sun(struct pair_stage *stage) { set(lamp(stage, LIGHT_DIRECTIONAL)->intensity, 2, 2, 1); }

static void with_image(struct pair_stage *stage, enum scene_light_kind kind)
{
    const uint32_t texture = picture(stage, 0.3f, 1, 0);
    struct scene_light *l = lamp(stage, kind);

    l->image = (int32_t)stage->b.scene.textures[texture].image;
    /* looks along -Z from above: to -y, tilted */
    l->to_world = (struct transform_d){{{1, 0, 0, -0.3}, {0, 0, 1, 2.4}, {0, -1, 0, 0.8}}};
    for (int c = 0; c < 3; c++)
        l->position[c] = l->to_world.m[c][3];
    l->projection_yfov_rad = 1.2f;
    l->projection_aspect = 1.5f;
}

static void gonio(struct pair_stage *stage) { with_image(stage, LIGHT_GONIOMETRIC); }

static void slide(struct pair_stage *stage) { with_image(stage, LIGHT_PROJECTION); }

static void sky(struct pair_stage *stage)
{
    float rgb[4][8][3];

    for (int y = 0; y < 4; y++)
        for (int x = 0; x < 8; x++)
            set(rgb[y][x], x == 3 && y == 1 ? 20 : 0.3f, 0.4f, (float)(y + 1) / 4);
    builder_environment_map(&stage->b, rgb[0][0], 8, 4);
}

static void window(struct pair_stage *stage)
{
    struct scene_environment *e = &stage->b.scene.environment;

    if (!e->present)
        builder_environment_constant(&stage->b, vec3_make(0.5f, 0.6f, 0.8f));
    e->portals = arena_alloc(&stage->b.scene.arena, 1, sizeof *e->portals);
    if (!e->portals)
        abort();
    e->portal_count = 1;
    e->portals[0] = (struct scene_portal){{-3, 3, -3}, {6, 0, 0}, {0, 0, 9}};
}

/* ---- the camera, and what moves ------------------------------------------------------------------------ */

static struct scene_camera *camera(struct pair_stage *stage) { return &stage->b.scene.cameras[0]; }

static void ortho(struct pair_stage *stage)
{
    camera(stage)->kind = CAMERA_ORTHOGRAPHIC;
    camera(stage)->xmag = camera(stage)->ymag = 1.5f;
}

static void lens(struct pair_stage *stage)
{
    camera(stage)->lens_radius = 0.15f;
    camera(stage)->focus_distance = 3.5f;
    camera(stage)->blades = 5;
}

static void panorama(struct pair_stage *stage) { camera(stage)->kind = CAMERA_PANORAMA; }

static const float moments[2] = {0, 1};

static uint32_t node_at(struct pair_stage *stage, const struct transform_d *at, double scale)
{
    const uint32_t number = builder_node(&stage->b, -1, 0);
    struct scene_node *node = &stage->b.scene.nodes[number];

    for (int c = 0; c < 3; c++) {
        node->translation[c] = at->m[c][3];
        node->scale[c] = scale;
    }
    camera(stage)->shutter_close_s = 0.5f;
    return number;
}

static struct scene_instance *moved_ball(struct pair_stage *stage)
{
    struct scene_instance *i = &stage->b.scene.instances[stage->instance];

    if (i->node < 0)
        i->node = (int32_t)node_at(stage, &i->to_world, i->to_world.m[0][0]);
    return i;
}

static void moving(struct pair_stage *stage)
{
    const struct scene_instance *i = moved_ball(stage);
    float places[2][3];

    for (int k = 0; k < 2; k++)
        for (int c = 0; c < 3; c++)
            places[k][c] = (float)i->to_world.m[c][3] + (k ? 0.5f : 0) * (c == 0);
    builder_channel(&stage->b, (uint32_t)i->node, PATH_TRANSLATION, 2, moments, places[0]);
}

static void turning(struct pair_stage *stage)
{
    static const float turns[2][4] = {{0, 0, 0, 1}, {0, 0.6f, 0, 0.8f}};

    builder_channel(&stage->b, (uint32_t)moved_ball(stage)->node, PATH_ROTATION, 2, moments, turns[0]);
}

static void swelling(struct pair_stage *stage)
{
    const struct scene_instance *i = moved_ball(stage);
    const float from = (float)i->to_world.m[0][0], sizes[2][3] = {{from, from, from}, {from, 1.4f * from, from}};

    builder_channel(&stage->b, (uint32_t)i->node, PATH_SCALE, 2, moments, sizes[0]);
}

static void filming(struct pair_stage *stage)
{
    struct scene_camera *c = camera(stage);
    const uint32_t node = builder_node(&stage->b, -1, 0);
    struct scene_node *n = &stage->b.scene.nodes[node];
    float places[2][3];

    c->shutter_close_s = 0.5f;
    for (int k = 0; k < 3; k++) {
        n->translation[k] = c->to_world.m[k][3];
        places[0][k] = (float)c->to_world.m[k][3];
        places[1][k] = places[0][k] - (k == 0 ? 0.4f : 0);
    }
    /* It looks along -Z as the node does, which is not turned. */
    c->to_world = (struct transform_d){{{1, 0, 0, n->translation[0]}, {0, 1, 0, n->translation[1]}, {0, 0, 1, n->translation[2]}}};
    c->node = (int32_t)node;
    builder_channel(&stage->b, node, PATH_TRANSLATION, 2, moments, places[0]);
}

static void copies(struct pair_stage *stage)
{
    const struct scene_instance from = stage->b.scene.instances[stage->instance];

    builder_place(&stage->b, from.mesh, from.material, vec3_make(0.4f, 0.6f, 0.4f), vec3_make(-1.6f, -0.3f, 0.6f));
    builder_place(&stage->b, from.mesh, from.material, vec3_make(-0.4f, 0.4f, 0.4f), vec3_make(1.7f, -0.6f, -0.6f));
}

static void true_sphere(struct pair_stage *stage)
{
    const uint32_t mesh = builder_sphere(&stage->b, 8, 1);

    stage->b.scene.meshes[mesh].arrays |= MESH_SPHERE;
    stage->b.scene.instances[stage->instance].mesh = mesh;
}

/* ---- the table ---------------------------------------------------------------------------------------- */

const struct pair_thing pair_things[] = {
    {"metal", metal, 0},
    {"mirror", mirror, 0},
    {"gloss", gloss, 0},
    {"glass", glass, 0},
    {"frosted glass", frosted, 0},
    {"thin wall", thin_wall, 0},
    {"translucent", translucent, 0},
    {"clay", clay, 0},
    {"mix", mixed, 0},
    {"glowing", glowing, 0},
    {"coat", coated, 0},
    {"sheen", sheen, 0},
    {"film", film, 0},
    {"brushed", brushed, 0},
    {"normal map", bumpy, 0},
    {"texture", painted, 0},
    {"roughness texture", rough_in_places, 0},
    {"blended", blended, 0},
    {"one-sided", one_sided, 0},
    {"absorption", absorbing, 0},
    {"dispersion", dispersing, 0},
    {"haze", haze, 0},
    {"smoke", smoke, 0},
    {"fire", fire, 0},
    {"fog", fog, 0},
    {"milk", milk, 0},
    {"ice", ice, 0},
    {"empty ball", nothing, 0},
    {"point light", point, 0},
    {"spot", spot, 0},
    {"sun", sun, 1},
    {"goniometric light", gonio, 0},
    {"slide", slide, 0},
    {"sky", sky, 1},
    {"window", window, 1},
    {"orthographic", ortho, 0},
    {"lens", lens, 0},
    {"panorama", panorama, 0},
    {"moving", moving, 0},
    {"turning", turning, 0},
    {"swelling", swelling, 0},
    {"moving camera", filming, 0},
    {"copies", copies, 0},
    {"true sphere", true_sphere, 0},
};
const size_t pair_thing_count = sizeof pair_things / sizeof *pair_things;

static int by_channel(const void *one, const void *other)
{
    const struct scene_channel *a = one, *b = other;

    return a->node != b->node ? (a->node < b->node ? -1 : 1) : (int)a->path - (int)b->path;
}

int pair_is_closed(size_t one, size_t other) { return !pair_things[one].opens && !pair_things[other].opens; }

void pair_scene(size_t one, size_t other, struct import_result *out)
{
    static struct pair_stage stage;
    const struct pair_thing *first = &pair_things[one < other ? one : other], *second = &pair_things[one < other ? other : one];
    size_t capacity = 0;

    set_stage(&stage, !pair_is_closed(one, other));
    first->add(&stage);
    if (one != other)
        second->add(&stage);
    qsort(stage.b.scene.channels, stage.b.scene.channel_count, sizeof *stage.b.scene.channels, by_channel);
    *out = (struct import_result){.scene = stage.b.scene};
    if (!MEM_GROW(out->blobs, capacity, stage.b.blob_count))
        abort();
    for (size_t i = 0; i < stage.b.blob_count; i++)
        out->blobs[i] = (struct import_blob){stage.b.blobs[i].digest, stage.b.blobs[i].data, stage.b.blobs[i].size_bytes};
    out->blob_count = stage.b.blob_count;
    for (uint32_t i = 0; i < out->scene.instance_count; i++)
        out->triangles_placed += out->scene.meshes[out->scene.instances[i].mesh].triangle_count;
}
