#include "client/study/study_clock.h"

#include <math.h>

#include "client/study/pair.h"

#define SHORT_S 0.02 /* shorter times are mostly the kernel's ticks */

void study_clock_pair(struct study_clock *clock, double a_s, double b_s)
{
    double ratio;

    if (!(a_s > SHORT_S) || !(b_s > SHORT_S))
        return;
    ratio = log(a_s / b_s);
    clock->squares += ratio * ratio;
    clock->pairs++;
}

void study_clock_probe(struct study_clock *clock, double core_s)
{
    if (!(core_s > SHORT_S))
        return;
    if (clock->last_s > 0)
        study_clock_pair(clock, core_s, clock->last_s);
    else
        clock->first_s = core_s;
    clock->last_s = core_s;
}

double study_clock_drift(const struct study_clock *clock)
{
    return clock->first_s > 0 ? clock->last_s / clock->first_s : 1;
}

double study_clock_noise(const struct study_clock *clock)
{
    return clock->pairs ? sqrt(clock->squares / clock->pairs / 2) : NAN;
}

double study_clock_width(const struct study_clock *clock, int probed)
{
    /* A pair's mean has half of one picture's variance. A probe adds one picture's, and the first probe is half of the
     * usual pair, which it then no longer averages. */
    return clock->pairs ? student_t95(clock->pairs) * study_clock_noise(clock) * (probed ? M_SQRT2 : 1) : NAN;
}
