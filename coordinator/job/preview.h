/* preview: the pictures of an unfinished frame that are kept ready, and when they are made again.
 *
 * A kept preview is made again at growing intervals, so that sending one is a copy:
 *  - somebody asked for it within PREVIEW_WATCHED_MS: not before PREVIEW_COSTS_WATCHED times the processor
 *    time that it took last, or until every tile has samples, when the samples have doubled;
 *  - nobody did: not before PREVIEW_COSTS times that, and with a quarter more samples. An EXR is then
 *    dropped.
 * Never sooner than PREVIEW_LEAST_MS. So previews take at most 2 % of one processor, 4 % while watched.
 */
#ifndef AZULEJO_COORDINATOR_PREVIEW_H
#define AZULEJO_COORDINATOR_PREVIEW_H

#include <stdint.h>

#include "common/base/buffer.h"

enum {
    PREVIEW_LEAST_MS = 1000,
    PREVIEW_WATCHED_MS = 30000,
    PREVIEW_COSTS = 50,
    PREVIEW_COSTS_WATCHED = 25,
    PREVIEW_FIRST_SHARE = 16,         /* the first is made with a 16th of the tiles */
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
/* Should it be made, without being asked for? */
int preview_is_due(const struct preview *p, enum preview_kind kind, const struct preview_now *now);
/* May what is kept be sent to a client that asks now? */
int preview_is_good(const struct preview *p, enum preview_kind kind, const struct preview_now *now);
/* Drop what nobody asks for any more. */
void preview_age(struct preview *p, enum preview_kind kind, uint64_t now_ns);

#endif
