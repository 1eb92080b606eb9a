/* The command that renders a frame again, for its header. */
#include "coordinator/farm/develop_parts.h"

#include <inttypes.h>

#include "common/base/shell.h"

static void add_real(struct buffer *out, const char *name, double value)
{
    buffer_printf(out, " --%s %.9g", name, value);
}

/* What the samples are functions of. */
static void add_settings(struct buffer *out, const struct render_settings *s)
{
    buffer_printf(out, " --size %ux%u", settings_whole_width(s), settings_whole_height(s));
    if (s->whole_width)
        buffer_printf(out, " --region %u,%u,%u,%u", s->region_x, s->region_y, s->width, s->height);
    buffer_printf(out, " --max-depth %u --seed %" PRIu64 " --camera %u --isa %s", s->max_depth, s->seed,
                  s->camera, isa_name(s->isa));
    add_real(out, "env-rotate", (double)s->env_rotate_deg);
    add_real(out, "env-strength", (double)s->env_strength);
    shell_option(out, "env-sampling", env_sampling_name(s->env_sampling));
    add_real(out, "fps", (double)s->fps);
    if (s->shutter > 0)
        add_real(out, "shutter", (double)s->shutter);
    if (s->lens_radius >= 0)
        add_real(out, "lens", (double)s->lens_radius);
    if (s->focus_distance > 0)
        add_real(out, "focus", (double)s->focus_distance);
}

static void add_choices(struct buffer *out, const struct render_settings *s)
{
    char names[SETTINGS_TEXT_SIZE];

    if (s->sampler != SAMPLER_SOBOL)
        shell_option(out, "sampler", sampler_name(s->sampler));
    if (s->light_choice != LIGHT_CHOICE_TREE)
        shell_option(out, "light-choice", light_choice_name(s->light_choice));
    if (s->texture_filter != TEXTURE_FILTER_CONE)
        shell_option(out, "texture-filter", texture_filter_name(s->texture_filter));
    if (s->bvh_quality != BVH_QUALITY_MEDIUM)
        shell_option(out, "bvh-quality", bvh_quality_name(s->bvh_quality));
    if (s->not_robust)
        shell_option(out, "robust", "off");
    if (s->no_roulette)
        shell_option(out, "roulette", "off");
    if (s->clamp > 0)
        add_real(out, "clamp", (double)s->clamp);
    if (s->without)
        shell_option(out, "without", settings_effects_text(s->without, names));
    if (s->aovs)
        shell_option(out, "aov", settings_aovs_text(s->aovs, names));
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
    if (t->exposure_ev != o->camera_ev)
        buffer_printf(out, " --exposure %.17g", t->exposure_ev - o->camera_ev);
    if (t->metering != TONEMAP_METERING_OFF)
        shell_option(out, "auto-exposure", tonemap_metering_name(t->metering));
    if (t->metering == TONEMAP_METERING_PERCENTILE)
        buffer_printf(out, " --percentile %.17g", t->metering_percentile);
    if (t->white_kelvin > 0)
        buffer_printf(out, " --white-balance %.17g", t->white_kelvin);
    if (o->exr_half)
        buffer_puts(out, " --half");
}

void develop_command(const struct development *d, struct buffer *out)
{
    buffer_printf(out, "azulejo render %s --frames %u", d->source[0] ? d->source : "SCENE", d->frame);
    add_settings(out, &d->settings);
    add_choices(out, &d->settings);
    add_samples(out, d);
    add_display(out, &d->output);
}
