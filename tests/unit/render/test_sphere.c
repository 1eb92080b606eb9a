/* True spheres: hits against a walk in double, rays that leave them, what an import makes of them,
 * and the light of sphere lamps against closed forms. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "common/base/buffer.h"
#include "tests/support/figure.h"
#include "tests/support/imported.h"
#include "tests/support/pbrt_text.h"
#include "tests/support/statistics.h"
#include "worker/render/shape/sphere.h"
#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"

/* A scene of this pbrt text, made ready. */
struct fixture {
    struct import_result import;
    struct render_scene *scene;
};

static void fixture_whole(struct fixture *f, const char *text)
{
    struct render_settings settings = imported_settings(16, 16, 4);

    pbrt_whole(text, NULL, &f->import);
    f->scene = imported_build(&f->import, &settings, 0);
}

static void fixture_init(struct fixture *f, const char *world)
{
    struct buffer text = BUFFER_INIT;

    buffer_printf(&text, RIGHT_HANDED "Film \"rgb\" WorldBegin\n%s", world);
    fixture_whole(f, buffer_text(&text));
    buffer_release(&text);
}

static void fixture_release(struct fixture *f)
{
    render_scene_free(f->scene);
    import_result_release(&f->import);
}

static uint32_t spheres_of(const struct render_scene *scene)
{
    uint32_t count = 0;

    for (uint32_t i = 0; i < scene->instance_count; i++)
        count += scene->instances[i].shape != NULL;
    return count;
}

/* ---- what becomes a sphere -------------------------------------------------------------------- */

static void test_which(void **state)
{
    static const struct {
        const char *world;
        uint32_t spheres;
    } cases[] = {
        {LAMP "Shape \"sphere\" \"float radius\" 2", 1},
        {LAMP "Rotate 33 1 2 3 Scale 3 3 3 Shape \"sphere\"", 1},
        {LAMP "Scale -1 1 1 Shape \"sphere\"", 1},
        {LAMP "ReverseOrientation Shape \"sphere\"", 1},
        {LAMP "AreaLightSource \"diffuse\" Shape \"sphere\"", 1},
        {LAMP "Material \"dielectric\" Shape \"sphere\"", 1},
        /* These stay meshes. */
        {LAMP "Scale 1 1 1.01 Shape \"sphere\"", 0},
        {LAMP "Shape \"sphere\" \"float zmin\" -0.5", 0},
        {LAMP "Shape \"sphere\" \"float phimax\" 180", 0},
        {LAMP "Shape \"sphere\" \"float alpha\" 0.5", 0},
        {LAMP "ActiveTransform EndTime Translate 0 0 1 ActiveTransform All Shape \"sphere\"", 0},
        {LAMP "Material \"dielectric\" Shape \"sphere\" Shape \"sphere\"", 0},
        {LAMP "Shape \"disk\"", 0},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct fixture f;

        fixture_init(&f, cases[i].world);
        if (spheres_of(f.scene) != cases[i].spheres)
            fail_msg("%s: %u spheres", cases[i].world, spheres_of(f.scene));
        fixture_release(&f);
    }
}

/* A mesh that only says that it is a sphere is shown as the mesh that it is. */
static void test_false_claims(void **state)
{
    struct render_settings settings = imported_settings(16, 16, 4);

    (void)state;
    for (int which = 0; which < 2; which++) {
        struct import_result import;
        struct render_scene *scene;

        pbrt_world(which ? LAMP "Shape \"cylinder\"" : LAMP "Shape \"sphere\" \"float phimax\" 350", &import);
        import.scene.meshes[0].arrays |= MESH_SPHERE;
        scene = imported_build(&import, &settings, 0);
        assert_int_equal(spheres_of(scene), 0);
        render_scene_free(scene);
        import_result_release(&import);
    }
}

/* ---- hits ------------------------------------------------------------------------------------- */

static struct vec3 random_direction(struct test_random *r)
{
    for (;;) {
        struct vec3 d =
            vec3_make(2 * test_random_float(r) - 1, 2 * test_random_float(r) - 1, 2 * test_random_float(r) - 1);
        float length2 = vec3_length_squared(d);

        if (length2 > 0.01f && length2 < 1)
            return vec3_normalize(d);
    }
}

