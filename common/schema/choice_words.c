#include "common/schema/choices.h"

#include <stddef.h>

#include "common/film/health.h"
#include "common/scene/effects.h"
#include "common/scene/settings.h"
#include "common/scene/stages.h"

#define WORD(PREFIX, NAME, number, word) [number] = word,
#define WORDS(PREFIX, type, noun, ROWS) static const char *const noun##_words[] = {ROWS(WORD)};
CHOICES(WORDS)
static const char *const accuracy_words[] = {ACCURACY_REASONS(WORD)};
#define TEXT(NAME, text, ...) text,
static const char *const effect_words[] = {EFFECT_MAP(TEXT)};
static const char *const aov_words[] = {AOV_MAP(TEXT)};
static const char *const stage_words[] = {STAGE_MAP(TEXT)};
#define HEALTH(NAME, name, ...) #name,
static const char *const health_words[] = {HEALTH_MAP(HEALTH)};

#define LIST(words) {words, sizeof(words) / sizeof *(words)}
/* By number, of a set by bit. */
static const struct {
    const char *const *words;
    unsigned count;
} choices[CHOICE_COUNT] = {
#define ROW(PREFIX, type, noun, ROWS) [CHOICE_##PREFIX] = LIST(noun##_words),
    CHOICES(ROW)[CHOICE_ACCURACY] = LIST(accuracy_words),
    [CHOICE_EFFECT] = LIST(effect_words),
    [CHOICE_AOV] = LIST(aov_words),
    [CHOICE_STAGE] = LIST(stage_words),
    [CHOICE_HEALTH] = LIST(health_words),
};

const char *choice_word(enum choice_name choice, uint64_t number)
{
    return number < choices[choice].count ? choices[choice].words[number] : NULL;
}

int choice_find(enum choice_name choice, const char *word)
{
    for (unsigned i = 0; i < choices[choice].count; i++) {
        const char *a = choices[choice].words[i], *b = word;
        while (*a && (*a == *b || (*a == ' ' && *b == '-')))
            a++, b++;
        if (!*a && !*b)
            return (int)i;
    }
    return -1;
}

#define DEFINE(PREFIX, type, noun, ROWS)                                                                               \
    const char *noun##_name(enum type number)                                                                          \
    {                                                                                                                  \
        const char *word = choice_word(CHOICE_##PREFIX, (unsigned)number);                                             \
        return word ? word : "unknown";                                                                                \
    }                                                                                                                  \
                                                                                                                       \
    int noun##_parse(const char *word)                                                                                 \
    {                                                                                                                  \
        return choice_find(CHOICE_##PREFIX, word);                                                                     \
    }
CHOICES(DEFINE)

const char *effect_name(enum effect_bit bit)
{
    const char *word = choice_word(CHOICE_EFFECT, (unsigned)bit);

    return word ? word : "unknown";
}

int effect_parse(const char *name) { return choice_find(CHOICE_EFFECT, name); }
