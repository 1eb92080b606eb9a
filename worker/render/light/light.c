#include "worker/render/light/light.h"

#define PLUS_ONE(...) +1
_Static_assert(0 LIGHT_KINDS_LISTED(PLUS_ONE) == LIGHT_KIND_COUNT,
               "each kind of SCENE_LIGHT_KINDS needs a row of LIGHT_KINDS_LISTED");
#undef PLUS_ONE

const struct light_row *light_row(int kind)
{
    static const struct light_row rows[] = {
#define ROW_LISTED(KIND, prefix, ...) \
    [LIGHT_##KIND] = {prefix##_new, prefix##_weigh},
#define ROW_FOUND(KIND, prefix, ...) \
    [LIGHT_##KIND] = {NULL, prefix##_weigh},
        LIGHT_KINDS_LISTED(ROW_LISTED)
        LIGHT_KINDS_FOUND(ROW_FOUND)
#undef ROW_LISTED
#undef ROW_FOUND
    };

    return &rows[kind];
}
