#include "client/terminal/progress.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "client/terminal/table.h"
#include "common/system/clock.h"
#include "common/cli/terminal.h"
#include "protocol/message.h"

#define PLAIN_INTERVAL_NS (5 * NS_PER_SECOND)

enum { BAR_MAX = 40, BAR_MIN = 8, LINE_MAX_BYTES = 1024 };

void progress_init(struct progress *p, int quiet)
{
    const char *term = getenv("TERM");
    const char *no_color = getenv("NO_COLOR");

    memset(p, 0, sizeof *p);
    p->quiet = quiet;
    p->terminal = isatty(STDERR_FILENO) && term && *term && strcmp(term, "dumb") != 0;
    p->color = p->terminal && !(no_color && *no_color);
}

static void draw_in_place(struct progress *p, double fraction, const char *text)
{
    size_t width = terminal_columns(STDERR_FILENO) - 1; /* the last column would wrap on some terminals */
    char line[LINE_MAX_BYTES];
    size_t bar = 0, filled, used;

    message_text(line, sizeof line, text);
    if (fraction >= 0) {
        used = text_columns(line) + strlen("100% [] ");
        bar = used + BAR_MIN <= width ? width - used : 0;
        bar = bar > BAR_MAX ? BAR_MAX : bar;
        fprintf(stderr, "\r\033[K%3d%% ", (int)(fraction * 100));
        (void)text_fit_phrases(line, width > 5 ? width - 5 - (bar ? bar + 3 : 0) : 0);
    } else {
        fputs("\r\033[K", stderr);
        (void)text_fit_phrases(line, width);
    }
    if (bar) {
        filled = (size_t)(fraction * (double)bar);
        fprintf(stderr, "[%s", p->color ? "\033[32m" : "");
        for (size_t i = 0; i < bar; i++) {
            if (i == filled && p->color)
                fputs("\033[2m", stderr);
            fputc(i < filled ? '#' : '-', stderr);
        }
        fprintf(stderr, "%s] ", p->color ? "\033[0m" : "");
    }
    fputs(line, stderr);
    fflush(stderr);
    p->drawn = 1;
}

/* Draw below the line, and go back up to it. */
static void draw_below(struct progress *p, const char *lines)
{
    size_t width = terminal_columns(STDERR_FILENO) - 1, rows = terminal_rows(STDERR_FILENO);
    size_t room = rows > 2 ? rows - 2 : 0, count = 0, hidden = 0;
    char line[LINE_MAX_BYTES];

    for (const char *end; (end = strchr(lines, '\n')); lines = end + 1) {
        if (count == room) {
            hidden++;
            continue;
        }
        snprintf(line, sizeof line, "%.*s", (int)(end - lines), lines);
        (void)text_fit_phrases(line, width);
        fprintf(stderr, "\n\r\033[K%s", line);
        count++;
    }
    if (hidden && count > 0)
        fprintf(stderr, "\r\033[K... and %zu more", hidden + 1);
    fputs("\033[J", stderr);
    if (count > 0)
        fprintf(stderr, "\033[%zuA\r", count);
    fflush(stderr);
    p->below = count;
}

void progress_draw(struct progress *p, double fraction, const char *text)
{
    progress_draw_lines(p, fraction, text, "");
}

void progress_draw_lines(struct progress *p, double fraction, const char *text, const char *lines)
{
    uint64_t now = clock_monotonic_ns();
    char line[LINE_MAX_BYTES];

    if (p->quiet)
        return;
    if (!(fraction <= 1))
        fraction = 1;
    if (p->terminal) {
        draw_in_place(p, fraction, text);
        if (p->below > 0 || lines[0])
            draw_below(p, lines);
        return;
    }
    if (p->last_ns == 0) {
        p->last_ns = now; /* work shorter than the interval prints no line */
        return;
    }
    if (now - p->last_ns < PLAIN_INTERVAL_NS)
        return;
    p->last_ns = now;
    message_text(line, sizeof line, text);
    if (fraction >= 0)
        fprintf(stderr, "%3d%%  %s\n", (int)(fraction * 100), line);
    else
        fprintf(stderr, "%s\n", line);
    for (const char *end; (end = strchr(lines, '\n')); lines = end + 1) {
        snprintf(line, sizeof line, "%.*s", (int)(end - lines), lines);
        fprintf(stderr, "%s\n", line);
    }
}

void progress_clear(struct progress *p)
{
    if (p->drawn) {
        fputs(p->below ? "\r\033[J" : "\r\033[K", stderr);
        fflush(stderr);
    }
    p->drawn = 0;
    p->below = 0;
}
