/* table: rows of text, printed in aligned columns.
 *
 * Cells may hold anything that came over a wire: control characters are replaced, so that
 * a worker's name cannot write escape sequences to somebody's terminal.
 */
#ifndef AZULEJO_CLIENT_TABLE_H
#define AZULEJO_CLIENT_TABLE_H

#include <stddef.h>

#include "common/base/status.h"

enum { TABLE_COLUMNS_MAX = 16 };

struct table {
    /* A title that starts with '>' sets its column flush right, one with '<' lets its texts be cut
     * where a terminal is too narrow. The last one may start with '~': a column of notes, which a
     * terminal gets on lines of their own below their rows. */
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

/* How many columns of a terminal the text takes (code points; wide ones count once). */
size_t text_columns(const char *text);
/* Cut to so many columns at a character's boundary. */
void text_cut(char *text, size_t columns);

/* How many columns the terminal behind the descriptor has; $COLUMNS, else 80, where it does not
 * say. */
size_t terminal_columns(int fd);

#endif
