/* Lights. pbrt-v4 divides each light's spectrum by its luminance under the camera's sensor, so that "rgb L" [1 1 1] and
 * any other spectrum of scale 1 give a radiance of luminance 1: an RGB value is our radiance unchanged, and every other
 * spectrum keeps only its colour. "power" and "illuminance" are in the same units (lumen, lux). */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/import/pbrt/read/pbrt_context.h"
#include "common/base/memory.h"
#include "common/image/color.h"
#include "common/math/elementary.h"

#define FOV_MIN_DEG 0.01 /* of a projection's shorter side */
#define FOV_MAX_DEG 179.0

static double luminance(const double c[3]) { return 0.2126729 * c[0] + 0.7151522 * c[1] + 0.0721750 * c[2]; }

/* pbrt-v4's square maps of equal areas; all of pbrt-v3's are of latitude and longitude. */
static int is_equal_area(const struct pbrt *p, const struct pbrt_image *image)
{
    return image->width == image->height && !p->version3;
}

/* name (L or I) times scale, which pbrt-v3 takes as a colour alone, pbrt-v4 as a number. */
static status read_strength(struct pbrt *p, struct pbrt_params *params, const char *name, double out[3])
{
    double scale[3] = {1, 1, 1};
    int given;

    out[0] = out[1] = out[2] = 1;
    TRY(pbrt_color(p, params, name, USE_LIGHT, out, &given));
    TRY(pbrt_color(p, params, "scale", USE_UNBOUNDED, scale, &given));
    if (!given && !p->version3)
        scale[0] = scale[1] = scale[2] = pbrt_float(params, "scale", 1);
    for (int i = 0; i < 3; i++)
        out[i] = fmax(out[i] * scale[i], 0);
    return STATUS_OK;
}

static void scale_by(double c[3], double factor)
{
    for (int i = 0; i < 3; i++)
        c[i] *= factor;
}

static void put_rgb(const double from[3], float to[3])
{
    for (int i = 0; i < 3; i++)
        to[i] = (float)fmin(fmax(from[i], 0), 1e30);
}

static float linear_value(const struct pbrt_image *image, float v) { return image->is_float ? v : srgb_decode(v); }

status pbrt_image_luminance(struct pbrt *p, struct pbrt_image *image, double *out)
{
    double sum = 0;
    size_t count;

    TRY(pbrt_image_decode(p, image));
    count = (size_t)image->width * image->height;
    for (size_t i = 0; i < count; i++) {
        const float *texel = image->pixels.pixels + i * image->channels;
        double c[3];
        for (unsigned k = 0; k < 3; k++)
            c[k] = (double)linear_value(image, texel[image->channels >= 3 ? k : 0]);
        sum += luminance(c);
    }
    *out = count ? sum / (double)count : 0;
    return STATUS_OK;
}

/* ---- area lights -------------------------------------------------------------------------- */

status pbrt_area_light_resolve(struct pbrt *p, struct pbrt_area_light *light)
{
    static const char *const sampling[] = {"nsamples", "samples", NULL};
    struct pbrt_params *a = light->params;
    const char *name = pbrt_string(a, "filename", NULL);

    if (light->resolved)
        return STATUS_OK;
    light->resolved = 1;
    TRY(read_strength(p, a, "L", light->radiance));
    light->power = pbrt_float(a, "power", 0);
    light->two_sided = pbrt_bool(a, "twosided", 0);
    light->mean_luminance = 1;
    if (name) {
        TRY(pbrt_image(p, name, &light->at, &light->image));
        if (light->image && light->power > 0)
            TRY(pbrt_image_luminance(p, light->image, &light->mean_luminance));
    }
    pbrt_ignore(a, sampling);
    pbrt_params_report(a, p->b, "area light");
    return STATUS_OK;
}

/* ---- places ------------------------------------------------------------------------------- */

static void transform_to(const struct transform_d *m, const double v[3], int is_point, double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = m->m[i][0] * v[0] + m->m[i][1] * v[1] + m->m[i][2] * v[2] + (is_point ? m->m[i][3] : 0);
}

