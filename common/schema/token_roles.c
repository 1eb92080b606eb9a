#include "common/schema/token_roles.h"

#include <string.h>

const char *web_role_name(enum web_role role)
{
    static const char *const names[WEB_ROLES] = {
#define ROLE(NAME, name, number) [number] = #name,
        TOKEN_ROLES(ROLE)
#undef ROLE
    };

    return role < WEB_ROLES ? names[role] : names[WEB_ROLE_NONE];
}

enum web_role web_role_parse(const char *word)
{
    for (int role = WEB_ROLE_NONE + 1; role < WEB_ROLES; role++)
        if (strcmp(word, web_role_name((enum web_role)role)) == 0)
            return (enum web_role)role;
    return WEB_ROLE_NONE;
}
