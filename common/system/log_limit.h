/* log_limit: at most one line per period and subject, for events that strangers can cause at will.
 *
 * A subject is a short text, such as a peer's address. The first line about it is written. Those that follow within
 * LOG_LIMIT_PERIOD_MS are counted, and the first line after the period gives their number. LOG_LIMIT_SUBJECTS are
 * tracked separately; when all of them are within their period, the rest share one entry. Time is passed in.
 */
#pragma once

#include <stdint.h>

enum { LOG_LIMIT_PERIOD_MS = 60000, LOG_LIMIT_SUBJECTS = 64, LOG_LIMIT_SUBJECT_SIZE = 64 };

struct log_limit {
    struct log_limit_subject {
        char name[LOG_LIMIT_SUBJECT_SIZE]; /* cut to fit; empty: unused */
        uint64_t written_ns;               /* the last line; 0: none yet */
        uint64_t left_out;                 /* lines since then */
    } subjects[LOG_LIMIT_SUBJECTS], rest;
};

/* 1: write a line about the subject now, with *left_out, the number of lines suppressed since the last one; 0: do not
 * write, it is counted. now_ns is monotonic and above 0. A zeroed struct log_limit is ready for use. */
int log_limit_pass(struct log_limit *limit, const char *subject, uint64_t now_ns, uint64_t *left_out);
