/* A film in work: records that are only appended. Cut anywhere, damaged anywhere, cleaned and killed anywhere, it has
 * everything before and nothing wrong; what it writes and what room it takes are bounded. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/system/file.h"
#include "coordinator/film/store_film.h"
#include "tests/support/film_data.h"
#include "tests/support/scratch_folder.h"

enum { JOB = 7, FRAME = 3, TILES_MAX = 1024, LEVEL_BYTES = 180 };

static char folder[SCRATCH_PATH], work[96], copy[96], kept[96];

static int make_folder(void **state)
{
    (void)state;
    scratch_folder(folder);
    snprintf(work, sizeof work, "%s/work", folder);
    snprintf(copy, sizeof copy, "%s/copy", folder);
    snprintf(kept, sizeof kept, "%s/kept", folder);
    return 0;
}

static int remove_folder(void **state)
{
    (void)state;
    file_remove_tree(folder);
    return 0;
}

/* A frame, as a farm has it. */
struct frame {
    struct film *film;
    struct film_file *file;
    struct film_commit commit;
    uint32_t durable[TILES_MAX][GROUPS];
    uint64_t received; /* bytes of results */
};

static void note_fold(void *user, const struct film_fold *fold)
{
    struct frame *f = user;

    assert_true(film_record_unit(&f->commit.units, fold));
    /* On the wire, too, it is this, without statistics of levels. */
    f->received += film_unit_size(fold) - (fold->level ? LEVEL_BYTES : 0);
}

static uint32_t measure_from; /* film_measure_from */

static struct frame *open_frame(const char *path, uint32_t width, uint32_t height, uint32_t spp, uint32_t aovs)
{
    struct frame *f = calloc(1, sizeof *f);
    struct error err = {0};

