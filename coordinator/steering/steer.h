/* steer: what people do to jobs. common/schema/verbs.h says in which states; here is what becomes of it:
 *
 *   pause PAUSED, resume and retry QUEUED, finish FINISHING, cancel CANCELLING, with `discard` CANCELLED;
 *   extend QUEUED if it was DONE; remove: gone; the others leave the state as it is
 *
 * A function returns when the change and its line in the job's log are on disk, or, if the store
 * cannot be written, noted for later (remove, retry and extend fail instead: ERR_IO).
 */
#pragma once

#include "common/schema/verbs.h"
#include "coordinator/farm/farm.h"
#include "protocol/azulejo.pb-c.h"

struct steering {
    struct farm *farm;
    struct job *job;
    const Azulejo__Wire__Envelope *message; /* the verb's, with its arguments */
    const char *who;                        /* for the log */
    uint64_t now_ns;                        /* the monotonic clock */
};

/* Is this the message of a verb, and of which, or of which variant? VERB_COUNT: of none. */
enum job_verb_name steer_verb(const Azulejo__Wire__Envelope *message);
/* Would the verb do something to the job, as far as can be said without the disk? */
int steer_offers(const struct job *job, enum job_verb_name verb);
/* Do what the message says. ERR_REFUSED: the job's state does not allow it; and the function's own errors. */
status steer(const struct steering *s, struct error *err) MUST_CHECK;

/* The chosen frames of a job that has ended go on, as by `retry`, and no others: it is QUEUED. The caller has called
 * job_reopen_check. ERR_IO, ERR_NO_MEMORY: nothing changed. */
status steer_reopen(struct farm *farm, struct job *job, const struct job_reopening *chosen, struct error *err) MUST_CHECK;

/* What each verb does, in a state that allows it: steer_pause, ...
 *
 * resume   suspicions against the job, and of machines that cannot render it, are cleared
 * cancel   farm_cancel; `discard`: unfinished frames become no pictures, and their films are removed
 * start    it waits no longer for other jobs and for its time (needs.h); what it requires of workers remains
 * extend   farm_extend, or farm_retarget: other rules about when its frames have enough samples. The log says which, and
 *          what they were; nothing happens if the job in work has them
 * retry    the frames that are given (ascending; none: those that are not done, and those that a person cut short) go on
 *          with the films that are there, or from the beginning; a done frame without film is rendered again. Frames that
 *          are given keep no result of a blocked worker.
 *          ERR_INPUT: no such frame
 * remove   the job, with its films, pictures and log; s->job is freed, unless a develop still holds it */
typedef status steer_deed(const struct steering *s, struct error *err);
#define VERB(NAME, name, ...) steer_deed steer_##name;
#define VARIANT(...)
JOB_VERBS(VERB, VARIANT)
#undef VERB
#undef VARIANT
