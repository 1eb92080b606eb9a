/* Files as they arrive: held a piece at a time, written in the thread pool to a file of its own, which gets its name
 * when it is whole. */
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "common/base/memory.h"
#include "common/system/trash.h"
#include "web/base/control.h"
#include "web/base/problem.h"
#include "web/uploads/import_parts.h"
#include "web/web.h"
#include "web/web.h"

enum { PIECE_BYTES = 1 << 20 };  /* the body pauses above this many unwritten bytes */

struct import_write {
    struct import_write *next;
    struct import *import;
    struct web_request *request; /* NULL: vanished, or answered */
    char *path;                  /* below files/ */
    char *temporary;
    int fd; /* -1: not open */
    uint64_t bytes;
    struct buffer held; /* not handed to a task yet */
    int working, ended, paused;
};

/* A piece on its way to the disk. While it works, the write's `fd` is its own. */
struct import_piece {
    uv_work_t work;
    struct import_write *write;
    status result;
    struct error error;
    struct buffer data;
    int last;
    uint32_t folders_left; /* that may be made, */
    uint32_t folders;      /* and were */
    int replaces;          /* there was a file of that name, of so many bytes */
    uint64_t replaced_bytes;
};

/* ---- in the thread pool ------------------------------------------------------------------- */

static status check_disk(const char *folder, uint64_t size, struct error *err)
{
    struct statvfs info;
    uint64_t disk, left, keep;

    if (statvfs(folder, &info) != 0)
        return error_set(err, STATUS_ERR_IO, "the disk for uploads cannot be used: %s", strerror(errno));
    disk = (uint64_t)info.f_blocks * info.f_frsize;
    left = (uint64_t)info.f_bavail * info.f_frsize;
    keep = disk / 10 < IMPORT_FREE_BYTES ? disk / 10 : IMPORT_FREE_BYTES;
    if (left < keep + size)
        return error_set(err, STATUS_ERR_IO,
                         "the disk for uploads is nearly full: %" PRIu64 " MiB are free and %" PRIu64
                         " MiB must remain; free room on it, or upload less",
                         left >> 20, keep >> 20);
    return STATUS_OK;
}

