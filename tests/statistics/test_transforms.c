/* Every scene with and without each transformation of tests/support/transform.h: the pictures are the same,
 * to the bit or but for noise.
 *
 *   test_transforms [--table] [--spp N] [--only NAME] [SCENE...]
 *
 * Without SCENE: the files below scenes/, and where AZULEJO_DATA names the data's folder, all scenes there.
 * A file without a sky gets a grey one. Both pictures have 64x64 pixels and the same seed, so most samples
 * are the same, and are compared by tests/support/blocks.h: family-wise 1e-4 over COMPARISONS (Sidak). Rows that
 * are parts of others run with --table or by their name. */
#include <dirent.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <cmocka.h>

#include "common/base/memory.h"
#include "tests/support/blocks.h"
#include "tests/support/groups.h"
#include "tests/support/imported.h"
#include "tests/support/statistics.h"
#include "tests/support/transform.h"

enum { SIDE = 64, VALUES = SIDE * SIDE * 3, COMPARISONS = 200000 };
enum { BITS_SAMPLES = 4 };
#define SIGNIFICANCE 1e-4
/* What moves is seen from 0.5 to 0.75 s. */
enum { MOVING_FRAME = 2 };
#define MOVING_FPS 4.0f
/* Larger files take too long for this test; `--table` and SCENE have no limit. */
#define TRIANGLES_MAX 2000000

struct totals {
    uint32_t scenes, pictures, unchanged, refused, failed;
    unsigned comparisons;
    double z; /* the largest */
};

static uint32_t samples = 16;
static const char *only;
static int table;

/* ---- pictures --------------------------------------------------------------------------------- */

/* 0: refused, as some files of the data must be. */
static int load(const char *path, int moves, struct import_result *out)
{
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct error err = {0};

    if (!moves)
        options.animation = "none";
    if (import_scene(path, &options, out, &err) != STATUS_OK)
        return 0;
    if (!out->scene.environment.present) {
        out->scene.environment.present = out->scene.environment.constant = 1;
        for (int c = 0; c < 3; c++)
            out->scene.environment.radiance[c] = 0.5f;
    }
    return 1;
}

/* Where bits are compared a few samples show as much as many. */
static uint32_t samples_for(int bits) { return bits ? BITS_SAMPLES : samples; }

static void render(struct import_result *import, int bits, int moves, double *mean)
{
    struct render_settings settings = imported_settings(SIDE, SIDE, samples_for(bits));
    struct render_stats stats = {0};
    struct render_scene *scene;
    const uint32_t frame = moves ? MOVING_FRAME : 0;

    if (moves) {
        settings.fps = MOVING_FPS;
        settings.shutter = 1;
    }
    scene = imported_build(import, &settings, frame);
    groups_render(scene, &settings, frame, mean, NULL, &stats);
    render_scene_free(scene);
}

/* ---- comparing two ---------------------------------------------------------------------------- */

static void judge(const char *path, const struct transform_row *row, double *picture, const double *reference,
                  struct totals *totals)
{
    double limit = sidak_alpha(SIGNIFICANCE, COMPARISONS);
    struct blocks_worst worst;
    uint32_t apart = 0;
    int failed;

    for (int i = 0; i < VALUES && row->factor > 0; i++)
        picture[i] /= (double)row->factor;
    worst = blocks_compare(picture, reference, SIDE);

    totals->pictures++;
    totals->comparisons += blocks_comparisons(SIDE);
    totals->z = fmax(totals->z, blocks_z(worst.p_value));
    for (int i = 0; i < VALUES; i += 3)
        apart += memcmp(picture + i, reference + i, 3 * sizeof *picture) != 0;
    failed = row->bits ? apart > 0 : worst.p_value < limit;
    if (table || failed)
        printf("%s%s | %s | %.2f %% of the pixels | z %.2f of %.2f | %+.3g %% at %d %d |\n", failed ? "FAILED " : "",
               path, row->name, 100.0 * apart / (SIDE * SIDE), blocks_z(worst.p_value), blocks_z(limit),
               100 * worst.share, worst.x, worst.y);
    fflush(stdout);
    totals->failed += (uint32_t)failed;
}

static int is_asked_for(const struct transform_row *row)
{
    return only ? strstr(row->name, only) != NULL : table || !row->part;
}

/* The picture as it is, once for each way of rendering it. */
static const double *reference_of(const char *path, const struct transform_row *row, double (*pictures)[2][VALUES], int (*made)[2])
{
    struct import_result import;

    if (!made[row->moves][row->bits]) {
        if (!load(path, row->moves, &import))
            abort();
        render(&import, row->bits, row->moves, pictures[row->moves][row->bits]);
        import_result_release(&import);
        made[row->moves][row->bits] = 1;
    }
    return pictures[row->moves][row->bits];
}

