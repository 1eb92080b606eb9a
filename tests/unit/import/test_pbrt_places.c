/* pbrt: a thing that a matrix places is the thing, moved: every shape with every surface under every kind of matrix, and whole
 * files of either hand. What is compared are the triangles, lamps and windows in the world. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/scene/pose.h"
#include "tests/support/gltf_maker.h"
#include "tests/support/pbrt_text.h"

/* ---- what is in the world -------------------------------------------------------------------- */

/* A triangle whose front is where its corners run counter-clockwise. */
struct face {
    double at[3][3], normal[3][3];
    float uv[3][2];
    int has_normals, has_uv;
    const struct scene_material *material;
};

struct world {
    struct import_result r;
    struct face *faces;
    size_t count;
};

static void place_vector(const struct transform_d *m, const double v[3], double out[3])
{
    for (int r = 0; r < 3; r++)
        out[r] = m->m[r][0] * v[0] + m->m[r][1] * v[1] + m->m[r][2] * v[2];
}

/* A normal's direction: by the transposed inverse. */
static void place_normal(const struct transform_d *m, const double v[3], double out[3])
{
    struct transform_d inverse;
    double length = 0;

    assert_true(transform_d_invert(m, &inverse));
    for (int r = 0; r < 3; r++) {
        out[r] = inverse.m[0][r] * v[0] + inverse.m[1][r] * v[1] + inverse.m[2][r] * v[2];
        length += out[r] * out[r];
    }
    for (int r = 0; r < 3; r++)
        out[r] /= sqrt(length);
}

static void exchange(void *a, void *b, size_t size)
{
    unsigned char kept[3 * sizeof(double)];

    memcpy(kept, a, size);
    memcpy(a, b, size);
    memcpy(b, kept, size);
}

/* Wound the other way round. */
static void turn_round(struct face *f)
{
    exchange(f->at[1], f->at[2], sizeof f->at[1]);
    exchange(f->normal[1], f->normal[2], sizeof f->normal[1]);
    exchange(f->uv[1], f->uv[2], sizeof f->uv[1]);
}

static struct face face_of(const struct mesh_view *v, uint32_t triangle, const struct scene_material *material)
{
    struct face f = {.has_normals = v->normals != NULL, .has_uv = v->uv0 != NULL, .material = material};

    for (int k = 0; k < 3; k++) {
        const size_t i = v->indices[3 * triangle + (uint32_t)k];
        for (int c = 0; c < 3; c++) {
            f.at[k][c] = (double)v->positions[3 * i + (size_t)c];
            f.normal[k][c] = v->normals ? (double)v->normals[3 * i + (size_t)c] : 1;
        }
        for (int c = 0; c < 2 && v->uv0; c++)
            f.uv[k][c] = v->uv0[2 * i + (size_t)c];
    }
    return f;
}

static void move_face(struct face *f, const struct transform_d *m)
{
    for (int k = 0; k < 3; k++) {
        double at[3], normal[3];
        transform_d_point(m, f->at[k], at);
        place_normal(m, f->normal[k], normal);
        memcpy(f->at[k], at, sizeof at);
        memcpy(f->normal[k], normal, sizeof normal);
    }
    if (transform_d_determinant(m) < 0)
        turn_round(f);
}

static void read_world_at(const char *folder, const char *text, double time_s, struct world *w)
{
    struct scene_pose pose;
    struct error err = {0};

    memset(w, 0, sizeof *w);
    pbrt_whole(text, folder, &w->r);
    assert_int_equal(scene_pose_init(&pose, &w->r.scene, time_s, &err), STATUS_OK);
    for (uint32_t i = 0; i < w->r.scene.instance_count; i++) {
        const struct scene_instance *instance = &w->r.scene.instances[i];
        const struct mesh_view v = view_mesh(&w->r, instance->mesh);
        struct transform_d to_file = pose_instance(&pose, &w->r.scene, i);
        for (int c = 0; c < 3; c++)
            to_file.m[c][3] += w->r.scene.origin[c];
        w->faces = mem_realloc_array(w->faces, w->count + v.mesh->triangle_count, sizeof *w->faces);
        assert_non_null(w->faces);
        for (uint32_t t = 0; t < v.mesh->triangle_count; t++) {
            struct face *f = &w->faces[w->count++];
            *f = face_of(&v, t, &w->r.scene.materials[instance->material]);
            move_face(f, &to_file);
        }
    }
    if (w->r.warning_count > 0)
        fail_msg("%s: %s", text, w->r.warnings[0]);
    scene_pose_release(&pose);
}

