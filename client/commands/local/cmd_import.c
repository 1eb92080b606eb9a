/* azulejo import: read a scene file and list what is in it. */
#include "client/commands/command.h"
#include "client/import/import.h"
#include "client/follow/job_info.h"

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct import_options options = IMPORT_OPTIONS_OF_COMMANDS;
    struct import_result scene;
    int json = 0, done;
    const struct option table[] = {
        IMPORT_OPTION_ROWS(options),
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        {0},
    };
    struct positionals rest;
    status result = command_parse(command, table, argc, argv, 1, 1, &rest, &done, err);

    if (result != STATUS_OK || done)
        return result;
    result = import_scene(rest.items[0], &options, &scene, err);
    if (result == STATUS_OK && json)
        result = json_print(import_report_json(&scene), err);
    else if (result == STATUS_OK)
        import_report_print(&scene, stdout);
    import_result_release(&scene);
    return result;
}

const struct command command_import = {
    .name = "import",
    .group = COMMAND_RENDER,
    .usage = "azulejo import SCENE [OPTION]...",
    .summary = "read a scene and list its contents and the effects that it needs",
    .description = "Read a scene file, check it, and tell its contents, the effects that rendering it calls for,\n"
                   "and what in it is not supported. Nothing is sent anywhere.",
    .run = run,
};
