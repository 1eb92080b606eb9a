/* arena: memory that is freed all at once.
 *
 * The owner of an arena owns everything in it; nothing in it is freed separately. Memory from an
 * arena is zeroed. Not thread-safe: one thread at a time may use an arena.
 */
#pragma once

#include <stddef.h>

struct arena_block;

struct arena {
    struct arena_block *head;
    size_t total_bytes; /* memory taken from the system */
};

void arena_init(struct arena *arena);
void arena_release(struct arena *arena);

/* Zeroed memory aligned to 16 bytes, or NULL when out of memory or on overflow. */
void *arena_alloc(struct arena *arena, size_t count, size_t size_bytes) __attribute__((warn_unused_result));
char *arena_strdup(struct arena *arena, const char *text) __attribute__((warn_unused_result));

#define ARENA_NEW(arena, type) ((type *)arena_alloc((arena), 1, sizeof(type)))
#define ARENA_ARRAY(arena, type, count) ((type *)arena_alloc((arena), (count), sizeof(type)))
