/* memory: every heap allocation of the project goes through here.
 *
 * Sizes are checked for overflow. A countdown can be armed so that the Nth allocation fails; the
 * fault tests use it to reach every out-of-memory path. Memory is plain malloc memory: mem_free()
 * accepts NULL and anything from these functions.
 */
#pragma once

#include <stddef.h>

/* Uninitialised memory; NULL when out of memory. A size of 0 yields a unique pointer. */
void *mem_alloc(size_t size_bytes) __attribute__((malloc, warn_unused_result));

/* Zeroed memory for `count` elements of `size_bytes`; NULL on overflow or exhaustion. */
void *mem_calloc(size_t count, size_t size_bytes) __attribute__((malloc, warn_unused_result));

/* Uninitialised memory for an array; NULL on overflow or exhaustion. */
void *mem_alloc_array(size_t count, size_t size_bytes) __attribute__((malloc, warn_unused_result));

/* Resize; on failure returns NULL and leaves the old block untouched. */
void *mem_realloc_array(void *old, size_t count, size_t size_bytes) __attribute__((warn_unused_result));

/* Memory aligned to `alignment` bytes (a power of two); free with mem_free(). */
void *mem_alloc_aligned(size_t alignment, size_t size_bytes) __attribute__((malloc, warn_unused_result));

/* Ask for large pages under a block that will be read at random, before it is written: otherwise
 * every other texel of a texture would cost a page table walk. Only a hint. */
void mem_advise_large_pages(void *block, size_t size_bytes);

char *mem_strdup(const char *text) __attribute__((warn_unused_result));
void *mem_memdup(const void *data, size_t size_bytes) __attribute__((warn_unused_result));
void mem_free(void *block);

/* Keep what is freed for the next block, up to 64 MiB, but for blocks above 4 MiB: films and messages come and go, and the
 * page faults of memory that was given back cost more than the work on it. At most two pools, so that what one thread
 * frees serves others. Call it before the first thread. */
void mem_keep(void);
/* Return freed memory to the machine, as far as the C library can. */
void mem_trim(void);

/* Fault hook: let `successes` more allocations succeed, then fail `failures` ones in a row
 * (a negative `successes` disarms). For tests; not thread-safe against itself. */
void mem_fault_arm(long successes, long failures);

/* How many allocations the armed hook has failed so far. */
long mem_fault_count(void);

/* *out = a * b, false on overflow. */
static inline int mem_size_mul(size_t a, size_t b, size_t *out) { return !__builtin_mul_overflow(a, b, out); }

/* Grow a typed array to hold at least `needed` elements; 0 when out of memory.
 * Usage: if (!MEM_GROW(items, capacity, count + 1)) return error_no_memory(...). */
#define MEM_GROW(array, capacity, needed) \
    mem_grow_((void **)&(array), &(capacity), (needed), sizeof *(array))
int mem_grow_(void **array, size_t *capacity, size_t needed, size_t size_bytes);
