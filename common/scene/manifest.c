#include "common/scene/manifest.h"
#include "common/scene/scene_effects.h"

#include <inttypes.h>
#include <math.h>

#include "common/base/json_quote.h"
#include "common/base/number.h"
#include "common/scene/kernel_sets.h"

void manifest_write_text(struct buffer *out, const char *text)
{
    const unsigned char *s = (const unsigned char *)text;

    buffer_puts(out, "\"");
    while (*s) {
        size_t length = utf8_length(s);
        if (length == 0) {
            buffer_puts(out, "\\ufffd");
            s++;
            continue;
        }
        if (*s == '"' || *s == '\\')
            buffer_printf(out, "\\%c", *s);
        else if (*s < 0x20 || *s == 0x7f)
            buffer_printf(out, "\\u%04x", *s);
        else
            buffer_append(out, s, length);
        s += length;
    }
    buffer_puts(out, "\"");
}

static void write_field(struct buffer *out, const char *key, const char *text)
{
    buffer_printf(out, "  \"%s\": ", key);
    manifest_write_text(out, text);
    buffer_puts(out, ",\n");
}

static void write_caller(struct buffer *out, const char *kind, const char *name, uint32_t index)
{
    buffer_puts(out, "{\"kind\": ");
    manifest_write_text(out, kind);
    buffer_puts(out, ", \"name\": ");
    manifest_write_text(out, name ? name : "");
    buffer_printf(out, ", \"index\": %" PRIu32, index);
}

static void write_cause(struct buffer *out, const struct effect_cause *cause)
{
    write_caller(out, cause->kind, cause->name, cause->index);
    buffer_printf(out, ", \"count\": %" PRIu32, cause->count);
    for (int i = 0; i < EFFECT_CAUSES_ALSO && cause->also[i].kind; i++) {
        buffer_puts(out, i ? ", " : ", \"also\": [");
        write_caller(out, cause->also[i].kind, cause->also[i].name, cause->also[i].index);
        buffer_puts(out, "}");
    }
    buffer_puts(out, cause->also[0].kind ? "]}" : "}");
}

/* All samples; *unattributed: those on no effect's account. */
static uint64_t accounted_looks(const struct manifest *m, uint64_t *unattributed)
{
    uint64_t known = m->effects & ~EFFECTS_WITHOUT_TIME, all = 0;

    *unattributed = 0;
    for (int i = 0; i < EFFECT_ACCOUNTS; i++) {
        all += m->accounts[i];
        if (i == 0 || !(known >> (i - 1) & 1))
            *unattributed += m->accounts[i];
    }
    return all;
}

/* Rounded to multiples of 1 / units: 1000 keeps three decimals. */
static void write_rounded(struct buffer *out, double value, double units)
{
    char text[NUMBER_TEXT_SIZE];

    buffer_puts(out, number_text(text, round(value * units) / units));
}

static void write_share(struct buffer *out, uint64_t looks, uint64_t all)
{
    if (all > 0)
        write_rounded(out, (double)looks / (double)all, 1e4);
    else
        buffer_puts(out, "null");
}

static void write_depth(struct buffer *out, const struct manifest *m)
{
    if (!m->depth_known) {
        buffer_puts(out, "null");
        return;
    }
    buffer_puts(out, "{\"share\": ");
    write_rounded(out, m->depth.share, 1e6);
    buffer_printf(out, ", \"max_depth\": %" PRIu32 ", \"deeper\": ", m->max_depth);
    if (m->depth.deeper) {
        buffer_printf(out, "%" PRIu32 ", \"deeper_share\": ", m->depth.deeper);
        write_rounded(out, m->depth.deeper_share, 1e6);
        buffer_puts(out, "}");
    } else {
        buffer_puts(out, "null, \"deeper_share\": null}");
    }
}

/* The effects of `set`, each with what needs it and, if it ran, its share of the time. */
static void write_causes(struct buffer *out, const char *key, const struct manifest *m, uint64_t set)
{
    uint64_t unattributed, looks = accounted_looks(m, &unattributed);
    int first = 1;

    buffer_printf(out, "  \"%s\": [", key);
    for (int bit = 0; bit < EFFECT_COUNT; bit++) {
        const struct effect_cause *cause = m->causes ? &m->causes[bit] : NULL;
        if (!(set >> bit & 1))
            continue;
        buffer_puts(out, first ? "\n    {\"effect\": " : ",\n    {\"effect\": ");
        first = 0;
        manifest_write_text(out, effect_name((enum effect_bit)bit));
        if (m->effects & ~EFFECTS_WITHOUT_TIME & (uint64_t)1 << bit) {
            buffer_puts(out, ", \"share\": ");
            write_share(out, m->accounts[bit + 1], looks);
        }
        if (cause && cause->kind) {
            buffer_puts(out, ", \"cause\": ");
            write_cause(out, cause);
        }
        buffer_puts(out, "}");
    }
    buffer_puts(out, first ? "],\n" : "\n  ],\n");
}

