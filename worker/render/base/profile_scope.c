#include "worker/render/base/profile_scope.h"

_Thread_local struct profile_place profile_place;
