#include "worker/render/charge.h"

_Thread_local watched_byte charge_now;
