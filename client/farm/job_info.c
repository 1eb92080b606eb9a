#include "client/farm/job_info.h"

#include <inttypes.h>
#include <string.h>

#include "client/farm/cut_frame.h"
#include "client/farm/figures_view.h"
#include "client/terminal/format.h"
#include "client/terminal/moment.h"
#include "client/farm/output.h"
#include "common/base/clock.h"
#include "common/base/digest.h"
#include "common/scene/settings.h"
#include "protocol/message.h"

const char *job_info_note(char out[JOB_NOTE_SIZE], const Azulejo__Wire__JobInfo *job)
{
    char when[FORMAT_SIZE], comment[JOB_NOTE_SIZE / 2];
    size_t used;

    if (job->waits_until)
        snprintf(out, JOB_NOTE_SIZE, "waits until %s", moment_text(when, job->waits_until, clock_wall_s()));
    else
        message_text(out, JOB_NOTE_SIZE, job->state_text);
    used = strlen(out);
    if (job->comment[0])
        snprintf(out + used, JOB_NOTE_SIZE - used, "%scomment: %s", used ? "; " : "",
                 message_text(comment, sizeof comment, job->comment));
    return out;
}

const Azulejo__Wire__JobInfo *job_list_find(const Azulejo__Wire__JobList *list, uint64_t job)
{
    for (size_t i = 0; i < list->n_jobs; i++)
        if (list->jobs[i]->job == job)
            return list->jobs[i];
    return NULL;
}

status job_ask(struct connection *c, Azulejo__Wire__Envelope *question, uint64_t job,
               Azulejo__Wire__Envelope **out, struct error *err)
{
    status result = connection_ask(c, question, AZULEJO__WIRE__ENVELOPE__BODY_JOB_LIST, out, err);

    if (result == STATUS_OK && job && !job_list_find((*out)->job_list, job)) {
        message_free(*out);
        *out = NULL;
        result = error_set(err, STATUS_ERR_NOT_FOUND,
                           "there is no job %" PRIu64 " ('azulejo list' shows which there are)",
                           job);
    }
    return result;
}

status job_query(struct connection *c, uint64_t job, Azulejo__Wire__Envelope **out,
                 struct error *err)
{
    Azulejo__Wire__Envelope envelope = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__JobQuery query = AZULEJO__WIRE__JOB_QUERY__INIT;

    query.job = job;
    envelope.body_case = AZULEJO__WIRE__ENVELOPE__BODY_JOB_QUERY;
    envelope.job_query = &query;
    return job_ask(c, &envelope, job, out, err);
}

status frame_choice_of_job(struct connection *c, uint64_t job, const struct frame_choice *choice,
                           struct frame_list *out, struct error *err)
{
    Azulejo__Wire__Envelope *answer = NULL;
    const Azulejo__Wire__JobInfo *info;
    status result;

    *out = (struct frame_list){0};
    if (!choice->list && !choice->first_middle_last)
        return STATUS_OK;
    result = job_query(c, job, &answer, err);
    if (result != STATUS_OK)
        return result;
    info = job_list_find(answer->job_list, job);
    result = frame_choice_of(choice, info->first_frame, info->last_frame, out, err);
    message_free(answer);
    return result;
}

json_t *json_names(const char *names)
{
    json_t *out = json_array();

    while (*names) {
        size_t length = strcspn(names, ",");
        json_array_append_new(out, json_stringn(names, length));
        names += length + (names[length] == ',');
    }
    return out;
}

