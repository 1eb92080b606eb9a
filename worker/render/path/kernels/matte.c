#include "common/scene/kernel_sets.h"

#define KERNEL_NAME matte
#define KERNEL_EFFECTS KERNEL_SET_MATTE
#include "worker/render/path/kernels/kernel.inc"
