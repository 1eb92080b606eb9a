/* Every two things that a scene can have, in one place (tests/support/pairs.h), said in other words: the picture is the same.
 *
 *   test_pairs [--all] [--table] [--spp N] [--only THING] [--row ROW]
 *
 * Rows are combined: one keeps the bits of a picture of 16x16 pixels (lengths, light, a black lamp, surfaces mixed with themselves,
 * tables and nodes in another order; indices, where transform_denser may), one has noise (turned, mirrored, other corners, in an empty
 * box, in pieces, lamps in halves and another order, more keys) and is judged by blocks.h, 32x32 pixels, family-wise 1e-4 over COMPARISONS (Sidak). That is for one of NOISE_EVERY pairs, with few
 * samples; --all: for all. --table prints a line for each picture; --row takes rows by their names instead of the two. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "tests/support/blocks.h"
#include "tests/support/groups.h"
#include "tests/support/imported.h"
#include "tests/support/pairs.h"
#include "tests/support/statistics.h"
#include "tests/support/transform.h"

enum { SIDE = 32, BITS_SIDE = 16, VALUES = SIDE * SIDE * 3, BITS_SAMPLES = 2, DEPTH = 6, COMPARISONS = 200000 };
enum { NOISE_EVERY = 16 }; /* pairs */
#define SIGNIFICANCE 1e-4

static uint32_t samples = 8;
static const char *only, *row_asked;
static int table, all;

static uint32_t with_the_same_bits(struct import_result *import)
{
    return transform_in_other_words(import) + transform_reorder_nodes(import);
}

static uint32_t with_the_same_bits_and_denser(struct import_result *import)
{
    return transform_denser(import) + with_the_same_bits(import);
}

static uint32_t with_noise(struct import_result *import)
{
    return transform_halve_lamps(import) + transform_elsewhere(import) + transform_more_keys(import);
}

static const struct transform_row rows[] = {
    {.name = "the same bits", .apply = with_the_same_bits, .bits = 1, .factor = TRANSFORM_LIGHT},
    {.name = "noise", .apply = with_noise},
    {.name = "denser", .apply = transform_denser, .bits = 1, .part = 1},
};

struct totals {
    uint32_t pairs, pictures, unchanged, failed;
    unsigned comparisons;
    double z;
};

static void render(struct import_result *import, int bits, double *mean)
{
    struct render_settings settings = bits ? imported_settings(BITS_SIDE, BITS_SIDE, BITS_SAMPLES) : imported_settings(SIDE, SIDE, samples);
    struct render_stats stats = {0};
    struct render_scene *scene;

    settings.max_depth = DEPTH;
    /* Beside bodies, rays past a lamp's edge are decided in double: one of 100,000 differs, and with it a region's guide. */
    if (bits)
        settings.light_choice = LIGHT_CHOICE_TREE;
    scene = imported_build(import, &settings, 0);
    groups_render(scene, &settings, 0, mean, NULL, &stats);
    render_scene_free(scene);
}

static void judge(size_t one, size_t other, const struct transform_row *row, double *picture, const double *reference,
                  struct totals *totals)
{
    const double limit = sidak_alpha(SIGNIFICANCE, COMPARISONS);
    const int side = row->bits ? BITS_SIDE : SIDE, values = side * side * 3;
    struct blocks_worst worst;
    uint32_t apart = 0;
    int failed;

    for (int i = 0; i < values && row->factor > 0; i++)
        picture[i] /= (double)row->factor;
    worst = blocks_compare(picture, reference, side);
    totals->pictures++;
    if (!row->bits) {
        totals->comparisons += blocks_comparisons(SIDE);
        totals->z = blocks_z(worst.p_value) > totals->z ? blocks_z(worst.p_value) : totals->z;
    }
    for (int i = 0; i < values; i += 3)
        apart += memcmp(picture + i, reference + i, 3 * sizeof *picture) != 0;
    failed = row->bits ? apart > 0 : worst.p_value < limit;
    totals->failed += (uint32_t)failed;
    if (table || failed)
        printf("%s%s, %s | %s | %.2f %% of the pixels | z %.2f of %.2f | %+.3g %% at %d %d |\n", failed ? "FAILED " : "",
               pair_things[one].name, pair_things[other].name, row->name, 100.0 * apart / (side * side), blocks_z(worst.p_value),
               blocks_z(limit), 100 * worst.share, worst.x, worst.y);
    fflush(stdout);
}

