/* figures_view: the errors of a job's pictures and what smaller ones cost, for people and for
 * programs. */
#ifndef AZULEJO_CLIENT_FIGURES_VIEW_H
#define AZULEJO_CLIENT_FIGURES_VIEW_H

#include "client/farm/connection.h"
#include "client/terminal/format.h"
#include "client/terminal/json.h"
#include "common/accuracy/figures.h"
#include "common/base/buffer.h"

/* "3.1/255"; "?" when not known. */
const char *figures_display_text(char out[FORMAT_SIZE], double display);
/* "41 s", "9 min", "2.5 h", "3 d". */
const char *figures_time_text(char out[FORMAT_SIZE], double seconds);

/* In the form of common/accuracy; NULL: not known. */
struct accuracy_figures figures_get(const Azulejo__Wire__Figures *figures);

/* Append "3.1/255 (2.9 to 3.4) in 95 % of the pixels, 41.2 dB, RMSE 2.1 % of the mean (2 to 2.2)". */
void figures_describe(struct buffer *out, const Azulejo__Wire__Figures *figures);
/* Append "reliable", or "may be understated: " and why. */
void figures_describe_word(struct buffer *out, const Azulejo__Wire__Figures *figures, uint64_t effects);
/* Append "now 3.1/255 after 41 s; 2/255 in 2 min; 1/255 in 9 min (7 to 12) on these 3 workers";
 * nothing if nothing is known. */
void figures_describe_curve(struct buffer *out, const Azulejo__Wire__JobInfo *job);

/* The summary's lines. */
void figures_print(FILE *file, const Azulejo__Wire__JobInfo *job);
/* Set the job's keys: error, worst_error, flicker, forecasts, efficiency, cores. */
void figures_json(json_t *root, const Azulejo__Wire__JobInfo *job);

/* Request the history of a frame's error. The caller frees the answer. */
status history_query(struct connection *c, uint64_t job, uint32_t frame,
                     Azulejo__Wire__Envelope **out, struct error *err) MUST_CHECK;
json_t *history_json(const Azulejo__Wire__History *history);
status history_print(const Azulejo__Wire__History *history, struct error *err) MUST_CHECK;

#endif
