#include "client/farm/needs_options.h"

#include <string.h>

#include "client/terminal/moment.h"
#include "client/terminal/parse.h"
#include "common/base/clock.h"

/* "3,17". */
static status parse_jobs(const char *text, struct needs_request *out, struct error *err)
{
    const char *at = text;

    for (;; at++) {
        uint64_t job;
        at = parse_digits(at, INT64_MAX, &job);
        if (!at || job == 0 || (*at && *at != ','))
            return error_set(err, STATUS_ERR_USAGE,
                             "--after: '%.64s' is not a list of jobs' numbers, write JOB[,JOB]... as in 3,17",
                             text);
        if (out->after_count == NEEDS_AFTER_MAX)
            return error_set(err, STATUS_ERR_USAGE, "--after: at most %d jobs", NEEDS_AFTER_MAX);
        out->after[out->after_count++] = job;
        if (*at == 0)
            return STATUS_OK;
    }
}

status needs_options_check(const struct needs_options *o, struct needs_request *out, struct error *err)
{
    status result = STATUS_OK;

    memset(out, 0, sizeof *out);
    if (o->after)
        result = parse_jobs(o->after, out, err);
    if (result == STATUS_OK && o->not_before)
        result = moment_parse("--not-before", o->not_before, clock_wall_s(), &out->not_before, err);
    if (result == STATUS_OK && o->require) {
        result = tags_parse(o->require, out->require, err);
        if (result != STATUS_OK)
            error_prefix(err, "--require");
    }
    out->memory_said = o->memory != UINT64_MAX;
    out->memory = out->memory_said ? o->memory : 0;
    return result;
}

void needs_request_set(Azulejo__Wire__JobSubmit *submit, struct needs_request *needs)
{
    submit->n_after = needs->after_count;
    submit->after = needs->after;
    submit->not_before = needs->not_before;
    submit->require = needs->require;
    submit->memory = needs->memory;
    submit->memory_said = needs->memory_said;
}
