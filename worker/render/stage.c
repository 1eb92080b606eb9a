#include "worker/render/stage.h"

_Thread_local watched_byte stage_now;
