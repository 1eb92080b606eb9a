/* starve: what happens when memory is exhausted, at whichever allocation. */
#pragma once

#include "common/base/status.h"

/* Call run(user) in processes of their own, whose allocation 0, 1, 2, ... fails, until none does. Each must end with one
 * line and the exit status of STATUS_ERR_NO_MEMORY (client/terminal/must.h), or return that status; at most `survivors`
 * of them may return STATUS_OK. Returns how many allocations there are. */
long starve_each(status (*run)(void *user), void *user, long survivors);
