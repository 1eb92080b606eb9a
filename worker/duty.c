#include "worker/duty.h"

#include <stdio.h>

void duty_init(struct duty *duty, const struct duty_options *options, uint64_t now_ns)
{
    *duty = (struct duty){.options = *options, .used_ns = now_ns, .other_cpus = -1, .input_idle_s = -1};
}

static int load_is_high(const struct duty *duty)
{
    return duty->other_cpus > duty->options.idle_load * duty->processors;
}

static int has_input(const struct duty *duty)
{
    return duty->input_idle_s >= 0 && duty->input_idle_s < duty->options.idle_for_s;
}

void duty_look(struct duty *duty, const struct usage *usage, uint64_t now_ns)
{
    duty->other_cpus = usage->other_cpus;
    duty->input_idle_s = usage->input_idle_s;
    duty->processors = usage->processors;
    if (load_is_high(duty))
        duty->used_ns = now_ns;
    else if (has_input(duty)) {
        uint64_t typed_ns = now_ns - (uint64_t)(duty->input_idle_s * 1e9);
        if (typed_ns <= now_ns && typed_ns > duty->used_ns)
            duty->used_ns = typed_ns;
    }
}

static void explain_use(const struct duty *duty, double idle_s, char reason[DUTY_REASON_SIZE])
{
    if (load_is_high(duty))
        snprintf(reason, DUTY_REASON_SIZE,
                 "its machine is in use: other processes take %.1f of %u processors, more than %.4g %%",
                 duty->other_cpus, duty->processors, 100 * duty->options.idle_load);
    else if (has_input(duty))
        snprintf(reason, DUTY_REASON_SIZE, "its machine is in use: somebody typed at a terminal %.0f s ago",
                 duty->input_idle_s);
    else
        snprintf(reason, DUTY_REASON_SIZE, "its machine has been idle for %.0f s of %.4g", idle_s,
                 duty->options.idle_for_s);
}

enum duty_state duty_state(const struct duty *duty, int minute, uint64_t now_ns, char reason[DUTY_REASON_SIZE])
{
    double idle_s = (double)(now_ns - duty->used_ns) / 1e9;

    reason[0] = 0;
    if (duty->by_signal) {
        snprintf(reason, DUTY_REASON_SIZE, "by SIGUSR1, until SIGUSR2");
        return DUTY_SIGNAL;
    }
    if (!hours_include(&duty->options.hours, minute)) {
        int next = hours_next(&duty->options.hours, minute);
        snprintf(reason, DUTY_REASON_SIZE, "until %02d:%02d of its local time (--hours)", next / 60, next % 60);
        return DUTY_HOURS;
    }
    if (duty->options.when_idle && (load_is_high(duty) || idle_s < duty->options.idle_for_s)) {
        explain_use(duty, idle_s, reason);
        return DUTY_IN_USE;
    }
    return DUTY_WORKS;
}
