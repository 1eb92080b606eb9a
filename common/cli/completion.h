/* completion: scripts that complete a program's command line in bash, zsh and fish, from its option tables.
 *
 *   completion_init --completion_add, once a command--> completion_write --> completion_release
 *
 * What an option or an argument takes follows from its row: a choice's words, and from the name of its
 * argument (FILE, FOLDER, JOB ...). Jobs are asked of the coordinator by
 * 'azulejo completion --jobs -- WORD...', which answers quickly or not at all.
 */
#pragma once

#include "common/base/arena.h"
#include "common/base/buffer.h"
#include "common/cli/options.h"
#include "common/base/status.h"

#define COMPLETION_SHELLS "bash|zsh|fish"

enum completion_value {
    COMPLETE_NOTHING,      /* a flag; a command without arguments */
    COMPLETE_TEXT,         /* anything: nothing is offered */
    COMPLETE_FILE,
    COMPLETE_FOLDER,
    COMPLETE_WORDS,        /* one of `words` */
    COMPLETE_LIST,         /* several of them, with commas in between */
    COMPLETE_JOB,          /* a number */
    COMPLETE_JOBS,         /* numbers and names */
    COMPLETE_FILE_OR_JOB,
};

struct completion_option {
    const char *name;
    char letter;
    int repeats;
    enum completion_value value;
    const char *words; /* "a b c"; NULL: none */
    const char *argument, *help;
};

struct completion_command {
    const char *name, *summary;  /* name NULL: of a program without commands */
    enum completion_value value; /* of its arguments */
    const char *words;
    struct completion_option *options;
    size_t count;
};

struct completion {
    struct arena arena;
    const char *program;
    struct completion_command *commands;
    size_t count, capacity;
};

/* The words for an argument that no table has, such as "STATE,...", with spaces in between; NULL: there are none. */
typedef const char *completion_words_fn(const char *argument);

void completion_init(struct completion *c, const char *program);
void completion_release(struct completion *c);
/* Add a command; `usage` as in options_print_help, `words_of` may be NULL. Copies everything. ERR_NO_MEMORY. */
status completion_add(struct completion *c, const char *name, const char *summary, const char *usage,
                      const struct option *table, completion_words_fn *words_of, struct error *err) MUST_CHECK;
/* Append the script for that shell. ERR_NO_MEMORY. */
status completion_write(const struct completion *c, const char *shell, struct buffer *out,
                        struct error *err) MUST_CHECK;

/* Print the script for a program without commands to standard output. ERR_NO_MEMORY. */
status completion_print(const char *program, const char *shell, const char *usage, const struct option *table,
                        struct error *err) MUST_CHECK;

/* completion_bash.c, completion_zsh.c, completion_fish.c */
void completion_write_bash(const struct completion *c, struct buffer *out);
void completion_write_zsh(const struct completion *c, struct buffer *out);
void completion_write_fish(const struct completion *c, struct buffer *out);
/* completion_text.c: the program's name as that of a shell's function: '-' becomes '_'. */
void completion_put_function(const struct completion *c, struct buffer *out);
/* The text with each character of `special` behind a backslash, without its end if it is long. */
void completion_put_help(struct buffer *out, const char *text, const char *special);
