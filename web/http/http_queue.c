#include "web/http/http_queue.h"

#include <string.h>

#include "common/base/memory.h"

static void drop_first(struct http_queue *queue)
{
    struct http_piece *piece = queue->first;

    queue->first = piece->next;
    if (!queue->first)
        queue->last = NULL;
    mem_free(piece);
}

void http_queue_release(struct http_queue *queue)
{
    while (queue->first)
        drop_first(queue);
    *queue = (struct http_queue){0};
}

void http_queue_add(struct http_queue *queue, enum http_piece_kind kind, const void *data, size_t size)
{
    struct http_piece *last = queue->last;
    size_t capacity = size;

    if (queue->failed || (size == 0 && kind == HTTP_PIECE_STREAM))
        return;
    if (kind == HTTP_PIECE_STREAM) {
        if (last && last->kind == kind && last->capacity - last->size >= size) {
            memcpy(last->data + HTTP_PIECE_ROOM + last->size, data, size);
            last->size += size;
            queue->bytes += size;
            return;
        }
        if (capacity < HTTP_PIECE_MIN)
            capacity = HTTP_PIECE_MIN;
    }
    last = mem_alloc(sizeof *last + HTTP_PIECE_ROOM + capacity);
    if (!last) {
        queue->failed = 1;
        return;
    }
    *last = (struct http_piece){.kind = kind, .size = size, .capacity = capacity};
    if (size > 0)
        memcpy(last->data + HTTP_PIECE_ROOM, data, size);
    if (queue->last)
        queue->last->next = last;
    else
        queue->first = last;
    queue->last = last;
    queue->bytes += size;
}

uint8_t *http_queue_next(struct http_queue *queue, size_t most, size_t *size, enum http_piece_kind *kind, int *is_start,
                         int *is_end)
{
    struct http_piece *piece = queue->first;

    if (!piece)
        return NULL;
    *size = piece->size - piece->taken;
    if (*size > most)
        *size = most;
    *kind = piece->kind;
    *is_start = piece->taken == 0;
    *is_end = piece->taken + *size == piece->size;
    return piece->data + HTTP_PIECE_ROOM + piece->taken;
}

void http_queue_taken(struct http_queue *queue, size_t size)
{
    struct http_piece *piece = queue->first;

    piece->taken += size;
    queue->bytes -= size;
    if (piece->taken == piece->size)
        drop_first(queue);
}
