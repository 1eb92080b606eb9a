#include "common/cli/terminal.h"

#include <stdlib.h>
#include <sys/ioctl.h>

enum { COLUMNS_DEFAULT = 80, ROWS_DEFAULT = 24, SIZE_MAX_NAMED = 10000 };

/* What the terminal says, else the variable, else `usual`. */
static size_t size_of(int fd, int rows, const char *variable, size_t usual)
{
    struct winsize size;
    const char *text = getenv(variable);
    long named = text ? strtol(text, NULL, 10) : 0;

    if (ioctl(fd, TIOCGWINSZ, &size) == 0 && (rows ? size.ws_row : size.ws_col) > 0)
        return rows ? size.ws_row : size.ws_col;
    return named > 0 && named < SIZE_MAX_NAMED ? (size_t)named : usual;
}

size_t terminal_columns(int fd) { return size_of(fd, 0, "COLUMNS", COLUMNS_DEFAULT); }
size_t terminal_rows(int fd) { return size_of(fd, 1, "LINES", ROWS_DEFAULT); }