/* The line's distance from the centre over the radius, in long double; infinite where the sphere lies
 * behind the ray. */
static long double passes_at(const struct sphere_shape *sphere, const struct ray *ray)
{
    double o[3], d[3];
    long double m[3], along = 0, d2 = 0, foot2 = 0;

    exact_origin(ray, o);
    exact_vec(ray->direction, d);
    for (int k = 0; k < 3; k++) {
        m[k] = (long double)o[k] - (long double)sphere->centre[k];
        along += m[k] * (long double)d[k];
        d2 += (long double)d[k] * (long double)d[k];
    }
    for (int k = 0; k < 3; k++) {
        long double foot = m[k] - along / d2 * (long double)d[k];
        foot2 += foot * foot;
    }
    return along < 0 ? sqrtl(foot2) / (long double)sphere->radius : INFINITY;
}

/* How far the surface's place is from the sphere, over the radius. */
static double off_sphere(const struct sphere_shape *sphere, const struct surface *s)
{
    double p[3], n[3];

    exact_vec(s->p, p);
    for (int k = 0; k < 3; k++)
        n[k] = p[k] + s->rest[k] - sphere->centre[k];
    return fabs(sqrt(exact_dot(n, n)) / sphere->radius - 1);
}

/* Of test_hits: rays that meet a sphere beside which they pass, or the other way round; rays that
 * leave one and meet what they cannot. */
static uint64_t misjudged, astray;

/* After the hit: outwards nothing, inwards the far side, from which outwards nothing again. */
static void leave_all_ways(const struct fixture *f, const struct surface *s, struct test_random *random)
{
    const struct sphere_shape *shape = sphere_of(s->instance->shape);

    for (int i = 0; i < 16; i++) {
        struct vec3 d = random_direction(random), n = s->front ? s->ng : vec3_neg(s->ng);
        float lean = i < 8 ? 1 : ldexpf(1, -2 * i + 10); /* ever more grazing */
        float along = vec3_dot(d, n);
        struct surface next;
        struct ray ray;
        struct hit hit;
        int met;

        d = vec3_normalize(vec3_mad(d, n, along * (lean - 1)));
        if (vec3_dot(d, n) == 0)
            continue;
        surface_leave(s, d, &ray);
        met = accel_intersect(f->scene->accel, &ray, NULL, &hit);
        if (met && hit.instance != 0)
            continue;
        if (met != (vec3_dot(d, n) < 0) || accel_occluded(f->scene->accel, &ray, NULL) != met) {
            astray++;
            continue;
        }
        if (!met)
            continue;
        surface_from_hit(f->scene, &ray, &hit, &next);
        astray += (uint64_t)next.front;
        assert_true(off_sphere(shape, &next) < 1e-14 * (1 + exact_largest(shape->centre) / shape->radius));
    }
}

/* Rays at a sphere of radius `radius` around (x, 2x, -x) from up to `far` radii or metres away, with so many small ones
 * beside it. */