static void read_world(const char *folder, const char *text, struct world *w) { read_world_at(folder, text, 0, w); }

static void world_release(struct world *w)
{
    mem_free(w->faces);
    import_result_release(&w->r);
}

static int near(const double a[3], const double b[3], double tolerance)
{
    for (int c = 0; c < 3; c++)
        if (!(fabs(a[c] - b[c]) <= tolerance))
            return 0;
    return 1;
}

static int shines(const struct face *f) { return f->material->emission[0] > 0; }

/* `emission`: that of their materials counts, too. */
static int same_face(const struct face *a, const struct face *b, int emission)
{
    const struct scene_material *m = a->material, *n = b->material;
    int first = 0;

    while (first < 3 && !near(a->at[0], b->at[first], 1e-5))
        first++;
    for (int k = 0; k < 3; k++) {
        const int other = (first + k) % 3;
        if (first == 3 || !near(a->at[k], b->at[other], 1e-5) || !near(a->normal[k], b->normal[other], 1e-4))
            return 0;
        for (int c = 0; c < 2; c++)
            if (!(fabsf(a->uv[k][c] - b->uv[other][c]) <= 1e-6f))
                return 0;
    }
    return a->has_normals == b->has_normals && a->has_uv == b->has_uv && m->kind == n->kind &&
           memcmp(m->base_color, n->base_color, sizeof m->base_color) == 0 &&
           m->base_color_texture.texture == n->base_color_texture.texture && (m->medium < 0) == (n->medium < 0) &&
           (m->medium_outside < 0) == (n->medium_outside < 0) &&
           (!emission || (m->double_sided == n->double_sided && memcmp(m->emission, n->emission, sizeof m->emission) == 0));
}

/* Each of `wanted`, which are moved first, is one of `got`, most often the next. `taken` has a byte for each of `got`. */
static void assert_faces(const char *what, const struct face *wanted, size_t count, const struct transform_d *by,
                         const struct face *got, size_t got_count, unsigned char *taken, int emission)
{
    size_t k = 0;

    for (size_t i = 0; i < count; i++) {
        struct face f = wanted[i];
        size_t tried = 0;
        move_face(&f, by);
        for (; tried < got_count && (taken[k] || !same_face(&f, &got[k], emission)); tried++)
            k = (k + 1) % got_count;
        if (tried == got_count)
            fail_msg("%s: no face is at (%g %g %g) (%g %g %g) (%g %g %g), uv (%g %g)", what, f.at[0][0], f.at[0][1], f.at[0][2],
                     f.at[1][0], f.at[1][1], f.at[1][2], f.at[2][0], f.at[2][1], f.at[2][2], (double)f.uv[0][0], (double)f.uv[0][1]);
        taken[k] = 1;
    }
}

static void assert_all_faces(const char *what, const struct world *wanted, const struct transform_d *by,
                             const struct world *got, int emission)
{
    unsigned char *taken = mem_calloc(got->count, 1);

    assert_non_null(taken);
    if (wanted->count != got->count)
        fail_msg("%s: %zu faces instead of %zu", what, got->count, wanted->count);
    assert_faces(what, wanted->faces, wanted->count, by, got->faces, got->count, taken, emission);
    mem_free(taken);
}

