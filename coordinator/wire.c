#include "coordinator/wire.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "protocol/message.h"

enum { EXPOSURE_EV_MAX = 100 };

void wire_output_set(struct wire_output *out, const struct output_settings *in)
{
    static char exr[] = "exr", png[] = "png";
    Azulejo__Wire__OutputSettings message = AZULEJO__WIRE__OUTPUT_SETTINGS__INIT;
    const struct tonemap_operator *op = in->tonemap.op;

    out->message = message;
    out->message.exr_half = in->exr_half;
    out->message.tonemap = (char *)op->name;
    out->message.exposure_ev = in->tonemap.exposure_ev;
    for (size_t i = 0; i < op->parameter_count; i++) {
        Azulejo__Wire__OutputSettings__ParametersEntry entry =
            AZULEJO__WIRE__OUTPUT_SETTINGS__PARAMETERS_ENTRY__INIT;
        entry.key = (char *)op->parameters[i].name;
        entry.value = in->tonemap.values[i];
        out->entries[i] = entry;
        out->entry_pointers[i] = &out->entries[i];
    }
    out->message.n_parameters = op->parameter_count;
    out->message.parameters = out->entry_pointers;
    if (in->exr)
        out->formats[out->message.n_formats++] = exr;
    if (in->png)
        out->formats[out->message.n_formats++] = png;
    out->message.formats = out->formats;
}

static status output_get(struct output_settings *out, const Azulejo__Wire__OutputSettings *in,
                         struct error *err)
{
    static const Azulejo__Wire__OutputSettings none = AZULEJO__WIRE__OUTPUT_SETTINGS__INIT;
    size_t count;
    const struct tonemap_operator *const *first = tonemap_operators(&count);
    char text[64];
    status s;

    memset(out, 0, sizeof *out);
    if (!in)
        in = &none;
    s = tonemap_settings_init(&out->tonemap, in->tonemap[0] ? in->tonemap : first[0]->name, err);
    if (s != STATUS_OK)
        return s;
    for (size_t i = 0; i < in->n_parameters; i++) {
        s = tonemap_settings_set(&out->tonemap, in->parameters[i]->key, in->parameters[i]->value,
                                 err);
        if (s != STATUS_OK)
            return s;
    }
    if (!isfinite(in->exposure_ev) || fabs(in->exposure_ev) > EXPOSURE_EV_MAX)
        return error_set(err, STATUS_ERR_INPUT, "exposure must be -%d..%d EV", EXPOSURE_EV_MAX,
                         EXPOSURE_EV_MAX);
    out->tonemap.exposure_ev = in->exposure_ev;
    out->exr_half = in->exr_half;
    for (size_t i = 0; i < in->n_formats; i++) {
        if (strcmp(in->formats[i], "exr") == 0)
            out->exr = 1;
        else if (strcmp(in->formats[i], "png") == 0)
            out->png = 1;
        else
            return error_set(err, STATUS_ERR_INPUT, "output format '%s': must be exr or png",
                             message_text(text, sizeof text, in->formats[i]));
    }
    if (in->n_formats == 0)
        out->exr = out->png = 1;
    return STATUS_OK;
}

status wire_job_get(struct job **out, const Azulejo__Wire__JobSubmit *in, uint32_t camera_count,
                    struct error *err)
{
    struct render_settings settings;
    struct output_settings output;
    struct digest scene;
    struct job *job;
    uint64_t total, frames;
    status s;

    *out = NULL;
    s = wire_digest_get(&scene, &in->scene, "the scene", err);
    if (s != STATUS_OK)
        return s;
    if (!in->settings)
        return error_set(err, STATUS_ERR_PROTOCOL, "a job without render settings");
    s = wire_settings_get(&settings, in->settings, camera_count, err);
    if (s == STATUS_OK)
        s = output_get(&output, in->output, err);
    if (s != STATUS_OK)
        return s;
    if (strlen(in->name) > JOB_NAME_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "a job's name has at most %d bytes", JOB_NAME_MAX);
    if (in->last_frame < in->first_frame ||
        in->last_frame - in->first_frame >= SETTINGS_FRAMES_MAX)
        return error_set(err, STATUS_ERR_INPUT,
                         "frames %u to %u: the last must not come before the first, and at most %d "
                         "are rendered by one job",
                         in->first_frame, in->last_frame, SETTINGS_FRAMES_MAX);
    frames = (uint64_t)in->last_frame - in->first_frame + 1;
    if (__builtin_mul_overflow((uint64_t)settings.width * settings.height * settings.spp, frames,
                               &total) ||
        total > INT64_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "the job has more samples than can be counted");
    job = job_new(in->first_frame, in->last_frame);
    if (!job)
        return error_no_memory(err, "a job");
    message_text(job->name, sizeof job->name, in->name);
    job->priority = in->priority;
    job->settings = settings;
    job->output = output;
    job->scene = scene;
    *out = job;
    return STATUS_OK;
}

status wire_job_pack(const struct job *job, struct buffer *out, struct error *err)
{
    Azulejo__Wire__JobSubmit message = AZULEJO__WIRE__JOB_SUBMIT__INIT;
    Azulejo__Wire__RenderSettings settings = AZULEJO__WIRE__RENDER_SETTINGS__INIT;
    struct wire_output output;
    uint8_t *space;

    wire_output_set(&output, &job->output);
    wire_settings_set(&settings, &job->settings);
    wire_digest_set(&message.scene, &job->scene);
    message.name = (char *)job->name;
    message.settings = &settings;
    message.output = &output.message;
    message.first_frame = job->first_frame;
    message.last_frame = job->last_frame;
    message.priority = job->priority;
    space = buffer_append_space(out, azulejo__wire__job_submit__get_packed_size(&message));
    if (!space)
        return error_no_memory(err, "a job");
    azulejo__wire__job_submit__pack(&message, space);
    return STATUS_OK;
}

status wire_job_unpack(struct job **out, const void *data, size_t size_bytes, struct error *err)
{
    Azulejo__Wire__JobSubmit *message;
    status s;

    *out = NULL;
    message = data ? azulejo__wire__job_submit__unpack(NULL, size_bytes, data) : NULL;
    if (!message)
        return error_set(err, STATUS_ERR_CORRUPT, "the job's description is damaged");
    s = wire_job_get(out, message, UINT32_MAX, err);
    azulejo__wire__job_submit__free_unpacked(message, NULL);
    return s;
}
