#include "common/schema/job_states.h"

#include <string.h>

enum phase { OPEN, HELD, ENDED };

static const struct {
    const char *word;
    enum phase phase;
    const char *remedy;
} rows[JOB_STATE_COUNT] = {
#define STATE(NAME, name, number, phase, remedy) [number] = {#name, phase, remedy},
    JOB_STATES(STATE)
#undef STATE
};

static int is_state(int state) { return state >= 0 && state < JOB_STATE_COUNT; }

const char *job_state_word(int state) { return is_state(state) ? rows[state].word : "unknown"; }

int job_state_ended(int state) { return is_state(state) && rows[state].phase == ENDED; }

int job_state_is_open(int state) { return is_state(state) && rows[state].phase == OPEN; }

const char *job_state_remedy(int state) { return rows[state].remedy; }

unsigned job_state_find(const char *word, size_t length)
{
    for (unsigned s = 0; s < JOB_STATE_COUNT; s++)
        if (strlen(rows[s].word) == length && strncmp(rows[s].word, word, length) == 0)
            return 1u << s;
    return 0;
}

const char *job_state_words(void)
{
#define STATE(NAME, name, ...) ", " #name
    return &JOB_STATES(STATE)[2];
#undef STATE
}
