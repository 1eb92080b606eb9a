#include "client/options/schedule_option.h"

#include <stdio.h>
#include <string.h>

#include "common/accuracy/schedule.h"
#include "common/system/file.h"
#include "common/image/image.h"

static status check_options(const struct job_options *o, struct error *err)
{
    const char *said = o->stop.spp != 0 ? "spp" : o->fit ? "fit" : NULL;

    for (int i = 0; i < STOP_COUNT; i++)
        said = o->stop.said[i].text ? stop_rules_rows[i].option : said;
    return said ? error_set(err, STATUS_ERR_USAGE, "--schedule-from fixes all samples: leave out --%s", said) : STATUS_OK;
}

/* Another release renders different samples. */
static status check_release(const struct buffer *exr, const char *path, struct error *err)
{
    static const char release[] = "azulejo " AZULEJO_VERSION " ";
    struct buffer kernel = BUFFER_INIT;
    status s = exr_read_text(&kernel, exr->data, exr->size, path, "azulejo:kernel", err);

    if (s == STATUS_OK && strncmp(buffer_text(&kernel), release, sizeof release - 1) != 0)
        s = error_set(err, STATUS_ERR_INPUT,
                      "%s: was rendered by '%s', and this is azulejo %s, whose samples are "
                      "different: use that release",
                      path, buffer_text(&kernel), AZULEJO_VERSION);
    buffer_release(&kernel);
    return s;
}

/* The region that the picture is of a larger one. */
static status read_region(const struct buffer *exr, const char *path, char out[SETTINGS_REGION_TEXT_SIZE],
                          struct error *err)
{
    struct buffer text = BUFFER_INIT;
    struct error why = {0};
    status s = exr_read_text(&text, exr->data, exr->size, path, SETTINGS_REGION_ATTRIBUTE, &why);

    if (s == STATUS_OK)
        snprintf(out, SETTINGS_REGION_TEXT_SIZE, "%s", buffer_text(&text));
    buffer_release(&text);
    return s == STATUS_OK || s == STATUS_ERR_NOT_FOUND ? STATUS_OK : error_set(err, s, "%s", why.text);
}

/* Another region has other samples. */
static status check_region(const struct job_request *request, const char *path, struct error *err)
{
    char region[SETTINGS_REGION_TEXT_SIZE];
    const char *wanted = request->schedule_region;
    int rectangle = (int)strcspn(wanted, " ");
    const char *size = strstr(wanted, " of ");

    if (strcmp(settings_region_text(&request->settings, region), wanted) == 0)
        return STATUS_OK;
    if (!size)
        return error_set(err, STATUS_ERR_USAGE, "%s: its schedule is for a whole picture: render it without --region",
                         path);
    return error_set(err, STATUS_ERR_USAGE, "%s: its schedule is for a region: give --size %s --region %.*s", path,
                     size + 4, rectangle, wanted);
}

status schedule_option_read(struct job_request *request, const struct job_options *o, struct error *err)
{
    const char *path = o->schedule_path;
    struct buffer exr = BUFFER_INIT, text = BUFFER_INIT;
    status s;

    if (!path)
        return STATUS_OK;
    s = check_options(o, err);
    THEN(s, file_read(path, IMAGE_BYTES_MAX, &exr, err));
    if (s == STATUS_OK) {
        s = exr_read_text(&text, exr.data, exr.size, path, SCHEDULE_ATTRIBUTE, err);
        if (s == STATUS_ERR_NOT_FOUND)
            s = error_set(err, STATUS_ERR_INPUT,
                          "%s: has no schedule; a picture that ended by its rules has none: give "
                          "these again (--spp, --target-error)",
                          path);
    }
    THEN(s, check_release(&exr, path, err));
    THEN(s, read_region(&exr, path, request->schedule_region, err));
    if (s == STATUS_OK) {
        s = schedule_decode(buffer_text(&text), &request->schedule_width, &request->schedule_height,
                            &request->settings.spp, &request->schedule, err);
        if (s != STATUS_OK)
            error_prefix(err, "%s", path);
    }
    request->spp_given = 1;
    buffer_release(&text);
    buffer_release(&exr);
    return s;
}

status schedule_option_fit(struct job_request *request, const struct job_options *o, struct error *err)
{
    struct render_settings *s = &request->settings;

    if (!o->schedule_path)
        return STATUS_OK;
    if (!o->size && !o->region && !request->schedule_region[0]) {
        s->width = request->schedule_width;
        s->height = request->schedule_height;
    }
    if (check_region(request, o->schedule_path, err) != STATUS_OK)
        return STATUS_ERR_USAGE;
    if (s->width != request->schedule_width || s->height != request->schedule_height)
        return error_set(err, STATUS_ERR_USAGE,
                         "%s: its schedule is for %ux%u pixels, and --size is %ux%u: leave --size out",
                         o->schedule_path, request->schedule_width, request->schedule_height, s->width, s->height);
    if (request->first_frame != request->last_frame)
        return error_set(err, STATUS_ERR_USAGE, "%s: its schedule is for one frame: give that one with --frames",
                         o->schedule_path);
    return STATUS_OK;
}
