/* azulejo verify: random tiles of a job's pictures are rendered again and compared. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>

#include "client/commands/command.h"
#include "client/farm/job_choice.h"
#include "client/farm/owners.h"
#include "client/farm/tile_again.h"
#include "client/follow/fetch.h"
#include "client/follow/job_info.h"
#include "client/terminal/must.h"
#include "common/accuracy/schedule.h"
#include "common/base/memory.h"
#include "common/system/file.h"
#include "protocol/message.h"

enum { TILES_DEFAULT = 16, TILES_MAX = 1 << 20, EXIT_DIFFERS = 12 };

struct place {
    uint32_t frame, tile;
};

struct verify {
    int64_t tiles, frame; /* frame -1: all that are done */
    int json;
    const char *path; /* the picture; NULL: those of the coordinator */
    struct buffer file;
    struct connection *connection;
    const Azulejo__Wire__JobInfo *job;
    struct render_settings settings;
    json_t *list;
    uint32_t checked, differ, same_worker;
};

/* ---- a picture's file --------------------------------------------------------------------------- */

/* A text of the picture's header, which azulejo wrote. */
static status header(const struct verify *v, const char *attribute, struct buffer *out, struct error *err)
{
    status s = exr_read_text(out, v->file.data, v->file.size, v->path, attribute, err);

    return s != STATUS_ERR_NOT_FOUND ? s
                                     : error_set(err, STATUS_ERR_INPUT, "%s: no picture of azulejo (its header has no %s)",
                                                 v->path, attribute);
}

/* Which job's and frame's picture is it? */
static status read_picture(struct verify *v, char job[32], struct error *err)
{
    struct buffer measured = BUFFER_INIT;
    double frame = 0;
    json_t *document = NULL;
    status s = file_read(v->path, IMAGE_BYTES_MAX, &v->file, err);

    THEN(s, header(v, "azulejo:measured", &measured, err));
    THEN(s, exr_read_number(&frame, v->file.data, v->file.size, v->path, "azulejo:frame", err));
    if (s == STATUS_OK) {
        document = json_loads(buffer_text(&measured), 0, NULL);
        snprintf(job, 32, "%" PRId64, (int64_t)json_integer_value(json_object_get(document, "job")));
        if (v->frame >= 0 && v->frame != (int64_t)frame)
            s = error_set(err, STATUS_ERR_USAGE, "%s is a picture of frame %.0f: leave --frame out", v->path, frame);
        v->frame = (int64_t)frame;
    }
    json_decref(document);
    buffer_release(&measured);
    return s;
}

/* Another farm has other jobs of that number. */
static status check_scene(const struct verify *v, struct error *err)
{
    struct buffer scene = BUFFER_INIT;
    char hex[DIGEST_HEX_SIZE];
    struct digest is;
    status s = header(v, "azulejo:scene", &scene, err);

    THEN(s, wire_digest_get(&is, &v->job->scene, "the scene", err));
    if (s == STATUS_OK) {
        digest_to_hex(&is, hex);
        if (strcmp(hex, buffer_text(&scene)) != 0)
            s = error_set(err, STATUS_ERR_NOT_FOUND,
                          "%s is a picture of another scene than job %" PRIu64 " of this farm: ask the farm that rendered it "
                          "(--coordinator), as long as that keeps the job", v->path, v->job->job);
    }
    buffer_release(&scene);
    return s;
}

/* ---- which tiles ------------------------------------------------------------------------------------ */

static int by_place(const void *one, const void *other)
{
    const struct place *a = one, *b = other;

    if (a->frame != b->frame)
        return a->frame < b->frame ? -1 : 1;
    return a->tile < b->tile ? -1 : a->tile > b->tile;
}

static uint64_t draw(uint64_t below)
{
    uint64_t number = 0;

    while (getrandom(&number, sizeof number, 0) != sizeof number)
        ;
    return number % below;
}

