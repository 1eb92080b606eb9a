#include "common/cli/completion.h"

#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"

void completion_init(struct completion *c, const char *program)
{
    memset(c, 0, sizeof *c);
    arena_init(&c->arena);
    c->program = program;
}

void completion_release(struct completion *c)
{
    mem_free(c->commands);
    arena_release(&c->arena);
    memset(c, 0, sizeof *c);
}

static int begins(const char *text, const char *with) { return strncmp(text, with, strlen(with)) == 0; }

/* What a name in capitals means. */
static enum completion_value value_of(const char *argument)
{
    static const char *const files[] = {"FILE", "PATH", "OUT", "PAGE", "PICTURE", "REFERENCE"};

    if (begins(argument, "SCENE|JOB"))
        return COMPLETE_FILE_OR_JOB;
    if (begins(argument, "JOB..."))
        return COMPLETE_JOBS;
    if (begins(argument, "JOB"))
        return COMPLETE_JOB;
    if (begins(argument, "FOLDER") || begins(argument, "DIR"))
        return COMPLETE_FOLDER;
    for (size_t i = 0; i < sizeof files / sizeof *files; i++)
        if (begins(argument, files[i]))
            return COMPLETE_FILE;
    return begins(argument, "SCENE") ? COMPLETE_FILE : COMPLETE_TEXT;
}

/* "a|b" as "a b"; NULL: no memory. */
static char *words_from(struct arena *arena, const char *choices)
{
    char *words = arena_strdup(arena, choices);

    for (char *at = words; at && *at; at++)
        if (*at == '|')
            *at = ' ';
    return words;
}

static int option_copy(struct arena *arena, struct completion_option *out, const struct option *row,
                       completion_words_fn *words_of)
{
    const char *words = row->argument && words_of ? words_of(row->argument) : NULL;
    size_t length = row->argument ? strlen(row->argument) : 0;

    out->name = arena_strdup(arena, row->name);
    out->letter = row->letter;
    out->repeats = row->kind == OPTION_LIST;
    out->help = arena_strdup(arena, row->help);
    out->argument = arena_strdup(arena, row->argument ? row->argument : "");
    if (!out->name || !out->help || !out->argument)
        return 0;
    if (row->kind == OPTION_FLAG) {
        out->value = COMPLETE_NOTHING;
    } else if (row->kind == OPTION_CHOICE) {
        out->value = COMPLETE_WORDS;
        out->words = words_from(arena, row->choices);
        return out->words != NULL;
    } else if (words) {
        out->value = length > 4 && strcmp(row->argument + length - 4, ",...") == 0 ? COMPLETE_LIST : COMPLETE_WORDS;
        out->words = words_from(arena, words);
        return out->words != NULL;
    } else {
        out->value = value_of(row->argument);
    }
    return 1;
}

/* "azulejo pause JOB... [OPTION]...": what follows the command's name. */
static int arguments_of(struct arena *arena, struct completion_command *command, const char *usage)
{
    const char *at = usage + strcspn(usage, " ");
    char word[64];

    if (command->name && *at)
        at += 1 + strcspn(at + 1, " ");
    at += *at == ' ';
    command->value = COMPLETE_NOTHING;
    if (*at < 'A' || strcspn(at, " ") >= sizeof word)
        return 1;
    memcpy(word, at, strcspn(at, " "));
    word[strcspn(at, " ")] = 0;
    if (word[0] >= 'a' && word[0] <= 'z') {
        command->value = COMPLETE_WORDS;
        command->words = words_from(arena, word);
        return command->words != NULL;
    }
    if (word[0] <= 'Z')
        command->value = value_of(word);
    return 1;
}

status completion_add(struct completion *c, const char *name, const char *summary, const char *usage,
                      const struct option *table, completion_words_fn *words_of, struct error *err)
{
    struct completion_command command = {0};
    size_t rows = 0;
    int ok;

    while (table[rows].name)
        rows++;
    command.name = name ? arena_strdup(&c->arena, name) : NULL;
    command.summary = arena_strdup(&c->arena, summary);
    command.options = ARENA_ARRAY(&c->arena, struct completion_option, rows + 1);
    ok = command.summary && command.options && (!name || command.name) && arguments_of(&c->arena, &command, usage) &&
         MEM_GROW(c->commands, c->capacity, c->count + 1);
    for (size_t i = 0; ok && i < rows; i++)
        if (table[i].kind != OPTION_GROUP)
            ok = option_copy(&c->arena, &command.options[command.count++], &table[i], words_of);
    NEED(ok, err, "a shell's completion");
    c->commands[c->count++] = command;
    return STATUS_OK;
}

status completion_write(const struct completion *c, const char *shell, struct buffer *out, struct error *err)
{
    if (strcmp(shell, "bash") == 0)
        completion_write_bash(c, out);
    else if (strcmp(shell, "zsh") == 0)
        completion_write_zsh(c, out);
    else
        completion_write_fish(c, out);
    return buffer_ok(out) ? STATUS_OK : error_no_memory(err, "a shell's completion");
}

status completion_print(const char *program, const char *shell, const char *usage, const struct option *table,
                        struct error *err)
{
    struct buffer text = BUFFER_INIT;
    struct completion c;
    status s;

    completion_init(&c, program);
    s = completion_add(&c, NULL, "", usage, table, NULL, err);
    THEN(s, completion_write(&c, shell, &text, err));
    if (s == STATUS_OK)
        fwrite(text.data, 1, text.size, stdout);
    buffer_release(&text);
    completion_release(&c);
    return s;
}
