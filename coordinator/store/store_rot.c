#include "coordinator/store/store_rot.h"

#include <dirent.h>
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/base/digest.h"
#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/system/trash.h"
#include "coordinator/store/files/blobs.h"
#include "coordinator/store/store_parts.h"

struct checking {
    struct store store; /* of its members: folder, lock, db */
    void (*say)(const char *line);
    struct rot *rot;
    int repair;
    int is_salvaged; /* of the rows only those that could be read are there */
};

enum { NUMBERS_BEYOND = 1000 }; /* jobs that may have been removed since the highest one that is known */

/* Text that may come from damaged bytes. */
static void clean(char *text)
{
    for (; *text; text++)
        if (*text < ' ' || *text > '~')
            *text = '?';
}

static void fault(struct checking *c, const char *format, ...) __attribute__((format(printf, 2, 3)));
static void fault(struct checking *c, const char *format, ...)
{
    char line[512];
    va_list list;

    va_start(list, format);
    vsnprintf(line, sizeof line, format, list);
    va_end(list);
    c->rot->faults++;
    c->say(line);
}

/* Call visit for each entry of a folder; it may be missing. */
static void walk(struct checking *c, const char *path, void (*visit)(struct checking *c, const char *path, const char *name))
{
    DIR *folder = opendir(path);
    const struct dirent *entry;

    while (folder && (entry = readdir(folder))) {
        char *file = entry->d_name[0] != '.' ? file_join(path, entry->d_name) : NULL;
        if (file)
            visit(c, file, entry->d_name);
        mem_free(file);
    }
    if (folder)
        closedir(folder);
}

static void walk_in_store(struct checking *c, const char *name,
                          void (*visit)(struct checking *c, const char *path, const char *name))
{
    char *path = file_join(c->store.folder, name);

    if (path)
        walk(c, path, visit);
    mem_free(path);
}

/* ---- blobs, outputs, films ------------------------------------------------------------------- */

static void check_blob(struct checking *c, const char *path, const char *name)
{
    struct digest digest;

    if (digest_from_hex(&digest, name) != STATUS_OK)
        return;
    c->rot->files++;
    if (blobs_check(c->store.folder, &digest) != 0)
        return;
    if (c->repair)
        (void)trash_unlink(c->store.folder, path);
    fault(c, "%s: is damaged%s: submit its scene again, and it is sent again", path, c->repair ? " and is removed" : "");
}

static void check_blobs(struct checking *c, const char *path, const char *name)
{
    if (strlen(name) == 2)
        walk(c, path, check_blob);
}

/* "frame-NNNN.", and what comes after it. */
static const char *frame_of(const char *name, uint32_t *frame)
{
    char *end;

    if (strncmp(name, "frame-", 6) != 0)
        return NULL;
    *frame = (uint32_t)strtoul(name + 6, &end, 10);
    return *end == '.' ? end + 1 : NULL;
}

static uint64_t job_of(const char *path)
{
    char *folder = file_dirname(path);
    uint64_t job = folder ? strtoull(file_basename(folder), NULL, 10) : 0;

    mem_free(folder);
    return job;
}

static void output_fault(struct checking *c, uint64_t job, uint32_t frame, const char *path)
{
    if (store_film_exists(&c->store, job, frame))
        fault(c, "%s: is damaged: fetching it makes it again from its film, with the same bits", path);
    else
        fault(c, "%s: is damaged: 'azulejo retry %" PRIu64 " --frames %u' renders it again, with the same bits", path,
              job, frame);
}

static void check_output(struct checking *c, const char *path, const char *name)
{
    uint32_t frame;
    const char *extension = frame_of(name, &frame);
    struct buffer lines = BUFFER_INIT;
    char other[64];
    struct digest digest, is;
    uint64_t size, job = job_of(path);
    size_t at = 0;

    if (!extension || strcmp(extension, SUMS_EXTENSION) != 0)
        return;
    c->rot->files++;
    if (sums_read(path, &lines) == SUMS_DAMAGED) {
        output_fault(c, job, frame, path);
        buffer_clear(&lines);
    }
    while (sums_next(&lines, &at, &digest, other, sizeof other)) {
        struct buffer file = BUFFER_INIT;
        store_output_path(&c->store, job, frame, other, &file);
        if (buffer_ok(&file) && digest_of_file(&is, &size, buffer_text(&file), NULL) == STATUS_OK) {
            c->rot->files++;
            if (!digest_equal(&is, &digest))
                output_fault(c, job, frame, buffer_text(&file));
        }
        buffer_release(&file);
    }
    buffer_release(&lines);
}

