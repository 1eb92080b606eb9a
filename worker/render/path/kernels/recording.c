/* The general kernel with hooks that write down what a path does (record_hooks.h). It is not in the table of
 * variants: no picture is rendered with it. */
#include "common/scene/kernel_sets.h"

#define KERNEL_NAME recording
#define KERNEL_EFFECTS KERNEL_SET_GENERAL
#define KERNEL_RECORDS 1
#include "worker/render/path/kernels/kernel.inc"
