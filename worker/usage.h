/* usage: what this process and the others of its machine use.
 *
 * Processors: of this process its own CPU clock; of the others /proc/stat (user, nice, system, irq and softirq time of
 * all processors; in a container that is the whole machine) less our own. Both are means since the last look. The last
 * input is the newest access time of a terminal (/dev/tty*, /dev/pts/?*), which the kernel sets when somebody types
 * there; input to a graphical desktop does not show in them.
 */
#pragma once

#include <stdint.h>

struct usage {
    unsigned processors;   /* of the machine, online */
    double cpus;           /* that this process used */
    double other_cpus;     /* that all others used; negative: not known */
    double input_idle_s;   /* since the last input at a terminal; negative: not known */
    uint64_t memory_bytes; /* resident */
    uint64_t machine_memory_bytes;
    uint64_t at_ns, own_ns, busy_ns; /* at the last look; busy_ns of the machine, 0: not known */
};

/* The first look: cpus is 0, other_cpus not known. 0: /proc/stat cannot be read. */
int usage_init(struct usage *usage);
void usage_look(struct usage *usage);

/* The busy time in the text of /proc/stat, for a clock of `hertz`; 0: it is not there. */
uint64_t usage_busy_ns(const char *stat, long hertz);
