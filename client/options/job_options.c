#include "client/options/job_options.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "client/terminal/parse.h"
#include "client/options/schedule_option.h"
#include "common/base/buffer.h"
#include "common/scene/pose.h"
#include "protocol/message.h"

/* With a target: 4 or 8 samples a pixel do not show yet how the error will fall (docs/ACCURACY.md). */

static status rules_check(const struct job_options *o, struct job_request *out, struct error *err)
{
    uint32_t spp;

    TRY(stop_options_check(&o->stop, &out->stop, &spp, err));
    out->spp_given = spp > 0;
    if (spp > 0)
        out->settings.spp = spp;
    if (out->stop.spp_min > 0 && !out->stop.has_target)
        return error_set(err, STATUS_ERR_USAGE,
                         "--min-spp: only --target-error can end a frame earlier: give both, or "
                         "--spp");
    if (spp > 0 && out->stop.spp_min > spp)
        return error_set(err, STATUS_ERR_USAGE, "--min-spp %u is more than --spp %u", out->stop.spp_min, spp);
    if (out->stop.has_target && out->stop.spp_min == 0)
        out->stop.spp_min = spp > 0 && spp < SPP_MIN_DEFAULT ? spp : SPP_MIN_DEFAULT;
    return STATUS_OK;
}

static status frames_check(const struct frame_choice *choice, struct job_request *out, struct error *err)
{
    struct frame_list *list = &out->frames;

    if (!choice->list && choice->first_middle_last)
        return error_set(err, STATUS_ERR_USAGE, "--first-middle-last: of which frames? Give --frames too, as in 1-48");
    if (!choice->list)
        return STATUS_OK;
    TRY(frame_list_parse(choice->list, list, err));
    if (choice->first_middle_last)
        frame_list_ends(list);
    out->first_frame = list->items[0];
    out->last_frame = list->items[list->count - 1];
    if (out->last_frame - out->first_frame >= SETTINGS_FRAMES_MAX)
        return error_set(err, STATUS_ERR_USAGE,
                         "--frames: %s: the first and the last are more than %d frames apart; submit "
                         "several jobs",
                         choice->list, SETTINGS_FRAMES_MAX);
    if (list->count == (size_t)(out->last_frame - out->first_frame) + 1)
        frame_list_free(list); /* all of them */
    return STATUS_OK;
}

status job_request_one_range(const struct job_request *request, struct error *err)
{
    if (request->frames.count == 0)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_USAGE, "--frames: this command takes one range without gaps, as in 1-48");
}

status job_options_check(const struct job_options *o, struct job_request *out, struct error *err)
{
    struct render_settings *s = &out->settings;
    status result;

    memset(out, 0, sizeof *out);
    render_settings_default(s);
    result = settings_said(render_settings_rows, SETTING_COUNT, o->said, s, err);
    out->first_frame = out->last_frame = 1;
    out->priority = (int32_t)o->priority;
    if (result == STATUS_OK && o->size)
        result = parse_size("--size", o->size, &s->width, &s->height, err);
    if (result == STATUS_OK && o->fit)
        result = parse_size("--fit", o->fit, &out->fit_width, &out->fit_height, err);
    if (result == STATUS_OK && o->region)
        result = parse_region(o->region, &out->region, err);
    THEN(result, frames_check(&o->frames, out, err));
    if (o->alpha)
        s->aovs |= 1u << AOV_ALPHA;
    THEN(result, rules_check(o, out, err));
    THEN(result, schedule_option_read(out, o, err));
    THEN(result, output_options_check(&o->output, &out->output, err));
    out->output.half = o->half;
    return result;
}

/* What is rendered fits then; where that is a region, the whole picture is shrunk by as much. */
static void shrink(struct job_request *request)
{
    struct render_settings *s = &request->settings;
    struct tile_rect *r = &request->region;
    const uint32_t width = r->width ? r->width : s->width, height = r->width ? r->height : s->height;
    const double share = fmin(request->fit_width / (double)width, request->fit_height / (double)height);

    if (request->fit_width == 0 || share >= 1)
        return;
    s->width = (uint32_t)fmax(round(s->width * share), 1);
    s->height = (uint32_t)fmax(round(s->height * share), 1);
    if (r->width == 0)
        return;
    r->width = (uint32_t)fmax(round(r->width * share), 1);
    r->height = (uint32_t)fmax(round(r->height * share), 1);
    r->x = (uint32_t)fmin(round(r->x * share), s->width - r->width);
    r->y = (uint32_t)fmin(round(r->y * share), s->height - r->height);
}

status job_request_crop(struct job_request *request, struct error *err)
{
    struct render_settings *s = &request->settings;
    const struct tile_rect *r = &request->region;

    if (r->width == 0) {
        shrink(request);
        return STATUS_OK;
    }
    if (r->x >= s->width || r->width > s->width - r->x || r->y >= s->height || r->height > s->height - r->y)
        return error_set(err, STATUS_ERR_USAGE,
                         "--region %u,%u,%u,%u: is not inside the picture of %ux%u pixels (--size)", r->x, r->y,
                         r->width, r->height, s->width, s->height);
    shrink(request);
    if (r->width == s->width && r->height == s->height)
        return STATUS_OK; /* all of it */
    s->whole_width = s->width;
    s->whole_height = s->height;
    s->region_x = r->x;
    s->region_y = r->y;
    s->width = r->width;
    s->height = r->height;
    return STATUS_OK;
}

