/* study_files: the study on disk (page, table, data, plots) and in the terminal. */
#pragma once

#include "client/study/data/study_data.h"

/* Append every measured point as CSV (RFC 4180), with a line of names. */
void study_csv(struct buffer *out, const struct study *s);

/* Write PAGE.html and, unless page_only, beside it PAGE.csv, PAGE.json and each plot as
 * PAGE-plot.svg and .png. `page` ends in ".html". A plot that could not be made into a PNG is
 * ERR_INCOMPLETE with the remedy; all other files are written then. ERR_IO, ERR_NO_MEMORY. */
status study_files_write(const struct study *s, const char *page, int page_only, struct error *err) MUST_CHECK;

/* Print the ten lines. */
void study_print(const struct study *s);
