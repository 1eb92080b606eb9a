#include "coordinator/net/descriptors.h"

#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>

#include "common/system/log.h"

enum {
    OPEN_ASSUMED = 32, /* where they cannot be counted */
    OPEN_LATER = 16,   /* the event loop's own and the listener */
};

static uint64_t clamp(uint64_t value, uint64_t low, uint64_t high)
{
    return value < low ? low : value > high ? high : value;
}

status descriptors_share(struct descriptors *out, uint64_t limit, uint64_t open, struct error *err)
{
    const uint64_t needed = open + DESCRIPTORS_RESERVE_MIN + STRANGERS_MIN + SESSIONS_MIN;
    uint64_t left, strangers;

    memset(out, 0, sizeof *out);
    if (limit < needed)
        return error_set(err, STATUS_ERR_LIMIT,
                         "%llu file descriptors are allowed, and at least %llu are needed: raise "
                         "the hard limit (ulimit -Hn, LimitNOFILE=)",
                         (unsigned long long)limit, (unsigned long long)needed);
    out->limit = limit;
    out->reserve = (uint32_t)clamp(limit / 8, DESCRIPTORS_RESERVE_MIN, DESCRIPTORS_RESERVE_MAX);
    if (out->reserve > limit - (needed - DESCRIPTORS_RESERVE_MIN))
        out->reserve = (uint32_t)(limit - (needed - DESCRIPTORS_RESERVE_MIN));
    left = limit - open - out->reserve;
    strangers = clamp(left / 4, STRANGERS_MIN, STRANGERS_MAX);
    out->connections_max = (uint32_t)clamp(left, 0, SESSIONS_MAX + STRANGERS_MAX);
    out->sessions_max = (uint32_t)clamp(left - strangers, SESSIONS_MIN, SESSIONS_MAX);
    return STATUS_OK;
}

uint32_t descriptors_strangers(const struct descriptors *d, uint32_t sessions)
{
    return (uint32_t)clamp(d->connections_max - sessions, STRANGERS_MIN, STRANGERS_MAX);
}

static uint64_t count_open(void)
{
    DIR *stream = opendir("/proc/self/fd");
    const struct dirent *entry;
    uint64_t count = 0;

    if (!stream)
        return OPEN_ASSUMED;
    while ((entry = readdir(stream)))
        if (entry->d_name[0] != '.')
            count++;
    closedir(stream);
    return count;
}

status descriptors_plan(struct descriptors *out, uint32_t guests, struct error *err)
{
    struct rlimit limit;
    rlim_t soft;
    char raised[48] = "";
    status s;

    memset(out, 0, sizeof *out);
    if (getrlimit(RLIMIT_NOFILE, &limit) != 0)
        return error_set(err, STATUS_ERR_INTERNAL, "the limit of file descriptors: %s", strerror(errno));
    soft = limit.rlim_cur;
    limit.rlim_cur = limit.rlim_max;
    if (soft != limit.rlim_max && setrlimit(RLIMIT_NOFILE, &limit) != 0) {
        log_warn("the limit of file descriptors stays at %llu: %s", (unsigned long long)soft, strerror(errno));
        limit.rlim_cur = soft;
    }
    guests = (uint32_t)clamp(guests, 0, limit.rlim_cur / 8);
    s = descriptors_share(out, limit.rlim_cur, count_open() + OPEN_LATER + guests, err);
    out->guests_max = guests;
    if (limit.rlim_cur != soft)
        snprintf(raised, sizeof raised, " (raised from %llu)", (unsigned long long)soft);
    if (s == STATUS_OK)
        log_info("%llu file descriptors%s: at most %u connections, of these %u sessions, and %u of the page; "
                 "%u kept for the store",
                 (unsigned long long)limit.rlim_cur, raised, out->connections_max, out->sessions_max, out->guests_max,
                 out->reserve);
    return s;
}

uint32_t descriptors_of_address(uint32_t most, uint32_t configured)
{
    if (configured > 0)
        return configured < most ? configured : most;
    return most - most / 4;
}
