#include "common/scene/kernel_sets.h"

#define KERNEL_NAME general
#define KERNEL_EFFECTS KERNEL_SET_GENERAL
#include "worker/render/path/kernels/kernel.inc"
