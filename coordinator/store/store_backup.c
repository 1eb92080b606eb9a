#include "coordinator/store/store_backup.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/system/clock.h"
#include "common/base/digest.h"
#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/store/files/blobs.h"
#include "coordinator/store/store_hold.h"
#include "coordinator/store/store_parts.h"

enum { BACKUP_BUSY_MS = 10000, BACKUP_TRIES_MAX = 20 };

static const char *const trees[] = {"blobs", "films", "outputs"};
enum { TREES = sizeof trees / sizeof *trees };
static const char marker_text[] = "a backup of an azulejo store, complete\n";

/* How far a restored store's epochs are ahead: more than any number of starts of the old one. */
#define EPOCHS_BEYOND "1125899906842624" /* 2^50 */

/* ---- folders --------------------------------------------------------------------------------- */

static int is_there(const char *folder, const char *name)
{
    char *path = file_join(folder, name);
    int there = path && file_exists(path);

    mem_free(path);
    return there;
}

/* ERR_REFUSED: the folder has something in it, other than a lock. */
static status check_empty(const char *path, struct error *err)
{
    DIR *folder = opendir(path);
    const struct dirent *entry;
    status s = STATUS_OK;

    if (!folder)
        return errno == ENOENT ? STATUS_OK
                               : error_set(err, STATUS_ERR_IO, "%s: cannot be read: %s", path, strerror(errno));
    while (s == STATUS_OK && (entry = readdir(folder)))
        if (strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0 && strcmp(entry->d_name, "lock") != 0)
            s = error_set(err, STATUS_ERR_REFUSED, "%s: is not empty: name a new folder", path);
    closedir(folder);
    return s;
}

/* ERR_REFUSED: the folder lies in the other. Both exist. */
static status check_outside(const char *inner, const char *outer, struct error *err)
{
    char *in = realpath(inner, NULL), *out = realpath(outer, NULL);
    status s = STATUS_OK;

    if (!in || !out)
        s = error_set(err, STATUS_ERR_IO, "%s, %s: cannot be found: %s", inner, outer, strerror(errno));
    else if (strncmp(in, out, strlen(out)) == 0 && (in[strlen(out)] == '/' || in[strlen(out)] == 0))
        s = error_set(err, STATUS_ERR_REFUSED, "%s: lies in %s: name a folder elsewhere, best on another disk", inner,
                      outer);
    free(out);
    free(in);
    return s;
}

static status copy_trees(const char *from, const char *to, struct copied *sum, struct error *err)
{
    status s = STATUS_OK;

    for (int i = 0; i < TREES && s == STATUS_OK; i++) {
        char *source = file_join(from, trees[i]), *target = file_join(to, trees[i]);
        s = source && target ? copy_tree(source, target, sum, err) : error_no_memory(err, "a copy");
        mem_free(target);
        mem_free(source);
    }
    return s;
}

/* All of it is on the disk when this returns. */
static status sync_all(const char *path, struct error *err)
{
    int fd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    status s = STATUS_OK;

    if (fd < 0 || syncfs(fd) != 0)
        s = error_set(err, STATUS_ERR_IO, "%s: cannot be synced: %s", path, strerror(errno));
    if (fd >= 0)
        close(fd);
    return s;
}

/* ---- databases ------------------------------------------------------------------------------- */

static status sqlite_failed(sqlite3 *db, const char *path, const char *what, struct error *err)
{
    return error_set(err, STATUS_ERR_IO, "%s: %s: %s", path, what, db ? sqlite3_errmsg(db) : "no memory");
}

static status database_connect(const char *path, int flags, sqlite3 **db, struct error *err)
{
    if (sqlite3_open_v2(path, db, flags, NULL) != SQLITE_OK)
        return sqlite_failed(*db, path, "cannot be opened", err);
    sqlite3_busy_timeout(*db, BACKUP_BUSY_MS);
    return STATUS_OK;
}

static status execute(sqlite3 *db, const char *path, const char *sql, struct error *err)
{
    return sqlite3_exec(db, sql, NULL, NULL, NULL) == SQLITE_OK ? STATUS_OK
                                                                : sqlite_failed(db, path, "cannot be written", err);
}

/* A snapshot of the database as one file, without a log. */
static status snapshot(sqlite3 *live, const char *path, struct error *err)
{
    sqlite3 *copy = NULL;
    sqlite3_backup *work = NULL;
    status s;

    unlink(path);
    s = database_connect(path, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, &copy, err);
    if (s == STATUS_OK && !(work = sqlite3_backup_init(copy, "main", live, "main")))
        s = sqlite_failed(copy, path, "cannot be written", err);
    if (work && sqlite3_backup_step(work, -1) != SQLITE_DONE)
        s = sqlite_failed(live, path, "the database cannot be copied", err);
    if (work && sqlite3_backup_finish(work) != SQLITE_OK && s == STATUS_OK)
        s = sqlite_failed(copy, path, "cannot be written", err);
    THEN(s, execute(copy, path, "PRAGMA journal_mode=DELETE", err));
    sqlite3_close(copy);
    if (s == STATUS_OK && chmod(path, 0600) != 0)
        s = error_set(err, STATUS_ERR_IO, "%s: its mode cannot be set: %s", path, strerror(errno));
    return s;
}

