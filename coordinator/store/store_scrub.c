#include "coordinator/store/store_scrub.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/base/digest.h"
#include "common/base/memory.h"
#include "common/system/file.h"
#include "coordinator/store/files/blobs.h"
#include "coordinator/store/store_parts.h"

enum {
    READ_BYTES = 256 << 10,
    STEP_FILES = 256, /* in one step, whatever their sizes */
};

enum part { BLOBS, OUTPUTS, ROWS, PARTS };

/* The names of a folder, without those that begin with a dot. */
struct names {
    char **items;
    size_t count, capacity, at;
};

struct scrub {
    struct store *store;
    enum part part;
    struct names folders, files; /* of the part; of folders.items[folders.at - 1] */
    int is_open;                 /* `folders` has been read */
    /* The file that is being read. fd -1: none */
    int fd;
    char *path;
    struct digest_stream *stream;
    uint8_t *piece;
};

static void names_release(struct names *n)
{
    for (size_t i = 0; i < n->count; i++)
        mem_free(n->items[i]);
    mem_free(n->items);
    *n = (struct names){0};
}

static void names_read(struct names *n, const char *path)
{
    DIR *folder = opendir(path);
    const struct dirent *entry;

    names_release(n);
    while (folder && (entry = readdir(folder))) {
        char *copy = entry->d_name[0] != '.' ? mem_strdup(entry->d_name) : NULL;
        if (copy && !MEM_GROW(n->items, n->capacity, n->count + 1)) {
            mem_free(copy);
            break;
        }
        if (copy)
            n->items[n->count++] = copy;
    }
    if (folder)
        closedir(folder);
}

struct scrub *scrub_new(struct store *store)
{
    struct scrub *s = mem_calloc(1, sizeof *s);

    if (!s)
        return NULL;
    s->store = store;
    s->fd = -1;
    return s;
}

static void close_file(struct scrub *s)
{
    if (s->fd >= 0)
        close(s->fd);
    s->fd = -1;
    digest_stream_free(s->stream);
    s->stream = NULL;
    mem_free(s->path);
    s->path = NULL;
}

void scrub_free(struct scrub *s)
{
    if (!s)
        return;
    close_file(s);
    names_release(&s->folders);
    names_release(&s->files);
    mem_free(s->piece);
    mem_free(s);
}

static void fault(struct scrub_report *report, const char *format, ...) __attribute__((format(printf, 2, 3)));
static void fault(struct scrub_report *report, const char *format, ...)
{
    va_list list;

    report->faults++;
    if (report->line_count == SCRUB_FAULTS_MAX)
        return;
    va_start(list, format);
    vsnprintf(report->lines[report->line_count++], SCRUB_LINE, format, list);
    va_end(list);
}

/* ---- a file ------------------------------------------------------------------------------------ */

/* Is the file still there under its name? Otherwise it was replaced or removed while it was read. */
static int is_same_file(const struct scrub *s)
{
    struct stat own, there;

    return fstat(s->fd, &own) == 0 && stat(s->path, &there) == 0 && own.st_ino == there.st_ino && own.st_dev == there.st_dev;
}

static void judge_blob(struct scrub *s, const char *name, const struct digest *is, struct scrub_report *report)
{
    struct digest digest;

    if (digest_from_hex(&digest, name) != STATUS_OK || digest_equal(is, &digest) || !is_same_file(s))
        return;
    if (blobs_check(s->store->folder, &digest) != 0) /* a machine that reads wrongly is another trouble */
        return;
    blobs_drop_damaged(s->store->folder, &digest);
    fault(report, "%s: was damaged on disk and is removed: its scene's next submission sends it again", s->path);
}

static void judge_output(struct scrub *s, const char *name, const struct digest *is, struct scrub_report *report)
{
    const uint64_t job = strtoull(s->folders.items[s->folders.at - 1], NULL, 10);
    struct error err = {0};
    char *end;
    uint32_t frame;

    if (strncmp(name, "frame-", 6) != 0)
        return;
    frame = (uint32_t)strtoul(name + 6, &end, 10);
    if (*end == '.' && is_same_file(s) &&
        store_output_check(s->store, job, frame, end + 1, is, &err) == STATUS_ERR_CORRUPT)
        fault(report, "%s", err.text);
}

static void end_file(struct scrub *s, struct scrub_report *report)
{
    const char *name = s->files.items[s->files.at - 1];
    struct digest is;

    if (digest_stream_final(s->stream, &is) == STATUS_OK) {
        report->files++;
        if (s->part == BLOBS)
            judge_blob(s, name, &is, report);
        else
            judge_output(s, name, &is, report);
    }
    s->stream = NULL;
    (void)posix_fadvise(s->fd, 0, 0, POSIX_FADV_DONTNEED);
    close_file(s);
}

