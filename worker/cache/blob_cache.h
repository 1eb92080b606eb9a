/* blob_cache: this machine's blobs on disk, named by their SHA-256.
 *
 * FOLDER/ab/cdef...: one file per blob, named by the 64 digits of its digest, the first two as a folder. FOLDER/tmp:
 * files being received. A file appears in its place by a rename, so it is complete. It is checked against its name the
 * first time a process uses it, so neither a crash nor a bad disk can put a wrong byte into a picture. Several
 * processes may share the folder: no process changes a file in place, and an unlinked file stays mapped where it is
 * used.
 *
 * Above the limit the least recently used files are removed (by modification time, which every use updates). If the
 * disk is full or fails, a blob is kept in anonymous memory while it is referenced.
 *
 * All functions are safe from any thread. A blob belongs to the holders of references to it and must be released before
 * the cache is closed.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/digest.h"
#include "common/base/status.h"

struct blob_cache;
struct cached_blob;

/* Create the folder if needed, check that it is writable, remove what crashed receivers left.
 * ERR_IO with the folder's name and the remedy. */
status blob_cache_open(struct blob_cache **out, const char *folder, uint64_t limit_bytes, struct error *err) MUST_CHECK;
void blob_cache_close(struct blob_cache *cache);
/* Bytes of its files, about. */
uint64_t blob_cache_bytes(struct blob_cache *cache);

/* Find a blob and take a reference. Reads and hashes the whole file the first time, so do not call it in the loop's
 * thread. ERR_NOT_FOUND: it is not there (or was damaged and has been removed); ERR_NO_MEMORY, ERR_IO. */
status blob_cache_get(struct blob_cache *cache, const struct digest *digest, struct cached_blob **out,
                      struct error *err) MUST_CHECK;
struct cached_blob *cached_blob_retain(struct cached_blob *blob);
void cached_blob_release(struct cached_blob *blob);
const struct digest *cached_blob_digest(const struct cached_blob *blob);
const uint8_t *cached_blob_data(const struct cached_blob *blob); /* never NULL */
size_t cached_blob_size(const struct cached_blob *blob);
