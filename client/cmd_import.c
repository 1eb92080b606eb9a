/* azulejo import: read a scene file and tell what is in it. */
#include "client/command.h"
#include "client/import/import.h"
#include "client/job_info.h"

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct import_result scene;
    int64_t scene_index = -1;
    int json = 0, done;
    const struct option table[] = {
        {"env", 'e', OPTION_STRING, &options.env_path, "FILE",
         "light the scene with this lat-long environment map (EXR or Radiance HDR)", 0, 0, NULL},
        {"scene", 0, OPTION_INT, &scene_index, "N",
         "which of the file's scenes, from 0 (default: the one that the file names)", -1, 1e6, NULL},
        {"variant", 0, OPTION_STRING, &options.variant, "NAME|N",
         "which of the file's material variants, by name or number from 0 (default: none)", 0, 0,
         NULL},
        {"animation", 0, OPTION_STRING, &options.animation, "NAME|N|none",
         "which of the file's animations, by name or number from 0 (default: all)", 0, 0, NULL},
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        {0},
    };
    struct positionals rest;
    status result = command_parse(command, table, argc, argv, 1, 1, &rest, &done, err);

    (void)exit_code;
    if (result != STATUS_OK || done)
        return result;
    options.scene_index = (int)scene_index;
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
    .summary = "read a scene and tell what is in it and what it calls for",
    .description = "Read a scene file, check it, and tell its contents, the effects that rendering it calls for,\n"
                   "and what in it is not supported. Nothing is sent anywhere.",
    .run = run,
};