/* What leaves all faces that shine, over pi: of one-sided ones. */
static double flux(const struct world *w)
{
    double sum = 0;

    for (size_t i = 0; i < w->count; i++) {
        double e[2][3], square = 0;
        if (!shines(&w->faces[i]))
            continue;
        for (int k = 0; k < 2; k++)
            for (int c = 0; c < 3; c++)
                e[k][c] = w->faces[i].at[k + 1][c] - w->faces[i].at[0][c];
        for (int c = 0; c < 3; c++) {
            const double g = e[0][(c + 1) % 3] * e[1][(c + 2) % 3] - e[0][(c + 2) % 3] * e[1][(c + 1) % 3];
            square += g * g;
        }
        sum += sqrt(square) / 2 * (double)w->faces[i].material->emission[0] * (w->faces[i].material->double_sided ? 2 : 1);
    }
    return sum;
}

/* ---- texts ----------------------------------------------------------------------------------- */

#define IDENTITY {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}}

static const struct {
    const char *text;
    struct transform_d matrix;
    int rigid; /* but for its hand */
} places[] = {
    {"", IDENTITY, 1},
    {"Translate 1 2 3", {{{1, 0, 0, 1}, {0, 1, 0, 2}, {0, 0, 1, 3}}}, 1},
    {"Rotate 90 0 0 1", {{{0, -1, 0, 0}, {1, 0, 0, 0}, {0, 0, 1, 0}}}, 1},
    {"Scale 2 2 2", {{{2, 0, 0, 0}, {0, 2, 0, 0}, {0, 0, 2, 0}}}, 0},
    {"Scale .5 .5 .5 Rotate 90 1 0 0", {{{.5, 0, 0, 0}, {0, 0, -.5, 0}, {0, .5, 0, 0}}}, 0},
    {"Translate 0 1 0 Scale 2 3 .5", {{{2, 0, 0, 0}, {0, 3, 0, 1}, {0, 0, .5, 0}}}, 0},
    {"Scale -1 1 1", {{{-1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}}, 1},
    {"Scale 1 1 -2", {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, -2, 0}}}, 0},
    {"ConcatTransform [0 0 -1 0  0 1 0 0  -1 0 0 0  1 0 2 1]", {{{0, 0, -1, 1}, {0, 1, 0, 0}, {-1, 0, 0, 2}}}, 1},
    {"ConcatTransform [1 0 0 0  1 1 0 0  0 0 1 0  0 0 0 1]", {{{1, 1, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}}, 0},
};

#define POINTS "\"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 1] "
#define CORNERS POINTS "\"integer indices\" [0 1 2 1 3 2] "
static const char *const shapes[] = {
    "Shape \"trianglemesh\" " CORNERS,
    "Shape \"trianglemesh\" " CORNERS "\"point2 uv\" [0 0 1 0 0 1 .5 .75]",
    "Shape \"trianglemesh\" " CORNERS "\"normal N\" [0 0 -1 0 0 -1 0 0 -1 0 -1 0]",
    "Shape \"sphere\" \"float radius\" .5",
    "Shape \"sphere\" \"float zmin\" -.25 \"float phimax\" 200",
    "Shape \"disk\" \"float height\" 1 \"float innerradius\" .25",
    "Shape \"cylinder\" \"float zmax\" .5",
    "Shape \"bilinearmesh\" " POINTS "\"integer indices\" [0 1 2 3] ",
    "Shape \"loopsubdiv\" \"integer levels\" 1 " CORNERS,
    "Shape \"curve\" \"string type\" \"cylinder\" \"point3 P\" [0 0 0 0 1 0 1 1 0 1 1 1] \"float width\" .125",
};

/* The surface, and whether what leaves it is said instead of its radiance. */
static const struct {
    const char *text;
    int has_power;
} surfaces[] = {
    {"Material \"diffuse\" \"texture reflectance\" \"t\"", 0},
    {"Material \"diffuse\" \"texture reflectance\" \"t\" ReverseOrientation", 0},
    {"Material \"diffuse\" \"texture reflectance\" \"t\" AreaLightSource \"diffuse\" \"rgb L\" [1 2 3]", 0},
    {"Material \"diffuse\" \"texture reflectance\" \"t\" AreaLightSource \"diffuse\" \"rgb L\" [1 2 3] \"float power\" 50 ReverseOrientation", 1},
    {"AreaLightSource \"diffuse\" \"float power\" 50 \"bool twosided\" true", 1},
    {"MediumInterface \"m\" \"\" Material \"interface\"", 0},
    {"MediumInterface \"\" \"m\" Material \"dielectric\" ReverseOrientation", 0},
};

