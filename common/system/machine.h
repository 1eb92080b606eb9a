/* machine: the resources of this machine. */
#pragma once

#include <stdint.h>

/* Bytes of memory that this process could still take without pushing others out: the kernel's own estimate (page cache
 * included), and no more than its control group and its address space limit leave. UINT64_MAX if unknown. */
uint64_t machine_memory_available(void);

/* Bytes of memory that this machine has, or that this process's control groups allow it. 0 if unknown. */
uint64_t machine_memory_total(void);
