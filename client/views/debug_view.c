#include "client/views/debug_view.h"

#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "client/terminal/table.h"
#include "common/film/unit.h"
#include "protocol/message.h"

enum { COLUMNS = 100, INDENT = 5, NAME_COLUMNS = 28, LISTED_MAX = 32 };

/* ---- values ----------------------------------------------------------------------------------- */

static double luminance(const float rgb[3])
{
    return 0.212656 * (double)rgb[0] + 0.715158 * (double)rgb[1] + 0.072186 * (double)rgb[2];
}

/* An absent vector is 0. */
static void vector(const Azulejo__Wire__Vec3 *v, float out[3])
{
    out[0] = v ? v->x : 0;
    out[1] = v ? v->y : 0;
    out[2] = v ? v->z : 0;
}

static int is_zero(const Azulejo__Wire__Vec3 *v) { return !v || (v->x == 0 && v->y == 0 && v->z == 0); }

static uint32_t bits_of(float value)
{
    uint32_t bits;

    memcpy(&bits, &value, sizeof bits);
    return bits;
}

/* ---- JSON ------------------------------------------------------------------------------------- */

static json_t *floats_json(const float v[3])
{
    return json_pack("[o, o, o]", json_number_float(v[0]), json_number_float(v[1]), json_number_float(v[2]));
}

static json_t *sample_json(const struct debug_sample *s)
{
    char bits[3][9];

    for (int c = 0; c < 3; c++)
        snprintf(bits[c], sizeof bits[c], "%08x", bits_of(s->added[c]));
    return json_pack("{s:I, s:o, s:[s, s, s], s:o}", "sample", (json_int_t)s->number, "radiance", floats_json(s->added),
                     "bits", bits[0], bits[1], bits[2], "luminance", json_number(luminance(s->added)));
}

json_t *debug_samples_json(const struct debug_sample *samples, size_t count)
{
    json_t *list = json_array();

    for (size_t i = 0; i < count; i++)
        json_array_append_new(list, sample_json(&samples[i]));
    return list;
}

json_t *debug_path_json(const struct debug_sample *sample, const Azulejo__Wire__RenderResult *result)
{
    json_t *out = sample_json(sample);

    json_object_update_new(out, json_message(&result->base));
    return out;
}

/* ---- text ------------------------------------------------------------------------------------- */

/* Phrases with commas in between, broken where a line has COLUMNS. */
struct line {
    FILE *out;
    size_t column;
};

static void line_begin(struct line *line, FILE *out, const char *title)
{
    line->out = out;
    line->column = (size_t)fprintf(out, "%*s%-8s ", INDENT, "", title);
}

static __attribute__((format(printf, 2, 3))) void line_add(struct line *line, const char *format, ...)
{
    const size_t start = INDENT + 9;
    char text[256];
    va_list arguments;
    size_t length;

    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    text_cut(text, COLUMNS - start - 1);
    length = text_columns(text);
    if (line->column > start && line->column + 2 + length > COLUMNS - 1) {
        fprintf(line->out, ",\n%*s", (int)start, "");
        line->column = start;
    } else if (line->column > start) {
        fputs(", ", line->out);
        line->column += 2;
    }
    fputs(text, line->out);
    line->column += length;
}

static void line_end(struct line *line) { fputc('\n', line->out); }

enum { TEXT_SIZE = 128 };

static const char *vector_text(char out[TEXT_SIZE], const Azulejo__Wire__Vec3 *v)
{
    float values[3];

    vector(v, values);
    snprintf(out, TEXT_SIZE, "%.4g %.4g %.4g", (double)values[0], (double)values[1], (double)values[2]);
    return out;
}

/* "white", or "material 3" where it has no name. */
static const char *name_text(char out[TEXT_SIZE], const char *name, const char *what, int32_t number)
{
    if (name[0])
        message_text(out, TEXT_SIZE, name);
    else
        snprintf(out, TEXT_SIZE, "%s %d", what, number);
    text_cut(out, NAME_COLUMNS);
    return out;
}

