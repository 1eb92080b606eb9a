#include "client/options/needs_options.h"

#include <string.h>

#include "client/terminal/moment.h"
#include "client/terminal/parse.h"
#include "common/system/clock.h"

/* "3,17". */
static status parse_jobs(const char *text, struct job_needs *out, struct error *err)
{
    const char *at = text;

    for (;; at++) {
        uint64_t job;
        at = parse_digits(at, INT64_MAX, &job);
        if (!at || job == 0 || (*at && *at != ','))
            return error_set(err, STATUS_ERR_USAGE,
                             "--after: '%.64s' is not a list of jobs' numbers, write JOB[,JOB]... as in 3,17", text);
        if (out->after_count == JOB_AFTER_MAX)
            return error_set(err, STATUS_ERR_USAGE, "--after: at most %d jobs", JOB_AFTER_MAX);
        out->after[out->after_count++] = job;
        if (*at == 0)
            return STATUS_OK;
    }
}

status needs_options_check(const struct needs_options *o, struct job_needs *out, struct error *err)
{
    const char *after = o->said[NEED_after].text, *not_before = o->said[NEED_not_before].text;
    const char *require = o->said[NEED_require].text, *memory = o->said[NEED_memory].text;
    status result;

    memset(out, 0, sizeof *out);
    result = settings_said(job_needs_rows, NEED_COUNT, o->said, out, err);
    if (result == STATUS_OK && after)
        result = parse_jobs(after, out, err);
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
