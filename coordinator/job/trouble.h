/* trouble: work that the environment (disk, permissions, descriptors, memory) prevents, and when to try it again.
 *
 *   none --trouble_note--> noted --trouble_note--> noted, with a longer wait
 *     ^------trouble_end------+
 *
 * The attempts never end: the cause may disappear at any time. The store has a trouble (farm->trouble), an open frame
 * has one for its film and its outputs, a job has one for films that cannot be opened and one for pictures that are
 * made again. An outage is logged when it begins and when it ends.
 */
#pragma once

#include <stdint.h>

enum {
    TROUBLE_FIRST_MS = 250,      /* the wait before the second try; it doubles up to */
    TROUBLE_LAST_MS = 5000,
};

struct trouble {
    char text[256];             /* the work that failed, and why; "": none */
    uint64_t since_ns, next_ns; /* monotonic; next_ns UINT64_MAX: not tried again */
    uint32_t tries;
    int quiet; /* its beginning was not logged, because the store's was */
};

int trouble_is(const struct trouble *trouble);
/* Is it too early for the next attempt? */
int trouble_waits(const struct trouble *trouble, uint64_t now_ns);
/* Another attempt failed. 1: it is the first one. */
int trouble_note(struct trouble *trouble, const char *text, uint64_t now_ns);
/* The same with another longest wait, for attempts that cost much. */
int trouble_note_within(struct trouble *trouble, const char *text, uint64_t last_ms, uint64_t now_ns);
/* The work succeeded. 1: there was trouble, which lasted for *lasted_ns. */
int trouble_end(struct trouble *trouble, uint64_t now_ns, uint64_t *lasted_ns);
