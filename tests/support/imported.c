#include "tests/support/imported.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/film/film.h"

static _Noreturn void give_up(const char *name, const char *why)
{
    fprintf(stderr, "imported: %s: %s\n", name, why);
    abort();
}

static status find_blob(void *user, const struct digest *digest, const uint8_t **data, size_t *size_bytes,
                        struct error *err)
{
    const struct import_result *import = user;

    for (size_t i = 0; i < import->blob_count; i++)
        if (digest_equal(&import->blobs[i].digest, digest)) {
            *data = import->blobs[i].data;
            *size_bytes = import->blobs[i].size_bytes;
            return STATUS_OK;
        }
    return error_set(err, STATUS_ERR_NOT_FOUND, "a blob is missing");
}

struct blob_source imported_source(struct import_result *import) { return (struct blob_source){find_blob, import}; }

static void expect_no_warning(const struct import_result *import, const char *name)
{
    if (import->warning_count > 0)
        give_up(name, import->warnings[0]);
}

void imported_file(const char *path, struct import_result *import)
{
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct error err = {0};

    if (import_scene(path, &options, import, &err) != STATUS_OK)
        give_up(path, err.text);
    expect_no_warning(import, path);
}

void imported_file_under(const char *path, const char *env, struct import_result *import)
{
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct error err = {0};

    options.env_path = env;
    if (import_scene(path, &options, import, &err) != STATUS_OK)
        give_up(path, err.text);
}

void imported_text(const char *text, const char *name, const char *folder, struct import_result *import)
{
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct error err = {0};

    if (import_scene_memory(text, strlen(text), name, folder, &options, import, &err) != STATUS_OK)
        give_up(name, err.text);
    expect_no_warning(import, name);
}

struct render_scene *imported_build(struct import_result *import, const struct render_settings *settings,
                                    uint32_t frame)
{
    struct render_scene *out;
    struct error err = {0};

    if (scene_validate(&import->scene, &err) != STATUS_OK ||
        render_scene_new(&out, &import->scene, settings, frame, imported_source(import), &err) != STATUS_OK)
        give_up(import->source, err.text);
    return out;
}

struct render_settings imported_settings(uint32_t width, uint32_t height, uint32_t spp)
{
    struct render_settings s;

    render_settings_default(&s);
    s.width = width;
    s.height = height;
    s.spp = spp;
    s.seed = 1;
    if (!(isa_supported_mask() >> s.isa & 1))
        s.isa = ISA_SSE2;
    return s;
}

void imported_render_tile(const struct render_scene *scene, uint32_t frame, uint32_t tile, struct film *film,
                          struct render_stats *stats)
{
    struct error err = {0};

    for (uint32_t g = 0; g < GROUPS; g++)
        for (uint32_t pass = 0; pass < film_pass_count(film, g); pass++) {
            float sums[TILE_FLOATS_MAX];
            struct unit_result unit = {.tile = tile, .group = g, .pass = pass, .sums = sums};
            enum film_merge_result merged;
            unit.count = render_tile(scene, frame, tile, g, pass, sums, &unit.tail, stats);
            if (film_merge(film, &unit, 0, &merged, &err) != STATUS_OK)
                give_up("film", err.text);
        }
}

void imported_want_film(struct film *film)
{
    film_want_all(film);
    for (uint32_t g = 0; g < GROUPS; g++)
        film_freeze(film, g, NULL);
}

void imported_render_film(const struct render_scene *scene, uint32_t frame, struct film *film,
                          struct render_stats *stats)
{
    imported_want_film(film);
    for (uint32_t tile = 0; tile < film_tile_count(film); tile++)
        imported_render_tile(scene, frame, tile, film, stats);
}

void imported_render_scene(const struct render_scene *scene, const struct render_settings *settings, uint32_t frame,
                           float *picture)
{
    struct film *film = film_new(settings->width, settings->height, settings->spp);
    struct render_stats stats = {0};

    if (!film)
        give_up("film", "out of memory");
    imported_render_film(scene, frame, film, &stats);
    if (stats.work.dropped_samples > 0)
        give_up("render", "samples that are not finite");
    film_develop(film, picture);
    film_free(film);
}

void imported_render(struct import_result *import, const struct render_settings *settings, uint32_t frame,
                     float *picture)
{
    struct render_scene *scene = imported_build(import, settings, frame);

    imported_render_scene(scene, settings, frame, picture);
    render_scene_free(scene);
}
