#include "common/accuracy/stop.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/duration.h"
#include "common/scene/settings.h"

/* How each measure is written, and its valid range. */
static const struct {
    const char *unit;
    double least, most;
    int falls; /* a smaller value is a better picture */
} measures[] = {
    [ALLOCATION_DISPLAY] = {"/255", 0.01, 128, 1},
    [ALLOCATION_PSNR] = {"dB", 5, 120, 0},
    [ALLOCATION_RMSE] = {"%", 0.001, 1000, 1},
};
enum { MEASURES = sizeof measures / sizeof measures[0] };

static status check_target(const struct allocation_target *target, enum status code, struct error *err)
{
    unsigned measure = (unsigned)target->measure;

    if (measure >= MEASURES)
        return error_set(err, code, "a target of an unknown measure");
    if (!(target->value >= measures[measure].least && target->value <= measures[measure].most))
        return error_set(err, code, "a target of %g%s: must be from %g%s to %g%s", target->value,
                         measures[measure].unit, measures[measure].least, measures[measure].unit,
                         measures[measure].most, measures[measure].unit);
    return STATUS_OK;
}

#define ROW(o, ...) SETTING_ROW(stop_rules, __VA_ARGS__)
const struct setting stop_rules_rows[STOP_COUNT] = {STOP_RULES(OPTION_ROW, ROW, )};

status stop_rules_validate(const struct stop_rules *rules, struct error *err)
{
    for (int i = 0; i < STOP_COUNT; i++)
        if (setting_check(&stop_rules_rows[i], rules, err) != STATUS_OK)
            return STATUS_ERR_INPUT;
    return rules->has_target ? check_target(&rules->target, STATUS_ERR_INPUT, err) : STATUS_OK;
}

/* ---- targets -------------------------------------------------------------------------------- */

status stop_target_parse(const char *text, struct allocation_target *out, struct error *err)
{
    char *end;
    double value = strtod(text, &end);

    for (unsigned i = 0; i < MEASURES && end != text; i++)
        if (strcmp(end, measures[i].unit) == 0) {
            *out = (struct allocation_target){(enum allocation_measure)i, value};
            return check_target(out, STATUS_ERR_USAGE, err);
        }
    return error_set(err, STATUS_ERR_USAGE,
                     "'%s' is not a target: give 2/255 (display codes that 95 %% of the pixels stay "
                     "within), 1%% (error over the frame's mean) or 45dB (PSNR)",
                     text);
}

const char *stop_target_text(char out[STOP_TEXT_SIZE], const struct allocation_target *target)
{
    snprintf(out, STOP_TEXT_SIZE, "%g%s", target->value,
             (unsigned)target->measure < MEASURES ? measures[target->measure].unit : "");
    return out;
}

int stop_target_is_stricter(const struct allocation_target *a, const struct allocation_target *b)
{
    return a->measure == b->measure && (unsigned)a->measure < MEASURES &&
           (measures[a->measure].falls ? a->value < b->value : a->value > b->value);
}

const char *stop_rules_text(char out[STOP_RULES_TEXT_SIZE], const struct stop_rules *rules, uint32_t spp)
{
    char text[STOP_TEXT_SIZE], duration[DURATION_TEXT_SIZE];
    size_t used = 0;
    int more = stop_ends_a_frame(rules);

    out[0] = 0;
    if (rules->has_target)
        used += (size_t)snprintf(out, STOP_RULES_TEXT_SIZE, "%s", stop_target_text(text, &rules->target));
    if (!more || spp < SETTINGS_SPP_MAX)
        used += (size_t)snprintf(out + used, STOP_RULES_TEXT_SIZE - used, "%s%s%u samples a pixel", used ? ", " : "",
                                 more ? "at most " : "", spp);
    if (rules->time_limit_ms > 0)
        used += (size_t)snprintf(out + used, STOP_RULES_TEXT_SIZE - used, "%s%s a frame", used ? ", " : "",
                                 duration_text(duration, (int64_t)(rules->time_limit_ms / 1000)));
    if (rules->core_limit_ms > 0)
        used += (size_t)snprintf(out + used, STOP_RULES_TEXT_SIZE - used, "%s%s of core time a frame", used ? ", " : "",
                                 duration_text(duration, (int64_t)(rules->core_limit_ms / 1000)));
    if (rules->max_rays > 0)
        snprintf(out + used, STOP_RULES_TEXT_SIZE - used, "%s%.6g million rays a frame", used ? ", " : "",
                 (double)rules->max_rays / 1e6);
    return out;
}

/* ---- ends ----------------------------------------------------------------------------------- */

const char *frame_end_text(enum frame_end end)
{
    static const char *const texts[FRAME_END_COUNT] = {
        [FRAME_END_NONE] = "not ended",
        [FRAME_END_CAP] = "ended with all samples",
        [FRAME_END_TARGET] = "ended by the target error",
        [FRAME_END_TIME] = "ended by the time limit",
        [FRAME_END_CORES] = "ended by the core limit",
        [FRAME_END_CANCEL] = "cut short",
        [FRAME_END_SCHEDULE] = "ended by the schedule",
        [FRAME_END_FINISH] = "finished early",
        [FRAME_END_MISSED] = "ended by the target error, which its picture misses,",
        [FRAME_END_RAYS] = "ended by the limit of rays",
    };

    return (unsigned)end < FRAME_END_COUNT ? texts[end] : "cut short";
}