/* The frames that are done, ascending; the caller frees them. */
static status list_frames(const struct verify *v, uint32_t **out, size_t *count, struct error *err)
{
    *count = 0;
    *out = must(mem_alloc_array((size_t)v->job->last_frame - v->job->first_frame + 1, sizeof **out));
    for (uint64_t f = v->job->first_frame; f <= v->job->last_frame; f++)
        if ((v->frame < 0 || (uint64_t)v->frame == f) && job_frame_listed(v->job, &v->job->done, (uint32_t)f))
            (*out)[(*count)++] = (uint32_t)f;
    if (*count > 0)
        return STATUS_OK;
    return v->frame >= 0 ? error_set(err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 ", frame %" PRId64 " is not finished",
                                     v->job->job, v->frame)
                         : error_set(err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 " has no finished frame", v->job->job);
}

/* So many different tiles of them, by lot; the caller frees them. */
static struct place *draw_tiles(const struct verify *v, const uint32_t *frames, size_t frame_count, size_t *count)
{
    uint32_t tiles = tile_count(v->settings.width, v->settings.height);
    uint64_t all = (uint64_t)tiles * frame_count;
    struct place *places;
    uint64_t taken = 0;

    *count = (uint64_t)v->tiles < all ? (size_t)v->tiles : (size_t)all;
    places = must(mem_alloc_array(*count, sizeof *places));
    if (*count > all / 2) { /* each with the odds of being among the rest */
        for (uint64_t i = 0; i < all && taken < *count; i++)
            if (draw(all - i) < *count - taken)
                places[taken++] = (struct place){frames[i / tiles], (uint32_t)(i % tiles)};
        return places;
    }
    while (taken < *count) {
        uint64_t at = draw(all), k = 0;
        const struct place p = {frames[at / tiles], (uint32_t)(at % tiles)};
        while (k < taken && by_place(&places[k], &p) != 0)
            k++;
        if (k == taken)
            places[taken++] = p;
    }
    qsort(places, *count, sizeof *places, by_place);
    return places;
}

/* ---- a frame -------------------------------------------------------------------------------------- */

struct frame_again {
    uint32_t number;
    struct image picture;
    Azulejo__Wire__Envelope *map; /* who rendered it; NULL: its film was not kept */
};

static int has_rules(const Azulejo__Wire__StopRules *stop)
{
    struct stop_rules rules;
    struct error ignored = {0};

    return wire_stop_get(&rules, stop, &ignored) == STATUS_OK && stop_ends_a_frame(&rules);
}

static status open_map(const struct verify *v, struct frame_again *f, struct error *err)
{
    Azulejo__Wire__FrameTilesGet get = AZULEJO__WIRE__FRAME_TILES_GET__INIT;
    Azulejo__Wire__Envelope question = MESSAGE(FRAME_TILES_GET, frame_tiles_get, &get);
    struct error why = {0};
    status s;

    get.job = v->job->job;
    get.frame = f->number;
    get.shares = 1;
    s = connection_ask(v->connection, &question, AZULEJO__WIRE__ENVELOPE__BODY_FRAME_TILES, &f->map, &why);
    if (s == STATUS_OK && f->map->frame_tiles->n_tiles != tile_count(v->settings.width, v->settings.height))
        return error_set(err, STATUS_ERR_PROTOCOL, "frame %u came with %zu tiles", f->number, f->map->frame_tiles->n_tiles);
    if (s == STATUS_ERR_NOT_FOUND && !has_rules(v->job->stop) && v->job->n_cut_frames == 0)
        return STATUS_OK; /* all of its tiles have all samples */
    if (s == STATUS_ERR_NOT_FOUND)
        return error_set(err, s, "job %" PRIu64 ", frame %u: its film was not kept, so how many samples its tiles have is not "
                         "known: verify another frame, or render it again", v->job->job, f->number);
    return s == STATUS_OK ? s : error_set(err, s, "%s", why.text);
}

static status open_frame(const struct verify *v, uint32_t number, struct frame_again *f, struct error *err)
{
    struct buffer data = BUFFER_INIT;
    status s = STATUS_OK;

    *f = (struct frame_again){.number = number};
    if (!v->path)
        s = fetch_output(v->connection, v->job->job, number, AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EXR, &data, err);
    if (s == STATUS_ERR_NOT_FOUND && v->job->output && !(output_message_formats(v->job->output) & OUTPUT_FORMAT_EXR))
        error_set(err, s, "job %" PRIu64 " makes no EXR, which tiles are compared with", v->job->job);
    if (s == STATUS_OK)
        s = exr_decode(&f->picture, v->path ? v->file.data : data.data, v->path ? v->file.size : data.size,
                       v->path ? v->path : "the picture", err);
    if (s == STATUS_OK && (f->picture.width != v->settings.width || f->picture.height != v->settings.height))
        s = error_set(err, STATUS_ERR_INPUT, "%s has %ux%u pixels, and the job's frames have %ux%u: it was changed since",
                      v->path ? v->path : "the picture", f->picture.width, f->picture.height, v->settings.width,
                      v->settings.height);
    THEN(s, open_map(v, f, err));
    buffer_release(&data);
    return s;
}