static void check_film(struct checking *c, const char *path, const char *name)
{
    uint32_t frame, lost = 0;
    const char *extension = frame_of(name, &frame);
    int kept = extension && strcmp(extension, "kept") == 0;
    struct error err = {0};
    status s;

    if (!kept && !(extension && strcmp(extension, "film") == 0))
        return;
    c->rot->files++;
    s = film_file_check(path, kept, job_of(path), frame, &lost, &err);
    if (s == STATUS_ERR_NOT_FOUND)
        fault(c, "%s: is damaged: what of the frame is wanted again is rendered from its beginning", path);
    else if (s != STATUS_OK)
        fault(c, "%s", err.text);
    else if (lost > 0)
        fault(c, "%s: %u tiles are damaged: they are rendered again, with the same bits, when the frame goes on", path, lost);
}

static void check_job_outputs(struct checking *c, const char *path, const char *name)
{
    (void)name;
    walk(c, path, check_output);
}

static void check_job_films(struct checking *c, const char *path, const char *name)
{
    (void)name;
    walk(c, path, check_film);
}

/* ---- rows ------------------------------------------------------------------------------------ */

/* The job stays under its number, parked. */
static status park_number(struct checking *c, uint64_t id, struct error *err)
{
    return sql_change(&c->store,
                      "INSERT OR IGNORE INTO jobs (id, name, state, state_text, scene_name, kernel, epoch_floor, submitted_at,"
                      " finished_at, active_ns, conflicts, samples, rays, vertices, dropped, cpu_ns, trace_ns, request)"
                      " VALUES (?, 'lost', ?, '', '', '', 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, zeroblob(1))",
                      SQL_VALUES(sql_number((int64_t)id), sql_number(JOB_STATE_PARKED)), "cannot be written", err);
}

static status repair_row(struct checking *c, const struct guarded_table *t, const char *key, int lost, struct error *err)
{
    struct buffer sql = BUFFER_INIT;
    status s;

    if (lost) {
        s = sql_change(&c->store, "DELETE FROM sums WHERE tab=? AND key=?",
                       SQL_VALUES(sql_text(t->name), sql_text(key)), "cannot be written", err);
        if (s == STATUS_OK && t->stays)
            s = park_number(c, strtoull(key, NULL, 10), err);
        return s;
    }
    if (t->stays)
        return STATUS_OK;
    rows_delete_text(c->store.db, t->name, &sql);
    s = buffer_ok(&sql) ? sql_change(&c->store, buffer_text(&sql), SQL_VALUES(sql_text(key)), "cannot be written", err)
                        : error_no_memory(err, "a statement");
    buffer_release(&sql);
    return s;
}

struct bad_row {
    char key[160];
    int lost;
};

static status check_table(struct checking *c, const struct guarded_table *t, struct error *err)
{
    struct bad_row *bad = NULL;
    size_t count = 0, capacity = 0;
    struct sql_rows rows = sql_select(&c->store, "SELECT key, lost FROM temp.bad WHERE tab=? ORDER BY key",
                                      SQL_VALUES(sql_text(t->name)), "cannot be read", err);
    status s;

    while (sql_next(&rows)) {
        if (!MEM_GROW(bad, capacity, count + 1)) {
            rows.result = error_no_memory(err, "damaged rows");
            continue;
        }
        column_text(rows.row, 0, bad[count].key, sizeof bad[count].key);
        clean(bad[count].key);
        bad[count++].lost = sqlite3_column_int(rows.row, 1);
    }
    s = sql_end(&rows);
    for (size_t i = 0; i < count && s == STATUS_OK; i++) {
        fault(c, "%s/queue.sqlite: %s %s: its row is %s: %s", c->store.folder, t->key, bad[i].key,
              bad[i].lost ? "lost" : "damaged",
              c->repair || t->stays ? t->remedy : "--repair removes it, and says what to do");
        if (c->repair)
            s = repair_row(c, t, bad[i].key, bad[i].lost, err);
    }
    mem_free(bad);
    return s;
}

/* The highest number of a job of which there are files; with `park`, those without a row are noted and parked. */
struct folders {
    uint64_t highest;
    int park;
    status result;
    struct error error;
};
static struct folders *walked; /* by the one walk that runs */

