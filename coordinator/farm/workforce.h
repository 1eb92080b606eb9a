/* workforce: the connected workers, and what is known of them without walking their list.
 *
 * Due are workers that may be able to take work: one that asked for more or delivered something
 * (workforce_due), or all (farm_wake: something came that any may take). Hungry is a worker that
 * had room and got nothing because there was nothing for it; one that holds enough is not.
 *
 * Proven workers (credit.h) are kept in the order of their last delivery, so that the sum of their
 * threads is at hand: workforce_counts after every change of a worker's credit.
 *
 * Invariant: proven_threads is the sum of counted_threads over the list from proven_oldest; it equals
 * the sum of credit.threads of proven workers that take work whenever workforce_threads returns.
 */
#pragma once

#include <stdint.h>

struct farm;
struct farm_worker;

struct workforce {
    struct farm_worker *due_first, *due_last;
    uint32_t hungry; /* how many are */
    struct farm_worker *proven_oldest, *proven_newest;
    uint64_t proven_threads;
};

/* A worker's place in the above. Zeroed. */
struct workforce_place {
    struct farm_worker *due_next, *due_previous;
    struct farm_worker *older, *newer; /* by delivery */
    uint32_t counted_threads;          /* 0: it is not in the list */
    uint32_t index;                    /* in farm->workers */
    uint8_t is_due, is_hungry;
};

void workforce_due(struct farm *farm, struct farm_worker *worker);
/* The next worker that is due, which it then no longer is; NULL: none. */
struct farm_worker *workforce_next_due(struct farm *farm);
void workforce_set_hungry(struct farm *farm, struct farm_worker *worker, int hungry);

/* The worker's credit may have changed, or whether it takes work (roster.h). */
void workforce_counts(struct farm *farm, struct farm_worker *worker);
/* The threads that share a frame's last units: this worker's, and those of workers that deliver. */
uint64_t workforce_threads(struct farm *farm, const struct farm_worker *worker, uint64_t now_ns);

/* The worker leaves. */
void workforce_leave(struct farm *farm, struct farm_worker *worker);