static void close_frame(struct frame_again *f)
{
    image_release(&f->picture);
    message_free(f->map);
    *f = (struct frame_again){0};
}

/* ---- what is said ----------------------------------------------------------------------------------- */

static json_t *names_json(const struct tile_again *t, int now)
{
    json_t *names = json_array();

    for (uint32_t i = 0; now ? i < t->by_count : tile_again_maker(t, i)[0] != 0; i++)
        json_array_append_new(names, json_text(now ? t->by[i] : tile_again_maker(t, i)));
    return names;
}

static void print_names(const struct tile_again *t, int now)
{
    uint32_t i = 0;

    for (; now ? i < t->by_count : tile_again_maker(t, i)[0] != 0; i++)
        printf("%s%s", i ? ", " : "", now ? t->by[i] : tile_again_maker(t, i));
    if (i == 0)
        printf("a worker that is not known");
}

static void tell(struct verify *v, const struct tile_again *t)
{
    v->checked++;
    v->differ += t->pixels_differ > 0;
    v->same_worker += t->same_worker != 0;
    if (v->json) {
        json_array_append_new(
            v->list,
            json_pack("{s:I, s:I, s:I, s:I, s:I, s:I, s:b, s:I, s:f, s:o, s:o, s:b}", "frame", (json_int_t)t->frame,
                      "tile", (json_int_t)t->tile, "x", (json_int_t)t->rect.x, "y", (json_int_t)t->rect.y, "width",
                      (json_int_t)t->rect.width, "height", (json_int_t)t->rect.height, "differs", t->pixels_differ > 0,
                      "pixels_differ", (json_int_t)t->pixels_differ, "largest_difference", t->most, "rendered_by",
                      names_json(t, 0), "verified_by", names_json(t, 1), "same_worker", t->same_worker));
        return;
    }
    if (t->pixels_differ == 0)
        return;
    printf("frame %u, tile %u (x %u to %u, y %u to %u) differs in %u of %u pixels, by up to %.3g: rendered by ",
           t->frame, t->tile, t->rect.x, t->rect.x + t->rect.width - 1, t->rect.y, t->rect.y + t->rect.height - 1,
           t->pixels_differ, t->rect.width * t->rect.height, t->most);
    print_names(t, 0);
    printf("; now by ");
    print_names(t, 1);
    printf("\n");
}

static status conclude(struct verify *v, int *exit_code, struct error *err)
{
    if (v->differ > 0)
        *exit_code = EXIT_DIFFERS;
    if (v->json)
        return json_print(json_pack("{s:I, s:I, s:I, s:I, s:O}", "job", (json_int_t)v->job->job, "tiles_checked",
                                    (json_int_t)v->checked, "tiles_differ", (json_int_t)v->differ, "tiles_same_worker",
                                    (json_int_t)v->same_worker, "tiles", v->list), err);
    printf("job %" PRIu64 ": %u tile%s rendered again, %u differ%s\n", v->job->job, v->checked, v->checked == 1 ? "" : "s",
           v->differ, v->differ == 1 ? "s" : "");
    if (v->same_worker > 0)
        printf("%u of them by a worker that had rendered them before: another machine would tell more\n", v->same_worker);
    if (v->differ > 0)
        printf("'azulejo distrust WORKER' renders again what a worker delivered; where no worker is at fault, the file was changed: "
               "fetch it again\n");
    return STATUS_OK;
}

/* ---- doing it -------------------------------------------------------------------------------------- */