static void check_number(struct checking *c, const char *path, const char *name)
{
    char *end;
    uint64_t id = strtoull(name, &end, 10);
    struct sql_rows rows;
    int known;

    if (id == 0 || *end || walked->result != STATUS_OK)
        return;
    if (id > walked->highest)
        walked->highest = id;
    rows = sql_select(&c->store, "SELECT 1 FROM jobs WHERE id=?1 UNION ALL SELECT 1 FROM removed WHERE job=?1",
                      SQL_VALUES(sql_number((int64_t)id)), "cannot be read", &walked->error);
    known = sql_next(&rows);
    walked->result = sql_end(&rows);
    if (known || walked->result != STATUS_OK)
        return;
    fault(c, "%s: no row of queue.sqlite is job %" PRIu64 "'s: %s", path, id,
          c->repair ? "it is parked under that number: submit it again, then cancel and remove this one"
                    : "--repair parks it under that number, which is never given again");
    if (c->repair)
        walked->result = park_number(c, id, &walked->error);
}

/* Numbers of jobs never begin again. */
static status check_sequence(struct checking *c, uint64_t highest, struct error *err)
{
    struct sql_rows rows = sql_select(&c->store,
                                      "SELECT coalesce((SELECT seq FROM sqlite_sequence WHERE name='jobs'), 0),"
                                      " max((SELECT coalesce(max(id), 0) FROM jobs), (SELECT coalesce(max(value), 0) FROM meta WHERE"
                                      " name='last_job' AND name NOT IN (SELECT key FROM temp.bad WHERE tab='meta')))",
                                      NULL, 0, "cannot be read", err);
    uint64_t next = 0, most = highest;

    if (sql_next(&rows)) {
        next = column_number(rows.row, 0);
        most = column_number(rows.row, 1) > most ? column_number(rows.row, 1) : most;
    }
    TRY(sql_end(&rows));
    if (!c->is_salvaged && next >= most && next - most < UINT64_C(1) << 40)
        return STATUS_OK;
    fault(c, "%s/queue.sqlite: the next job's number is %s: %s %d after the highest that is there, so that no removed job's "
          "number is given again", c->store.folder, c->is_salvaged ? "not known" : "damaged",
          c->repair ? "it goes on" : "--repair goes on", NUMBERS_BEYOND);
    if (!c->repair)
        return STATUS_OK;
    most += NUMBERS_BEYOND;
    TRY(sql_change(&c->store, "DELETE FROM sqlite_sequence WHERE name='jobs'", NULL, 0, "cannot be written", err));
    return sql_change(&c->store, "INSERT INTO sqlite_sequence (name, seq) VALUES ('jobs', ?)",
                      SQL_VALUES(sql_number((int64_t)most)), "cannot be written", err);
}

static status check_rows(struct checking *c, struct error *err)
{
    struct folders folders = {0};
    status s = STATUS_OK;

    if (rows_find(c->store.db) != SQLITE_OK)
        return sql_error(&c->store, "cannot be read", err);
    for (const struct guarded_table *t = guarded_tables; t->name && s == STATUS_OK; t++)
        s = check_table(c, t, err);
    walked = &folders;
    if (s == STATUS_OK) {
        walk_in_store(c, "outputs", check_number);
        walk_in_store(c, "films", check_number);
        s = folders.result == STATUS_OK ? STATUS_OK : error_set(err, folders.result, "%s", folders.error.text);
    }
    walked = NULL;
    THEN(s, check_sequence(c, folders.highest, err));
    return s;
}

/* ---- the database ---------------------------------------------------------------------------- */

/* What can be read of the damaged file goes into a new one, which takes its place. */
static status salvage(struct checking *c, const char *path, struct error *err)
{
    struct buffer fresh = BUFFER_INIT, aside = BUFFER_INIT, log = BUFFER_INIT, log_aside = BUFFER_INIT;
    uint64_t copied = 0;
    status s = STATUS_OK;

    c->is_salvaged = 1;
    database_close(&c->store);
    buffer_printf(&fresh, "%s.new", path);
    buffer_printf(&aside, "%s.damaged", path);
    buffer_printf(&log, "%s-wal", path);
    buffer_printf(&log_aside, "%s.damaged-wal", path);
    if (!buffer_ok(&fresh) || !buffer_ok(&aside) || !buffer_ok(&log) || !buffer_ok(&log_aside))
        s = error_no_memory(err, "a path");
    if (s == STATUS_OK) {
        (void)unlink(buffer_text(&fresh));
        s = database_make(&c->store, buffer_text(&fresh), err);
    }
    if (s == STATUS_OK && rows_salvage(c->store.db, path, &copied) != SQLITE_OK)
        s = sql_error(&c->store, "cannot be written", err);
    database_close(&c->store); /* its log becomes part of it */
    if (s == STATUS_OK && ((rename(path, buffer_text(&aside)) != 0 && errno != ENOENT) ||
                           (rename(buffer_text(&log), buffer_text(&log_aside)) != 0 && errno != ENOENT) ||
                           rename(buffer_text(&fresh), path) != 0))
        s = error_set(err, STATUS_ERR_IO, "%s: cannot be renamed: %s", path, strerror(errno));
    THEN(s, file_sync_folder_of(path, err));
    if (s == STATUS_OK) {
        char line[512];
        snprintf(line, sizeof line, "%s: %" PRIu64 " rows of it could be read, and are in a new file; the old one is %s", path,
                 copied, buffer_text(&aside));
        c->say(line);
        s = database_make(&c->store, path, err);
    }
    buffer_release(&log_aside);
    buffer_release(&log);
    buffer_release(&aside);
    buffer_release(&fresh);
    return s;
}