enum { TEXT_SIZE = 2000, SHAPES = sizeof shapes / sizeof *shapes, PLACES = sizeof places / sizeof *places };

static const char preamble[] = "WorldBegin " LAMP "Texture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"t.pfm\"\n"
                               "MakeNamedMedium \"m\" \"string type\" \"homogeneous\"\n";

static char *folder_with_picture(void)
{
    static const float pixels[12] = {.1f, .2f, .3f, .4f, .5f, .6f, .7f, .8f, .9f, .1f, .5f, .9f};
    char *folder = pbrt_folder_make(), file[64];
    const int head = snprintf(file, sizeof file, "PF\n2 2\n-1\n");

    memcpy(file + head, pixels, sizeof pixels);
    pbrt_folder_put(folder, "t.pfm", file, (size_t)head + sizeof pixels);
    return folder;
}

static void write_thing(char out[TEXT_SIZE], const char *hand, const char *place, const char *surface, const char *shape)
{
    snprintf(out, TEXT_SIZE, "Film \"rgb\" %s%sAttributeBegin %s %s %s AttributeEnd\n", hand, preamble, place, surface, shape);
}

/* ---- tests ----------------------------------------------------------------------------------- */

/* Every surface of every shape at every place. What has a power sends it out at each. */
static void test_places(void **state)
{
    char *folder = folder_with_picture(), text[TEXT_SIZE];

    (void)state;
    for (size_t u = 0; u < sizeof surfaces / sizeof *surfaces; u++)
        for (size_t s = 0; s < SHAPES; s++) {
            struct world still, moved;
            write_thing(text, EYE, "", surfaces[u].text, shapes[s]);
            read_world(folder, text, &still);
            for (size_t p = 1; p < PLACES; p++) {
                write_thing(text, EYE, places[p].text, surfaces[u].text, shapes[s]);
                read_world(folder, text, &moved);
                assert_all_faces(text, &still, &places[p].matrix, &moved, !surfaces[u].has_power);
                if (surfaces[u].has_power && !(fabs(flux(&moved) / flux(&still) - 1) <= 1e-3))
                    fail_msg("%s: what leaves it is %g times what it was", text, flux(&moved) / flux(&still));
                world_release(&moved);
            }
            world_release(&still);
        }
    pbrt_folder_remove(folder);
}

static void test_objects(void **state)
{
    char *folder = folder_with_picture(), text[TEXT_SIZE];

    (void)state;
    for (size_t s = 0; s < SHAPES; s++)
        for (size_t p = 0; p < PLACES; p++)
            for (size_t inner = 3; inner < PLACES; inner += 3) { /* scaled, mirrored, sheared */
                struct world still, moved;
                write_thing(text, EYE, places[inner].text, surfaces[1].text, shapes[s]);
                read_world(folder, text, &still);
                snprintf(text, sizeof text, "Film \"rgb\" " EYE "%sObjectBegin \"o\" %s %s %s ObjectEnd %s ObjectInstance \"o\"", preamble,
                         places[inner].text, surfaces[1].text, shapes[s], places[p].text);
                read_world(folder, text, &moved);
                assert_all_faces(text, &still, &places[p].matrix, &moved, 1);
                world_release(&moved);
                world_release(&still);
            }
    pbrt_folder_remove(folder);
}

/* What is at one place when the shutter opens, and at another when it closes: a shape, an object, a shape in an object; in files of both
 * hands, also where the shape's vertices, or all of it, are far from the file's origin. */
