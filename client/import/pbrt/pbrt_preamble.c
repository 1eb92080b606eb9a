/* The directives before WorldBegin, and WorldBegin itself. */
#include <string.h>

#include "client/import/pbrt/read/pbrt_directive.h"

/* Camera and film wait for one another until the world begins. */
static status keep_directive(struct pbrt *p, const char *word, const struct pbrt_place *at, struct pbrt_directive *out)
{
    if (p->in_world)
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "%s must come before WorldBegin", word);
    TRY(pbrt_read_directive(p, word, NULL, at, out));
    out->params = pbrt_params_copy(&p->params, &p->arena);
    return STATUS_OK;
}

static status do_camera(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_matrices world_from_camera;

    TRY(keep_directive(p, "Camera", at, &p->camera));
    for (int i = 0; i < 2; i++)
        if (!transform_d_invert(&p->camera.ctm.at[i], &world_from_camera.at[i]))
            return pbrt_fail(p, STATUS_ERR_INPUT, at, "the camera's matrix cannot be inverted");
    p->camera_medium = p->now.outside;
    pbrt_keep_system(p, "camera", &world_from_camera);
    return STATUS_OK;
}

static status do_film(struct pbrt *p, const struct pbrt_place *at)
{
    TRY(keep_directive(p, "Film", at, &p->film));
    if (strcmp(p->film.kind, "image") == 0)
        p->version3 = 1; /* pbrt-v4 has no such film */
    return STATUS_OK;
}

static status do_sampler(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_directive d;

    TRY(pbrt_read_directive(p, "Sampler", NULL, at, &d));
    pbrt_sampler(p, &d);
    return STATUS_OK;
}

static status do_integrator(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_directive d;

    TRY(pbrt_read_directive(p, "Integrator", NULL, at, &d));
    pbrt_integrator(p, &d);
    return STATUS_OK;
}

static status do_filter(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_directive d;

    TRY(pbrt_read_directive(p, "PixelFilter", NULL, at, &d));
    pbrt_filter(p, &d);
    return STATUS_OK;
}

/* How rays are found does not change the picture. */
static status do_accelerator(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_directive d;

    return pbrt_read_directive(p, "Accelerator", NULL, at, &d);
}

static status do_option(struct pbrt *p, const struct pbrt_place *at)
{
    struct pbrt_directive d = {.kind = "", .at = *at, .params = &p->params};

    TRY(pbrt_next_params(p, NULL));
    pbrt_option(p, &d);
    return STATUS_OK;
}

static status do_world(struct pbrt *p, const struct pbrt_place *at)
{
    if (p->in_world)
        return pbrt_fail(p, STATUS_ERR_INPUT, at, "WorldBegin occurs twice");
    if (!p->film.params)
        pbrt_warn(p, at, "no film", "there is no Film before WorldBegin: the file is taken as pbrt-v4's (a Film \"image\" makes it pbrt-v3's)");
    TRY(pbrt_camera(p));
    p->in_world = 1;
    p->now.active = 3;
    pbrt_identity(p);
    pbrt_keep_system(p, "world", &p->now.ctm);
    return STATUS_OK;
}

static status do_world_end(struct pbrt *p UNUSED, const struct pbrt_place *at UNUSED) { return STATUS_OK; }

const struct pbrt_word pbrt_preamble_words[] = {
    {"Camera", do_camera},
    {"Film", do_film},
    {"Sampler", do_sampler},
    {"Integrator", do_integrator},
    {"SurfaceIntegrator", do_integrator},
    {"PixelFilter", do_filter},
    {"Accelerator", do_accelerator},
    {"Option", do_option},
    {"WorldBegin", do_world},
    {"WorldEnd", do_world_end},
    {NULL, NULL},
};