/* The first column of the first row; 0 without rows. */
static status select_number(sqlite3 *db, const char *path, const char *sql, int64_t *out, struct error *err)
{
    sqlite3_stmt *statement = NULL;
    int code = sqlite3_prepare_v2(db, sql, -1, &statement, NULL);

    *out = 0;
    if (code == SQLITE_OK)
        code = sqlite3_step(statement);
    if (code == SQLITE_ROW)
        *out = sqlite3_column_int64(statement, 0);
    sqlite3_finalize(statement);
    return code == SQLITE_ROW || code == SQLITE_DONE ? STATUS_OK : sqlite_failed(db, path, "cannot be read", err);
}

/* Has the live database moved on such that files copied after the snapshot may be newer than its rows? New jobs and frames do
 * no harm; pictures that were developed again do, and frames that were done and are no longer. */
static status has_moved_on(sqlite3 *live, const char *path, int *moved, struct error *err)
{
    static const char question[] =
        "SELECT (SELECT count(*) FROM copy.jobs AS c JOIN main.jobs AS l ON l.id=c.id"
        " WHERE l.revision<>c.revision OR l.request<>c.request) +"
        " (SELECT count(*) FROM copy.frames AS c JOIN main.jobs AS j ON j.id=c.job"
        " LEFT JOIN main.frames AS l ON l.job=c.job AND l.frame=c.frame WHERE l.job IS NULL)";
    sqlite3_stmt *attach = NULL;
    int64_t count = 0;
    struct error ignored;
    status s = STATUS_OK;

    if (sqlite3_prepare_v2(live, "ATTACH ? AS copy", -1, &attach, NULL) != SQLITE_OK ||
        sqlite3_bind_text(attach, 1, path, -1, SQLITE_STATIC) != SQLITE_OK || sqlite3_step(attach) != SQLITE_DONE)
        s = sqlite_failed(live, path, "cannot be compared", err);
    sqlite3_finalize(attach);
    if (s != STATUS_OK)
        return s;
    s = select_number(live, path, question, &count, err);
    *moved = count > 0;
    if (execute(live, path, "DETACH copy", &ignored) != STATUS_OK && s == STATUS_OK)
        s = sqlite_failed(live, path, "cannot be compared", err);
    return s;
}

static status check_database(const char *path, struct error *err)
{
    sqlite3 *db = NULL;
    sqlite3_stmt *statement = NULL;
    status s = database_connect(path, SQLITE_OPEN_READWRITE, &db, err);
    int good = 0;

    if (s == STATUS_OK && sqlite3_prepare_v2(db, "PRAGMA integrity_check(1)", -1, &statement, NULL) == SQLITE_OK &&
        sqlite3_step(statement) == SQLITE_ROW)
        good = strcmp((const char *)sqlite3_column_text(statement, 0), "ok") == 0;
    sqlite3_finalize(statement);
    if (s == STATUS_OK && !good)
        s = error_set(err, STATUS_ERR_CORRUPT, "%s: the backup's database is damaged: use another backup", path);
    sqlite3_close(db);
    return s;
}

/* Workers may still have results of leases that the old store granted after the backup. */
static status raise_epoch(const char *path, struct error *err)
{
    sqlite3 *db = NULL;
    sqlite3_stmt *statement = NULL;
    status s = database_connect(path, SQLITE_OPEN_READWRITE, &db, err);

    if (s == STATUS_OK &&
        (rows_guard(db) != SQLITE_OK ||
         sqlite3_prepare_v2(db, "UPDATE meta SET value = max(value, ?) + " EPOCHS_BEYOND " WHERE name='epoch_limit'",
                            -1, &statement, NULL) != SQLITE_OK ||
         sqlite3_bind_int64(statement, 1, clock_wall_s() << 24) != SQLITE_OK || sqlite3_step(statement) != SQLITE_DONE))
        s = sqlite_failed(db, path, "cannot be written", err);
    sqlite3_finalize(statement);
    sqlite3_close(db);
    return s;
}

/* ---- backup ---------------------------------------------------------------------------------- */

/* The files, the database, and again what has changed meanwhile. */
static status copy_store(const char *store, const char *dir, const char *database, sqlite3 *live, struct copied *sum,
                         struct error *err)
{
    status s = copy_trees(store, dir, sum, err);
    int moved = 1;

    for (int i = 0; i < BACKUP_TRIES_MAX && moved && s == STATUS_OK; i++) {
        s = snapshot(live, database, err);
        THEN(s, copy_trees(store, dir, sum, err));
        THEN(s, has_moved_on(live, database, &moved, err));
    }
    if (s == STATUS_OK && moved)
        log_warn("jobs were developed or extended all the time: some pictures in the backup may be "
                 "newer than it says");
    return s;
}

