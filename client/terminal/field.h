/* field: a labelled line of a summary: "  samples     1.23 M in 1.2 s". Anything but a terminal gets the whole text on one line.
 *
 * Its text may come from the wire: control characters are replaced. */
#pragma once

#include <stdio.h>

/* A sentence: a terminal gets it in lines of its width, broken between words. */
void field_print(FILE *file, const char *label, const char *text);
void field_printf(FILE *file, const char *label, const char *format, ...) __attribute__((format(printf, 3, 4)));
/* Figures: a terminal gets the first phrases, as many as fit; if not even one does, all of them as a sentence. */
void field_print_phrases(FILE *file, const char *label, const char *text);