static json_t *settings_json(const Azulejo__Wire__RenderSettings *s)
{
    char names[SETTINGS_TEXT_SIZE];
    json_t *region = s->whole_width
                         ? json_pack("[I, I, I, I]", (json_int_t)s->region_x, (json_int_t)s->region_y,
                                     (json_int_t)s->width, (json_int_t)s->height)
                         : json_null();
    json_t *out = json_pack(
        "{s:I, s:I, s:o, s:I, s:I, s:I, s:I, s:o, s:o, s:s, s:s}", "width", 
        (json_int_t)(s->whole_width ? s->whole_width : s->width), "height",
        (json_int_t)(s->whole_height ? s->whole_height : s->height), "region", region, "spp", (json_int_t)s->spp, "max_depth",
        (json_int_t)s->max_depth, "seed", (json_int_t)s->seed, "camera", (json_int_t)s->camera,
        "env_rotate_deg", json_number_float(s->env_rotate_deg), "env_strength",
        json_number_float(s->env_strength), "env_sampling",
        env_sampling_name((enum env_sampling)s->env_sampling), "isa", isa_name((enum isa)s->isa));

    if (!out)
        return NULL;
    json_object_set_new(out, "fps", json_number_float(s->fps));
    json_object_set_new(out, "shutter", json_number_float(s->shutter));
    /* null: the camera's own */
    json_object_set_new(out, "lens_radius", s->lens_radius > 0 || s->pinhole
                                                ? json_number_float(s->lens_radius)
                                                : json_null());
    json_object_set_new(out, "focus_distance", s->focus_distance > 0
                                                   ? json_number_float(s->focus_distance)
                                                   : json_null());
    json_object_set_new(out, "without", json_names(settings_effects_text(s->without, names)));
    json_object_set_new(out, "sampler", json_string(sampler_name((enum sampler_kind)s->sampler)));
    json_object_set_new(out, "light_choice",
                        json_string(light_choice_name((enum light_choice)s->light_choice)));
    json_object_set_new(out, "roulette", json_boolean(!s->no_roulette));
    json_object_set_new(out, "texture_filter",
                        json_string(texture_filter_name((enum texture_filter)s->texture_filter)));
    json_object_set_new(out, "bvh_quality",
                        json_string(bvh_quality_name((enum bvh_quality)s->bvh_quality)));
    json_object_set_new(out, "robust", json_boolean(!s->not_robust));
    /* null: no sample is scaled down */
    json_object_set_new(out, "clamp", s->clamp > 0 ? json_number_float(s->clamp) : json_null());
    json_object_set_new(out, "aovs", json_names(settings_aovs_text(s->aovs, names)));
    return out;
}

json_t *job_parameter_json(const char *operator_name, const char *name, double value)
{
    const struct tonemap_operator *op = tonemap_find(operator_name);

    for (size_t i = 0; op && i < op->parameter_count; i++) {
        const struct tonemap_parameter *p = &op->parameters[i];

        if (strcmp(p->name, name) == 0 && p->kind == TONEMAP_CHOICE && value >= p->min &&
            value <= p->max)
            return json_string(p->choices[(size_t)value]);
    }
    return json_number(value);
}

static json_t *file_json(const Azulejo__Wire__OutputSettings *o)
{
    struct digest digest;
    char hex[DIGEST_HEX_SIZE];

    if (o->tonemap_file.len != DIGEST_BYTES)
        return json_null();
    memcpy(digest.bytes, o->tonemap_file.data, DIGEST_BYTES);
    digest_to_hex(&digest, hex);
    return json_pack("{s:o, s:s}", "name", json_text(o->tonemap_file_name), "digest", hex);
}

static json_t *output_json(const Azulejo__Wire__OutputSettings *o)
{
    json_t *parameters = json_object();
    json_t *formats = json_array();
    json_t *out;

    for (size_t i = 0; i < o->n_parameters; i++)
        json_object_set_new(parameters, o->parameters[i]->key,
                            job_parameter_json(o->tonemap, o->parameters[i]->key,
                                               o->parameters[i]->value));
    for (size_t i = 0; i < o->n_formats; i++)
        json_array_append_new(formats, json_text(o->formats[i]));
    out = json_pack("{s:b, s:o, s:o, s:o, s:o}", "exr_half", (int)o->exr_half, "tonemap",
                    json_text(o->tonemap), "parameters", parameters, "exposure_ev",
                    json_number(o->exposure_ev), "formats", formats);
    if (!out)
        return NULL;
    json_object_set_new(out, "camera_ev", json_number(o->camera_ev));
    json_object_set_new(out, "auto_exposure", json_text(o->metering[0] ? o->metering : "off"));
    json_object_set_new(out, "percentile", json_number(output_percentile(o)));
    /* null: colours as they are; no file */
    json_object_set_new(out, "white_balance", o->white_kelvin > 0 ? json_number(o->white_kelvin)
                                                                  : json_null());
    json_object_set_new(out, "temporal", json_integer(o->temporal ? o->temporal : 1));
    json_object_set_new(out, "lut", file_json(o));
    json_object_set_new(out, "png_bits", json_integer(o->png_bits ? o->png_bits : 8));
    json_object_set_new(out, "jpeg_quality",
                        json_integer(o->jpeg_quality ? o->jpeg_quality : JPEG_QUALITY_DEFAULT));
    json_object_set_new(out, "dither", json_boolean(!o->no_dither));
    return out;
}

