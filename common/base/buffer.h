/* buffer: a growable run of bytes, with text helpers (after git's strbuf).
 *
 * Invariant: `data` is NULL or holds `size` bytes and a terminating NUL after them, so a buffer of
 * text can be passed as a C string once something has been added to it. Appending to a buffer that
 * ran out of memory does nothing and sets `failed`; check it once at the end (buffer_ok).
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

struct buffer {
    uint8_t *data;
    size_t size;
    size_t capacity;
    int failed;
};

#define BUFFER_INIT {0}

void buffer_init(struct buffer *b);
void buffer_release(struct buffer *b); /* frees; leaves an initialised empty buffer */
void buffer_clear(struct buffer *b);   /* size = 0, keeps the memory */
void buffer_wipe(struct buffer *b);    /* overwrites what it holds, a secret, and releases it */
void buffer_reserve(struct buffer *b, size_t more_bytes);
void buffer_append(struct buffer *b, const void *data, size_t size_bytes);
uint8_t *buffer_append_space(struct buffer *b, size_t size_bytes); /* NULL if out of memory */
void buffer_printf(struct buffer *b, const char *format, ...) __attribute__((format(printf, 2, 3)));
void buffer_puts(struct buffer *b, const char *text);
void buffer_consume(struct buffer *b, size_t size_bytes); /* drop bytes from the front */

/* The text; "" for an empty buffer. */
const char *buffer_text(const struct buffer *b);

static inline int buffer_ok(const struct buffer *b) { return !b->failed; }
