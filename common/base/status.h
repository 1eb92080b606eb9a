/* status: the result of a function that can fail, and its texts.
 *
 * A function that can fail returns a `status` and takes an optional `struct error *` as its last parameter. On failure
 * it fills the error with one sentence that names the file, the place and the remedy, and returns the same code. The
 * error is reported (logged or printed) exactly once, by the code that handles it.
 */
#pragma once

#include <stdarg.h>

/* One line per status: name, exit code of a program that ends with it, text.
 * Exit codes: 0 success, 1 internal, 2 usage, 3 bad input, 4 unreachable, 5 refused, 6 job failed or cancelled, 7 timed
 * out, 8 local I/O, 9 only a part was available, 10 a worker of another release, 11 done but not on disk yet, 12
 * `verify`: a tile differs. The numbers of the statuses themselves are part of the wire
 * protocol: new ones are added at the end. */
#define STATUS_MAP(X)                                                    \
    X(OK, 0, "success")                                                  \
    X(ERR_INTERNAL, 1, "internal error")                                 \
    X(ERR_NO_MEMORY, 1, "out of memory")                                 \
    X(ERR_USAGE, 2, "bad usage")                                         \
    X(ERR_INPUT, 3, "bad input")                                         \
    X(ERR_UNSUPPORTED, 3, "not supported")                               \
    X(ERR_LIMIT, 3, "a limit was exceeded")                              \
    X(ERR_UNREACHABLE, 4, "unreachable")                                 \
    X(ERR_REFUSED, 5, "refused")                                         \
    X(ERR_NOT_FOUND, 5, "not found")                                     \
    X(ERR_JOB_FAILED, 6, "job failed")                                   \
    X(ERR_TIMEOUT, 7, "timed out")                                       \
    X(ERR_IO, 8, "input/output error")                                   \
    X(ERR_CORRUPT, 8, "stored data is damaged")                          \
    X(ERR_PROTOCOL, 5, "protocol violation")                             \
    X(ERR_INCOMPLETE, 9, "incomplete")                                   \
    X(ERR_MISMATCH, 10, "the releases do not fit")                       \
    X(ERR_FORBIDDEN, 3, "not allowed")                                   \
    X(ERR_NOT_STORED, 11, "not stored yet")

typedef enum status {
#define STATUS_ENUM(name, exit_code, text) STATUS_##name,
    STATUS_MAP(STATUS_ENUM)
#undef STATUS_ENUM
        STATUS_COUNT
} status;

#define MUST_CHECK __attribute__((warn_unused_result))
/* A parameter that an interface gives and this function needs not. */
#define UNUSED __attribute__((unused))

/* One error, as text. Zero-initialise; the text is always terminated. */
struct error {
    status code;
    char text[1024];
};

/* The status's short text ("bad input"); never NULL. */
const char *status_text(status code);

/* Is the environment the cause (disk, permissions, descriptors, memory), so that the same call may
 * succeed later? 0: the request or the stored data is at fault, and waiting changes nothing. */
static inline int status_is_environment(status code) { return code == STATUS_ERR_IO || code == STATUS_ERR_NO_MEMORY; }

/* Is a scene that a worker could not make ready for this reason itself at fault, so that the same machine will never
 * render it? Anything else (memory, disk, descriptors, threads, a blob that is lost) may pass. */
static inline int status_is_scene(status code)
{
    return code == STATUS_ERR_INPUT || code == STATUS_ERR_UNSUPPORTED || code == STATUS_ERR_LIMIT;
}

/* The exit code of a program that ends because of `code`. */
int status_exit_code(status code);

/* Return at once if a step fails, where nothing is to be released: TRY(step(err)); */
#define TRY(...)                         \
    do {                                 \
        const status try_ = __VA_ARGS__; \
        if (try_ != STATUS_OK)           \
            return try_;                 \
    } while (0)

/* The next step, unless an earlier one failed, on the way to a common exit: THEN(s, step(err)); */
#define THEN(s, ...)           \
    do {                       \
        if ((s) == STATUS_OK)  \
            (s) = __VA_ARGS__; \
    } while (0)

/* Fill `err` (may be NULL) and return `code`, so that `return error_set(...)` reads well. The macro
 * shows the compiler and the analyser which value is returned. */
#define error_set(err, code, ...) error_set_result_(error_set_((err), (code), __VA_ARGS__), (code))
status error_set_(struct error *err, status code, const char *format, ...) __attribute__((format(printf, 3, 4)));
static inline status error_set_result_(status set UNUSED, status code) { return code; }

/* Put "context: " before the text of an error already set, to name the file or the place. */
void error_prefix(struct error *err, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Out of memory, in one place so that all messages agree. */
static inline status error_no_memory(struct error *err, const char *what)
{
    return error_set(err, STATUS_ERR_NO_MEMORY, "out of memory for %s", what);
}

/* Return so at once if there is no memory, where nothing is to be released: NEED(list, err, "the list"); */
#define NEED(condition, err, what)              \
    do {                                        \
        if (!(condition))                       \
            return error_no_memory(err, what);  \
    } while (0)
