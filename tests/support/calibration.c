#include "tests/support/calibration.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/accuracy/word.h"
#include "common/base/memory.h"
#include "common/image/image.h"
#include "common/scene/scene_effects.h"
#include "tests/support/imported.h"

static size_t picture_floats(const struct calibration *c) { return (size_t)c->width * c->height * 3; }

static void *need(size_t count, size_t size)
{
    void *out = mem_calloc(count, size);

    if (!out) {
        fprintf(stderr, "calibration: out of memory\n");
        abort();
    }
    return out;
}

static size_t tail_count(const struct calibration *c)
{
    return (size_t)tile_count(c->width, c->height) * RECORD_GROUPS * RECORD_TAIL_MAX;
}

static void allocate(struct calibration *c, const struct calibration_size *size)
{
    memset(c, 0, sizeof *c);
    c->width = size->width;
    c->height = size->height;
    c->seeds = size->seeds;
    c->levels = size->levels;
    c->reference_seeds = size->reference_seeds;
    c->reference_spp = size->reference_spp;
    c->views = need((size_t)c->seeds * c->levels, sizeof *c->views);
    for (size_t i = 0; i < (size_t)c->seeds * c->levels; i++) {
        for (int r = 0; r < RECORD_GROUPS; r++)
            c->views[i].groups[r] = need(picture_floats(c), sizeof(float));
        c->views[i].tails = need(tail_count(c), sizeof *c->views[i].tails);
    }
    c->subject = need((size_t)c->width * c->height, sizeof *c->subject);
    c->references = need((size_t)c->reference_seeds * RECORD_GROUPS, sizeof *c->references);
    for (size_t i = 0; i < (size_t)c->reference_seeds * RECORD_GROUPS; i++)
        c->references[i] = need(picture_floats(c), sizeof(float));
}

void calibration_release(struct calibration *c)
{
    for (size_t i = 0; i < (size_t)c->seeds * c->levels; i++) {
        for (int r = 0; r < RECORD_GROUPS; r++)
            mem_free(c->views[i].groups[r]);
        mem_free(c->views[i].tails);
    }
    for (size_t i = 0; i < (size_t)c->reference_seeds * RECORD_GROUPS; i++)
        mem_free(c->references[i]);
    mem_free(c->references);
    mem_free(c->subject);
    mem_free(c->views);
    memset(c, 0, sizeof *c);
}

/* Merge two descending lists, keep the largest of both. */
static void merge_tails(struct record_tail *into, const struct record_tail *from, uint32_t count)
{
    struct record_tail out[RECORD_TAIL_MAX];
    uint32_t a = 0, b = 0;

    for (uint32_t i = 0; i < RECORD_TAIL_MAX; i++)
        out[i] = b < count && from[b].luminance > into[a].luminance ? from[b++] : into[a++];
    memcpy(into, out, sizeof out);
}

/* Sums of one seed, grown unit by unit. */
struct growth {
    const struct render_scene *scene;
    const struct render_settings *settings;
    double *sums[RECORD_GROUPS];
    struct record_tail *tails;
    uint64_t rays, cpu_ns;
    double *subject; /* [pixels], and how many samples of each pixel: of all seeds */
    double subject_samples;
};

static void grow(struct growth *g, uint32_t seed, uint32_t begin, uint32_t end)
{
    static struct record_unit unit;
    uint32_t width = g->settings->width, height = g->settings->height;

    for (uint32_t tile = 0; tile < tile_count(width, height); tile++)
        for (uint32_t group = 0; group < RECORD_GROUPS; group++) {
            struct tile_rect rect = tile_rect_of(width, height, tile);
            record_render(g->scene, g->settings, seed, 0, tile, group, begin, end, &unit);
            for (uint32_t i = 0; i < unit.head.pixels * 3; i++) {
                size_t at = ((size_t)(rect.y + i / 3 / rect.width) * width + rect.x + i / 3 % rect.width) * 3 + i % 3;
                g->sums[group][at] += (double)unit.sums[i];
            }
            for (uint32_t i = 0; i < unit.head.pixels; i++)
                g->subject[(size_t)(rect.y + i / rect.width) * width + rect.x + i % rect.width] += unit.subject[i];
            merge_tails(g->tails + ((size_t)tile * RECORD_GROUPS + group) * RECORD_TAIL_MAX, unit.tail, unit.head.tail_count);
            g->rays += unit.head.rays;
            g->cpu_ns += unit.head.cpu_ns;
        }
    g->subject_samples += (end - begin) * (double)RECORD_GROUPS;
}

