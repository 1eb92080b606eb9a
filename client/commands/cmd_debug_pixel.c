/* azulejo debug-pixel: one sample of a picture rendered again, and everything that its path did. */
#include <ctype.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "client/commands/command.h"
#include "client/farm/job_choice.h"
#include "client/views/debug_view.h"
#include "client/follow/job_info.h"
#include "client/link/local.h"
#include "client/link/signals.h"
#include "client/farm/submission.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "protocol/message.h"

enum {
    SAMPLES_MAX = 64,            /* paths reported by one command */
    OPTIONS_MAX = 96,
    WORKER_LOOK_MS = 10,
    LOCAL_PATIENCE_S = 86400,    /* a local farm is watched: it need not be doubted */
};

struct debug {
    const char *target, *pixel_text;
    struct option_list sample_texts;
    int64_t frame; /* -1: the first */
    uint32_t x, y;
    uint32_t samples[SAMPLES_MAX];
    size_t sample_count;
    int json, quiet;
    struct job_options options;
    struct local_options local;
    struct connection_options where;
    char frames[24];

    struct job_request request;
    struct import_result scene;
    struct local_farm *farm;
    struct connection *connection;
    uint64_t job;             /* 0: of a scene */
    struct tile_rect picture; /* what is rendered of the whole picture */
    uint32_t spp;
};

/* ---- what is asked for ------------------------------------------------------------------------ */

static status parse_pixel(const char *text, uint32_t *x, uint32_t *y, struct error *err)
{
    unsigned column, row;
    int used = 0;

    if (!text)
        return error_set(err, STATUS_ERR_USAGE, "which pixel? Give --pixel X,Y, from the upper left corner");
    if (!isdigit((unsigned char)text[0]) || sscanf(text, "%9u,%9u%n", &column, &row, &used) != 2 || text[used])
        return error_set(err, STATUS_ERR_USAGE,
                         "--pixel %s: must be column and row from the upper left corner, as in 33,40", text);
    *x = column;
    *y = row;
    return STATUS_OK;
}

/* "5", "0-3" */
static status add_samples(struct debug *d, const char *text, struct error *err)
{
    unsigned first, last;
    int used = 0, count = isdigit((unsigned char)text[0]) ? sscanf(text, "%9u%n-%9u%n", &first, &used, &last, &used) : 0;

    if (count == 1)
        last = first;
    if (count < 1 || text[used] || last < first)
        return error_set(err, STATUS_ERR_USAGE, "--sample %s: must be a sample's number or a range, as in 5 or 0-3",
                         text);
    if (last - first >= SAMPLES_MAX - d->sample_count)
        return error_set(err, STATUS_ERR_USAGE,
                         "--sample %s: at most %d paths at once; without --sample the pixel's samples are listed", text,
                         SAMPLES_MAX);
    for (uint32_t n = first; n <= last; n++)
        d->samples[d->sample_count++] = n;
    return STATUS_OK;
}

/* A number, or a name that is no file's: "7", "walk". */
static int is_job(const char *target)
{
    return target[strspn(target, "0123456789")] == 0 || (!strpbrk(target, "./") && access(target, F_OK) != 0);
}

static status parse_request(struct debug *d, struct error *err)
{
    status result = parse_pixel(d->pixel_text, &d->x, &d->y, err);

    for (size_t i = 0; i < d->sample_texts.count && result == STATUS_OK; i++)
        result = add_samples(d, d->sample_texts.items[i], err);
    if (result == STATUS_OK && is_job(d->target))
        result = job_word_check(d->target, err);
    return result;
}

/* ---- asking ----------------------------------------------------------------------------------- */

static status check_result(const Azulejo__Wire__RenderResult *result, uint32_t count, int path, struct error *err)
{
    if (result->added.len != (size_t)count * 3 * sizeof(float) || (path && !result->path))
        return error_set(err, STATUS_ERR_PROTOCOL, "the worker answered with something else than %u sample%s", count,
                         count == 1 ? "" : "s");
    return STATUS_OK;
}

/* Samples `first` to `first` + `count` - 1 of the pixel. The caller frees the answer. */
static status ask(struct debug *d, uint32_t first, uint32_t count, int path, Azulejo__Wire__Envelope **answer,
                  struct error *err)
{
    Azulejo__Wire__RenderRequest request = AZULEJO__WIRE__RENDER_REQUEST__INIT;
    Azulejo__Wire__RenderSettings settings = AZULEJO__WIRE__RENDER_SETTINGS__INIT;
    Azulejo__Wire__PixelSamples pixel = AZULEJO__WIRE__PIXEL_SAMPLES__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(RENDER_REQUEST, render_request, &request);
    status result;