/* The share of the light that clamping removed. */
static double clamped_share(const Azulejo__Wire__Work *w)
{
    double all = w->clamped_luminance + w->kept_luminance;

    return all > 0 ? w->clamped_luminance / all : 0;
}

static json_t *stats_json(const Azulejo__Wire__Work *w, const struct health *health,
                          const Azulejo__Wire__RenderStats *s)
{
    json_t *out = json_pack("{s:I, s:I, s:I, s:I, s:f, s:f, s:I, s:f}", "samples",
                            (json_int_t)w->samples, "rays", (json_int_t)w->rays, "vertices",
                            (json_int_t)w->vertices, "leaked_rays", (json_int_t)w->leaked_rays,
                            "cpu_seconds", (double)s->cpu_ns / 1e9, "trace_seconds",
                            (double)s->trace_ns / 1e9, "clamped_samples",
                            (json_int_t)w->clamped_samples, "clamped_share", clamped_share(w));

    for (int k = 0; k < HEALTH_KINDS; k++)
        json_object_set_new(out, health_rows[k].name, json_integer((json_int_t)health->count[k]));
    return out;
}

/* ---- health ---------------------------------------------------------------------------------- */

/* What went wrong with samples; nothing is known of counters that do not fit. */
static struct health job_health(const Azulejo__Wire__JobInfo *job)
{
    struct unit_work work;
    struct error unused;

    if (wire_work_get(&work, job->work, &unused) != STATUS_OK)
        memset(&work.health, 0, sizeof work.health);
    return work.health;
}

/* Where the job's pixels are in the whole picture. */
static struct tile_rect job_rect(const Azulejo__Wire__JobInfo *job)
{
    const Azulejo__Wire__RenderSettings *s = job->settings;

    return s ? (struct tile_rect){s->region_x, s->region_y, s->width, s->height}
             : (struct tile_rect){0, 0, 0, 0};
}

static json_t *first_json(const Azulejo__Wire__JobInfo *job, uint64_t key, uint32_t frame)
{
    struct tile_rect picture = job_rect(job);
    struct health_place p;
    struct tile_rect rect;

    if (!health_place_of(key, &p) || p.tile >= tile_count(picture.width, picture.height))
        return json_null();
    rect = tile_rect_of(picture.width, picture.height, p.tile);
    return json_pack("{s:I, s:I, s:I, s:[I, I], s:I}", "frame", (json_int_t)frame, "pass",
                     (json_int_t)p.pass, "tile", (json_int_t)p.tile, "pixel",
                     (json_int_t)(picture.x + rect.x + p.pixel % rect.width),
                     (json_int_t)(picture.y + rect.y + p.pixel / rect.width), "sample", (json_int_t)p.sample);
}

/* Counters that are not 0, by name. */
static json_t *health_json(const Azulejo__Wire__JobInfo *job, const struct health *health)
{
    json_t *out = json_object();

    for (int k = 0; k < HEALTH_KINDS; k++)
        if (health->count[k])
            json_object_set_new(
                out, health_rows[k].name,
                json_pack("{s:I, s:o, s:s, s:s}", "count", (json_int_t)health->count[k], "first",
                          first_json(job, health->first[k], health->frame[k]), "text",
                          health->count[k] == 1 ? health_rows[k].one : health_rows[k].many,
                          "remedy", health_rows[k].remedy));
    return out;
}

/* null: not known, as of jobs that older releases rendered. */
static json_t *depth_json(const Azulejo__Wire__JobInfo *job)
{
    const Azulejo__Wire__EndedByDepth *d = job->ended_by_depth;

    if (!d)
        return json_null();
    return json_pack("{s:f, s:I, s:o, s:o}", "share", d->share, "max_depth",
                     (json_int_t)(job->settings ? job->settings->max_depth : 0), "deeper",
                     d->deeper ? json_integer(d->deeper) : json_null(), "deeper_share",
                     d->deeper ? json_number(d->deeper_share) : json_null());
}

static json_t *verbs_json(const Azulejo__Wire__JobInfo *job)
{
    json_t *out = json_array();

    for (size_t i = 0; i < job->n_verbs; i++)
        json_array_append_new(out, json_text(job->verbs[i]));
    return out;
}

