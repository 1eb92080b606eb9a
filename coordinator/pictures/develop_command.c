/* The command that renders a frame again, for its header. */
#include "coordinator/pictures/develop_parts.h"

#include "common/system/shell.h"

/* What the samples are functions of. */
static void add_settings(struct buffer *out, const struct render_settings *s)
{
    char text[SETTING_TEXT_SIZE];

    buffer_printf(out, " --size %ux%u", settings_whole_width(s), settings_whole_height(s));
    if (s->whole_width)
        buffer_printf(out, " --region %u,%u,%u,%u", s->region_x, s->region_y, s->width, s->height);
    for (int i = 0; i < SETTING_COUNT; i++) {
        const struct setting *row = &render_settings_rows[i];
        if (row->option && setting_is_told(row, s))
            shell_option(out, row->option, setting_text(row, s, text));
    }
}

/* Which samples there are: those of the cap and the rules, or of the file's own schedule. */
static void add_samples(struct buffer *out, const struct development *d)
{
    const struct stop_rules *rules = &d->stop;
    char text[STOP_TEXT_SIZE];

    if (d->schedule.size > 0) {
        buffer_puts(out, " --schedule-from FILE.exr");
        return;
    }
    buffer_printf(out, " --spp %u", d->settings.spp);
    if (!stop_has_rounds(rules))
        return;
    if (rules->has_target) {
        shell_option(out, "target-error", stop_target_text(text, &rules->target));
        buffer_printf(out, " --min-spp %u", rules->spp_min);
    }
    shell_option(out, "allocation", rules->adaptive ? "adaptive" : "uniform");
}

/* What a target's error is measured through, and what the pictures look like. */
static void add_display(struct buffer *out, const struct output_settings *o)
{
    const struct tonemap_settings *t = &o->tonemap;
    struct tonemap_settings own = *t;
    char text[SETTING_TEXT_SIZE];

    shell_option(out, "tonemap", t->op->name);
    for (size_t i = 0; i < t->op->parameter_count; i++) {
        const struct tonemap_parameter *p = &t->op->parameters[i];
        if (t->values[i] == p->preset)
            continue;
        if (p->choices)
            buffer_printf(out, " --tonemap-param %s=%s", p->name, p->choices[(size_t)t->values[i]]);
        else
            buffer_printf(out, " --tonemap-param %s=%.17g", p->name, t->values[i]);
    }
    if (t->has_file)
        shell_option(out, "lut", t->file_name);
    own.exposure_ev -= o->camera_ev;
    if (t->metering != TONEMAP_METERING_PERCENTILE)
        setting_reset(&look_rows[LOOK_metering_percentile], &own);
    for (int i = 0; i < LOOK_COUNT; i++)
        if (i != LOOK_temporal && i != LOOK_denoise_around && setting_is_told(&look_rows[i], &own))
            shell_option(out, look_rows[i].option, setting_text(&look_rows[i], &own, text));
    if (o->exr_half)
        buffer_puts(out, " --half");
}

void develop_command(const struct development *d, struct buffer *out)
{
    buffer_printf(out, "azulejo render %s --frames %u", d->source[0] ? d->source : "SCENE", d->frame);
    add_settings(out, &d->settings);
    add_samples(out, d);
    add_display(out, &d->output);
}
