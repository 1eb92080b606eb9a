/* cache_writer: a blob on its way into the cache.
 *
 * The bytes go to a file in FOLDER/tmp and are hashed as they arrive; at the end the file is
 * renamed to its place (blob_cache.h). If the disk accepts no more, the writer continues in
 * anonymous memory, which the finished blob then owns. A writer is used by one thread.
 */
#pragma once

#include <stdint.h>

#include "common/base/digest.h"
#include "common/base/status.h"
#include "worker/cache/blob_cache.h"

struct cache_writer;

/* Receive a blob of `total_bytes`, in order. */
status cache_writer_new(struct cache_writer **out, struct blob_cache *cache, const struct digest *digest,
                        uint64_t total_bytes, struct error *err) MUST_CHECK;
status cache_writer_add(struct cache_writer *w, const void *data, size_t size_bytes, struct error *err) MUST_CHECK;
uint64_t cache_writer_bytes(const struct cache_writer *w); /* so far */
/* Check the digest, put the blob into the cache and take a reference to it. Always frees the
 * writer. ERR_CORRUPT: the bytes do not match the blob's name. */
status cache_writer_finish(struct cache_writer *w, struct cached_blob **out, struct error *err) MUST_CHECK;
void cache_writer_abandon(struct cache_writer *w); /* NULL is fine */

/* For tests: every write to disk from now on fails as if the disk were full. */
void blob_cache_fault_disk_full(int on);