static void shoot_beside(uint32_t others, double radius, double x, double far, uint64_t seed)
{
    struct buffer text = BUFFER_INIT;
    struct test_random random = {seed};
    struct fixture f;
    const struct sphere_shape *shape;
    int hits = 0, misses = 0;

    /* The camera is the farthest of all places from which rays start. */
    buffer_printf(&text, "LookAt 0 0 %g 0 0 0 0 1 0 Camera \"perspective\" Film \"rgb\" WorldBegin " LAMP
                         "Translate %.17g %.17g %.17g Shape \"sphere\" \"float radius\" %.17g",
                  2 * far, x, 2 * x, -x, radius);
    for (uint32_t k = 0; k < others; k++)
        buffer_printf(&text, " Translate %.17g %.17g %.17g Shape \"sphere\" \"float radius\" %.17g",
                      k == 0 ? 4 * radius : 0, k == 1 ? 4 * radius : k == 2 ? -8 * radius : 0,
                      k == 3 ? -4 * radius : k > 3 ? 2 * radius : 0, 0.01 * radius);
    fixture_whole(&f, buffer_text(&text));
    assert_int_equal(spheres_of(f.scene), 1 + others);
    shape = sphere_of(f.scene->instances[0].shape);
    for (int i = 0; i < 4000; i++) {
        struct vec3 away = random_direction(&random), aside = random_direction(&random);
        double reach = radius * 1.01 * pow(far / radius, test_random_double(&random));
        double aim = radius * 1.5 * test_random_double(&random), origin[3], way[3];
        struct ray ray = {.t_max = INFINITY};
        struct surface s;
        struct hit hit;
        long double passes;
        int met;

        origin[0] = shape->centre[0] + reach * (double)away.x;
        origin[1] = shape->centre[1] + reach * (double)away.y;
        origin[2] = shape->centre[2] + reach * (double)away.z;
        way[0] = shape->centre[0] + aim * (double)aside.x - origin[0];
        way[1] = shape->centre[1] + aim * (double)aside.y - origin[1];
        way[2] = shape->centre[2] + aim * (double)aside.z - origin[2];
        ray.origin = exact_round(origin, ray.rest);
        ray.direction =
            vec3_normalize(vec3_make((float)(way[0] / reach), (float)(way[1] / reach), (float)(way[2] / reach)));
        exact_origin(&ray, origin);
        passes = passes_at(shape, &ray);
        /* Doubles of the distance and the coordinates cannot tell. */
        if (fabsl(passes - 1) < 1e-14L * (1 + (long double)(reach / radius)))
            continue;
        met = accel_intersect(f.scene->accel, &ray, NULL, &hit);
        if (met && hit.instance != 0)
            continue;
        if (met != (passes < 1)) {
            if (misjudged++ == 0)
                printf("# radius %g at %g, from %g away: met %d, passes at %Lg radii\n", radius, x, reach, met, passes);
            continue;
        }
        assert_int_equal(accel_occluded(f.scene->accel, &ray, NULL), met);
        hits += met;
        misses += !met;
        if (!met)
            continue;
        surface_from_hit(f.scene, &ray, &hit, &s);
        if (!s.front || vec3_dot(s.ng, ray.direction) > 0 ||
            !(off_sphere(shape, &s) < 1e-14 * (1 + exact_largest(shape->centre) / radius))) {
            misjudged++;
            continue;
        }
        leave_all_ways(&f, &s, &random);
    }
    assert_true(hits > 20 && misses > 20);
    fixture_release(&f);
    buffer_release(&text);
}

/* Two spheres are looked at one by one; of seven the accelerator has a tree, and looks at their boxes. */
static void shoot(double radius, double x, double far, uint64_t seed)
{
    shoot_beside(1, radius, x, far, seed);
    shoot_beside(6, radius, x, far, seed);
}

static void test_hits(void **state)
{
    (void)state;
    shoot(1, 0, 1e3, 1);
    shoot(1, 0, 1e9, 2);
    shoot(1e-6, 0, 1, 3);
    shoot(1e6, 0, 1e9, 4);
    shoot(1e-3, 700, 1e3, 5);
    shoot(0.5, 31.4, 1e6, 6);
    figure_within("rays at spheres that miss wrongly, hit wrongly or hit elsewhere", (double)misjudged, 0, 0,
                  "long double, tolerance 1e-14");
    figure_within("rays that leave a sphere and meet what they cannot", (double)astray, 0, 0, "exact");
}

#define SQUARE "Shape \"trianglemesh\" \"point3 P\" [-9 -9 0 9 -9 0 9 9 0 -9 9 0] " \
               "\"integer indices\" [0 1 2 0 2 3]"

/* ---- faces closer than float's error ---------------------------------------------------------- */

/* The middle of SQUARE, whose corner 0 is 9 less. */
static void middle_of_ground(const struct render_scene *scene, double out[3])
{
    double corner[3][3];

    triangle_exact_corners(scene, 0, 0, 0, corner);
    for (int a = 0; a < 3; a++)
        out[a] = corner[0][a] + (a < 2 ? 9 : 0);
}