static void try_scene(const char *path, struct totals *totals)
{
    static double references[2][2][VALUES], picture[VALUES];
    int made[2][2] = {{0}};
    struct import_result import;
    uint64_t triangles;

    if (!load(path, 0, &import)) {
        totals->refused++;
        return;
    }
    triangles = import.triangles_placed;
    import_result_release(&import);
    if (triangles > TRIANGLES_MAX && !table)
        return;
    totals->scenes++;
    for (size_t i = 0; i < transform_count; i++) {
        const struct transform_row *row = &transforms[i];
        if (!is_asked_for(row))
            continue;
        if (!load(path, row->moves, &import))
            abort();
        if (row->apply(&import) > 0) {
            render(&import, row->bits, row->moves, picture);
            judge(path, row, picture, reference_of(path, row, references, made), totals);
        } else {
            totals->unchanged++;
        }
        import_result_release(&import);
    }
}

/* ---- the scenes ------------------------------------------------------------------------------- */

static int is_scene(const char *name)
{
    static const char *const endings[] = {".gltf", ".glb", ".pbrt", ".obj"};
    size_t length = strlen(name);

    for (size_t i = 0; i < sizeof endings / sizeof *endings; i++)
        if (length > strlen(endings[i]) && strcmp(name + length - strlen(endings[i]), endings[i]) == 0)
            return 1;
    return 0;
}

/* Parts of other scenes, and files that are broken on purpose. */
static int is_left_out(const char *name)
{
    static const char *const names[] = {"geometry", "models", "meshes", "fuzz"};

    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (strcmp(name, names[i]) == 0)
            return 1;
    return name[0] == '.';
}

static void try_folder(const char *folder, struct totals *totals)
{
    struct dirent **entries;
    int count = scandir(folder, &entries, NULL, alphasort);

    for (int i = 0; i < count; i++) {
        char path[4096];
        struct stat about;
        snprintf(path, sizeof path, "%s/%s", folder, entries[i]->d_name);
        if (!is_left_out(entries[i]->d_name) && stat(path, &about) == 0) {
            if (S_ISDIR(about.st_mode))
                try_folder(path, totals);
            else if (is_scene(path))
                try_scene(path, totals);
        }
        free(entries[i]);
    }
    if (count >= 0)
        free(entries);
}

static void finish(const struct totals *totals)
{
    printf("# %u scenes, %u pictures, %u transformations with nothing to change, %u files refused; "
           "largest z %.2f of %.2f; %u failed\n",
           totals->scenes, totals->pictures, totals->unchanged, totals->refused, totals->z,
           blocks_z(sidak_alpha(SIGNIFICANCE, COMPARISONS)), totals->failed);
    assert_true(totals->comparisons <= COMPARISONS);
    assert_true(totals->pictures > 0);
    assert_int_equal(totals->failed, 0);
}

static void test_own_scenes(void **state)
{
    struct totals totals = {0};

    (void)state;
    try_folder("scenes", &totals);
    finish(&totals);
}

static void test_data(void **state)
{
    const char *folder = getenv("AZULEJO_DATA");
    struct totals totals = {0};

    (void)state;
    if (!folder)
        skip();
    try_folder(folder, &totals);
    finish(&totals);
}

/* ---- arguments -------------------------------------------------------------------------------- */

static char **files;
static int file_count;

static void test_files(void **state)
{
    struct totals totals = {0};

    (void)state;
    for (int i = 0; i < file_count; i++)
        try_scene(files[i], &totals);
    finish(&totals);
}

static int read_arguments(int argc, char **argv)
{
    int i = 1;

    for (; i < argc && argv[i][0] == '-'; i++) {
        if (strcmp(argv[i], "--table") == 0)
            table = 1;
        else if (strcmp(argv[i], "--spp") == 0 && i + 1 < argc && atoi(argv[i + 1]) >= 4)
            samples = (uint32_t)atoi(argv[++i]);
        else if (strcmp(argv[i], "--only") == 0 && i + 1 < argc)
            only = argv[++i];
        else
            return 0;
    }
    files = argv + i;
    file_count = argc - i;
    return 1;
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_own_scenes), cmocka_unit_test(test_data)};
    const struct CMUnitTest some[] = {cmocka_unit_test(test_files)};

    if (!read_arguments(argc, argv)) {
        fprintf(stderr, "usage: test_transforms [--table] [--spp N, at least 4] [--only NAME] [SCENE...]\n");
        return 2;
    }
    if (file_count > 0)
        return cmocka_run_group_tests_name("transforms", some, NULL, NULL);
    return cmocka_run_group_tests_name("transforms", tests, NULL, NULL);
}
