/* Closed rooms in scene files, with walls of a millimetre: they keep the light out wherever the file
 * puts them. (Rooms that the importer cannot move to the origin, and doors: test_doors.) */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <cmocka.h>

#include "tests/support/imported.h"

enum { WIDTH = 24, HEIGHT = 16, PIXELS = WIDTH * HEIGHT * 3 };

/* The room's inner half sizes, and what its walls measure. */
static const double inner[3] = {2, 1.5, 2.5}, wall = 1e-3;

struct where {
    double shift; /* along (1, -0.75, 0.5), in metres */
    int turned;   /* by an odd angle about an odd axis */
};

static void put_place(char **at, const struct where *where, const double local[3])
{
    /* A turn by 0.7 about y, then by 0.4 about x. */
    const double c = where->turned ? cos(0.7) : 1, s = where->turned ? sin(0.7) : 0;
    const double d = where->turned ? cos(0.4) : 1, t = where->turned ? sin(0.4) : 0;
    double x = c * local[0] + s * local[2], y = local[1], z = c * local[2] - s * local[0];

    *at += sprintf(*at, "%.17g %.17g %.17g ", where->shift + x, -0.75 * where->shift + d * y - t * z,
                   0.5 * where->shift + t * y + d * z);
}

static const char box_indices[] = "\"integer indices\" [0 2 3 0 3 1 4 5 7 4 7 6 0 1 5 0 5 4 "
                                  "2 6 7 2 7 3 0 4 6 0 6 2 1 3 7 1 7 5] \"point3 P\" [";

static void put_box(char **at, const struct where *where, const double low[3], const double high[3])
{
    *at += sprintf(*at, "Shape \"trianglemesh\" %s", box_indices);
    for (int i = 0; i < 8; i++)
        put_place(at, where, (double[3]){i & 1 ? high[0] : low[0], i & 2 ? high[1] : low[1], i & 4 ? high[2] : low[2]});
    *at += sprintf(*at, "]\n");
}

/* Two boxes, one in the other. */
static void put_shell(char **at, const struct where *where)
{
    for (int side = 0; side < 2; side++) {
        double low[3], high[3];
        for (int a = 0; a < 3; a++) {
            high[a] = inner[a] + side * wall;
            low[a] = -high[a];
        }
        put_box(at, where, low, high);
    }
}

/* Six plates that overlap at the edges, the last ones left out. */
static void put_plates(char **at, const struct where *where, int plates)
{
    for (int k = 0; k < plates; k++) {
        double low[3], high[3];
        for (int a = 0; a < 3; a++) {
            high[a] = inner[a] + wall;
            low[a] = -high[a];
        }
        if (k & 1)
            high[k / 2] = -inner[k / 2];
        else
            low[k / 2] = inner[k / 2];
        put_box(at, where, low, high);
    }
}

enum walls { SHELL, PLATES, ONE_OPEN, WALLS };
enum light { SKY, LAMP_OUTSIDE, LAMP_INSIDE };

static void put_light(char **at, const struct where *where, enum light light)
{
    static const double inside[3] = {0.5, 1, -1};

    if (light == SKY) {
        *at += sprintf(*at, "LightSource \"infinite\" \"rgb L\" [1e6 1e6 1e6]\n");
        return;
    }
    *at += sprintf(*at, "LightSource \"point\" \"rgb I\" [10 10 10] \"point3 from\" [");
    put_place(at, where, light == LAMP_INSIDE ? inside : (double[3]){2.3, 0.1, 0.2});
    *at += sprintf(*at, "]\n");
    if (light == LAMP_INSIDE)
        return;
    /* And a face that shines, a centimetre before the wall. */
    *at += sprintf(*at, "AttributeBegin AreaLightSource \"diffuse\" \"rgb L\" [1e6 1e6 1e6] "
                        "\"bool twosided\" true Shape \"trianglemesh\" \"integer indices\" "
                        "[0 1 2 0 2 3] \"point3 P\" [");
    for (int i = 0; i < 4; i++)
        put_place(at, where, (double[3]){i == 1 || i == 2 ? 1 : -1, i > 1 ? 1 : -1, inner[2] + wall + 0.01});
    *at += sprintf(*at, "] AttributeEnd\n");
}

