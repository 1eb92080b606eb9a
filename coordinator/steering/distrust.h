/* distrust: what a worker rendered is rendered again.
 *
 *   a loser of an audit, or `azulejo distrust` --distrust_worker--> blocked by name, its results not believed (distrusted.h)
 *     frames in work that have some, done frames whose films were kept --distrust_tick--> opened again, without them
 *     done frames without a film, or of another release --> listed: people decide
 *
 * Who rendered a done frame is in its row of the store, so all of this holds over restarts: what distrust_tick did not get to
 * is found again at the next start. */
#pragma once

#include "coordinator/farm/farm.h"

enum {
    DISTRUST_REPORTS_MAX = 16,   /* answers under way */
    DISTRUST_FRAMES_MAX = 65536, /* in one of them */
};

enum distrust_fate {
    DISTRUST_AGAIN,   /* it is rendered again */
    DISTRUST_NO_FILM, /* its film was not kept: `retry --frames` renders it from its beginning */
    DISTRUST_RELEASE, /* its job was rendered by another release: submit the scene again */
};

/* Frames that have samples of one worker, by ascending job and frame. */
struct distrust_report {
    struct distrust_frame {
        uint64_t job;
        uint32_t frame;
        enum distrust_fate fate;
    } * frames;
    size_t count, capacity;
};
void distrust_report_release(struct distrust_report *report);

/* Block the name, and believe nothing that it has delivered so far, of done frames since that moment (seconds since 1970,
 * UTC; 0: ever). `who`: for the log. ERR_NOT_FOUND: no such worker has delivered anything; ERR_INPUT: no worker's name;
 * ERR_IO, ERR_NO_MEMORY: repeat it. */
status distrust_worker(struct farm *farm, const char *name, int64_t since, const char *who,
                       struct distrust_report *report, struct error *err) MUST_CHECK;
/* At every tick. */
void distrust_tick(struct farm *farm);