/* How far the place on instance `of` is from the nearest other, of which one is glass: spheres, and the ground. */
static double nearest_other(const struct render_scene *scene, uint32_t of, const double p[3])
{
    double least = INFINITY, ground[3];

    middle_of_ground(scene, ground);
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct render_instance *other = &scene->instances[i];
        double to[3], beyond2 = (p[2] - ground[2]) * (p[2] - ground[2]);

        if (i == of || !((scene->materials[other->material].flags |
                          scene->materials[scene->instances[of].material].flags) & MATERIAL_BOUNDS))
            continue;
        if (other->shape) {
            exact_sub(p, sphere_of(other->shape)->centre, to);
            least = fmin(least, fabs(sqrt(exact_dot(to, to)) - sphere_of(other->shape)->radius));
            continue;
        }
        for (int a = 0; a < 2; a++)
            beyond2 += pow(fmax(fabs(p[a] - ground[a]) - 9, 0), 2);
        least = fmin(least, sqrt(beyond2));
    }
    return least;
}

/* A place of a sphere, or of the ground: mostly where it is nearest to `other`, or a little beside. */
static void some_place(const struct render_scene *scene, const struct render_instance *on,
                       const struct render_instance *other, struct test_random *random, double p[3])
{
    const struct sphere_shape *sphere = on->shape ? sphere_of(on->shape) : NULL;
    const struct sphere_shape *seen = other->shape ? sphere_of(other->shape) : NULL;
    struct vec3 d = random_direction(random);
    const double aside[3] = {(double)d.x, (double)d.y, (double)d.z};
    double size = sphere ? sphere->radius : seen ? seen->radius : 1, ground[3], to[3], length;
    double wide = pow((double)scene->near_reach / size, test_random_double(random));

    middle_of_ground(scene, ground);
    for (int a = 0; a < 3 && !sphere; a++)
        p[a] = ground[a] + (a == 2 ? 0 : fmin(fmax((seen ? seen->centre[a] - ground[a] : 0) + wide * aside[a], -9), 9));
    if (!sphere)
        return;
    for (int a = 0; a < 3; a++)
        to[a] = seen ? seen->centre[a] - sphere->centre[a] : a == 2 ? ground[2] - sphere->centre[2] : 0;
    length = sqrt(exact_dot(to, to));
    for (int a = 0; a < 3; a++)
        to[a] = (length > 0 ? to[a] / length : 0) * (test_random_double(random) < 0.2 ? -1 : 1) + wide * aside[a];
    length = sqrt(exact_dot(to, to));
    for (int a = 0; a < 3; a++)
        p[a] = sphere->centre[a] + sphere->radius / length * to[a];
}

/* Spheres of glass and others, that touch, cut, hold or do not reach one another and the ground. */
static void random_spheres(struct buffer *text, struct test_random *random)
{
    double c[3] = {0, 0, 1}, r = 1;

    buffer_printf(text, LAMP SQUARE);
    for (int i = 0; i < 6; i++) {
        const double gap[] = {0, 1e-7, -1e-7, 1e-5, -0.3, 1}, from = r;
        double next = 0.2 + test_random_double(random), apart;
        struct vec3 d = random_direction(random);

        buffer_printf(text, " AttributeBegin Material \"%s\" Translate %.9g %.9g %.9g Shape \"sphere\" \"float radius\" "
                            "%.9g AttributeEnd", test_random_double(random) < 0.5 ? "dielectric" : "diffuse", c[0], c[1],
                      c[2], r);
        r = next;
        apart = test_random_double(random) < 0.3 ? fabs(from - r) : from + r;
        apart += gap[(int)(6 * test_random_double(random))];
        for (int a = 0; a < 3; a++)
            c[a] += apart * (double)(&d.x)[a];
        if (i % 2)
            c[2] = r + gap[(int)(6 * test_random_double(random))] * (i % 3 ? 1 : -1);
    }
}

/* Of a sphere that stands on the ground only the foot is near it, and of one that does not reach it nothing. */
static void test_alone(void **state)
{
    struct test_random random = {5};
    struct fixture f;

    (void)state;
    fixture_init(&f, LAMP SQUARE " Material \"dielectric\" Translate 2 0 1 Shape \"sphere\" "
                                 "Translate 3 0 1 Shape \"sphere\"");
    assert_int_equal(spheres_of(f.scene), 2);
    for (uint32_t i = 1; i < 3; i++) {
        const double *centre = sphere_of(f.scene->instances[i].shape)->centre;
        struct vec3 c = vec3_make((float)centre[0], (float)centre[1], (float)centre[2]);
        struct vec3 foot = vec3_add(c, vec3_make(0, 0, -1)), below = vec3_make(foot.x, foot.y, (float)centre[2] - (float)i);

        for (int k = 0; k < 1000; k++) {
            struct vec3 d = random_direction(&random);
            assert_false((i == 2 || d.z > -0.95f) &&
                         render_near_face(f.scene, &f.scene->instances[i], 0, vec3_add(c, d), 1));
        }
        assert_int_equal(render_near_face(f.scene, &f.scene->instances[i], 0, foot, 1), i == 1);
        assert_int_equal(render_near_face(f.scene, &f.scene->instances[0], 0, below, 1), i == 1);
    }
    fixture_release(&f);
}

