/* progress: one line that shows the progress of some work, and if wanted more lines below it.
 *
 * On a terminal the line is redrawn in place, no wider than the terminal, in colour unless NO_COLOR is set; anywhere
 * else a plain line comes every few seconds. All of it goes to standard error, so that standard output stays clean.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

struct progress {
    int quiet, terminal, color;
    int drawn;        /* a line is on the terminal */
    size_t below;     /* and this many below it */
    uint64_t last_ns; /* of the last plain line; 0: none yet */
};

void progress_init(struct progress *p, int quiet);

/* fraction 0..1 (negative: not known, no bar), and the text beside it. */
void progress_draw(struct progress *p, double fraction, const char *text);

/* The same with `lines` below: printable text, each ends with a newline. A terminal shows as many as it
 * has room for. */
void progress_draw_lines(struct progress *p, double fraction, const char *text, const char *lines);

/* Remove the line, so that something else can be printed. */
void progress_clear(struct progress *p);
