/* job_states: the states of a job, each once.
 *
 * STATE(NAME, name, number, phase, remedy)
 *   NAME, name  JOB_STATE_NAME, the wire's JOB_NAME; the word that people and programs read
 *   number      the wire's and the store's; never used again for another state
 *   phase       OPEN: its units are lent, HELD: none is, ENDED: final
 *   remedy      what a person can do where a verb is refused
 *
 * The order is that in which people read them. coordinator/job/queue.h has the edges between them. */
#pragma once

#include <stddef.h>

#define JOB_STATES(STATE)                                                                                              \
    STATE(QUEUED, queued, 0, OPEN, "it goes on by itself; 'pause' or 'cancel' stops it")                               \
    STATE(RUNNING, running, 1, OPEN, "it goes on by itself; 'pause' or 'cancel' stops it")                             \
    STATE(PAUSED, paused, 7, HELD, "'resume' goes on with it, 'cancel' ends it")                                       \
    STATE(PARKED, parked, 5, HELD, "its workers died or hung: 'resume' tries again, 'cancel' ends it")                 \
    STATE(FINISHING, finishing, 8, OPEN, "it ends with the first pass of its frames in work; 'cancel' ends it now")    \
    STATE(CANCELLING, cancelling, 6, HELD, "wait until its pictures are made")                                         \
    STATE(DONE, done, 2, ENDED, "'extend' gives it more samples, 'retry --frames' makes frames again")                 \
    STATE(FAILED, failed, 3, ENDED, "'retry' goes on with it")                                                         \
    STATE(CANCELLED, cancelled, 4, ENDED, "'retry' goes on with it")

enum job_state {
#define STATE(NAME, name, number, ...) JOB_STATE_##NAME = number,
    JOB_STATES(STATE)
#undef STATE
#define STATE(...) +1
    JOB_STATE_COUNT = 0 JOB_STATES(STATE)
#undef STATE
};

/* "queued"; "unknown" for a number that is no state. */
const char *job_state_word(int state);
/* Is it final? */
int job_state_ended(int state);
/* Are units lent in this state? */
int job_state_is_open(int state);
const char *job_state_remedy(int state);
/* The bit of the state that is named by so many bytes; 0: none is. */
unsigned job_state_find(const char *word, size_t length);
/* "queued, running, ... and cancelled". */
const char *job_state_words(void);
