/* try: returns from an importer's function when a step fails. */
#ifndef AZULEJO_IMPORT_TRY_H
#define AZULEJO_IMPORT_TRY_H

#include "common/base/status.h"

#define TRY(call)                 \
    do {                          \
        status result_ = (call);  \
        if (result_ != STATUS_OK) \
            return result_;       \
    } while (0)

#endif
