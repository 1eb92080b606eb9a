#include "common/schema/requests.h"

#include <stddef.h>
#include <string.h>

#define ANYBODY REQUEST_FROM_ANYBODY
#define WORKERS REQUEST_FROM_WORKERS
#define PEOPLE REQUEST_FROM_PEOPLE
#define PAGE REQUEST_FROM_PAGE

const struct request_rule request_rules[REQUEST_COUNT] = {
#define REQUEST(NAME, name, FROM, ROLE, OWN) [REQUEST_##NAME] = {#name, FROM, WEB_ROLE_##ROLE, REQUEST_IS_##OWN, 0},
#define ANSWER(NAME, name) [REQUEST_##NAME] = {#name, 0, WEB_ROLE_NONE, 0, 0},
#define PART(NAME, name, of, ROLE) [REQUEST_##NAME] = {#name, 0, WEB_ROLE_##ROLE, 0, 1},
#define VERB(NAME, name, ROLE, ...) [REQUEST_JOB_##NAME] = {"job_" #name, PEOPLE, WEB_ROLE_##ROLE, 1, 0},
    REQUESTS(REQUEST, ANSWER, PART) VERB_REQUESTS(VERB)
};

const struct request_rule *request_find(const char *name)
{
    for (size_t i = 0; i < REQUEST_COUNT; i++)
        if (!request_rules[i].is_part && strcmp(request_rules[i].name, name) == 0)
            return &request_rules[i];
    return NULL;
}
