#include "web/base/problem.h"

#include "protocol/json/json_wire.h"

const struct problem_kind problem_kinds[PROBLEM_COUNT] = {
#define PROBLEM_ROW(name, code, http, title, meaning) {code, http, title, meaning},
    PROBLEM_MAP(PROBLEM_ROW)
#undef PROBLEM_ROW
};

/* What has one meaning wherever it comes from. */
static enum problem plain(status code)
{
    switch (code) {
    case STATUS_ERR_NOT_FOUND: return PROBLEM_NOT_FOUND;
    case STATUS_ERR_FORBIDDEN: return PROBLEM_FORBIDDEN;
    case STATUS_ERR_LIMIT: return PROBLEM_LIMIT;
    case STATUS_ERR_UNSUPPORTED: return PROBLEM_UNSUPPORTED;
    case STATUS_ERR_NO_MEMORY:
    case STATUS_ERR_IO:
    case STATUS_ERR_UNREACHABLE: return PROBLEM_UNAVAILABLE;
    case STATUS_ERR_TIMEOUT: return PROBLEM_TIMEOUT;
    default: return PROBLEM_INTERNAL;
    }
}

enum problem problem_of_request(status code, int has_token)
{
    switch (code) {
    case STATUS_ERR_USAGE:
    case STATUS_ERR_INPUT:
    case STATUS_ERR_PROTOCOL: return PROBLEM_INPUT;
    case STATUS_ERR_REFUSED: return has_token ? PROBLEM_FORBIDDEN : PROBLEM_NO_TOKEN;
    default: return plain(code);
    }
}

enum problem problem_of_farm(status code)
{
    switch (code) {
    case STATUS_ERR_USAGE:
    case STATUS_ERR_INPUT:
    case STATUS_ERR_PROTOCOL: return PROBLEM_VALUE;
    case STATUS_ERR_REFUSED:
    case STATUS_ERR_MISMATCH:
    case STATUS_ERR_INCOMPLETE:
    case STATUS_ERR_JOB_FAILED: return PROBLEM_STATE;
    default: return plain(code);
    }
}

enum problem problem_of_http(unsigned http_status)
{
    for (int i = 0; i < PROBLEM_COUNT; i++)
        if (problem_kinds[i].http_status == http_status)
            return (enum problem)i;
    return PROBLEM_INTERNAL;
}

void problem_put(struct buffer *out, enum problem problem, const char *detail, const char *instance)
{
    const struct problem_kind *kind = &problem_kinds[problem];

    buffer_printf(out, "{\"type\":\"/docs/errors#%s\",\"title\":", kind->code);
    json_put_text(out, kind->title);
    buffer_printf(out, ",\"status\":%u,\"code\":\"%s\",\"detail\":", kind->http_status, kind->code);
    json_put_text(out, detail);
    buffer_puts(out, ",\"instance\":");
    json_put_text(out, instance);
    buffer_puts(out, "}\n");
}
