#include "coordinator/job/wire.h"

#include <string.h>

#include "common/base/memory.h"
#include "protocol/message.h"

static status output_pack(const struct output_settings *in, struct buffer *out, struct error *err)
{
    struct wire_output output;
    uint8_t *space;

    wire_output_set(&output, in);
    space = buffer_append_space(out, azulejo__wire__output_settings__get_packed_size(&output.message));
    NEED(space, err, "output settings");
    azulejo__wire__output_settings__pack(&output.message, space);
    return STATUS_OK;
}

status wire_tonemap_pack(const struct tonemap_settings *in, struct buffer *out, struct error *err)
{
    const struct output_settings output = {.tonemap = *in};

    return output_pack(&output, out, err);
}

status wire_tonemap_unpack(struct tonemap_settings *out, const void *data, size_t size_bytes, struct error *err)
{
    Azulejo__Wire__OutputSettings *message = azulejo__wire__output_settings__unpack(NULL, size_bytes, data);
    struct output_settings output;
    status s = message ? wire_output_get(&output, message, err) : STATUS_ERR_CORRUPT;

    if (s == STATUS_OK)
        *out = output.tonemap;
    else if (!message || !status_is_environment(s))
        s = error_set(err, STATUS_ERR_CORRUPT, "the settings are damaged");
    if (message)
        azulejo__wire__output_settings__free_unpacked(message, NULL);
    return s;
}

status wire_output_digest(struct digest *out, const struct output_settings *in, struct error *err)
{
    struct output_settings looks = *in;
    struct buffer packed = BUFFER_INIT;
    status s;

    looks.exr = looks.png = looks.jpg = looks.exr_half = 0;
    memset(&looks.picture, 0, sizeof looks.picture);
    looks.tonemap.file_name[0] = 0;
    looks.camera_ev = 0;
    s = output_pack(&looks, &packed, err);
    if (s == STATUS_OK && digest_of(out, packed.data, packed.size) != STATUS_OK)
        s = error_no_memory(err, "a digest");
    buffer_release(&packed);
    return s;
}

/* Only existing passes, and at least one for each tile. */
static status check_schedule(const Azulejo__Wire__JobSubmit *in, const struct render_settings *settings,
                             struct error *err)
{
    uint32_t tiles = tile_count(settings->width, settings->height);

    if (in->schedule.len == 0)
        return STATUS_OK;
    if (in->schedule.len != (size_t)tiles * GROUPS || in->first_frame != in->last_frame)
        return error_set(err, STATUS_ERR_INPUT,
                         "a schedule of %zu tiles for %u frames of %u tiles: a schedule is for one frame, and for a picture of the same size",
                         in->schedule.len / GROUPS, in->last_frame - in->first_frame + 1, tiles);
    for (uint32_t t = 0; t < tiles; t++)
        for (uint32_t g = 0; g < GROUPS; g++)
            if (in->schedule.data[t * GROUPS + g] > pass_count(settings->spp, g))
                return error_set(err, STATUS_ERR_INPUT,
                                 "a schedule of %u passes of tile %u, group %u: %u samples a pixel "
                                 "have %u",
                                 in->schedule.data[t * GROUPS + g], t, g, settings->spp, pass_count(settings->spp, g));
    return STATUS_OK;
}

/* The frames to render, and why only these. */
static status get_frames(struct job *job, const Azulejo__Wire__JobSubmit *in, struct error *err)
{
    uint64_t at = job->first_frame;

    if (in->estimate > ESTIMATE_CONTINUED)
        return error_set(err, STATUS_ERR_INPUT, "an unknown kind of estimate, %u", in->estimate);
    job->estimate = (enum job_estimate)in->estimate;
    for (size_t i = 0; i < in->n_frames; i++) {
        if (in->frames[i] < at || in->frames[i] > job->last_frame)
            return error_set(err, STATUS_ERR_INPUT, "frame %u: the frames to render must ascend from %u to %u at most",
                             in->frames[i], job->first_frame, job->last_frame);
        while (at < in->frames[i])
            job_frame_rest(job, (uint32_t)at++);
        at++;
    }
    while (in->n_frames > 0 && at <= job->last_frame)
        job_frame_rest(job, (uint32_t)at++);
    return STATUS_OK;
}

