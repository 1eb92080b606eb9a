#include "coordinator/store/files/audit.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "common/base/json_quote.h"
#include "common/system/log.h"
#include "common/base/memory.h"

enum { TEXT_MAX = sizeof((struct error *)0)->text };

status audit_init(struct audit *a, const char *folder, struct error *err)
{
    *a = (struct audit){.fd = -1};
    if (!folder)
        return STATUS_OK;
    a->path = mem_alloc(strlen(folder) + sizeof "/audit.log");
    NEED(a->path, err, "the audit log");
    sprintf(a->path, "%s/audit.log", folder);
    return STATUS_OK;
}

void audit_release(struct audit *a)
{
    if (a->fd >= 0)
        close(a->fd);
    mem_free(a->path);
    *a = (struct audit){.fd = -1};
}

/* ---- the file ------------------------------------------------------------------------------- */

/* audit.log.3 -> audit.log.4, ..., audit.log -> audit.log.1 */
static int rotate(struct audit *a)
{
    struct buffer from = BUFFER_INIT, to = BUFFER_INIT;
    int ok = 1;

    for (int i = AUDIT_OLD_FILES - 1; i >= 0 && ok; i--) {
        buffer_clear(&from);
        buffer_clear(&to);
        buffer_puts(&from, a->path);
        if (i > 0)
            buffer_printf(&from, ".%d", i);
        buffer_printf(&to, "%s.%d", a->path, i + 1);
        ok = buffer_ok(&from) && buffer_ok(&to) &&
             (rename(buffer_text(&from), buffer_text(&to)) == 0 || errno == ENOENT);
    }
    buffer_release(&from);
    buffer_release(&to);
    return ok;
}

/* Is the open file still the one at the path? Somebody may have moved it away. */
static int is_current(const struct audit *a)
{
    struct stat open_file, named;

    return a->fd >= 0 && fstat(a->fd, &open_file) == 0 && stat(a->path, &named) == 0 &&
           open_file.st_dev == named.st_dev && open_file.st_ino == named.st_ino;
}

/* A line that a crash cut short gets its end. */
static int end_line(int fd, off_t size)
{
    char last = '\n';

    if (size > 0 && pread(fd, &last, 1, size - 1) != 1)
        return 0;
    return last == '\n' || write(fd, "\n", 1) == 1;
}

static int open_file(struct audit *a)
{
    struct stat file;

    if (a->fd >= 0)
        close(a->fd);
    a->fd = open(a->path, O_RDWR | O_APPEND | O_CREAT | O_CLOEXEC, 0600);
    return a->fd >= 0 && fstat(a->fd, &file) == 0 && end_line(a->fd, file.st_size);
}

/* Write all of it or nothing. */
static int append(struct audit *a, const char *line, size_t size)
{
    struct stat file;
    ssize_t wrote;

    if (!is_current(a) && !open_file(a))
        return 0;
    if (fstat(a->fd, &file) != 0)
        return 0;
    if (file.st_size > 0 && file.st_size + (off_t)size > AUDIT_FILE_BYTES) {
        if (!rotate(a) || !open_file(a) || fstat(a->fd, &file) != 0)
            return 0;
    }
    wrote = write(a->fd, line, size);
    if (wrote == (ssize_t)size)
        return 1;
    if (wrote >= 0) {
        if (ftruncate(a->fd, file.st_size) != 0)
            a->fd = (close(a->fd), -1); /* its end is mended when it is opened */
        errno = ENOSPC;
    }
    return 0;
}

/* ---- a line --------------------------------------------------------------------------------- */

static void put_time(struct buffer *line)
{
    struct timespec now;
    struct tm utc;
    char when[32];

    clock_gettime(CLOCK_REALTIME, &now);
    gmtime_r(&now.tv_sec, &utc);
    strftime(when, sizeof when, "%Y-%m-%dT%H:%M:%S", &utc);
    buffer_printf(line, "{\"time\": \"%s.%03ldZ\"", when, now.tv_nsec / 1000000);
}

static void put_text(struct buffer *line, const char *name, const char *text)
{
    char quoted[JSON_QUOTE_SIZE(TEXT_MAX)];

    json_quote(quoted, text, TEXT_MAX);
    buffer_printf(line, ", \"%s\": %s", name, quoted);
}

static void make_line(struct buffer *line, const struct audit *a, const struct audit_actor *actor, const char *verb,
                      uint64_t job, const char *details, const struct error *why)
{
    put_time(line);
    put_text(line, "who", actor->who);
    if (actor->key[0]) {
        put_text(line, "address", actor->address);
        put_text(line, "key", actor->key);
        buffer_printf(line, ", \"session\": %u", actor->session);
    }
    put_text(line, "verb", verb);
    if (job)
        buffer_printf(line, ", \"job\": %" PRIu64, job);
    if (details && strlen(details) <= AUDIT_DETAILS_MAX)
        buffer_printf(line, ", \"details\": %s", details);
    put_text(line, "outcome", !why ? "done" : why->code == STATUS_ERR_REFUSED ? "refused" : "failed");
    if (why) {
        buffer_printf(line, ", \"status\": %d", status_exit_code(why->code));
        put_text(line, "error", why->text);
    }
    if (a->lost)
        buffer_printf(line, ", \"lost\": %" PRIu64, a->lost);
    buffer_puts(line, "}\n");
}

void audit_note(struct audit *a, const struct audit_actor *actor, const char *verb, uint64_t job, const char *details,
                const struct error *why)
{
    struct buffer line = BUFFER_INIT;

    if (!a->path)
        return;
    errno = 0;
    make_line(&line, a, actor, verb, job, details, why);
    if (buffer_ok(&line) && append(a, buffer_text(&line), line.size)) {
        if (a->failing)
            log_info("%s: written again; %" PRIu64 " lines are lost", a->path, a->lost);
        a->failing = 0;
        a->lost = 0;
    } else {
        a->lost++;
        if (!a->failing)
            log_warn("%s: cannot be written: %s; what people do is not in it from now on", a->path,
                     strerror(errno ? errno : ENOMEM));
        a->failing = 1;
    }
    buffer_release(&line);
}
