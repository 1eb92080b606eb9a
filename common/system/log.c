#include "common/system/log.h"

#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "common/base/json_quote.h"

enum { LOG_TEXT_MAX = 2000 };

static const char *const level_names[] = {"error", "warn", "info", "debug"};
static const char *program_name = "azulejo";
static enum log_level threshold = LOG_LEVEL_INFO;
static int is_json;

static void (*_Atomic tap)(enum log_level level, const char *text);

void log_tap(void (*take)(enum log_level level, const char *text)) { atomic_store(&tap, take); }

void log_setup(const char *program, enum log_level level)
{
    program_name = program;
    threshold = level;
}

int log_level_parse(const char *name)
{
    for (int i = 0; i < 4; i++)
        if (strcmp(name, level_names[i]) == 0)
            return i;
    return -1;
}

status log_set_format(const char *given, struct error *err)
{
    const char *name = given ? given : getenv("AZULEJO_LOG_FORMAT");

    if (!name || !name[0])
        name = "text";
    if (strcmp(name, "text") != 0 && strcmp(name, "json") != 0)
        return error_set(err, STATUS_ERR_USAGE, "AZULEJO_LOG_FORMAT: '%s' is not one of text, json", name);
    is_json = strcmp(name, "json") == 0;
    return STATUS_OK;
}

int log_is_json(void) { return is_json; }

/* One write, so that lines of threads do not mix. */
static void put(const char *line, size_t size)
{
    if (write(STDERR_FILENO, line, size) < 0)
        return; /* there is nowhere to report this */
}

void log_line(enum log_level level, const char *format, ...)
{
    char text[LOG_TEXT_MAX], line[JSON_QUOTE_SIZE(LOG_TEXT_MAX) + 256], when[32];
    struct timespec now;
    struct tm utc;
    va_list args;
    void (*take)(enum log_level level, const char *text) = atomic_load(&tap);
    size_t used;

    if (level > threshold)
        return;
    va_start(args, format);
    if (vsnprintf(text, sizeof text, format, args) < 0)
        text[0] = 0;
    va_end(args);
    if (take)
        take(level, text);
    clock_gettime(CLOCK_REALTIME, &now);
    gmtime_r(&now.tv_sec, &utc);
    used = strftime(when, sizeof when, "%Y-%m-%dT%H:%M:%S", &utc);
    snprintf(when + used, sizeof when - used, ".%03ldZ", now.tv_nsec / 1000000);
    if (is_json) {
        used = (size_t)snprintf(
            line, 256, "{\"time\": \"%s\", \"level\": \"%s\", \"program\": \"%s\", \"pid\": %ld, \"text\": ", when,
            level_names[level], program_name, (long)getpid());
        used += json_quote(line + used, text, sizeof text);
        line[used++] = '}';
    } else {
        used = (size_t)snprintf(line, sizeof line - 1, "%s %s %s: %s", when, level_names[level], program_name, text);
    }
    line[used++] = '\n';
    put(line, used);
}