    pixel.x = d->x;
    pixel.y = d->y;
    pixel.first = first;
    pixel.count = count;
    pixel.path = path != 0;
    request.job = d->job;
    request.frame = (uint32_t)d->frame;
    request.pixel = &pixel;
    if (!d->job) {
        wire_settings_set(&settings, &d->request.settings);
        wire_digest_set(&request.scene, &d->scene.scene_digest);
        request.settings = &settings;
    }
    TRY(connection_ask(d->connection, &envelope, AZULEJO__WIRE__ENVELOPE__BODY_RENDER_RESULT, answer, err));
    result = check_result((*answer)->render_result, count, path, err);
    if (result != STATUS_OK) {
        message_free(*answer);
        *answer = NULL;
    }
    return result;
}

static void take_sample(const Azulejo__Wire__RenderResult *result, uint32_t first, uint32_t i, struct debug_sample *out)
{
    out->number = first + i;
    memcpy(out->added, result->added.data + i * sizeof out->added, sizeof out->added);
}

static json_t *header_json(const struct debug *d)
{
    return json_pack("{s:o, s:I, s:[I, I], s:I}", "job", d->job ? json_integer((json_int_t)d->job) : json_null(),
                     "frame", (json_int_t)d->frame, "pixel", (json_int_t)d->x, (json_int_t)d->y, "spp",
                     (json_int_t)d->spp);
}

static status print_document(const struct debug *d, json_t *samples, struct error *err)
{
    json_t *document = header_json(d);

    json_object_set_new(document, "samples", samples);
    return json_print(document, err);
}

static status tell_paths(struct debug *d, struct error *err)
{
    json_t *list = json_array();
    status result = STATUS_OK;

    for (size_t i = 0; i < d->sample_count && result == STATUS_OK; i++) {
        Azulejo__Wire__Envelope *answer = NULL;
        struct debug_sample sample;

        result = ask(d, d->samples[i], 1, 1, &answer, err);
        if (result != STATUS_OK)
            break;
        take_sample(answer->render_result, d->samples[i], 0, &sample);
        if (d->json)
            json_array_append_new(list, debug_path_json(&sample, answer->render_result));
        else
            debug_path_print(stdout, &sample, answer->render_result, d->picture);
        message_free(answer);
    }
    if (d->json && result == STATUS_OK)
        return print_document(d, list, err);
    json_decref(list);
    return result;
}

static status tell_samples(struct debug *d, struct error *err)
{
    struct debug_sample *samples = must(mem_alloc_array(d->spp, sizeof *samples));
    status result = STATUS_OK;

    for (uint32_t at = 0, count; at < d->spp && result == STATUS_OK; at += count) {
        Azulejo__Wire__Envelope *answer = NULL;

        count = d->spp - at < PIXEL_SAMPLES_MAX ? d->spp - at : PIXEL_SAMPLES_MAX;
        result = ask(d, at, count, 0, &answer, err);
        for (uint32_t i = 0; i < count && result == STATUS_OK; i++)
            take_sample(answer->render_result, at, i, &samples[at + i]);
        message_free(answer);
    }
    if (result == STATUS_OK) {
        debug_samples_sort(samples, d->spp);
        if (d->json)
            result = print_document(d, debug_samples_json(samples, d->spp), err);
        else
            debug_samples_print(stdout, samples, d->spp);
    }
    mem_free(samples);
    return result;
}

static status tell(struct debug *d, struct error *err)
{
    if (d->x - d->picture.x >= d->picture.width || d->y - d->picture.y >= d->picture.height) {
        error_set(err, STATUS_ERR_INPUT, "--pixel %u,%u is outside the picture of %ux%u pixels", d->x, d->y,
                  d->picture.width, d->picture.height);
        if (err && (d->picture.x || d->picture.y))
            snprintf(err->text + strlen(err->text), sizeof err->text - strlen(err->text), " from %u,%u on",
                     d->picture.x, d->picture.y);
        return STATUS_ERR_INPUT;
    }
    for (size_t i = 0; i < d->sample_count; i++)
        if (d->samples[i] >= d->spp)
            return error_set(err, STATUS_ERR_INPUT, "--sample %u: the pixel has samples 0 to %u", d->samples[i],
                             d->spp - 1);
    if (!d->json)
        printf("pixel %u,%u of frame %" PRId64 "\n", d->x, d->y, d->frame);
    return d->sample_count ? tell_paths(d, err) : tell_samples(d, err);
}

