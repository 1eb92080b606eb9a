#include "common/base/memory.h"

#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif

static atomic_int fault_armed;
static atomic_long fault_successes;
static atomic_long fault_failures;
static atomic_long fault_count;

void mem_fault_arm(long successes, long failures)
{
    atomic_store(&fault_successes, successes);
    atomic_store(&fault_failures, failures);
    atomic_store(&fault_count, 0);
    atomic_store(&fault_armed, successes >= 0);
}

long mem_fault_count(void) { return atomic_load(&fault_count); }

static int fault_hits(void)
{
    if (!atomic_load_explicit(&fault_armed, memory_order_relaxed))
        return 0;
    if (atomic_fetch_sub(&fault_successes, 1) > 0)
        return 0;
    if (atomic_fetch_sub(&fault_failures, 1) <= 0)
        return 0;
    atomic_fetch_add(&fault_count, 1);
    return 1;
}

void *mem_alloc(size_t size_bytes)
{
    if (fault_hits())
        return NULL;
    return malloc(size_bytes ? size_bytes : 1);
}

void *mem_calloc(size_t count, size_t size_bytes)
{
    if (fault_hits())
        return NULL;
    if (count == 0 || size_bytes == 0)
        count = size_bytes = 1;
    return calloc(count, size_bytes);
}

void *mem_alloc_array(size_t count, size_t size_bytes)
{
    size_t total;

    if (!mem_size_mul(count, size_bytes, &total))
        return NULL;
    return mem_alloc(total);
}

void *mem_realloc_array(void *old, size_t count, size_t size_bytes)
{
    size_t total;

    if (!mem_size_mul(count, size_bytes, &total) || fault_hits())
        return NULL;
    return realloc(old, total ? total : 1);
}

void *mem_alloc_aligned(size_t alignment, size_t size_bytes)
{
    void *block = NULL;

    if (fault_hits())
        return NULL;
    if (posix_memalign(&block, alignment, size_bytes ? size_bytes : 1) != 0)
        return NULL;
    return block;
}

void mem_advise_large_pages(void *block, size_t size_bytes)
{
#ifdef MADV_HUGEPAGE
    const uintptr_t page = (uintptr_t)2 << 20; /* of x86-64; only advice */
    uintptr_t start = ((uintptr_t)block + page - 1) & ~(page - 1);
    uintptr_t end = ((uintptr_t)block + size_bytes) & ~(page - 1);

    if (block && start < end)
        (void)madvise((void *)start, end - start, MADV_HUGEPAGE);
#else
    (void)block;
    (void)size_bytes;
#endif
}

char *mem_strdup(const char *text) { return mem_memdup(text, strlen(text) + 1); }

void *mem_memdup(const void *data, size_t size_bytes)
{
    void *copy = mem_alloc(size_bytes);

    if (copy && size_bytes)
        memcpy(copy, data, size_bytes);
    return copy;
}

void mem_free(void *block) { free(block); }

void mem_keep(void)
{
#ifdef __GLIBC__
    mallopt(M_ARENA_MAX, 2);
    mallopt(M_MMAP_THRESHOLD, 4 << 20);
    mallopt(M_TRIM_THRESHOLD, 64 << 20);
#endif
}

void mem_trim(void)
{
#ifdef __GLIBC__
    malloc_trim(0);
#endif
}

int mem_grow_(void **array, size_t *capacity, size_t needed, size_t size_bytes)
{
    size_t wanted = *capacity;
    void *grown;

    if (needed <= wanted)
        return 1;
    wanted = wanted < 8 ? 8 : wanted + wanted / 2;
    if (wanted < needed)
        wanted = needed;
    grown = mem_realloc_array(*array, wanted, size_bytes);
    if (!grown)
        return 0;
    *array = grown;
    *capacity = wanted;
    return 1;
}
