#include "common/base/status.h"

#include <stdio.h>
#include <string.h>

static const struct {
    int exit_code;
    const char *text;
} statuses[STATUS_COUNT] = {
#define STATUS_ROW(name, exit_code, text) [STATUS_##name] = {exit_code, text},
    STATUS_MAP(STATUS_ROW)
#undef STATUS_ROW
};

const char *status_text(status code)
{
    if ((unsigned)code >= STATUS_COUNT)
        return "unknown status";
    return statuses[code].text;
}

int status_exit_code(status code)
{
    if ((unsigned)code >= STATUS_COUNT)
        return 1;
    return statuses[code].exit_code;
}

status error_set_(struct error *err, status code, const char *format, ...)
{
    if (err) {
        va_list args;
        err->code = code;
        va_start(args, format);
        vsnprintf(err->text, sizeof err->text, format, args);
        va_end(args);
    }
    return code;
}

void error_prefix(struct error *err, const char *format, ...)
{
    char old[sizeof err->text];
    va_list args;
    size_t used;

    if (!err)
        return;
    memcpy(old, err->text, sizeof old);
    va_start(args, format);
    vsnprintf(err->text, sizeof err->text, format, args);
    va_end(args);
    used = strlen(err->text);
    snprintf(err->text + used, sizeof err->text - used, ": %s", old);
}