/* ---- a job on a farm -------------------------------------------------------------------------- */

static status debug_job(struct debug *d, struct error *err)
{
    Azulejo__Wire__Envelope *answer = NULL;
    status result = connection_open(&d->connection, &d->where, err);

    THEN(result, job_word_find(d->connection, d->target, &d->job, err));
    THEN(result, job_query(d->connection, d->job, &answer, err));
    if (result == STATUS_OK) {
        const Azulejo__Wire__JobInfo *info = job_list_find(answer->job_list, d->job);

        if (!info->settings)
            result = error_set(err, STATUS_ERR_PROTOCOL, "job %" PRIu64 " came without settings", d->job);
        else if (d->frame >= 0 && (d->frame < info->first_frame || d->frame > info->last_frame))
            result = error_set(err, STATUS_ERR_INPUT, "--frame %" PRId64 ": job %" PRIu64 " has frames %u to %u",
                               d->frame, d->job, info->first_frame, info->last_frame);
        else {
            d->frame = d->frame < 0 ? (int64_t)info->first_frame : d->frame;
            d->picture = (struct tile_rect){info->settings->region_x, info->settings->region_y,
                                            info->settings->width, info->settings->height};
            d->spp = info->settings->spp;
        }
    }
    message_free(answer);
    return result == STATUS_OK ? tell(d, err) : result;
}

/* ---- a scene, on this machine ----------------------------------------------------------------- */

static status prepare_scene(struct debug *d, struct error *err)
{
    status result;

    if (d->frame >= 0) {
        snprintf(d->frames, sizeof d->frames, "%" PRId64, d->frame);
        d->options.frames.list = d->frames;
    }
    result = job_options_check(&d->options, &d->request, err);
    THEN(result, submission_prepare(d->target, &d->options, d->quiet || d->json, &d->request, &d->scene, err));
    if (result != STATUS_OK)
        return result;
    d->frame = d->request.first_frame;
    d->picture = settings_rect(&d->request.settings);
    d->spp = d->request.settings.spp;
    return signals_catch(err);
}

/* The worker connects in its own time; if it never does, the connection's watch says why. */
static status await_worker(struct connection *c, struct error *err)
{
    const struct timespec moment = {0, WORKER_LOOK_MS * 1000000};
    size_t workers = 0;
    status result;

    for (;;) {
        Azulejo__Wire__WorkerQuery query = AZULEJO__WIRE__WORKER_QUERY__INIT;
        Azulejo__Wire__Envelope envelope = MESSAGE(WORKER_QUERY, worker_query, &query), *answer = NULL;

        result = connection_ask(c, &envelope, AZULEJO__WIRE__ENVELOPE__BODY_WORKER_LIST, &answer, err);
        if (result == STATUS_OK)
            workers = answer->worker_list->n_workers;
        message_free(answer);
        if (result != STATUS_OK || workers > 0)
            return result;
        nanosleep(&moment, NULL);
    }
}

static status debug_on_local_farm(struct debug *d, struct error *err)
{
    struct connection_options where = *local_farm_address(d->farm);
    status result;

    where.timeout_s = LOCAL_PATIENCE_S;
    TRY(connection_open(&d->connection, &where, err));
    connection_set_watch(d->connection, local_farm_check, d->farm);
    result = local_farm_check(d->farm, err); /* what ended before the connection watched */
    THEN(result, submission_upload(d->connection, &d->scene, &d->request, 1, err));
    THEN(result, await_worker(d->connection, err));
    return result == STATUS_OK ? tell(d, err) : result;
}

static status debug_scene(struct debug *d, struct error *err)
{
    status result = prepare_scene(d, err);

    THEN(result, local_farm_start(&d->farm, &d->local, err));
    if (result == STATUS_OK) {
        result = debug_on_local_farm(d, err);
        if (result != STATUS_OK)
            result = local_farm_explain(d->farm, result, err);
    }
    return result;
}

/* ---- the command ------------------------------------------------------------------------------ */

