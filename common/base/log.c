#include "common/base/log.h"

#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum { LOG_LINE_MAX = 2048 };

static const char *const level_names[] = {"error", "warn", "info", "debug"};
static const char *program_name = "azulejo";
static enum log_level threshold = LOG_LEVEL_INFO;

static void (*_Atomic tap)(enum log_level level, const char *text);

void log_tap(void (*take)(enum log_level level, const char *text))
{
    atomic_store(&tap, take);
}

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

void log_line(enum log_level level, const char *format, ...)
{
    char line[LOG_LINE_MAX];
    struct timespec now;
    struct tm utc;
    va_list args;
    void (*take)(enum log_level level, const char *text) = atomic_load(&tap);
    size_t used, begin;
    int n;

    if (level > threshold)
        return;
    clock_gettime(CLOCK_REALTIME, &now);
    gmtime_r(&now.tv_sec, &utc);
    used = strftime(line, sizeof line, "%Y-%m-%dT%H:%M:%S", &utc);
    n = snprintf(line + used, sizeof line - used, ".%03ldZ %s %s: ", now.tv_nsec / 1000000,
                 level_names[level], program_name);
    if (n > 0)
        used += (size_t)n;
    begin = used;
    va_start(args, format);
    n = vsnprintf(line + used, sizeof line - used - 1, format, args);
    va_end(args);
    if (n > 0)
        used += (size_t)n;
    if (used > sizeof line - 2)
        used = sizeof line - 2;
    line[used] = 0;
    if (take)
        take(level, line + begin);
    line[used++] = '\n';
    if (write(STDERR_FILENO, line, used) < 0)
        return; /* there is nowhere to report this */
}
