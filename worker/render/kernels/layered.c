#include "common/scene/kernel_sets.h"

#define KERNEL_NAME layered
#define KERNEL_EFFECTS KERNEL_SET_LAYERED
#include "worker/render/kernels/kernel.inc"