void job_request_release(struct job_request *request)
{
    frame_list_free(&request->frames);
    output_request_release(&request->output);
    buffer_release(&request->schedule);
    buffer_release(&request->source);
}

static status camera_find(const struct scene *scene, const char *name, uint32_t *camera, struct error *err)
{
    struct buffer names = BUFFER_INIT;
    unsigned long number;
    char *end;

    *camera = 0;
    if (!name)
        return STATUS_OK;
    for (uint32_t i = 0; i < scene->camera_count; i++) {
        if (scene->cameras[i].name && strcmp(scene->cameras[i].name, name) == 0) {
            *camera = i;
            return STATUS_OK;
        }
    }
    number = strtoul(name, &end, 10);
    if (name[0] >= '0' && name[0] <= '9' && *end == 0 && number < scene->camera_count) {
        *camera = (uint32_t)number;
        return STATUS_OK;
    }
    for (uint32_t i = 0; i < scene->camera_count && names.size < 600; i++)
        buffer_printf(&names, "%s%u '%s'", i ? ", " : "", i, scene->cameras[i].name ? scene->cameras[i].name : "");
    error_set(err, STATUS_ERR_USAGE, "--camera: the scene has no camera '%s'; it has %s", name, buffer_text(&names));
    buffer_release(&names);
    return STATUS_ERR_USAGE;
}

/* Options that have no effect with this camera. */
static status lens_check(const struct render_settings *s, const struct scene_camera *camera, struct error *err)
{
    if (s->lens_radius > 0 && camera->kind == CAMERA_PANORAMA)
        return error_set(err, STATUS_ERR_USAGE, "--lens: a panorama camera has no lens: choose another --camera");
    if (s->lens_radius > 0 && s->focus_distance == 0 && camera->focus_distance == 0)
        return error_set(err, STATUS_ERR_USAGE, "--lens: the camera has no focus distance: give --focus METRES too");
    return STATUS_OK;
}

status job_request_complete(struct job_request *request, const struct job_options *o, const struct scene *scene,
                            struct error *err)
{
    struct render_settings *s = &request->settings;
    const struct scene_camera *camera;
    status result;

    TRY(camera_find(scene, o->camera, &s->camera, err));
    camera = &scene->cameras[s->camera];
    if (!o->size)
        picture_size_default(camera->aspect, &s->width, &s->height);
    if (!o->frames.list && scene_is_animated(scene, s))
        request->first_frame = request->last_frame = 0;
    request->output.camera_ev = (double)camera->exposure_ev;
    request->output.tonemap.exposure_ev += request->output.camera_ev;
    result = lens_check(s, camera, err);
    return result == STATUS_OK ? render_settings_validate(s, scene->camera_count, err) : result;
}

status job_request_submit(struct connection *c, const struct job_request *request, const char *name,
                          const struct digest *scene, unsigned formats, struct job_accepted *out, struct error *err)
{
    Azulejo__Wire__Envelope envelope = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__JobSubmit submit = AZULEJO__WIRE__JOB_SUBMIT__INIT;
    Azulejo__Wire__RenderSettings settings = AZULEJO__WIRE__RENDER_SETTINGS__INIT;
    Azulejo__Wire__StopRules stop;
    struct wire_output output;
    Azulejo__Wire__Envelope *answer = NULL;

    wire_settings_set(&settings, &request->settings);
    output_message_set(&output, &request->output, formats);
    submit.name = (char *)name;
    wire_digest_set(&submit.scene, scene);
    submit.settings = &settings;
    submit.output = &output.message;
    submit.first_frame = request->first_frame;
    submit.last_frame = request->last_frame;
    wire_stop_set(&stop, &request->stop);
    submit.stop = &stop;
    submit.schedule = (ProtobufCBinaryData){request->schedule.size, request->schedule.data};
    submit.frames = request->frames.items;
    submit.n_frames = request->frames.count;
    submit.estimate = (uint32_t)request->estimate;
    submit.priority = request->priority;
    submit.force = request->force;
    submit.token = (char *)request->token;
    submit.source = (char *)buffer_text(&request->source);
    submit.owner = (char *)(request->owner ? request->owner : "");
    wire_needs_set(&submit, &request->needs);
    envelope.body_case = AZULEJO__WIRE__ENVELOPE__BODY_JOB_SUBMIT;
    envelope.job_submit = &submit;
    TRY(connection_ask(c, &envelope, AZULEJO__WIRE__ENVELOPE__BODY_JOB_ACCEPTED, &answer, err));
    *out = (struct job_accepted){answer->job_accepted->job, answer->job_accepted->estimate_spp};
    message_free(answer);
    return STATUS_OK;
}
