/* duty: may this worker take work now? Not while a signal paused it, outside its hours, or (with
 * --when-idle) while somebody else uses its machine.
 *
 * A machine is in use while other processes take more than idle_load of its processors, or somebody typed
 * at a terminal in the last idle_for_s. It is idle again when neither was so for idle_for_s; a worker
 * begins as if it had been in use. Time and measurements are passed in.
 */
#pragma once

#include <stdint.h>

#include "worker/hours.h"
#include "worker/usage.h"

#define DUTY_IDLE_LOAD_PERCENT 25.0
#define DUTY_IDLE_FOR_S 60.0

struct duty_options {
    struct hours hours;
    int when_idle;
    double idle_load; /* 0..1, of the machine's processors */
    double idle_for_s;
};

/* The first that applies. */
enum duty_state { DUTY_WORKS, DUTY_SIGNAL, DUTY_HOURS, DUTY_IN_USE };

struct duty {
    struct duty_options options;
    int by_signal;    /* paused until the other signal */
    uint64_t used_ns; /* when the machine was last seen in use */
    double other_cpus, input_idle_s;
    unsigned processors;
};

enum { DUTY_REASON_SIZE = 128 };

void duty_init(struct duty *duty, const struct duty_options *options, uint64_t now_ns);
/* A new measurement. */
void duty_look(struct duty *duty, const struct usage *usage, uint64_t now_ns);
/* `minute`: of the local day. `reason` is "" if it works. */
enum duty_state duty_state(const struct duty *duty, int minute, uint64_t now_ns, char reason[DUTY_REASON_SIZE]);
