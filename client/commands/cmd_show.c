/* azulejo show: everything about one job. */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "client/commands/command.h"
#include "client/views/effects_view.h"
#include "client/follow/fetch.h"
#include "client/follow/figures_view.h"
#include "client/terminal/field.h"
#include "client/terminal/format.h"
#include "client/follow/job_info.h"
#include "client/options/output.h"
#include "client/farm/store_view.h"
#include "client/farm/job_choice.h"
#include "common/scene/settings.h"
#include "protocol/message.h"

static void print_settings(const Azulejo__Wire__RenderSettings *s)
{
    char region[64] = "";
    struct render_settings defaults;
    int usual;

    render_settings_default(&defaults);
    if (s->whole_width)
        snprintf(region, sizeof region, ", at %u,%u of %u x %u", s->region_x, s->region_y, s->whole_width,
                 s->whole_height);
    field_printf(stdout, "picture", "%u x %u pixels%s, depth %u, seed %" PRIu64 ", camera %u", s->width, s->height,
                 region, s->max_depth, s->seed, s->camera);
    usual = s->env_sampling == defaults.env_sampling;
    if (!usual || s->env_rotate_deg != defaults.env_rotate_deg || s->env_strength != defaults.env_strength)
        field_printf(stdout, "light map", "%s%s%sturned %g degrees, strength %g", usual ? "" : "sampled by ",
                     usual ? "" : env_sampling_name((enum env_sampling)s->env_sampling), usual ? "" : ", ",
                     (double)s->env_rotate_deg, (double)s->env_strength);
    field_print(stdout, "isa", isa_name((enum isa)s->isa));
}

/* "2/255, at most 4096 samples a pixel" */
static void print_rules(const Azulejo__Wire__JobInfo *job)
{
    char text[STOP_RULES_TEXT_SIZE];
    struct stop_rules rules;
    struct error ignored = {0};

    if (job->by_schedule)
        field_print(stdout, "until", "it has what its schedule says");
    else if (wire_stop_get(&rules, job->stop, &ignored) == STATUS_OK)
        field_print(stdout, "until", stop_rules_text(text, &rules, job->settings->spp));
}

/* Only values that differ from the defaults. */
static void print_extras(const Azulejo__Wire__RenderSettings *s)
{
    char names[SETTINGS_TEXT_SIZE];
    char choices[SETTINGS_CHOICES_TEXT_SIZE];
    struct render_settings defaults, settings;
    struct error err = {0};

    render_settings_default(&defaults);
    if (s->shutter > 0)
        field_printf(stdout, "motion", "%g frames a second, shutter open for %g of each", (double)s->fps, (double)s->shutter);
    else if (s->fps != defaults.fps)
        field_printf(stdout, "motion", "%g frames a second", (double)s->fps);
    if (s->pinhole)
        field_print(stdout, "lens", "pinhole");
    else if (s->lens_radius > 0)
        field_printf(stdout, "lens", "radius %g m", (double)s->lens_radius);
    if (s->focus_distance > 0)
        field_printf(stdout, "focus", "%g m", (double)s->focus_distance);
    if (s->without)
        field_print(stdout, "without", settings_effects_text(s->without, names));
    if (wire_settings_get(&settings, s, UINT32_MAX, &err) == STATUS_OK && settings_choices_text(&settings, choices)[0])
        field_print(stdout, "choices", choices);
    if (s->aovs)
        field_print(stdout, "aovs", settings_aovs_text(s->aovs, names));
}

static void print_parameter(struct buffer *line, const Azulejo__Wire__OutputSettings *o, size_t i)
{
    const char *word = tonemap_choice_word(o->tonemap, o->parameters[i]->key, o->parameters[i]->value);
    char key[64];

    message_text(key, sizeof key, o->parameters[i]->key);
    if (word)
        buffer_printf(line, ", %s=%s", key, word);
    else
        buffer_printf(line, ", %s=%g", key, o->parameters[i]->value);
}

static void print_files(struct buffer *line, const Azulejo__Wire__OutputSettings *o)
{
    unsigned formats = output_message_formats(o);
    const char *between = "";

    if (formats & OUTPUT_FORMAT_EXR) {
        buffer_printf(line, "%s EXR", o->exr_half ? "16-bit" : "32-bit");
        between = ", ";
    }
    if (formats & OUTPUT_FORMAT_PNG) {
        buffer_printf(line, "%s%u-bit PNG", between, o->png_bits ? o->png_bits : 8);
        between = ", ";
    }
    if (formats & OUTPUT_FORMAT_JPEG)
        buffer_printf(line, "%sJPEG of quality %u", between, o->jpeg_quality ? o->jpeg_quality : JPEG_QUALITY_DEFAULT);
    buffer_printf(line, "%s", o->no_dither ? ", not dithered" : "");
}