    assert_non_null(f);
    f->film = film_data_new(width, height, spp, aovs);
    film_measure_from(f->film, measure_from);
    assert_true(film_tile_count(f->film) <= TILES_MAX);
    if (film_kept_load(kept, JOB, FRAME, f->film, f->durable, NULL, &err) != STATUS_OK ||
        film_file_open(&f->file, path, JOB, FRAME, f->film, f->durable, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    film_on_fold(f->film, note_fold, f);
    return f;
}

static void close_frame(struct frame *f)
{
    film_file_close(f->file);
    film_free(f->film);
    buffer_release(&f->commit.units);
    buffer_release(&f->commit.states);
    free(f);
}

/* As merge_commit_begin, _run and _end do. */
static void commit(struct frame *f)
{
    struct error err = {0};

    buffer_clear(&f->commit.states);
    for (uint32_t i = 0; i < f->commit.stale.count; i++)
        if (film_tile_samples(f->film, f->commit.stale.first + i) > 0)
            assert_true(film_record_state(&f->commit.states, f->film, f->commit.stale.first + i));
    if (film_file_commit(f->file, &f->commit, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    buffer_clear(&f->commit.units);
}

static uint8_t *read_whole(const char *path, size_t *size)
{
    struct buffer bytes = BUFFER_INIT;
    struct error err = {0};
    uint8_t *out;

    if (file_read(path, (size_t)1 << 30, &bytes, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    *size = bytes.size;
    out = malloc(bytes.size);
    assert_non_null(out);
    memcpy(out, bytes.data, bytes.size);
    buffer_release(&bytes);
    return out;
}

static void write_whole(const char *path, const uint8_t *data, size_t size)
{
    int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC, 0600);

    assert_true(fd >= 0);
    assert_int_equal(write(fd, data, size), (ssize_t)size);
    close(fd);
}

/* What a reader finds of both groups of a tile. */
static void check_reader(const char *path, const struct film *film, uint32_t spp)
{
    struct render_settings s = {.width = film_width(film), .height = film_height(film), .spp = spp};
    struct film_reader *reader;
    struct error err = {0};
    uint32_t tile;

    assert_int_equal(film_reader_open(&reader, kept, path, JOB, FRAME, &s, &err), STATUS_OK);
    while (film_reader_next(reader, &tile, &err) == STATUS_OK)
        for (uint32_t g = 0; g < GROUPS; g++)
            assert_int_equal(film_tile_passes(film_reader_film(reader), tile, g), film_tile_passes(film, tile, g));
    film_reader_close(reader);
}

/* ---- cut ------------------------------------------------------------------------------------- */

enum { CUT_WIDTH = 20, CUT_HEIGHT = 5, CUT_SPP = 20, SYNC_EVERY = 100 }; /* 2 tiles */

/* The file is cut at every byte of its last records: a unit, a state, a note, a unit. What is before is there, and
 * a film that goes on from there ends with the same bits. */
static void a_film_cut_anywhere_has_everything_before(void **state)
{
    struct film *whole = film_data_whole(CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0);
    struct frame *f = open_frame(work, CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0);
    size_t size, ends[5], first, at;
    struct buffer note = BUFFER_INIT;
    uint8_t *bytes;

    (void)state;
    buffer_puts(&note, "measured");
    film_data_merge(f->film, 0, 0, 0);
    film_data_merge(f->film, 1, 0, 0);
    commit(f);
    for (int step = 0; step < 4; step++) {
        struct stat info;
        assert_int_equal(stat(work, &info), 0);
        ends[step] = (size_t)info.st_size;
        if (step == 0)
            film_data_merge(f->film, 0, 0, 1);
        else if (step == 1)
            f->commit.stale = (struct film_stale){1, 1};
        else if (step == 2)
            assert_int_equal(film_file_note_write(f->file, 0, &note, NULL), STATUS_OK);
        else
            film_data_merge(f->film, 1, 0, 1);
        commit(f);
    }
    close_frame(f);
    bytes = read_whole(work, &size);
    ends[4] = size;
    first = ends[0];
    for (size_t cut = first; cut <= size; cut++) {
        struct buffer found = BUFFER_INIT;
        struct stat info;
        write_whole(copy, bytes, cut);
        f = open_frame(copy, CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0);
        assert_int_equal(f->durable[0][0], cut >= ends[1] ? 2 : 1);
        assert_int_equal(f->durable[1][0], cut >= ends[4] ? 2 : 1);
        assert_int_equal(film_file_note_read(f->file, 0, &found, NULL), STATUS_OK);
        assert_int_equal(found.size, cut >= ends[3] ? note.size : 0);
        /* What is torn is cut off. */
        for (at = 0; at < 4 && ends[at + 1] <= cut; at++)
            ;
        assert_int_equal(stat(copy, &info), 0);
        assert_int_equal((size_t)info.st_size, ends[at]);
        check_reader(copy, f->film, CUT_SPP);
        for (uint32_t t = 0; t < 2; t++)
            for (uint32_t g = 0; g < GROUPS; g++)
                for (uint32_t p = film_tile_passes(f->film, t, g); p < film_pass_count(f->film, g); p++)
                    film_data_merge(f->film, t, g, p);
        film_data_assert_same(f->film, whole);
        if (cut % SYNC_EVERY == 0)
            commit(f);
        close_frame(f);
        if (cut % SYNC_EVERY == 0) {
            f = open_frame(copy, CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0);
            film_data_assert_same(f->film, whole);
            close_frame(f);
        }
        buffer_release(&found);
    }
    free(bytes);
    buffer_release(&note);
    unlink(work);
    film_free(whole);
}

/* ---- levels ---------------------------------------------------------------------------------- */

/* A film that left out its levels gets them from its units, to the bit; of a tile whose units became a state it does
 * not. */
static void levels_come_from_the_units(void **state)
{
    struct film *whole = film_data_whole(CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0);

    (void)state;
    measure_from = LEVELS_MAX;
    for (int stale = 0; stale < 2; stale++) {
        struct frame *f = open_frame(work, CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0);
        struct film_level level;
        for (uint32_t t = 0; t < 2; t++)
            for (uint32_t g = 0; g < GROUPS; g++)
                for (uint32_t p = 0; p < film_pass_count(f->film, g); p++)
                    film_data_merge(f->film, t, g, p);
        commit(f);
        assert_false(film_level(f->film, 0, 0, 1, &level));
        close_frame(f);
        f = open_frame(work, CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0);
        assert_true(film_has_skipped(f->film) && film_level_is_skipped(f->film, 1, 2));
        if (stale) { /* the state is before the units, as if these had been given back */
            struct film_commit one = {.stale = {1, 1}};
            unlink(work);
            film_file_close(f->file);
            assert_int_equal(film_file_open(&f->file, work, JOB, FRAME, f->film, f->durable, NULL), STATUS_OK);
            for (uint32_t t = 0; t < 2; t++)
                assert_true(film_record_state(&one.states, f->film, t));
            assert_int_equal(film_file_commit(f->file, &one, NULL), STATUS_OK);
            buffer_release(&one.states);
        }
        assert_int_equal(film_levels_load(kept, work, JOB, FRAME, f->film, NULL), STATUS_OK);
        assert_int_equal(film_has_skipped(f->film), stale);
        assert_int_equal(film_level_is_complete(f->film, 1, 2), !stale);
        if (!stale)
            film_data_assert_same(f->film, whole);
        close_frame(f);
        unlink(work);
    }
    measure_from = 0;
    film_free(whole);
}

/* ---- damaged --------------------------------------------------------------------------------- */

/* A bit of every 5th byte is flipped: the tile has less, never anything else, the others are whole; and
 * what is rendered again brings the same bits. */
static void a_flipped_bit_is_noticed(void **state)
{
    struct film *whole = film_data_whole(CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0);
    struct frame *f = open_frame(work, CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0);
    uint32_t passes = film_pass_count(f->film, 0), less = 0;
    uint8_t *bytes;
    size_t size;

    (void)state;
    for (uint32_t p = 0; p < passes; p++)
        for (uint32_t t = 0; t < 2; t++)
            for (uint32_t g = 0; g < GROUPS; g++) {
                film_data_merge(f->film, t, g, p);
                if (p == 1 && g == 1)
                    f->commit.stale = (struct film_stale){t, 1};
                commit(f);
            }
    close_frame(f);
    bytes = read_whole(work, &size);
    for (size_t at = 80; at < size; at += 5) {
        uint32_t lacking[2] = {0};
        bytes[at] ^= (uint8_t)(1 << at % 8);
        write_whole(copy, bytes, size);
        bytes[at] ^= (uint8_t)(1 << at % 8);
        f = open_frame(copy, CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0);
        for (uint32_t t = 0; t < 2; t++)
            for (uint32_t g = 0; g < GROUPS; g++)
                lacking[t] += passes - film_tile_passes(f->film, t, g);
        assert_true(lacking[0] == 0 || lacking[1] == 0);
        less += lacking[0] + lacking[1] > 0;
        for (uint32_t t = 0; t < 2; t++)
            for (uint32_t g = 0; g < GROUPS; g++)
                for (uint32_t p = film_tile_passes(f->film, t, g); p < passes; p++)
                    film_data_merge(f->film, t, g, p);
        film_data_assert_same(f->film, whole);
        if (at % SYNC_EVERY == 0) {
            commit(f);
            close_frame(f);
            f = open_frame(copy, CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0);
            film_data_assert_same(f->film, whole);
        }
        close_frame(f);
    }
    assert_true(less > (size - 80) / 5 / 4); /* a state stands for the units before it, and they for it */
    free(bytes);
    unlink(work);
    film_free(whole);
}

/* ---- other caps ------------------------------------------------------------------------------ */

/* A pass that the cap cut is not the whole pass: with a larger cap it is rendered again. */
static void a_short_pass_counts_with_its_cap_alone(void **state)
{
    struct frame *f = open_frame(work, 16, 16, 20, 0); /* a group's passes: 2, 4, 8, and 2 of 8 */
    struct film *whole = film_data_whole(16, 16, 32, 0);

    (void)state;
    for (uint32_t g = 0; g < GROUPS; g++)
        for (uint32_t p = 0; p < film_pass_count(f->film, g); p++)
            film_data_merge(f->film, 0, g, p);
    commit(f);
    close_frame(f);
    f = open_frame(work, 16, 16, 32, 0);
    assert_true(f->durable[0][0] + 1 == film_pass_count(f->film, 0));
    for (uint32_t g = 0; g < GROUPS; g++)
        for (uint32_t p = film_tile_passes(f->film, 0, g); p < film_pass_count(f->film, g); p++)
            film_data_merge(f->film, 0, g, p);
    commit(f);
    close_frame(f);
    f = open_frame(work, 16, 16, 32, 0);
    film_data_assert_same(f->film, whole);
    close_frame(f);
    unlink(work);
    film_free(whole);
}

/* ---- room ------------------------------------------------------------------------------------ */

static uint64_t counter_of_io(const char *name)
{
    char line[128];
    FILE *file = fopen("/proc/self/io", "r");
    unsigned long long value = 0;

    assert_non_null(file);
    while (fgets(line, sizeof line, file))
        if (strncmp(line, name, strlen(name)) == 0)
            value = strtoull(line + strlen(name), NULL, 10);
    fclose(file);
    return value;
}

/* As a picture's samples are: positive, noisy, in three octaves. */
static void merge_noisy(struct film *film, uint32_t tile, uint32_t group, uint32_t pass)
{
    float sums[TILE_FLOATS_MAX];
    struct unit_result unit = film_data_unit(film, tile, group, pass, sums);
    enum film_merge_result result;
    uint64_t random = tile * 7919u + group * 104729u + pass * 1299709u + 1;
    uint32_t begin, end;

    pass_range(film_spp(film), group, pass, &begin, &end);
    for (size_t i = 0; i < unit.count; i++) {
        random = random * 6364136223846793005u + 1442695040888963407u;
        sums[i] = (float)(end - begin) * (.2f + 1.4f * (float)(random >> 40) * 0x1p-24f);
    }
    memset(&unit.work.health, 0, sizeof unit.work.health);
    assert_int_equal(film_merge(film, &unit, 1, &result, NULL), STATUS_OK);
}

enum { ROOM_WIDTH = 256, ROOM_HEIGHT = 256, ROOM_SPP = 256, COMMIT_UNITS = 64 };

/* Runs of data between holes. */
static uint32_t extents(const char *path)
{
    int fd = open(path, O_RDONLY);
    off_t end = lseek(fd, 0, SEEK_END), at = lseek(fd, 0, SEEK_DATA);
    uint32_t count = 0;

    for (; at >= 0 && at < end; at = lseek(fd, at, SEEK_DATA), count++)
        at = lseek(fd, at, SEEK_HOLE);
    close(fd);
    return count;
}

static uint64_t allocated(const char *path)
{
    struct stat info;

    assert_int_equal(stat(path, &info), 0);
    return (uint64_t)info.st_blocks * 512;
}

/* A whole frame, committed 64 units at a time in the farm's order: what is written for what comes, and the room that it
 * takes in work, and kept. */
static void room_and_writes_are_bounded(void **state)
{
    struct frame *f = open_frame(work, ROOM_WIDTH, ROOM_HEIGHT, ROOM_SPP, 0);
    const double pixels = ROOM_WIDTH * ROOM_HEIGHT;
    uint64_t before = counter_of_io("wchar:"), most = 0, written;
    uint32_t units = 0, passes = film_pass_count(f->film, 0);
    struct frame *back;
    struct error err = {0};

    (void)state;
    for (uint32_t p = 0; p < passes; p++)
        for (uint32_t g = 0; g < GROUPS; g++)
            for (uint32_t t = 0; t < film_tile_count(f->film); t++) {
                merge_noisy(f->film, t, g, p);
                if (++units % COMMIT_UNITS)
                    continue;
                commit(f);
                most = allocated(work) > most ? allocated(work) : most;
            }
    commit(f);
    assert_int_equal(film_kept_write(kept, JOB, FRAME, f->film, f->file, &err), STATUS_OK);
    written = counter_of_io("wchar:") - before;
    print_message("# received %.1f, written %.1f (%.2f times), at most %.1f in work, kept %.1f bytes a pixel, %u extents\n",
                  (double)f->received / pixels, (double)written / pixels, (double)written / (double)f->received,
                  (double)most / pixels, (double)allocated(kept) / pixels, extents(work));
    assert_true(extents(work) < 200);
    assert_true((double)written <= 1.5 * (double)f->received);
    assert_true((double)most <= 100 * pixels);
    assert_true((double)allocated(kept) <= 60 * pixels);
    unlink(kept);
    back = open_frame(work, ROOM_WIDTH, ROOM_HEIGHT, ROOM_SPP, 0);
    film_data_assert_same(back->film, f->film);
    close_frame(back);
    close_frame(f);
    unlink(work);
}

static void copy_with_holes(const char *from, const char *to)
{
    char command[300];

    snprintf(command, sizeof command, "cp --sparse=always '%s' '%s'", from, to);
    assert_int_equal(system(command), 0);
}

/* Append half of what the commit wrote to the copy that was made before. */
static void append_half(size_t old_bytes)
{
    size_t size;
    uint8_t *bytes = read_whole(work, &size);
    int fd = open(copy, O_WRONLY);

    assert_true(fd >= 0);
    assert_true(pwrite(fd, bytes + old_bytes, (size - old_bytes) / 2, (off_t)old_bytes) > 0);
    close(fd);
    free(bytes);
}

/* What was folded of each tile and group. */
static void note_passes(const struct film *film, uint32_t (*passes)[GROUPS])
{
    for (uint32_t t = 0; t < film_tile_count(film); t++)
        for (uint32_t g = 0; g < GROUPS; g++)
            passes[t][g] = film_tile_passes(film, t, g);
}

/* Killed after any commit while room is made, or in one that was half written: nothing that was durable is lost. */
static void cleaning_killed_anywhere_loses_nothing(void **state)
{
    enum { SIDE = 128, SPP = 128, UNITS = 8 };
    struct frame *f = open_frame(work, SIDE, SIDE, SPP, 0), *back;
    uint32_t durable[TILES_MAX][GROUPS], units = 0, passes = film_pass_count(f->film, 0), kills = 0, cleaned = 0;

    (void)state;
    assert_int_equal(film_file_limit(f->film), (uint64_t)SIDE * SIDE * 87);
    for (uint32_t p = 0; p < passes; p++)
        for (uint32_t g = 0; g < GROUPS; g++)
            for (uint32_t t = 0; t < film_tile_count(f->film); t++) {
                uint64_t bytes = film_file_bytes(f->file);
                struct stat old;
                if (units % UNITS == 0)
                    note_passes(f->film, durable);
                merge_noisy(f->film, t, g, p);
                if (++units % UNITS)
                    continue;
                copy_with_holes(work, copy);
                assert_int_equal(stat(work, &old), 0);
                commit(f);
                cleaned += film_file_bytes(f->file) < bytes;
                if (p < 3)
                    continue; /* it is not full before */
                append_half((size_t)old.st_size);
                back = open_frame(copy, SIDE, SIDE, SPP, 0);
                for (uint32_t i = 0; i < film_tile_count(f->film); i++)
                    for (uint32_t k = 0; k < GROUPS; k++)
                        assert_true(back->durable[i][k] >= durable[i][k]);
                close_frame(back);
                copy_with_holes(work, copy);
                back = open_frame(copy, SIDE, SIDE, SPP, 0);
                film_data_assert_same(back->film, f->film);
                close_frame(back);
                kills++;
            }
    assert_true(kills > 50 && cleaned > 8);
    close_frame(f);
    unlink(work);
}

/* ---- emptied tiles ----------------------------------------------------------------------------- */

enum { LIAR = 9, HONEST = 5 };

static void merge_by(struct film *film, uint32_t tile, uint32_t pass, uint32_t deliverer)
{
    float sums[TILE_FLOATS_MAX];
    enum film_merge_result result;

    for (uint32_t g = 0; g < GROUPS; g++) {
        struct unit_result unit = film_data_unit(film, tile, g, pass, sums);
        assert_int_equal(film_merge(film, &unit, deliverer, &result, NULL), STATUS_OK);
    }
}

static void empty_tile(struct frame *f, uint32_t tile)
{
    struct error err = {0};

    assert_int_equal(film_file_empty_tile(f->file, f->film, tile, &err), STATUS_OK);
    memset(f->durable[tile], 0, sizeof f->durable[tile]);
}

/* Tile 1 is an honest worker's and whole; tile 0 has `passes` of `deliverer`. */
static void check_emptied(const char *path, uint32_t passes, uint32_t deliverer)
{
    struct frame *f = open_frame(path, CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0);

    for (uint32_t g = 0; g < GROUPS; g++) {
        assert_int_equal(f->durable[0][g], passes);
        assert_int_equal(f->durable[1][g], film_pass_count(f->film, g));
        assert_int_equal(film_deliverer(f->film, 1, g, 0), HONEST);
        for (uint32_t p = 0; p < passes; p++)
            assert_int_equal(film_deliverer(f->film, 0, g, p), deliverer);
    }
    check_reader(path, f->film, CUT_SPP);
    close_frame(f);
}

/* A tile gives up a liar's samples, which are in the film of a done frame or in the one in work. Killed at any moment, it
 * has those of the liar, who is known, or those that came after, and never a mixture. */
static void an_emptied_tile_is_of_one_time(void **state)
{
    (void)state;
    for (int is_kept = 0; is_kept < 2; is_kept++) {
        struct frame *f = open_frame(work, CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0);
        const uint32_t passes = film_pass_count(f->film, 0);
        struct stat old;
        uint8_t *bytes;
        size_t size;

        for (uint32_t p = 0; p < passes; p++) {
            merge_by(f->film, 0, p, LIAR);
            merge_by(f->film, 1, p, HONEST);
        }
        if (is_kept)
            assert_int_equal(film_kept_write(kept, JOB, FRAME, f->film, f->file, NULL), STATUS_OK);
        else
            commit(f);
        close_frame(f);
        f = open_frame(work, CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0);
        empty_tile(f, 0);
        assert_int_equal(film_tile_samples(f->film, 0), 0);
        close_frame(f);
        check_emptied(work, passes, LIAR); /* nothing was committed */
        f = open_frame(work, CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0);
        empty_tile(f, 0);
        merge_by(f->film, 0, 0, HONEST);
        assert_int_equal(stat(work, &old), 0);
        film_file_fault(is_kept); /* the header of a new file may succeed */
        assert_int_equal(film_file_commit(f->file, &f->commit, NULL), STATUS_ERR_IO);
        film_file_fault(-1);
        check_emptied(work, passes, LIAR);
        commit(f);
        check_emptied(work, 1, HONEST);
        bytes = read_whole(work, &size);
        for (size_t cut = (size_t)old.st_size; cut < size; cut += 7) {
            struct frame *back;
            write_whole(copy, bytes, cut);
            back = open_frame(copy, CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0);
            for (uint32_t g = 0; g < GROUPS; g++) {
                const uint32_t got = film_tile_passes(back->film, 0, g);
                assert_int_equal(back->durable[1][g], passes);
                assert_true(got <= 1 || got == passes);
                for (uint32_t p = 0; p < got; p++)
                    assert_int_equal(film_deliverer(back->film, 0, g, p), got == 1 ? HONEST : LIAR);
            }
            close_frame(back);
        }
        free(bytes);
        for (uint32_t p = 1; p < passes; p++)
            merge_by(f->film, 0, p, HONEST);
        commit(f);
        check_emptied(work, passes, HONEST);
        close_frame(f);
        unlink(work);
        unlink(kept);
    }
}

/* Its room is given back; that it was emptied stays known, as the kept film still has what it was. */
static void an_emptied_tile_outlives_the_cleaning(void **state)
{
    enum { SIDE = 128, SPP = 128, UNITS = 8 };
    struct frame *f = open_frame(work, SIDE, SIDE, SPP, 0), *back;
    const uint32_t passes = film_pass_count(f->film, 0), tiles = film_tile_count(f->film);
    uint32_t cleaned = 0, units = 0;

    (void)state;
    for (uint32_t t = 0; t < tiles; t++)
        for (uint32_t p = 0; p < passes; p++)
            merge_by(f->film, t, p, LIAR);
    commit(f);
    assert_int_equal(film_kept_write(kept, JOB, FRAME, f->film, f->file, NULL), STATUS_OK);
    close_frame(f);
    f = open_frame(work, SIDE, SIDE, SPP, 0);
    for (uint32_t t = 0; t < tiles; t++)
        empty_tile(f, t);
    for (uint32_t p = 0; p + 1 < passes; p++) /* one pass less than the kept film has */
        for (uint32_t g = 0; g < GROUPS; g++)
            for (uint32_t t = 0; t < tiles; t++) {
                uint64_t bytes = film_file_bytes(f->file);
                merge_noisy(f->film, t, g, p);
                if (++units % UNITS)
                    continue;
                commit(f);
                cleaned += film_file_bytes(f->file) < bytes;
            }
    assert_true(cleaned >= 8);
    back = open_frame(work, SIDE, SIDE, SPP, 0);
    film_data_assert_same(back->film, f->film);
    check_reader(work, f->film, SPP);
    close_frame(back);
    close_frame(f);
    unlink(work);
    unlink(kept);
}

/* ---- a disk that fails ------------------------------------------------------------------------ */

static void a_commit_that_fails_changes_nothing(void **state)
{
    struct frame *f = open_frame(work, CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0), *back;
    struct buffer note = BUFFER_INIT;

    (void)state;
    buffer_puts(&note, "measured");
    film_data_merge(f->film, 0, 0, 0);
    commit(f);
    for (long writes = 0; writes < 3; writes++) {
        uint64_t bytes = film_file_bytes(f->file);
        struct buffer found = BUFFER_INIT;
        film_data_merge(f->film, 0, 0, (uint32_t)writes + 1);
        f->commit.stale = (struct film_stale){0, 1};
        assert_true(film_record_state(&f->commit.states, f->film, 0));
        assert_int_equal(film_file_note_write(f->file, 0, &note, NULL), STATUS_OK);
        film_file_fault(writes);
        assert_int_equal(film_file_commit(f->file, &f->commit, NULL), STATUS_ERR_IO);
        film_file_fault(-1);
        assert_int_equal(film_file_bytes(f->file), bytes);
        back = open_frame(work, CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0);
        assert_int_equal(back->durable[0][0], writes + 1);
        close_frame(back);
        commit(f); /* the note, too, which waited */
        back = open_frame(work, CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0);
        assert_int_equal(back->durable[0][0], writes + 2);
        assert_int_equal(film_file_note_read(back->file, 0, &found, NULL), STATUS_OK);
        assert_int_equal(found.size, note.size);
        buffer_release(&found);
        close_frame(back);
    }
    buffer_release(&note);
    close_frame(f);
    unlink(work);
}

/* A disk that hangs: fdatasync does not return before `release`. */
static struct {
    pthread_mutex_t lock;
    pthread_cond_t change;
    int hangs, waits;
} disk = {PTHREAD_MUTEX_INITIALIZER, PTHREAD_COND_INITIALIZER, 0, 0};

int fdatasync(int fd)
{
    pthread_mutex_lock(&disk.lock);
    disk.waits += disk.hangs;
    pthread_cond_broadcast(&disk.change);
    while (disk.hangs)
        pthread_cond_wait(&disk.change, &disk.lock);
    pthread_mutex_unlock(&disk.lock);
    return fsync(fd);
}

static void *commit_there(void *frame)
{
    commit(frame);
    return NULL;
}

/* The loop notes and reads while a commit hangs. What it noted then belongs to the next one. */
static void a_commit_that_hangs_holds_up_nothing(void **state)
{
    struct frame *f = open_frame(work, CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0), *back;
    struct buffer first = BUFFER_INIT, second = BUFFER_INIT, found = BUFFER_INIT;
    pthread_t thread;

    (void)state;
    buffer_puts(&first, "measured");
    buffer_puts(&second, "measured again");
    film_data_merge(f->film, 0, 0, 0);
    film_data_merge(f->film, 1, 0, 0);
    commit(f);
    film_data_merge(f->film, 0, 0, 1);
    assert_int_equal(film_file_note_write(f->file, 0, &first, NULL), STATUS_OK);
    disk.hangs = 1;
    assert_int_equal(pthread_create(&thread, NULL, commit_there, f), 0);
    pthread_mutex_lock(&disk.lock);
    while (!disk.waits)
        pthread_cond_wait(&disk.change, &disk.lock);
    pthread_mutex_unlock(&disk.lock);
    alarm(60); /* ends a test that waits for the disk */
    assert_true(film_file_bytes(f->file) > 0);
    assert_int_equal(film_file_note_write(f->file, 0, &second, NULL), STATUS_OK);
    assert_int_equal(film_file_note_read(f->file, 0, &found, NULL), STATUS_OK);
    assert_int_equal(found.size, second.size);
    assert_int_equal(film_file_empty_tile(f->file, f->film, 1, NULL), STATUS_OK);
    alarm(0);
    pthread_mutex_lock(&disk.lock);
    disk.hangs = 0;
    pthread_cond_broadcast(&disk.change);
    pthread_mutex_unlock(&disk.lock);
    pthread_join(thread, NULL);
    for (int at = 0; at < 2; at++) { /* before and after the next commit */
        back = open_frame(work, CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0);
        buffer_clear(&found);
        assert_int_equal(film_file_note_read(back->file, 0, &found, NULL), STATUS_OK);
        assert_int_equal(found.size, at ? second.size : first.size);
        assert_int_equal(back->durable[0][0], 2);
        assert_int_equal(back->durable[1][0], at ? 0 : 1);
        close_frame(back);
        commit(f);
    }
    buffer_release(&first);
    buffer_release(&second);
    buffer_release(&found);
    close_frame(f);
    unlink(work);
}

/* A unit that waited for the one before it is folded later; who rendered it, and how long, is on disk all the same. */
static void a_unit_that_waited_keeps_its_cost(void **state)
{
    struct frame *f = open_frame(work, CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0), *back;
    uint64_t there_ns, ns;
    uint32_t thread;

    (void)state;
    assert_int_equal(film_data_merge(f->film, 0, 0, 1), FILM_WAITING);
    film_note_cost(f->film, 0, 0, 1, 5, 1234567);
    assert_int_equal(film_data_merge(f->film, 0, 0, 0), FILM_MERGED);
    film_cost(f->film, 0, 0, 1, &thread, &there_ns);
    assert_int_equal(thread, 5);
    commit(f);
    back = open_frame(work, CUT_WIDTH, CUT_HEIGHT, CUT_SPP, 0);
    film_cost(back->film, 0, 0, 1, &thread, &ns);
    assert_int_equal(thread, 5);
    assert_true(ns > 0 && ns == there_ns);
    close_frame(back);
    close_frame(f);
    unlink(work);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_unit_that_waited_keeps_its_cost),
        cmocka_unit_test(a_film_cut_anywhere_has_everything_before),
        cmocka_unit_test(levels_come_from_the_units),
        cmocka_unit_test(a_flipped_bit_is_noticed),
        cmocka_unit_test(a_short_pass_counts_with_its_cap_alone),
        cmocka_unit_test(a_commit_that_fails_changes_nothing),
        cmocka_unit_test(a_commit_that_hangs_holds_up_nothing),
        cmocka_unit_test(room_and_writes_are_bounded),
        cmocka_unit_test(cleaning_killed_anywhere_loses_nothing),
        cmocka_unit_test(an_emptied_tile_is_of_one_time),
        cmocka_unit_test(an_emptied_tile_outlives_the_cleaning),
    };

    return cmocka_run_group_tests_name("film_log", tests, make_folder, remove_folder);
}
