#include "client/table.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "protocol/message.h"

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

void table_add(struct table *t, const char *format, ...)
{
    char text[512], printable[512];
    char *copy;
    va_list args;

    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    copy = mem_strdup(message_text(printable, sizeof printable, text));
    if (!copy || !MEM_GROW(t->cells, t->cell_capacity, t->cell_count + 1)) {
        mem_free(copy);
        t->failed = 1;
        return;
    }
    t->cells[t->cell_count++] = copy;
}

static void print_cell(const char *text, size_t width, int right, int last)
{
    size_t columns = text_columns(text);
    int pad = columns < width ? (int)(width - columns) : 0;

    if (right)
        printf("%*s%s", pad, "", text);
    else if (last)
        fputs(text, stdout);
    else
        printf("%s%*s", text, pad, "");
    fputs(last ? "\n" : "  ", stdout);
}

status table_print(const struct table *t, struct error *err)
{
    size_t widths[TABLE_COLUMNS_MAX] = {0};
    int right[TABLE_COLUMNS_MAX] = {0};

    if (t->failed)
        return error_no_memory(err, "a table");
    for (size_t c = 0; c < t->column_count; c++) {
        right[c] = t->titles[c][0] == '>';
        widths[c] = text_columns(t->titles[c] + right[c]);
    }
    for (size_t i = 0; i < t->cell_count; i++) {
        size_t columns = text_columns(t->cells[i]);
        if (columns > widths[i % t->column_count])
            widths[i % t->column_count] = columns;
    }
    for (size_t c = 0; c < t->column_count; c++)
        print_cell(t->titles[c] + right[c], widths[c], right[c], c + 1 == t->column_count);
    for (size_t i = 0; i < t->cell_count; i++) {
        size_t c = i % t->column_count;
        print_cell(t->cells[i], widths[c], right[c], c + 1 == t->column_count);
    }
    return STATUS_OK;
}
