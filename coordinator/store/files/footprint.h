/* footprint: what takes the room in a store, by walking its folders. [any thread] */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"

/* Bytes on disk, holes left out. */
struct job_footprint {
    uint64_t job, films, pictures;
};
/* Zero-initialise. */
struct footprint {
    struct job_footprint *jobs; /* ascending; also of folders whose job is not known */
    size_t count, capacity;
    uint64_t films, pictures, blobs, database, reserve, other;
    uint64_t trash;                  /* is being freed; not in the total */
    uint64_t disk_bytes, free_bytes; /* of the file system */
};

/* Fill a zeroed footprint. Files that vanish meanwhile do not count. ERR_NO_MEMORY, ERR_IO. */
status footprint_measure(struct footprint *out, const char *folder, struct error *err) MUST_CHECK;
/* The file system's size and what is free of it. ERR_IO. */
status footprint_disk(const char *folder, uint64_t *disk_bytes, uint64_t *free_bytes, struct error *err) MUST_CHECK;
/* What is being freed at the moment. */
uint64_t footprint_trash(const char *folder);
void footprint_release(struct footprint *footprint);
uint64_t footprint_total(const struct footprint *footprint);
/* NULL: it takes no room. */
const struct job_footprint *footprint_find(const struct footprint *footprint, uint64_t job);