static void test_near(void **state)
{
    uint64_t near = 0, missed = 0, far = 0, asked = 0;
    struct test_random random = {11};

    (void)state;
    for (int k = 0; k < 60; k++) {
        struct buffer text = BUFFER_INIT;
        struct fixture f;
        double reach, ground[3];

        random_spheres(&text, &random);
        fixture_init(&f, buffer_text(&text));
        reach = (double)f.scene->near_reach;
        middle_of_ground(f.scene, ground);
        for (int i = 0; i < 4000; i++) {
            uint32_t of = (uint32_t)(test_random_double(&random) * f.scene->instance_count);
            uint32_t other = (uint32_t)(test_random_double(&random) * f.scene->instance_count);
            const struct render_instance *on = &f.scene->instances[of];
            double p[3], rest[3], apart;
            int is_near;

            some_place(f.scene, on, &f.scene->instances[other], &random, p);
            apart = nearest_other(f.scene, of, p);
            is_near = render_near_face(f.scene, on, on->shape || p[1] - ground[1] < p[0] - ground[0] ? 0 : 1, exact_round(p, rest), 1);
            near += apart < reach;
            missed += apart < reach && !is_near;
            far += apart > 0.1;
            asked += apart > 0.1 && is_near;
        }
        fixture_release(&f);
        buffer_release(&text);
    }
    printf("# %llu places near another face, %llu not; of those %llu ask\n", (unsigned long long)near,
           (unsigned long long)far, (unsigned long long)asked);
    assert_true(near > 5000 && asked * 2 < far);
    figure_within("places of spheres and beside them, near another face, where no one asks which comes first",
                  (double)missed, 0, 0, "exact");
}

#define LAMP_BALL "AttributeBegin AreaLightSource \"diffuse\" Shape \"sphere\" AttributeEnd "

/* Of shadow rays to sampled points of the lamp, the first instance, from 8 radii along z. */
static uint32_t blocked_share(const char *world, int *tried)
{
    struct test_random random = {7};
    uint32_t blocked = 0;
    struct fixture f;
    const struct sphere_shape *lamp;

    fixture_init(&f, world);
    lamp = sphere_of(f.scene->instances[0].shape);
    *tried = 20000;
    for (int i = 0; i < *tried; i++) {
        struct light_context context = {.p = {(float)lamp->centre[0] + 0.05f * test_random_float(&random),
                                              (float)lamp->centre[1], (float)lamp->centre[2] + 8}};
        float u = test_random_float(&random), v = test_random_float(&random);
        struct light_sample light;
        struct ray ray = {.origin = context.p};

        assert_true(emitters_sample(f.scene, &context, u, v, &light));
        ray.reaches = 1;
        ray.direction = light.direction;
        ray.t_max = light.distance;
        ray.end = light.face;
        ray.end_inset = light.inset;
        ray.end_cosine = light.cosine;
        blocked += accel_occluded(f.scene->accel, &ray, NULL) != 0;
    }
    fixture_release(&f);
    return blocked;
}

/* The lamp does not stand in its own way, nor does what is inside it or behind; what stands before
 * it does, however close. */
static void test_shadow_rays(void **state)
{
    static const struct {
        const char *world;
        int blocks;
    } cases[] = {
        {LAMP_BALL, 0},
        {LAMP_BALL "Shape \"sphere\" \"float radius\" 0.9999", 0},
        {LAMP_BALL "Shape \"sphere\" \"float radius\" 1.0001", 1},
        {LAMP_BALL SQUARE, 0},
        {LAMP_BALL "Translate 0 0 0.12 " SQUARE, 0},
        {LAMP_BALL "Translate 0 0 1.0001 " SQUARE, 1},
        {LAMP_BALL "Translate 0 0 3 Shape \"sphere\" \"float radius\" 1.9", 1},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        int tried;
        uint32_t blocked = blocked_share(cases[i].world, &tried);

        if (blocked != (cases[i].blocks ? (uint32_t)tried : 0))
            fail_msg("%s: %u of %d blocked", cases[i].world, blocked, tried);
    }
}