static void test_moving(void **state)
{
    static const char far[] = "Shape \"trianglemesh\" \"integer indices\" [0 1 2 1 3 2] \"point3 P\" [3000000 0 0 3000001 0 0 3000000 1 0 3000001 1 1]";
    static const char *const hands[] = {EYE, "Camera \"perspective\"\n"};
    char *folder = folder_with_picture(), text[TEXT_SIZE], thing[TEXT_SIZE / 4], moved[TEXT_SIZE / 4];

    (void)state;
    for (size_t k = 0; k < 12 * PLACES * PLACES; k++) {
        const size_t form = k % 3, way = k / 3 % 4, p = k / 12 % PLACES, q = k / 12 / PLACES;
        const char *const ends[2] = {places[p].text, places[q].text}, *away = way & 1 ? "Translate 3e6 0 -5e6" : "";
        const char *hand = hands[(p + q) / 3 % 2];
        int used;

        if (p == q || (p + q) % 3 || p + 1 == PLACES || q + 1 == PLACES) /* a shear that changes is not supported, and said so */
            continue;
        snprintf(thing, sizeof thing, "%s %s", surfaces[0].text, way & 2 ? far : shapes[1]);
        snprintf(moved, sizeof moved, "ActiveTransform StartTime %s ActiveTransform EndTime %s ActiveTransform All", ends[0], ends[1]);
        used = snprintf(text, sizeof text, "Film \"rgb\" %s%s", hand, preamble);
        if (form == 0)
            snprintf(text + used, sizeof text - (size_t)used, "%s %s %s", away, moved, thing);
        else if (form == 1)
            snprintf(text + used, sizeof text - (size_t)used, "ObjectBegin \"o\" %s ObjectEnd %s %s ObjectInstance \"o\"", thing, away, moved);
        else
            snprintf(text + used, sizeof text - (size_t)used, "ObjectBegin \"o\" %s %s ObjectEnd %s ObjectInstance \"o\"", moved, thing, away);
        for (int end = 0; end < 2; end++) {
            struct world still, moving;
            char alone[TEXT_SIZE];
            read_world_at(folder, text, end, &moving);
            assert_true(moving.r.scene.node_count > 0);
            snprintf(alone, sizeof alone, "Film \"rgb\" %s%s%s %s %s", hand, preamble, away, ends[end], thing);
            read_world(folder, alone, &still);
            assert_all_faces(text, &still, &places[0].matrix, &moving, 1);
            world_release(&still);
            world_release(&moving);
        }
    }
    pbrt_folder_remove(folder);
}

/* A lamp on one side is the shape, which shines, and what is seen of its back: the shape as if it were no lamp. */
static void test_backs_of_lamps(void **state)
{
    char *folder = folder_with_picture(), text[TEXT_SIZE];

    (void)state;
    for (size_t s = 0; s < SHAPES; s++)
        for (int reversed = 0; reversed < 2; reversed++)
            for (size_t p = 0; p < PLACES; p++) {
                struct world plain, lamp;
                unsigned char *taken;
                int closed;
                write_thing(text, EYE, places[p].text, surfaces[reversed].text, shapes[s]);
                read_world(folder, text, &plain);
                write_thing(text, EYE, places[p].text, surfaces[2 + reversed].text, shapes[s]);
                read_world(folder, text, &lamp);
                taken = mem_calloc(lamp.count, 1);
                assert_non_null(taken);
                closed = plain.r.scene.meshes[0].closed > 0;
                assert_int_equal(lamp.count, closed ? plain.count : 2 * plain.count);
                assert_faces(text, plain.faces, plain.count, &places[0].matrix, lamp.faces, lamp.count, taken, 0);
                for (size_t i = 0; i < lamp.count; i++) {
                    assert_int_equal(taken[i], shines(&lamp.faces[i])); /* the front does */
                    assert_false(lamp.faces[i].material->double_sided);
                }
                for (size_t i = 0; i < plain.count; i++) {
                    turn_round(&plain.faces[i]);
                    for (int k = 0; k < 3; k++)
                        for (int c = 0; c < 3; c++)
                            plain.faces[i].normal[k][c] *= plain.faces[i].has_normals ? -1 : 1;
                }
                if (!closed)
                    assert_faces(text, plain.faces, plain.count, &places[0].matrix, lamp.faces, lamp.count, taken, 0);
                mem_free(taken);
                world_release(&lamp);
                world_release(&plain);
            }
    pbrt_folder_remove(folder);
}

