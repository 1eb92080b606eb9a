/* A film that is not open, read tile by tile; what its tiles are said to have. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/system/file.h"
#include "common/base/memory.h"
#include "coordinator/pictures/tile_map.h"
#include "coordinator/film/store_film.h"
#include "protocol/azulejo.pb-c.h"
#include "protocol/channel.h"
#include "tests/support/film_data.h"
#include "tests/support/scratch_folder.h"

enum { WIDTH = 40, HEIGHT = 37, TILES = 3 * 3, SPP = 60, JOB = 7, FRAME = 3 };

static char folder[SCRATCH_PATH], kept[96], work[96];

static int make_folder(void **state)
{
    (void)state;
    scratch_folder(folder);
    snprintf(kept, sizeof kept, "%s/kept", folder);
    snprintf(work, sizeof work, "%s/work", folder);
    return 0;
}

static int remove_folder(void **state)
{
    (void)state;
    file_remove_tree(folder);
    return 0;
}

static struct render_settings settings(void)
{
    return (struct render_settings){.width = WIDTH, .height = HEIGHT, .spp = SPP};
}

/* Tiles from `first` on with this many passes of each group. */
static struct film *film_with(uint32_t first, uint32_t passes)
{
    struct film *film = film_data_new(WIDTH, HEIGHT, SPP, 0);

    for (uint32_t t = first; t < TILES; t++)
        for (uint32_t g = 0; g < GROUPS; g++)
            for (uint32_t p = 0; p < passes; p++)
                film_data_merge(film, t, g, p);
    return film;
}

static void keep(const struct film *film)
{
    struct error err = {0};

    if (film_kept_write(kept, JOB, FRAME, film, NULL, &err) != STATUS_OK)
        fail_msg("%s", err.text);
}

/* Write the tiles that have samples to a film in work. */
static void put_into_work(const struct film *film)
{
    struct film *empty = film_data_new(WIDTH, HEIGHT, SPP, 0);
    uint32_t durable[TILES][GROUPS] = {{0}};
    struct film_commit commit = {0};
    struct film_file *file;
    struct error err = {0};

    assert_int_equal(film_file_open(&file, work, JOB, FRAME, empty, durable, &err), STATUS_OK);
    for (uint32_t t = 0; t < TILES; t++)
        if (film_tile_samples(film, t) > 0)
            assert_true(film_record_state(&commit.states, film, t));
    assert_int_equal(film_file_commit(file, &commit, &err), STATUS_OK);
    buffer_release(&commit.states);
    film_file_close(file);
    film_free(empty);
}

