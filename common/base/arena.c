#include "common/base/arena.h"

#include <stdint.h>
#include <string.h>

#include "common/base/memory.h"

enum { ARENA_BLOCK_BYTES = 64 * 1024, ARENA_ALIGN = 16 };

struct arena_block {
    struct arena_block *next;
    size_t size, used;
    _Alignas(16) uint8_t bytes[];
};

void arena_init(struct arena *arena) { memset(arena, 0, sizeof *arena); }

void arena_release(struct arena *arena)
{
    struct arena_block *block = arena->head;

    while (block) {
        struct arena_block *next = block->next;
        mem_free(block);
        block = next;
    }
    arena_init(arena);
}

void *arena_alloc(struct arena *arena, size_t count, size_t size_bytes)
{
    struct arena_block *block = arena->head;
    size_t total;
    void *result;

    if (!mem_size_mul(count, size_bytes, &total) || total > SIZE_MAX / 2)
        return NULL;
    total = (total + ARENA_ALIGN - 1) / ARENA_ALIGN * ARENA_ALIGN;
    if (!block || block->size - block->used < total) {
        size_t size = total > ARENA_BLOCK_BYTES ? total : ARENA_BLOCK_BYTES;
        block = mem_alloc_aligned(ARENA_ALIGN, sizeof *block + size);
        if (!block)
            return NULL;
        block->size = size;
        block->used = 0;
        block->next = arena->head;
        arena->head = block;
        arena->total_bytes += sizeof *block + size;
    }
    result = block->bytes + block->used;
    block->used += total;
    return memset(result, 0, total);
}

char *arena_strdup(struct arena *arena, const char *text)
{
    size_t size = strlen(text) + 1;
    char *copy = arena_alloc(arena, size, 1);

    if (copy)
        memcpy(copy, text, size);
    return copy;
}
