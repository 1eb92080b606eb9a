#include "client/terminal/table.h"

#include <ctype.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "common/cli/terminal.h"
#include "protocol/message.h"

#define CUT_MARK ".."
enum { CUT_MIN = 8 };

void table_init(struct table *t, const char *const *titles, size_t column_count)
{
    memset(t, 0, sizeof *t);
    t->titles = titles;
    t->column_count = column_count;
}

void table_release(struct table *t)
{
    for (size_t i = 0; i < t->cell_count; i++)
        mem_free(t->cells[i]);
    mem_free(t->cells);
    memset(t, 0, sizeof *t);
}

size_t text_columns(const char *text)
{
    size_t columns = 0;

    for (; *text; text++)
        columns += ((unsigned char)*text & 0xc0) != 0x80;
    return columns;
}

void text_cut(char *text, size_t columns)
{
    size_t seen = 0;

    for (char *at = text; *at; at++) {
        if (((unsigned char)*at & 0xc0) == 0x80)
            continue;
        if (seen == columns) {
            *at = 0;
            return;
        }
        seen++;
    }
}

/* Is this blank between two phrases? "frame 2: 35/255" is one. */
static int ends_phrase(const char *at)
{
    return strchr(",;)=", at[-1]) || (at[-1] == ':' && !isdigit((unsigned char)at[1])) || at[1] == '(' || at[1] == ' ';
}

/* The end of what fits, before a blank; 0: nothing. Phrases end outside of parentheses. */
static size_t fit_end(const char *text, size_t columns, int phrases)
{
    size_t seen = 0, end = 0;
    int depth = 0;

    for (const char *at = text; *at && seen <= columns; at++) {
        if (*at == ' ' && at > text && (!phrases || (depth == 0 && ends_phrase(at))))
            end = (size_t)(at - text);
        depth += (*at == '(') - (*at == ')');
        seen += ((unsigned char)*at & 0xc0) != 0x80;
    }
    while (phrases && end > 0 && strchr(" ,;:=", text[end - 1]))
        end--;
    return end;
}

static int fit_text(char *text, size_t columns, int phrases)
{
    size_t end = fit_end(text, columns, phrases);

    if (text_columns(text) <= columns)
        return 1;
    if (end > 0)
        text[end] = 0;
    return end > 0;
}

void text_fit_words(char *text, size_t columns)
{
    if (!fit_text(text, columns, 0))
        text_cut(text, columns);
}

int text_fit_phrases(char *text, size_t columns)
{
    if (fit_text(text, columns, 1))
        return 1;
    text_fit_words(text, columns);
    return 0;
}

void table_add(struct table *t, const char *format, ...)
{
    char text[512], printable[512];
    va_list args;

    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    MUST_GROW(t->cells, t->cell_capacity, t->cell_count + 1);
    t->cells[t->cell_count++] = must(mem_strdup(message_text(printable, sizeof printable, text)));
}

/* `mark`: the first letter of the column's title. */
static void print_cell(const char *text, size_t width, char mark, int last)
{
    size_t columns = text_columns(text);
    int pad = columns < width ? (int)(width - columns) : 0;
    char shown[512];

    if (columns > width && mark == '<') {
        snprintf(shown, sizeof shown, "%s", text);
        text_cut(shown, width - strlen(CUT_MARK));
        printf("%s" CUT_MARK, shown);
    } else if (mark == '>') {
        printf("%*s%s", pad, "", text);
    } else if (last) {
        fputs(text, stdout);
    } else {
        printf("%s%*s", text, pad, "");
    }
    fputs(last ? "\n" : "  ", stdout);
}

/* Narrow the columns whose texts may be cut, the first one first, so that the rows fit `columns`. */
static void fit(const struct table *t, size_t *widths, size_t columns)
{
    size_t all = 2 * (t->column_count - 1);

    for (size_t c = 0; c < t->column_count; c++)
        all += widths[c];
    for (size_t c = 0; c < t->column_count && all > columns; c++) {
        size_t cut = all - columns;

        if (t->titles[c][0] != '<' || widths[c] <= CUT_MIN)
            continue;
        cut = cut < widths[c] - CUT_MIN ? cut : widths[c] - CUT_MIN;
        widths[c] -= cut;
        all -= cut;
    }
}

/* Rows without the last column, whose texts follow on separate lines. */
static void print_with_notes(const struct table *t, const size_t *widths, const int *marked)
{
    size_t shown = t->column_count - 1;

    for (size_t c = 0; c < shown; c++)
        print_cell(t->titles[c] + marked[c], widths[c], t->titles[c][0], c + 1 == shown);
    for (size_t i = 0; i < t->cell_count; i++) {
        size_t c = i % t->column_count;
        if (c < shown)
            print_cell(t->cells[i], widths[c], t->titles[c][0], c + 1 == shown);
        else if (t->cells[i][0])
            printf("     %s\n", t->cells[i]);
    }
}

void table_print(const struct table *t)
{
    size_t widths[TABLE_COLUMNS_MAX] = {0};
    int marked[TABLE_COLUMNS_MAX] = {0};
    int notes = t->titles[t->column_count - 1][0] == '~' && isatty(STDOUT_FILENO);

    for (size_t c = 0; c < t->column_count; c++) {
        marked[c] = strchr("><~", t->titles[c][0]) != NULL;
        widths[c] = text_columns(t->titles[c] + marked[c]);
    }
    for (size_t i = 0; i < t->cell_count; i++) {
        size_t columns = text_columns(t->cells[i]);
        if (columns > widths[i % t->column_count])
            widths[i % t->column_count] = columns;
    }
    if (notes)
        widths[t->column_count - 1] = 0;
    if (isatty(STDOUT_FILENO))
        fit(t, widths, terminal_columns(STDOUT_FILENO));
    if (notes) {
        print_with_notes(t, widths, marked);
        return;
    }
    for (size_t c = 0; c < t->column_count; c++)
        print_cell(t->titles[c] + marked[c], widths[c], t->titles[c][0], c + 1 == t->column_count);
    for (size_t i = 0; i < t->cell_count; i++) {
        size_t c = i % t->column_count;
        print_cell(t->cells[i], widths[c], t->titles[c][0], c + 1 == t->column_count);
    }
}
