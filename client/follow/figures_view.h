/* figures_view: the errors of a job's pictures and what smaller ones cost, for people. */
#pragma once

#include <stdio.h>

#include "client/link/connection.h"
#include "client/terminal/format.h"
#include "common/accuracy/figures.h"
#include "common/base/buffer.h"

/* "3.1/255"; "?" when not known. */
const char *figures_display_text(char out[FORMAT_SIZE], double display);
/* "41 s", "9 min", "2.5 h", "3 d". */
const char *figures_time_text(char out[FORMAT_SIZE], double seconds);

/* In the form of common/accuracy; NULL: not known. */
struct accuracy_figures figures_get(const Azulejo__Wire__Figures *figures);

/* Append "3.1/255 (2.9 to 3.4) in 95 % of the pixels, 41.2 dB, RMSE 2.1 % of the mean (2 to 2.2); worst part 7.2,
 * 12 fireflies". */
void figures_describe(struct buffer *out, const Azulejo__Wire__Figures *figures);
/* Append "reliable", or "may be understated: " and why. */
void figures_describe_word(struct buffer *out, const Azulejo__Wire__Figures *figures, uint64_t effects);
/* "RMSE 8.1 % of the mean raw, 2.3 % denoised". */
void figures_describe_both(struct buffer *out, const Azulejo__Wire__HistoryPoint *point);
/* Append "36 s left  7/255 now -> 5/255 at 1:26": the time left, the error, and the one that the job's rules will give after so
 * long in work; "(1:10 to 2:05)" where the time is uncertain. In no more than `columns`: the interval goes first, then "now",
 * the time left, and the milestone. Nothing if nothing is known. The page has the same words
 * (web/assets/format.js). */
void figures_describe_line(struct buffer *out, const Azulejo__Wire__JobInfo *job, size_t columns);
/* How the error moves, for a terminal that shows arrows: it falls, stands, rises; "": not known, or no such terminal. */
const char *figures_trend(double slope);
/* Append "now 3.1/255 after 41 s; 2/255 in 2 min; 1/255 would take 9 min (7 min to 12 min); 1.5/255 at the end, in 4 min on
 * these 3 workers": an error below that of the end will not come. Nothing if nothing is known. */
void figures_describe_curve(struct buffer *out, const Azulejo__Wire__JobInfo *job);

/* The summary's lines. */
void figures_print(FILE *file, const Azulejo__Wire__JobInfo *job);

/* Request the history of a frame's error. The caller frees the answer. */
status history_query(struct connection *c, uint64_t job, uint32_t frame, Azulejo__Wire__Envelope **out,
                     struct error *err) MUST_CHECK;
void history_print(const Azulejo__Wire__History *history);
