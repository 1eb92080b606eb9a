/* log: lines on standard error, "time level program: text", or as JSON, an object a line: {"time":
 * "2026-03-01T12:00:00.000Z", "level": "info", "program": "azulejo-worker", "pid": 17, "text": "..."}
 *
 * The level and the program's name are set once at the start. Safe from any thread: a line is one write.
 */
#pragma once

#include "common/base/status.h"

enum log_level { LOG_LEVEL_ERROR, LOG_LEVEL_WARN, LOG_LEVEL_INFO, LOG_LEVEL_DEBUG };

void log_setup(const char *program, enum log_level level);

/* Choose the lines' form, "text" or "json": as given, else (NULL) by AZULEJO_LOG_FORMAT, else text. ERR_USAGE:
 * the variable says neither. */
status log_set_format(const char *given, struct error *err) MUST_CHECK;
int log_is_json(void);

/* "error", "warn", "info", "debug" -> level; -1 for anything else. */
int log_level_parse(const char *name);

void log_line(enum log_level level, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Also give every line that is logged to `take`, without time and program. It is called by any thread,
 * and must not log. */
void log_tap(void (*take)(enum log_level level, const char *text));

#define log_error(...) log_line(LOG_LEVEL_ERROR, __VA_ARGS__)
#define log_warn(...) log_line(LOG_LEVEL_WARN, __VA_ARGS__)
#define log_info(...) log_line(LOG_LEVEL_INFO, __VA_ARGS__)
#define log_debug(...) log_line(LOG_LEVEL_DEBUG, __VA_ARGS__)