status wire_job_get(struct job **out, const Azulejo__Wire__JobSubmit *in, uint32_t camera_count, struct error *err)
{
    struct render_settings settings;
    struct stop_rules stop;
    struct output_settings output;
    struct digest scene;
    char token[JOB_TOKEN_MAX + 1];
    struct job *job;
    uint64_t total, frames;
    status s;

    *out = NULL;
    TRY(wire_digest_get(&scene, &in->scene, "the scene", err));
    if (!in->settings)
        return error_set(err, STATUS_ERR_PROTOCOL, "a job without render settings");
    s = wire_settings_get(&settings, in->settings, camera_count, err);
    THEN(s, wire_output_get(&output, in->output, err));
    if (s != STATUS_OK)
        return s;
    if (strlen(in->name) > JOB_NAME_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "a job's name has at most %d bytes", JOB_NAME_MAX);
    if (strlen(in->token) > JOB_TOKEN_MAX || strcmp(message_text(token, sizeof token, in->token), in->token) != 0)
        return error_set(err, STATUS_ERR_INPUT, "a submission's token has at most %d bytes, all printable",
                         JOB_TOKEN_MAX);
    if (in->last_frame < in->first_frame || in->last_frame - in->first_frame >= SETTINGS_FRAMES_MAX)
        return error_set(err, STATUS_ERR_INPUT,
                         "frames %u to %u: the last must not come before the first, and at most %d "
                         "are rendered by one job",
                         in->first_frame, in->last_frame, SETTINGS_FRAMES_MAX);
    frames = (uint64_t)in->last_frame - in->first_frame + 1;
    if (__builtin_mul_overflow((uint64_t)settings.width * settings.height * settings.spp, frames, &total) ||
        total > INT64_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "the job has more samples than can be counted");
    s = wire_stop_get(&stop, in->stop, err);
    THEN(s, check_schedule(in, &settings, err));
    if (s != STATUS_OK)
        return s;
    job = job_new(in->first_frame, in->last_frame);
    NEED(job, err, "a job");
    buffer_append(&job->schedule, in->schedule.data, in->schedule.len);
    if (!buffer_ok(&job->schedule)) {
        job_free(job);
        return error_no_memory(err, "a schedule");
    }
    job->stop = stop;
    message_text(job->name, sizeof job->name, in->name);
    memcpy(job->token, token, sizeof job->token);
    if (strlen(in->source) <= JOB_SOURCE_MAX)
        message_text(job->source, sizeof job->source, in->source);
    job->priority = in->priority;
    message_text(job->owner, sizeof job->owner, in->owner);
    job->settings = settings;
    job->output = output;
    job->scene = scene;
    s = get_frames(job, in, err);
    if (s == STATUS_OK)
        s = wire_needs_get(&job->needs, in, err); /* the jobs that it waits for are checked elsewhere */
    if (s != STATUS_OK) {
        job_free(job);
        return s;
    }
    *out = job;
    return STATUS_OK;
}