/* The rotation or mirroring in a matrix: its axes made orthonormal, z kept. 0: singular. */
static int orthonormal(const struct transform_d *m, double out[3][3])
{
    double x[3], y[3], z[3], dot = 0;

    for (int i = 0; i < 3; i++) {
        y[i] = m->m[i][1];
        z[i] = m->m[i][2];
    }
    if (!pbrt_unit(z))
        return 0;
    for (int i = 0; i < 3; i++)
        dot += y[i] * z[i];
    for (int i = 0; i < 3; i++)
        y[i] -= dot * z[i];
    if (!pbrt_unit(y))
        return 0;
    for (int i = 0; i < 3; i++)
        x[i] = y[(i + 1) % 3] * z[(i + 2) % 3] - y[(i + 2) % 3] * z[(i + 1) % 3];
    dot = transform_d_determinant(m);
    if (!(fabs(dot) > 0) || !isfinite(dot))
        return 0;
    for (int i = 0; i < 3; i++) {
        out[i][0] = dot < 0 ? -x[i] : x[i];
        out[i][1] = y[i];
        out[i][2] = z[i];
    }
    return 1;
}

/* Position and direction of a light from "from" to "to". */
static status read_aim(struct pbrt *p, const struct pbrt_directive *d, struct scene_light *out)
{
    const struct transform_d world = pbrt_to_world(p, &d->ctm.at[0]);
    double from[3] = {0, 0, 0}, to[3] = {0, 0, 1}, w[3], at[3];

    (void)pbrt_triple(d->params, "from", from);
    (void)pbrt_triple(d->params, "to", to);
    for (int i = 0; i < 3; i++)
        w[i] = to[i] - from[i];
    transform_to(&world, w, 0, at);
    if (!pbrt_unit(at))
        return pbrt_fail(p, STATUS_ERR_INPUT, &d->at, "the light has no direction");
    for (int i = 0; i < 3; i++)
        out->direction[i] = (float)at[i];
    transform_to(&world, from, 1, at);
    memcpy(out->position, at, sizeof out->position);
    return STATUS_OK;
}

/* A frame of the light's axes turned by `turn` (columns). */
static status read_frame(struct pbrt *p, const struct pbrt_directive *d, const double turn[3], struct scene_light *out)
{
    const struct transform_d world = pbrt_to_world(p, &d->ctm.at[0]);
    double axes[3][3];

    if (!orthonormal(&world, axes))
        return pbrt_fail(p, STATUS_ERR_INPUT, &d->at, "the light's matrix cannot be inverted");
    for (int i = 0; i < 3; i++) {
        for (int c = 0; c < 3; c++)
            out->to_world.m[i][c] = axes[i][c] * turn[c];
        out->position[i] = out->to_world.m[i][3] = world.m[i][3];
        out->direction[i] = (float)-out->to_world.m[i][2];
    }
    return STATUS_OK;
}

/* ---- lights at a point -------------------------------------------------------------------- */

static status read_point(struct pbrt *p, const struct pbrt_directive *d, struct scene_light *out)
{
    double power = pbrt_float(d->params, "power", 0), strength[3];

    out->kind = LIGHT_POINT;
    TRY(read_aim(p, d, out));
    TRY(read_strength(p, d->params, "I", strength));
    if (power > 0)
        scale_by(strength, power / (4 * PI_D));
    put_rgb(strength, out->intensity);
    return STATUS_OK;
}

static double cosine_of_degrees(double angle) { return (double)det_cos((float)(angle * PI_D / 180)); }

static status read_spot(struct pbrt *p, const struct pbrt_directive *d, struct scene_light *out)
{
    double power = pbrt_float(d->params, "power", 0), strength[3];
    double cone = pbrt_float(d->params, "coneangle", 30);
    double delta = pbrt_float(d->params, "conedeltaangle", 5);

    out->kind = LIGHT_SPOT;
    out->falloff = p->version3 ? FALLOFF_FOURTH : FALLOFF_SMOOTHSTEP;
    TRY(read_aim(p, d, out));
    TRY(read_strength(p, d->params, "I", strength));
    if (!(cone > 0 && cone <= 90)) {
        pbrt_warn(p, &d->at, "cone angle", "a spot light's cone angle of %g is not supported: 90 degrees at most",
                  cone);
        cone = cone > 0 ? 90 : 1;
    }
    delta = fmin(fmax(delta, 0), cone);
    if (power > 0) {
        double end = cosine_of_degrees(cone), start = cosine_of_degrees(cone - delta);
        scale_by(strength, power / (2 * PI_D * ((1 - start) + (start - end) / 2)));
    }
    out->outer_cone_rad = (float)(cone * PI_D / 180);
    if (out->outer_cone_rad > 1.5707963f)
        out->outer_cone_rad = 1.5707963f;
    out->inner_cone_rad = (float)((cone - delta) * PI_D / 180);
    if (out->inner_cone_rad >= out->outer_cone_rad * 0.9999f)
        out->inner_cone_rad = out->outer_cone_rad * 0.9999f; /* a hard edge */
    put_rgb(strength, out->intensity);
    return STATUS_OK;
}

