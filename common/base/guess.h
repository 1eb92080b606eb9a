/* guess: which of some words an unknown one was meant to be. Initialise with `word`, and `prefix` for the hint or NULL; offer
 * each with guess_try. */
#pragma once

enum { GUESS_WORD_MAX = 32, GUESS_HINT_SIZE = 80 }; /* longer words are like no other */

struct guess {
    const char *word, *prefix;
    const char *nearest; /* NULL: none is so near that it would be a slip */
    unsigned distance;
};

void guess_try(struct guess *guess, const char *word);
/* ": did you mean drain?", or "". */
const char *guess_hint(char out[GUESS_HINT_SIZE], const struct guess *guess);