static status backup_held(const char *store, const char *dir, struct copied *sum, struct error *err)
{
    char *source = file_join(store, "queue.sqlite"), *target = file_join(dir, "queue.sqlite");
    char *marker = file_join(dir, "backup");
    sqlite3 *live = NULL;
    status s = source && target && marker ? STATUS_OK : error_no_memory(err, "a path");

    THEN(s, database_connect(source, SQLITE_OPEN_READWRITE, &live, err));
    THEN(s, copy_store(store, dir, target, live, sum, err));
    sqlite3_close(live);
    blobs_clean(dir); /* uploads that were under way */
    THEN(s, sync_all(dir, err));
    THEN(s, file_write_private(marker, marker_text, sizeof marker_text - 1, err));
    mem_free(marker);
    mem_free(target);
    mem_free(source);
    return s;
}

status store_backup(const char *store, const char *dir, struct copied *sum, struct error *err)
{
    int hold = -1;
    status s = STATUS_OK;

    *sum = (struct copied){0};
    if (!is_there(store, "queue.sqlite"))
        return error_set(err, STATUS_ERR_CORRUPT, "%s: is no store: name the coordinator's --store", store);
    s = check_empty(dir, err);
    THEN(s, file_make_private_folder(dir, err));
    THEN(s, check_outside(dir, store, err));
    THEN(s, store_hold_begin(store, &hold, err));
    THEN(s, backup_held(store, dir, sum, err));
    store_hold_end(hold);
    return s;
}

/* ---- restore --------------------------------------------------------------------------------- */

int store_restoring(const char *store) { return is_there(store, "restoring"); }

/* Blobs whose bytes rotted would fail a job later; without them clients send them again. */
static void check_blobs(const char *store)
{
    char *path = file_join(store, "blobs");
    DIR *blobs = path ? opendir(path) : NULL;
    const struct dirent *entry;

    while (blobs && (entry = readdir(blobs))) {
        char *below = strlen(entry->d_name) == 2 && entry->d_name[0] != '.' ? file_join(path, entry->d_name) : NULL;
        DIR *folder = below ? opendir(below) : NULL;
        const struct dirent *file;

        while (folder && (file = readdir(folder))) {
            struct digest digest;
            if (digest_from_hex(&digest, file->d_name) == STATUS_OK && blobs_check(store, &digest) != 1) {
                log_warn("%s/%s: is damaged in the backup and left out; clients send it again", below, file->d_name);
                unlinkat(dirfd(folder), file->d_name, 0);
            }
        }
        if (folder)
            closedir(folder);
        mem_free(below);
    }
    if (blobs)
        closedir(blobs);
    mem_free(path);
}

/* Mark the store as half restored. At once: a temporary file's name, left by a crash, would look like
 * something that is in the store. */
static status mark_restoring(const char *path, struct error *err)
{
    int fd = open(path, O_WRONLY | O_CREAT | O_CLOEXEC, 0600);

    if (fd < 0)
        return error_set(err, STATUS_ERR_IO, "%s: cannot be written: %s", path, strerror(errno));
    close(fd);
    return file_sync_folder_of(path, err);
}

/* The database comes last, under its own name: then the store is whole. */
static status restore_files(const char *dir, const char *store, struct copied *sum, struct error *err)
{
    char *source = file_join(dir, "queue.sqlite"), *fresh = file_join(store, "queue.sqlite.new");
    char *target = file_join(store, "queue.sqlite"), *restoring = file_join(store, "restoring");
    status s = source && fresh && target && restoring ? STATUS_OK : error_no_memory(err, "a path");

    THEN(s, mark_restoring(restoring, err));
    THEN(s, copy_file(source, fresh, sum, err));
    THEN(s, check_database(fresh, err));
    THEN(s, raise_epoch(fresh, err));
    THEN(s, copy_trees(dir, store, sum, err));
    if (s == STATUS_OK)
        check_blobs(store);
    THEN(s, sync_all(store, err));
    if (s == STATUS_OK && (rename(fresh, target) != 0 || unlink(restoring) != 0))
        s = error_set(err, STATUS_ERR_IO, "%s: cannot be put in place: %s", target, strerror(errno));
    THEN(s, file_sync_folder_of(target, err));
    mem_free(restoring);
    mem_free(target);
    mem_free(fresh);
    mem_free(source);
    return s;
}

status store_restore(const char *dir, const char *store, struct copied *sum, struct error *err)
{
    struct store_lock lock = STORE_UNLOCKED;
    status s = STATUS_OK;

    *sum = (struct copied){0};
    if (!is_there(dir, "backup") || !is_there(dir, "queue.sqlite"))
        return error_set(err, STATUS_ERR_CORRUPT,
                         "%s: is no complete backup: a backup that was interrupted cannot be restored", dir);
    if (is_there(store, "queue.sqlite"))
        return error_set(err, STATUS_ERR_REFUSED,
                         "%s: has jobs already: name an empty folder with --store, or move this one away", store);
    if (!store_restoring(store)) /* films that lie there could be taken for a job's */
        s = check_empty(store, err);
    THEN(s, file_make_private_folder(store, err));
    THEN(s, store_lock(&lock, store, err));
    THEN(s, restore_files(dir, store, sum, err));
    store_unlock(&lock);
    return s;
}
