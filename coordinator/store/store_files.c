/* The places of a job's films and outputs below the store's folder. */
#include <dirent.h>
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/base/file.h"
#include "common/base/log.h"
#include "common/base/memory.h"
#include "common/base/trash.h"
#include "coordinator/store/store_parts.h"

static status make_job_folder(const struct store *store, const char *kind, uint64_t job,
                              struct error *err)
{
    char name[48];

    snprintf(name, sizeof name, "%s/%" PRIu64, kind, job);
    return store_make_folder(store, name, err);
}

static void film_path(const struct store *store, uint64_t job, uint32_t frame, struct buffer *path)
{
    buffer_printf(path, "%s/films/%" PRIu64 "/frame-%04u.film", store->folder, job, frame);
}

static void kept_path(const struct store *store, uint64_t job, uint32_t frame, struct buffer *path)
{
    buffer_printf(path, "%s/films/%" PRIu64 "/frame-%04u.kept", store->folder, job, frame);
}

status store_film_open(struct store *store, uint64_t job, uint32_t frame, struct film *film,
                       uint32_t (*durable)[GROUPS], uint8_t *slot, struct film_file **out, struct error *err)
{
    struct buffer path = BUFFER_INIT, kept = BUFFER_INIT, notes = BUFFER_INIT;
    status s = make_job_folder(store, "films", job, err);

    *out = NULL;
    film_path(store, job, frame, &path);
    kept_path(store, job, frame, &kept);
    if (s == STATUS_OK && !(buffer_ok(&path) && buffer_ok(&kept)))
        s = error_no_memory(err, "a path");
    if (s == STATUS_OK)
        s = film_kept_load(buffer_text(&kept), job, frame, film, durable, &notes, err);
    if (s == STATUS_OK)
        s = film_file_open(out, buffer_text(&path), job, frame, film, durable, slot, err);
    if (s == STATUS_OK && notes.size > 0) {
        s = film_file_notes_restore(*out, &notes, err);
        if (s != STATUS_OK) {
            film_file_close(*out);
            *out = NULL;
        }
    }
    buffer_release(&notes);
    buffer_release(&kept);
    buffer_release(&path);
    return s;
}

static int may_exist(const struct buffer *path)
{
    struct stat info;

    /* A file that cannot be looked up may exist: opening it gives the reason. */
    return !buffer_ok(path) || stat(buffer_text(path), &info) == 0 ||
           (errno != ENOENT && errno != ENOTDIR);
}

int store_film_exists(const struct store *store, uint64_t job, uint32_t frame)
{
    struct buffer path = BUFFER_INIT, kept = BUFFER_INIT;
    int exists;

    film_path(store, job, frame, &path);
    kept_path(store, job, frame, &kept);
    exists = may_exist(&path) || may_exist(&kept);
    buffer_release(&kept);
    buffer_release(&path);
    return exists;
}

static void remove_path(const struct store *store, const struct buffer *path)
{
    if (buffer_ok(path) && trash_unlink(store->folder, buffer_text(path)) != 0 && errno != ENOENT)
        log_warn("%s: cannot be removed: %s", buffer_text(path), strerror(errno));
}

status store_film_keep(struct store *store, uint64_t job, uint32_t frame, const struct film *film,
                       struct film_file *file, struct error *err)
{
    struct buffer path = BUFFER_INIT, kept = BUFFER_INIT;
    status s = STATUS_OK;

    film_path(store, job, frame, &path);
    kept_path(store, job, frame, &kept);
    if (!buffer_ok(&path) || !buffer_ok(&kept))
        s = error_no_memory(err, "a path");
    if (s == STATUS_OK)
        s = film_kept_write(buffer_text(&kept), job, frame, film, file, err);
    if (s == STATUS_OK)
        remove_path(store, &path);
    buffer_release(&kept);
    buffer_release(&path);
    return s;
}

