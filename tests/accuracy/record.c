/* record: the units of a scene for given seeds, in one file (tests/support/recording.h).
 *
 *   record SCENE --out FILE [--size WxH] [--spp N] [--seeds N] [--first-seed N] [--frame N]
 *          [--env FILE] [--env-strength X] [--max-depth N]
 *
 * One thread: run several over ranges of seeds. */
#include <stdio.h>
#include <stdlib.h>

#include "client/import/import.h"
#include "common/cli/options.h"
#include "tests/support/imported.h"
#include "tests/support/recording.h"

static _Noreturn void die(const struct error *err)
{
    fprintf(stderr, "record: %s\n", err->text);
    exit(status_exit_code(err->code));
}

static void put(FILE *file, const void *data, size_t size_bytes)
{
    if (fwrite(data, 1, size_bytes, file) != size_bytes) {
        perror("record: write");
        exit(1);
    }
}

static void record_seed(const struct render_scene *scene, const struct render_settings *settings,
                        const struct record_header *header, uint32_t seed, uint32_t frame, FILE *file)
{
    static struct record_unit unit;

    for (uint32_t pass = 0; pass < header->passes; pass++)
        for (uint32_t group = 0; group < RECORD_GROUPS; group++)
            for (uint32_t tile = 0; tile < header->tiles; tile++) {
                uint32_t begin, end, cap = (header->spp + 1 - group) / RECORD_GROUPS;
                record_pass_range(pass, &begin, &end);
                if (begin >= cap)
                    continue;
                record_render(scene, settings, seed, frame, tile, group, begin, end < cap ? end : cap, &unit);
                unit.head.pass = pass;
                put(file, &unit.head, sizeof unit.head);
                put(file, unit.sums, (size_t)unit.head.pixels * 3 * sizeof *unit.sums);
                put(file, unit.tail, unit.head.tail_count * sizeof *unit.tail);
            }
}

int main(int argc, char **argv)
{
    const char *out = NULL, *size = "64x64", *env = NULL;
    int64_t spp = 256, seeds = 1, first = 1, frame = 0, depth = -1;
    double strength = 1;
    int help = 0;
    const struct option table[] = {
        {"out", 0, OPTION_STRING, &out, "FILE", "where to write", 0, 0, NULL},
        {"size", 0, OPTION_STRING, &size, "WxH", "pixels; default: 64x64", 0, 0, NULL},
        {"spp", 0, OPTION_INT, &spp, "N", "samples of a pixel over both groups", 1, SETTINGS_SPP_MAX, NULL},
        {"seeds", 0, OPTION_INT, &seeds, "N", "how many", 1, 1000000, NULL},
        {"first-seed", 0, OPTION_INT, &first, "N", "the first of them", 0, 1000000, NULL},
        {"frame", 0, OPTION_INT, &frame, "N", "of an animation", 0, SETTINGS_FRAMES_MAX, NULL},
        {"env", 0, OPTION_STRING, &env, "FILE", "environment map", 0, 0, NULL},
        {"env-strength", 0, OPTION_REAL, &strength, "X", "factor of the environment", 0, 1e9, NULL},
        {"max-depth", 0, OPTION_INT, &depth, "N", "path depth", 0, SETTINGS_DEPTH_MAX, NULL},
        {0},
    };
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct record_header header = {.magic = RECORD_MAGIC};
    struct import_result import;
    struct render_settings settings;
    struct render_scene *scene;
    struct positionals rest;
    struct error err = {0};
    FILE *file;

    if (options_parse(table, argc, argv, &rest, &help, &err) != STATUS_OK)
        die(&err);
    if (help || rest.count != 1 || !out ||
        sscanf(size, "%ux%u", &header.width, &header.height) != 2) {
        options_print_help("record SCENE --out FILE [options]", "Records units.", table);
        return help ? 0 : 2;
    }
    options.env_path = env;
    if (import_scene(rest.items[0], &options, &import, &err) != STATUS_OK)
        die(&err);
    settings = imported_settings(header.width, header.height, (uint32_t)spp);
    settings.env_strength = (float)strength;
    if (depth >= 0)
        settings.max_depth = (uint32_t)depth;
    render_force_general(1);
    scene = imported_build(&import, &settings, (uint32_t)frame);
    header.spp = (uint32_t)spp;
    header.seeds = (uint32_t)seeds;
    header.tiles = tile_count(header.width, header.height);
    for (uint32_t begin, end;; header.passes++) {
        record_pass_range(header.passes, &begin, &end);
        if (begin >= (header.spp + 1) / RECORD_GROUPS)
            break;
    }
    file = fopen(out, "wb");
    if (!file) {
        perror(out);
        return 1;
    }
    put(file, &header, sizeof header);
    for (int64_t i = 0; i < seeds; i++)
        record_seed(scene, &settings, &header, (uint32_t)(first + i), (uint32_t)frame, file);
    if (fclose(file) != 0) {
        perror(out);
        return 1;
    }
    render_scene_free(scene);
    import_result_release(&import);
    return 0;
}