/* A place, and directions from it. */
struct mark {
    double at[3], way[3][3];
};

static size_t marks_of(const struct scene *scene, struct mark *out)
{
    size_t count = 0;

    for (uint32_t i = 0; i < scene->light_count; i++) {
        const struct scene_light *l = &scene->lights[i];
        const unsigned parts = scene_light_parts(l->kind);
        struct mark *m = &out[count++];
        *m = (struct mark){0};
        for (int c = 0; c < 3; c++) {
            m->at[c] = parts & LIGHT_HAS_PLACE ? l->position[c] + scene->origin[c] : 0;
            m->way[0][c] = parts & LIGHT_HAS_DIRECTION ? (double)l->direction[c] : 0;
            for (int k = 0; k < 3 && parts & LIGHT_HAS_FRAME; k++)
                m->way[k][c] = l->to_world.m[c][k];
        }
    }
    for (uint32_t i = 0; i < scene->environment.portal_count; i++) {
        const struct scene_portal *p = &scene->environment.portals[i];
        struct mark *m = &out[count++];
        *m = (struct mark){0};
        for (int c = 0; c < 3; c++) {
            m->at[c] = p->corner[c] + scene->origin[c];
            m->way[0][c] = (double)p->edge1[c];
            m->way[1][c] = (double)p->edge2[c];
        }
    }
    for (uint32_t i = 0; i < scene->medium_count; i++) {
        struct mark *m = &out[count++];
        *m = (struct mark){0};
        for (int c = 0; c < 3 && scene->media[i].has_grid; c++) {
            m->at[c] = scene->media[i].grid_to_world.m[c][3] + scene->origin[c];
            for (int k = 0; k < 3; k++)
                m->way[k][c] = scene->media[i].grid_to_world.m[c][k];
        }
    }
    return count;
}

static void assert_marks(const char *what, const struct scene *wanted, const struct transform_d *by, const struct scene *got)
{
    struct mark a[16], b[16];
    const size_t count = marks_of(wanted, a);

    assert_int_equal(marks_of(got, b), count);
    for (size_t i = 0; i < count; i++) {
        double at[3], way[3];
        if (a[i].at[0] != 0 || a[i].at[1] != 0 || a[i].at[2] != 0) {
            transform_d_point(by, a[i].at, at);
            if (!near(at, b[i].at, 1e-5))
                fail_msg("%s: mark %zu is at (%g %g %g), not (%g %g %g)", what, i, b[i].at[0], b[i].at[1], b[i].at[2], at[0], at[1], at[2]);
        }
        for (int k = 0; k < 3; k++) {
            place_vector(by, a[i].way[k], way);
            if (!near(way, b[i].way[k], 1e-5))
                fail_msg("%s: way %d of mark %zu is (%g %g %g), not (%g %g %g)", what, k, i, b[i].way[k][0],
                         b[i].way[k][1], b[i].way[k][2], way[0], way[1], way[2]);
        }
    }
}

#define LAMPS                                                                                                              \
    "LightSource \"point\" \"point3 from\" [1 2 3]\n"                                                                      \
    "LightSource \"spot\" \"point3 from\" [1 2 3] \"point3 to\" [2 4 -1]\n"                                                \
    "LightSource \"distant\" \"point3 from\" [1 2 3] \"point3 to\" [2 4 -1]\n"                                             \
    "AttributeBegin Translate 3 2 1 Rotate 30 1 2 3 LightSource \"projection\" \"string filename\" \"t.pfm\" AttributeEnd\n" \
    "AttributeBegin Translate 3 2 1 Rotate 30 1 2 3 LightSource \"goniometric\" \"string filename\" \"t.pfm\" AttributeEnd\n"