static status open_file(struct import_write *w, struct error *err)
{
    w->fd = open(w->temporary, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
    return w->fd >= 0 ? STATUS_OK : error_set(err, STATUS_ERR_IO, "%s: cannot be stored: %s", w->path, strerror(errno));
}

static status write_all(struct import_write *w, const struct buffer *data, struct error *err)
{
    for (size_t done = 0; done < data->size;) {
        ssize_t n = write(w->fd, data->data + done, data->size - done);
        if (n < 0 && errno == EINTR)
            continue;
        if (n <= 0)
            return error_set(err, STATUS_ERR_IO, "%s: cannot be stored: %s", w->path,
                             n < 0 ? strerror(errno) : "the disk takes no more");
        done += (size_t)n;
    }
    return STATUS_OK;
}

/* Make the folders of `final`, which begins with the import's folder. */
static status make_folders(struct import_piece *p, char *final, size_t from, struct error *err)
{
    const char *path = p->write->path;

    for (char *slash = strchr(final + from, '/'); slash; slash = strchr(slash + 1, '/')) {
        int made;
        *slash = 0;
        made = mkdir(final, 0700) == 0;
        if (!made && errno != EEXIST)
            return error_set(err, errno == ENOTDIR ? STATUS_ERR_USAGE : STATUS_ERR_IO,
                             "%s: its folder cannot be made: %s", path, strerror(errno));
        *slash = '/';
        p->folders += (uint32_t)made;
        if (p->folders > p->folders_left)
            return error_set(err, STATUS_ERR_LIMIT, "%s: an upload may have at most %d folders", path,
                             IMPORT_FILES_MAX);
    }
    return STATUS_OK;
}

static status take_name(struct import_piece *p, struct error *err)
{
    struct import_write *w = p->write;
    struct buffer final = BUFFER_INIT;
    struct stat info;
    status s = STATUS_OK;
    size_t from;

    buffer_printf(&final, "%s/files/", w->import->folder);
    from = final.size;
    buffer_puts(&final, w->path);
    if (!buffer_ok(&final))
        s = error_no_memory(err, "a path");
    THEN(s, make_folders(p, (char *) final.data, from, err));
    if (s == STATUS_OK && lstat(buffer_text(&final), &info) == 0) {
        p->replaces = 1;
        p->replaced_bytes = (uint64_t)info.st_size;
        if (!S_ISREG(info.st_mode))
            s = error_set(err, STATUS_ERR_USAGE, "%s: there is a folder of that name", w->path);
    }
    if (s == STATUS_OK && rename(w->temporary, buffer_text(&final)) != 0)
        s = error_set(err, errno == ENOTDIR ? STATUS_ERR_USAGE : STATUS_ERR_IO, "%s: cannot be stored: %s", w->path,
                      strerror(errno));
    buffer_release(&final);
    return s;
}

static void run_piece(uv_work_t *work)
{
    struct import_piece *p = work->data;
    struct import_write *w = p->write;
    struct error *err = &p->error;
    status s = check_disk(w->import->folder, p->data.size, err);

    if (s == STATUS_OK && w->fd < 0)
        s = open_file(w, err);
    THEN(s, write_all(w, &p->data, err));
    if ((s != STATUS_OK || p->last) && w->fd >= 0) {
        close(w->fd);
        w->fd = -1;
    }
    if (s == STATUS_OK && p->last)
        s = take_name(p, err);
    p->result = s;
}

/* ---- on the loop -------------------------------------------------------------------------- */

static void write_free(struct import_write *w, int whole)
{
    struct import *import = w->import;
    struct imports *all = import->all;

    for (struct import_write **at = &all->writing; *at; at = &(*at)->next)
        if (*at == w) {
            *at = w->next;
            break;
        }
    if (w->fd >= 0)
        close(w->fd);
    if (!whole) {
        import->bytes -= w->bytes;
        if (w->temporary)
            (void)trash_unlink(all->folder, w->temporary);
    }
    all->writes--;
    import->writes--;
    buffer_release(&w->held);
    mem_free(w->path);
    mem_free(w->temporary);
    mem_free(w);
    import_settle(import);
}

static void fail(struct import_write *w, const struct error *err)
{
    struct web_request *request = w->request;

    w->request = NULL;
    if (!w->working)
        write_free(w, 0);
    if (request) {
        request->state = NULL;
        import_fail(request, err);
    }
}

static void end_piece(uv_work_t *work, int code);

/* Hand what is held to the pool, if nothing is there yet. */
static void pump(struct import_write *w)
{
    struct import_piece *p;
    struct error err = {0};

    if (w->working || (!w->ended && w->held.size == 0))
        return;
    if (!buffer_ok(&w->held)) {
        error_no_memory(&err, "an upload");
        fail(w, &err);
        return;
    }
    p = mem_calloc(1, sizeof *p);
    if (!p) {
        error_no_memory(&err, "a piece of a file");
        fail(w, &err);
        return;
    }
    p->write = w;
    p->data = w->held;
    buffer_init(&w->held);
    p->last = w->ended;
    p->folders_left = IMPORT_FILES_MAX - w->import->folders;
    w->working = 1;
    p->work.data = p;
    uv_queue_work(w->import->all->web->loop, &p->work, run_piece, end_piece); /* never fails with these */
    if (w->paused && w->request && !w->ended) {
        w->paused = 0;
        web_pause_body(w->request, 0);
    }
}

static void stored(struct import_write *w, const struct import_piece *p)
{
    struct import *import = w->import;
    struct web_request *request = w->request;
    json_t *answer = json_pack("{s:s, s:I}", "path", w->path, "bytes", (json_int_t)w->bytes);

    import->folders += p->folders;
    import->files += !p->replaces;
    import->bytes -= p->replaced_bytes;
    write_free(w, 1);
    if (request) {
        request->state = NULL;
        import_answer(request, 201, answer);
    } else {
        json_decref(answer);
    }
}

static void end_piece(uv_work_t *work, int code)
{
    struct import_piece *p = work->data;
    struct import_write *w = p->write;

    (void)code; /* it is never cancelled */
    w->working = 0;
    if (p->result != STATUS_OK) {
        w->import->folders += p->folders;
        fail(w, &p->error);
    } else if (p->last) {
        stored(w, p);
    } else if (!w->request) {
        write_free(w, 0);
    } else {
        pump(w);
    }
    buffer_release(&p->data);
    mem_free(p);
}

/* By the limits of the token and of the store. */
static status check_bytes(const struct import *import, const char *path, uint64_t more, struct error *err)
{
    const struct imports *all = import->all;
    const struct farm_state *state = &all->web->state;
    uint64_t own = more, every = more;

    for (const struct import *i = all->list; i; i = i->next) {
        every += i->bytes;
        own += i->token == import->token ? i->bytes : 0;
    }
    if (own > IMPORT_TOKEN_BYTES)
        return error_set(err, STATUS_ERR_LIMIT,
                         "%s: the uploads of one token may have %" PRIu64 " GiB together: submit or delete one "
                         "first, or use 'azulejo submit'", path, IMPORT_TOKEN_BYTES >> 30);
    if (every > state->uploads_max)
        return error_set(err, STATUS_ERR_LIMIT,
                         "%s: the store would take more than its --store-limit of %" PRIu64 " MiB: remove jobs "
                         "first", path, state->store_limit >> 20);
    return STATUS_OK;
}

static void on_body(struct web_request *request, const uint8_t *data, size_t size)
{
    struct import_write *w = request->state;
    struct error err = {0};

    if (!w)
        return;
    if (size == 0) {
        w->ended = 1;
    } else if (check_bytes(w->import, w->path, size, &err) != STATUS_OK) {
        fail(w, &err);
        return;
    } else {
        buffer_append(&w->held, data, size);
        w->bytes += size;
        w->import->bytes += size;
    }
    pump(w);
    w = request->state;
    if (w && !w->ended && !w->paused && w->held.size >= PIECE_BYTES) {
        w->paused = 1;
        web_pause_body(request, 1);
    }
}

static void on_gone(struct web_request *request)
{
    struct import_write *w = request->state;

    if (!w)
        return;
    request->state = NULL;
    w->request = NULL;
    if (!w->working)
        write_free(w, 0);
}

void import_writes_stop(struct import *import)
{
    struct import_write *next;
    struct error err = {0};

    error_set(&err, STATUS_ERR_NOT_FOUND, "the upload was removed");
    for (struct import_write *w = import->all->writing; w; w = next) {
        next = w->next;
        if (w->import == import)
            fail(w, &err);
    }
}

static status check_file(const struct import *import, const char *path, struct error *err)
{
    status s = import_path_check(path, err);

    if (s == STATUS_OK && import->state != IMPORT_OPEN)
        s = error_set(err, STATUS_ERR_REFUSED, "the upload is being imported, or was: begin a new one");
    if (s == STATUS_OK && import->files + import->writes >= IMPORT_FILES_MAX)
        s = error_set(err, STATUS_ERR_LIMIT, "an upload may have at most %d files", IMPORT_FILES_MAX);
    if (s == STATUS_OK && import->all->writes >= IMPORT_WRITES_MAX)
        s = error_set(err, STATUS_ERR_LIMIT, "%d files are being uploaded: try again when one has ended",
                      IMPORT_WRITES_MAX);
    for (const struct import_write *w = import->all->writing; w && s == STATUS_OK; w = w->next)
        if (w->import == import && strcmp(w->path, path) == 0)
            s = error_set(err, STATUS_ERR_REFUSED, "%s: is being uploaded already", path);
    return s == STATUS_OK ? web_store_usable(import->all->web, err) : s;
}

static struct import_write *write_new(struct import *import, const char *path)
{
    struct import_write *w = mem_calloc(1, sizeof *w);
    struct buffer temporary = BUFFER_INIT;

    if (!w)
        return NULL;
    buffer_printf(&temporary, "%s/tmp/%" PRIu64, import->folder, ++import->all->last_write);
    w->fd = -1;
    w->import = import;
    w->path = mem_strdup(path);
    w->temporary = buffer_ok(&temporary) ? mem_strdup(buffer_text(&temporary)) : NULL;
    buffer_release(&temporary);
    w->next = import->all->writing;
    import->all->writing = w;
    import->writes++;
    import->all->writes++;
    return w;
}

void import_file(struct web_request *request)
{
    struct import *import = NULL;
    struct import_write *w = NULL;
    struct error err = {0};
    const char *length = web_header(request, "content-length");
    const uint64_t announced = length ? strtoull(length, NULL, 10) : 0;
    status s = import_find(request, &import, &err);

    if (announced > IMPORT_TOKEN_BYTES) {
        (void)error_set(&err, STATUS_ERR_LIMIT, "the uploads of one token may have %" PRIu64 " GiB together: use 'azulejo submit'",
                        IMPORT_TOKEN_BYTES >> 30);
        problem_answer(request, PROBLEM_TOO_LARGE, err.text);
        return;
    }
    THEN(s, check_file(import, request->parameters[1], &err));
    THEN(s, check_bytes(import, request->parameters[1], announced, &err)); /* rather than when they have come */
    if (s == STATUS_OK) {
        w = write_new(import, request->parameters[1]);
        if (!w || !w->path || !w->temporary) {
            s = error_no_memory(&err, "an upload");
            if (w)
                write_free(w, 1);
        }
    }
    if (s != STATUS_OK) {
        import_fail(request, &err);
        return;
    }
    w->request = request;
    request->state = w;
    request->on_body = on_body;
    request->on_gone = on_gone;
}
