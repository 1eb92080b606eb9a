#include "common/schema/verbs.h"

#include <string.h>

const struct job_verb job_verbs[VERB_COUNT] = {
#define VERB(NAME, word, ROLE, run, text, help, ...) [VERB_##NAME] = {.name = #word, .path = #word, .says = text, __VA_ARGS__},
#define VARIANT(NAME, word, of, text, ...) [VERB_##NAME] = {.name = #word, .path = #of, .says = text, __VA_ARGS__},
    JOB_VERBS(VERB, VARIANT)
#undef VERB
#undef VARIANT
};

const struct job_verb *job_verb_find(const char *name)
{
    const struct job_verb *verb = job_verbs;

    while (strcmp(verb->name, name) != 0)
        verb++;
    return verb;
}

const struct job_verb *job_verb_variant(const struct job_verb *verb)
{
    for (int v = 0; v < VERB_COUNT; v++)
        if (strcmp(job_verbs[v].path, verb->name) == 0 && &job_verbs[v] != verb)
            return &job_verbs[v];
    return NULL;
}