static void print_output(const Azulejo__Wire__OutputSettings *o)
{
    struct buffer line = BUFFER_INIT;
    char text[128];

    print_files(&line, o);
    field_print(stdout, "output", buffer_text(&line));
    buffer_clear(&line);
    buffer_printf(&line, "%s", message_text(text, sizeof text, o->tonemap));
    for (size_t i = 0; i < o->n_parameters; i++)
        print_parameter(&line, o, i);
    buffer_printf(&line, ", exposure %+g EV", o->exposure_ev);
    if (o->camera_ev != 0)
        buffer_printf(&line, " of which %+g the camera's", o->camera_ev);
    if (strcmp(o->metering, "percentile") == 0)
        buffer_printf(&line, ", percentile %g becomes white", output_percentile(o));
    else if (strcmp(o->metering, "key") == 0)
        buffer_printf(&line, ", log-mean becomes 0.18");
    if (o->white_kelvin > 0)
        buffer_printf(&line, ", %g K becomes white", o->white_kelvin);
    if (o->temporal > 1)
        buffer_printf(&line, ", averaged over %u frames", o->temporal);
    if (o->denoise[0] && strcmp(o->denoise, denoising_name(DENOISING_OFF)) != 0)
        buffer_printf(&line, ", denoised%s", strcmp(o->denoise, denoising_name(DENOISING_FAST)) == 0 ? " (fast)" : "");
    if (o->denoise_around > 0 && o->denoise[0] && strcmp(o->denoise, denoising_name(DENOISING_OFF)) != 0)
        buffer_printf(&line, " with %u frame%s before and after each", o->denoise_around, o->denoise_around == 1 ? "" : "s");
    if (o->tonemap_file.len)
        buffer_printf(&line, ", with %s", message_text(text, sizeof text, o->tonemap_file_name));
    field_print(stdout, "tone map", buffer_text(&line));
    buffer_release(&line);
}

static void print_needs(const Azulejo__Wire__JobInfo *job)
{
    char text[FORMAT_SIZE], value[SETTING_TEXT_SIZE];
    struct job_needs needs;

    if (job->n_after)
        printf("  %-10s  job%s", "after", job->n_after > 1 ? "s" : "");
    for (size_t i = 0; i < job->n_after; i++)
        printf("%s %" PRIu64 "%s", i ? "," : "", job->after[i], i + 1 == job->n_after ? "\n" : "");
    if (job->not_before)
        field_print(stdout, "not before", format_time(text, job->not_before));
    if (job->require[0])
        field_print(stdout, "requires", job->require);
    if (job->memory)
        field_printf(stdout, "memory", "%s%s", bytes_text(text, job->memory),
                     job->memory_said ? "" : " at least, estimated from the scene's files and triangles");
#define OPTION(...)
#define SETTING(o, KIND, type, name, ...) needs.name = job->name;
    JOB_NEEDS(OPTION, SETTING, )
#undef OPTION
#undef SETTING
    for (int i = 0; i < NEED_COUNT; i++)
        if (job_needs_rows[i].shown == SETTING_SHOWN_LISTED && !setting_is_default(&job_needs_rows[i], &needs))
            field_print(stdout, job_needs_rows[i].option, setting_text(&job_needs_rows[i], &needs, value));
}

static void print_job(const Azulejo__Wire__JobInfo *job)
{
    char text[FORMAT_SIZE], note[JOB_NOTE_SIZE];

    printf("job %" PRIu64 ": %s\n", job->job, job_state_word(job->state));
    field_print(stdout, "name", job->name);
    field_print(stdout, "scene", job->scene_name);
    if (job->state_text[0] || job->comment[0])
        field_print(stdout, "note", job_info_note(note, job));
    field_printf(stdout, "range", "%u-%u, priority %d", job->first_frame, job->last_frame, job->priority);
    if (job->owner[0])
        field_print(stdout, "owner", job->owner);
    print_needs(job);
    if (job->settings) {
        print_settings(job->settings);
        print_rules(job);
        print_extras(job->settings);
    }
    if (job->output)
        print_output(job->output);
    field_print(stdout, "submitted", format_time(text, job->submitted_at));
    if (job->finished_at)
        field_print(stdout, "ended", format_time(text, job->finished_at));
    job_info_print_summary(stdout, job);
    if (job->state == AZULEJO__WIRE__JOB_STATE__JOB_RUNNING) {
        field_printf(stdout, "workers", "%u", job->workers);
        field_print(stdout, "time left", format_duration(text, job->seconds_left));
    }
}

