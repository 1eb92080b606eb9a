/* azulejo owners: which worker and thread rendered each tile of a frame. */
#include <inttypes.h>
#include <string.h>

#include "client/commands/command.h"
#include "client/follow/fetch.h"
#include "client/follow/job_info.h"
#include "client/farm/owners.h"
#include "client/farm/job_choice.h"
#include "protocol/message.h"

struct view {
    const char *path; /* NULL: the legend alone */
    int64_t frame;    /* -1: the one in work, or the last one done */
    int64_t scale;    /* 0: not given */
    int over, json;
};

static status check_view(const struct view *v, struct error *err)
{
    int picture = v->path && !owners_path_is_json(v->path) && !(v->json && strcmp(v->path, "-") == 0);

    if ((v->over || v->scale) && !picture)
        return error_set(err, STATUS_ERR_USAGE, "--%s is about the picture: give -o FILE.png with it",
                         v->over ? "over" : "scale");
    if (v->json && v->path && strcmp(v->path, "-") == 0)
        return error_set(err, STATUS_ERR_USAGE, "-o - writes the picture and --json the tiles: give one of them");
    return v->path ? owners_path_check(v->path, err) : STATUS_OK;
}

/* The frame's own picture, as the job tone maps it: of a frame in work as it is now. */
static status fetch_picture(struct connection *c, const Azulejo__Wire__JobInfo *job, uint32_t frame, struct image8 *out,
                            struct error *err)
{
    unsigned formats = job->output ? output_message_formats(job->output) : 0;
    int jpeg = !(formats & OUTPUT_FORMAT_PNG) && formats & OUTPUT_FORMAT_JPEG && job_frame_listed(job, &job->done, frame);
    struct buffer data = BUFFER_INIT;
    status result =
        fetch_output(c, job->job, frame,
                     jpeg ? AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_JPEG : AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_PNG,
                     &data, err);

    if (result == STATUS_ERR_NOT_FOUND && !(formats & (OUTPUT_FORMAT_PNG | OUTPUT_FORMAT_JPEG)))
        error_set(err, result, "--over: job %" PRIu64 " makes no PNG or JPEG: leave --over out, or give it some with "
                  "'azulejo develop %" PRIu64 " --format png'", job->job, job->job);
    THEN(result, image_decode_8(out, data.data, data.size, "the frame's picture", err));
    buffer_release(&data);
    return result;
}

static status show(struct connection *c, const Azulejo__Wire__JobInfo *job, const struct view *v, struct error *err)
{
    uint32_t frame = v->frame >= 0 ? (uint32_t)v->frame : job->now_frame;
    struct owners owners = {0};
    struct image8 over = {0};
    status result = owners_get(c, job->job, frame, &owners, err);

    if (result == STATUS_OK && v->over)
        result = fetch_picture(c, job, frame, &over, err);
    if (result == STATUS_OK && v->path)
        result = owners_write(&owners, v->path, (uint32_t)v->scale, v->over ? &over : NULL, err);
    if (result == STATUS_OK && v->json)
        result = json_print(owners_json(&owners), err);
    else if (result == STATUS_OK && (!v->path || strcmp(v->path, "-") != 0))
        owners_print(&owners);
    image8_release(&over);
    owners_release(&owners);
    return result;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct view v = {.frame = -1};
    const struct option table[] = {
        {"frame", 0, OPTION_INT, &v.frame, "N", "the frame (default: the one in work, or the last one done)", 0,
         INT32_MAX, NULL},
        {"output", 'o', OPTION_STRING, &v.path, "FILE",
         "also write the tiles in their workers' colours (.png), or who rendered what of each (.json); -: the "
         "picture to standard output, without the legend",
         0, 0, NULL},
        {"scale", 0, OPTION_INT, &v.scale, "K",
         "the picture has K x K pixels for each of the frame (default: so many that its longer side has 512 or more)",
         1, OWNERS_SCALE_MAX, NULL},
        {"over", 0, OPTION_FLAG, &v.over, NULL, "the frame's own picture shines through the colours", 0, 0, NULL},
        {"json", 0, OPTION_FLAG, &v.json, NULL, "print JSON in place of the legend", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct positionals rest;
    struct connection *connection = NULL;
    Azulejo__Wire__Envelope *answer = NULL;
    uint64_t job;
    int done;
    status result = command_parse(command, table, argc, argv, 1, 1, &rest, &done, err);

    if (result != STATUS_OK || done)
        return result;
    result = check_view(&v, err);
    THEN(result, job_word_check(rest.items[0], err));
    THEN(result, connection_open(&connection, &where, err));
    THEN(result, job_word_find(connection, rest.items[0], &job, err));
    THEN(result, job_query(connection, job, &answer, err));
    THEN(result, show(connection, job_list_find(answer->job_list, job), &v, err));
    message_free(answer);
    connection_close(connection);
    return result;
}

const struct command command_owners = {
    .name = "owners",
    .group = COMMAND_JOBS,
    .usage = "azulejo owners JOB [OPTION]...",
    .summary = "show which worker rendered which tile",
    .description =
        "Tell which worker and thread rendered each 16x16 tile of a frame, in work or done: a legend, and with\n"
        "-o FILE.png the tiles in their workers' colours (threads are shades of them). A tile that several\n"
        "workers shared has the colour of the one with the most samples of it; JSON lists them all. The\n"
        "coordinator keeps this with the frame's film, over restarts, as long as it keeps the film.",
    .run = run,
};
