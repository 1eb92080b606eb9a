/* Hints: what a pbrt file says about how to render it (options, sampler, integrator, film). */
#include <math.h>
#include <string.h>

#include "client/import/pbrt/read/pbrt_context.h"
#include "common/math/elementary.h"
#include "common/scene/settings.h"

void pbrt_option(struct pbrt *p, const struct pbrt_directive *d)
{
    /* These control pbrt's implementation or its tests. */
    static const char *const silent[] = {"rendercoordsys", "seed", "pixelstats", "wavefront",
                                         "msereferenceimage", "msereferenceout",
                                         "displacementedgescale", NULL};

    pbrt_ignore(d->params, silent);
    pbrt_params_report(d->params, p->b, "Option");
}

void pbrt_sampler(struct pbrt *p, const struct pbrt_directive *d)
{
    static const char *const how[] = {"randomization", "jitter", "seed", "dimensions",
                                      "scramble", NULL};
    long x, y;

    p->samples = pbrt_integer(d->params, "pixelsamples", -1);
    p->samples_at = d->at;
    x = pbrt_integer(d->params, "xsamples", 0);
    y = pbrt_integer(d->params, "ysamples", 0);
    if (x > 0 || y > 0) { /* each is 4 where it is not given */
        x = x > 0 ? x : 4;
        y = y > 0 ? y : 4;
    }
    if (x > 0 && x <= 1 << 12 && y <= 1 << 12)
        p->samples = x * y;
    pbrt_ignore(d->params, how);
    pbrt_params_report(d->params, p->b, "sampler");
}

void pbrt_integrator(struct pbrt *p, const struct pbrt_directive *d)
{
    static const char *const how[] = {"lightsampler", "lightsamplestrategy", "rrthreshold",
                                      "visualizestrategies", "visualizeweights", "usemis", NULL};
    static const char *const paths[] = {"path", "volpath", "bdpt", "mlt", "simplepath",
                                        "simplevolpath", "lightpath", "randomwalk", "directlighting",
                                        "sppm", NULL};
    int known = 0;

    for (int i = 0; paths[i]; i++)
        known = known || strcmp(d->kind, paths[i]) == 0;
    if (!known)
        pbrt_warn(p, &d->at, "integrator", "the integrator \"%.40s\" is not supported: paths are traced", d->kind);
    p->max_depth = pbrt_integer(d->params, "maxdepth", PBRT_MAX_DEPTH);
    if (strcmp(d->kind, "directlighting") == 0)
        p->max_depth = 1;
    p->depth_at = d->at;
    if (pbrt_bool(d->params, "regularize", 0))
        pbrt_warn(p, &d->at, "regularize",
                  "the integrator's \"regularize\" is not supported: caustics stay sharp and noisy");
    pbrt_ignore(d->params, how);
    if (known)
        pbrt_params_report(d->params, p->b, "integrator");
}
/* A Gaussian is given by its deviation and where it is cut; pbrt-v3's "alpha" is 1 / (2 sigma^2). Ours is cut at 3 of
 * them. */
static double gaussian_width(struct pbrt *p, const struct pbrt_directive *d, double radius)
{
    const double alpha = pbrt_float(d->params, "alpha", 0);
    const double sigma = alpha > 0 ? 1 / sqrt(2 * alpha) : pbrt_float(d->params, "sigma", 0.5);

    if (radius < 2.5 * sigma)
        pbrt_warn(p, &d->at, "PixelFilter cut", "the Gaussian filter is cut at 3 standard deviations, not at %g pixels", radius);
    return 6 * sigma;
}

void pbrt_filter(struct pbrt *p, const struct pbrt_directive *d)
{
    struct import_hints *hints = &p->b->out->hints;
    const int kind = pixel_filter_parse(d->kind);
    double x, y, width;

    if (kind < 0 || kind == PIXEL_FILTER_BLACKMAN_HARRIS) {
        pbrt_warn(p, &d->at, "PixelFilter", "the pixel filter \"%.40s\" is not supported: %s is used", d->kind,
                  pixel_filter_name(PIXEL_FILTER_BLACKMAN_HARRIS));
        return;
    }
    x = pbrt_float(d->params, "xradius", kind == PIXEL_FILTER_BOX ? 0.5 : kind == PIXEL_FILTER_TRIANGLE ? 2 : 1.5);
    y = pbrt_float(d->params, "yradius", x);
    width = kind == PIXEL_FILTER_GAUSSIAN ? gaussian_width(p, d, x) : 2 * x;
    pbrt_params_report(d->params, p->b, "pixel filter");
    if (x != y)
        pbrt_warn(p, &d->at, "PixelFilter yradius", "the pixel filter is as high as it is wide: its \"yradius\" is ignored");
    if (!(width >= 0.01 && width <= 16)) {
        pbrt_warn(p, &d->at, "PixelFilter width",
                  "a pixel filter %g pixels wide is not supported (0.01 to 16 are): it is ignored", width);
        return;
    }
    hints->has_filter = 1;
    hints->pixel_filter = (enum pixel_filter)kind;
    hints->filter_width = (float)width;
}

