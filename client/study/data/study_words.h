/* study_words: a study in sentences, and the figures that they need. Plain UTF-8, no markup;
 * numbers have two or three significant digits in every locale. */
#pragma once

#include "client/study/data/study_data.h"

/* ---- numbers (appended) ---- */
void words_number(struct buffer *out, double value);     /* two digits: "0.83", "3.2", "11", "1230" */
void words_exact(struct buffer *out, double value);      /* as given: "3", "2.5" */
void words_count(struct buffer *out, double value);      /* "812", "4.2 thousand", "1.1 billion" */
void words_codes(struct buffer *out, double codes);      /* "3.2/255" */
void words_time(struct buffer *out, double seconds);     /* "41 s", "2 min", "1.3 h", "2.1 days" */
void words_core_time(struct buffer *out, double core_s); /* "0.8 core-hours" */
/* "1.25 EUR", "less than 0.01 EUR"; currency may be NULL. */
void words_price(struct buffer *out, double price, const char *currency);
void words_percent(struct buffer *out, double share); /* "83 %" */
/* " (0.7 to 1.1)"; nothing when a bound is not known. */
void words_range(struct buffer *out, const struct study_interval *v, double unit);

/* ---- figures ---- */
int study_has_fit(const struct study *s);
/* The fitted error after core_s; NaN without a fit. */
struct study_interval study_codes_after(const struct study *s, double core_s);
/* The cost of an error in codes by the fit; a bound that the fit cannot give is NaN. */
struct study_interval study_cost_of(const struct study *s, double codes);
/* What the target costs: as predicted, else by the fit. */
struct study_interval study_target_cost(const struct study *s);
/* The way of a render with a target error, where its time certainly differs from the usual one's; NULL: it does not. */
const struct study_choice *study_by_target(const struct study *s);
/* The cost of the target by that way. */
struct study_interval study_headline_cost(const struct study *s);
/* Tiles of 16x16 pixels; below some 100 a picture cannot show everything. */
double study_tiles(const struct study *s);
int study_is_small(const struct study *s);
/* Core seconds in a second on the clock, on the workers at hand; 1 when not known. */
double study_rate(const struct study *s);
/* "reliable", or "may be understated". */
const char *study_point_word(const struct study_point *point);
const struct study_point *study_last_point(const struct study *s); /* NULL: none */

/* Does a choice's time certainly differ by a twentieth or more? */
/* The gain, with an interval that holds for all ways of a study together. */
struct study_interval study_sure_gain(const struct study_choice *choice);
int study_time_differs(const struct study_choice *choice);
/* Does it certainly have a bias that a quarter of the target does not hide? */
int study_bias_counts(const struct study *s, const struct study_choice *choice);
/* How much a choice matters at the study's target: 0 is not at all, NaN not measured. */
double study_choice_weight(const struct study *s, const struct study_choice *choice);
double study_question_weight(const struct study *s, const struct study_question *question);
/* Can it be left out: is its bias certainly below a quarter of the target? */
int study_effect_is_spare(const struct study *s, const struct study_effect *effect);

/* Indices of all questions, those that matter most first; out[questions.count]. Equal ones keep their order. */
void study_order_questions(const struct study *s, size_t *out);
/* The same of the effects: bargains first (most time for least bias). */
void study_order_effects(const struct study *s, size_t *out);

/* ---- sentences (appended) ---- */
void study_say_headline(struct buffer *out, const struct study *s);
void study_say_wall(struct buffer *out, const struct study *s);    /* "That is 24 min on ..." */
void study_say_meaning(struct buffer *out, const struct study *s); /* the meaning of 3/255 */
/* Returns whether the figures are reliable. */
int study_say_trust(struct buffer *out, const struct study *s);
/* What a small picture cannot show; nothing for a large one. */
void study_say_small(struct buffer *out, const struct study *s);
void study_say_choice(struct buffer *out, const struct study *s, const struct study_choice *choice);
