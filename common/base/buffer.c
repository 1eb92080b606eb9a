#include "common/base/buffer.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"

void buffer_init(struct buffer *b) { memset(b, 0, sizeof *b); }

void buffer_release(struct buffer *b)
{
    mem_free(b->data);
    buffer_init(b);
}

void buffer_wipe(struct buffer *b)
{
    if (b->data) /* the C library wants a pointer also where there is nothing to wipe */
        explicit_bzero(b->data, b->capacity);
    buffer_release(b);
}

void buffer_clear(struct buffer *b)
{
    b->size = 0;
    b->failed = 0;
    if (b->data)
        b->data[0] = 0;
}

void buffer_reserve(struct buffer *b, size_t more_bytes)
{
    size_t needed;

    if (b->failed)
        return;
    if (__builtin_add_overflow(b->size, more_bytes, &needed) || __builtin_add_overflow(needed, (size_t)1, &needed) ||
        !MEM_GROW(b->data, b->capacity, needed))
        b->failed = 1;
}

uint8_t *buffer_append_space(struct buffer *b, size_t size_bytes)
{
    uint8_t *space;

    buffer_reserve(b, size_bytes);
    if (b->failed)
        return NULL;
    space = b->data + b->size;
    b->size += size_bytes;
    b->data[b->size] = 0;
    return space;
}

void buffer_append(struct buffer *b, const void *data, size_t size_bytes)
{
    uint8_t *space = buffer_append_space(b, size_bytes);

    if (space && size_bytes)
        memcpy(space, data, size_bytes);
}

void buffer_printf(struct buffer *b, const char *format, ...)
{
    va_list args, again;
    int length;

    va_start(args, format);
    va_copy(again, args);
    length = vsnprintf(NULL, 0, format, args);
    va_end(args);
    if (length < 0) {
        b->failed = 1;
    } else {
        buffer_reserve(b, (size_t)length);
        if (!b->failed) {
            vsnprintf((char *)b->data + b->size, (size_t)length + 1, format, again);
            b->size += (size_t)length;
        }
    }
    va_end(again);
}

void buffer_puts(struct buffer *b, const char *text) { buffer_append(b, text, strlen(text)); }

void buffer_consume(struct buffer *b, size_t size_bytes)
{
    if (size_bytes >= b->size) {
        b->size = 0;
    } else {
        memmove(b->data, b->data + size_bytes, b->size - size_bytes);
        b->size -= size_bytes;
    }
    if (b->data)
        b->data[b->size] = 0;
}

const char *buffer_text(const struct buffer *b) { return b->data ? (const char *)b->data : ""; }
