#include "common/scene/kernel_sets.h"

#define KERNEL_NAME opaque
#define KERNEL_EFFECTS KERNEL_SET_OPAQUE
#include "worker/render/kernels/kernel.inc"