static void write_names(struct buffer *out, const char *key, uint64_t set)
{
    int first = 1, column = 0;

    buffer_printf(out, "  \"%s\": [", key);
    for (int bit = 0; bit < EFFECT_COUNT; bit++)
        if (set >> bit & 1) {
            if (!first)
                buffer_puts(out, ",");
            buffer_puts(out, column++ % 5 == 0 ? "\n    " : " ");
            manifest_write_text(out, effect_name((enum effect_bit)bit));
            first = 0;
        }
    buffer_puts(out, first ? "],\n" : "\n  ],\n");
}

static void write_time(struct buffer *out, const struct manifest *m)
{
    uint64_t looks = 0, unattributed, accounted = accounted_looks(m, &unattributed);

    for (int i = 0; i < STAGE_COUNT; i++)
        looks += m->stages[i];
    buffer_printf(out, "  \"time\": {\"looks\": %" PRIu64 ", \"share\": {", looks);
    for (int i = 0; i < STAGE_COUNT; i++) {
        buffer_printf(out, "%s\"%s\": ", i ? ", " : "", stage_name((enum stage)i));
        write_share(out, m->stages[i], looks);
    }
    buffer_puts(out, "}, \"no_effect\": ");
    write_share(out, unattributed, accounted);
    buffer_puts(out, "}\n");
}

static void write_error(struct buffer *out, const struct manifest *m)
{
    if (!m->error_known) {
        buffer_puts(out, "  \"error\": null,\n");
        return;
    }
    buffer_printf(out,
                  "  \"error\": {\"display\": %.9g, \"display_all\": %.9g, \"worst_part\": %.9g, \"fireflies\": %.0f, "
                  "\"subject\": %.9g},\n",
                  m->error.display, m->error.display_all, m->error.worst_part, m->error.fireflies, m->error.subject);
}

static void write_health(struct buffer *out, const struct unit_work *work, const struct health_row *rows)
{
    int some = 0;

    buffer_puts(out, "  \"health\": [");
    for (int k = 0; k < HEALTH_KINDS; k++)
        if (work->health.count[k] > 0) {
            buffer_printf(out, "%s{\"kind\": \"%s\", \"count\": %" PRIu64 ", \"share\": %.3g}", some ? ", " : "",
                          rows[k].name, work->health.count[k],
                          work->samples ? (double)work->health.count[k] / (double)work->samples : 0);
            some = 1;
        }
    buffer_puts(out, "],\n");
}

void manifest_write(struct buffer *out, const struct manifest *m)
{
    static const struct unit_work none;
    const struct unit_work *work = m->work ? m->work : &none;
    uint64_t off = m->called_for & ~m->effects & m->without;

    buffer_printf(out, "{\n  \"azulejo_effects\": %d,\n", MANIFEST_VERSION);
    buffer_printf(out, "  \"job\": %" PRIu64 ",\n", m->job);
    write_field(out, "name", m->job_name);
    write_field(out, "scene", m->scene_digest);
    write_field(out, "scene_name", m->scene_name);
    buffer_printf(out, "  \"frame\": %" PRIu32 ",\n", m->frame);
    buffer_puts(out, "  \"kernel\": {\"variant\": ");
    manifest_write_text(out, kernel_set_name(m->effects));
    buffer_puts(out, ", \"renderer\": ");
    manifest_write_text(out, m->renderer);
    buffer_puts(out, "},\n");
    write_causes(out, "ran", m, m->effects);
    write_causes(out, "switched_off", m, off);
    write_names(out, "not_called_for", EFFECTS_ALL & ~m->effects & ~off);
    buffer_printf(out,
                  "  \"picture\": {\"complete\": %s, \"samples_min\": %" PRIu32
                  ", \"samples_mean\": %.6g, \"samples_max\": %" PRIu32 ", \"tiles_without_samples\": %" PRIu32
                  ", \"ended_by_depth\": ",
                  m->complete ? "true" : "false", m->pixel_samples.least, m->pixel_samples.mean, m->pixel_samples.most,
                  m->tiles_empty);
    write_depth(out, m);
    buffer_puts(out, "},\n");
    write_error(out, m);
    write_health(out, work, m->health_rows);
    buffer_printf(out, "  \"audit\": {\"units\": %" PRIu32 ", \"says\": \"%s\"},\n", m->audited,
                  m->audited ? "audited" : "not audited");
    buffer_printf(out, "  \"work\": {\"frame_samples\": %" PRIu64, m->frame_samples);
#define COUNTER(name, limit, attribute) buffer_printf(out, ", \"" #name "\": %" PRIu64, work->name);
    WORK_COUNTERS(COUNTER)
    buffer_puts(out, ", \"cpu_s\": ");
    write_rounded(out, (double)m->cpu_ns / 1e9, 1e3);
    buffer_puts(out, "},\n");
    write_time(out, m);
    buffer_puts(out, "}\n");
}
