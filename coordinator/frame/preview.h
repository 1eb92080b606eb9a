/* preview: the pictures of an unfinished frame that are kept ready, and when they are made again.
 *
 * The first is made when somebody asks. For PREVIEW_WATCHED_MS from the last question it is kept and made again, so
 * that sending one is a copy: not before PREVIEW_COSTS times the processor time that it took last, nor sooner than
 * PREVIEW_LEAST_MS, or until every tile has samples, when the samples have doubled. So previews take at most 4 % of
 * one processor while somebody watches, and nothing otherwise.
 */
#pragma once

#include <stdint.h>

#include "common/base/buffer.h"

enum {
    PREVIEW_LEAST_MS = 1000,
    PREVIEW_WATCHED_MS = 30000,
    PREVIEW_COSTS = 25,
    PREVIEW_KEPT_BYTES = 64 << 20,    /* larger ones are made for each request */
};

/* A picture's bytes, shared by what is kept and by those that are being sent. One thread's. */
struct preview_file {
    struct buffer bytes;
    uint32_t holders;
};
/* Takes the buffer's memory, also on failure; has one holder. NULL: out of memory. */
struct preview_file *preview_file_new(struct buffer *bytes);
struct preview_file *preview_file_hold(struct preview_file *file);
void preview_file_drop(struct preview_file *file); /* NULL is fine */

enum preview_kind { PREVIEW_PNG, PREVIEW_EXR, PREVIEW_KINDS };

/* Zeroed: nothing is kept. */
struct preview {
    struct preview_file *file; /* NULL: none is kept */
    double covered;            /* what it shows: the share of tiles that have samples, */
    uint64_t samples;          /* the samples of the frame, */
    uint32_t revision;         /* and the job's output settings */
    uint64_t made_ns;          /* monotonic */
    uint64_t cost_ns;          /* processor time that it took */
    uint64_t asked_ns;         /* when a client asked last; 0: never */
    int too_large;             /* to be kept */
    const void *making;        /* the task that makes it; NULL: none */
};

/* The frame as it is. */
struct preview_now {
    double covered;
    uint64_t samples, now_ns;
    uint32_t revision;
};

void preview_release(struct preview *p);
int preview_is_watched(const struct preview *p, uint64_t now_ns);
/* Should it be made again? */
int preview_is_due(const struct preview *p, const struct preview_now *now);
/* May what is kept be sent to a client that asks now? */
int preview_is_good(const struct preview *p, enum preview_kind kind, const struct preview_now *now);
/* Drop what is not asked for any more. */
void preview_age(struct preview *p, uint64_t now_ns);