static void take_means(const struct calibration *c, const struct growth *g, uint32_t samples,
                       float *const out[RECORD_GROUPS])
{
    for (int r = 0; r < RECORD_GROUPS; r++)
        for (size_t i = 0; i < picture_floats(c); i++)
            out[r][i] = (float)(g->sums[r][i] / samples);
}

static void clear(const struct calibration *c, struct growth *g)
{
    for (int r = 0; r < RECORD_GROUPS; r++)
        memset(g->sums[r], 0, picture_floats(c) * sizeof(double));
    memset(g->tails, 0, tail_count(c) * sizeof *g->tails);
    g->rays = g->cpu_ns = 0;
}

static void render_all(struct calibration *c, struct growth *g, uint32_t first_seed)
{
    for (uint32_t s = 0; s < c->seeds; s++) {
        clear(c, g);
        for (uint32_t level = 0; level < c->levels; level++) {
            struct calibration_view *v = &c->views[s * c->levels + level];
            uint32_t end = calibration_spp(level) / RECORD_GROUPS;
            grow(g, first_seed + s, level ? end / 2 : 0, end);
            take_means(c, g, end, v->groups);
            memcpy(v->tails, g->tails, tail_count(c) * sizeof *v->tails);
            v->rays = g->rays;
            v->cpu_ns = g->cpu_ns;
        }
        c->cpu_s += (double)g->cpu_ns * 1e-9;
    }
    for (uint32_t s = 0; s < c->reference_seeds; s++) {
        clear(c, g);
        grow(g, CALIBRATION_REFERENCE_SEED + first_seed + s, 0, c->reference_spp / RECORD_GROUPS);
        take_means(c, g, c->reference_spp / RECORD_GROUPS, c->references + s * RECORD_GROUPS);
        c->cpu_s += (double)g->cpu_ns * 1e-9;
    }
}

void calibration_render(struct calibration *c, const char *scene_path, const char *env, const struct calibration_size *size)
{
    struct render_settings settings = imported_settings(size->width, size->height, calibration_spp(size->levels - 1));
    struct import_result import;
    struct growth g = {.settings = &settings};
    struct render_scene *scene;

    allocate(c, size);
    imported_file_under(scene_path, env, &import);
    render_force_general(1);
    g.scene = scene = imported_build(&import, &settings, 0);
    for (int r = 0; r < RECORD_GROUPS; r++)
        g.sums[r] = need(picture_floats(c), sizeof(double));
    g.tails = need(tail_count(c), sizeof *g.tails);
    g.subject = need((size_t)c->width * c->height, sizeof *g.subject);
    render_all(c, &g, size->first_seed);
    for (size_t i = 0; i < (size_t)c->width * c->height; i++)
        c->subject[i] = (float)(g.subject[i] / g.subject_samples);
    mem_free(g.subject);
    for (int r = 0; r < RECORD_GROUPS; r++)
        mem_free(g.sums[r]);
    mem_free(g.tails);
    render_scene_free(scene);
    import_result_release(&import);
}

void calibration_describe(struct calibration *c, const char *scene_path, const char *env)
{
    struct import_result import;

    imported_file_under(scene_path, env, &import);
    c->effects = scene_effects_default(&import.scene, 0);
    c->brightest = accuracy_brightest(&import.scene, 1);
    import_result_release(&import);
}

