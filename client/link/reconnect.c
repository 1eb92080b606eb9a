#include "client/link/reconnect.h"

#include <poll.h>
#include <stdio.h>

#include "client/terminal/format.h"
#include "client/link/signals.h"
#include "common/system/clock.h"

enum { PAUSE_FIRST_MS = 250, PAUSE_LAST_MS = 5000 };

int reconnect_is_loss(status code) { return code == STATUS_ERR_UNREACHABLE || code == STATUS_ERR_TIMEOUT; }

/* Wait that long, or until a signal arrives or `until_ns`. */
static void pause_until(uint64_t until_ns, unsigned pause_ms)
{
    struct pollfd wake = {.fd = signals_fd(), .events = POLLIN}; /* -1 is ignored */
    uint64_t now_ns = clock_monotonic_ns();
    uint64_t left_ms = now_ns < until_ns ? (until_ns - now_ns) / NS_PER_MS + 1 : 0;

    (void)poll(&wake, 1, (int)(left_ms < pause_ms ? left_ms : pause_ms));
    signals_drain();
}

status reconnect(struct connection **c, const struct reconnect *how, struct error *err)
{
    struct error lost = err ? *err : (struct error){.code = STATUS_ERR_UNREACHABLE};
    uint64_t until_ns = clock_monotonic_ns() + (uint64_t)(how->patience_s * 1e9);
    unsigned pause_ms = PAUSE_FIRST_MS;
    char patience[FORMAT_SIZE];
    status result = lost.code;

    connection_close(*c);
    *c = NULL;
    if (!(how->patience_s > 0))
        return result;
    if (!how->quiet)
        fprintf(stderr, "%s; waiting up to %s for it to come back\n", lost.text,
                format_duration(patience, how->patience_s));
    if (how->deadline_ns && how->deadline_ns < until_ns)
        until_ns = how->deadline_ns;
    while (!*c) {
        pause_until(until_ns, pause_ms);
        pause_ms = pause_ms * 2 < PAUSE_LAST_MS ? pause_ms * 2 : PAUSE_LAST_MS;
        TRY(how->where.watch ? how->where.watch(how->where.watch_user, err) : STATUS_OK);
        result = connection_open(c, &how->where, err);
        if (result == STATUS_OK || !reconnect_is_loss(result))
            break;
        if (clock_monotonic_ns() < until_ns)
            continue;
        if (until_ns == how->deadline_ns)
            return error_set(err, STATUS_ERR_TIMEOUT, "%s", lost.text);
        if (err)
            *err = lost;
        return lost.code;
    }
    if (result == STATUS_OK && !how->quiet)
        fprintf(stderr, "the coordinator at %s is back\n", connection_address(*c));
    return result;
}

status connection_open_waiting(struct connection **out, const struct connection_options *options, struct error *err)
{
    struct reconnect how = {.where = *options, .quiet = options->quiet && *options->quiet};
    status result = connection_open(out, options, err);

    if (result != STATUS_ERR_TIMEOUT || !options->patience_s)
        return result;
    how.patience_s = *options->patience_s;
    return reconnect(out, &how, err);
}