static status read_distant(struct pbrt *p, const struct pbrt_directive *d, struct scene_light *out)
{
    double lux = pbrt_float(d->params, "illuminance", 0), strength[3];

    out->kind = LIGHT_DIRECTIONAL;
    TRY(read_aim(p, d, out));
    TRY(read_strength(p, d->params, "L", strength));
    if (lux > 0)
        scale_by(strength, lux);
    put_rgb(strength, out->intensity);
    return STATUS_OK;
}

static status light_image(struct pbrt *p, const struct pbrt_directive *d, struct pbrt_image **out)
{
    const char *name = pbrt_string(d->params, "filename", NULL);

    *out = NULL;
    if (!name)
        name = pbrt_string(d->params, "mapname", NULL); /* pbrt-v3 */
    return name ? pbrt_image(p, name, &d->at, out) : STATUS_OK;
}

/* These pixels as an image row. */
static status add_pixels(struct pbrt *p, const char *name, const struct image *pixels, uint32_t *row)
{
    struct buffer out = BUFFER_INIT;
    status result = pfm_encode(&out, pixels, p->err);

    if (result == STATUS_OK)
        return builder_add_image(p->b, name, out.data, out.size, row);
    buffer_release(&out);
    return result;
}

static status read_goniometric(struct pbrt *p, const struct pbrt_directive *d, struct scene_light *out)
{
    /* pbrt exchanges y and z: a square map's middle is the light's +y. */
    /* A lat-long picture begins at +x there, ours at -x: half a turn about y. */
    static const double same[3] = {1, 1, 1}, half_turn[3] = {-1, 1, -1};
    double power = pbrt_float(d->params, "power", 0), strength[3], mean;
    struct pbrt_image *image;
    struct image latlong = {0};
    status result;
    uint32_t row;

    TRY(light_image(p, d, &image));
    if (!image)
        return read_point(p, d, out);
    out->kind = LIGHT_GONIOMETRIC;
    TRY(read_strength(p, d->params, "I", strength));
    TRY(pbrt_image_decode(p, image));
    if (power > 0) {
        TRY(pbrt_image_luminance(p, image, &mean));
        scale_by(strength, mean > 0 ? power / (4 * PI_D * mean) : 0);
    }
    put_rgb(strength, out->intensity);
    if (!is_equal_area(p, image)) {
        TRY(read_frame(p, d, half_turn, out));
        TRY(pbrt_image_row(p, image, &row));
        out->image = (int32_t)row;
        return STATUS_OK;
    }
    TRY(read_frame(p, d, same, out));
    TRY(pbrt_octahedral_to_latlong(&image->pixels, 1, &latlong, p->err));
    result = add_pixels(p, image->name, &latlong, &row);
    image_release(&latlong);
    if (result == STATUS_OK)
        out->image = (int32_t)row;
    return result;
}

static status read_projection(struct pbrt *p, const struct pbrt_directive *d, struct scene_light *out)
{
    /* pbrt's shines along +z; pbrt-v3's picture has its top at -y. */
    const double flip[3] = {1, p->version3 ? -1 : 1, -1};
    double power = pbrt_float(d->params, "power", 0), strength[3], aspect, tangent;
    double fov = pbrt_float(d->params, "fov", p->version3 ? 45 : 90);
    struct pbrt_image *image;
    uint32_t row;

    TRY(light_image(p, d, &image));
    if (!image)
        return pbrt_fail(p, STATUS_ERR_INPUT, &d->at, "a projection light needs a picture that can be read (\"string filename\")");
    if (!(fov >= FOV_MIN_DEG && fov <= FOV_MAX_DEG))
        return pbrt_fail(p, STATUS_ERR_INPUT, &d->at, "the projection light's fov is %g: it must be %g to %g degrees",
                         fov, FOV_MIN_DEG, FOV_MAX_DEG);
    out->kind = LIGHT_PROJECTION;
    TRY(read_frame(p, d, flip, out));
    TRY(read_strength(p, d->params, "I", strength));
    TRY(pbrt_image_decode(p, image));
    aspect = (double)image->width / image->height;
    tangent = (double)det_tan((float)(fov * PI_D / 360)); /* of the shorter side */
    if (aspect < 1)
        tangent /= aspect;
    out->projection_yfov_rad = 2 * det_atan2((float)tangent, 1);
    out->projection_aspect = (float)aspect;
    if (power > 0) {
        /* The flux of a picture of its mean: the solid angle weighted by it, texel by texel. */
        enum { STEPS = 64 };
        double sum = 0, area = 4 * tangent * tangent * aspect, mean;
        for (int y = 0; y < STEPS; y++)
            for (int x = 0; x < STEPS; x++) {
                double u = tangent * aspect * (2 * (x + 0.5) / STEPS - 1);
                double v = tangent * (2 * (y + 0.5) / STEPS - 1);
                double c = 1 / sqrt(1 + u * u + v * v);
                sum += c * c * c * area / (STEPS * STEPS);
            }
        TRY(pbrt_image_luminance(p, image, &mean));
        scale_by(strength, mean * sum > 0 ? power / (mean * sum) : 0);
    }
    put_rgb(strength, out->intensity);
    TRY(pbrt_image_row(p, image, &row));
    out->image = (int32_t)row;
    return STATUS_OK;
}