status store_film_reader(const struct store *store, uint64_t job, uint32_t frame,
                         const struct render_settings *settings, struct film_reader **out, struct error *err)
{
    struct buffer path = BUFFER_INIT, kept = BUFFER_INIT;
    status s;

    *out = NULL;
    film_path(store, job, frame, &path);
    kept_path(store, job, frame, &kept);
    s = buffer_ok(&path) && buffer_ok(&kept)
            ? film_reader_open(out, buffer_text(&kept), buffer_text(&path), job, frame, settings, err)
            : error_no_memory(err, "a path");
    buffer_release(&kept);
    buffer_release(&path);
    return s;
}

void store_film_remove(struct store *store, uint64_t job, uint32_t frame)
{
    struct buffer path = BUFFER_INIT;

    film_path(store, job, frame, &path);
    remove_path(store, &path);
    buffer_clear(&path);
    kept_path(store, job, frame, &path);
    remove_path(store, &path);
    buffer_release(&path);
}

int store_film_kept_remove(struct store *store, uint64_t job, uint32_t frame)
{
    struct buffer path = BUFFER_INIT;
    int gone;

    kept_path(store, job, frame, &path);
    gone = buffer_ok(&path) && trash_unlink(store->folder, buffer_text(&path)) == 0;
    buffer_release(&path);
    return gone;
}

void store_films_remove(struct store *store, uint64_t job)
{
    struct buffer path = BUFFER_INIT;
    DIR *folder;
    const struct dirent *entry;

    buffer_printf(&path, "%s/films/%" PRIu64, store->folder, job);
    if (buffer_ok(&path) && trash_take(store->folder, buffer_text(&path))) {
        buffer_release(&path);
        return;
    }
    folder = buffer_ok(&path) ? opendir(buffer_text(&path)) : NULL;
    if (folder) {
        while ((entry = readdir(folder)))
            if (entry->d_name[0] != '.')
                unlinkat(dirfd(folder), entry->d_name, 0);
        closedir(folder);
        rmdir(buffer_text(&path));
    }
    buffer_release(&path);
}

int store_outputs_remove(struct store *store, uint64_t job)
{
    struct buffer path = BUFFER_INIT;
    int gone = 0;

    buffer_printf(&path, "%s/outputs/%" PRIu64, store->folder, job);
    if (buffer_ok(&path)) {
        if (!trash_take(store->folder, buffer_text(&path)) && errno != ENOENT)
            file_remove_tree(buffer_text(&path));
        gone = !may_exist(&path);
    }
    if (!gone)
        log_warn("job %" PRIu64 ": its pictures cannot be removed; the next start tries again", job);
    buffer_release(&path);
    return gone;
}

void store_films_list(const struct store *store, void (*visit)(void *user, uint64_t job), void *user)
{
    char *path = file_join(store->folder, "films");
    DIR *folder = path ? opendir(path) : NULL;
    const struct dirent *entry;

    while (folder && (entry = readdir(folder))) {
        char *end;
        uint64_t job = strtoull(entry->d_name, &end, 10);
        if (job > 0 && *end == 0)
            visit(user, job);
    }
    if (folder)
        closedir(folder);
    mem_free(path);
}

void store_output_path(const struct store *store, uint64_t job, uint32_t frame,
                       const char *extension, struct buffer *path)
{
    buffer_printf(path, "%s/outputs/%" PRIu64 "/frame-%04u.%s", store->folder, job, frame,
                  extension);
}

status store_output_read(const struct store *store, uint64_t job, uint32_t frame,
                         const char *extension, size_t limit_bytes, struct buffer *out,
                         struct error *err)
{
    struct buffer path = BUFFER_INIT;
    status s;

    store_output_path(store, job, frame, extension, &path);
    s = buffer_ok(&path) ? file_read_kept(buffer_text(&path), limit_bytes, out, err)
                         : error_no_memory(err, "a path");
    buffer_release(&path);
    return s;
}

status store_output_write(struct store *store, uint64_t job, uint32_t frame, const char *extension,
                          const struct buffer *data, struct error *err)
{
    struct buffer path = BUFFER_INIT;
    status s = make_job_folder(store, "outputs", job, err);

    store_output_path(store, job, frame, extension, &path);
    if (s == STATUS_OK && !buffer_ok(&path))
        s = error_no_memory(err, "a path");
    if (s == STATUS_OK)
        s = file_write_private(buffer_text(&path), data->data, data->size, err);
    buffer_release(&path);
    return s;
}
