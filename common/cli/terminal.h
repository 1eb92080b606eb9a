/* terminal: how large the terminal is. */
#pragma once

#include <stddef.h>

/* The number of columns of the descriptor's terminal; $COLUMNS, else 80, if that is unknown. */
size_t terminal_columns(int fd);
/* And of rows: $LINES, else 24. */
size_t terminal_rows(int fd);