static json_t *after_json(const Azulejo__Wire__JobInfo *job)
{
    json_t *out = json_array();

    for (size_t i = 0; i < job->n_after; i++)
        json_array_append_new(out, json_integer((json_int_t)job->after[i]));
    return out;
}

json_t *job_info_json(const Azulejo__Wire__JobInfo *job)
{
    const struct health health = job_health(job);
    json_t *root = json_object();
    struct digest digest;
    char hex[DIGEST_HEX_SIZE] = "";

    if (!root)
        return NULL;
    if (job->scene.len == DIGEST_BYTES) {
        memcpy(digest.bytes, job->scene.data, DIGEST_BYTES);
        digest_to_hex(&digest, hex);
    }
    json_object_set_new(root, "estimate", json_boolean(job->estimate));
    json_object_set_new(root, "frames_resting", json_integer(job->frames_resting));
    json_object_set_new(root, "job", json_integer((json_int_t)job->job));
    json_object_set_new(root, "name", json_text(job->name));
    json_object_set_new(root, "state", json_string(job_state_word(job->state)));
    json_object_set_new(root, "state_text", json_text(job->state_text));
    json_object_set_new(root, "priority", json_integer(job->priority));
    json_object_set_new(root, "owner", job->owner[0] ? json_text(job->owner) : json_null());
    json_object_set_new(root, "comment", json_text(job->comment));
    json_object_set_new(root, "after", after_json(job));
    json_object_set_new(root, "not_before", job->not_before ? json_integer(job->not_before) : json_null());
    json_object_set_new(root, "require", json_names(job->require));
    /* null: not known, or any */
    json_object_set_new(root, "memory", job->memory ? json_integer((json_int_t)job->memory) : json_null());
    json_object_set_new(root, "memory_is_estimate", json_boolean(!job->memory_said));
    json_object_set_new(root, "finished_early", json_boolean(job->finished_early));
    json_object_set_new(root, "first_frame", json_integer(job->first_frame));
    json_object_set_new(root, "last_frame", json_integer(job->last_frame));
    json_object_set_new(root, "scene", json_string(hex));
    json_object_set_new(root, "scene_name", json_text(job->scene_name));
    if (job->settings)
        json_object_set_new(root, "settings", settings_json(job->settings));
    if (job->output)
        json_object_set_new(root, "output", output_json(job->output));
    json_object_set_new(root, "frames_done", json_integer(job->frames_done));
    json_object_set_new(root, "frames_developed", json_integer(job->frames_developed));
    json_object_set_new(root, "revision", json_integer(job->revision));
    json_object_set_new(root, "develop_error", job->develop_error[0]
                                                   ? json_text(job->develop_error)
                                                   : json_null());
    json_object_set_new(root, "cut_frames", cut_frames_json(job));
    json_object_set_new(root, "samples_done", json_integer((json_int_t)job->samples_done));
    json_object_set_new(root, "samples_total", json_integer((json_int_t)job->samples_total));
    figures_json(root, job);
    json_object_set_new(root, "samples_per_second", json_number(job->samples_per_second));
    json_object_set_new(root, "seconds_left",
                        job->seconds_left >= 0 ? json_number(job->seconds_left) : json_null());
    json_object_set_new(root, "seconds_active", json_number(job->seconds_active));
    if (job->stats && job->work) {
        json_object_set_new(root, "stats", stats_json(job->work, &health, job->stats));
        json_object_set_new(root, "health", health_json(job, &health));
        json_object_set_new(root, "ended_by_depth", depth_json(job));
    }
    json_object_set_new(root, "submitted_at", json_integer(job->submitted_at));
    json_object_set_new(root, "finished_at", job->finished_at ? json_integer(job->finished_at)
                                                              : json_null());
    json_object_set_new(root, "workers", json_integer(job->workers));
    json_object_set_new(root, "conflicts", json_integer((json_int_t)job->conflicts));
    json_object_set_new(root, "preview_frame", json_integer(job->preview_frame));
    json_object_set_new(root, "preview_ready", json_boolean(job->preview_ready));
    json_object_set_new(root, "preview_covered", json_number(job->preview_covered));
    json_object_set_new(root, "verbs", verbs_json(job));
    json_object_set_new(root, "queue_position", json_integer(job->queue_position));
    return root;
}

static void print_line(FILE *out, const char *label, const char *text)
{
    char copy[512];

    fprintf(out, "  %-10s  %s\n", label, message_text(copy, sizeof copy, text));
}