/* ---- the environment ---------------------------------------------------------------------- */

/* The illuminance on a surface facing the light's +z, from a lat-long picture whose top is +z. */
static double map_illuminance(const struct image *map)
{
    double sum = 0;

    for (uint32_t y = 0; y < map->height / 2; y++) {
        float sine, cosine;
        det_sincos((float)(PI_D * (y + 0.5) / map->height), &sine, &cosine);
        for (uint32_t x = 0; x < map->width; x++) {
            const float *texel = map->pixels + ((size_t)y * map->width + x) * map->channels;
            const double c[3] = {(double)texel[0], (double)texel[map->channels >= 3 ? 1 : 0],
                                 (double)texel[map->channels >= 3 ? 2 : 0]};
            sum += luminance(c) * (double)(sine * cosine);
        }
    }
    return sum * (PI_D / map->height) * (2 * PI_D / map->width);
}

static void set_to_map(struct pbrt *p, const double map_of_light[3][3], const double axes[3][3])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double v = 0;
            for (int k = 0; k < 3; k++)
                v += map_of_light[i][k] * axes[j][k];
            p->b->environment.to_map[i][j] = (float)v;
        }
}

static status linear_copy(struct pbrt *p, const struct pbrt_image *image, struct image *out)
{
    TRY(image_init(out, image->width, image->height, 3, p->err));
    for (size_t i = 0; i < (size_t)image->width * image->height; i++)
        for (unsigned k = 0; k < 3; k++) {
            float v = image->pixels.pixels[i * image->channels + (image->channels >= 3 ? k : 0)];
            out->pixels[3 * i + k] = linear_value(image, v);
        }
    return STATUS_OK;
}

static void mirror_columns(struct image *map)
{
    for (uint32_t y = 0; y < map->height; y++)
        for (uint32_t x = 0; x < map->width / 2; x++) {
            float *row = map->pixels + (size_t)y * map->width * 3;
            for (unsigned k = 0; k < 3; k++) {
                float swap = row[3 * x + k];
                row[3 * x + k] = row[3 * (map->width - 1 - x) + k];
                row[3 * (map->width - 1 - x) + k] = swap;
            }
        }
}

/* Make the lat-long map and its rotation. `axes`: the light's axes in the world, columns. */
static status make_map(struct pbrt *p, const struct pbrt_directive *d, struct pbrt_image *image,
                       const double axes[3][3], struct image *out)
{
    struct transform_d m = transform_d_identity();
    double handed;
    struct image pixels = {0};
    status result;

    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            m.m[i][j] = axes[i][j];
    handed = transform_d_determinant(&m) < 0 ? -1 : 1;
    TRY(pbrt_image_decode(p, image));
    if (is_equal_area(p, image)) /* the lat-long map is twice as large */
        TRY(builder_check_pixels(p->b, image->name, 2 * (uint64_t)image->width, image->height));
    TRY(linear_copy(p, image, &pixels));
    if (is_equal_area(p, image)) {
        /* Map axes (x, z, -+y) of the light: the zenith is +z, and the whole is a rotation. */
        const double map_of_light[3][3] = {{1, 0, 0}, {0, 0, 1}, {0, -handed, 0}};
        result = pbrt_octahedral_to_latlong(&pixels, -handed, out, p->err);
        image_release(&pixels);
        set_to_map(p, map_of_light, axes);
        return result;
    }
    if (!pbrt_has(d->params, "mapname") && !p->version3)
        pbrt_warn(p, &d->at, "environment shape",
                  "the environment \"%.100s\" is not square: taken as a map of latitude and "
                  "longitude (pbrt-v3's)",
                  image->name);
    {
        /* pbrt-v3: u = phi / (2 pi) from +x towards +y, the zenith is +z. */
        const double map_of_light[3][3] = {{-1, 0, 0}, {0, 0, 1}, {0, handed, 0}};
        set_to_map(p, map_of_light, axes);
    }
    if (handed > 0)
        mirror_columns(&pixels);
    *out = pixels;
    return STATUS_OK;
}

