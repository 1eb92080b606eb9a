/* screen: the whole terminal, for a display that is drawn again and again.
 *
 * Uses the terminal's other screen, so that what was there before is back afterwards; the cursor is
 * hidden, and keys arrive at once and unseen. screen_end restores all of it. Ctrl-C stays a signal;
 * Ctrl-Z is off, because it would leave the terminal in this state.
 */
#pragma once

#include <stddef.h>
#include <termios.h>

struct screen {
    int drawn_on;   /* standard output is a terminal that can do this */
    int reads_keys; /* and standard input is one, too */
    struct termios before;
};

/* Without a terminal it does nothing. */
void screen_begin(struct screen *s);
void screen_end(struct screen *s);
/* Begin a new picture at the top; what is printed to standard output then follows. */
void screen_clear(const struct screen *s);
/* Show it, and wait for so many milliseconds, a key or a caught signal (client/link/signals.h gives
 * the descriptor; -1: none). Returns the key, 0: none. */
int screen_wait(const struct screen *s, int signals_fd, int wait_ms);
