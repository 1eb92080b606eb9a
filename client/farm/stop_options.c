#include "client/farm/stop_options.h"

#include <string.h>

status stop_options_check(const struct stop_options *o, struct stop_rules *rules, uint32_t *spp,
                          struct error *err)
{
    status result = STATUS_OK;
    int more;

    memset(rules, 0, sizeof *rules);
    if (o->target) {
        result = stop_target_parse(o->target, &rules->target, err);
        rules->has_target = 1;
        if (result != STATUS_OK)
            error_prefix(err, "--target-error");
    }
    if (result == STATUS_OK && o->time_limit)
        result = stop_duration_parse("--time-limit", o->time_limit, &rules->time_limit_ms, err);
    if (result == STATUS_OK && o->core_limit)
        result = stop_duration_parse("--core-limit", o->core_limit, &rules->core_limit_ms, err);
    more = o->target || o->time_limit || o->core_limit;
    rules->adaptive = o->allocation ? strcmp(o->allocation, "adaptive") == 0 : more;
    *spp = o->spp > 0 ? (uint32_t)o->spp : more ? SETTINGS_SPP_MAX : 0;
    return result;
}