/* Read or write all of it in one order. `move` returns 0 at the file's end. */
static int each_part(struct calibration *c, FILE *file, int (*move)(FILE *, void *, size_t))
{
    size_t picture = picture_floats(c) * sizeof(float);

    for (size_t i = 0; i < (size_t)c->seeds * c->levels; i++) {
        struct calibration_view *v = &c->views[i];
        for (int r = 0; r < RECORD_GROUPS; r++)
            if (!move(file, v->groups[r], picture))
                return 0;
        if (!move(file, v->tails, tail_count(c) * sizeof *v->tails) || !move(file, &v->rays, sizeof v->rays) ||
            !move(file, &v->cpu_ns, sizeof v->cpu_ns))
            return 0;
    }
    for (size_t i = 0; i < (size_t)c->reference_seeds * RECORD_GROUPS; i++)
        if (!move(file, c->references[i], picture))
            return 0;
    return move(file, c->subject, (size_t)c->width * c->height * sizeof *c->subject) &&
           move(file, &c->cpu_s, sizeof c->cpu_s);
}

static int read_part(FILE *file, void *data, size_t size) { return fread(data, 1, size, file) == size; }

static int write_part(FILE *file, void *data, size_t size) { return fwrite(data, 1, size, file) == size; }

int calibration_load(struct calibration *c, const char *path, const struct calibration_size *size)
{
    struct calibration_size found;
    FILE *file = fopen(path, "rb");
    int ok;

    if (!file)
        return 0;
    ok = read_part(file, &found, sizeof found);
    if (ok && size->reference_seeds > 0)
        ok = found.reference_seeds == size->reference_seeds && found.reference_spp == size->reference_spp;
    ok = ok && found.width == size->width && found.height == size->height && found.seeds == size->seeds &&
         found.first_seed == size->first_seed && found.levels == size->levels;
    if (ok) {
        allocate(c, &found);
        ok = each_part(c, file, read_part);
        if (!ok)
            calibration_release(c);
    }
    fclose(file);
    return ok;
}

void calibration_save(const struct calibration *c, const char *path, const struct calibration_size *size)
{
    struct calibration copy = *c;
    struct calibration_size written = *size;
    FILE *file = fopen(path, "wb");
    int ok = file && write_part(file, &written, sizeof written) && each_part(&copy, file, write_part);

    if (file && fclose(file) != 0)
        ok = 0;
    if (!ok) {
        perror(path);
        abort();
    }
}

double calibration_truth(const struct calibration *c, uint32_t seed, double *mean)
{
    size_t count = picture_floats(c);
    uint32_t parts = c->reference_seeds * RECORD_GROUPS, spp = calibration_spp(c->levels - 1);
    double reference = (double)c->reference_spp * c->reference_seeds, weight = 1 / (reference + (double)spp * (c->seeds - 1));
    double error = 0, used = 0;

    memset(mean, 0, count * sizeof *mean);
    for (uint32_t p = 0; p < parts; p++)
        for (size_t i = 0; i < count; i++)
            mean[i] += (double)c->references[p][i] * reference / parts * weight;
    for (uint32_t s = 0; s < c->seeds; s++) {
        const struct calibration_view *v = &c->views[s * c->levels + c->levels - 1];
        if (s == seed)
            continue;
        used++;
        for (size_t i = 0; i < count; i++) {
            double sum = 0;
            for (int r = 0; r < RECORD_GROUPS; r++)
                sum += (double)v->groups[r][i];
            mean[i] += sum / RECORD_GROUPS * spp * weight;
            for (int r = 0; r < RECORD_GROUPS; r++) {
                double d = (double)v->groups[r][i] - sum / RECORD_GROUPS;
                error += d * d / (RECORD_GROUPS * (RECORD_GROUPS - 1.0)); /* of one seed's mean */
            }
        }
    }
    /* The error of a mean of n samples as 1/n, from the seeds' own: pessimistic for a sequence that
     * converges faster. */
    return used > 0 ? error / used * spp * weight : 0;
}
