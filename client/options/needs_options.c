#include "client/options/needs_options.h"

#include <string.h>

#include "client/terminal/moment.h"
#include "common/system/clock.h"

status needs_options_check(const struct needs_options *o, struct job_needs *out, struct error *err)
{
    const char *not_before = o->said[NEED_not_before].text;
    const char *require = o->said[NEED_require].text, *memory = o->said[NEED_memory].text;
    status result;

    memset(out, 0, sizeof *out);
    result = settings_said(job_needs_rows, NEED_COUNT, o->said, out, err);
    if (result == STATUS_OK && not_before)
        result = moment_parse("--not-before", not_before, clock_wall_s(), &out->not_before, err);
    if (result == STATUS_OK && require) {
        result = tags_parse(require, out->require, err);
        if (result != STATUS_OK)
            error_prefix(err, "--require");
    }
    out->memory_said = memory != NULL;
    if (result == STATUS_OK && memory && options_size_parse(memory, &out->memory) != STATUS_OK)
        result = error_set(err, STATUS_ERR_USAGE, "--memory: '%s' is not a size (a number with K, M, G or T)", memory);
    return result;
}
