/* metrics: the farm in numbers, as Prometheus reads them.
 *
 * Counters are of this run of the coordinator. What takes the store's room is measured by a task of the pool, when
 * somebody asks and the last measurement is METRICS_STORE_MS old: the answer does not wait for it.
 */
#pragma once

#include <stdint.h>

#include "common/base/buffer.h"
#include "common/base/histogram.h"
#include "coordinator/store/files/footprint.h"

enum {
    METRICS_STORE_MS = 60000,
    METRICS_STORE_SHARE = 20,    /* and measuring takes at most this part of the time */
    METRICS_FRAMES_MAX = 50,     /* frames in work, which have labels of their own */
};

struct page;

/* Zeroed. */
struct metrics {
    struct histogram lag; /* how late the loop's ticks were */
    uint64_t ticked_ns;
    struct footprint store; /* without its jobs; as it was measured last */
    uint64_t measured_ns;   /* monotonic; 0: not yet */
    uint64_t next_ns;
    int measuring;
};

/* At each tick of the server's loop. */
void metrics_tick(struct metrics *metrics, uint64_t now_ns);
/* Append all of them. */
void metrics_write(struct page *page, uint64_t now_ns, struct buffer *out);
