/* http_queue: bytes that wait for a connection to take them, in pieces that keep the ends of messages.
 *
 * Every piece has room in front of it for the library's own framing, so nothing is copied a second time.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

enum {
    HTTP_PIECE_ROOM = 32,        /* in front of a piece's bytes */
    HTTP_PIECE_MIN = 4 << 10,    /* small writes of a stream share a piece of this size */
};

enum http_piece_kind { HTTP_PIECE_STREAM, HTTP_PIECE_TEXT, HTTP_PIECE_BINARY };

struct http_piece {
    struct http_piece *next;
    enum http_piece_kind kind;
    size_t size, capacity, taken; /* `taken` of `size` bytes were sent */
    uint8_t data[];               /* HTTP_PIECE_ROOM, then the bytes */
};

struct http_queue {
    struct http_piece *first, *last;
    size_t bytes; /* that were not sent */
    int failed;   /* out of memory: the connection must end, for bytes are missing */
};

void http_queue_release(struct http_queue *queue);
/* A copy of the bytes; those of streams are joined. */
void http_queue_add(struct http_queue *queue, enum http_piece_kind kind, const void *data, size_t size);
/* The next bytes to send, at most `most`; they stay until http_queue_taken. NULL: none. *is_start and
 * *is_end tell where they lie in their message. */
uint8_t *http_queue_next(struct http_queue *queue, size_t most, size_t *size, enum http_piece_kind *kind, int *is_start,
                         int *is_end);
void http_queue_taken(struct http_queue *queue, size_t size);