static void room_text(char *text, const struct where *where, enum walls walls, enum light light)
{
    static const double eye[3] = {-1.2, 0.3, 1.7}, target[3] = {0.4, -0.2, -2};
    /* Any other upward direction would do, but it is the room's. */
    const struct where axis = {0, where->turned};

    text += sprintf(text, "LookAt ");
    put_place(&text, where, eye);
    put_place(&text, where, target);
    put_place(&text, &axis, (double[3]){0, 1, 0});
    text += sprintf(text, "Camera \"perspective\" \"float fov\" 80 Film \"rgb\" WorldBegin\n");
    put_light(&text, where, light);
    text += sprintf(text, "Material \"diffuse\" \"rgb reflectance\" [0.8 0.8 0.8]\n");
    if (walls == SHELL)
        put_shell(&text, where);
    else
        put_plates(&text, where, walls == PLATES ? 6 : 5);
}

static void room_picture(const struct where *where, enum walls walls, enum light light, float picture[PIXELS])
{
    struct render_settings settings = imported_settings(WIDTH, HEIGHT, 32);
    struct import_result import;
    char text[16384];

    settings.max_depth = 12;
    room_text(text, where, walls, light);
    imported_text(text, "room.pbrt", NULL, &import);
    imported_render(&import, &settings, 0, picture);
    import_result_release(&import);
}

static void assert_dark(const float picture[PIXELS], const char *what, const struct where *where)
{
    for (int i = 0; i < PIXELS; i++)
        if (picture[i] != 0)
            fail_msg("%s at %g m%s: light inside, %g at number %d", what, where->shift, where->turned ? ", turned" : "",
                     (double)picture[i], i);
}

static double brightness(const float picture[PIXELS])
{
    double sum = 0;

    for (int i = 0; i < PIXELS; i++)
        sum += (double)picture[i];
    return sum / PIXELS;
}

static const double shifts[] = {0, 1e3, 1e4, 1e5, 1e6};
enum { SHIFTS = sizeof shifts / sizeof *shifts };

/* The whole scene is moved in its file. */
static void test_dark_inside(void **state)
{
    float picture[PIXELS];

    (void)state;
    for (int i = 0; i < 2 * SHIFTS; i++) {
        const struct where where = {shifts[i / 2], i & 1};
        room_picture(&where, SHELL, SKY, picture);
        assert_dark(picture, "a shell", &where);
        room_picture(&where, PLATES, SKY, picture);
        assert_dark(picture, "plates", &where);
        room_picture(&where, PLATES, LAMP_OUTSIDE, picture);
        assert_dark(picture, "plates before a lamp", &where);
    }
}

/* The same rooms are bright with a plate left out, and with the lamp inside they look everywhere
 * as they do at the origin: floats cannot hold more of a file's digits. */
static void test_bright_inside(void **state)
{
    float first[PIXELS], picture[PIXELS];

    (void)state;
    for (int turned = 0; turned < 2; turned++) {
        struct where where = {0, turned};
        room_picture(&where, ONE_OPEN, SKY, picture);
        assert_true(brightness(picture) > 1e5);
        for (int i = 0; i < SHIFTS; i++) {
            int apart = 0;
            where.shift = shifts[i];
            room_picture(&where, PLATES, LAMP_INSIDE, i ? picture : first);
            for (int k = 0; i && k < PIXELS; k++)
                apart += fabsf(picture[k] - first[k]) > 1e-3f * first[k];
            assert_true(brightness(first) > 0.1);
            if (apart > PIXELS / 100)
                fail_msg("%g m%s: %d of %d numbers differ", where.shift, turned ? ", turned" : "", apart, PIXELS);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_dark_inside),
        cmocka_unit_test(test_bright_inside),
    };

    return cmocka_run_group_tests_name("rooms", tests, NULL, NULL);
}