/* Of what the disk holds, not of what the kernel remembers. */
static void open_file(struct scrub *s, const char *folder, const char *name)
{
    s->path = file_join(folder, name);
    s->fd = s->path ? open(s->path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW) : -1;
    s->stream = s->fd >= 0 ? digest_stream_new() : NULL;
    if (!s->stream)
        close_file(s);
    else
        (void)posix_fadvise(s->fd, 0, 0, POSIX_FADV_DONTNEED);
}

/* Bytes that were read; 0: the file is over. */
static uint64_t read_some(struct scrub *s, struct scrub_report *report)
{
    ssize_t got = read(s->fd, s->piece, READ_BYTES);

    if (got > 0 && digest_stream_add(s->stream, s->piece, (size_t)got) == STATUS_OK)
        return (uint64_t)got;
    if (got == 0)
        end_file(s, report);
    else
        close_file(s);
    return 0;
}

/* ---- rows -------------------------------------------------------------------------------------- */

/* On a connection of its own, which only reads. */
static void check_rows(struct scrub *s, struct scrub_report *report)
{
    char *path = file_join(s->store->folder, "queue.sqlite");
    sqlite3_stmt *row = NULL;
    sqlite3 *db = NULL;

    if (path && sqlite3_open_v2(path, &db, SQLITE_OPEN_READONLY | SQLITE_OPEN_NOMUTEX, NULL) == SQLITE_OK &&
        rows_find(db) == SQLITE_OK &&
        sqlite3_prepare_v2(db, "SELECT tab, key FROM temp.bad ORDER BY tab, key", -1, &row, NULL) == SQLITE_OK)
        while (sqlite3_step(row) == SQLITE_ROW) {
            const char *table = (const char *)sqlite3_column_text(row, 0), *key = (const char *)sqlite3_column_text(row, 1);
            const int is_job = table && strcmp(table, "jobs") == 0;
            if (is_job && report->job_count < SCRUB_FAULTS_MAX)
                report->jobs[report->job_count++] = strtoull(key ? key : "", NULL, 10);
            fault(report, "queue.sqlite: a row of %s was damaged on disk%s", table ? table : "?",
                  is_job ? "; it is written again" : ": end the coordinator and run 'azulejo-coordinator --check --repair'");
        }
    sqlite3_finalize(row);
    sqlite3_close(db);
    mem_free(path);
    report->files++;
}

/* ---- the round --------------------------------------------------------------------------------- */

static void next_part(struct scrub *s, struct scrub_report *report)
{
    names_release(&s->folders);
    names_release(&s->files);
    s->is_open = 0;
    s->part++;
    if (s->part == PARTS) {
        s->part = BLOBS;
        report->is_round = 1;
    }
}

/* The next file is open, or the round is over. */
static void find_file(struct scrub *s, struct scrub_report *report)
{
    static const char *const tops[PARTS] = {"blobs", "outputs", NULL};

    while (s->fd < 0 && !report->is_round) {
        char *top = tops[s->part] ? file_join(s->store->folder, tops[s->part]) : NULL;
        char *folder = NULL;
        if (s->part == ROWS) {
            check_rows(s, report);
            next_part(s, report);
            continue;
        }
        if (top && !s->is_open)
            names_read(&s->folders, top);
        s->is_open = 1;
        if (top && s->files.at == s->files.count && s->folders.at < s->folders.count) {
            folder = file_join(top, s->folders.items[s->folders.at++]);
            if (folder)
                names_read(&s->files, folder);
        } else if (top && s->files.at < s->files.count) {
            folder = file_join(top, s->folders.items[s->folders.at - 1]);
            if (folder)
                open_file(s, folder, s->files.items[s->files.at]);
            s->files.at++;
        } else {
            next_part(s, report);
        }
        mem_free(folder);
        mem_free(top);
    }
}

void scrub_step(struct scrub *s, uint64_t bytes, struct scrub_report *report)
{
    uint64_t done = 0;

    *report = (struct scrub_report){0};
    if (!s->piece && !(s->piece = mem_alloc(READ_BYTES)))
        return;
    while (done < bytes && report->files < STEP_FILES && !report->is_round) {
        if (s->fd < 0)
            find_file(s, report);
        if (s->fd >= 0)
            done += read_some(s, report);
    }
}
