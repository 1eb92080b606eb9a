/* file: read and write whole files.
 *
 * Reading has a size limit. Writing goes to a temporary file in the same folder, which is synced
 * and renamed, so a reader sees either the old file or the new one, never a part.
 */
#pragma once

#include <sys/stat.h>
#include <sys/types.h>

#include "common/base/buffer.h"
#include "common/base/status.h"

/* Append the file's bytes to `out`. ERR_INPUT if the path cannot be read (missing, a folder, no permission), ERR_IO if
 * the machine failed to read it (disk, descriptors), ERR_NO_MEMORY, ERR_LIMIT if it is larger than `limit_bytes`. */
status file_read(const char *path, size_t limit_bytes, struct buffer *out, struct error *err) MUST_CHECK;

/* The same, but messages call the file `name`. */
status file_read_as(const char *path, const char *name, size_t limit_bytes, struct buffer *out,
                    struct error *err) MUST_CHECK;

/* The same for a file that this program keeps below its own folder, two levels up (outputs/JOB/FILE): ERR_NOT_FOUND
 * only if that folder exists and the file does not; every other failure to read is ERR_IO. */
status file_read_kept(const char *path, size_t limit_bytes, struct buffer *out, struct error *err) MUST_CHECK;

/* Write atomically (temporary file, fsync, rename, fsync of the folder), mode 0666 less umask. A
 * failure leaves no temporary file. ERR_IO. */
status file_write_atomic(const char *path, const void *data, size_t size_bytes, struct error *err) MUST_CHECK;

/* The same, mode 0600. */
status file_write_private(const char *path, const void *data, size_t size_bytes, struct error *err) MUST_CHECK;

/* The same without the folder's sync: after a crash the file may be the old one, or missing, until
 * file_sync_folder_of was called once for all files of the folder. */
status file_write_one_of_many(const char *path, const void *data, size_t size_bytes, struct error *err) MUST_CHECK;

/* Make the folder and its parents (mode 0777 less umask), and sync each parent that got a new
 * entry. An existing folder is no error. ERR_IO. */
status file_make_folder(const char *path, struct error *err) MUST_CHECK;
/* The same, mode 0700. */
status file_make_private_folder(const char *path, struct error *err) MUST_CHECK;
/* The same without a sync, for what need not outlive the program: it does not wait for a disk. */
status file_make_scratch_folder(const char *path, struct error *err) MUST_CHECK;

/* Sync the folder that holds `path`, so that its entries are durable. No error where the file
 * system cannot sync folders. ERR_IO. */
status file_sync_folder_of(const char *path, struct error *err) MUST_CHECK;

/* As fsync(2) and fdatasync(2), unless file_forgo_syncs() was called. */
int file_sync(int fd);
int file_sync_data(int fd);
/* Nothing that this process writes need outlast the machine's next failure: from here on no function syncs. For programs
 * whose files are removed when they end. Once, before threads. */
void file_forgo_syncs(void);
int file_syncs(void); /* 0: they are forgone */

/* Remove the folder and its contents, as far as possible. Follows no links, and stays on one file
 * system. If large files are in it, a process does this, and is not waited for longer than REMOVE_WAIT_MS. */
void file_remove_tree(const char *path);

/* Does it take so much room that freeing it may take the kernel long (ext4 with discard: half a minute)? */
int file_is_large(const struct stat *info);
/* Start a process that removes the file, or the folder with what is in it, and outlives this one. `name` is relative
 * to the folder `at` (AT_FDCWD: where this process is). The process to wait for; 0: none could be started. */
pid_t file_remove_apart(int at, const char *name);

int file_exists(const char *path);

/* Occupy standard input, output and error if the caller left them closed: using them still fails, but
 * no file or socket gets their numbers, into which messages would then be written. First in main(). */
void file_hold_standard(void);

/* Join folder and name with one '/'; the caller frees with mem_free. NULL: out of memory. */
char *file_join(const char *folder, const char *name);

/* The folder part of a path ("." when there is none); the caller frees with mem_free. */
char *file_dirname(const char *path);

/* The part after the last '/'; points into `path`. */
const char *file_basename(const char *path);

/* The extension after the last '.' of the basename, without the dot; "" if none. */
const char *file_extension(const char *path);
