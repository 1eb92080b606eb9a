/* blob_cache_parts: the inside of the cache, shared by its files; private to its files.
 *
 * blob_cache.c        blobs in use: found, mapped, checked against their names, counted
 * blob_cache_sweep.c  the size limit, and what crashed receivers left
 * cache_writer.c      blobs on their way in
 */
#pragma once

#include <pthread.h>
#include <sys/stat.h>

#include "worker/cache/blob_cache.h"

enum {
    CACHE_BUCKETS = 4096,
    CACHE_PATH_ROOM = 96, /* room for what follows the folder's name in a path */
};

struct verified;

struct blob_cache {
    pthread_mutex_t lock;
    char *folder;
    uint64_t limit_bytes;
    uint64_t stored_bytes; /* files, as of the last sweep plus what was stored since */
    uint64_t temporary_count;
    struct cached_blob *live[CACHE_BUCKETS];
    struct verified *verified[CACHE_BUCKETS];
};

/* FOLDER/ab/cdef... ; NULL: out of memory. */
char *cache_blob_path(const struct blob_cache *cache, const struct digest *digest, int folder_only);

/* A blob with one reference that cannot be found yet; owns the mapping `data`. NULL: out of memory. */
struct cached_blob *cached_blob_new(struct blob_cache *cache, const struct digest *digest, const uint8_t *data,
                                    size_t size_bytes);
/* Make it findable. If another thread was faster, take its blob and free ours. */
struct cached_blob *cache_add(struct blob_cache *cache, struct cached_blob *blob);

/* Remember that this process need not hash the file again. If that fails, it is hashed again. */
void cache_remember_verified(struct blob_cache *cache, const struct digest *digest, const struct stat *info);
/* Map the open file and check it against its name. */
status cache_map_file(struct blob_cache *cache, int fd, const char *path, const struct digest *digest,
                      struct cached_blob **out, struct error *err) MUST_CHECK;

/* Count the files. Above the limit, remove the least recently used ones until a tenth of it is
 * free, so that not every new blob causes a sweep. Other processes may do the same at the same
 * time; a file that is already gone is no error. */
void cache_sweep(struct blob_cache *cache);
void cache_sweep_temporaries(const char *folder);
