#include "common/scene/kernel_sets.h"

#define KERNEL_NAME glass
#define KERNEL_EFFECTS KERNEL_SET_GLASS
#include "worker/render/path/kernels/kernel.inc"