/* pbrt's world is left-handed, and one whose camera is mirrored the other: all of it, mirrored. */
static void test_hands(void **state)
{
    static const struct transform_d mirror = {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, -1, 0}}};
    static const char others[] =
        "LightSource \"infinite\" \"point3 portal\" [.5 0 1  2 0 1.5  2 3 1  .5 3 .5]\n"
        "MakeNamedMedium \"g\" \"string type\" \"uniformgrid\" \"integer nx\" 2 \"float density\" [1 3] \"point3 p0\" [1 2 3] \"point3 p1\" [2 4 6]\n"
        "AttributeBegin MediumInterface \"g\" \"\" Material \"interface\" Shape \"sphere\" AttributeEnd\n";
    char *folder = folder_with_picture(), text[TEXT_SIZE];
    struct world right, left;

    (void)state;
    for (size_t u = 0; u < sizeof surfaces / sizeof *surfaces; u++)
        for (size_t s = 0; s < SHAPES; s++)
            for (size_t p = 0; p < PLACES; p++) {
                write_thing(text, EYE, places[p].text, surfaces[u].text, shapes[s]);
                read_world(folder, text, &right);
                write_thing(text, "LookAt 0 0 5 0 0 0 0 1 0 Camera \"perspective\"\n", places[p].text, surfaces[u].text, shapes[s]);
                read_world(folder, text, &left);
                assert_all_faces(text, &right, &mirror, &left, 1);
                world_release(&right);
                world_release(&left);
            }
    snprintf(text, sizeof text, "Film \"rgb\" " EYE "%s" LAMPS "%s", preamble, others);
    read_world(folder, text, &right);
    snprintf(text, sizeof text, "Film \"rgb\" LookAt 0 0 5 0 0 0 0 1 0 Camera \"perspective\" %s" LAMPS "%s", preamble, others);
    read_world(folder, text, &left);
    assert_marks(text, &right.r.scene, &mirror, &left.r.scene);
    world_release(&right);
    world_release(&left);
    pbrt_folder_remove(folder);
}

static void test_lamps(void **state)
{
    char *folder = folder_with_picture(), text[TEXT_SIZE];
    struct world still, moved;

    (void)state;
    snprintf(text, sizeof text, "Film \"rgb\" " EYE "WorldBegin " LAMPS TRIANGLE);
    read_world(folder, text, &still);
    for (size_t p = 1; p < PLACES; p++) {
        if (!places[p].rigid)
            continue;
        snprintf(text, sizeof text, "Film \"rgb\" " EYE "WorldBegin AttributeBegin %s " LAMPS "AttributeEnd " TRIANGLE, places[p].text);
        read_world(folder, text, &moved);
        assert_marks(text, &still.r.scene, &places[p].matrix, &moved.r.scene);
        world_release(&moved);
    }
    world_release(&still);
    pbrt_folder_remove(folder);
}

#define MAPPING_HERE "%s"

/* The lookup's place of the mesh's vertices, and the picture. */
static struct digest lookup_places(const struct world *w, float out[6][2])
{
    const struct scene *scene = &w->r.scene;
    const struct scene_texture_slot *s = &w->faces[0].material->base_color_texture;

    assert_int_equal(w->count, 2);
    assert_true(s->texture >= 0);
    for (int i = 0; i < 6; i++)
        for (int c = 0; c < 2; c++) {
            const float *uv = w->faces[i / 3].uv[i % 3];
            out[i][c] = s->uv_transform[c][0] * uv[0] + s->uv_transform[c][1] * uv[1] + s->uv_transform[c][2];
        }
    return scene->images[scene->textures[s->texture].image].blob.digest;
}

