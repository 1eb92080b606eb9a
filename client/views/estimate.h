/* estimate: what a job's accuracy will cost, judged by a few samples of a few of its frames. */
#pragma once

#include "client/link/connection.h"
#include "common/accuracy/price.h"
#include "common/accuracy/stop.h"

enum { ESTIMATE_FRAMES_MAX = 3 }; /* rendered: the first, the middle, the last */

/* The history of the error of one of these frames. */
struct estimate_frame {
    uint32_t number;
    Azulejo__Wire__Envelope *history;
    struct prices prices, target_prices; /* of the display error; in the target's measure */
};

struct estimate {
    double price;               /* of a core-hour; negative: none was given */
    double seconds_to_deadline; /* negative: none was given */
    int has_target;
    struct allocation_target target;
    uint32_t spp, pilot_spp; /* the job's cap, and the samples rendered */
    uint32_t frame_count;    /* of the job */
    struct estimate_frame frames[ESTIMATE_FRAMES_MAX];
    size_t count;
    const Azulejo__Wire__JobInfo *info; /* of the job that was rendered */
    double cores;                       /* of the farm, or the local ones; 0: not known */
    uint32_t workers;                   /* of the farm; 0: rendered on this machine */
    const char *command;                /* the command that continues from it; NULL: there is none
                                            */
};

/* Find the prices from the histories. */
void estimate_fit(struct estimate *e);
/* The newest figures of one of its frames; never NULL after estimate_check. */
const Azulejo__Wire__HistoryPoint *estimate_point(const struct estimate_frame *frame);
/* ERR_INPUT: a frame has too few samples for an estimate. */
status estimate_check(const struct estimate *e, struct error *err) MUST_CHECK;

status estimate_print_json(const struct estimate *e, struct error *err) MUST_CHECK;
void estimate_print_text(const struct estimate *e);