/* Without the rows about frames and about pictures: this command writes no picture. */
static void choose_rows(const struct debug *d, const struct option *all, struct option out[OPTIONS_MAX])
{
    static const char *const left_out[] = {"frames", "first-middle-last", "aov", "half", "priority"};
    const char *output = (const char *)&d->options.output;
    size_t count = 0;

    for (; all->name && count + 1 < OPTIONS_MAX; all++) {
        const char *target = all->target;
        int wanted = !(target >= output && target < output + sizeof d->options.output);

        for (size_t i = 0; i < sizeof left_out / sizeof *left_out; i++)
            wanted &= strcmp(all->name, left_out[i]) != 0;
        if (wanted)
            out[count++] = *all;
    }
    memset(&out[count], 0, sizeof out[count]);
}

/* Each kind of target has options of its own. */
static status check_options(const struct debug *d, const struct job_options *scene_before,
                            const struct connection_options *where_before, struct error *err)
{
    if (is_job(d->target) && memcmp(&d->options, scene_before, sizeof d->options) != 0)
        return error_set(err, STATUS_ERR_USAGE,
                         "job %s has its own settings: give only --frame, --pixel, --sample and where the farm is",
                         d->target);
    if (!is_job(d->target) && memcmp(&d->where, where_before, sizeof d->where) != 0)
        return error_set(err, STATUS_ERR_USAGE,
                         "%s is a scene, which is rendered here: --coordinator, --key and --timeout are for jobs",
                         d->target);
    return STATUS_OK;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    static struct debug d = {.options = JOB_OPTIONS_INIT, .where = CONNECTION_OPTIONS_INIT, .frame = -1};
    static struct job_options scene_before;
    static struct connection_options where_before;
    const struct option table[] = {
        {"pixel", 'p', OPTION_STRING, &d.pixel_text, "X,Y", "column and row, from 0 at the upper left corner", 0, 0,
         NULL},
        {"sample", 0, OPTION_LIST, &d.sample_texts, "N",
         "the sample whose path is printed, from 0, or a range as in 0-3; may be repeated (default: list all, the "
         "largest first)",
         0, 0, NULL},
        {"frame", 0, OPTION_INT, &d.frame, "N", "the frame (default: the first)", 0, INT32_MAX, NULL},
        {"json", 0, OPTION_FLAG, &d.json, NULL, "print JSON", 0, 0, NULL},
        {"quiet", 'q', OPTION_FLAG, &d.quiet, NULL, "no warnings", 0, 0, NULL},
        {"verbose", 'v', OPTION_FLAG, &d.local.verbose, NULL,
         "of a scene: show what the coordinator and the worker log", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(d.where),
        {"", 0, OPTION_GROUP, NULL, NULL, "of a scene, as for render:", 0, 0, NULL},
        JOB_STUDY_ROWS(d.options),
        {0},
    };
    struct option rows[OPTIONS_MAX];
    struct positionals rest;
    int done;
    status result;

    memcpy(&scene_before, &d.options, sizeof scene_before);
    memcpy(&where_before, &d.where, sizeof where_before);
    choose_rows(&d, table, rows);
    result = command_parse(command, rows, argc, argv, 1, 1, &rest, &done, err);
    if (result != STATUS_OK || done)
        return result;
    d.target = rest.items[0];
    d.local.workers = 1;
    d.local.threads = 1;
    result = check_options(&d, &scene_before, &where_before, err);
    THEN(result, parse_request(&d, err));
    THEN(result, is_job(d.target) ? debug_job(&d, err) : debug_scene(&d, err));
    connection_close(d.connection);
    local_farm_stop(d.farm);
    import_result_release(&d.scene);
    job_request_release(&d.request);
    return result;
}

const struct command command_debug_pixel = {
    .name = "debug-pixel",
    .group = COMMAND_PICTURES,
    .usage = "azulejo debug-pixel SCENE|JOB --pixel X,Y [--sample N]... [OPTION]...",
    .summary = "render one sample again and tell what its path did",
    .description =
        "Render one sample of a picture again, with the bits that the picture got, and tell every vertex of its\n"
        "path: place, material, throughput, the light that was sampled, the next direction, and what ended it.\n"
        "A number is a job, and so is a word without '.' and '/' that is no file's name: a worker of the farm does it,\n"
        "also after the job is done. Anything else is a scene, which is rendered on this machine. Without --sample the\n"
        "pixel's samples are listed by luminance.",
    .run = run,
};