static void print_place(FILE *out, size_t number, const Azulejo__Wire__PathVertex *v)
{
    char a[TEXT_SIZE], b[TEXT_SIZE], c[TEXT_SIZE], kind[16];
    struct line line;

    fprintf(out, "%3zu  %-8s ", number, message_text(kind, sizeof kind, v->kind));
    line.out = out;
    line.column = INDENT + 9;
    if (isfinite(v->distance))
        line_add(&line, "at %s", vector_text(a, v->position));
    if (isfinite(v->distance))
        line_add(&line, "%.5g m on", (double)v->distance);
    else
        line_add(&line, "nothing is met");
    if (v->instance >= 0)
        line_add(&line, "%s of %s (mesh %s, triangle %u)", name_text(a, v->material_name, "material", v->material),
                 name_text(b, v->instance_name, "instance", v->instance), name_text(c, v->mesh_name, "number", v->mesh),
                 v->triangle);
    line_end(&line);
    line_begin(&line, out, "carries");
    line_add(&line, "throughput %s", vector_text(a, v->throughput));
    if (v->medium >= 0)
        line_add(&line, "through medium %s", name_text(a, v->medium_name, "number", v->medium));
    for (size_t i = 0; i < v->n_bodies; i++)
        line_add(&line, "%s %s", i ? "in" : "inside", name_text(a, v->bodies[i], "body", (int32_t)i));
    if (v->instance >= 0) {
        line_add(&line, "%s", v->front ? "front" : "back");
        line_add(&line, "normal %s", vector_text(a, v->geometric_normal));
        if (!is_zero(v->shading_normal))
            line_add(&line, "shading %s", vector_text(a, v->shading_normal));
    }
    line_end(&line);
}

static void print_met(FILE *out, const Azulejo__Wire__PathVertex *v)
{
    char a[TEXT_SIZE];
    struct line line;

    if (is_zero(v->added_medium) && is_zero(v->added_path))
        return;
    line_begin(&line, out, "meets");
    if (!is_zero(v->added_medium))
        line_add(&line, "the medium adds %s", vector_text(a, v->added_medium));
    if (!is_zero(v->added_path)) {
        line_add(&line, "%s adds %s", v->instance >= 0 ? "the surface" : "the environment",
                 vector_text(a, v->added_path));
        if (v->met_pdf > 0)
            line_add(&line, "density of light sampling %.4g/sr", (double)v->met_pdf);
        line_add(&line, "weight %.4g", (double)v->met_weight);
    }
    line_end(&line);
}

static void print_light(FILE *out, const Azulejo__Wire__PathVertex *v)
{
    const Azulejo__Wire__LightSampled *l = v->light;
    char a[TEXT_SIZE], b[TEXT_SIZE];
    struct line line;

    if (!l)
        return;
    line_begin(&line, out, "light");
    if (!l->kind[0] || !(l->pdf > 0)) {
        line_add(&line, "none that shines here was chosen");
        line_end(&line);
        return;
    }
    message_text(a, sizeof a, l->kind);
    if (l->instance >= 0)
        line_add(&line, "%s %u of %s", a, l->triangle, name_text(b, l->name, "instance", l->instance));
    else if (l->number >= 0)
        line_add(&line, "%s %s", a, name_text(b, l->name, "number", l->number));
    else
        line_add(&line, "%s", a);
    line_add(&line, "towards %s", vector_text(a, l->direction));
    if (isfinite(l->distance))
        line_add(&line, "%.4g m away", (double)l->distance);
    line_add(&line, "radiance %s", vector_text(a, l->radiance));
    line_add(&line, l->delta ? "odds %.4g" : "density %.4g/sr", (double)l->pdf);
    line_add(&line, "scatters %s", vector_text(a, l->scatter));
    if (!l->delta)
        line_add(&line, "found by it with %.4g/sr", (double)l->scatter_pdf);
    if (!l->traced)
        line_add(&line, "no shadow ray");
    else if (is_zero(l->visible))
        line_add(&line, "hidden");
    else {
        line_add(&line, "weight %.4g", (double)l->weight);
        line_add(&line, "visible %s", vector_text(a, l->visible));
        line_add(&line, "adds %s", vector_text(a, v->added_light));
    }
    line_end(&line);
}

static void print_caster(FILE *out, const Azulejo__Wire__PathVertex *v)
{
    char a[TEXT_SIZE];
    struct line line;

    if (!v->added_caster || is_zero(v->added_caster))
        return;
    line_begin(&line, out, "caustic");
    line_add(&line, "a lamp without size adds %s by way of a smooth surface", vector_text(a, v->added_caster));
    line_end(&line);
}