/* From a ball that all but stands on a table, right above the table: down to it, and up to nothing. */
static void test_on_table(void **state)
{
    static const char *const materials[] = {"", "Material \"dielectric\" "};
    struct test_random random = {9};

    (void)state;
    for (int which = 0; which < 2; which++) {
        struct buffer text = BUFFER_INIT;
        struct fixture f;

        buffer_printf(&text, LAMP "AttributeBegin %s Rotate 90 1 0 0 Shape \"sphere\" AttributeEnd "
                                  "Translate 0 0 -1.00001 " SQUARE, materials[which]);
        fixture_init(&f, buffer_text(&text));
        for (int i = 0; i < 20000; i++) {
            const struct sphere_shape *shape = sphere_of(f.scene->instances[0].shape);
            float aside = ldexpf(test_random_float(&random), -i % 16), angle = (float)i, height;
            struct vec3 d = random_direction(&random), from;
            struct ray ray = {.t_max = INFINITY};
            struct surface s;
            struct hit hit;
            int met;

            from = vec3_make(aside * cosf(angle), aside * sinf(angle), -1);
            from = vec3_scale(vec3_normalize(from), 0.5f * (float)shape->radius);
            ray.origin =
                vec3_add(from, vec3_make((float)shape->centre[0], (float)shape->centre[1], (float)shape->centre[2]));
            ray.direction = vec3_normalize(from);
            assert_true(accel_intersect(f.scene->accel, &ray, NULL, &hit));
            surface_from_hit(f.scene, &ray, &hit, &s);
            assert_true(hit.instance == 0 && !s.front);
            if (vec3_dot(d, s.ng) > 0)
                d = vec3_neg(d); /* outwards: the normal is on the inner side */
            surface_leave(&s, d, &ray);
            met = accel_intersect(f.scene->accel, &ray, NULL, &hit);
            height = s.p.z - (float)shape->centre[2] + 1.00001f;
            if (d.z > 0 || height < -7 * d.z) /* it reaches the table within the square */
                assert_int_equal(met, d.z < 0);
            assert_true(!met || hit.instance == 1);
        }
        fixture_release(&f);
        buffer_release(&text);
    }
}

/* ---- texture coordinates ---------------------------------------------------------------------- */

/* pbrt's: u runs with the azimuth around z, v from the pole at -z. */
static void test_uv(void **state)
{
    struct test_random random = {8};
    struct fixture f;

    (void)state;
    fixture_init(&f, LAMP "Texture \"t\" \"spectrum\" \"checkerboard\" "
                          "Material \"diffuse\" \"texture reflectance\" \"t\" "
                          "Rotate 20 1 1 0 Scale 2 2 2 Shape \"sphere\"");
    assert_int_equal(spheres_of(f.scene), 1);
    for (int i = 0; i < 2000; i++) {
        const struct render_instance *instance = &f.scene->instances[0];
        const struct sphere_shape *shape = sphere_of(instance->shape);
        struct vec3 d = random_direction(&random), centre, local;
        struct ray ray = {.t_max = INFINITY};
        struct surface s;
        struct hit hit;
        float u, v;
        double want_u, want_v;

        centre = vec3_make((float)shape->centre[0], (float)shape->centre[1], (float)shape->centre[2]);
        ray.origin = vec3_mad(centre, d, 5);
        ray.direction = vec3_neg(d);
        assert_true(accel_intersect(f.scene->accel, &ray, NULL, &hit));
        surface_from_hit(f.scene, &ray, &hit, &s);
        surface_uv(&s, &u, &v);
        local = transform_vector(&instance->to_object, d);
        want_u = atan2((double)local.y, (double)local.x) / (2 * PI_D);
        want_u += want_u < 0;
        want_v = acos(-(double)local.z / (double)vec3_length(local)) / PI_D;
        if (want_v < 0.05 || want_v > 0.95)
            continue; /* around the poles a mesh can only come near */
        assert_true(fabs((double)v - want_v) < 1e-3);
        assert_true(fabs((double)u - want_u) < 1e-3);
    }
    fixture_release(&f);
}

