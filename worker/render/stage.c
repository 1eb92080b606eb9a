#include "worker/render/stage.h"

_Thread_local _Atomic uint8_t stage_now;
