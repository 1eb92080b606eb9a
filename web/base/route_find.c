#include <string.h>

#include "web/api/routes.h"

/* Does the path, of this size, match the pattern? A {name...} at the end takes the rest. The places of the
 * parameters, and their sizes. */
static int match(const char *pattern, const char *path, size_t at[WEB_PARAMETERS_MAX], size_t sizes[WEB_PARAMETERS_MAX],
                 size_t *count)
{
    const char *p = path;

    *count = 0;
    while (*pattern) {
        const char *close = strchr(pattern, '}');
        if (*pattern != '{' || !close) {
            if (*pattern++ != *p++)
                return 0;
            continue;
        }
        if (*count == WEB_PARAMETERS_MAX)
            return 0;
        at[*count] = (size_t)(p - path);
        sizes[*count] = close[-1] == '.' ? strlen(p) : strcspn(p, close[1] && close[1] != '/' ? "/." : "/");
        if (sizes[*count] == 0)
            return 0;
        p += sizes[(*count)++];
        pattern = close + 1;
    }
    return *p == 0;
}

const struct web_route *web_route_find(const struct web_routing *routing, enum web_method method, char *path,
                                       const char *parameters[WEB_PARAMETERS_MAX], unsigned *allowed)
{
    size_t at[WEB_PARAMETERS_MAX], sizes[WEB_PARAMETERS_MAX], count;
    const struct web_route *found = NULL;

    *allowed = 0;
    for (size_t i = 0; i < routing->count; i++) {
        if (!match(routing->routes[i].path, path, at, sizes, &count))
            continue;
        *allowed |= 1u << routing->routes[i].method;
        if (!found && routing->routes[i].method == method)
            found = &routing->routes[i];
    }
    memset(parameters, 0, WEB_PARAMETERS_MAX * sizeof *parameters);
    if (!found || !match(found->path, path, at, sizes, &count))
        return NULL;
    for (size_t i = 0; i < count; i++)
        parameters[i] = path + at[i];
    for (size_t i = 0; i < count; i++)
        path[at[i] + sizes[i]] = 0;
    return found;
}
