#include "common/scene/kernel_sets.h"

#define KERNEL_NAME textured
#define KERNEL_EFFECTS KERNEL_SET_TEXTURED
#include "worker/render/kernels/kernel.inc"