static void try_row(size_t one, size_t other, const struct transform_row *row, const double *reference, struct totals *totals)
{
    static double picture[VALUES];
    struct import_result import;

    pair_scene(one, other, &import);
    if (row->apply(&import) > 0) {
        render(&import, row->bits, picture);
        judge(one, other, row, picture, reference, totals);
    } else {
        totals->unchanged++;
    }
    import_result_release(&import);
}

static void try_pair(size_t one, size_t other, struct totals *totals)
{
    static double references[2][VALUES];
    struct import_result import;
    const int noise = all || only || (7 * one + 13 * other) % NOISE_EVERY == 0;
    int wanted[2] = {!row_asked && noise, !row_asked};

    pair_scene(one, other, &import);
    for (size_t i = 0; row_asked && i < transform_count; i++)
        if (strstr(transforms[i].name, row_asked))
            wanted[transforms[i].bits] = 1;
    for (size_t i = 0; row_asked && i < sizeof rows / sizeof *rows; i++)
        if (strstr(rows[i].name, row_asked))
            wanted[rows[i].bits] = 1;
    for (int bits = 0; bits < 2; bits++)
        if (wanted[bits])
            render(&import, bits, references[bits]);
    import_result_release(&import);
    totals->pairs++;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        struct transform_row row = rows[i];
        if (row_asked ? !strstr(row.name, row_asked) : row.part || !wanted[row.bits])
            continue;
        if (row.apply == transform_denser && !pair_is_closed(one, other))
            continue;
        if (row.apply == with_the_same_bits && pair_is_closed(one, other))
            row.apply = with_the_same_bits_and_denser;
        try_row(one, other, &row, references[row.bits], totals);
    }
    for (size_t i = 0; row_asked && i < transform_count; i++)
        if (strstr(transforms[i].name, row_asked))
            try_row(one, other, &transforms[i], references[transforms[i].bits], totals);
}

static int is_asked_for(size_t one, size_t other)
{
    return !only || strcmp(pair_things[one].name, only) == 0 || strcmp(pair_things[other].name, only) == 0;
}

static void two_things_in_one_place(void **state)
{
    struct totals totals = {0};

    (void)state;
    for (size_t one = 0; one < pair_thing_count; one++)
        for (size_t other = one; other < pair_thing_count; other++)
            if (is_asked_for(one, other))
                try_pair(one, other, &totals);
    printf("# %u pairs, %u pictures, %u with nothing to change; largest z %.2f of %.2f; %u failed\n", totals.pairs, totals.pictures,
           totals.unchanged, totals.z, blocks_z(sidak_alpha(SIGNIFICANCE, COMPARISONS)), totals.failed);
    assert_true(totals.comparisons <= COMPARISONS);
    assert_true(totals.pictures > 0);
    assert_int_equal(totals.failed, 0);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(two_things_in_one_place)};

    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--table") == 0)
            table = 1;
        else if (strcmp(argv[i], "--all") == 0)
            all = 1, samples = 16;
        else if (strcmp(argv[i], "--spp") == 0 && i + 1 < argc && atoi(argv[i + 1]) >= 4)
            samples = (uint32_t)atoi(argv[++i]);
        else if (strcmp(argv[i], "--only") == 0 && i + 1 < argc)
            only = argv[++i];
        else if (strcmp(argv[i], "--row") == 0 && i + 1 < argc)
            row_asked = argv[++i];
        else
            return fprintf(stderr, "usage: test_pairs [--all] [--table] [--spp N, at least 4] [--only THING] [--row ROW]\n"), 2;
    }
    return cmocka_run_group_tests_name("pairs", tests, NULL, NULL);
}
