/* time_left: how often the reported time left of a frame is right, on the recorded units of real
 * scenes (tests/accuracy/record.c), worked on by 2, 8 and 32 threads under a simulated clock, slowed down so that
 * the frame takes two minutes.
 *
 *   time_left FILE...
 *
 * Prints the table of docs/ACCURACY.md. Ends with status 1 where a share is below 80 %. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "tests/support/eta_replay.h"
#include "tests/support/recording.h"

static const uint32_t threads[] = {2, 8, 32};
enum { COLUMNS = sizeof threads / sizeof *threads };
#define SHARE_LEAST 0.8
#define FRAME_S 120.0 /* what a frame takes: processors are as slow as that needs */

struct costs {
    struct record_header header;
    uint64_t *cpu_ns; /* [passes][groups][tiles], of the first seed */
};

static _Noreturn void die(const char *path, const char *why)
{
    fprintf(stderr, "time_left: %s: %s; record it again (make accuracy-time)\n", path, why);
    exit(2);
}

static size_t place(const struct costs *c, uint32_t tile, uint32_t group, uint32_t pass)
{
    return ((size_t)pass * RECORD_GROUPS + group) * c->header.tiles + tile;
}

static void costs_read(struct costs *c, const char *path)
{
    FILE *file = fopen(path, "rb");
    struct record_head head;
    uint32_t seed = 0, units = 0;

    if (!file)
        die(path, "cannot be opened");
    if (fread(&c->header, sizeof c->header, 1, file) != 1 || c->header.magic != RECORD_MAGIC ||
        c->header.passes > RECORD_PASSES_MAX)
        die(path, "is no recording");
    c->cpu_ns = mem_calloc(place(c, 0, 0, c->header.passes), sizeof *c->cpu_ns);
    while (c->cpu_ns && fread(&head, sizeof head, 1, file) == 1) {
        size_t data = (size_t)head.pixels * 3 * sizeof(float) + head.tail_count * sizeof(struct record_tail);
        if (units > 0 && head.seed != seed)
            break;
        seed = head.seed;
        if (head.tile >= c->header.tiles || head.group >= RECORD_GROUPS || head.pass >= c->header.passes ||
            fseek(file, (long)data, SEEK_CUR) != 0)
            die(path, "is damaged");
        c->cpu_ns[place(c, head.tile, head.group, head.pass)] = head.cpu_ns;
        units++;
    }
    fclose(file);
    if (units == 0)
        die(path, "holds no units");
}

static uint64_t unit_ns(void *user, const struct eta_unit *unit)
{
    const struct costs *c = user;

    return c->cpu_ns[place(c, unit->tile, unit->group, unit->pass)];
}

static int by_size(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

/* What the tile at nine tenths costs over the one at a tenth. */
static double unevenness(const struct costs *c)
{
    double *tiles = mem_calloc(c->header.tiles, sizeof *tiles), ratio;

    if (!tiles)
        abort();
    for (size_t i = 0; i < place(c, 0, 0, c->header.passes); i++)
        tiles[i % c->header.tiles] += (double)c->cpu_ns[i];
    qsort(tiles, c->header.tiles, sizeof *tiles, by_size);
    ratio = tiles[c->header.tiles * 9 / 10] / tiles[c->header.tiles / 10];
    mem_free(tiles);
    return ratio;
}

int main(int argc, char **argv)
{
    int bad = 0;

    printf("| scene | tiles | a dear tile over a cheap one |");
    for (size_t i = 0; i < COLUMNS; i++)
        printf(" %u workers |", threads[i]);
    printf("\n|---|---:|---:|---:|---:|---:|\n");
    for (int i = 1; i < argc; i++) {
        const char *name = strrchr(argv[i], '/') ? strrchr(argv[i], '/') + 1 : argv[i];
        struct costs c;
        struct eta_frame frame;
        double core_s = 0;

        costs_read(&c, argv[i]);
        for (size_t k = 0; k < place(&c, 0, 0, c.header.passes); k++)
            core_s += (double)c.cpu_ns[k] / 1e9;
        frame = (struct eta_frame){c.header.width, c.header.height, c.header.spp, unit_ns, &c};
        printf("| %.*s | %u | %.0f |", (int)strcspn(name, "."), name, c.header.tiles, unevenness(&c));
        for (size_t k = 0; k < COLUMNS; k++) {
            double share = eta_replay(&frame, threads[k], core_s / threads[k] / FRAME_S);
            printf(" %.0f %% |", 100 * share);
            bad |= !(share >= SHARE_LEAST);
        }
        printf("\n");
        mem_free(c.cpu_ns);
    }
    return bad;
}
