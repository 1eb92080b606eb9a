#include "common/base/guess.h"

#include <limits.h>
#include <stdio.h>
#include <string.h>

/* How many letters must be added, removed, replaced or swapped with the next to make b of a (Damerau's distance without
 * repeated edits). UINT_MAX: a word is too long. */
static unsigned distance_of(const char *a, const char *b)
{
    size_t n = strlen(a), m = strlen(b);
    unsigned row[3][GUESS_WORD_MAX + 1];

    if (n > GUESS_WORD_MAX || m > GUESS_WORD_MAX)
        return UINT_MAX;
    for (size_t k = 0; k <= m; k++)
        row[0][k] = (unsigned)k;
    for (size_t i = 1; i <= n; i++) {
        unsigned *now = row[i % 3], *last = row[(i + 2) % 3], *before = row[(i + 1) % 3];

        now[0] = (unsigned)i;
        for (size_t k = 1; k <= m; k++) {
            unsigned best = last[k - 1] + (a[i - 1] != b[k - 1]);

            if (last[k] + 1 < best)
                best = last[k] + 1;
            if (now[k - 1] + 1 < best)
                best = now[k - 1] + 1;
            if (i > 1 && k > 1 && a[i - 1] == b[k - 2] && a[i - 2] == b[k - 1] && before[k - 2] + 1 < best)
                best = before[k - 2] + 1;
            now[k] = best;
        }
    }
    return row[n % 3][m];
}

void guess_try(struct guess *guess, const char *word)
{
    const unsigned distance = distance_of(guess->word, word);
    const size_t length = strlen(guess->word);

    if (distance > (length < 4 ? 1u : length < 8 ? 2u : 3u) || (guess->nearest && distance >= guess->distance))
        return;
    guess->nearest = word;
    guess->distance = distance;
}

const char *guess_hint(char out[GUESS_HINT_SIZE], const struct guess *guess)
{
    out[0] = 0;
    if (guess->nearest)
        snprintf(out, GUESS_HINT_SIZE, ": did you mean %s%s?", guess->prefix ? guess->prefix : "", guess->nearest);
    return out;
}