/* "cropwindow" [x0 x1 y0 y1] in shares of the film, "pixelbounds" in pixels: pixels from the first up to the last. */
static void read_crop(struct pbrt *p, struct pbrt_params *params)
{
    struct import_hints *hints = &p->b->out->hints;
    const struct pbrt_param *shares = pbrt_param(params, "cropwindow", PBRT_NUMBERS);
    const struct pbrt_param *pixels = pbrt_param(params, "pixelbounds", PBRT_NUMBERS);
    const struct pbrt_param *given = pixels ? pixels : shares; /* as pbrt has it */
    double edge[4];

    if (!given)
        return;
    for (int i = 0; i < 4 && given->number_count == 4; i++) {
        double size = i < 2 ? hints->width : hints->height;
        edge[i] = ceil(given->numbers[i] * (pixels ? 1 : size));
        edge[i] = fmin(fmax(edge[i], 0), size);
    }
    if (given->number_count != 4 || !(edge[0] < edge[1] && edge[2] < edge[3])) {
        pbrt_warn(p, &p->film.at, "crop window", "the film's crop window is none: the whole picture is rendered");
        return;
    }
    hints->crop_x = (uint32_t)edge[0];
    hints->crop_y = (uint32_t)edge[2];
    hints->crop_width = (uint32_t)(edge[1] - edge[0]);
    hints->crop_height = (uint32_t)(edge[3] - edge[2]);
}

/* pbrt's imaging ratio, 1 unless asked for. pbrt-v4's time of exposure is the shutter's (older ones had it with the film); in pbrt-v3
 * the film's scale is all. */
static void put_exposure(struct pbrt *p, struct scene_camera *camera)
{
    struct pbrt_params *film = p->film.params;
    double open = pbrt_float(p->camera.params, "shutteropen", 0), close = pbrt_float(p->camera.params, "shutterclose", 1);
    double time = pbrt_float(film, "exposuretime", p->version3 ? 1 : close - open);
    double ratio = pbrt_float(film, "iso", 100) / 100 * time;

    if (p->version3)
        ratio *= pbrt_float(film, "scale", 1);
    if (ratio > 1e-12 && ratio < 1e12 && ratio != 1)
        camera->exposure_ev = det_log((float)ratio) * 1.44269504f;
}

void pbrt_film_hints(struct pbrt *p, struct scene_camera *camera, double *aspect)
{
    struct pbrt_params *params = p->film.params;
    static const char *const elsewhere[] = {"filename", "savefp16", "diagonal",
                                            "coordinatesystem", NULL};
    const char *const limit = p->version3 ? "maxsampleluminance" : "maxcomponentvalue";
    long width = 1280, height = 720;
    double most;
    const char *sensor;

    *aspect = 1280.0 / 720.0;
    put_exposure(p, camera);
    if (!params)
        return;
    width = pbrt_integer(params, "xresolution", width);
    height = pbrt_integer(params, "yresolution", height);
    if (width >= 1 && height >= 1 && width <= SETTINGS_SIZE_MAX && height <= SETTINGS_SIZE_MAX) {
        *aspect = (double)width / (double)height;
        p->b->out->hints.width = (uint32_t)width;
        p->b->out->hints.height = (uint32_t)height;
    } else {
        pbrt_warn(p, &p->film.at, "resolution",
                  "a film of %ld x %ld pixels is not supported (1 to %d are): its size is ignored", width, height,
                  SETTINGS_SIZE_MAX);
    }
    sensor = pbrt_string(params, "sensor", "cie1931");
    if (strcmp(sensor, "cie1931") != 0)
        pbrt_warn(p, &p->film.at, "sensor", "the film's sensor \"%.40s\" is not supported: an ideal one is used",
                  sensor);
    if (pbrt_float(params, "whitebalance", 0) != 0)
        pbrt_warn(p, &p->film.at, "whitebalance",
                  "the film's \"whitebalance\" is not supported: see --white-balance for the tone "
                  "mapped picture");
    most = pbrt_float(params, limit, INFINITY);
    if (most < (double)SCENE_RADIANCE_MAX)
        pbrt_warn(p, &p->film.at, limit, "the film's \"%s\" of %g is not supported: no sample is clamped", limit, most);
    if (strcmp(p->film.kind, "rgb") != 0 && strcmp(p->film.kind, "image") != 0)
        pbrt_warn(p, &p->film.at, "film", "the film \"%.40s\" is taken as \"rgb\"", p->film.kind);
    pbrt_ignore(params, elsewhere);
    read_crop(p, params);
    pbrt_params_report(params, p->b, "film");
}

void pbrt_integrator_hints(struct pbrt *p)
{
    struct import_hints *hints = &p->b->out->hints;
    long depth = p->max_depth >= 0 ? p->max_depth : PBRT_MAX_DEPTH;

    if (p->samples > SETTINGS_SPP_MAX)
        pbrt_warn(p, &p->samples_at, "pixelsamples", "%ld samples a pixel are more than the limit of %d, which is used",
                  p->samples, SETTINGS_SPP_MAX);
    if (p->samples > 0)
        hints->spp = (uint32_t)(p->samples < SETTINGS_SPP_MAX ? p->samples : SETTINGS_SPP_MAX);
    if (depth > SETTINGS_DEPTH_MAX)
        pbrt_warn(p, &p->depth_at, "maxdepth", "a depth of %ld is more than the limit of %d, which is used", depth,
                  SETTINGS_DEPTH_MAX);
    hints->has_max_depth = 1;
    hints->max_depth = (uint32_t)(depth < SETTINGS_DEPTH_MAX ? depth : SETTINGS_DEPTH_MAX);
}
