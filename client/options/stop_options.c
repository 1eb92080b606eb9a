#include "client/options/stop_options.h"

#include <string.h>

status stop_options_check(const struct stop_options *o, struct stop_rules *rules, uint32_t *spp, struct error *err)
{
    const char *target = o->said[STOP_target].text, *allocation = o->said[STOP_adaptive].text;
    status result;
    int more;

    memset(rules, 0, sizeof *rules);
    if (target) {
        result = stop_target_parse(target, &rules->target, err);
        rules->has_target = 1;
        if (result != STATUS_OK) {
            error_prefix(err, "--target-error");
            return result;
        }
    }
    result = settings_said(stop_rules_rows, STOP_COUNT, o->said, rules, err);
    more = stop_ends_a_frame(rules);
    rules->adaptive = allocation ? strcmp(allocation, "adaptive") == 0 : more;
    *spp = o->spp > 0 ? (uint32_t)o->spp : more ? SETTINGS_SPP_MAX : 0;
    return result;
}
