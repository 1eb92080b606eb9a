/* table: rows of text, printed in aligned columns.
 *
 * Cells may contain any text from the wire: control characters are replaced, so that a worker's
 * name cannot write escape sequences to a user's terminal.
 */
#pragma once

#include <stddef.h>

enum { TABLE_COLUMNS_MAX = 16 };

struct table {
    /* A title that starts with '>' sets its column flush right, one with '<' allows its texts to be
     * cut if a terminal is too narrow, the first such column first. The last one may start with '~': a column of notes, which a
     * terminal shows on separate lines below their rows. */
    const char *const *titles;
    size_t column_count;
    char **cells; /* [row][column], owned */
    size_t cell_count, cell_capacity;
};

void table_init(struct table *t, const char *const *titles, size_t column_count);
void table_release(struct table *t);

/* Add the next cell, row by row. */
void table_add(struct table *t, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Print to standard output. */
void table_print(const struct table *t);

/* The width of the text in columns of a terminal (code points; wide ones count once). */
size_t text_columns(const char *text);
/* Cut the text to `columns` at a character's boundary. */
void text_cut(char *text, size_t columns);
/* Cut the text to the phrases that fit, from the first one on: "35/255 (28 to 39) in 95 % of the pixels, 27 dB". 0: not
 * even one does; then to the words that fit. */
int text_fit_phrases(char *text, size_t columns);
void text_fit_words(char *text, size_t columns);
