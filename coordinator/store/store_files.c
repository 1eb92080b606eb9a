/* The places of a job's films and outputs below the store's folder. */
#include <dirent.h>
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/system/trash.h"
#include "coordinator/store/store_parts.h"

/* Is the folder still the one that was locked? Its disk may have been unmounted. */
static status same_folder(const struct store *store, struct error *err)
{
    char *path = file_join(store->folder, "lock");
    struct stat ours, found;
    status s = STATUS_OK;

    NEED(path, err, "the store");
    if (stat(path, &found) != 0)
        s = error_set(err, STATUS_ERR_IO, "%s: cannot be found: %s; was the store moved or unmounted?", path,
                      strerror(errno));
    else if (fstat(store->folder_lock.file, &ours) != 0 || ours.st_ino != found.st_ino || ours.st_dev != found.st_dev)
        s = error_set(err, STATUS_ERR_IO, "%s: is another folder than at the start; was it moved or unmounted?",
                      store->folder);
    mem_free(path);
    return s;
}

status store_make_folder(const struct store *store, const char *name, struct error *err)
{
    char *path = file_join(store->folder, name);
    status s = path ? same_folder(store, err) : error_no_memory(err, "the store");

    THEN(s, file_make_private_folder(path, err));
    mem_free(path);
    return s;
}

static status make_job_folder(const struct store *store, const char *kind, uint64_t job, struct error *err)
{
    char name[48];

    snprintf(name, sizeof name, "%s/%" PRIu64, kind, job);
    return store_make_folder(store, name, err);
}

/* The same without a sync, which a film's first commit does (store_film.c). */
static status make_films_folder(const struct store *store, uint64_t job, struct error *err)
{
    char name[48], *path;
    status s;

    snprintf(name, sizeof name, "films/%" PRIu64, job);
    path = file_join(store->folder, name);
    s = path ? same_folder(store, err) : error_no_memory(err, "the store");
    if (s == STATUS_OK && mkdir(path, 0700) != 0 && errno != EEXIST)
        s = file_make_private_folder(path, err); /* also the folder above, or says why not */
    mem_free(path);
    return s;
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
                       uint32_t (*durable)[GROUPS], struct film_file **out, struct error *err)
{
    struct buffer path = BUFFER_INIT, kept = BUFFER_INIT, notes[GROUPS] = {0};
    status s = make_films_folder(store, job, err);

    *out = NULL;
    film_path(store, job, frame, &path);
    kept_path(store, job, frame, &kept);
    if (s == STATUS_OK && !(buffer_ok(&path) && buffer_ok(&kept)))
        s = error_no_memory(err, "a path");
    THEN(s, film_kept_load(buffer_text(&kept), job, frame, film, durable, notes, err));
    THEN(s, film_file_open(out, buffer_text(&path), job, frame, film, durable, err));
    if (s == STATUS_OK) {
        s = film_file_notes_restore(*out, notes, err);
        if (s != STATUS_OK) {
            film_file_close(*out);
            *out = NULL;
        }
    }
    for (uint32_t g = 0; g < GROUPS; g++)
        buffer_release(&notes[g]);
    buffer_release(&kept);
    buffer_release(&path);
    return s;
}

status store_film_measure(struct store *store, uint64_t job, uint32_t frame, struct film *film, struct error *err)
{
    struct buffer path = BUFFER_INIT, kept = BUFFER_INIT;
    status s = STATUS_OK;

    film_path(store, job, frame, &path);
    kept_path(store, job, frame, &kept);
    if (!(buffer_ok(&path) && buffer_ok(&kept)))
        s = error_no_memory(err, "a path");
    THEN(s, film_levels_load(buffer_text(&kept), buffer_text(&path), job, frame, film, err));
    buffer_release(&kept);
    buffer_release(&path);
    return s;
}

static int may_exist(const struct buffer *path)
{
    struct stat info;

    /* A file that cannot be looked up may exist: opening it gives the reason. */
    return !buffer_ok(path) || stat(buffer_text(path), &info) == 0 || (errno != ENOENT && errno != ENOTDIR);
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

/* A small film in work is kept as it is: it is on disk already. 0: it is to be written. The new name need not be
 * durable: under the old one it is the frame's film as well. */
static int keep_as_it_is(const struct film *film, struct film_file *file, const struct buffer *path,
                         const struct buffer *kept)
{
    return buffer_ok(path) && file && film_file_bytes(file) <= film_kept_limit(film) && !may_exist(kept) &&
           rename(buffer_text(path), buffer_text(kept)) == 0;
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
    if (!keep_as_it_is(film, file, &path, &kept)) {
        THEN(s, film_kept_write(buffer_text(&kept), job, frame, film, file, err));
        if (s == STATUS_OK)
            remove_path(store, &path);
    }
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

void store_output_path(const struct store *store, uint64_t job, uint32_t frame, const char *extension,
                       struct buffer *path)
{
    buffer_printf(path, "%s/outputs/%" PRIu64 "/frame-%04u.%s", store->folder, job, frame, extension);
}

status store_output_read(const struct store *store, uint64_t job, uint32_t frame, const char *extension,
                         size_t limit_bytes, struct buffer *out, struct error *err)
{
    struct buffer path = BUFFER_INIT;
    size_t start = out->size;
    struct digest is;
    status s;

    store_output_path(store, job, frame, extension, &path);
    s = buffer_ok(&path) ? file_read_kept(buffer_text(&path), limit_bytes, out, err) : error_no_memory(err, "a path");
    if (s == STATUS_OK && digest_of(&is, out->data + start, out->size - start) != STATUS_OK)
        s = error_no_memory(err, "a digest");
    THEN(s, store_output_check(store, job, frame, extension, &is, err));
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
    THEN(s, file_write_one_of_many(buffer_text(&path), data->data, data->size, err));
    THEN(s, sums_note(store, job, frame, extension, data, err));
    buffer_release(&path);
    return s;
}

status store_outputs_sync(const struct store *store, uint64_t job, struct error *err)
{
    struct buffer path = BUFFER_INIT;
    status s = STATUS_OK;

    buffer_printf(&path, "%s/outputs/%" PRIu64, store->folder, job);
    if (!may_exist(&path)) { /* no output was written */
        buffer_release(&path);
        return STATUS_OK;
    }
    s = sums_write(store, job, err);
    buffer_printf(&path, "/any");
    if (s == STATUS_OK)
        s = buffer_ok(&path) ? file_sync_folder_of(buffer_text(&path), err) : error_no_memory(err, "a path");
    buffer_release(&path);
    return s;
}
