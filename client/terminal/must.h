/* must: memory, or the end of the program.
 *
 * A command that finds no memory says so in one line and ends with the exit status of STATUS_ERR_NO_MEMORY. Nothing needs
 * an orderly end: the private farm's programs die with their parent (client/link/child.h), the next run removes the
 * scratch folder (client/link/scratch.h), and files are written beside their places and then renamed. What common's functions
 * report is a status, and goes on as one. */
#pragma once

#include "common/base/buffer.h"
#include "common/base/memory.h"

/* From now on the JSON library's memory is taken in this way, too. */
void must_begin(void);

/* The block; NULL ends the program.  items = must(mem_alloc_array(count, sizeof *items)); */
void *must(void *block);
/* End the program if the buffer ran out of memory. */
void must_hold(const struct buffer *buffer);
/* Grow a typed array, as MEM_GROW. */
#define MUST_GROW(array, capacity, needed) must_(MEM_GROW(array, capacity, needed))
void must_(int done);