static status check_tile(struct verify *v, const struct frame_again *f, uint32_t tile, struct error *err)
{
    const struct render_settings *s = &v->settings;
    struct tile_again t = {.job = v->job->job, .frame = f->number, .tile = tile,
                           .map = f->map ? f->map->frame_tiles : NULL, .rect = tile_rect_of(s->width, s->height, tile)};
    struct film *film = must(film_new_aovs(s->width, s->height, s->spp, s->aovs));
    status result = STATUS_OK;

    film_measure_from(film, LEVELS_MAX);
    for (uint32_t g = 0; g < GROUPS; g++) {
        film_freeze(film, g, NULL);
        t.passes[g] = t.map && t.map->tiles[tile]->n_group_passes == GROUPS ? t.map->tiles[tile]->group_passes[g]
                                                                            : film_pass_count(film, g);
        if (t.passes[g] > film_pass_count(film, g))
            result = error_set(err, STATUS_ERR_PROTOCOL, "tile %u came with %u passes", tile, t.passes[g]);
    }
    THEN(result, tile_again_render(v->connection, &t, film, err));
    THEN(result, tile_again_compare(&t, film, &f->picture, v->job->output && v->job->output->exr_half, err));
    if (result == STATUS_OK)
        tell(v, &t);
    film_free(film);
    return result;
}

static status check_tiles(struct verify *v, struct error *err)
{
    struct frame_again f = {0};
    uint32_t *frames = NULL;
    struct place *places = NULL;
    size_t frame_count, count = 0;
    status s = list_frames(v, &frames, &frame_count, err);

    if (s == STATUS_OK)
        places = draw_tiles(v, frames, frame_count, &count);
    for (size_t i = 0; i < count && s == STATUS_OK; i++) {
        if (i == 0 || places[i].frame != places[i - 1].frame) {
            close_frame(&f);
            s = open_frame(v, places[i].frame, &f, err);
        }
        THEN(s, check_tile(v, &f, places[i].tile, err));
    }
    close_frame(&f);
    mem_free(places);
    mem_free(frames);
    return s;
}

static int is_picture(const char *text)
{
    size_t length = strlen(text);

    return length > 4 && strcmp(text + length - 4, ".exr") == 0;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code, struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct verify v = {.tiles = TILES_DEFAULT, .frame = -1, .file = BUFFER_INIT};
    const struct option table[] = {
        {"tiles", 't', OPTION_INT, &v.tiles, "N", "how many tiles, by lot over all finished frames (default 16)", 1, TILES_MAX,
         NULL},
        {"frame", 0, OPTION_INT, &v.frame, "N", "only tiles of this frame", 0, INT32_MAX, NULL},
        {"json", 0, OPTION_FLAG, &v.json, NULL, "print JSON, with all tiles", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    Azulejo__Wire__Envelope *answer = NULL;
    char of_picture[32] = "";
    struct positionals rest;
    const char *word;
    uint64_t job = 0;
    int done;
    status s = command_parse(command, table, argc, argv, 1, 1, &rest, &done, err);

    if (s != STATUS_OK || done)
        return s;
    word = rest.items[0];
    if (is_picture(word)) {
        v.path = word;
        s = read_picture(&v, of_picture, err);
        word = of_picture;
    }
    THEN(s, job_word_check(word, err));
    THEN(s, connection_open(&v.connection, &where, err));
    THEN(s, job_word_find(v.connection, word, &job, err));
    THEN(s, job_query(v.connection, job, &answer, err));
    if (s == STATUS_OK) {
        v.job = job_list_find(answer->job_list, job);
        v.list = json_array();
        s = wire_settings_get(&v.settings, v.job->settings, UINT32_MAX, err);
        if (s == STATUS_OK && v.path)
            s = check_scene(&v, err);
        THEN(s, check_tiles(&v, err));
        THEN(s, conclude(&v, exit_code, err));
    }
    json_decref(v.list);
    message_free(answer);
    connection_close(v.connection);
    buffer_release(&v.file);
    return s;
}

const struct command command_verify = {
    .name = "verify",
    .group = COMMAND_JOBS,
    .usage = "azulejo verify JOB|PICTURE.exr [--tiles N] [OPTION]...",
    .summary = "render random tiles again and compare them",
    .description =
        "Render some tiles of a job's finished frames again, on other workers than those that rendered them where there\n"
        "are such, and compare them with the pictures, bit for bit: those on the coordinator, or a file that was fetched.\n"
        "The farm must still have the job. Each tile that differs is named, with the workers that rendered it; the exit\n"
        "status is 12 then.",
    .run = run,
};
