/* trash: large files go at once, and their room is freed by a thread.
 *
 * Freeing a large file's room can take the kernel half a minute (ext4 with discard). It happens where the file's last
 * name goes or its last descriptor is closed, whichever is later. A thread that must not wait for that
 * renames the file into FOLDER/trash and hands its descriptors over:
 *
 *   trash_take or trash_unlink: renamed -> the thread of trash_open: unlinked -> its room is free
 *   trash_close_file                    -> the same thread: closed
 *
 * A process cannot end while the kernel frees room for it, either. So the thread lets another process unlink what is
 * large, when this one has it closed, and does not wait for that when it is to end.
 *
 * FOLDER/trash is the caller's to make, on the file system of what it takes. What a kill left in it goes after the
 * next trash_open. Nothing in it is ever used again, or durable.
 */
#pragma once

#include "common/base/status.h"

struct trash;

/* Start a thread that empties FOLDER/trash, now and whenever something comes. ERR_NO_MEMORY. */
status trash_open(struct trash **out, const char *folder, struct error *err) MUST_CHECK;
/* Waits for no large file; the next trash_open goes on with what is left. NULL is fine. */
void trash_close(struct trash *trash);
/* Empty it again: what could not be removed may go now. [any thread] */
void trash_wake(void);

/* Move the file or folder into FOLDER/trash. 0: it is where it was, and errno says why (no thread empties any
 * trash: ENOTSUP). [any thread] */
int trash_take(const char *folder, const char *path);
/* As unlink(2), by trash_take where possible. [any thread] */
int trash_unlink(const char *folder, const char *path);
/* As close(2) of a file that may have lost its name; small files are closed at once. [any thread] */
void trash_close_file(int fd);