static void print_next(FILE *out, const Azulejo__Wire__PathVertex *v)
{
    char a[TEXT_SIZE];
    struct line line;

    if (!v->lobe[0])
        return;
    line_begin(&line, out, "goes on");
    line_add(&line, "%s", message_text(a, sizeof a, v->lobe));
    line_add(&line, "towards %s", vector_text(a, v->direction));
    if (v->delta)
        line_add(&line, "delta lobe");
    else
        line_add(&line, "density %.4g/sr", (double)v->pdf);
    line_add(&line, "weight %s", vector_text(a, v->weight));
    if (v->survival < 1)
        line_add(&line, "survives with %.4g", (double)v->survival);
    line_end(&line);
}

static void print_health(FILE *out, const Azulejo__Wire__RenderResult *result, struct tile_rect picture)
{
    struct unit_work work;
    struct error ignored = {0};
    char text[HEALTH_TEXT_SIZE];

    if (wire_work_get(&work, result->work, &ignored) != STATUS_OK)
        return;
    for (int k = 0; k < HEALTH_KINDS; k++)
        if (work.health.count[k])
            fprintf(out, "  health   %s\n", health_text(text, &work.health, (enum health_kind)k, picture, 0));
}

void debug_path_print(FILE *out, const struct debug_sample *sample, const Azulejo__Wire__RenderResult *result,
                      struct tile_rect picture)
{
    const Azulejo__Wire__SamplePath *path = result->path;
    const float *a = sample->added;
    char text[TEXT_SIZE];
    float radiance[3];

    fprintf(out, "sample %u: radiance %.9g %.9g %.9g, luminance %.6g\n", sample->number, (double)a[0], (double)a[1],
            (double)a[2], luminance(a));
    fprintf(out, "  bits     %08x %08x %08x\n", bits_of(a[0]), bits_of(a[1]), bits_of(a[2]));
    vector(path->radiance, radiance);
    if (memcmp(radiance, a, sizeof radiance) != 0)
        fprintf(out, "  path     %.9g %.9g %.9g before the film's guards\n", (double)radiance[0],
                (double)radiance[1], (double)radiance[2]);
    print_health(out, result, picture);
    for (size_t i = 0; i < path->n_vertices; i++) {
        print_place(out, i, path->vertices[i]);
        print_met(out, path->vertices[i]);
        print_light(out, path->vertices[i]);
        print_caster(out, path->vertices[i]);
        print_next(out, path->vertices[i]);
    }
    if (path->truncated)
        fprintf(out, "     ... and more vertices\n");
    fprintf(out, "  end      %s\n", message_text(text, sizeof text, path->end));
}

/* ---- a pixel's samples ------------------------------------------------------------------------ */

static int compare_samples(const void *a_, const void *b_)
{
    const struct debug_sample *a = a_, *b = b_;
    double la = luminance(a->added), lb = luminance(b->added);

    la = isnan(la) ? INFINITY : la;
    lb = isnan(lb) ? INFINITY : lb;
    if (la != lb)
        return la > lb ? -1 : 1;
    return a->number < b->number ? -1 : a->number > b->number;
}

void debug_samples_sort(struct debug_sample *samples, size_t count)
{
    if (count)
        qsort(samples, count, sizeof *samples, compare_samples);
}

void debug_samples_print(FILE *out, const struct debug_sample *samples, size_t count)
{
    double sum = 0, rest = 0;

    for (size_t i = 0; i < count; i++) {
        sum += luminance(samples[i].added);
        if (i >= LISTED_MAX)
            rest += luminance(samples[i].added);
    }
    fprintf(out, "%zu samples, mean luminance %.6g; the largest first\n", count, count ? sum / (double)count : 0);
    fprintf(out, "%8s  %12s  %7s  radiance\n", "sample", "luminance", "share");
    for (size_t i = 0; i < count && i < LISTED_MAX; i++) {
        const float *v = samples[i].added;
        fprintf(out, "%8u  %12.6g  %6.2f%%  %.6g %.6g %.6g\n", samples[i].number, luminance(v),
                sum > 0 ? 100 * luminance(v) / sum : 0, (double)v[0], (double)v[1], (double)v[2]);
    }
    if (count > LISTED_MAX)
        fprintf(out, "%8s  %12.6g  %6.2f%%  mean of the other %zu, and their share\n", "...",
                rest / (double)(count - LISTED_MAX), sum > 0 ? 100 * rest / sum : 0, count - LISTED_MAX);
}