/* Report that the database is damaged; `text`, the reason, is made printable. With --repair what can be read is saved and
 * open afterwards; without it the database is closed. ERR_IO, ERR_NO_MEMORY. */
static status mend_database(struct checking *c, const char *path, char *text, struct error *err)
{
    clean(text);
    fault(c, "%s: %s: %s", path, text,
          c->repair ? "what can be read of it is saved; a back-up has more ('azulejo-coordinator restore')"
                    : "--repair saves what can be read of it; a back-up has more ('azulejo-coordinator restore')");
    if (c->repair)
        return salvage(c, path, err);
    database_close(&c->store);
    return STATUS_OK;
}

static status check_database(struct checking *c, struct error *err)
{
    char *path = file_join(c->store.folder, "queue.sqlite");
    struct stat info;
    struct error why = {0};
    char text[160];
    status s;

    NEED(path, err, "a path");
    c->rot->files++;
    if (stat(path, &info) != 0 || info.st_size == 0) {
        snprintf(text, sizeof text, "is %s", info.st_size == 0 ? "empty" : "missing");
        s = STATUS_ERR_CORRUPT;
    } else {
        s = database_make(&c->store, path, &why);
        snprintf(text, sizeof text, "is damaged (%.100s)", why.text);
        if (s == STATUS_OK && !rows_sound(c->store.db, text, sizeof text - 16)) {
            memmove(text + 12, text, strlen(text) + 1);
            memcpy(text, "is damaged: ", 12);
            s = STATUS_ERR_CORRUPT;
        } else if (s == STATUS_OK && database_other_columns(c->store.db)) {
            snprintf(text, sizeof text, "is damaged: the table %s has other columns", database_other_columns(c->store.db));
            s = STATUS_ERR_CORRUPT;
        } else if (s != STATUS_OK && strstr(why.text, "newer azulejo")) {
            mem_free(path);
            return error_set(err, s, "%s", why.text);
        }
    }
    if (s != STATUS_OK)
        s = mend_database(c, path, text, err);
    if (s == STATUS_OK && c->store.db) {
        s = check_rows(c, err);
        if (s != STATUS_OK && sqlite3_errcode(c->store.db) == SQLITE_CORRUPT) { /* a page that quick_check does not read */
            snprintf(text, sizeof text, "is damaged (%.100s)", err->text);
            s = mend_database(c, path, text, err);
            if (s == STATUS_OK && c->store.db)
                s = check_rows(c, err);
        }
    }
    database_close(&c->store);
    mem_free(path);
    return s;
}

status store_rot_check(const char *folder, int repair, void (*say)(const char *line), struct rot *out, struct error *err)
{
    struct checking c = {.store = {.folder_lock = STORE_UNLOCKED}, .say = say, .rot = out, .repair = repair};
    status s;

    *out = (struct rot){0};
    saves_init(&c.store);
    c.store.folder = mem_strdup(folder);
    c.store.damage = damage_new();
    s = c.store.folder && c.store.damage ? STATUS_OK : error_no_memory(err, "the store");
    if (s == STATUS_OK && !file_exists(folder))
        s = error_set(err, STATUS_ERR_INPUT, "%s: there is no such store", folder);
    THEN(s, store_lock(&c.store.folder_lock, folder, err));
    THEN(s, check_database(&c, err));
    if (s == STATUS_OK) {
        walk_in_store(&c, "blobs", check_blobs);
        walk_in_store(&c, "outputs", check_job_outputs);
        walk_in_store(&c, "films", check_job_films);
    }
    saves_stop(&c.store);
    damage_free(c.store.damage);
    store_unlock(&c.store.folder_lock);
    mem_free(c.store.folder);
    return s;
}