/* A texture that is scaled and moved is the texture over coordinates that are. */
static void test_mappings(void **state)
{
    static const char *const textures[] = {
        "Texture \"x\" \"spectrum\" \"imagemap\" \"string filename\" \"t.pfm\" " MAPPING_HERE,
        "Texture \"x\" \"spectrum\" \"imagemap\" \"string filename\" \"t.pfm\" \"bool invert\" true " MAPPING_HERE,
        "Texture \"x\" \"spectrum\" \"checkerboard\" \"rgb tex1\" [.1 .2 .3] \"rgb tex2\" [.4 .5 .6] " MAPPING_HERE,
        "Texture \"x\" \"spectrum\" \"bilerp\" \"rgb v00\" [.1 .2 .3] \"rgb v11\" [.4 .5 .6] " MAPPING_HERE,
        "Texture \"a\" \"spectrum\" \"checkerboard\" \"rgb tex1\" [.1 .2 .3] \"rgb tex2\" [.4 .5 .6] " MAPPING_HERE
        "Texture \"b\" \"spectrum\" \"imagemap\" \"string filename\" \"t.pfm\" " MAPPING_HERE
        "Texture \"x\" \"spectrum\" \"scale\" \"texture tex\" \"a\" \"texture scale\" \"b\" ",
    };
    static const float mappings[][4] = {{1, 1, 0.25f, -0.375f}, {2, 0.5f, 0, 0}, {4, -1, 0.5f, 0.75f}};
    static const float uv[4][2] = {{0, 0}, {1, 0}, {0, 1}, {0.5f, 0.75f}};
    char *folder = folder_with_picture(), text[TEXT_SIZE], mapping[200];

    (void)state;
    for (size_t k = 0; k < 3 * sizeof textures / sizeof *textures; k++) {
        const float *m = mappings[k % 3];
        float places_of[2][6][2];
        struct digest pictures[2];
        for (int baked = 0; baked < 2; baked++) {
            const char *from = textures[k / 3];
            struct world w;
            int used = snprintf(text, sizeof text, "Film \"rgb\" " EYE "%s", preamble);
            snprintf(mapping, sizeof mapping, "\"float uscale\" %g \"float vscale\" %g \"float udelta\" %g \"float vdelta\" %g ",
                     (double)m[0], (double)m[1], (double)m[2], (double)m[3]);
            for (; *from; from++) {
                if (*from != '%') {
                    text[used++] = *from;
                    continue;
                }
                used += snprintf(text + used, sizeof text - (size_t)used, "%s", baked ? "" : mapping);
                from++;
            }
            used += snprintf(text + used, sizeof text - (size_t)used,
                             "Material \"diffuse\" \"texture reflectance\" \"x\" Shape \"trianglemesh\" " CORNERS "\"point2 uv\" [");
            for (int i = 0; i < 4; i++)
                used += snprintf(text + used, sizeof text - (size_t)used, "%g %g ", (double)(baked ? m[0] * uv[i][0] + m[2] : uv[i][0]),
                                 (double)(baked ? m[1] * uv[i][1] + m[3] : uv[i][1]));
            snprintf(text + used, sizeof text - (size_t)used, "]");
            read_world(folder, text, &w);
            pictures[baked] = lookup_places(&w, places_of[baked]);
            world_release(&w);
        }
        if (memcmp(&pictures[0], &pictures[1], sizeof *pictures) != 0)
            fail_msg("%s: another picture", text);
        for (int i = 0; i < 12; i++)
            if (!(fabsf((&places_of[0][0][0])[i] - (&places_of[1][0][0])[i]) < 1e-5f))
                fail_msg("%s: corner %d is looked up at %g, not %g", text, i / 2, (double)(&places_of[1][0][0])[i], (double)(&places_of[0][0][0])[i]);
    }
    pbrt_folder_remove(folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_places), cmocka_unit_test(test_objects), cmocka_unit_test(test_moving), cmocka_unit_test(test_backs_of_lamps),
        cmocka_unit_test(test_hands),  cmocka_unit_test(test_lamps),   cmocka_unit_test(test_mappings),
    };

    return cmocka_run_group_tests_name("pbrt: a thing that is placed", tests, NULL, NULL);
}
