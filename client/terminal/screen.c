#include "client/terminal/screen.h"

#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define SCREEN_OTHER "\033[?1049h\033[?25l"
#define SCREEN_BACK "\033[?25h\033[?1049l"

void screen_begin(struct screen *s)
{
    const char *term = getenv("TERM");
    struct termios keys;

    memset(s, 0, sizeof *s);
    s->drawn_on = isatty(STDOUT_FILENO) && term && *term && strcmp(term, "dumb") != 0;
    if (!s->drawn_on)
        return;
    /* A program in the background must not change the terminal's settings. */
    if (isatty(STDIN_FILENO) && tcgetpgrp(STDIN_FILENO) == getpgrp() &&
        tcgetattr(STDIN_FILENO, &s->before) == 0) {
        keys = s->before;
        keys.c_lflag &= ~(tcflag_t)(ICANON | ECHO);
        keys.c_cc[VMIN] = 0;
        keys.c_cc[VTIME] = 0;
        keys.c_cc[VSUSP] = _POSIX_VDISABLE;
        s->reads_keys = tcsetattr(STDIN_FILENO, TCSANOW, &keys) == 0;
    }
    fputs(SCREEN_OTHER, stdout);
    fflush(stdout);
}

void screen_end(struct screen *s)
{
    if (s->drawn_on) {
        fputs(SCREEN_BACK, stdout);
        fflush(stdout);
    }
    if (s->reads_keys)
        tcsetattr(STDIN_FILENO, TCSANOW, &s->before);
    s->drawn_on = s->reads_keys = 0;
}

void screen_clear(const struct screen *s)
{
    if (s->drawn_on)
        fputs("\033[H\033[2J", stdout);
}

int screen_wait(const struct screen *s, int signals_fd, int wait_ms)
{
    struct pollfd events[] = {{.fd = signals_fd, .events = POLLIN},
                              {.fd = s->reads_keys ? STDIN_FILENO : -1, .events = POLLIN}};
    char key = 0;

    fflush(stdout);
    (void)poll(events, 2, wait_ms);
    if (events[1].revents == 0 || read(STDIN_FILENO, &key, 1) != 1)
        return 0;
    return (unsigned char)key;
}