static status read_map(struct pbrt *p, const struct pbrt_directive *d, struct pbrt_image *image, double lux,
                       double strength[3])
{
    const struct transform_d world = pbrt_to_world(p, &d->ctm.at[0]);
    struct buffer bytes = BUFFER_INIT;
    struct image map = {0};
    double axes[3][3];
    status result;

    if (!orthonormal(&world, axes))
        return pbrt_fail(p, STATUS_ERR_INPUT, &d->at, "the light's matrix cannot be inverted");
    TRY(make_map(p, d, image, axes, &map));
    if (lux > 0) {
        double known = map_illuminance(&map);
        scale_by(strength, known > 0 ? lux / known : 0);
    }
    result = pfm_encode(&bytes, &map, p->err);
    image_release(&map);
    if (result != STATUS_OK) {
        buffer_release(&bytes);
        return result;
    }
    return builder_set_environment_map(p->b, image->name, bytes.data, bytes.size);
}

/* Four corners in the world, one after the other around the window. */
static status read_portal(struct pbrt *p, const struct pbrt_directive *d)
{
    const struct pbrt_param *param = pbrt_param(d->params, "portal", PBRT_TRIPLES);
    struct scene_portal portal;

    if (!param)
        return STATUS_OK;
    if (param->number_count != 12)
        return pbrt_fail(p, STATUS_ERR_INPUT, &param->at, "a portal has four corners");
    for (int i = 0; i < 3; i++) {
        double sign = p->mirrored && i == 2 ? -1 : 1;
        const double *n = param->numbers;
        portal.corner[i] = sign * n[i];
        portal.edge1[i] = (float)(sign * (n[3 + i] - n[i]));
        portal.edge2[i] = (float)(sign * (n[9 + i] - n[i]));
    }
    return builder_add_portal(p->b, &portal);
}

static status read_infinite(struct pbrt *p, const struct pbrt_directive *d)
{
    struct scene_environment *env = &p->b->environment;
    double lux = pbrt_float(d->params, "illuminance", 0), strength[3];
    const int was_present = env->present;
    struct pbrt_image *image;

    (void)pbrt_param(d->params, "nsamples", ~0u);
    (void)pbrt_param(d->params, "samples", ~0u);
    TRY(read_strength(p, d->params, "L", strength));
    TRY(light_image(p, d, &image));
    if (was_present && !(env->constant && !image)) {
        pbrt_warn(p, &d->at, "several environments",
                  "several infinite lights with pictures are not supported: this one is left out");
        for (size_t i = 0; i < d->params->count; i++)
            d->params->items[i].used = 1;
        return STATUS_OK;
    }
    if (image)
        TRY(read_map(p, d, image, lux, strength));
    else if (lux > 0)
        scale_by(strength, lux / PI_D);
    for (int i = 0; i < 3; i++)
        strength[i] += was_present ? (double)env->radiance[i] : 0;
    put_rgb(strength, env->radiance);
    env->constant = !image;
    env->present = 1;
    return read_portal(p, d);
}

/* ---- all of them -------------------------------------------------------------------------- */

status pbrt_light(struct pbrt *p, const struct pbrt_directive *d)
{
    static const struct {
        const char *kind;
        status (*read)(struct pbrt *p, const struct pbrt_directive *d, struct scene_light *out);
    } kinds[] = {
        {"point", read_point},           {"spot", read_spot},
        {"distant", read_distant},       {"goniometric", read_goniometric},
        {"projection", read_projection},
    };
    struct scene_light light;
    char what[96];

    snprintf(what, sizeof what, "light \"%.60s\"", d->kind);
    if (pbrt_is_moving(&d->ctm))
        pbrt_warn(p, &d->at, "animated light", "a light that moves is not supported: at rest");
    if (strcmp(d->kind, "infinite") == 0 || strcmp(d->kind, "exinfinite") == 0) {
        TRY(read_infinite(p, d));
        pbrt_params_report(d->params, p->b, what);
        return STATUS_OK;
    }
    scene_light_default(&light);
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++)
        if (strcmp(d->kind, kinds[i].kind) == 0) {
            light.name = builder_name(p->b, d->kind);
            TRY(kinds[i].read(p, d, &light));
            pbrt_params_report(d->params, p->b, what);
            return builder_add_light(p->b, &light);
        }
    pbrt_warn(p, &d->at, what, "the light kind \"%.60s\" is not known: left out", d->kind);
    return STATUS_OK;
}
