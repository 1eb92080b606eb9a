/* azulejo accuracy: what accuracy costs, on one page. */
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "client/command.h"
#include "client/study/study_files.h"
#include "common/base/file.h"

static status study_load(struct study *s, const char *path, struct error *err)
{
    struct buffer text = BUFFER_INIT;
    status result = file_read(path, STUDY_FILE_BYTES_MAX, &text, err);

    if (result == STATUS_OK)
        result = study_read(s, buffer_text(&text), text.size, path, err);
    buffer_release(&text);
    return result;
}

/* The page's path: as given, or the study's with another extension, here. */
static status page_path(struct buffer *out, const char *given, const char *from, struct error *err)
{
    if (given && strcasecmp(file_extension(given), "html") != 0)
        return error_set(err, STATUS_ERR_USAGE, "-o %s: the page's name must end in .html", given);
    if (given) {
        buffer_puts(out, given);
    } else {
        const char *base = file_basename(from), *extension = file_extension(from);
        size_t length = strlen(base) - (*extension ? strlen(extension) + 1 : 0);
        buffer_printf(out, "%.*s.html", (int)length, base);
    }
    return buffer_ok(out) ? STATUS_OK : error_no_memory(err, "a path");
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    const char *from = NULL, *out = NULL;
    int page_only = 0, quiet = 0, done;
    const struct option table[] = {
        {"from", 0, OPTION_STRING, &from, "FILE.json", "draw the study that this file holds", 0, 0,
         NULL},
        {"out", 'o', OPTION_STRING, &out, "PAGE.html",
         "the page's path (default: named after FILE, in this folder)", 0, 0, NULL},
        {"page-only", 0, OPTION_FLAG, &page_only, NULL,
         "write the page alone: no CSV, no JSON, no plots", 0, 0, NULL},
        {"quiet", 'q', OPTION_FLAG, &quiet, NULL, "print no summary", 0, 0, NULL},
        {0},
    };
    struct buffer page = BUFFER_INIT;
    struct positionals rest;
    struct study study;
    status result = command_parse(command, table, argc, argv, 0, 0, &rest, &done, err);

    (void)exit_code;
    if (result != STATUS_OK || done)
        return result;
    if (!from)
        return error_set(err, STATUS_ERR_USAGE, "--from FILE.json is missing; usage: %s",
                         command->usage);
    study_init(&study);
    result = page_path(&page, out, from, err);
    if (result == STATUS_OK)
        result = study_load(&study, from, err);
    if (result == STATUS_OK)
        result = study_files_write(&study, buffer_text(&page), page_only, err);
    if ((result == STATUS_OK || result == STATUS_ERR_INCOMPLETE) && !quiet) {
        status printed = study_print(&study, result == STATUS_OK ? err : NULL);
        printf("%s\n", buffer_text(&page));
        result = result == STATUS_OK ? printed : result;
    }
    study_release(&study);
    buffer_release(&page);
    return result;
}

const struct command command_accuracy = {
    .name = "accuracy",
    .group = COMMAND_RENDER,
    .usage = "azulejo accuracy --from FILE.json [OPTION]...",
    .summary = "show what accuracy costs, on one page",
    .description =
        "Draw what a study found out about a scene: what each error of the picture costs in processor time,\n"
        "what other ways of rendering would cost, and what each effect is worth. Writes one HTML page that\n"
        "needs nothing else, the points as CSV, the study as JSON, and the plots as SVG and PNG beside it.",
    .run = run,
};
