#include "worker/usage.h"

#include <fcntl.h>
#include <glob.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "common/system/clock.h"

/* The beginning of a small file as a string; "" when it cannot be read. */
static void read_text(const char *path, char *out, size_t size)
{
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    ssize_t got = fd < 0 ? 0 : read(fd, out, size - 1);

    out[got > 0 ? got : 0] = 0;
    if (fd >= 0)
        close(fd);
}

uint64_t usage_busy_ns(const char *stat, long hertz)
{
    unsigned long long user, nice, system, idle, iowait, irq, softirq;

    if (hertz <= 0 || sscanf(stat, "cpu %llu %llu %llu %llu %llu %llu %llu", &user, &nice, &system, &idle, &iowait,
                             &irq, &softirq) != 7)
        return 0;
    return (user + nice + system + irq + softirq) * (NS_PER_SECOND / (uint64_t)hertz);
}

static uint64_t machine_busy_ns(void)
{
    char text[512];

    read_text("/proc/stat", text, sizeof text);
    return usage_busy_ns(text, sysconf(_SC_CLK_TCK));
}

static uint64_t own_cpu_ns(void)
{
    struct timespec t = {0};

    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (uint64_t)t.tv_sec * NS_PER_SECOND + (uint64_t)t.tv_nsec;
}

static uint64_t resident_bytes(void)
{
    char text[128];
    unsigned long long size, resident;

    read_text("/proc/self/statm", text, sizeof text);
    if (sscanf(text, "%llu %llu", &size, &resident) != 2)
        return 0;
    return resident * (uint64_t)sysconf(_SC_PAGESIZE);
}

/* A terminal without input since the machine started does not count: 0 is no time of input. */
static double terminals_idle_s(void)
{
    static const char *const patterns[] = {"/dev/tty[0-9]*", "/dev/pts/[0-9]*"};
    time_t now = time(NULL), newest = 0;

    for (size_t p = 0; p < sizeof patterns / sizeof *patterns; p++) {
        glob_t found;
        if (glob(patterns[p], GLOB_NOSORT, NULL, &found) != 0)
            continue;
        for (size_t i = 0; i < found.gl_pathc; i++) {
            struct stat info;
            if (stat(found.gl_pathv[i], &info) == 0 && S_ISCHR(info.st_mode) && info.st_atime > newest)
                newest = info.st_atime;
        }
        globfree(&found);
    }
    return newest == 0 ? -1 : newest < now ? (double)(now - newest) : 0;
}

int usage_init(struct usage *usage)
{
    memset(usage, 0, sizeof *usage);
    usage_look(usage);
    usage->cpus = 0;
    usage->other_cpus = -1;
    return usage->busy_ns > 0;
}

void usage_look(struct usage *usage)
{
    uint64_t at_ns = clock_monotonic_ns(), own_ns = own_cpu_ns(), busy_ns = machine_busy_ns();
    double passed_ns = (double)(at_ns - usage->at_ns);
    long processors = sysconf(_SC_NPROCESSORS_ONLN);

    usage->processors = processors > 0 ? (unsigned)processors : 1;
    usage->cpus = passed_ns > 0 ? (double)(own_ns - usage->own_ns) / passed_ns : 0;
    usage->other_cpus = -1;
    if (busy_ns > 0 && usage->busy_ns > 0 && passed_ns > 0) {
        double busy = busy_ns > usage->busy_ns ? (double)(busy_ns - usage->busy_ns) / passed_ns : 0;
        usage->other_cpus = busy > usage->cpus ? busy - usage->cpus : 0;
    }
    usage->input_idle_s = terminals_idle_s();
    usage->memory_bytes = resident_bytes();
    usage->machine_memory_bytes = (uint64_t)sysconf(_SC_PHYS_PAGES) * (uint64_t)sysconf(_SC_PAGESIZE);
    usage->at_ns = at_ns;
    usage->own_ns = own_ns;
    usage->busy_ns = busy_ns;
}