static void print_health(FILE *out, const Azulejo__Wire__JobInfo *job)
{
    struct health health = job_health(job);
    char line[HEALTH_TEXT_SIZE];

    for (int k = 0; k < HEALTH_KINDS && job->settings; k++) {
        if (health.count[k] == 0)
            continue;
        print_line(out, "health",
                   health_text(line, &health, (enum health_kind)k, job_rect(job),
                               job->last_frame > job->first_frame));
        print_line(out, "", health_rows[k].remedy);
    }
}

/* What longer paths would have brought, where it can be seen. */
static void print_depth(FILE *out, const Azulejo__Wire__JobInfo *job)
{
    struct depth_report report = {0};
    char line[DEPTH_TEXT_SIZE];

    if (job->ended_by_depth)
        report = (struct depth_report){job->ended_by_depth->share, job->ended_by_depth->deeper,
                                       job->ended_by_depth->deeper_share};
    if (report.share > DEPTH_SHARE_TOLD && job->settings)
        print_line(out, "depth", depth_report_text(line, &report, job->settings->max_depth));
}

void job_info_print_summary(FILE *out, const Azulejo__Wire__JobInfo *job)
{
    char a[FORMAT_SIZE], b[FORMAT_SIZE], c[FORMAT_SIZE];
    char line[512];
    uint32_t frames = job->last_frame - job->first_frame + 1;

    snprintf(line, sizeof line, "%u of %u", job->frames_done, frames);
    print_line(out, "frames", line);
    if (job->seconds_active > 0)
        snprintf(line, sizeof line, "%s in %s, %s/s", format_count(a, (double)job->samples_done),
                 format_duration(b, job->seconds_active),
                 format_count(c, (double)job->samples_done / job->seconds_active));
    else
        snprintf(line, sizeof line, "%s", format_count(a, (double)job->samples_done));
    print_line(out, "samples", line);
    if (job->stats && job->work && job->work->rays) {
        snprintf(line, sizeof line, "%s, %.1f a sample, %s of processor time",
                 format_count(a, (double)job->work->rays),
                 (double)job->work->rays / (double)(job->work->samples ? job->work->samples : 1),
                 format_duration(b, (double)job->stats->cpu_ns * 1e-9));
        print_line(out, "rays", line);
    }
    for (size_t i = 0; i < job->n_cut_frames; i++)
        print_line(out, cut_frame_is_cancelled(job->cut_frames[i]) ? "cut short" : "ended",
                   cut_frame_text(line, job, job->cut_frames[i]));
    figures_print(out, job);
    print_health(out, job);
    print_depth(out, job);
    if (job->work && job->settings && job->settings->clamp > 0) {
        snprintf(line, sizeof line,
                 "%" PRIu64 " samples were above %g and are scaled down to it: the picture lacks %.3g %% "
                 "of its light",
                 job->work->clamped_samples, (double)job->settings->clamp,
                 100 * clamped_share(job->work));
        print_line(out, "clamped", line);
    }
    if (job->develop_error[0])
        print_line(out, "pictures", job->develop_error);
    else if (job->output && output_message_formats(job->output) & ~(unsigned)OUTPUT_FORMAT_EXR &&
             job->frames_developed < job->frames_done) {
        snprintf(line, sizeof line, "of %u of %u finished frames are made", job->frames_developed,
                 job->frames_done);
        print_line(out, "pictures", line);
    }
    if (job->conflicts) {
        snprintf(line, sizeof line,
                 "%" PRIu64
                 " results differed from ones already merged: a worker computes wrong results "
                 "(see the coordinator's log)",
                 job->conflicts);
        print_line(out, "conflicts", line);
    }
}

status job_info_verdict(const Azulejo__Wire__JobInfo *job, struct error *err)
{
    char why[512];

    if (job->state != AZULEJO__WIRE__JOB_STATE__JOB_FAILED &&
        job->state != AZULEJO__WIRE__JOB_STATE__JOB_CANCELLED)
        return STATUS_OK;
    message_text(why, sizeof why, job->state_text);
    if (strcmp(why, job_state_word(job->state)) == 0)
        why[0] = 0; /* "was cancelled: cancelled" */
    return error_set(err, STATUS_ERR_JOB_FAILED, "job %" PRIu64 " %s%s%s", job->job,
                     job->state == AZULEJO__WIRE__JOB_STATE__JOB_FAILED ? "failed"
                                                                        : "was cancelled",
                     why[0] ? ": " : "", why);
}
