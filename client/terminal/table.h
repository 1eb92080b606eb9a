/* table: rows of text, printed in aligned columns.
 *
 * Cells may contain any text from the wire: control characters are replaced, so that a worker's
 * name cannot write escape sequences to a user's terminal.
 */
#ifndef AZULEJO_CLIENT_TABLE_H
#define AZULEJO_CLIENT_TABLE_H

#include <stddef.h>

#include "common/base/status.h"

enum { TABLE_COLUMNS_MAX = 16 };

struct table {
    /* A title that starts with '>' sets its column flush right, one with '<' allows its texts to be
     * cut if a terminal is too narrow, the first such column first. The last one may start with '~': a column of notes, which a
     * terminal shows on separate lines below their rows. */
    const char *const *titles;
    size_t column_count;
    char **cells;              /* [row][column], owned */
    size_t cell_count, cell_capacity;
    int failed;
};

void table_init(struct table *t, const char *const *titles, size_t column_count);
void table_release(struct table *t);

/* Add the next cell, row by row. */
void table_add(struct table *t, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Print to standard output. ERR_NO_MEMORY when a cell could not be kept. */
status table_print(const struct table *t, struct error *err) MUST_CHECK;

/* The width of the text in columns of a terminal (code points; wide ones count once). */
size_t text_columns(const char *text);
/* Cut the text to `columns` at a character's boundary. */
void text_cut(char *text, size_t columns);

/* The number of columns of the descriptor's terminal; $COLUMNS, else 80, if that is unknown. */
size_t terminal_columns(int fd);
/* And of rows: $LINES, else 24. */
size_t terminal_rows(int fd);

#endif
