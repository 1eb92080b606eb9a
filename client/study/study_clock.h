/* study_clock: what a study's processor times are worth.
 *
 * Equal pictures take unequal times, and over minutes a machine becomes faster or slower as a whole. So between the two
 * pictures of each way one of the usual way is rendered again, always the same: the probe. A way's time is divided by
 * what the probe takes at that moment over what it took at first, and how far equal pictures are apart is in every
 * interval that times are part of. Nothing here does I/O.
 */
#pragma once

/* Zero-initialise. */
struct study_clock {
    double squares; /* sum over the pairs of equal pictures of ln(one's time / the other's), squared */
    unsigned pairs;
    double first_s, last_s; /* of the probe */
};

/* Two pictures of equal work. Times too short to be measured do not count. */
void study_clock_pair(struct study_clock *clock, double a_s, double b_s);
/* The probe has been rendered (again). */
void study_clock_probe(struct study_clock *clock, double core_s);
/* How much slower the machine is now than at the first probe; 1: not known. */
double study_clock_drift(const struct study_clock *clock);
/* The standard deviation of ln of one picture's time; NaN: not known. */
double study_clock_noise(const struct study_clock *clock);
/* Half of the 95 % interval of ln(time of a pair / time of another pair); `probed`: one is corrected by its probe.
 * NaN: not known. */
double study_clock_width(const struct study_clock *clock, int probed);