/* The manifest of one frame: the named one, else the job's first. */
static status show_effects(struct connection *connection, const Azulejo__Wire__JobInfo *job, int64_t frame, int json,
                           struct error *err)
{
    uint32_t number = frame >= 0 ? (uint32_t)frame : job->first_frame;
    struct buffer data = BUFFER_INIT;
    json_t *manifest = NULL;
    status result =
        fetch_output(connection, job->job, number, AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EFFECTS_JSON, &data, err);

    THEN(result, manifest_parse(&manifest, data.data, data.size, err));
    if (result == STATUS_OK && json)
        result = json_print(json_incref(manifest), err);
    else if (result == STATUS_OK)
        manifest_print(manifest);
    json_decref(manifest);
    buffer_release(&data);
    return result;
}

static status show_history(struct connection *connection, const Azulejo__Wire__JobInfo *job, int64_t frame, int json,
                           struct error *err)
{
    Azulejo__Wire__Envelope *answer = NULL;
    status result = history_query(connection, job->job, frame >= 0 ? (uint32_t)frame : job->now_frame, &answer, err);

    if (result == STATUS_OK && json)
        result = json_print(json_message(&answer->history->base), err);
    else if (result == STATUS_OK)
        history_print(answer->history);
    message_free(answer);
    return result;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    int json = 0, effects = 0, history = 0, farm = 0, done;
    int64_t frame = -1;
    const struct option table[] = {
        {"effects", 0, OPTION_FLAG, &effects, NULL,
         "show instead the effects that a finished frame needed, what was left out, and where its "
         "time went",
         0, 0, NULL},
        {"history", 0, OPTION_FLAG, &history, NULL,
         "show instead the history of a frame's error, and what it cost", 0, 0, NULL},
        {"frame", 0, OPTION_INT, &frame, "N",
         "the frame for --effects (default: the job's first), and for --history (the one in work, or the last "
         "one done)",
         0, INT32_MAX, NULL},
        {"farm", 0, OPTION_FLAG, &farm, NULL,
         "show instead, without a JOB, what takes the room in the coordinator's store", 0, 0, NULL},
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct positionals rest;
    struct connection *connection = NULL;
    Azulejo__Wire__Envelope *answer = NULL;
    uint64_t job;
    status result = command_parse(command, table, argc, argv, 0, 1, &rest, &done, err);

    if (result != STATUS_OK || done)
        return result;
    if (farm != (rest.count == 0) || (farm && (effects || history || frame >= 0)))
        return error_set(err, STATUS_ERR_USAGE,
                         farm ? "--farm shows the store: give neither a JOB nor another view with it"
                              : "which job? Give its number, or --farm");
    if (farm)
        return store_show(&where, json, err);
    if (frame >= 0 && !effects && !history)
        return error_set(err, STATUS_ERR_USAGE, "--frame says whose --effects or --history to show: give both");
    if (effects && history)
        return error_set(err, STATUS_ERR_USAGE, "give --effects or --history, not both");
    result = job_word_check(rest.items[0], err);
    THEN(result, connection_open(&connection, &where, err));
    THEN(result, job_word_find(connection, rest.items[0], &job, err));
    THEN(result, job_query(connection, job, &answer, err));
    if (result == STATUS_OK && effects)
        result = show_effects(connection, job_list_find(answer->job_list, job), frame, json, err);
    else if (result == STATUS_OK && history)
        result = show_history(connection, job_list_find(answer->job_list, job), frame, json, err);
    else if (result == STATUS_OK && json)
        result = json_print(json_message(&job_list_find(answer->job_list, job)->base), err);
    else if (result == STATUS_OK)
        print_job(job_list_find(answer->job_list, job));
    message_free(answer);
    connection_close(connection);
    return result;
}

const struct command command_show = {
    .name = "show",
    .group = COMMAND_JOBS,
    .usage = "azulejo show JOB | --farm [OPTION]...",
    .summary = "show everything about a job, or what takes the room",
    .description =
        "Tell a job's settings, how far it is, what it has cost so far, and its estimated error. With\n"
        "--effects, tell of a finished frame which effects ran, who called for them, and where the time went. With --farm,\n"
        "tell what takes the room in the coordinator's store, by kind, by owner and by job.",
    .run = run,
};