status wire_job_pack(const struct job *job, struct buffer *out, struct error *err)
{
    Azulejo__Wire__JobSubmit message = AZULEJO__WIRE__JOB_SUBMIT__INIT;
    Azulejo__Wire__RenderSettings settings = AZULEJO__WIRE__RENDER_SETTINGS__INIT;
    Azulejo__Wire__StopRules stop;
    struct wire_output output;
    uint32_t *frames = NULL;
    uint8_t *space;

    if (job->frames_resting_count > 0) {
        frames = mem_alloc_array(job_frames_wanted(job), sizeof *frames);
        NEED(frames, err, "a job");
        for (uint64_t at = job->first_frame; at <= job->last_frame; at++)
            if (!job_frame_is_resting(job, (uint32_t)at))
                frames[message.n_frames++] = (uint32_t)at;
    }
    message.frames = frames;
    message.estimate = (uint32_t)job->estimate;
    wire_output_set(&output, &job->output);
    wire_settings_set(&settings, &job->settings);
    wire_digest_set(&message.scene, &job->scene);
    wire_stop_set(&stop, &job->stop);
    message.stop = &stop;
    message.schedule = (ProtobufCBinaryData){job->schedule.size, job->schedule.data};
    message.name = (char *)job->name;
    message.settings = &settings;
    message.output = &output.message;
    message.first_frame = job->first_frame;
    message.last_frame = job->last_frame;
    message.priority = job->priority;
    message.token = (char *)job->token;
    message.source = (char *)job->source;
    wire_needs_set(&message, &job->needs);
    space = buffer_append_space(out, azulejo__wire__job_submit__get_packed_size(&message));
    if (space)
        azulejo__wire__job_submit__pack(&message, space);
    mem_free(frames);
    return space ? STATUS_OK : error_no_memory(err, "a job");
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

static status same_packed(const struct job *a, const struct job *b, int *same, struct error *err)
{
    struct buffer left = BUFFER_INIT, right = BUFFER_INIT;
    status s = wire_job_pack(a, &left, err);

    THEN(s, wire_job_pack(b, &right, err));
    *same = s == STATUS_OK && left.size == right.size && memcmp(left.data, right.data, left.size) == 0;
    buffer_release(&right);
    buffer_release(&left);
    return s;
}

status wire_job_estimated(const struct job *estimate, const struct job *job, int *same, struct error *err)
{
    struct job other = *job; /* packed, never kept */

    other.settings.spp = estimate->settings.spp;
    other.stop = estimate->stop;
    other.output = estimate->output;
    other.priority = estimate->priority;
    other.needs = estimate->needs;
    other.estimate = estimate->estimate;
    other.frames_resting = estimate->frames_resting;
    other.frames_resting_count = estimate->frames_resting_count;
    memcpy(other.name, estimate->name, sizeof other.name);
    memcpy(other.token, estimate->token, sizeof other.token);
    memcpy(other.source, estimate->source, sizeof other.source);
    *same = 0;
    if (job->first_frame != estimate->first_frame || job->last_frame != estimate->last_frame ||
        job->settings.spp < estimate->settings.spp)
        return STATUS_OK;
    return same_packed(estimate, &other, same, err);
}

status wire_job_same(const struct job *a, const struct job *b, int *same, struct error *err)
{
    struct job other = *b; /* packed, never kept */

    other.output = a->output;
    other.priority = a->priority;
    other.needs = a->needs;
    memcpy(other.source, a->source, sizeof other.source);
    return same_packed(a, &other, same, err);
}

static void wire_figures_set(Azulejo__Wire__Figures *out, const struct accuracy_figures *f)
{
    azulejo__wire__figures__init(out);
    out->display = f->display_error;
    out->display_low = f->display_lo;
    out->display_high = f->display_hi;
    out->psnr_db = f->psnr_db;
    out->psnr_low = f->psnr_lo;
    out->psnr_high = f->psnr_hi;
    out->rmse_percent = f->rmse_percent;
    out->rmse_low = f->rmse_lo;
    out->rmse_high = f->rmse_hi;
    out->top_share = f->top_share;
    out->disagreement = f->disagreement;
    out->unseen = f->unseen;
    out->tail_index = f->tail_index;
    out->reliable = f->reliable;
    out->reasons = f->reasons;
    out->lone = f->lone;
    out->dark = f->dark;
    out->display_all = f->display_all;
    out->worst_part = f->worst_part;
    out->fireflies = f->fireflies;
    out->subject = f->subject;
}

void wire_point_set(struct wire_point *out, const struct history_point *point)
{
    Azulejo__Wire__HistoryPoint *m = &out->message;

    azulejo__wire__history_point__init(m);
    m->core_seconds = point->core_s;
    m->wall_seconds = point->wall_s;
    m->samples = point->samples;
    m->rays = point->rays;
    m->uneven = point->uneven;
    if (point->figures.known) {
        wire_figures_set(&out->figures, &point->figures);
        m->figures = &out->figures;
    }
    if (point->denoised.known) {
        wire_figures_set(&out->denoised, &point->denoised);
        m->denoised = &out->denoised;
    }
}