/* Each tile as it is read is that of the film; NULL: it has no samples. */
static void check_tiles(const struct film *const from[TILES])
{
    struct render_settings s = settings();
    struct film_reader *reader;
    struct error err = {0};
    uint32_t tile;

    if (film_reader_open(&reader, kept, work, JOB, FRAME, &s, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    for (uint32_t t = 0; t < TILES; t++) {
        float have[TILE_PIXELS_MAX][4], wanted[TILE_PIXELS_MAX][4];
        const struct film *film = film_reader_film(reader);
        struct tile_rect rect = tile_rect_of(WIDTH, HEIGHT, t);
        assert_int_equal(film_reader_next(reader, &tile, &err), STATUS_OK);
        assert_int_equal(tile, t);
        assert_int_equal(film_tile_samples(film, t), from[t] ? film_tile_samples(from[t], t) : 0);
        assert_int_equal(film_tile_picture(film, t, have), from[t] != NULL);
        for (uint32_t other = 0; other < t; other++) /* it has the memory of one tile */
            assert_int_equal(film_tile_samples(film, other), 0);
        if (!from[t])
            continue;
        film_tile_picture(from[t], t, wanted);
        assert_memory_equal(have, wanted, rect.width * rect.height * sizeof *have);
    }
    assert_int_equal(film_reader_next(reader, &tile, &err), STATUS_ERR_NOT_FOUND);
    assert_int_equal(film_reader_next(reader, &tile, &err), STATUS_ERR_NOT_FOUND);
    film_reader_close(reader);
}

static void all_from(const struct film *film, const struct film *from[TILES])
{
    for (uint32_t t = 0; t < TILES; t++)
        from[t] = film_tile_samples(film, t) > 0 ? film : NULL;
}

static void kept_and_unfinished_films_are_read(void **state)
{
    struct film *few = film_with(0, 2), *more = film_with(5, 4);
    const struct film *from[TILES];

    (void)state;
    keep(few);
    all_from(few, from);
    check_tiles(from);
    put_into_work(more); /* beside it, with newer tiles from 5 on */
    for (uint32_t t = 5; t < TILES; t++)
        from[t] = more;
    check_tiles(from);
    unlink(kept);
    all_from(more, from);
    check_tiles(from);
    unlink(work);
    film_free(few);
    film_free(more);
}

static void other_frames_and_damage_are_not_shown(void **state)
{
    struct render_settings s = settings(), larger = s;
    struct film *film = film_with(0, 2);
    struct film_reader *reader;
    struct error err = {0};
    const struct film *from[TILES];
    struct stat info;
    int fd;

    (void)state;
    assert_int_equal(film_reader_open(&reader, kept, work, JOB, FRAME, &s, &err), STATUS_ERR_NOT_FOUND);
    keep(film);
    put_into_work(film);
    larger.width++;
    assert_int_equal(film_reader_open(&reader, kept, work, JOB, FRAME + 1, &s, &err), STATUS_ERR_NOT_FOUND);
    assert_int_equal(film_reader_open(&reader, kept, work, JOB, FRAME, &larger, &err), STATUS_ERR_NOT_FOUND);
    assert_null(reader);
    unlink(work);
    /* A byte of the fifth tile's sums; and the file's last tile is cut off. */
    assert_int_equal(stat(kept, &info), 0);
    fd = open(kept, O_RDWR);
    assert_true(fd >= 0);
    assert_int_equal(pwrite(fd, "\377", 1, info.st_size / 2), 1);
    assert_int_equal(ftruncate(fd, info.st_size - 5), 0);
    close(fd);
    all_from(film, from);
    from[TILES - 1] = NULL;
    for (uint32_t t = 3; t < 6; t++) /* sizes differ at the edges: one of these */
        from[t] = NULL;
    assert_int_equal(film_reader_open(&reader, kept, work, JOB, FRAME, &s, &err), STATUS_OK);
    for (uint32_t t = 0, damaged = 0; t < TILES; t++) {
        uint32_t tile, samples;
        assert_int_equal(film_reader_next(reader, &tile, &err), STATUS_OK);
        samples = film_tile_samples(film_reader_film(reader), tile);
        damaged += samples == 0;
        if (from[t])
            assert_int_equal(samples, film_tile_samples(film, t));
        if (t == TILES - 1)
            assert_int_equal(damaged, 2);
    }
    film_reader_close(reader);
    unlink(kept);
    film_free(film);
}

/* ---- what tiles have ------------------------------------------------------------------------- */

static void cells_say_what_tiles_have(void **state)
{
    struct film *film = film_with(1, 3);
    struct tile_map map;
    struct error err = {0};

    (void)state;
    film_note_cost(film, 2, 0, 0, 5, 1000);
    film_note_cost(film, 2, 1, 2, 6, 500);
    assert_int_equal(tile_map_new(&map, WIDTH, HEIGHT, 0, &err), STATUS_OK);
    assert_int_equal(map.count, TILES);
    for (uint32_t t = 0; t < TILES; t++)
        assert_int_equal(tile_map_take(&map, film, t, &err), STATUS_OK);
    assert_int_equal(map.cells[0].samples, 0);
    assert_int_equal(map.cells[0].worker, 0);
    assert_true(isnan(map.cells[0].error));
    assert_int_equal(map.cells[2].samples, film_tile_samples(film, 2));
    assert_int_equal(map.cells[2].units, 6);
    assert_int_equal(map.cells[2].passes, 3);
    assert_int_equal(map.cells[2].thread, 6);
    assert_int_equal(map.cells[2].cpu_ns, 1500);
    assert_int_equal(map.workers[map.cells[2].worker - 1].number, film_deliverer(film, 2, 1, 2));
    assert_true(map.cells[2].error > 0);
    tile_map_release(&map);
    assert_int_equal(tile_map_new(&map, 65536, 65536 / 8, 0, &err), STATUS_ERR_LIMIT);
    film_free(film);
}

static void send_unit(struct film *film, uint32_t group, uint32_t pass, uint32_t deliverer, uint32_t thread)
{
    float sums[TILE_FLOATS_MAX];
    struct unit_result unit = film_data_unit(film, 4, group, pass, sums);
    enum film_merge_result result;

    assert_int_equal(film_merge(film, &unit, deliverer, &result, NULL), STATUS_OK);
    film_note_cost(film, 4, group, pass, thread, 1000);
}

static void check_share(const struct tile_map *map, uint32_t i, const char *label, uint32_t thread, uint32_t units,
                        uint32_t samples)
{
    const struct tile_share *share = &map->shares[map->cells[4].first_share + i];

    assert_true(i < map->cells[4].share_count);
    assert_string_equal(map->workers[share->worker - 1].label, label);
    assert_int_equal(share->thread, thread);
    assert_int_equal(share->units, units);
    assert_int_equal(share->samples, samples);
}

static void shares_say_who_sent_what(void **state)
{
    struct film *film = film_data_new(WIDTH, HEIGHT, SPP, 0);
    struct tile_map map;
    struct error err = {0};

    (void)state;
    /* Passes 0 to 3 have 2, 2, 4 and 8 samples. Ana is 5, and 9 after she connected again; Rui is 6. */
    send_unit(film, 0, 0, 6, 1);
    send_unit(film, 1, 0, 5, 2);
    send_unit(film, 0, 1, 5, 2);
    send_unit(film, 1, 1, 9, 2);
    send_unit(film, 0, 2, 9, 1);
    send_unit(film, 1, 2, 6, 3);
    send_unit(film, 0, 3, 6, 1);
    assert_int_equal(tile_map_new(&map, WIDTH, HEIGHT, 1, &err), STATUS_OK);
    for (uint32_t t = 0; t < TILES; t++)
        assert_int_equal(tile_map_take(&map, film, t, &err), STATUS_OK);
    assert_int_equal(map.worker_count, 3);
    for (uint32_t i = 0; i < map.worker_count; i++) {
        struct deliverer *worker = &map.workers[i];
        worker->process = worker->number; /* it was started again, under its name */
        snprintf(worker->host, sizeof worker->host, "lab");
        snprintf(worker->label, sizeof worker->label, "%s", worker->number == 6 ? "rui" : "ana");
    }
    assert_int_equal(tile_map_join(&map, &err), STATUS_OK);
    assert_int_equal(map.worker_count, 2);
    assert_int_equal(map.cells[0].share_count, 0);
    assert_int_equal(map.cells[4].share_count, 4);
    check_share(&map, 0, "rui", 1, 2, 2 + 8);
    check_share(&map, 1, "rui", 3, 1, 4);
    check_share(&map, 2, "ana", 2, 3, 2 + 2 + 2);
    check_share(&map, 3, "ana", 1, 1, 4);
    assert_string_equal(map.workers[map.cells[4].worker - 1].label, "rui");
    assert_int_equal(map.workers[map.shares[map.cells[4].first_share + 2].worker - 1].process, 9);
    tile_map_release(&map);
    film_free(film);
}

/* Both sent as much: the tile is of the one with the older unit. */
static void equal_shares_go_to_the_older_unit(void **state)
{
    struct film *film = film_data_new(WIDTH, HEIGHT, SPP, 0);
    struct tile_map map;
    struct error err = {0};

    (void)state;
    send_unit(film, 1, 0, 5, 1);
    send_unit(film, 0, 0, 6, 1);
    assert_int_equal(tile_map_new(&map, WIDTH, HEIGHT, 1, &err), STATUS_OK);
    assert_int_equal(tile_map_take(&map, film, 4, &err), STATUS_OK);
    for (uint32_t i = 0; i < map.worker_count; i++)
        snprintf(map.workers[i].label, sizeof map.workers[i].label, "%s", map.workers[i].number == 6 ? "rui" : "ana");
    assert_int_equal(tile_map_join(&map, &err), STATUS_OK);
    check_share(&map, 0, "rui", 1, 1, 2);
    check_share(&map, 1, "ana", 1, 1, 2);
    tile_map_release(&map);
    film_free(film);
}

/* Workers that are not known any more are not taken for one another. */
static void unknown_workers_stay_apart(void **state)
{
    struct film *film = film_data_new(WIDTH, HEIGHT, SPP, 0);
    struct tile_map map;
    struct error err = {0};

    (void)state;
    send_unit(film, 0, 0, 5, 1);
    send_unit(film, 1, 0, 6, 1);
    assert_int_equal(tile_map_new(&map, WIDTH, HEIGHT, 1, &err), STATUS_OK);
    assert_int_equal(tile_map_take(&map, film, 4, &err), STATUS_OK);
    assert_int_equal(tile_map_join(&map, &err), STATUS_OK);
    assert_int_equal(map.worker_count, 2);
    assert_int_equal(map.cells[4].share_count, 2);
    tile_map_release(&map);
    film_free(film);
}

/* The largest frame, every tile shared by 60 threads: what is kept fits into one message, and each tile has its owner. */
static void the_largest_frame_fits_into_a_message(void **state)
{
    enum { SHARES = 8, WORKERS = 30, SIDE = 4096 };
    Azulejo__Wire__FrameTile tile = AZULEJO__WIRE__FRAME_TILE__INIT;
    Azulejo__Wire__FrameShare share = AZULEJO__WIRE__FRAME_SHARE__INIT, *shares[SHARES];
    struct tile_map map;
    struct error err = {0};
    size_t bytes = 0;

    (void)state;
    assert_int_equal(tile_map_new(&map, SIDE, SIDE, 1, &err), STATUS_OK);
    assert_int_equal(map.count, TILE_MAP_TILES_MAX);
    assert_true(MEM_GROW(map.shares, map.share_capacity, (size_t)map.count * SHARES));
    assert_true(MEM_GROW(map.workers, map.worker_capacity, WORKERS));
    memset(map.workers, 0, WORKERS * sizeof *map.workers);
    map.worker_count = WORKERS;
    for (uint32_t t = 0; t < map.count; t++) {
        map.cells[t].first_share = (uint32_t)map.share_count;
        map.cells[t].share_count = SHARES;
        for (uint32_t i = 0; i < SHARES; i++)
            map.shares[map.share_count++] = (struct tile_share){1 + (t + i) % WORKERS, 300, 20, 100 + i};
    }
    assert_int_equal(tile_map_join(&map, &err), STATUS_OK);
    tile.samples = tile.error = 1;
    tile.cpu_ns = (uint64_t)1 << 44;
    tile.units = tile.passes = 300;
    tile.worker = tile.thread = 300;
    tile.shares = shares;
    share.worker = share.thread = share.units = 300;
    share.samples = 1 << 20;
    for (uint32_t i = 0; i < SHARES; i++)
        shares[i] = &share;
    for (uint32_t t = 0; t < map.count; t++) {
        assert_true(map.cells[t].share_count > 0);
        assert_int_equal(map.shares[map.cells[t].first_share].samples, 100 + SHARES - 1);
        tile.n_shares = map.cells[t].share_count;
        bytes += 3 + azulejo__wire__frame_tile__get_packed_size(&tile);
    }
    assert_true(bytes < CHANNEL_FRAME_MAX - (256 << 10)); /* which the workers' names may take */
    tile_map_release(&map);
}

/* Replicates that differ by a known number of codes: the film's display shows 255 codes for radiance 1. */
static void linear_codes(void *user, const float *rgb, uint32_t count, float *codes)
{
    (void)user;
    for (uint32_t i = 0; i < 3 * count; i++)
        codes[i] = rgb[i] * 255;
}

static void errors_are_of_the_mean_of_both_groups(void **state)
{
    enum { PIXELS = 256 };
    const struct film_codes codes = {linear_codes, NULL};
    struct film *film = film_new(16, 16, 16);
    static float sums[PIXELS * PIXEL_FLOATS];
    enum film_merge_result result;
    double first = 0, both;

    (void)state;
    film_freeze(film, 0, &codes);
    film_freeze(film, 1, &codes);
    film_want_all(film);
    /* Passes 0 and 1, two samples each, whose means are 0.5 and 0.5 + 8 / 255. */
    for (uint32_t n = 0; n < 2 * GROUPS; n++) {
        struct unit_result unit = {.group = n / 2, .pass = n % 2, .sums = sums, .count = PIXELS * PIXEL_FLOATS,
                                   .work = {.samples = 2 * PIXELS}};
        for (uint32_t i = 0; i < PIXELS * PIXEL_FLOATS; i++)
            sums[i] = n % 2 ? 1 + 16.0f / 255 : 1;
        assert_int_equal(film_merge(film, &unit, 1, &result, NULL), STATUS_OK);
        if (n == 0)
            assert_true(isnan(tile_map_error(film, 0))); /* one pass has no halves */
        if (n == 1)
            first = tile_map_error(film, 0);
    }
    both = tile_map_error(film, 0);
    assert_true(fabs(first - 4) < 1e-3); /* half of the halves' difference */
    assert_true(fabs(both - 4 / sqrt(2)) < 1e-3);
    film_free(film);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(kept_and_unfinished_films_are_read),
        cmocka_unit_test(other_frames_and_damage_are_not_shown),
        cmocka_unit_test(cells_say_what_tiles_have),
        cmocka_unit_test(shares_say_who_sent_what),
        cmocka_unit_test(equal_shares_go_to_the_older_unit),
        cmocka_unit_test(unknown_workers_stay_apart),
        cmocka_unit_test(the_largest_frame_fits_into_a_message),
        cmocka_unit_test(errors_are_of_the_mean_of_both_groups),
    };
    return cmocka_run_group_tests_name("film_reader", tests, make_folder, remove_folder);
}