/* ---- light ------------------------------------------------------------------------------------ */

/* Irradiance at a place with normal `n`, by sampling the lamp, blocked by nothing. */
static double irradiance(const struct render_scene *scene, struct vec3 p, struct vec3 n, double *error)
{
    const struct light_context context = {.p = p, .n = n};
    struct running_stats s = {0};
    enum { SIDE = 100 };

    for (int i = 0; i < SIDE * SIDE; i++) {
        struct light_sample light;
        double value = 0;

        if (emitters_sample(scene, &context, ((float)(i % SIDE) + 0.5f) / SIDE, ((float)(i / SIDE) + 0.5f) / SIDE,
                            &light))
            value = (double)(light.radiance.x / light.pdf * float_max(vec3_dot(light.direction, n), 0));
        running_stats_add(&s, value);
    }
    *error = running_stats_error(&s);
    return s.mean;
}

static void expect_irradiance(const char *world, double offset, double expected)
{
    struct fixture f;
    const struct sphere_shape *shape;
    double error, got;
    struct vec3 p;

    fixture_init(&f, world);
    assert_true(f.scene->instances[0].shape && f.scene->emitters.face_count == 1);
    shape = sphere_of(f.scene->instances[0].shape);
    p = vec3_make((float)shape->centre[0], (float)(shape->centre[1] - offset), (float)shape->centre[2]);
    got = irradiance(f.scene, p, vec3_make(0, 1, 0), &error);
    if (!(fabs(got / expected - 1) < 2e-3 + 4 * error / expected))
        fail_msg("%s, %g away: %.6g +- %.2g, not %.6g", world, offset, got, error, expected);
    fixture_release(&f);
}

#define GLOW "AreaLightSource \"diffuse\" \"rgb L\" [3 3 3] "

static void test_irradiance(void **state)
{
    static const double away[] = {1.0001, 1.1, 2, 30, 1e4, 1e9};

    (void)state;
    for (size_t i = 0; i < sizeof away / sizeof *away; i++)
        expect_irradiance(GLOW "Shape \"sphere\"", away[i], 3 * PI_D / (away[i] * away[i]));
    expect_irradiance(GLOW "Shape \"sphere\" \"float radius\" 1e-4", 0.7, 3 * PI_D * 1e-8 / 0.49);
    /* From inside it fills the hemisphere, wherever the place is. */
    expect_irradiance("ReverseOrientation " GLOW "Shape \"sphere\" \"float radius\" 5", 0, 3 * PI_D);
    expect_irradiance("ReverseOrientation " GLOW "Shape \"sphere\" \"float radius\" 5", 4, 3 * PI_D);
    expect_irradiance("ReverseOrientation " GLOW "Shape \"sphere\" \"float radius\" 5", -3, 3 * PI_D);
}

/* A lamp of so many watts: the area is the sphere's, not the mesh's. */
static void test_power(void **state)
{
    struct fixture f;
    double radiance;

    (void)state;
    fixture_init(&f, "AreaLightSource \"diffuse\" \"rgb L\" [1 1 1] \"float power\" 100 "
                     "Rotate 40 1 2 0 Scale 2 2 2 Shape \"sphere\" \"float radius\" 1.5");
    assert_int_equal(spheres_of(f.scene), 1);
    radiance = (double)f.scene->materials[f.scene->instances[0].material].m.emission[1];
    if (!(fabs(radiance * 4 * PI_D * 9 * PI_D / 100 - 1) < 1e-5))
        fail_msg("%.9g W", radiance * 4 * PI_D * 9 * PI_D);
    fixture_release(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_which),       cmocka_unit_test(test_false_claims),
        cmocka_unit_test(test_near), cmocka_unit_test(test_alone),
        cmocka_unit_test(test_hits),        cmocka_unit_test(test_shadow_rays),
        cmocka_unit_test(test_uv),          cmocka_unit_test(test_irradiance),
        cmocka_unit_test(test_power),       cmocka_unit_test(test_on_table),
    };

    return cmocka_run_group_tests_name("sphere", tests, NULL, NULL);
}
