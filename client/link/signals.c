#include "client/link/signals.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <string.h>
#include <unistd.h>

static const int stop_signals[] = {SIGINT, SIGTERM, SIGHUP};
enum { STOP_SIGNAL_COUNT = sizeof stop_signals / sizeof stop_signals[0] };

static int pipe_ends[2] = {-1, -1};
static volatile sig_atomic_t stop_signal, stop_count;

static void note(int number)
{
    int saved = errno;

    if (number != SIGCHLD) {
        stop_signal = number;
        stop_count++;
    }
    /* A full pipe is fine: the reader has not yet seen the bytes that are in it. */
    if (write(pipe_ends[1], "", 1) < 0) {
    }
    errno = saved;
}

status signals_catch(struct error *err)
{
    struct sigaction action;

    if (pipe_ends[0] >= 0)
        return STATUS_OK;
    if (pipe2(pipe_ends, O_CLOEXEC | O_NONBLOCK) != 0)
        return error_set(err, STATUS_ERR_IO, "no pipe for signals: %s", strerror(errno));
    memset(&action, 0, sizeof action);
    action.sa_handler = note;
    sigemptyset(&action.sa_mask);
    action.sa_flags = SA_RESTART;
    for (int i = 0; i < STOP_SIGNAL_COUNT; i++)
        sigaction(stop_signals[i], &action, NULL);
    action.sa_flags |= SA_NOCLDSTOP;
    sigaction(SIGCHLD, &action, NULL);
    return STATUS_OK;
}

void signals_restore_in_child(void)
{
    struct sigaction action;

    memset(&action, 0, sizeof action);
    action.sa_handler = SIG_DFL;
    sigemptyset(&action.sa_mask);
    for (int i = 0; i < STOP_SIGNAL_COUNT; i++)
        sigaction(stop_signals[i], &action, NULL);
    sigaction(SIGCHLD, &action, NULL);
    sigaction(SIGPIPE, &action, NULL);
}

int signals_fd(void) { return pipe_ends[0]; }

void signals_drain(void)
{
    char bytes[64];

    while (pipe_ends[0] >= 0 && read(pipe_ends[0], bytes, sizeof bytes) > 0) {
    }
}

int signals_stop(void) { return stop_signal; }

int signals_stop_count(void) { return stop_count; }
